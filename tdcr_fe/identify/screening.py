"""Score test: how much would the misfit fall, to first order, if an effect were switched on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from tdcr_fe.effects import Effect, Experiment
from tdcr_fe.identify.derivatives import Column, Request, linearize
from tdcr_fe.identify.fitting import can_be_seen
from tdcr_fe.identify.problem import Fit, FitProblem, Point

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Score:
    """One candidate beside one fitted model."""

    effect: Effect
    drop: float  # fall of the sum of squares over the fitted readings, to first order
    starts: list[Point]  # where a fit may begin
    predicted: Array  # residual over sigma that it would leave, to first order, shape (n,)
    signature: Array  # change of the predictions over sigma, by direction, shape (n, k)
    note: str = ""  # reason of refusal; empty where it is not refused
    # typical steps of its parameters in their fitted coordinates
    scales: Mapping[tuple[str, str], float] = field(default_factory=dict)
    # parameters whose part of the signature is a difference of two runs, with the reason
    differenced: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def refused(
        cls, effect: Effect, fit: Fit, note: str, scales: Mapping[tuple[str, str], float] | None = None
    ) -> Score:
        """Of an effect that is not tried beside a model."""
        nothing = np.zeros((fit.residual.size, 0))
        return cls(effect, 0.0, [], fit.residual, nothing, note, scales or {})

    @property
    def count(self) -> int:
        """Parameters of the effect."""
        return len(self.effect.parameters)

    def cost(self, problem: FitProblem) -> float:
        """Robust sum of squares over the fitted readings that it would leave, to first order."""
        return problem.cost(self.predicted)[0]


def screen(problem: FitProblem, fit: Fit, effects: Sequence[Effect]) -> list[Score]:
    """Score candidates beside a fitted model, largest fall first.

    One run along the path of the fitted model gives the derivatives of all readings by the parameters of all
    candidates at their null values. The residual is projected on them, with the fitted parameters free; amplitudes stay
    within bounds. A parameter that changes nothing while the others have their null values
    (`Effect.unidentifiable_at_null`) is held at the values of the probe points. Where there is no derivative, the
    difference of a run at the probe point takes its place.

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
    sets: list[_ProbeSet] = []
    scores: list[Score] = []
    for e in effects:
        probes = e.probe_points(experiment, excitation)
        alternatives = [points for points in probes if _possible(problem, fit, e, points)]
        if not alternatives:
            note = "the robot cannot be combined with it" if probes else "these data cannot show it"
            scores.append(Score.refused(e, fit, note))
        sets += [_ProbeSet.of(e, points, experiment) for points in alternatives]
    signatures, differenced = _signatures(problem, fit, sets)
    for e in effects:
        own = [(x, y) for x, y in zip(sets, signatures, strict=True) if x.effect is e]
        if own:
            score = _score(problem, fit, own)
            why = {name: reason for (effect, name), reason in differenced.items() if effect == e.name}
            scores.append(replace(score, differenced=why))
    return sorted(scores, key=lambda s: -s.drop)


def _possible(problem: FitProblem, fit: Fit, e: Effect, points: Sequence[dict[str, float]]) -> bool:
    """Whether the model can have the effect at all points: some laws of the material exclude each other."""
    try:
        for point in points:
            problem.with_effects((*fit.effects, e), {**fit.values, e.name: point})
    except ValueError:
        return False
    return True


#: Effect, parameter and values at which a derivative is taken.
_ColumnKey = tuple[str, str, tuple[float, ...]]


def _column_key(column: Column) -> _ColumnKey:
    return (*column.key, tuple(column.values.values()))


@dataclass(frozen=True)
class _ProbeSet:
    """One of the alternatives of `Effect.probe_points`."""

    effect: Effect
    points: list[dict[str, float]]
    # Null values; the same with those parameters that are held at the values of the points
    null: dict[str, float]
    start: dict[str, float]
    directions: list[dict[str, float]]  # changes of the coordinates from the start to each point
    differentiated: Effect  # whose derivatives are taken, see `Effect.near_null`

    @classmethod
    def of(cls, e: Effect, points: list[dict[str, float]], experiment: Experiment) -> _ProbeSet:
        """Beside a fitted model."""
        null, fixed = e.null_values(experiment), e.unidentifiable_at_null(experiment)
        start = {**null, **{name: points[0][name] for name in fixed}}
        directions = [_direction(e, fixed, null, p) for p in points]
        return cls(e, points, null, start, directions, e.near_null(experiment))

    @property
    def columns(self) -> dict[str, Column]:
        """What the signature needs, by parameter."""
        found: dict[str, Column] = {}
        for d in self.directions:
            for name, change in d.items():
                if change != 0.0:
                    found.setdefault(name, Column(self.differentiated, name, self.start, change))
        return found

    def key(self, name: str) -> _ColumnKey:
        """Of the column of a parameter; the same where the derivative is the same."""
        return _column_key(Column(self.effect, name, self.start, 0.0))

    def signature(self, derivatives: Mapping[str, Array], count: int) -> Array:
        """Change of the predictions towards every point, from the derivatives by parameter, shape (count, k)."""
        return np.stack(
            [
                sum((derivatives[n] * x for n, x in d.items() if x != 0.0), np.zeros(count))
                for d in self.directions
            ],
            axis=1,
        )


