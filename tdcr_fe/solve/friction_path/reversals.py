"""Slip reversals within a solved substep: where they are, what they change, and how certain that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.complementarity import solve_box
from tdcr_fe.solve.equations.numbering import Numbering
from tdcr_fe.solve.equations.state import SolverState, Target
from tdcr_fe.solve.friction_path.equilibrium import Equilibrium
from tdcr_fe.solve.friction_path.friction_path import FollowedPath, follow
from tdcr_fe.solve.friction_path.slip_model import SlipModel
from tdcr_fe.solve.friction_path.taut_tendons import TautTendons
from tdcr_fe.solve.friction_path.tension_response import LoadResponse
from tdcr_fe.solve.friction_path.tension_transfer import tension_transfer

Array = NDArray[np.float64]
Index = NDArray[np.int_]

#: Slips below this fraction of the presliding distance, and mobilisations below it, are zero [1].
SMALL = 1e-2
#: Largest error of the interpolated slips, over the largest slip, with which reversals are located; slips below so many
#: presliding distances count as that [1].
ROUGH, LEAST_SLIPS = 0.1, 10.0
#: Times what is uncertain in the interpolation with which the path is followed once more: where its error is below
#: `ROUGH` of the slips, and where it is above [1].
OVERSHOOT, FAR_OVERSHOOT = 2.0, 3.0
#: Slips are monotone where their rates are this many times larger than the rates of what is uncertain [1].
SAFETY = 2.0
#: Uncertainty of what located reversals cause before the substep is solved with them, as a fraction of it [1].
CORRECTION_ERROR = 0.03
#: Error of reversals located with twice as many states within the substep as before, over what they changed [1].
REFINED_ERROR = 0.5
#: Largest effect of reversals over that at first order [1].
FIRST_ORDER = 1.25
#: Nearest to its ends, as a fraction of it, where a substep is divided without and with a reversal located [1].
NEAR, CLOSE = 0.1, 1e-3


class History(NamedTuple):
    """What the mobilisations at the end of a substep count from: its start, or the last reversal.

    Attributes
    ----------
    slip : ndarray, shape (k,)
        Of the frictional holes [m].
    mobilisation : ndarray, shape (k,)
        At that slip [1].
    at_end : ndarray, shape (k,)
        That follow at the end, at first order [1].
    """

    slip: Array
    mobilisation: Array
    at_end: Array

    def of(self, state: SolverState, numbering: Numbering) -> SolverState:
        """A state with this history, and with the mobilisations that follow from it."""
        slips = numbering.with_frictional_holes([f.slip for f in state.friction], self.slip)
        turned = numbering.with_frictional_holes([f.mobilisation for f in state.friction], self.mobilisation)
        friction = [
            replace(own, slip=slip, mobilisation=mobilisation)
            for own, slip, mobilisation in zip(state.friction, slips, turned, strict=True)
        ]
        now = numbering.with_frictional_holes(state.mobilisation, self.at_end)
        return state._replace(friction=tuple(friction), mobilisation=now)


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
    uncertain : float
        Error that is left where the substep is solved with the reversals located, over the length [1].
    turning : History or None
        What the mobilisations at the end count from, where that is known.
    path : FollowedPath or None
        With them, where it reaches the end.
    """

    effect: float
    error: float
    division: float
    uncertain: float = np.inf
    turning: History | None = None
    path: FollowedPath | None = None

    @property
    def total(self) -> float:
        """Largest displacement of a node where they are left out of account, over the length [1]."""
        return FIRST_ORDER * self.effect + self.error


class Point(NamedTuple):
    """A solved state at an end of a substep or within it.

    Attributes
    ----------
    factor : float
        Load factor within the substep [1].
    state : Equilibrium
        Linearised exactly, with the response to the tensions of all tendons under tension at any of the points.
    load : LoadResponse or None
        Response to the change of the loads in the whole substep; None where no load changes.
    """

    factor: float
    state: Equilibrium
    load: LoadResponse | None = None


