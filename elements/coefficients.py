"""Friction coefficients that depend on normal force, slip rate and turning angle at a hole, solved with the tensions.

The coefficients ``mu`` set the tensions, and the tensions set the normal forces and, where tendons stretch, the slip
rates. So ``mu = law(N(T(mu)), v(T(mu)))`` is solved by Newton's method, and the derivatives of the tensions follow from
the implicit function theorem.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from tdcr_fe.elements import Array, Flags
from tdcr_fe.elements.capstan import Slopes, TensionDerivatives
from tdcr_fe.elements.hysteresis import ACCEPTED

#: Most iterations, also for mobilisations of elastic tendons, and for tensions that agree with turning angles.
MAX_ITERATIONS = 30


class CoefficientLaw(Protocol):
    """Law of the friction coefficient at a hole."""

    def coefficient(self, normal_force: Array, slip_rate: Array, turning_angle: Array) -> tuple[Array, ...]:
        """Coefficient of friction and its derivatives, hole by hole.

        Parameters
        ----------
        normal_force
            See `normal_forces` [N], shape (k,).
        slip_rate
            Rate at which the tendon passes the hole, positive towards the base [m/s], shape (k,).
        turning_angle
            By which the tendon turns at the hole [rad], not negative, shape (k,).

        Returns
        -------
        mu, dmu_dnormal, dmu_drate, dmu_dangle : ndarray, shape (k,)
            Coefficient, not negative [1], and its derivatives by the three arguments [1/N, s/m, 1/rad].
        """


class Coefficients(NamedTuple):
    """Coefficients of all holes, and their derivatives by what they depend on, each of shape (m, n-1)."""

    value: Array
    by_normal: Array
    by_rate: Array
    by_angle: Array


def normal_forces(tension: Array, angles: Array) -> Array:
    """Normal force at every hole, ``(T_k + T_k+1) sin(theta_k / 2)`` [N], shape (m, n-1).

    Both segments pull on the piece of tendon inside the hole. Along their bisector the pulls add to this, which the
    hole bears; across it they differ by ``(T_k - T_k+1) cos(theta_k / 2)``, which is the friction.
    """
    return np.asarray((tension[:, :-1] + tension[:, 1:]) * np.sin(0.5 * angles))


def evaluate_laws(
    laws: Sequence[tuple[CoefficientLaw, Flags]], constant: Array, normal: Array, rate: Array, angle: Array
) -> Coefficients:
    """Coefficients of all holes.

    Parameters
    ----------
    laws
        With the holes that follow them.
    constant
        Coefficients of the other holes [1], shape (m, n-1).
    normal, rate, angle
        Normal forces [N], slip rates [m/s] and turning angles [rad], shape (m, n-1).
    """
    found = Coefficients(constant.copy(), *np.zeros((3, *constant.shape)))
    for law, holes in laws:
        own = law.coefficient(normal[holes], rate[holes], angle[holes])
        for target, values in zip(found, own, strict=True):
            target[holes] = values
    return found


class Linearisation(NamedTuple):
    """Tensions for given coefficients, and the coefficients that the laws return at those tensions."""

    tension: Array  # (m, n): [N]
    slopes: Slopes  # Derivatives of the tensions for given coefficients
    law: Coefficients  # Coefficients that the laws return at these tensions
    by_tension: Array  # (m, n-1, n): Derivatives of the laws' coefficients by the tensions [1/N]
    by_coefficient: Array  # (m, n, n-1): Derivatives of the tensions by the coefficients [N]

    @property
    def matrix(self) -> Array:
        """Derivative of ``mu - law(mu)`` by ``mu``, shape (m, n-1, n-1)."""
        return np.asarray(np.eye(self.by_tension.shape[1]) - self.by_tension @ self.by_coefficient)


def solve_coefficients(linearise: Callable[[Array], Linearisation], start: Array) -> Linearisation:
    """The linearisation at coefficients that satisfy the laws at the tensions they lead to.

    Newton's method, its steps halved where they increase the error.

    Parameters
    ----------
    linearise
        Returns the linearisation for given coefficients.
    start
        Coefficients to start from [1], shape (m, n-1).

    Returns
    -------
    Linearisation
        Its tensions are nan where no solution was found.
    """
    mu, now = start, linearise(start)
    error = float(np.max(np.abs(now.law.value - mu), initial=0.0))
    for _ in range(MAX_ITERATIONS):
        if error <= ACCEPTED:
            return now
        try:
            step = np.linalg.solve(now.matrix, (now.law.value - mu)[..., None])[..., 0]
        except np.linalg.LinAlgError:
            step = now.law.value - mu
        factor = 1.0
        while True:
            trial = np.maximum(mu + factor * step, 0.0)
            there = linearise(trial)
            new = float(np.max(np.abs(there.law.value - trial)))
            if new < error or factor <= 1.0 / 16.0:
                break
            factor *= 0.5
        mu, now, error = trial, there, new
    return now._replace(tension=np.full_like(now.tension, np.nan))


def tension_derivatives(
    solved: Linearisation, angles: Array, rate_by_length: Array, hole_incidence: Array
) -> TensionDerivatives:
    """Derivatives of the tensions, the coefficients of friction following their laws.

    Parameters
    ----------
    solved
        Linearisation at the coefficients that satisfy the laws.
    angles
        Turning angles [rad], shape (m, n-1).
    rate_by_length
        Derivatives of the slip rates at the holes by the segments' lengths at kept tensions [1/s], shape (m, n-1, n).
    hole_incidence
        From the mobilisations to the holes, shape (n-1, g).
    """
    tension = solved.tension
    n, h, g = tension.shape[1], angles.shape[1], hole_incidence.shape[1]
    # Implicit function theorem: dT = E + B dmu, (I - G B) dmu = G E + ..., with E the change at kept coefficients.
    by_shape, by_base, by_mobilisation = solved.slopes().derivatives(hole_incidence)
    kept = np.concatenate((by_shape[:, :, n:], by_mobilisation, by_base[:, :, None]), axis=2)
    change = solved.by_tension @ kept
    hole = np.arange(h)
    force_by_angle = 0.5 * (tension[:, :-1] + tension[:, 1:]) * np.cos(0.5 * angles)
    change[:, hole, hole] += solved.law.by_normal * force_by_angle + solved.law.by_angle
    by_length = solved.law.by_rate[:, :, None] * rate_by_length
    right = np.concatenate((by_length, change), axis=2)
    total = solved.by_coefficient @ np.linalg.solve(solved.matrix, right)
    total[:, :, n:] += kept
    by_shape, by_mobilisation, by_base = np.split(total, (n + h, n + h + g), axis=2)
    return TensionDerivatives(by_shape, by_base[:, :, 0], by_mobilisation)
