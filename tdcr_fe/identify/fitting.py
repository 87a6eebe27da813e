"""Fit the parameters of effects to the readings: weighted, bounded, robust least squares on solver sensitivities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from tdcr_fe.effects import Effect
from tdcr_fe.identify.problem import Fit, FitProblem, Point
from tdcr_fe.identify.run import Run

Array = NDArray[np.float64]

#: A parameter whose typical step changes the readings by less than this, rms over sigma, is not fitted.
NOTHING = 0.02

#: Share of the extrapolated discretisation error that may be wrong.
UNSURE = 1.0 / 3.0

#: Assumed error of the simulation, as a fraction of the length and in radians [1, rad].
NUMERICS = 2e-5


def sensitivities(
    problem: FitProblem, effects: Sequence[Effect], fit: Fit, free: Sequence[tuple[str, str]], steps: Array
) -> Array:
    """Derivatives of the predictions over sigma by the coordinates, by runs beside the present one, (n, p)."""
    z = problem.coordinates(effects, fit.values, free)
    points, taken = [], []
    by_name = {e.name: e for e in effects}
    for j, k in enumerate(free):
        low, high = problem.bounds(by_name[k[0]], k[1])
        h = steps[j] if z[j] + steps[j] <= high else -steps[j]
        if z[j] + h < low:
            h = max(high - z[j], low - z[j], key=abs)
        moved = z.copy()
        moved[j] += h
        taken.append(h)
        points.append(problem.point(effects, fit.values, free, moved))
    found, _ = problem.residuals(effects, points, reference=fit.run)
    columns = [(fit.residual - r) / h for r, h in zip(found, taken, strict=True)]
    matrix = np.stack(columns, axis=1) if columns else np.zeros((fit.residual.size, 0))
    return np.where(np.isfinite(matrix), matrix, 0.0)


def fit(
    problem: FitProblem,
    effects: Sequence[Effect],
    starts: Sequence[Point],
    give_up_above: float = float("inf"),
    max_iterations: int = 12,
    reference: Run | None = None,
    polish: bool = True,
) -> Fit:
    """Levenberg and Marquardt with bounds.

    During the iteration every run follows the reference path of the previous one, which is fast. The result is then
    simulated on its own path, and improved from there if it differs.

    Parameters
    ----------
    problem
        Readings and forward model.
    effects
        Whose parameters are fitted.
    starts
        Points to begin from; the best is taken. The second and later ones are tried only where the first does not
        improve on ``reference`` alone.
    give_up_above
        A fit that converges slowly while its cost is above this is abandoned.
    max_iterations
        Steps.
    reference
        A neighbour's run for the starting points.
    polish
        Iterate to convergence; see `finish`.

    Returns
    -------
    Fit
        Parameters that change nothing on these readings stay where they began and are not free.
    """
    effects = tuple(effects)
    found, runs = problem.residuals(effects, starts, reference, record=True)
    costs = [problem.cost(r) for r in found]
    best = int(np.argmin([c[0] for c in costs]))
    every = tuple((e.name, p.name) for e in effects for p in e.parameters)
    now = Fit(
        effects,
        starts[best],
        found[best],
        *costs[best],
        np.zeros((len(problem.readings.values), 0)),
        every,
        runs[best],
    )
    if not np.isfinite(now.cost):
        return now
    if polish:
        return finish(problem, now, give_up_above, max_iterations)
    return _descend(problem, now, give_up_above, max_iterations, last=False)


def finish(
    problem: FitProblem, now: Fit, give_up_above: float = float("inf"), max_iterations: int = 12
) -> Fit:
    """Improve a fit to the end, on its own path, with the sensitivities there."""
    for _ in range(2):
        now = _descend(problem, now, give_up_above, max_iterations)
        if now.cost > give_up_above:
            break
        (r,), (run,) = problem.residuals(now.effects, [now.values], record=True)
        free_run = replace(now, residual=r, cost=problem.cost(r)[0], held_cost=problem.cost(r)[1], run=run)
        if not np.isfinite(free_run.cost):
            return free_run
        change = abs(free_run.cost - now.cost)
        now = free_run
        if change < 1.0 + 1e-2 * now.cost:
            break
    return now


class _LinearModel(NamedTuple):
    """Predictions over sigma around a fit, linear in the coordinates of the free parameters.

    Attributes
    ----------
    free : tuple of (str, str)
    matrix : ndarray, shape (n, p)
        Sensitivities.
    size : ndarray, shape (p,)
        Root mean square of its columns over the fitted readings, where it was evaluated last.
    scale : ndarray, shape (p,)
        Typical steps of the coordinates.
    steps : ndarray, shape (p,)
        Steps of the difference quotients.
    """

    free: tuple[tuple[str, str], ...]
    matrix: Array
    size: Array
    scale: Array
    steps: Array

    @classmethod
    def of(cls, problem: FitProblem, now: Fit) -> _LinearModel:
        """Of a fit; without its sensitivities where it has none."""
        natural = {(e.name, p.name): p.scale for e in now.effects for p in e.parameters}
        scale = np.array([problem.scales.get(k, natural[k]) for k in now.free])
        if now.jacobian.shape[1] != len(now.free):
            return cls(now.free, now.jacobian, np.ones(len(now.free)), scale, 0.2 * scale)
        size = np.sqrt(np.mean(now.jacobian[problem.fitted] ** 2, axis=0))
        steps = np.clip(1.0 / np.maximum(size, 1e-300), 1e-3 * scale, 0.5 * scale)
        return cls(now.free, now.jacobian, size, scale, steps)

    def evaluated(self, problem: FitProblem, now: Fit) -> _LinearModel:
        """With its sensitivities at a fit, without parameters that change nothing."""
        matrix = sensitivities(problem, now.effects, now, self.free, self.steps)
        size = np.sqrt(np.mean(matrix[problem.fitted] ** 2, axis=0))
        free, scale = self.free, self.scale
        keep = size * scale > NOTHING
        if not np.all(keep):
            free = tuple(k for k, ok in zip(free, keep, strict=True) if ok)
            matrix, size, scale = matrix[:, keep], size[keep], scale[keep]
        # The next derivatives: over a change of the readings by one sigma.
        steps = np.clip(1.0 / size, 1e-3 * scale, 0.5 * scale)
        return _LinearModel(free, matrix, size, scale, steps)

    def updated(self, change: Array, move: Array) -> _LinearModel:
        """By Broyden's method, from the change of the predictions (n,) over a step of the coordinates (p,)."""
        weight = self.size**2
        error = change - self.matrix @ move
        update = np.outer(error, weight * move) / float(np.sum(weight * move**2))
        return self._replace(matrix=self.matrix + update)


