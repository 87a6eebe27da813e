"""Slip reversals within a solved substep: what they change at its end, how certain that is, where it may be divided."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.complementarity import solve_box
from tdcr_fe.solve.equations.configuration import SolverState, Target
from tdcr_fe.solve.equations.layout import Numbering
from tdcr_fe.solve.friction_path.follow import follow_friction
from tdcr_fe.solve.friction_path.known_states import InterpolationPoint
from tdcr_fe.solve.friction_path.path import FrictionPath
from tdcr_fe.solve.friction_path.rates import columns_of, tension_columns
from tdcr_fe.solve.friction_path.response import TautTendons
from tdcr_fe.solve.friction_path.slips import SlipModel
from tdcr_fe.solve.friction_path.transfer import tension_transfer

Array = NDArray[np.float64]
Index = NDArray[np.int_]

#: Reversals that change a mobilisation by less than this are left out; slips below this fraction of the presliding
#: distance are zero [1].
SMALL = 1e-2
#: The interpolation is too uncertain to locate reversals where its error is above this fraction of the largest slip,
#: but for slips below so many presliding distances, which count as that many [1].
ROUGH, LEAST_SLIPS = 0.1, 10.0
#: Factors on the parabola in the interpolated slip rates with which the path is followed once more to see its error:
#: where the parabola moves slips by less than `ROUGH` of the largest, and where by more [1].
DEFECT_FACTOR, ROUGH_DEFECT_FACTOR = 2.0, 3.0
#: A slip keeps its direction whatever the interpolation misses where its rate is this many times larger than what the
#: parabola adds to it [1].
SAFETY = 2.0
#: Displacement by all holes of which that is not so, to first order, up to which the path is not followed once more, as
#: a fraction of what is allowed: holes that reverse earlier or later move others, too [1].
NEGLIGIBLE = 0.01
#: Error over that allowed that is taken where the other path shows none although holes may be wrong to first order: it
#: asks for a state within the substep. Once in 700 load steps of random robots 1e-3 of the length was missing [1].
UNDECIDED = 2.0
#: A substep whose reversals cannot be located is divided no nearer to its start than at this fraction of it [1].
LEAST_DIVISION = 0.1
#: From -1 to 1: presliding distances of slip over which a mobilisation can change.
FULL_RANGE = 2.0
#: Error left by located reversals after the substep is solved with them, before the path is followed again with the new
#: end: a fraction of what they change [1].
CORRECTION_ERROR = 0.03
#: Error of reversals located through twice as many states within the substep as before, over what they changed [1].
#: With a quarter of it, one of twenty random robots ended 2.2e-5 of the length off.
REFINED_ERROR = 0.5
#: Largest difference between the tensions of solved states and those of the followed path, over the largest tension,
#: up to which a path through every other state shows the error [1]: farther off the path the interpolation is linear in
#: the tensions, and both paths may have the same error.
NEAR_PATH = 2e-3
#: Displacement of a node up to which the end of a followed path and the solution to first order with its reversals are
#: the same, over the length, where less is allowed [1]: the path has an error of its integration, seen up to 6.5e-7.
AGREEMENT = 2e-6
#: Largest effect of reversals over that to first order [1].
FIRST_ORDER = 1.25


class SolvedStates(NamedTuple):
    """Solved states of a substep, from its start to its end, between which slips are interpolated."""

    points: Sequence[InterpolationPoint]
    taut: TautTendons  # The tendons under tension in any of them
    targets: tuple[Target, Target]  # Inputs and loads at both ends
    length: float  # Of the longest backbone [m]
    allowed: float  # Largest displacement of a node that reversals may cause, over the length [1]

    @property
    def numbering(self) -> Numbering:
        """Of the unknowns."""
        return self.points[-1].state.numbering

    @property
    def agreement(self) -> float:
        """Displacement of a node up to which the end of a path and the solution to first order are the same [m]."""
        return max(self.allowed, AGREEMENT) * self.length


class PathError(NamedTuple):
    """What the interpolation of the slips leaves uncertain in a followed path."""

    displacement: float  # Of a node at the end of the substep, the largest [m]
    reverses: bool  # Whether any slip reverses with other slips that are possible


class SubstepSlips(NamedTuple):
    """Slips of the tendons under tension in a substep that was solved as a whole."""

    states: SolvedStates  # Of the substep
    model: SlipModel  # The slips in it
    tension: Array  # (q,): Of the segments at its start [N]
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
    def of(cls, states: SolvedStates) -> SubstepSlips:
        """From its solved states."""
        taut, points = states.taut, states.points
        holes, k = taut.holes, len(taut.holes)
        start, end = points[0].state, points[-1].state
        data = [taut.slip_data(point.state, states.targets, point.factor, point.load) for point in points]
        model = SlipModel(tension_transfer(taut.tendons), data, taut.presliding, taut.unknown)
        before, after = start.mobilisation[holes], end.mobilisation[holes]
        base = taut.base_tensions(1)
        last = model.slips.at(1.0, np.append(after, base), data[-1].tension).derivatives
        every, pulled = np.arange(k), k + np.flatnonzero(base > 0.0)
        matrix, tensions = columns_of(last, every).T, tension_columns(last, every).T
        if pulled.size:
            # Tendons driven by displacement that are taut keep their length: their tensions follow.
            columns = columns_of(last, pulled).T
            follow = -np.linalg.solve(columns[pulled], matrix[pulled])
            tensions = tensions + tension_columns(last, pulled).T @ follow
            matrix = matrix + columns @ follow
        slip = (end.slips - start.slips)[holes]
        assert end.response is not None
        first, columns = taut.base_tensions(0), end.response.nodes @ tensions
        return cls(states, model, data[0].tension, before, after, first, slip, matrix[:k], columns)

    def follow(self, defect_factor: float = 1.0) -> FrictionPath:
        """The friction states followed through the substep.

        Reversals that change a mobilisation by less than `SMALL` are left out.

        Parameters
        ----------
        defect_factor
            Factor on the parabola in the slip rates, see `SlipModel` [1].
        """
        model = self.model if defect_factor == 1.0 else self.model.with_defect_factor(defect_factor)
        path = follow_friction(model.slips, self.before, self.base, self.tension)
        # By how much the mobilisation at the end changes where it counts from the reversal, not from the start.
        change = path.reversal_mobilisation - self.before - path.reversal_slip / self.model.presliding
        slight = path.reversed & (np.abs(change) < SMALL)
        if not slight.any():
            return path
        return path._replace(
            reversal_slip=np.where(slight, 0.0, path.reversal_slip),
            reversal_mobilisation=np.where(slight, self.before, path.reversal_mobilisation),
            reversal_factor=np.where(slight, 0.0, path.reversal_factor),
        )

    def corrected(self, trial: Array) -> Array:
        """Mobilisations at the end for other trial mobilisations there [1], to first order, shape (k,)."""
        right = self.model.presliding * (trial - self.after) + self.matrix @ self.after
        return solve_box(self.matrix, right, self.after)[0]

    def with_reversals(self, path: FrictionPath) -> Array:
        """Mobilisations at the end, counted from the last reversals of a path [1], shape (k,)."""
        since = (self.slip - path.reversal_slip) / self.model.presliding
        return self.corrected(path.reversal_mobilisation + since)

    def at_end(self, path: FrictionPath) -> Array:
        """Mobilisations at the end of the substep that follow from a path [1], shape (k,).

        Those to first order, which have no error of the integration, where they agree with the end of the path. They
        need not: where derivatives of the tensions jump, the equations to first order can have another solution.
        """
        first_order = self.with_reversals(path)
        last = path.unknowns[: len(first_order)]
        if path.complete and self.displacement(last - first_order) > self.states.agreement:
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
        presliding = self.model.presliding
        error = self.slip_error if path.complete else np.abs(self.slip) + presliding
        side = np.trunc(mobilisation)
        return self.corrected(np.where(side != 0.0, side * (1.0 - error / presliding), mobilisation))

    def displacement(self, change: Array) -> float:
        """Largest displacement of a node by a change of the mobilisations [1], shape (k,), to first order [m]."""
        return _largest_displacement(self.columns @ change, self.states.numbering)

    @property
    def slip_error(self) -> Array:
        """Uncertainty of the change of the slips: what the parabola in their rates adds to it [m], shape (k,)."""
        return np.abs(self.model.defect)

    @property
    def largest_slip(self) -> float:
        """Largest change of a slip, at least the presliding distance [m]."""
        return max(float(np.abs(self.slip).max()), self.model.slips.presliding)

    @property
    def is_rough(self) -> bool:
        """Whether the interpolation is too uncertain to locate reversals."""
        least = LEAST_SLIPS * self.model.slips.presliding
        return float(self.slip_error.max()) > ROUGH * max(self.largest_slip, least)

    @property
    def rough_division(self) -> float:
        """Where to divide the substep if reversals cannot be located, as a fraction of it [1].

        The error of the slips falls about with the square of the substep.
        """
        rough = ROUGH * self.largest_slip
        return min(0.5, max(LEAST_DIVISION, float(np.sqrt(rough / max(float(self.slip_error.max()), rough)))))

    def path_error(self, path: FrictionPath, mobilisation: Array, matters: bool) -> PathError | None:
        """What the interpolation leaves uncertain in a complete path; None where it is too rough to say.

        Where the error may be larger than allowed to first order, and the other path shows nothing of it, states within
        the substep have to decide: that path has one error of many.

        Parameters
        ----------
        path
            The path.
        mobilisation
            Those at the end that follow from it [1], shape (k,).
        matters
            Whether the reversals of the path displace a node by more than is allowed.
        """
        allowed = self.states.allowed * self.states.length
        factor = DEFECT_FACTOR
        if self.slip_error.max() > ROUGH * self.largest_slip:
            factor = ROUGH_DEFECT_FACTOR
        off_line = self.model.error_off_line(path.segments.start, path.segments.tension)
        error = SAFETY * (factor - 1.0) * (self.slip_error + off_line)
        first_order = 0.0
        if not (self.is_rough and matters):
            first_order = self._displacement_by(error, path)
            if first_order <= NEGLIGIBLE * allowed:
                return PathError(first_order, False)
        if self.is_rough:
            return None
        other = self.follow(factor)
        if not other.complete:
            return None
        moved = self.displacement(mobilisation - self.at_end(other))
        if moved <= allowed < first_order:
            return PathError(UNDECIDED * allowed, True)
        return PathError(moved, bool(other.reversed.any()))

    def _displacement_by(self, error: Array, path: FrictionPath) -> float:
        """Largest displacement of a node by an error of the slips [m], to first order [m].

        Only by those holes whose mobilisation at the end depends on it, see `FrictionPath.insensitive_holes`.
        """
        presliding = self.model.presliding
        which = np.flatnonzero(~path.insensitive_holes(error, presliding))
        if not which.size:
            return 0.0
        response = self.columns[:, which] @ np.linalg.inv(self.matrix[np.ix_(which, which)])
        limited = np.minimum(error[which], FULL_RANGE * presliding[which])
        return _largest_displacement(np.abs(response) @ limited, self.states.numbering)


def _largest_displacement(step: Array, numbering: Numbering) -> float:
    """Largest displacement of a node in a change of the unknowns of the reduced scene [m]."""
    nodes = np.concatenate([step[p.nodes] for p in numbering.robots]).reshape(-1, 6)
    return float(np.linalg.norm(nodes[:, :3], axis=1).max())


class SlipHistory(NamedTuple):
    """What the mobilisations at the end of a substep count from: its start, or the last reversal."""

    slip: Array  # (k,): Of the frictional holes [m]
    mobilisation: Array  # (k,): At that slip [1]
    at_end: Array  # (k,): Those at the end of the substep, as they follow from the path [1]
    followed: Index  # (i,): Which of the holes belong to tendons under tension, the ones of the path
    slips: SubstepSlips  # Of these holes, in the substep

    def of(self, state: SolverState) -> SolverState:
        """A state with this history, and with the mobilisations that follow from it."""
        numbering = self.slips.states.numbering
        slips = numbering.with_frictional_holes([f.slip for f in state.friction], self.slip)
        counted = numbering.with_frictional_holes([f.mobilisation for f in state.friction], self.mobilisation)
        friction = [
            replace(own, slip=slip, mobilisation=mobilisation)
            for own, slip, mobilisation in zip(state.friction, slips, counted, strict=True)
        ]
        at_end = numbering.with_frictional_holes(state.mobilisation, self.at_end)
        return state._replace(friction=tuple(friction), mobilisation=at_end)

    def distance(self, state: SolverState) -> float:
        """Largest displacement of a node between the end that follows from the path, and a solved one [m]."""
        off = self.slips.states.numbering.at_frictional_holes(state.mobilisation) - self.at_end
        return self.slips.displacement(off[self.followed])


class Reversals(NamedTuple):
    """Slip reversals within a substep."""

    effect: float  # Largest displacement of a node that they cause at its end, over the length [1]
    error: float  # Uncertainty of that effect [1]
    division: float  # Where to divide the substep, as a fraction of it [1]
    # Error that is left where the substep is solved with the reversals located, over the length [1]
    remaining_error: float = np.inf
    history: SlipHistory | None = None  # What the mobilisations at the end count from, where that is known
    path: FrictionPath | None = None  # The path with the reversals, where it reaches the end

    @property
    def total(self) -> float:
        """Largest displacement of a node where they are left out of account, over the length [1]."""
        return FIRST_ORDER * self.effect + self.error


def find_reversals(states: SolvedStates, solved_with_reversals: bool = False) -> Reversals | None:
    """Reversals of slips between two solved states.

    Parameters
    ----------
    states
        Of the substep; the last one is solved from the first as a whole.
    solved_with_reversals
        Whether the last state was solved with reversals located before; else as a whole.

    Returns
    -------
    Reversals or None
        None where every slip is monotone, so that the substep is exact as a whole.
    """
    substep, length, allowed = SubstepSlips.of(states), states.length, states.allowed
    path = substep.follow()
    corrected = substep.at_end(path)
    effect = substep.displacement(corrected - substep.after) / length
    history = _history(substep, path, corrected) if path.complete else None
    if history is not None and len(states.points) > 2:
        error = _refined_error(substep, path, corrected, effect)
        return Reversals(effect, error, 0.5, error, history, path)
    if path.complete:
        found = substep.path_error(path, corrected, matters=effect > allowed)
        if found is not None:
            if not (path.reversed.any() or found.reverses or solved_with_reversals):
                return None
            error = found.displacement / length
            remaining = error + (0.0 if solved_with_reversals else CORRECTION_ERROR * effect)
            return Reversals(effect, error, _division(allowed, error), remaining, history, path)
    # Reversals are not located well enough.
    worst = substep.worst_case(path, corrected)
    error = FIRST_ORDER * substep.displacement(corrected - worst) / length
    return Reversals(effect, error, substep.rough_division, np.inf, history, path if path.complete else None)


def _refined_error(substep: SubstepSlips, path: FrictionPath, corrected: Array, effect: float) -> float:
    """Error of a path through states within the substep, over the length [1].

    Half of what the new states changed; or what changes without every other of them, if that is less and they lie near
    the path.
    """
    error, states = REFINED_ERROR * effect, substep.states
    if error > states.allowed and len(states.points) % 2 == 1 and _near_path(states, path):
        coarser = substep._replace(model=substep.model.through_every_other_state())
        moved = corrected - coarser.at_end(coarser.follow())
        error = min(error, substep.displacement(moved) / states.length)
    return error


def _near_path(states: SolvedStates, path: FrictionPath) -> bool:
    """Whether all solved states after the start are near a followed path."""
    for point in states.points[1:]:
        tension = states.taut.tensions(point.state)
        if float(np.abs(path.at(point.factor)[1] - tension).max()) > NEAR_PATH * float(tension.max()):
            return False
    return True


def _history(substep: SubstepSlips, path: FrictionPath, at_end: Array) -> SlipHistory:
    """What the mobilisations of all frictional holes count from after a followed path.

    The path has the mobilisations ``at_end`` at the end of the substep [1], shape (k,).
    """
    points, holes = substep.states.points, substep.states.taut.holes
    start, end = points[0].state, points[-1].state
    slip, counted, last = start.slips.copy(), start.mobilisation.copy(), end.mobilisation.copy()
    slip[holes] += path.reversal_slip
    counted[holes], last[holes] = path.reversal_mobilisation, at_end
    return SlipHistory(slip, counted, last, holes, substep)


def _division(allowed: float, found: float) -> float:
    """Where to divide a substep whose error, which falls about with its cube, is above the one allowed [1]."""
    return min(0.5, max(LEAST_DIVISION, float(np.cbrt(allowed / max(found, allowed)))))
