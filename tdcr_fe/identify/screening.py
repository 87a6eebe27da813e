"""The columns of all candidate causes beside a model, and how much of the misfit they would remove, to first order."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares, lsq_linear

from tdcr_fe.effects import Effect, Experiment
from tdcr_fe.effects.base import Form
from tdcr_fe.elements import Array, Flags
from tdcr_fe.identify import criteria
from tdcr_fe.identify.bay_state import COMPONENTS, FORCE
from tdcr_fe.identify.causes import BesideDescription, Cause, PointForce, StateLoad
from tdcr_fe.identify.derivatives import Column, Request, linearize
from tdcr_fe.identify.fitting import can_be_seen
from tdcr_fe.identify.input_causes import ChangedInputs
from tdcr_fe.identify.problem import Fit, FitProblem, Point
from tdcr_fe.identify.run import Run

#: Relative error of predictions by first-order columns, as a sum of squares [1].
FIRST_ORDER = 0.02

#: Loads that depend on the state, the most promising by the response of each load step, that are derived along the
#: history where there is friction. The right one was the sixth of those by tendon and place, and became the first.
WITH_HISTORY = 40

#: Steps at most by which the numbers of a force towards a point are fitted to first order.
EVALUATIONS = 40


class Start(NamedTuple):
    """Where the fit of a candidate may begin."""

    point: Point  # empty where it is refused
    predicted: Array  # residual over sigma that it would leave, to first order, shape (n,)
    half: Point | None = None  # the half of the way there from the model without


@dataclass(frozen=True)
class Score:
    """One candidate beside one fitted model."""

    effect: Effect
    drop: float  # fall of the sum of squares over the fitted readings, to first order
    # change of the predictions over sigma, by direction, shape (n, k); k = 0 where it is refused
    signature: Array
    begin: Callable[[], Start]  # most candidates are not fitted
    note: str = ""  # reason of refusal; empty where it is not refused
    probe: _ProbeSet | None = None  # to which the signature belongs
    # typical steps of its parameters in their fitted coordinates
    scales: Mapping[tuple[str, str], float] = field(default_factory=dict)

    @classmethod
    def refused(cls, effect: Effect, fit: Fit, note: str) -> Score:
        """The score of an effect that is not tried beside a model."""
        nothing, start = np.zeros((fit.residual.size, 0)), Start({}, fit.residual)
        return cls(effect, 0.0, nothing, lambda: start, note)

    @cached_property
    def start(self) -> Start:
        """Where its fit may begin."""
        return self.begin()

    @cached_property
    def count(self) -> int:
        """Parameters of the candidate that change anything, and those that it holds."""
        if not self.signature.size or self.probe is None:
            return len(self.effect.parameters)
        return int(np.count_nonzero(np.any(self.signature, axis=0))) + len(self.probe.held)


def screen(problem: FitProblem, fit: Fit, effects: Sequence[Effect]) -> tuple[list[Score], Fit]:
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

    Returns
    -------
    scores : list of Score
    fit : Fit
        The model with the run from which the derivatives are, as a reference for fits of the candidates.
    """
    experiment = problem.with_effects(fit.effects, fit.values)
    excitation = problem.excitation_range(fit.run)
    sets, scores = list[_ProbeSet](), list[Score]()
    for e in effects:
        probes = e.probe_points(experiment, excitation)
        alternatives = [points for points in probes if _possible(problem, fit, e, points)]
        if not alternatives:
            note = "the robot cannot be combined with it" if probes else "these data cannot show it"
            scores.append(Score.refused(e, fit, note))
        sets += [_ProbeSet.of(e, points, experiment) for points in alternatives]
    signatures, fit = _signatures(problem, fit, sets, history=False)
    found = _scores(problem, fit, sets, signatures)
    if experiment.model.friction != "none":
        every = (x for x in found.values() if isinstance(x.effect, StateLoad))
        loads = [x for x in every if not isinstance(x.effect, PointForce)]
        loads.sort(key=lambda x: criteria.complexity(problem, [x.effect], {}, x.count) - x.drop)
        first = {x.effect.name for x in loads[:WITH_HISTORY]}
        if sets := [one for one in sets if one.effect.name in first]:
            found |= _scores(problem, fit, sets, _signatures(problem, fit, sets, history=True)[0])
    return sorted([*scores, *found.values()], key=lambda s: -s.drop), fit


def _scores(
    problem: FitProblem, fit: Fit, sets: Sequence[_ProbeSet], signatures: Sequence[Array]
) -> dict[str, Score]:
    """Scores by names of candidates; ``signatures``: of the probe sets."""
    space, by_effect = _Space.of(problem, fit), dict[str, list[tuple[_ProbeSet, Array]]]()
    for one, signature in zip(sets, signatures, strict=True):
        by_effect.setdefault(one.effect.name, []).append((one, signature))
    return {name: _score(space, own) for name, own in by_effect.items()}