def _descend(
    problem: FitProblem, now: Fit, give_up_above: float, max_iterations: int, last: bool = True
) -> Fit:
    """Iterate from a fit on the path of its run.

    Between full evaluations of the sensitivities they are updated by Broyden's method, which costs no run.
    ``last``: evaluate them once more at the end.
    """
    model = _LinearModel.of(problem, now)
    damping = 1e-3
    # The sensitivities came with the fit; were evaluated at the present point; have to be evaluated.
    known = now.jacobian.shape[1] == len(now.free)
    fresh, stale = False, not known
    for _ in range(max_iterations if model.free else 0):
        if stale:
            model = model.evaluated(problem, now)
            if not model.free:
                break
            fresh, stale = True, False
        z, move, promised = _proposal(problem, now, model.free, model.matrix, damping)
        if promised < 0.02 + 2e-4 * now.cost:
            if fresh or known:
                break
            stale = True
            continue
        trial = _moved(problem, now, model.free, z + move)
        if not trial.cost < now.cost:
            damping *= 100.0
            if not fresh:
                stale = True
            elif damping > 1e6:
                break
            continue
        gain = now.cost - trial.cost
        if gain > 0.25 * promised:
            damping = max(1e-6, 0.1 * damping)
        model = model.updated(now.residual - trial.residual, move)
        was_exact, known, fresh, stale = fresh or known, False, False, gain < 0.5 * promised
        now = trial
        if gain < 0.05 + 1e-3 * now.cost and (was_exact or promised < 2.0 * gain):
            break
        if now.cost > give_up_above and gain < 0.5 * now.cost and not was_exact:
            break
    matrix = model.matrix
    if model.free and last and not (fresh or known):
        matrix = sensitivities(problem, now.effects, now, model.free, model.steps)
    return replace(now, jacobian=matrix, free=model.free)


