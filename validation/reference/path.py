"""Solve one load step in substeps small enough to resolve the friction history.

Slip at a hole is assumed monotone within a substep: only the net slip enters. A reversal of slip within a substep is
therefore missed, and so is a jump to another branch of equilibria. Two error estimates detect this. First, a whole
substep and its two halves from the same state must give the same configuration (step doubling). Second, step
doubling may miss a reversal whose extremum lies between the ends of the halves: a parabola is put through the slip
at the beginning, middle and end of the substep, and the effect on the shape of an extremum beyond these values is
estimated. A substep in which a hole starts or stops slipping is short in any case. A substep is bisected until both
estimates are within the tolerance twice in succession; the halves of the last bisection are kept.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tdcr_fe.model.loading import Actuation, Load
from tdcr_fe.validation.reference.newton import Attempt, Problem, solve
from tdcr_fe.validation.reference.settings import Array, Mask
from tdcr_fe.validation.reference.statics import State, Statics
from tdcr_fe.validation.reference.tendons import Driver, History

#: Largest displacement of a node, over the length, by halving every substep of a load step [1]; distributed over the
#: substeps.
PATH_TOLERANCE = 1e-4
#: Substeps that step doubling begins with; four to each are solved at least.
_INITIAL_SUBSTEPS = 2
#: How often a substep may be halved, for the path or to converge. Beyond it, a path that is not resolved is reported
#: with its refinement error, and a substep that does not converge ends the sequence.
MAX_BISECTIONS = 10
#: Mobilisation from which on a hole counts as slipping.
SLIPPING = 1.0 - 1e-9
#: Factors on the presliding distance of the continuation that is tried where Newton's method fails.
_CONTINUATION = (1e5, 1e4, 1e3, 100.0, 10.0, 1.0)

#: Fraction of the tolerance of a load step that any substep may use, however short: where the slip at a hole
#: reverses abruptly, the whole error of the step arises in a few short substeps.
_SMALLEST = 1.0 / 8.0

#: Longest substep in which a hole may start or stop slipping: such changes make others turn round abruptly, between the
#: points that the estimates see.
_EVENTFUL = 1.0 / 16.0
#: Number of successive bisections that must agree: a hole that moves back and forth within its presliding distance
#: ends as if it had been at rest, so that a single agreement may be coincidence.
_AGREEMENTS = 2

#: Repetitions, at most, of a solution with moments, forces and coefficients that follow laws of the state.
_REPETITIONS = 60


class NotConverged(Exception):
    """A substep has no solution that Newton's method finds, however small."""


@dataclass(frozen=True)
class Ramp:
    """Linear change of tensions, displacements, loads and time over one load step.

    Attributes
    ----------
    by_displacement : ndarray of bool, shape (n_tendons,)
    begin, end : ndarray, shape (n_tendons,)
        Tension [N] or displacement [m].
    old, new : mapping of str to Load
        Concentrated loads before and after the step.
    times : (float, float)
        [s].
    direction : ndarray, shape (n_tendons,)
        Sign of the last change of each tendon's input, in this step or before [1].
    """

    by_displacement: Mask
    begin: Array
    end: Array
    old: Mapping[str, Load]
    new: Mapping[str, Load]
    times: tuple[float, float]
    direction: Array

    @classmethod
    def between(
        cls, statics: Statics, before: Actuation | None, target: Actuation, state: State, direction: Array
    ) -> Ramp:
        """Ramp from a state to the targets of a step; a tendon that changes its mode starts from its present value."""
        tendons = statics.tendons
        tension = state.tensions[tendons.first] if tendons.count else np.zeros(0)
        pulled = tendons.base_sum @ tendons.taken_in(state.lengths, state.tensions)[0]
        old_modes = np.zeros(tendons.count, dtype=bool) if before is None else before.by_displacement
        old_values = np.zeros(tendons.count) if before is None else before.values
        begin = np.where(target.by_displacement, pulled, tension)
        begin = np.where(old_modes == target.by_displacement, old_values, begin)
        turn = np.sign(target.values - begin)
        direction = np.where(turn != 0.0, turn, direction)
        loads: Mapping[str, Load] = {} if before is None else before.loads
        times = (0.0 if before is None else before.time, target.time)
        return cls(target.by_displacement, begin, target.values, loads, target.loads, times, direction)

    def time(self, factor: float) -> float:
        """Time at a load factor 0..1 of the step [s]."""
        return (1.0 - factor) * self.times[0] + factor * self.times[1]

    def driver(self, factor: float) -> Driver:
        """Prescribed inputs at a load factor 0..1 of the step."""
        return Driver(self.by_displacement, (1.0 - factor) * self.begin + factor * self.end)

    def loads(self, factor: float) -> list[tuple[float, Load]]:
        """Factors and concentrated loads at a load factor 0..1 of the step."""
        kept = {name: load for name, load in self.new.items() if self.old.get(name) == load}
        removed = [(1.0 - factor, load) for name, load in self.old.items() if name not in kept]
        added = [(factor, load) for name, load in self.new.items() if name not in kept]
        changing = [(f, load) for f, load in removed + added if f != 0.0]
        return [(1.0, load) for load in kept.values()] + changing


