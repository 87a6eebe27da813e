"""The most probable unknowns of one frame: Gauss-Newton steps in a trust region, from a Gaussian prior and readings.

The unknowns ``x`` have the prior mean ``x0`` and covariance ``P``, which may be singular, as where the history of a
hole is known exactly. They are sought as ``x0 + P v``, so that ``P`` is never inverted: the misfit is

    v P v + |(y - h(x)) / sigma|^2 ,

and the step of Gauss and Newton leads to ``v = H' (H P H' + R)^-1 (y - h + H P v)``, the iterated Kalman filter (B. M.
Bell, F. W. Cathey, IEEE Trans. Autom. Control 38 (1993) 294-297).

`scipy.optimize.least_squares` solves more states a frame on the problem of the campaign ``estimate``: its first step is
at most one standard deviation long, and it solves one more state to see that it has converged.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, Protocol, TypeVar

import numpy as np

from tdcr_fe.elements import Array

#: First radius of the trust region, and the smallest [standard deviations]. With a first one of 3, 5 and 10, there were
#: 1, 3 and 12 of 300 frames that were not solved, with tensions known to 0.1 N; with 1.5 and 2 there was none.
FIRST_RADIUS, LEAST_RADIUS = 2.0, 1e-3
#: The iteration has converged where the linear model could lower the misfit by less than this [1].
CONVERGED_GAIN = 0.1
#: The iteration has failed where the linear model could still lower the misfit by more than this, and by over 1 % [1].
FAILED_GAIN = 5.0
#: A state whose misfit is below this for each reading explains them, though a hole that begins to slip or to stick may
#: end the iteration before the linear model has nothing left to gain [1]. Where curvatures are read, the state before
#: is further off than one above half of this.
PLAUSIBLE = 10.0
#: States that are solved at most.
MOST_STATES = 30


class SolvedState(Protocol):
    """A solved state."""

    @property
    def residual(self) -> Array:
        """Readings less their predictions, over their standard deviations, shape (n_readings,)."""

    @property
    def jacobian(self) -> Array:
        """Derivatives of the predictions by the unknowns, over the same, shape (n_readings, n)."""


P = TypeVar("P", bound=SolvedState)


@dataclass(frozen=True, eq=False)
class Found(Generic[P]):
    """Where the iteration ended."""

    point: P  # The last one that was solved, where derivatives are taken
    unknowns: Array  # (n,): Where the linear model there has its least misfit; or as solved, where that is not trusted
    pull: Array  # (n,): ``v`` there
    misfit: float
    possible_gain: float  # By how much the linear model could still lower the misfit [1]
    states: int  # That were solved

    @property
    def converged(self) -> bool:
        """Whether this is the most probable state, nearly."""
        plausible = self.misfit <= PLAUSIBLE * len(self.point.residual)
        return plausible or self.possible_gain <= max(FAILED_GAIN, 0.01 * self.misfit)


def most_probable(
    solve: Callable[[Array, P | None], P | None],
    mean: Array,
    covariance: Array,
    start: Array,
    near: P | None = None,
) -> Found[P] | None:
    """Find the most probable unknowns.

    Parameters
    ----------
    solve
        From unknowns and a state nearby, if there is one, to the state; None where there is no solution.
    mean, covariance
        Mean and covariance of the prior, shapes (n,) and (n, n).
    start
        ``v`` to begin from, shape (n,).
    near
        The state nearby with which the first state is solved.

    Returns
    -------
    Found or None
        None where the first state has no solution.
    """
    v = start
    point = solve(mean + covariance @ v, near)
    if point is None:
        return None

    def misfit(v: Array, at: P) -> float:
        return float(v @ covariance @ v + at.residual @ at.residual)

    radius, states, value, before = FIRST_RADIUS, 1, misfit(v, point), FIRST_RADIUS
    while True:
        linear = _Linear(v, covariance, point.residual, point.jacobian)
        step = linear.step(0.0)
        gain, length = linear.gain(step), linear.length(step)
        # The linear model has missed the readings by the square of the step that led here.
        if gain * min(1.0, length / before) ** 4 <= CONVERGED_GAIN:
            v, value, gain = v + step, value - gain, 0.0
            break
        better = None
        while better is None and radius > LEAST_RADIUS and states < MOST_STATES:
            step = linear.step_within(radius)
            at, states = solve(mean + covariance @ (v + step), point), states + 1
            lowered = -np.inf if at is None else value - misfit(v + step, at)
            expected = linear.gain(step)
            if at is not None and lowered > 0.1 * expected:
                better = at
                radius *= 2.0 if lowered > 0.7 * expected else 1.0
            else:
                radius = 0.25 * linear.length(step)
        if better is None:
            break
        point, v, before = better, v + step, linear.length(step)
        value = misfit(v, point)
    return Found(point, mean + covariance @ v, v, value, gain, states)


def linear_start(covariance: Array, residual: Array, jacobian: Array) -> Array:
    """``v`` that a linear model predicts in the first trust region; the residual is that of the prior mean."""
    return _Linear(np.zeros(len(covariance)), covariance, residual, jacobian).step_within(FIRST_RADIUS)


def posterior_covariance(covariance: Array, jacobian: Array) -> Array:
    """Covariance of the unknowns given the readings, from that of the prior and `SolvedState.jacobian`."""
    cross = covariance @ jacobian.T
    return np.asarray(covariance - cross @ np.linalg.solve(jacobian @ cross + np.eye(len(jacobian)), cross.T))


@dataclass(frozen=True, eq=False)
class _Linear:
    """The problem linearised at ``v``."""

    v: Array
    covariance: Array
    residual: Array
    jacobian: Array

    @cached_property
    def _cross_covariance(self) -> Array:
        """Covariance of unknowns and readings, ``P H'``."""
        return self.covariance @ self.jacobian.T

    def step(self, damping: float) -> Array:
        """Step that minimises the misfit plus the damping times its own size, as ``v``."""
        scale = 1.0 + damping
        matrix = self.jacobian @ self._cross_covariance + scale * np.eye(len(self.residual))
        weights = np.linalg.solve(matrix, scale * self.residual + self.v @ self._cross_covariance)
        return np.asarray((self.jacobian.T @ weights - self.v) / scale)

    def step_within(self, radius: float) -> Array:
        """Step damped until it is no longer than a radius [standard deviations]."""
        damping, step = 0.0, self.step(0.0)
        while self.length(step) > radius:
            damping = 4.0 * damping or 1.0
            step = self.step(damping)
        return step

    def length(self, step: Array) -> float:
        """Length of a step [standard deviations]."""
        return math.sqrt(max(float(step @ self.covariance @ step), 0.0))

    def gain(self, step: Array) -> float:
        """By how much a step lowers the misfit."""
        after = self.residual - step @ self._cross_covariance
        change = 2.0 * self.v + step
        return float(self.residual @ self.residual - after @ after - change @ self.covariance @ step)