def _possible(problem: FitProblem, fit: Fit, e: Effect, points: Sequence[dict[str, float]]) -> bool:
    """Whether the model can have the effect at all points: some laws of the material exclude each other."""
    if isinstance(e, BesideDescription | ChangedInputs):  # neither robot nor model changes
        return True
    try:
        for point in points:
            problem.with_effects((*fit.effects, e), {**fit.values, e.name: point})
    except ValueError:
        return False
    return True


#: Parameters that are held at other than their null values.
_Held = tuple[tuple[str, float], ...]

#: Of a column: names of effect and parameter, and what is held.
_Key = tuple[str, str, _Held]


@dataclass(frozen=True)
class _ProbeSet:
    """One of the alternatives of `Effect.probe_points`."""

    effect: Effect
    start: dict[str, float]  # null values, but for those parameters that are held at the values of the points
    held: _Held
    # Changes of the coordinates from the start to each point, other than zero
    directions: list[dict[str, float]]
    differentiated: Effect  # whose derivatives are taken, see `Effect.near_null`

    @classmethod
    def of(cls, e: Effect, points: list[dict[str, float]], experiment: Experiment) -> _ProbeSet:
        """The probe set of some points beside a fitted model."""
        null, fixed = e.null_values(experiment), e.unidentifiable_at_null(experiment)
        start = {**null, **{name: points[0][name] for name in fixed}}
        held = tuple((n, x) for n, x in start.items() if x != null[n])
        moving = [p for p in e.parameters if p.name not in fixed]
        changes = [
            {p.name: p.coordinate(x[p.name]) - p.coordinate(null[p.name]) for p in moving} for x in points
        ]
        directions = [{n: change for n, change in own.items() if change != 0.0} for own in changes]
        return cls(e, start, held, directions, e.near_null(experiment))

    def columns(self, name: str, change: float) -> dict[_Key, Column]:
        """Columns that add up to that of a parameter; those of the same key are the same, as in other forms.

        ``change``: of its coordinate, where the derivative is a difference of two runs.
        """
        e = self.effect
        own: dict[str, Effect] = {part.name: part for part in e.parts} if isinstance(e, Cause) else {}
        own = own or {e.listed if isinstance(e, Form) else e.name: self.differentiated}
        return {(key, name, self.held): Column(one, name, self.start, change) for key, one in own.items()}

    def limits(self, problem: FitProblem) -> tuple[Array, Array]:
        """Least and largest amplitudes within the bounds of the parameters, shape (k,) both."""
        e, ranges = self.effect, []
        for d in self.directions:
            free = [(e.name, n) for n in d]
            room = problem.limits([e], free) - problem.coordinates([e], {e.name: self.start}, free)[:, None]
            ends = np.sort(room / np.array(list(d.values()))[:, None], axis=1)
            ranges.append((np.max(ends[:, 0], initial=-np.inf), np.min(ends[:, 1], initial=np.inf)))
        low, high = np.array(ranges).T
        return low, high

    def mixed(self, problem: FitProblem, amplitudes: Array) -> dict[str, float]:
        """Values at the sum of amplitudes times directions, within bounds."""
        e, each = self.effect, zip(amplitudes, self.directions, strict=True)
        names = list(dict.fromkeys(n for d in self.directions for n in d))
        change = sum(a * np.array([d.get(n, 0.0) for n in names]) for a, d in each)
        free = [(e.name, n) for n in names]
        return problem.moved([e], {e.name: self.start}, free, np.asarray(change))[e.name]

    def signature(self, by: Mapping[_Key, Array], count: int) -> Array:
        """Change of the predictions towards every point, from the derivatives ``by`` the columns, shape (count, k)."""
        moves = [[by[k] * x for n, x in d.items() for k in self.columns(n, x)] for d in self.directions]
        return np.stack([sum(parts, np.zeros(count)) for parts in moves], axis=1)


def _signatures(
    problem: FitProblem, fit: Fit, sets: Sequence[_ProbeSet], history: bool
) -> tuple[list[Array], Fit]:
    """Signatures of all probe sets from one run, and the model with that run.

    Alternatives that begin at the same values share a derivative, and so do causes with the same parts.
    ``history``: see `Request`.
    """
    moves = [(one, n, x) for one in sets for d in one.directions for n, x in d.items()]
    columns = dict(reversed([own for one, n, x in moves for own in one.columns(n, x).items()]))
    request = Request(fit.effects, fit.values, tuple(columns.values()), fit.run, history=history)
    (linear,) = linearize(problem, [request])
    by_key = dict(zip(columns, linear.matrix.T, strict=True))
    found = [one.signature(by_key, fit.residual.size) for one in sets]
    reference = fit if linear.run.trajectories is None else replace(fit, run=linear.run)
    return found, reference


