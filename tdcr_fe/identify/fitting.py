"""Fit the parameters of effects to the readings: weighted, bounded, robust least squares on exact derivatives.

The iteration is that of Levenberg and Marquardt with bounds (Nocedal and Wright, Numerical Optimization, Sec. 10.3; the
bounded linear problem by `scipy.optimize.lsq_linear`). `scipy.optimize.least_squares` takes a Jacobian as well, but
keeps strictly inside the bounds, where most null values are, and cannot be stopped when a competitor is ahead.

A fit is a generator that yields what has to be simulated, so that several fits advance together: their runs are shared
among the processes, and one that cannot come near the best is stopped.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from tdcr_fe.effects import Effect
from tdcr_fe.elements import Array, Flags
from tdcr_fe.identify.causes import ReadingCause
from tdcr_fe.identify.derivatives import Column, Request, linearized
from tdcr_fe.identify.forward import Work, advance
from tdcr_fe.identify.problem import Fit, FitProblem, Free, Point
from tdcr_fe.identify.result import PROFILED, Profile
from tdcr_fe.identify.settings import OutOfTime

#: A fit under way.
Fitting = Work[Fit]

#: A parameter is not fitted where its value could not be distinguished from zero: its typical step changes the
#: readings by less than NOTHING (rms over sigma), and FURTHEST such steps, or as many as its bounds allow, change all
#: readings together by less than VISIBLE (root of the sum of squares over sigma). Steps are at least so long that null
#: is within FURTHEST of them. A marker among many that is read with much noise may change less than NOTHING, but more
#: than VISIBLE.
NOTHING, VISIBLE, FURTHEST = 0.02, 3.0, 100.0

#: Share of the extrapolated discretisation error that may be wrong.
UNSURE = 1.0 / 3.0

#: A run takes substeps that another run has chosen where their predictions differ by less than this, rms over sigma. On
#: robots with friction, substeps of its own then change them by 0.05 or less.
NEAR_PATH = 2.0

#: Steps of a fit, at most.
ITERATIONS = 12

#: After a step that raised the cost, one with more damping is skipped if it promises at least this share of what that
#: one promised, as it is nearly the same step. (At kinks of friction a damping of 1e-3 in place of 1e-5 changed little,
#: and most steps were tried three times.)
SAME_STEP = 0.9

#: A fit is stopped where it cannot come below so many times the lowest cost so far, plus a constant; far above what
#: makes it indistinguishable [1].
LEFT_BEHIND = (1.3, 60.0)


@dataclass
class Race:
    """When fits that compete are of no interest any more, and when they end where they are."""

    limit: float = math.inf  # cost above which a fit is of no interest

    def reached(self, cost: float) -> None:
        """Note that one of the fits has come to this cost; the others have to come near it."""
        self.limit = min(self.limit, limit_beside(cost))

    def in_reach(self, cost: float, error: float) -> bool:
        """Whether a fit that promises a cost may come below the limit, by the `distance` of its last prediction."""
        return math.sqrt(cost) - error <= math.sqrt(max(self.limit, 0.0))


def limit_beside(cost: float) -> float:
    """Cost above which a fit is of no interest where another one has this cost, see `LEFT_BEHIND`."""
    return LEFT_BEHIND[0] * cost + LEFT_BEHIND[1]


def run_fits(problem: FitProblem, fittings: Sequence[Fitting]) -> list[Fit]:
    """Run several fits to their ends; what all of them need at a time is simulated at a time.

    At the deadline of the problem every fit ends with its last complete model.

    Raises
    ------
    OutOfTime
        The deadline has passed before each had a complete model.
    """
    return advance(fittings, problem.run)


def fit(problem: FitProblem, effects: Sequence[Effect], start: Point, race: Race | None = None) -> Fit:
    """Fit the parameters of effects, to convergence, or until they cannot come near the best of a race.

    Parameters
    ----------
    problem
        Readings and forward model.
    effects
        Whose parameters are fitted.
    start
        Where it begins.
    race
        With other fits.

    Returns
    -------
    Fit
        Parameters that change nothing on these readings stay where they began and are not free.
    """

    def fitting() -> Fitting:
        now = yield from begin(problem, effects, start)
        if not np.isfinite(now.cost):
            return now
        return (yield from finish(problem, now, race or Race()))

    return run_fits(problem, [fitting()])[0]


def begin(problem: FitProblem, effects: Sequence[Effect], start: Point, along: Fit | None = None) -> Fitting:
    """A model at a point, on the path of another one, with all parameters free that change anything there."""
    free = [(e.name, p.name) for e in effects for p in e.parameters]
    return evaluated(problem, effects, start, free, along)


def evaluated(
    problem: FitProblem, effects: Sequence[Effect], values: Point, free: Free, along: Fit | None = None
) -> Fitting:
    """A model at given values with its derivatives by those of the given parameters that change anything.

    ``along``: a model whose substeps the run takes, which is several times as fast.
    """
    natural = {(e.name, p.name): p.scale for e in effects for p in e.parameters}
    scale = np.array([problem.scales.get(k, natural[k]) for k in free])  # typical steps
    columns = columns_of(effects, values, free, 0.2 * scale)
    request = Request(tuple(effects), values, columns, None if along is None else along.run)
    linear = yield from linearized(problem, request)
    z = problem.coordinates(effects, values, free)
    null = problem.coordinates(effects, {e.name: e.null_values(problem.experiment) for e in effects}, free)
    steps = np.maximum(scale, np.abs(z - null) / FURTHEST)
    reach = np.max(np.abs(problem.limits(effects, free) - z[:, None]), axis=1, initial=0.0) / steps
    keep = can_be_seen(linear.matrix[problem.fitted] * steps, reach)
    r, kept = linear.residual, tuple(itertools.compress(free, keep))
    of_path = r if along is None else along.path_residual
    return Fit(tuple(effects), values, r, *problem.cost(r), linear.matrix[:, keep], kept, linear.run, of_path)


def columns_of(effects: Sequence[Effect], values: Point, free: Free, steps: Array) -> tuple[Column, ...]:
    """Derivatives by free parameters, with the steps of differences in their coordinates, shape (p,)."""
    by_name = {e.name: e for e in effects}
    each = zip(free, steps.tolist(), strict=True)
    return tuple(Column(by_name[e], name, values[e], x) for (e, name), x in each)


def can_be_seen(changes: Array, reach: Array) -> Flags:
    """Whether readings can show parameters at all, shape (p,).

    Parameters
    ----------
    changes
        Changes of the readings over sigma by a typical step of each parameter, shape (n, p).
    reach
        Largest change of each parameter within its bounds, in typical steps, shape (p,).
    """
    size = np.linalg.norm(changes, axis=0)
    small = size <= NOTHING * np.sqrt(max(1, len(changes)))
    return np.isfinite(size) & ~(small & (size * np.minimum(reach, FURTHEST) <= VISIBLE))


def descend(problem: FitProblem, now: Fit, race: Race, predicted: Array | None = None) -> Fitting:
    """Iterate from a fit on the path of its run, which is fast; `ITERATIONS` at most.

    Parameters
    ----------
    problem
        Readings and forward model.
    now
        With its derivatives.
    race
        The iteration ends where the cost cannot come below its limit: where the linear model does not lead there by
        more than the error that it has just made, or where the cost stagnates and the linear model does not lead there;
        and where the time of the race is over.
    predicted
        Residual over sigma that a linear model predicted for this fit, shape (n,); None where there was none.
    """
    if not np.isfinite(now.cost):
        return now
    damping, failed = 1e-3, math.inf
    error = float("inf") if predicted is None else distance(problem, now.residual, predicted)
    for _ in range(ITERATIONS if now.free else 0):
        step, promised = _proposal(problem, now, damping)
        if promised < little(now) or damping > 1e6:
            return replace(now, stuck=failed < math.inf)
        if promised > SAME_STEP * failed:
            damping *= 100.0
            continue
        reach = reachable_cost(problem, now)
        if not race.in_reach(reach, error):
            return replace(now, pruned=True)
        point = problem.moved(now.effects, now.values, now.free, step)
        try:
            trial = yield from evaluated(problem, now.effects, point, now.free, now)
        except OutOfTime:
            break
        if not trial.cost < now.cost:
            failed = promised
            continue
        gain = now.cost - trial.cost
        error = distance(problem, trial.residual, now.residual - now.jacobian @ step)
        if gain > 0.25 * promised:
            damping = max(1e-6, 0.1 * damping)
        now, failed = trial, math.inf
        race.reached(now.cost)
        if (gain < 0.05 + 1e-3 * now.cost and promised < 2.0 * gain) or not now.free:
            break
        if gain < 0.1 * now.cost and reach > race.limit:
            return replace(now, pruned=True)
    return now


def little(fit: Fit) -> float:
    """A fall of the cost of a fit that is worth no further step."""
    return 0.02 + 2e-4 * fit.cost


def linear_optimum(problem: FitProblem, now: Fit) -> Fit:
    """A fit at the best values that its linear model knows, as that predicts it."""
    step, _ = _proposal(problem, now, 0.0)
    values = problem.moved(now.effects, now.values, now.free, step)
    return problem.with_residual(replace(now, values=values), now.residual - now.jacobian @ step)


def reachable_cost(problem: FitProblem, now: Fit) -> float:
    """Cost of a fit at the best values that its linear model knows."""
    return max(0.0, now.cost - _proposal(problem, now, 0.0)[1])


def distance(problem: FitProblem, a: Array, b: Array) -> float:
    """Root of the robust sum of squares of a difference of residuals, over the fitted readings."""
    return float(np.sqrt(problem.cost(a - b)[0]))


def finish(problem: FitProblem, now: Fit, race: Race) -> Fitting:
    """Improve a fit to the end. Far from the run whose substeps it has taken, it is evaluated once more with its own.

    It is not improved further after that, since the cost hardly changes (by less than one in all of 32 fits).
    """
    if not now.stuck:
        now = yield from descend(problem, now, race)
    if now.pruned or float(np.sqrt(np.mean((now.residual - now.path_residual) ** 2))) < NEAR_PATH:
        return now
    try:
        return (yield from evaluated(problem, now.effects, now.values, now.free))
    except OutOfTime:
        return now


def fitted(problem: FitProblem, now: Fit, race: Race, predicted: Array | None = None) -> Fitting:
    """A model fitted, to the end where it comes near the best; `predicted` as in `descend`."""
    now = yield from descend(problem, now, race, predicted)
    race.reached(now.cost)
    if now.cost <= race.limit:
        now = yield from finish(problem, replace(now, pruned=False), race)
    return now


def smaller(
    problem: FitProblem, effects: Sequence[Effect], start: Point, best: Fit, known: Fit | None = None
) -> Fitting:
    """Fit a model beside the best one, on its path, unless that leaves it behind; to the end where it is as good.

    A ``known`` fit of the same model is it where nothing promises to lead below.
    """
    now = yield from begin(problem, effects, start, best)
    if known is not None and not known.pruned and known.cost - reachable_cost(problem, now) < little(known):
        return known
    return (yield from fitted(problem, now, Race(limit_beside(best.cost))))


def _proposal(problem: FitProblem, now: Fit, damping: float) -> tuple[Array, float]:
    """The step to the next coordinates, and the fall of the cost by the linear model."""
    if not now.free or not np.isfinite(now.cost):
        return np.zeros(len(now.free)), 0.0
    z = problem.coordinates(now.effects, now.values, now.free)
    limits = problem.limits(now.effects, now.free)
    jw, rw = _weighted(problem, now)
    move = _bounded_step(jw, rw, damping, limits[:, 0] - z, limits[:, 1] - z)
    return move, float(np.sum(rw**2) - np.sum((rw - jw @ move) ** 2))


def _weighted(problem: FitProblem, fit: Fit) -> tuple[Array, Array]:
    """Jacobian and residual of the fitted readings, so that their squares are robust, shapes (m, p) and (m,)."""
    w = problem.root_weights(fit.residual)[problem.fitted]
    return fit.jacobian[problem.fitted] * w[:, None], fit.residual[problem.fitted] * w


def covariance(problem: FitProblem, fit: Fit) -> Array:
    """Covariance of the coordinates of the free parameters, shape (p, p).

    Enlarged where the misfit is above noise, and by the effect of the errors of mesh and path.
    """
    if not fit.free:
        return np.zeros((0, 0))
    j, r = _weighted(problem, fit)
    norm = np.maximum(np.linalg.norm(j, axis=0), 1e-300)
    inner = np.linalg.pinv((j / norm).T @ (j / norm), rcond=1e-10)
    factor = max(1.0, fit.cost / max(1, len(r) - len(fit.free)))
    # The extrapolated error of mesh and path is known to about a third; so is its effect on the parameters.
    w = problem.root_weights(fit.residual)[problem.fitted]
    shift = inner / np.outer(norm, norm) @ (j.T @ (UNSURE * problem.correction[problem.fitted] * w))
    return np.asarray(inner / np.outer(norm, norm) * factor + np.outer(shift, shift))


def _bounded_step(j: Array, r: Array, damping: float, low: Array, high: Array) -> Array:
    """Least squares step with Marquardt's damping, inside bounds."""
    norm = np.maximum(np.linalg.norm(j, axis=0), 1e-300)
    scaled = np.concatenate((j / norm, np.sqrt(damping) * np.eye(len(norm))))
    right = np.concatenate((r, np.zeros(len(norm))))
    low, high = np.minimum(low * norm, -1e-12), np.maximum(high * norm, 1e-12)
    return np.asarray(lsq_linear(scaled, right, (low, high), method="bvls").x / norm)