def _signatures(
    problem: FitProblem, fit: Fit, sets: Sequence[_ProbeSet]
) -> tuple[list[Array], dict[tuple[str, str], str]]:
    """Signatures of all probe sets from one run, and the parameters whose column is a difference of two runs.

    Alternatives that begin at the same values share a derivative; those that need differences each have their own.
    """
    exact: dict[_ColumnKey, int] = {}
    columns: list[Column] = []
    for one in sets:
        for name, column in one.columns.items():
            if one.key(name) not in exact:
                exact[one.key(name)] = len(columns)
                columns.append(column)
    count = fit.residual.size
    (linear,) = linearize(problem, [Request(fit.effects, fit.values, tuple(columns), fit.run)])
    differenced = {columns[j].key: why for j, why in linear.differenced.items()}
    by_key = {key: linear.matrix[:, j] for key, j in exact.items()}
    more = [
        column
        for one in sets
        for name, column in one.columns.items()
        if exact[one.key(name)] in linear.differenced and column.step != columns[exact[one.key(name)]].step
    ]
    extra: dict[tuple[_ColumnKey, float], Array] = {}
    if more:
        (other,) = linearize(problem, [Request(fit.effects, fit.values, tuple(more), fit.run)])
        for column, values in zip(more, other.matrix.T, strict=True):
            extra[(_column_key(column), column.step)] = values
    found = []
    for one in sets:
        own = {n: extra.get((one.key(n), c.step), by_key[one.key(n)]) for n, c in one.columns.items()}
        found.append(one.signature(own, count))
    return found, differenced


def _score(problem: FitProblem, fit: Fit, sets: Sequence[tuple[_ProbeSet, Array]]) -> Score:
    """The best of the alternatives of one candidate."""
    fitted = problem.fitted
    e = sets[0][0].effect
    best: Score | None = None
    others: list[Point] = []
    scales: dict[tuple[str, str], float] = {}
    for one, signature in sets:
        low, high = np.array([_amplitude_range(problem, e, one.null, d) for d in one.directions]).T
        if not np.any(can_be_seen(signature, np.maximum(np.abs(low), np.abs(high)))):
            continue
        k = fit.jacobian.shape[1]
        a = np.concatenate((fit.jacobian, signature), axis=1)
        w = problem.root_weights(fit.residual)
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
        for name, j in ((n, j) for d in one.directions for n, j in d.items()):
            if j != 0.0:
                scales[(e.name, name)] = abs(j)
        starts = [{**fit.values, e.name: _mix(problem, one, factor * amplitude[k:])} for factor in (1.0, 0.5)]
        others.append(starts[0])
        if best is None or drop > best.drop:
            points = [*starts, {**fit.values, e.name: one.points[0]}]
            best = Score(e, drop, points, fit.residual - a @ amplitude, signature)
    if best is None:
        return Score.refused(e, fit, "it changes nothing on these data", scales)
    starts = best.starts + [o for o in others if o is not best.starts[0]]
    return replace(best, starts=starts, scales=scales)


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


def _mix(problem: FitProblem, one: _ProbeSet, amplitudes: Array) -> dict[str, float]:
    """Values at the sum of amplitudes times directions, within bounds."""
    values = {}
    for p in one.effect.parameters:
        if all(d[p.name] == 0.0 for d in one.directions):
            values[p.name] = one.points[0][p.name]
            continue
        z = p.coordinate(one.null[p.name])
        z += sum(a * d[p.name] for a, d in zip(amplitudes, one.directions, strict=True))
        low, high = problem.bounds(one.effect, p.name)
        values[p.name] = p.value(float(np.clip(z, low, high)))
    return values