def _moved(problem: FitProblem, now: Fit, free: tuple[tuple[str, str], ...], z: Array) -> Fit:
    """A fit with the free parameters at other coordinates, on the path of its run."""
    point = problem.point(now.effects, now.values, free, z)
    (r,), (run,) = problem.residuals(now.effects, [point], now.run, record=True)
    cost, held_cost = problem.cost(r)
    return replace(now, values=point, residual=r, cost=cost, held_cost=held_cost, run=run, free=free)


def _proposal(
    problem: FitProblem, now: Fit, free: Sequence[tuple[str, str]], j: Array, damping: float
) -> tuple[Array, Array, float]:
    """Coordinates, the next step from them, and the fall of the cost predicted by the linear model."""
    fitted = problem.fitted
    by_name = {e.name: e for e in now.effects}
    z = problem.coordinates(now.effects, now.values, free)
    limits = np.array([problem.bounds(by_name[k[0]], k[1]) for k in free])
    a = np.abs(now.residual)
    threshold = problem.robust_threshold
    w = np.sqrt(np.where(a <= threshold, 1.0, threshold / np.maximum(a, 1e-300)))[fitted]
    jw, rw = j[fitted] * w[:, None], now.residual[fitted] * w
    norm = np.linalg.norm(jw, axis=0)
    move = _bounded_step(jw, rw, norm, damping, limits[:, 0] - z, limits[:, 1] - z)
    return z, move, float(np.sum(rw**2) - np.sum((rw - jw @ move) ** 2))


def covariance(problem: FitProblem, fit: Fit, inflate: bool = True) -> Array:
    """Of the coordinates of the free parameters, shape (p, p).

    Enlarged where the misfit is above noise, and by the effect of the simulation's own errors.
    """
    if not fit.free:
        return np.zeros((0, 0))
    fitted = ~problem.held_out
    w = np.minimum(1.0, problem.robust_threshold / np.maximum(np.abs(fit.residual), 1e-300))[fitted]
    j = fit.jacobian[fitted] * np.sqrt(w)[:, None]
    norm = np.maximum(np.linalg.norm(j, axis=0), 1e-300)
    inner = np.linalg.pinv((j / norm).T @ (j / norm), rcond=1e-10)
    dof = max(1, int(np.count_nonzero(fitted)) - len(fit.free))
    factor = max(1.0, fit.cost / dof) if inflate else 1.0
    # An undetectable systematic error biases the parameters most where it is parallel to their sensitivities.
    scale = np.where(problem.readings.is_position, problem.data.robot.backbone.length, 1.0) / problem.sigma
    known = (problem.readings.is_position | problem.readings.is_angle) & fitted
    factor += NUMERICS**2 * float(np.sum(scale[known] ** 2))
    # The extrapolated error of mesh and path is known to about a third; so is its effect on the parameters.
    shift = inner / np.outer(norm, norm) @ (j.T @ (UNSURE * problem.correction[fitted] * np.sqrt(w)))
    return np.asarray(inner / np.outer(norm, norm) * factor + np.outer(shift, shift))


def _bounded_step(j: Array, r: Array, norm: Array, damping: float, low: Array, high: Array) -> Array:
    """Least squares step with Marquardt's damping, inside bounds."""
    norm = np.maximum(norm, 1e-300)
    scaled = np.concatenate((j / norm, np.sqrt(damping) * np.eye(len(norm))))
    right = np.concatenate((r, np.zeros(len(norm))))
    low, high = np.minimum(low * norm, -1e-12), np.maximum(high * norm, 1e-12)
    solution = lsq_linear(scaled, right, (low, high), method="bvls")
    return np.asarray(solution.x / norm)