def profiles(problem: FitProblem, fit: Fit) -> Iterator[Profile]:
    """Likelihood profiles of all free parameters of a fit: how the misfit grows as one is moved and the others follow.

    Where a parameter is normally distributed, the misfit grows with the square of the distance in standard errors.
    Where it is not, its 95 % interval is that of the profile (Bates and Watts, Nonlinear Regression Analysis, Sec.
    6.1). The others follow along the ridge that the covariance gives, so that a profile takes two runs.
    """
    spread = covariance(problem, fit)
    deviation = np.sqrt(np.maximum(np.diag(spread), 0.0))
    by_name = {e.name: e for e in fit.effects}
    z = problem.coordinates(fit.effects, fit.values, fit.free)
    limits = problem.limits(fit.effects, fit.free)
    jacobian, _ = _weighted(problem, fit)
    for i, key in enumerate(fit.free):
        if not deviation[i] > 0.0 or isinstance(by_name[key[0]], ReadingCause):  # the latter are linear
            continue
        step = spread[:, i] / deviation[i]
        along = PROFILED[:, None] * step
        inside = np.all((z + along >= limits[:, 0]) & (z + along <= limits[:, 1]), axis=1)
        points = [problem.moved(fit.effects, fit.values, fit.free, x) for x in along[inside]]
        fits = [evaluated(problem, fit.effects, p, (), fit) for p in points]
        cost = np.array([x.cost for x in run_fits(problem, fits)])
        # In units of the growth by one standard error where the model is linear.
        growth = np.sqrt(np.maximum(cost - fit.cost, 0.0)) / np.linalg.norm(jacobian @ step)
        roots = np.append(np.sign(PROFILED[inside]) * growth, 0.0)
        values = np.array([p[key[0]][key[1]] for p in (*points, fit.values)])
        order = np.argsort(values)
        order = order[np.isfinite(roots[order])]
        yield Profile(".".join(key), values[order], roots[order])