class _Substep(NamedTuple):
    """Taut tendons of a substep that was solved as a whole.

    Attributes
    ----------
    model : SlipModel
        The slips in it.
    tension : ndarray, shape (q,)
        Of the segments at its start [N].
    before, after : ndarray, shape (k,)
        Mobilisations at its ends [1].
    base : ndarray, shape (c,)
        Unknown tensions at the base, at its start [N].
    slip : ndarray, shape (k,)
        Change of the slips [m].
    matrix : ndarray, shape (k, k)
        As of `SlipState` at the end, with the tendons slack and taut as they are there.
    columns : ndarray, shape (unknowns, k)
        Change of the unknowns of the reduced scene by the mobilisations there.
    """

    model: SlipModel
    tension: Array
    before: Array
    after: Array
    base: Array
    slip: Array
    matrix: Array
    columns: Array

    @classmethod
    def of(
        cls,
        points: Sequence[Point],
        picked: TautTendons,
        targets: tuple[Target, Target],
        presliding: float,
    ) -> _Substep:
        """Of the tendons under tension."""
        holes, k = picked.holes, len(picked.holes)
        start, end = points[0].state, points[-1].state
        ends = [picked.end(at.state, targets, at.factor, at.load) for at in points]
        model = SlipModel(tension_transfer(picked.tendons), ends, k, picked.unknown, presliding)
        before, after = start.mobilisation[holes], end.mobilisation[holes]
        base = picked.base_tensions(1)
        last = model.at(1.0, np.append(after, base), ends[-1].tension)
        every, taut = np.arange(k), k + np.flatnonzero(base > 0.0)
        by, matrix = last.segments(every), last.columns(every)
        if taut.size:
            pulled = -np.linalg.solve(last.columns(taut)[taut], matrix[taut])
            by, matrix = by + last.segments(taut) @ pulled, matrix + last.columns(taut) @ pulled
        slip = (end.slips - start.slips)[holes]
        assert end.response is not None
        columns = end.response.nodes @ by
        return cls(model, ends[0].tension, before, after, picked.base_tensions(0), slip, matrix[:k], columns)

    def follow(self, uncertain: float = 1.0) -> FollowedPath:
        """The friction states followed through it, see `tdcr_fe.solve.friction_path.friction_path.follow`.

        Reversals that change a mobilisation by less than `SMALL` are left out.
        """
        model = self.model if uncertain == 1.0 else self.model.with_bulge(uncertain)
        path = follow(model, self.before, self.base, self.tension)
        lost = path.turning_mobilisation - self.before - path.turning_slip / self.model.presliding
        slight = path.reversed & (np.abs(lost) < SMALL)
        if not slight.any():
            return path
        return path._replace(
            turning_slip=np.where(slight, 0.0, path.turning_slip),
            turning_mobilisation=np.where(slight, self.before, path.turning_mobilisation),
            turning_factor=np.where(slight, 0.0, path.turning_factor),
        )

    def corrected(self, trial: Array) -> Array:
        """Mobilisations at the end for other trial mobilisations there, at first order, shape (k,)."""
        right = self.model.presliding * (trial - self.after) + self.matrix @ self.after
        return solve_box(self.matrix, right, self.after)[0]

    def with_reversals(self, path: FollowedPath) -> Array:
        """Mobilisations at the end, counted from the last reversals, shape (k,)."""
        since = (self.slip - path.turning_slip) / self.model.presliding
        return self.corrected(path.turning_mobilisation + since)

    def at_worst(self, path: FollowedPath, mobilisation: Array, error: Array) -> Array:
        """Mobilisations at the end if every hole that slips there has just reversed by an error, shape (k,)."""
        presliding = self.model.presliding
        lost = np.abs(error) if path.complete else np.abs(self.slip) + presliding
        side = np.trunc(mobilisation)
        return self.corrected(np.where(side != 0.0, side * (1.0 - lost / presliding), mobilisation))

    def displacement(self, change: Array, numbering: Numbering) -> float:
        """Largest displacement of a node by a change of the mobilisations, shape (k,), at first order [m]."""
        step = self.columns @ change
        nodes = np.concatenate([step[p.nodes] for p in numbering.robots]).reshape(-1, 6)
        return float(np.linalg.norm(nodes[:, :3], axis=1).max())


