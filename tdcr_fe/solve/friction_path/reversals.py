"""Slip reversals within a solved substep: what they change at its end, how certain that is, where it may be divided."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.friction_path.follow import FrictionPath, follow_friction
from tdcr_fe.solve.friction_path.rates import columns_of
from tdcr_fe.solve.friction_path.response import KnownStates
from tdcr_fe.solve.friction_path.slips import InterpolatedSlips, Intervals
from tdcr_fe.solve.friction_path.transfer import tension_transfer

#: Part of a change that the mean of the slopes at both ends may leave unexplained [1]: with more, nothing is said of
#: what an error of the slips does at the end, and a substep may have jumped to another branch.
ROUGH = 0.1
#: Error of reversals located through twice as many states within the substep as before, over what they changed [1].
#: With a quarter of it, three of 200 random robots ended up to 1.2e-5 of the length off.
REFINED_ERROR = 0.5


class SubstepSlips(NamedTuple):
    """Slips of the tendons under tension in a substep that was solved as a whole."""

    known: KnownStates  # Of the substep
    slips: InterpolatedSlips  # In it
    before: Array  # (k,): Mobilisations at its start and its end [1]
    after: Array  # as `before`
    base: Array  # (c,): Unknown tensions at the base, at its start [N]
    # (k, k): Minus the derivatives of the plastic slips by the mobilisations at the end, see
    # `SlipState.columns`, with the tendons slack and taut as they are there [m]
    matrix: Array
    # (unknowns, k): Derivatives of the unknowns of the reduced scene by the mobilisations there
    columns: Array

    @classmethod
    def of(cls, known: KnownStates) -> SubstepSlips:
        """From its solved states."""
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
        first, columns = start.driven_tension[taut.driven], known.points[-1].response.nodes @ tensions
        return cls(known, slips, before, after, first, matrix[:k], columns)

    @property
    def presliding(self) -> Array:
        """Presliding distances of the holes [m], shape (k,)."""
        return self.slips.elastic_slip[: len(self.before)]

    @property
    def slip(self) -> Array:
        """Change of the slips [m], shape (k,)."""
        return np.asarray((self.known.end.slips - self.known.start.slips)[self.known.taut.holes])

    def follow(self) -> FrictionPath:
        """The friction states followed through the substep."""
        return follow_friction(self.slips, self.before, self.base, self.slips.intervals.tension[0])

    def displacement(self, change: Array) -> float:
        """Largest displacement of a node by a change of the mobilisations [1], shape (k,), to first order [m]."""
        return self._largest(self.columns @ change)

    @property
    def slip_error(self) -> Array:
        """Uncertainty of the change of the slips: what the parabola in their rates adds to it [m], shape (k,)."""
        return np.abs(self.slips.intervals.defect[: len(self.presliding)])

    def displacement_by_error(self, path: FrictionPath) -> float:
        """Largest displacement of a node by the error of the slips, to first order [m].

        Only by those holes whose mobilisation at the end depends on it, see `FrictionPath.insensitive_holes`; by any
        change of the friction where the path does not reach the end, or is known too roughly.
        """
        error, least = self.slip_error, float(self.presliding.min())
        if not path.complete or error.max() > ROUGH * max(float(np.abs(self.slip).max()), least):
            return self._largest(2.0 * np.abs(self.columns).sum(axis=1))
        which = np.flatnonzero(~path.insensitive_holes(error, self.presliding))
        if not which.size:
            return 0.0
        response = self.columns[:, which] @ np.linalg.inv(self.matrix[np.ix_(which, which)])
        return self._largest(np.abs(response) @ error[which])

    def _largest(self, step: Array) -> float:
        """Largest displacement of a node in a change of the unknowns of the reduced scene [m]."""
        nodes = np.concatenate([step[p.nodes] for p in self.known.end.numbering.robots]).reshape(-1, 6)
        return float(np.linalg.norm(nodes[:, :3], axis=1).max())


class SlipHistory(NamedTuple):
    """What the mobilisations at the end of a substep count from: its start, or the last reversal."""

    slip: Array  # (k,): Of the frictional holes [m]
    mobilisation: Array  # (k,): At that slip [1]
    at_end: Array  # (k,): Those at the end of the substep, as they follow from the path [1]
    path: FrictionPath  # Of the holes of tendons under tension, with the reversals
    slips: SubstepSlips  # Of these holes, in the substep

    @classmethod
    def after(cls, substep: SubstepSlips, path: FrictionPath) -> SlipHistory:
        """After a followed path."""
        known, holes = substep.known, substep.known.taut.holes
        start, end = known.start, known.end
        slip, counted, last = start.slips.copy(), start.mobilisation.copy(), end.mobilisation.copy()
        slip[holes] += path.reversal_slip
        counted[holes], last[holes] = path.reversal_mobilisation, path.unknowns[: len(holes)]
        return cls(slip, counted, last, path, substep)

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
    possible: bool  # Whether any slip reverses, or may reverse with an error of the slips
    # What the mobilisations at the end count from, where the path reaches it
    history: SlipHistory | None = None

    @property
    def total(self) -> float:
        """Largest displacement of a node if they are ignored, over the length [1]."""
        return self.effect + self.error


def find_reversals(known: KnownStates, length: float) -> Reversals:
    """Reversals of slips between two solved states.

    Parameters
    ----------
    known
        Of the substep; the last one is solved from the first as a whole.
    length
        Of the longest backbone [m].
    """
    substep = SubstepSlips.of(known)
    path = substep.follow()
    effect = substep.displacement(path.unknowns[: len(substep.after)] - substep.after) / length
    history = SlipHistory.after(substep, path) if path.complete else None
    possible = path.reversed.any() or path.may_touch_bound(substep.slip_error / substep.presliding).any()
    if history is not None and len(known.points) > 2:
        return Reversals(effect, REFINED_ERROR * effect, possible, history)
    return Reversals(effect, substep.displacement_by_error(path) / length, possible, history)
