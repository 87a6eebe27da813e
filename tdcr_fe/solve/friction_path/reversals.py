"""Slip reversals within a solved substep: what they change at its end, how certain that is, where it may be divided."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.friction_path.follow import FrictionPath, follow_friction
from tdcr_fe.solve.friction_path.response import KnownStates
from tdcr_fe.solve.friction_path.slips import InterpolatedSlips, Intervals
from tdcr_fe.solve.friction_path.transfer import tension_transfer

#: Part of a change that the mean of the slopes at both ends may leave unexplained [1]. If more is unexplained, the
#: slopes do not tell what an error of the slips does at the end, and the substep may have jumped to another branch.
ROUGH = 0.1
#: Error of reversals located through twice as many states within the substep as before, over what they changed [1].
#: With a quarter of it, three of 200 random robots ended up to 1.2e-5 of the length off.
REFINED_ERROR = 0.5


class EndResponse(NamedTuple):
    """Response of the end of a substep to the friction there, with the tendons slack and taut as they are."""

    known: KnownStates  # Solved states of the substep, its end among them
    # (k, k): Minus the derivatives of the plastic slips by the mobilisations, see `SlipDerivatives.columns` [m]
    matrix: Array
    columns: Array  # (unknowns, k): Derivatives of the unknowns of the reduced scene by the mobilisations

    @classmethod
    def of(cls, known: KnownStates, slips: InterpolatedSlips) -> EndResponse:
        """From the slips in the substep."""
        taut, end, k = known.taut, known.end, len(known.taut.holes)
        base = end.driven_tension[taut.driven]
        z = np.append(end.mobilisation[taut.holes], base)
        last = slips.at(1.0, z, taut.tensions(end)).derivatives
        pulled = k + np.flatnonzero(base > 0.0)
        matrix, tensions = last.columns[:k].T, last.tensions[:k].T
        if pulled.size:
            # Tendons driven by displacement that are taut keep their length: their tensions follow.
            columns = last.columns[pulled].T
            follow = -np.linalg.solve(columns[pulled], matrix[pulled])
            tensions = tensions + last.tensions[pulled].T @ follow
            matrix = matrix + columns @ follow
        return cls(known, matrix[:k], known.points[-1].response.nodes[:, :-1] @ tensions)

    def displacement(self, change: Array) -> float:
        """Largest displacement of a node by a change of the mobilisations [1], shape (k,), to first order [m]."""
        return self._largest(self.columns @ change)

    def to_error(self, error: Array, path: FrictionPath) -> float:
        """Largest displacement of a node by an error of the slips [m], shape (k,), to first order [m].

        Only by those holes whose mobilisation at the end depends on it, see `FrictionPath.insensitive_holes`; by any
        change of the friction where the path does not reach the end, or is known too roughly.
        """
        known, presliding = self.known, self.known.taut.presliding
        slip = np.abs((known.end.slips - known.start.slips)[known.taut.holes])
        if not path.complete or error.max() > ROUGH * max(slip.max(), presliding.min()):
            return self._largest(2.0 * np.abs(self.columns).sum(axis=1))
        which = np.flatnonzero(~path.insensitive_holes(error, presliding))
        if not which.size:
            return 0.0
        response = self.columns[:, which] @ np.linalg.inv(self.matrix[np.ix_(which, which)])
        return self._largest(np.abs(response) @ error[which])

    def _largest(self, step: Array) -> float:
        """Largest displacement of a node in a change of the unknowns of the reduced scene [m]."""
        nodes = np.concatenate([step[p.nodes] for p in self.known.end.numbering.robots]).reshape(-1, 6)
        return float(np.linalg.norm(nodes[:, :3], axis=1).max())


class Reversals(NamedTuple):
    """Slip reversals within a substep, and what the mobilisations at its end count from."""

    path: FrictionPath  # Friction path of the holes of tendons under tension through the substep
    response: EndResponse
    effect: float  # Largest displacement of a node that reversals cause at its end, over the length [1]
    error: float  # Uncertainty of that effect [1]
    possible: bool  # Whether any slip reverses, or may reverse with an error of the slips

    @property
    def total(self) -> float:
        """Largest displacement of a node if they are ignored, over the length [1]."""
        return self.effect + self.error

    def of(self, state: SolverState) -> SolverState:
        """A state that counts from the start of the substep or the last reversals, mobilised as at the path's end."""
        known, path, numbering = self.response.known, self.path, self.response.known.end.numbering
        start, holes = known.start, known.taut.holes
        slip, counted, last = start.slips.copy(), start.mobilisation.copy(), known.end.mobilisation.copy()
        slip[holes] += path.reversal_slip
        counted[holes], last[holes] = path.reversal_mobilisation, path.unknowns[: len(holes)]
        slips = numbering.with_frictional_holes([f.slip for f in state.friction], slip)
        mobilised = numbering.with_frictional_holes([f.mobilisation for f in state.friction], counted)
        by_robot = zip(state.friction, slips, mobilised, strict=True)
        friction = tuple(replace(own, slip=slip, mobilisation=s) for own, slip, s in by_robot)
        at_end = numbering.with_frictional_holes(state.mobilisation, last)
        return state._replace(friction=friction, mobilisation=at_end)


def find_reversals(known: KnownStates, length: float, *, refinable: bool) -> Reversals:
    """Reversals of slips between two solved states.

    Parameters
    ----------
    known
        Solved states of the substep; the last one is solved from the first as a whole.
    length
        Length of the longest backbone [m].
    refinable
        Whether states within the substep may be solved, which decide where a slip reverses. Else the path is followed
        once more, with twice the defect, and the difference is an error, too.
    """
    taut, start, holes = known.taut, known.start, known.taut.holes
    data = [taut.slip_data(point, known.targets) for point in known.points]
    transfer, intervals, presliding = tension_transfer(taut.tendons), Intervals.between(data), taut.presliding
    elastic_slip = np.append(presliding, np.zeros(len(taut.driven)))
    slips = InterpolatedSlips(transfer, intervals, elastic_slip, np.eye(len(data[0].tension)))
    begin = start.mobilisation[holes], start.driven_tension[taut.driven], data[0].tension
    path, response = follow_friction(slips, *begin), EndResponse.of(known, slips)
    defect = np.abs(intervals.defect[: len(holes)])
    if not path.complete:
        return Reversals(path, response, 0.0, response.to_error(defect, path) / length, possible=True)
    effect = response.displacement(path.unknowns[: len(holes)] - known.end.mobilisation[holes]) / length
    possible = bool((path.reversed | path.may_touch_bound(defect / presliding)).any())
    refined = len(known.points) > 2
    off_line = intervals.error_off_line(path.segments.start, path.segments.tension, len(holes))
    error = REFINED_ERROR * effect if refined else response.to_error(defect + off_line, path) / length
    if error > 0.0 and not refinable:
        other = follow_friction(slips._replace(intervals=intervals.with_defect_doubled()), *begin)
        moved = response.displacement(path.unknowns[: len(holes)] - other.unknowns[: len(holes)]) / length
        error = max(error, moved, response.to_error(defect + off_line, other) / length)
        possible = bool(possible or other.reversed.any())
    return Reversals(path, response, effect, error, possible)