@dataclass(frozen=True)
class Point:
    """A point of the equilibrium path, history committed."""

    state: State
    history: History


@dataclass(frozen=True)
class Path:
    """A part of the equilibrium path, from one point to another.

    Attributes
    ----------
    end : Point
    substeps : int
    refinement_error : float
        Sum over the substeps of the difference that taking them in halves made, largest at any node, over the
        length [1]; NaN where the number of substeps was given.
    """

    end: Point
    substeps: int = 1
    refinement_error: float = 0.0

    def then(self, other: Path) -> Path:
        """Join this part and the next."""
        return Path(other.end, self.substeps + other.substeps, self.refinement_error + other.refinement_error)


class LoadStepPath:
    """One load step.

    Parameters
    ----------
    statics
        Equilibrium of the robot.
    ramp
        Change of inputs, loads and time.

    Attributes
    ----------
    iterations : int
        Newton iterations so far.
    """

    def __init__(self, statics: Statics, ramp: Ramp) -> None:
        self.statics, self.ramp = statics, ramp
        self.iterations = 0

    def solve(self, start: Point, count: int | None) -> Path:
        """A number of equal substeps, halved only where Newton's method fails; without one as many as resolve the path.

        Raises
        ------
        NotConverged
        """
        path, n = Path(start, 0), count or _INITIAL_SUBSTEPS
        for k in range(n):
            begin, end = k / n, (k + 1) / n
            if count is None:
                whole = self._substep(path.end, end)
                path = path.then(self._refine(path.end, begin, end, whole, 0))
            else:
                path = path.then(self._halved(path.end, begin, end, MAX_BISECTIONS))
        return path if count is None else replace(path, refinement_error=float("nan"))

    def _halved(self, start: Point, begin: float, end: float, bisections: int) -> Path:
        path = self._substep(start, end)
        if path is not None:
            return path
        if bisections == 0:
            raise NotConverged
        middle = 0.5 * (begin + end)
        first = self._halved(start, begin, middle, bisections - 1)
        return first.then(self._halved(first.end, middle, end, bisections - 1))

    def _refine(
        self, start: Point, begin: float, end: float, whole: Path | None, level: int, agreed: int = 0
    ) -> Path:
        """Refine one substep, None where it failed, by bisection until two successive bisections agree."""
        middle, last = 0.5 * (begin + end), level >= MAX_BISECTIONS
        first = self._substep(start, middle)
        second = None if first is None else self._substep(first.end, end)
        met = False
        if first is not None and second is not None:
            halves = first.then(second)
            error = float("inf") if whole is None else self._difference(whole.end, halves.end)
            error = max(error, self._missed_reversal(start, first.end, halves.end))
            quiet = end - begin <= _EVENTFUL or not _changes_state(start, first.end, halves.end)
            met = quiet and error <= PATH_TOLERANCE * max(end - begin, _SMALLEST)
            if last or (met and agreed + 1 >= _AGREEMENTS):
                return replace(halves, refinement_error=error)
        try:
            if last:
                raise NotConverged
            agreed = agreed + 1 if met else 0
            one = self._refine(start, begin, middle, first, level + 1, agreed)
            after = self._substep(one.end, end)
            return one.then(self._refine(one.end, middle, end, after, level + 1, agreed))
        except NotConverged:
            if whole is None:
                raise
            # the coarser solution is kept; its whole displacement counts as error
            return replace(whole, refinement_error=self._difference(start, whole.end))

    def _difference(self, a: Point, b: Point) -> float:
        """Largest distance between the stations of two configurations over the length [1]."""
        gap = np.linalg.norm(a.state.positions - b.state.positions, axis=1)
        return float(np.max(gap)) / self.statics.robot.backbone.length

    def _missed_reversal(self, start: Point, middle: Point, end: Point) -> float:
        """Estimated effect of a slip reversal between the points, largest displacement over the length [1].

        The slip at a hole is interpolated by a parabola through the three points. If its extremum lies beyond all of
        them, the hole may have slipped that far and back. If the mobilisation reached its bound there, it is now wrong
        by the excess. The effect on the shape is that of the corresponding tension on a straight rod.
        """
        tendons = self.statics.tendons
        if not tendons.n_friction:
            return 0.0
        passed = np.array([p.history.passed for p in (start, middle, end)])
        mobilised = np.array([p.history.mobilisation for p in (start, middle, end)])
        net, sag = passed[2] - passed[0], passed[1] - 0.5 * (passed[0] + passed[2])
        with np.errstate(divide="ignore", invalid="ignore"):
            where = np.clip(0.5 + net / (8.0 * sag), 0.0, 1.0)
        where = np.where(sag == 0.0, 0.0, where)
        extremum = passed[0] + where * net + 4.0 * where * (1.0 - where) * sag
        direction = np.sign(sag)
        outermost = np.argmax(direction * passed, axis=0)
        column = np.arange(len(net))
        beyond = direction * (extremum - passed[outermost, column]) / self.statics.settings.presliding
        room = 1.0 - direction * mobilised[outermost, column]
        wrong = np.clip(beyond - room, 0.0, 2.0)
        return float(np.max(wrong * self._effect(end)))

    def _effect(self, point: Point) -> Array:
        """Displacement of the tip over the length caused by full friction, by friction variable [1]."""
        statics, tendons, state = self.statics, self.statics.tendons, point.state
        backbone = statics.robot.backbone
        before = state.tensions[tendons.holes]
        drop = before * (1.0 - np.exp(-tendons.mu * state.angles)) + tendons.adhesion
        at = statics.layout.s[tendons.tail[tendons.holes + 1]]
        radius = np.linalg.norm(tendons.tail_hole[tendons.holes + 1], axis=1)
        bend = drop * radius * (backbone.length - at) ** 2 / (2.0 * backbone.EI * backbone.length)
        effect = np.bincount(tendons.variable[tendons.rough], bend[tendons.rough], tendons.n_friction)
        return np.asarray(effect, dtype=float)

    def _substep(self, start: Point, factor: float) -> Path | None:
        """Newton from the last point; if it fails with friction, continuation in the presliding distance."""
        statics = self.statics
        backbone = statics.robot.backbone
        if backbone.creep_rate != 0.0:
            statics.set_compliance_factor(backbone.compliance_factor(self.ramp.time(factor)))
        delta, unknowns = statics.settings.presliding, start.state.unknowns
        attempt = self._with_laws(unknowns, factor, start, delta)
        if not attempt.converged and statics.tendons.n_friction:
            for softer in _CONTINUATION:
                attempt = self._with_laws(unknowns, factor, start, softer * delta)
                if not attempt.converged:
                    break
                unknowns = attempt.state.unknowns
        if not attempt.converged:
            return None
        state, tendons = attempt.state, statics.tendons
        passed = tendons.passed_sum @ tendons.taken_in(state.lengths, state.tensions)[0]
        return Path(Point(state, History(state.mobilisation.copy(), passed)))

    def _with_laws(self, unknowns: Array, factor: float, start: Point, presliding: float) -> Attempt:
        """Solve with moments, forces and coefficients that follow laws of the state, by fixed-point iteration."""
        statics, ramp, tendons = self.statics, self.ramp, self.statics.tendons
        tendons.mu = tendons.coefficients(start.state.tensions, start.state.angles)
        for _ in range(_REPETITIONS):
            forces = statics.forces(ramp.loads(factor))
            problem = Problem(statics, forces, ramp.driver(factor), start.history, presliding)
            attempt = solve(problem, unknowns)
            self.iterations += attempt.iterations
            if not attempt.converged:
                return attempt
            if statics.follow_laws(attempt.state, ramp.direction, ramp.time(factor)):
                return attempt
            unknowns = attempt.state.unknowns
        return replace(attempt, converged=False)


def _changes_state(*points: Point) -> bool:
    """Whether any hole changes between stick, pull and release from one of these points to another."""
    states = [np.trunc(p.history.mobilisation / SLIPPING) for p in points]
    return any(bool(np.any(state != states[0])) for state in states)
