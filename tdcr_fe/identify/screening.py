"""Score test: how much would the misfit fall, to first order, if an effect were switched on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from tdcr_fe.effects import Effect
from tdcr_fe.identify.fitting import NOTHING
from tdcr_fe.identify.problem import Fit, FitProblem, Point

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Score:
    """One candidate beside one fitted model.

    Attributes
    ----------
    effect : Effect
    drop : float
        Fall of the sum of squares over the fitted readings, to first order.
    drop_held : float
        Fall of the sum of squares over the held-out readings for the same change.
    starts : list of Point
        Where a fit may begin.
    signature : ndarray, shape (n, k)
        Change of the predictions over sigma, by direction.
    note : str
        Reason of refusal; empty where it is not refused.
    scales : mapping
        Typical steps of its parameters in their fitted coordinates.
    """

    effect: Effect
    drop: float
    drop_held: float
    starts: list[Point]
    signature: Array
    note: str = ""
    scales: Mapping[tuple[str, str], float] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Parameters of the effect."""
        return len(self.effect.parameters)


def screen(problem: FitProblem, fit: Fit, effects: Sequence[Effect]) -> list[Score]:
    """Score candidates beside a fitted model, largest fall first.

    Every candidate is moved a little from its null values in one run per direction, and the residual is projected on
    the change of the predictions, with the fitted parameters free; amplitudes stay within bounds. The runs follow the
    path of the fitted one, so that differences are smooth.

    Parameters
    ----------
    problem
        Readings.
    fit
        The model.
    effects
        Candidates that are not in it.
    """
    experiment = problem.with_effects(fit.effects, fit.values)
    excitation = problem.excitation_range(fit.run)
    null = {e.name: e.null_values(experiment) for e in effects}
    tasks: list[tuple[Effect, int, Point]] = []
    empty: list[Score] = []
    none = np.zeros((fit.residual.size, 0))
    for e in effects:
        alternatives = e.probe_points(experiment, excitation)
        if not alternatives:
            empty.append(Score(e, 0.0, 0.0, [], none, "these data cannot show it"))
        for i, points in enumerate(alternatives):
            tasks += [(e, i, {**fit.values, e.name: p}) for p in points]
    if not tasks:
        return empty
    points_of: dict[str, list[list[Point]]] = {}
    residuals: dict[str, list[list[Array]]] = {}
    found = _residuals(problem, fit, tasks)
    for (e, i, point), r in zip(tasks, found, strict=True):
        rows, sets = residuals.setdefault(e.name, []), points_of.setdefault(e.name, [])
        while len(rows) <= i:
            rows.append([])
            sets.append([])
        rows[i].append(r)
        sets[i].append(point)
    scores = list(empty)
    for e in effects:
        if e.name in residuals:
            scores.append(_score(problem, fit, e, null[e.name], points_of[e.name], residuals[e.name]))
    return sorted(scores, key=lambda s: -s.drop)


def _residuals(problem: FitProblem, fit: Fit, tasks: Sequence[tuple[Effect, int, Point]]) -> list[Array]:
    """Residuals at every task's point, all runs at once."""
    experiments = [problem.with_effects((*fit.effects, e), point) for e, _, point in tasks]
    runs = problem.solve(experiments, reference=fit.run)
    return [problem.residual(s, run) for s, run in zip(experiments, runs, strict=True)]