def find_reversals(
    points: Sequence[Point],
    picked: TautTendons,
    targets: tuple[Target, Target],
    presliding: float,
    length: float,
    allowed: float,
    *,
    locate: bool,
    again: bool = False,
) -> Reversals | None:
    """Reversals of slips between two solved states.

    Parameters
    ----------
    points
        The states, and any that were solved within the substep; the last one is solved from the first as a whole.
    picked
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
    again
        Whether the last state was solved with reversals located in it; else as a whole.

    Returns
    -------
    Reversals or None
        None where every slip is monotone, so that the substep is exact as a whole.
    """
    substep = _Substep.of(points, picked, targets, presliding)
    start, end, holes = points[0].state, points[-1].state, picked.holes
    path = substep.follow()
    within = len(points) > 2

    def displacement(mobilisation: Array, other: Array) -> float:
        return substep.displacement(mobilisation - other, end.numbering) / length

    at_holes = np.abs(substep.model.bulge)
    worst = float(at_holes.max())
    sure = worst <= SMALL * presliding or np.all(path.margin >= SAFETY * (OVERSHOOT - 1.0) * at_holes)
    if path.complete and sure and not (path.reversed.any() or again or within):
        return None
    scale = max(float(np.abs(substep.slip).max()), presliding)
    corrected = substep.with_reversals(path)
    effect = displacement(corrected, substep.after)
    division = min(0.5, max(NEAR, float(np.sqrt(ROUGH * scale / max(worst, ROUGH * scale)))))
    if path.complete and locate:
        turning = _history(start, end, holes, path, corrected)
        if within:
            error = REFINED_ERROR * effect
            return Reversals(effect, error, 0.5, error, turning, path)
    else:
        turning = None
    if path.complete and worst <= ROUGH * max(scale, LEAST_SLIPS * presliding):
        located = Reversals(effect, 0.0, _division(path, corrected - substep.after))
        if effect > allowed and not locate:
            return located
        beyond = substep.follow(OVERSHOOT if worst <= ROUGH * scale else FAR_OVERSHOOT)
        if beyond.complete:
            if not (path.reversed.any() or beyond.reversed.any() or again):
                return None
            spread = displacement(corrected, substep.with_reversals(beyond))
            if not locate:
                return located._replace(error=spread)
            uncertain = spread + (0.0 if again else CORRECTION_ERROR * effect)
            return Reversals(effect, spread, _part(allowed, spread), uncertain, turning, path)
    # Reversals are not located well enough; the error falls about with the square of the substep.
    error = FIRST_ORDER * displacement(corrected, substep.at_worst(path, corrected, at_holes))
    return Reversals(effect, error, division, np.inf, turning, path if path.complete else None)


def _history(
    start: Equilibrium, end: Equilibrium, holes: NDArray[np.int_], path: FollowedPath, at_end: Array
) -> History:
    """What the mobilisations count from after a followed path, and those at the end of some of the holes."""
    slip, turned, last = start.slips.copy(), start.mobilisation.copy(), end.mobilisation.copy()
    slip[holes] += path.turning_slip
    turned[holes], last[holes] = path.turning_mobilisation, at_end
    return History(slip, turned, last)


def _part(allowed: float, found: float) -> float:
    """Where to divide a substep whose error, which falls about with its cube, is above the one allowed [1]."""
    return min(0.5, max(NEAR, float(np.cbrt(allowed / max(found, allowed)))))


def _division(path: FollowedPath, change: Array) -> float:
    """Where to divide the substep: at the first reversal that changes a mobilisation; else in the middle [1]."""
    turned = path.turning_factor[path.reversed & (np.abs(change) > SMALL)]
    first = float(turned.min(initial=1.0))
    return first if CLOSE < first < 1.0 - CLOSE else 0.5
