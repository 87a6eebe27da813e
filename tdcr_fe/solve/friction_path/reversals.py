"""Slip reversals within a solved substep: what they change at its end, how certain that is, where it may be divided."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.elements.complementarity import solve_box
from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.equations.layout import Numbering
from tdcr_fe.solve.friction_path.follow import FrictionPath, follow_friction
from tdcr_fe.solve.friction_path.rates import columns_of
from tdcr_fe.solve.friction_path.response import KnownStates
from tdcr_fe.solve.friction_path.slips import InterpolatedSlips, Intervals
from tdcr_fe.solve.friction_path.transfer import tension_transfer

#: Part of a change that the mean of the slopes at both ends may leave unexplained [1]: with more, reversals are not
#: located by interpolated slips, and a substep may have jumped to another branch.
ROUGH = 0.1
#: Error of reversals located through twice as many states within the substep as before, over what they changed [1].
#: With a quarter of it, three of 200 random robots ended up to 1.2e-5 of the length off.
REFINED_ERROR = 0.5


class SubstepSlips(NamedTuple):
    """Slips of the tendons under tension in a substep that was solved as a whole."""

    known: KnownStates  # Of the substep
    # Largest displacement of a node that reversals may cause, and up to which the end of a path and the solution to
    # first order are the same [m]
    allowed: float
    slips: InterpolatedSlips  # In it
    before: Array  # (k,): Mobilisations at its start and its end [1]
    after: Array  # as `before`
    base: Array  # (c,): Unknown tensions at the base, at its start [N]
    slip: Array  # (k,): Change of the slips [m]
    # (k, k): Minus the derivatives of the plastic slips by the mobilisations at the end, see
    # `SlipState.columns`, with the tendons slack and taut as they are there [m]
    matrix: Array
    # (unknowns, k): Derivatives of the unknowns of the reduced scene by the mobilisations there
    columns: Array

    @classmethod
    def of(cls, known: KnownStates, allowed: float) -> SubstepSlips:
        """From its solved states; for ``allowed`` see the attribute."""
        taut, start, end = known.taut, known.start, known.end
        holes, k = taut.holes, len(taut.holes)
        data = [taut.slip_data(point, known.targets) for point in known.points]
        transfer, intervals = tension_transfer(taut.tendons), Intervals.between(data)
        elastic_slip = np.append(taut.presliding, np.zeros(len(taut.driven)))
        slips = InterpolatedSlips(transfer, intervals, elastic_slip, np.eye(len(data[0].tension)))
        before, after = start.mobilisation[holes], end.mobilisation[holes]
        base = end.driven_tension[taut.driven]
        last = slips.at(1.0, np.append(after, base), data[-1].tension).derivatives
        every, pulled = np.arange(k), k + np.flatnonzero(base > 0.0)
        matrix, tensions = columns_of(last, every).T, last.tensions[:k].T
        if pulled.size:
            # Tendons driven by displacement that are taut keep their length: their tensions follow.
            columns = columns_of(last, pulled).T
            follow = -np.linalg.solve(columns[pulled], matrix[pulled])
            tensions = tensions + last.tensions[pulled].T @ follow
            matrix = matrix + columns @ follow
        slip = (end.slips - start.slips)[holes]
        first, columns = start.driven_tension[taut.driven], known.points[-1].response.nodes @ tensions
        return cls(known, allowed, slips, before, after, first, slip, matrix[:k], columns)

    @property
    def presliding(self) -> Array:
        """Presliding distances of the holes [m], shape (k,)."""
        return self.slips.elastic_slip[: len(self.before)]

    def follow(self, slips: InterpolatedSlips) -> FrictionPath:
        """The friction states followed through the substep with its slips, or with others that are possible."""
        return follow_friction(slips, self.before, self.base, slips.intervals.tension[0])

    def corrected(self, trial: Array) -> Array:
        """Mobilisations at the end for other trial mobilisations there [1], to first order, shape (k,)."""
        right = self.presliding * (trial - self.after) + self.matrix @ self.after
        return solve_box(self.matrix, right, self.after)[0]

    def at_end(self, path: FrictionPath) -> Array:
        """Mobilisations at the end of the substep that follow from a path [1], shape (k,).

        Those to first order, counted from the last reversals, which have no error of the integration, where they agree
        with the end of the path. They need not: where derivatives of the tensions jump, the equations to first order
        can have another solution.
        """
        since = (self.slip - path.reversal_slip) / self.presliding
        first_order = self.corrected(path.reversal_mobilisation + since)
        last = path.unknowns[: len(first_order)]
        if path.complete and self.displacement(last - first_order) > self.allowed:
            return last
        return first_order

    def worst_case(self, path: FrictionPath, mobilisation: Array) -> Array:
        """Mobilisations at the end if every hole that slips there had just reversed by the error of its slip [1], (k,).

        Parameters
        ----------
        path
            The path. Where it is not complete, the whole slip counts as error.
        mobilisation
            At the end [1], shape (k,).
        """
        presliding = self.presliding
        error = self.slip_error if path.complete else np.abs(self.slip) + presliding
        side = np.trunc(mobilisation)
        return self.corrected(np.where(side != 0.0, side * (1.0 - error / presliding), mobilisation))

    def displacement(self, change: Array) -> float:
        """Largest displacement of a node by a change of the mobilisations [1], shape (k,), to first order [m]."""
        return _largest_displacement(self.columns @ change, self.known.end.numbering)

    @property
    def slip_error(self) -> Array:
        """Uncertainty of the change of the slips: what the parabola in their rates adds to it [m], shape (k,)."""
        return np.abs(self.slips.intervals.defect[: len(self.presliding)])

    def path_error(self, path: FrictionPath, mobilisation: Array) -> tuple[float, bool] | None:
        """What the interpolation leaves uncertain in a complete path; None where it is too rough to say.

        The largest displacement of a node at the end [m], and whether any slip reverses with other slips that are
        possible.

        Where the error may be larger than allowed to first order, and the other path shows nothing of it, states within
        the substep have to decide, since the other path shows only one of many possible errors.

        Parameters
        ----------
        path
            The path.
        mobilisation
            Those at the end that follow from it [1], shape (k,).
        """
        allowed, first_order = self.allowed, self._displacement_by_error(path)
        if first_order == 0.0:
            return 0.0, False
        largest = max(float(np.abs(self.slip).max()), float(self.presliding.min()))
        if float(self.slip_error.max()) > ROUGH * largest:
            return None
        other = self.follow(self.slips._replace(intervals=self.slips.intervals.with_defect_doubled()))
        if not other.complete:
            return None
        moved = self.displacement(mobilisation - self.at_end(other))
        if moved <= allowed < first_order:
            # Any value above `allowed` asks for a state within the substep. Without it, 1e-3 of the length was missing
            # once in 700 load steps of random robots.
            return 2.0 * allowed, True
        return moved, bool((other.reversed | path.may_touch_bound(other)).any())

    def _displacement_by_error(self, path: FrictionPath) -> float:
        """Largest displacement of a node by the error of the slips, to first order [m].

        Only by those holes whose mobilisation at the end depends on it, see `FrictionPath.insensitive_holes`.
        """
        segments, count = path.segments, len(self.presliding)
        off_line = self.slips.intervals.error_off_line(segments.start, segments.tension, count)
        error = self.slip_error + off_line
        which = np.flatnonzero(~path.insensitive_holes(error, self.presliding))
        if not which.size:
            return 0.0
        response = self.columns[:, which] @ np.linalg.inv(self.matrix[np.ix_(which, which)])
        return _largest_displacement(np.abs(response) @ error[which], self.known.end.numbering)


def _largest_displacement(step: Array, numbering: Numbering) -> float:
    """Largest displacement of a node in a change of the unknowns of the reduced scene [m]."""
    nodes = np.concatenate([step[p.nodes] for p in numbering.robots]).reshape(-1, 6)
    return float(np.linalg.norm(nodes[:, :3], axis=1).max())


class SlipHistory(NamedTuple):
    """What the mobilisations at the end of a substep count from: its start, or the last reversal."""

    slip: Array  # (k,): Of the frictional holes [m]
    mobilisation: Array  # (k,): At that slip [1]
    at_end: Array  # (k,): Those at the end of the substep, as they follow from the path [1]
    path: FrictionPath  # Of the holes of tendons under tension, with the reversals
    slips: SubstepSlips  # Of these holes, in the substep

    def of(self, state: SolverState) -> SolverState:
        """A state with this history, and with the mobilisations that follow from it."""
        numbering = self.slips.known.end.numbering
        slips = numbering.with_frictional_holes([f.slip for f in state.friction], self.slip)
        counted = numbering.with_frictional_holes([f.mobilisation for f in state.friction], self.mobilisation)
        by_robot = zip(state.friction, slips, counted, strict=True)
        friction = [replace(own, slip=slip, mobilisation=s) for own, slip, s in by_robot]
        at_end = numbering.with_frictional_holes(state.mobilisation, self.at_end)
        return state._replace(friction=tuple(friction), mobilisation=at_end)

    def distance(self, state: SolverState) -> float:
        """Largest displacement of a node between the end that follows from the path, and a solved one [m]."""
        known = self.slips.known
        off = known.end.numbering.at_frictional_holes(state.mobilisation) - self.at_end
        return self.slips.displacement(off[known.taut.holes])


class Reversals(NamedTuple):
    """Slip reversals within a substep."""

    effect: float  # Largest displacement of a node that they cause at its end, over the length [1]
    error: float  # Uncertainty of that effect [1]
    # What the mobilisations at the end count from, where the path reaches it
    history: SlipHistory | None = None

    @property
    def total(self) -> float:
        """Largest displacement of a node if they are ignored, over the length [1]."""
        return self.effect + self.error


def find_reversals(
    known: KnownStates, length: float, allowed: float, *, solved_with_reversals: bool
) -> Reversals:
    """Reversals of slips between two solved states.

    Parameters
    ----------
    known
        Of the substep; the last one is solved from the first as a whole.
    length
        Of the longest backbone [m].
    allowed
        Largest displacement of a node that reversals may cause, over the length [1].
    solved_with_reversals
        Whether the last state was solved with reversals located before; else as a whole.

    Returns
    -------
    Reversals
        Without any effect where every slip is monotone, so that the substep is exact as a whole.
    """
    substep = SubstepSlips.of(known, allowed * length)
    path = substep.follow(substep.slips)
    corrected = substep.at_end(path)
    effect = substep.displacement(corrected - substep.after) / length
    history = _history(substep, path, corrected) if path.complete else None
    if history is not None and len(known.points) > 2:
        return Reversals(effect, REFINED_ERROR * effect, history)
    if path.complete:
        found = substep.path_error(path, corrected)
        if found is not None:
            error, reverses = found
            if not (path.reversed.any() or reverses or solved_with_reversals):
                return Reversals(0.0, 0.0)
            return Reversals(effect, error / length, history)
    # Reversals are not located well enough.
    error = substep.displacement(corrected - substep.worst_case(path, corrected)) / length
    return Reversals(effect, error, history)


def _history(substep: SubstepSlips, path: FrictionPath, at_end: Array) -> SlipHistory:
    """What the mobilisations of all frictional holes count from after a followed path.

    The path has the mobilisations ``at_end`` at the end of the substep [1], shape (k,).
    """
    known, holes = substep.known, substep.known.taut.holes
    start, end = known.start, known.end
    slip, counted, last = start.slips.copy(), start.mobilisation.copy(), end.mobilisation.copy()
    slip[holes] += path.reversal_slip
    counted[holes], last[holes] = path.reversal_mobilisation, at_end
    return SlipHistory(slip, counted, last, path, substep)