def _score(
    problem: FitProblem,
    fit: Fit,
    e: Effect,
    null: dict[str, float],
    sets: list[list[Point]],
    residuals: list[list[Array]],
) -> Score:
    fitted = problem.fitted
    fixed = e.unidentifiable_at_null(problem.with_effects(fit.effects, fit.values))
    best: Score | None = None
    others: list[Point] = []
    scales: dict[tuple[str, str], float] = {}
    for points, rows in zip(sets, residuals, strict=True):
        signature = np.stack([fit.residual - r for r in rows], axis=1)
        if not np.all(np.isfinite(signature)):
            continue
        strength = np.sqrt(np.mean(signature**2, axis=0))
        if np.all(strength < NOTHING):
            continue
        directions = [_direction(e, fixed, null, p[e.name]) for p in points]
        low, high = np.array([_amplitude_range(problem, e, null, d) for d in directions]).T
        k = fit.jacobian.shape[1]
        a = np.concatenate((fit.jacobian, signature), axis=1)
        w = np.minimum(1.0, problem.robust_threshold / np.maximum(np.abs(fit.residual), 1e-300)) ** 0.5
        norm = np.maximum(np.linalg.norm(a[fitted] * w[fitted, None], axis=0), 1e-300)
        bounds = (
            np.concatenate((np.full(k, -np.inf), np.minimum(low, -1e-9) * norm[k:])),
            np.concatenate((np.full(k, np.inf), np.maximum(high, 1e-9) * norm[k:])),
        )
        solution = lsq_linear(a[fitted] * w[fitted, None] / norm, fit.residual[fitted] * w[fitted], bounds)
        amplitude = solution.x / norm
        left = (fit.residual - a @ amplitude) * w
        weighted = fit.residual * w
        drop = float(np.sum(weighted[fitted] ** 2) - np.sum(left[fitted] ** 2))
        drop_held = float(np.sum(weighted[problem.held_out] ** 2) - np.sum(left[problem.held_out] ** 2))
        for name, j in ((n, j) for d in directions for n, j in d.items()):
            if j != 0.0:
                scales[(e.name, name)] = abs(j)
        starts = [
            {**fit.values, e.name: _mix(problem, e, null, directions, points, factor * amplitude[k:])}
            for factor in (1.0, 0.5)
        ]
        others.append(starts[0])
        if best is None or drop > best.drop:
            best = Score(e, drop, drop_held, [*starts, points[0]], signature)
    if best is None:
        return Score(
            e, 0.0, 0.0, [], np.zeros((fit.residual.size, 0)), "it changes nothing on these data", scales
        )
    return Score(
        e,
        best.drop,
        best.drop_held,
        best.starts + [o for o in others if o is not best.starts[0]],
        best.signature,
        scales=scales,
    )


def _direction(
    e: Effect, fixed: Sequence[str], null: dict[str, float], point: dict[str, float]
) -> dict[str, float]:
    """Change of the coordinates from the null values to a point; fixed parameters do not move."""
    return {
        p.name: 0.0 if p.name in fixed else p.coordinate(point[p.name]) - p.coordinate(null[p.name])
        for p in e.parameters
    }


def _amplitude_range(
    problem: FitProblem, e: Effect, null: dict[str, float], direction: dict[str, float]
) -> tuple[float, float]:
    """Range of an amplitude within the bounds of the parameters."""
    low, high = -np.inf, np.inf
    for p in e.parameters:
        d = direction[p.name]
        if d == 0.0:
            continue
        a, b = problem.bounds(e, p.name)
        here = p.coordinate(null[p.name])
        ends = sorted(((a - here) / d, (b - here) / d))
        low, high = max(low, ends[0]), min(high, ends[1])
    return low, high


def _mix(
    problem: FitProblem,
    e: Effect,
    null: dict[str, float],
    directions: list[dict[str, float]],
    points: list[Point],
    amplitudes: Array,
) -> dict[str, float]:
    """Values at the sum of amplitudes times directions, within bounds."""
    values = {}
    for p in e.parameters:
        here = p.coordinate(null[p.name])
        if all(d[p.name] == 0.0 for d in directions):
            values[p.name] = points[0][e.name][p.name]
            continue
        z = here + sum(a * d[p.name] for a, d in zip(amplitudes, directions, strict=True))
        low, high = problem.bounds(e, p.name)
        values[p.name] = p.value(float(np.clip(z, low, high)))
    return values