@dataclass(frozen=True)
class _Space:
    """Weighted readings that are fitted, less what the parameters of a model can bring."""

    problem: FitProblem
    fit: Fit
    which: Flags  # the fitted readings, shape (n,)
    weights: Array  # square roots, shape (n,)
    basis: Array  # of what the parameters can bring, shape (m, p)
    rest: Array  # the residual, shape (m,)

    @classmethod
    @lru_cache(maxsize=4)  # one model is asked for by many candidates; it holds a run
    def of(cls, problem: FitProblem, fit: Fit) -> _Space:
        """What the parameters of a model span."""
        which, weights = problem.fitted, problem.root_weights(fit.residual)
        known = fit.jacobian[which] * weights[which, None]
        basis = np.linalg.qr(known / np.maximum(np.linalg.norm(known, axis=0), 1e-300))[0]
        r = fit.residual[which] * weights[which]
        return cls(problem, fit, which, weights, basis, r - basis @ (basis.T @ r))

    def free(self, signature: Array) -> Array:
        """Columns less what the parameters of the model can bring, shape (m, k)."""
        x = signature[self.which] * self.weights[self.which, None]
        return np.asarray(x - self.basis @ (self.basis.T @ x))

    def amplitudes(self, signature: Array, low: Array, high: Array) -> tuple[Array, float]:
        """The best within bounds, and the fall of the sum of squares."""
        x = self.free(signature)
        norm = np.maximum(np.linalg.norm(x, axis=0), 1e-300)
        found = np.linalg.lstsq(x / norm, self.rest, rcond=1e-10)[0]
        low, high = np.minimum(low, -1e-9) * norm, np.maximum(high, 1e-9) * norm
        if np.any(found < low) or np.any(found > high):
            found = lsq_linear(x / norm, self.rest, (low, high), method="bvls").x
        left = self.rest - x / norm @ found
        return found / norm, float(self.rest @ self.rest - left @ left)

    def adapted(self, change: Array) -> tuple[Point, Array]:
        """Values and residual over sigma with a change of the predictions, to which the model's parameters adapt."""
        fit, w, problem = self.fit, self.weights, self.problem
        left = fit.residual - change
        if not fit.jacobian.shape[1]:
            return fit.values, left
        known = fit.jacobian * w[:, None]
        own = np.linalg.lstsq(known[self.which], (left * w)[self.which], rcond=1e-10)[0]
        values = problem.moved(fit.effects, fit.values, fit.free, np.asarray(own))
        return values, np.asarray(left - fit.jacobian @ own)


def _score(space: _Space, sets: Sequence[tuple[_ProbeSet, Array]]) -> Score:
    """The best of the alternatives of one candidate."""
    e, fit = sets[0][0].effect, space.fit
    found, scales = list[Score](), dict[tuple[str, str], float]()
    for one, signature in sets:
        low, high = limits = one.limits(space.problem)
        if np.any(can_be_seen(signature, np.maximum(np.abs(low), np.abs(high)))):
            found.append(_beside(space, one, signature, limits))
            scales |= {(e.name, n): abs(j) for d in one.directions for n, j in d.items()}
    if not found:
        return Score.refused(e, fit, "it changes nothing on these data")
    if isinstance(e, PointForce):
        return replace(_towards_point(space, e, fit.run), scales=scales)
    return replace(max(found, key=lambda x: x.drop), scales=scales)


def _beside(space: _Space, one: _ProbeSet, signature: Array, limits: tuple[Array, Array]) -> Score:
    """One of the alternatives of a candidate, with its best amplitudes within limits."""
    amplitude, drop = space.amplitudes(signature, *limits)

    def begin() -> Start:
        values, predicted = space.adapted(signature @ amplitude)
        point, half = (one.mixed(space.problem, share * amplitude) for share in (1.0, 0.5))
        name, without = one.effect.name, space.fit.values
        return Start({**values, name: point}, predicted, {**without, name: half})

    return Score(one.effect, drop, signature, begin, probe=one)


class _Pulled(NamedTuple):
    """What a force towards a point does."""

    change: Array  # of the predictions over sigma, shape (n,)
    slopes: Array  # its derivatives by the numbers of the force, shape (n, P)
    largest: float  # force [N]


