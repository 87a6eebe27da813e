"""Slip reversals within a solved substep: what they change at its end, how certain that is, where it may be divided."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.solve.equations.numbering import Numbering
from tdcr_fe.solve.equations.state import SolverState, Target
from tdcr_fe.solve.friction_path.path import FrictionPath
from tdcr_fe.solve.friction_path.substep_slips import (
    LEAST_DIVISION,
    SMALL,
    InterpolationPoint,
    SubstepSlips,
)
from tdcr_fe.solve.friction_path.taut_tendons import TautTendons

Array = NDArray[np.float64]
Index = NDArray[np.int_]

#: Error left by located reversals after the substep is solved with them, before the path is followed again with the new
#: end: a fraction of what they change [1].
CORRECTION_ERROR = 0.03
#: Error of reversals located through twice as many states within the substep as before, over what they changed [1].
#: With a quarter of it, one of twenty random robots ended 2.2e-5 of the length off (documentation, page "Theory").
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
#: Nearest to its ends, as a fraction of it, where a substep is divided at a reversal [1].
LEAST_DIVISION_AT_REVERSAL = 1e-3


class History(NamedTuple):
    """What the mobilisations at the end of a substep count from: its start, or the last reversal.

    Attributes
    ----------
    slip : ndarray, shape (k,)
        Of the frictional holes [m].
    mobilisation : ndarray, shape (k,)
        At that slip [1].
    at_end : ndarray, shape (k,)
        Those at the end of the substep, as they follow from the path [1].
    followed : ndarray of int, shape (i,)
        Which of the holes belong to tendons under tension, the ones of the path.
    slips : SubstepSlips
        Of these holes, in the substep.
    """

    slip: Array
    mobilisation: Array
    at_end: Array
    followed: Index
    slips: SubstepSlips

    def of(self, state: SolverState, numbering: Numbering) -> SolverState:
        """A state with this history, and with the mobilisations that follow from it."""
        slips = numbering.with_frictional_holes([f.slip for f in state.friction], self.slip)
        counted = numbering.with_frictional_holes([f.mobilisation for f in state.friction], self.mobilisation)
        friction = [
            replace(own, slip=slip, mobilisation=mobilisation)
            for own, slip, mobilisation in zip(state.friction, slips, counted, strict=True)
        ]
        at_end = numbering.with_frictional_holes(state.mobilisation, self.at_end)
        return state._replace(friction=tuple(friction), mobilisation=at_end)

    def distance(self, state: SolverState, numbering: Numbering) -> float:
        """Largest displacement of a node between the end that follows from the path, and a solved one [m]."""
        off = numbering.at_frictional_holes(state.mobilisation) - self.at_end
        return self.slips.displacement(off[self.followed], numbering)


class Reversals(NamedTuple):
    """Slip reversals within a substep.

    Attributes
    ----------
    effect : float
        Largest displacement of a node that they cause at its end, over the length [1].
    error : float
        Uncertainty of that effect [1].
    division : float
        Where to divide the substep, as a fraction of it [1].
    remaining_error : float
        Error that is left where the substep is solved with the reversals located, over the length [1].
    history : History or None
        What the mobilisations at the end count from, where that is known.
    path : FrictionPath or None
        The path with the reversals, where it reaches the end.
    """

    effect: float
    error: float
    division: float
    remaining_error: float = np.inf
    history: History | None = None
    path: FrictionPath | None = None

    @property
    def total(self) -> float:
        """Largest displacement of a node where they are left out of account, over the length [1]."""
        return FIRST_ORDER * self.effect + self.error


def find_reversals(
    points: Sequence[InterpolationPoint],
    taut: TautTendons,
    targets: tuple[Target, Target],
    presliding: float,
    length: float,
    allowed: float,
    *,
    locate: bool,
    solved_with_reversals: bool = False,
) -> Reversals | None:
    """Reversals of slips between two solved states.

    Parameters
    ----------
    points
        The states, and any that were solved within the substep; the last one is solved from the first as a whole.
    taut
        The tendons under tension in any of them.
    targets
        Inputs and loads at both ends.
    presliding
        Presliding distance [m].
    length
        Of the longest backbone [m].
    allowed
        Largest displacement of a node that they may cause, over the length [1].
    locate
        Whether they are located where they cause more than that; else only where to divide is found.
    solved_with_reversals
        Whether the last state was solved with reversals located before; else as a whole.

    Returns
    -------
    Reversals or None
        None where every slip is monotone, so that the substep is exact as a whole.
    """
    substep = SubstepSlips.of(points, taut, targets, presliding)
    numbering = points[-1].state.numbering
    path = substep.follow()
    agreement = _agreement(allowed, length)
    corrected = substep.at_end(path, numbering, agreement)
    change = corrected - substep.after
    effect = substep.displacement(change, numbering) / length
    history = _history(points, taut, path, corrected, substep) if path.complete and locate else None
    if history is not None and len(points) > 2:
        error = _refined_error(substep, points, taut, path, corrected, effect, length, allowed)
        return Reversals(effect, error, 0.5, error, history, path)
    if path.complete:
        divided = Reversals(effect, 0.0, _division_at_reversal(path, change))
        if effect > allowed and not locate and not substep.is_rough:
            return divided
        found = substep.path_error(
            path, corrected, numbering, allowed * length, agreement, matters=effect > allowed, locate=locate
        )
        if found is not None:
            if not (path.reversed.any() or found.reverses or solved_with_reversals):
                return None
            error = found.displacement / length
            if not locate:
                return divided._replace(error=error)
            remaining = error + (0.0 if solved_with_reversals else CORRECTION_ERROR * effect)
            return Reversals(effect, error, _division(allowed, error), remaining, history, path)
    # Reversals are not located well enough.
    worst = substep.worst_case(path, corrected)
    error = FIRST_ORDER * substep.displacement(corrected - worst, numbering) / length
    return Reversals(effect, error, substep.rough_division, np.inf, history, path if path.complete else None)


def _agreement(allowed: float, length: float) -> float:
    """Displacement of a node up to which the end of a path and the solution to first order are the same [m]."""
    return max(allowed, AGREEMENT) * length


def _refined_error(
    substep: SubstepSlips,
    points: Sequence[InterpolationPoint],
    taut: TautTendons,
    path: FrictionPath,
    corrected: Array,
    effect: float,
    length: float,
    allowed: float,
) -> float:
    """Error of a path through states within the substep, over the length [1].

    Half of what the new states changed; or what changes without every other of them, if that is less and they lie near
    the path.
    """
    error = REFINED_ERROR * effect
    if error > allowed and len(points) % 2 == 1 and _near_path(points, taut, path):
        coarser = substep._replace(model=substep.model.through_every_other_state())
        numbering = points[-1].state.numbering
        moved = corrected - coarser.at_end(coarser.follow(), numbering, _agreement(allowed, length))
        error = min(error, substep.displacement(moved, numbering) / length)
    return error


def _near_path(points: Sequence[InterpolationPoint], taut: TautTendons, path: FrictionPath) -> bool:
    """Whether all solved states after the start are near a followed path."""
    for at in points[1:]:
        tension = taut.tensions(at.state)
        if float(np.abs(path.at(at.factor)[1] - tension).max()) > NEAR_PATH * float(tension.max()):
            return False
    return True


def _history(
    points: Sequence[InterpolationPoint],
    taut: TautTendons,
    path: FrictionPath,
    at_end: Array,
    slips: SubstepSlips,
) -> History:
    """What the mobilisations of all frictional holes count from after a followed path.

    Parameters
    ----------
    points
        Solved states, from the start of the substep to its end.
    taut
        The tendons under tension, whose holes the path is about.
    path
        The path.
    at_end
        Mobilisations of these holes at the end [1], shape (k,).
    slips
        Of these holes, in the substep.
    """
    start, end, holes = points[0].state, points[-1].state, taut.holes
    slip, counted, last = start.slips.copy(), start.mobilisation.copy(), end.mobilisation.copy()
    slip[holes] += path.reversal_slip
    counted[holes], last[holes] = path.reversal_mobilisation, at_end
    return History(slip, counted, last, holes, slips)


def _division(allowed: float, found: float) -> float:
    """Where to divide a substep whose error, which falls about with its cube, is above the one allowed [1]."""
    return min(0.5, max(LEAST_DIVISION, float(np.cbrt(allowed / max(found, allowed)))))


def _division_at_reversal(path: FrictionPath, change: Array) -> float:
    """Where to divide the substep: at the first reversal that changes a mobilisation; else in the middle [1].

    Parameters
    ----------
    path
        The path.
    change
        Of the mobilisations at the end by the reversals [1], shape (k,).
    """
    factors = path.reversal_factor[path.reversed & (np.abs(change) > SMALL)]
    first = float(factors.min(initial=1.0))
    return first if LEAST_DIVISION_AT_REVERSAL < first < 1.0 - LEAST_DIVISION_AT_REVERSAL else 0.5