def _towards_point(space: _Space, cause: PointForce, run: Run, follows: bool = True) -> Score:
    """The force towards a point that explains a residual best, where the robot follows it linearly.

    Parameters
    ----------
    space
        The residual, less what the parameters of the model can bring.
    cause
        The force. It is tried at all points of `PointForce.tries`; from the best one all its numbers are fitted.
        Fits from the best five explained as much in six data sets, at the best disk, but for 3 % in one.
    run
        With its response to actions.
    follows
        Whether the force moves the robot from where it is in the run; False: the run is where the force holds it.
    """
    assert run.bays is not None and run.acted is not None
    own = slice(COMPONENTS * cause.bay + FORCE.start, COMPONENTS * (cause.bay + 1))
    response, by_force = run.acted.state[:, own, own], run.acted.readings[:, None, own]
    response = response if follows else np.zeros_like(response)
    names, steps = [p.name for p in cause.parameters], space.problem.readings.step
    before, none = run.bays.moved[:, cause.bay], np.zeros((len(response), 3, 1))

    @lru_cache(maxsize=1)  # residual and derivatives are asked for one after the other
    def at(*z: float) -> _Pulled:
        """The force with these numbers, by Newton's method."""
        values, force = dict(zip(names, z, strict=True)), none
        for _ in range(3 if follows else 1):
            moved = before + (response @ force)[..., 0]
            missing = cause.force(moved, values)[..., None] - force
            by = cause.derivatives(moved, values)
            matrix = np.eye(3) - by[..., :3] @ response
            force = force + np.linalg.solve(matrix, missing)
        by_values = np.linalg.solve(matrix, by[..., 3:])
        largest = float(np.max(np.linalg.norm(force, axis=1)))
        return _Pulled((by_force @ force[steps])[:, 0, 0], (by_force @ by_values[steps])[:, 0], largest)

    def left(z: Array) -> Array:
        return space.rest - space.free(at(*z.tolist()).change[:, None])[:, 0]

    def slopes(z: Array) -> Array:
        return -space.free(at(*z.tolist()).slopes)

    tries = list(cause.tries(before))
    low, high = (np.array([getattr(p, end) for p in cause.parameters]) for end in ("lower", "upper"))
    strength, scales = names.index(cause.strength), [p.scale for p in cause.parameters]
    forces = np.stack([cause.force(before, values) for values in tries], axis=-1)
    columns = space.free((by_force @ forces[steps])[:, 0])
    size = np.maximum(np.sum(columns**2, axis=0), 1e-300)
    amplitudes = columns.T @ space.rest / size
    starts = np.array([[values[n] for n in names] for values in tries])
    strengths = cause.times(amplitudes, starts[:, strength])
    strengths = np.clip(strengths, 0.999 * low[strength], 0.999 * high[strength])
    starts[:, strength] = strengths
    promised = np.where(strengths > low[strength], size * amplitudes**2, 0.0)
    if not np.any(promised > 0.0):
        return Score.refused(cause, space.fit, "")  # beside another model it may
    start = starts[np.argmax(promised)]
    found = least_squares(left, start, slopes, (low, high), x_scale=scales, max_nfev=EVALUATIONS)
    z = found.x
    if follows:  # a larger force bends or buckles the robot beyond first order
        most = space.problem.data.robot.backbone.EI / cause.at**2
        z[strength] = cause.times(min(1.0, most / max(at(*z.tolist()).largest, 1e-300)), z[strength])
    best, change = dict(zip(names, z.tolist(), strict=True)), at(*z.tolist()).change

    def begin() -> Start:
        values, predicted = space.adapted(change)
        return Start({**values, cause.name: best}, predicted)

    drop = float(space.rest @ space.rest - np.sum(left(z) ** 2))
    probe = _ProbeSet.of(cause, [best], space.problem.experiment)
    return Score(cause, drop, change[:, None], begin, probe=probe)


def rescored(problem: FitProblem, fit: Fit, scores: Sequence[Score], run: Run) -> list[Score]:
    """Candidates beside another model, with the columns that they have beside the model of a run."""
    space, found = _Space.of(problem, fit), list[Score]()
    for score in scores:
        one = score.probe
        assert one is not None
        if isinstance(one.effect, PointForce):
            found.append(_towards_point(space, one.effect, run, follows=False))
        else:
            new = _beside(space, one, score.signature, one.limits(problem))
            found.append(replace(new, scales=score.scales))
    return found


def apart(problem: FitProblem, fit: Fit, change: Array, score: Score) -> tuple[float, float]:
    """How far a candidate is from making a change of the predictions over sigma, beside a fitted model.

    Parameters
    ----------
    problem, fit, score
        The candidate beside the model.
    change
        Change of the predictions over sigma, shape (n,).

    Returns
    -------
    left, whole : float
        Sums of squares over the fitted readings that are left of the change, at best and without the candidate.
    """
    space = _Space.of(problem, fit)
    goal, x = space.free(change[:, None])[:, 0], space.free(score.signature)
    x = x / np.maximum(np.linalg.norm(x, axis=0), 1e-300)
    left = goal - x @ np.linalg.lstsq(x, goal, rcond=1e-10)[0]
    return float(left @ left), float(goal @ goal)
