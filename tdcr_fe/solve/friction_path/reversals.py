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
#: Slips keep their direction where their rates are this many times larger than the rates of what is uncertain [1].
SAFETY = 2.0
#: Displacement by all holes of which that is not so, at first order, up to which the path is not followed once more: as
#: a fraction of that allowed, since holes that reverse earlier or later move others [1].
NEGLIGIBLE = 0.01
#: Uncertainty of what located reversals cause before the substep is solved with them, as a fraction of it [1].
CORRECTION_ERROR = 0.03
#: Error of reversals located with twice as many states within the substep as before, over what they changed [1].
REFINED_ERROR = 0.5
#: Largest difference between the tensions of solved states and those of the followed path, over the largest tension,
#: with which what changes without every other state shows the error: off the path slips are taken as linear [1].
NEAR_PATH = 2e-3
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


class _Spread(NamedTuple):
    """What is uncertain in a followed path.

    Attributes
    ----------
    displacement : float
        Of a node at the end of the substep, the largest [m].
    reverses : bool
        Whether a slip may reverse by it.
    """

    displacement: float
    reverses: bool


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

    def at_worst(self, path: FollowedPath, mobilisation: Array) -> Array:
        """Mobilisations at the end if every hole that slips there has just reversed by an error, shape (k,)."""
        presliding = self.model.presliding
        lost = self.uncertain if path.complete else np.abs(self.slip) + presliding
        side = np.trunc(mobilisation)
        return self.corrected(np.where(side != 0.0, side * (1.0 - lost / presliding), mobilisation))

    def displacement(self, change: Array, numbering: Numbering) -> float:
        """Largest displacement of a node by a change of the mobilisations, shape (k,), at first order [m]."""
        return _largest_displacement(self.columns @ change, numbering)

    @property
    def uncertain(self) -> Array:
        """What is uncertain in the change of the slips [m], shape (k,)."""
        return np.abs(self.model.bulge)

    @property
    def scale(self) -> float:
        """Largest slip [m]."""
        return max(float(np.abs(self.slip).max()), self.model.presliding)

    @property
    def is_rough(self) -> bool:
        """Whether the interpolation is too uncertain to locate reversals."""
        return float(self.uncertain.max()) > ROUGH * max(self.scale, LEAST_SLIPS * self.model.presliding)

    @property
    def rough_division(self) -> float:
        """Where to divide the substep if reversals are not located, as a fraction of it [1]."""
        rough = ROUGH * self.scale
        return min(0.5, max(NEAR, float(np.sqrt(rough / max(float(self.uncertain.max()), rough)))))

    def spread(
        self, path: FollowedPath, mobilisation: Array, numbering: Numbering, allowed: float, matters: bool
    ) -> _Spread | None:
        """What is uncertain in a complete path by the interpolation of the slips; None where that is too rough to say.

        Parameters
        ----------
        path
            The path.
        mobilisation
            That follow from it at the end, shape (k,).
        numbering
            Of the unknowns.
        allowed
            Displacement of a node that is allowed [m].
        matters
            Whether the effect of the reversals is larger than that.
        """
        overshoot = OVERSHOOT if self.uncertain.max() <= ROUGH * self.scale else FAR_OVERSHOOT
        factors = np.array([piece.now for piece in path.pieces])
        beside = self.model.beside_line(factors, np.array([piece.tension for piece in path.pieces]))
        error = SAFETY * (overshoot - 1.0) * (self.uncertain + beside)
        if not (self.is_rough and matters):
            left = self._displacement_by(error, path, numbering)
            if left <= NEGLIGIBLE * allowed:
                return _Spread(left, False)
        if self.is_rough:
            return None
        beyond = self.follow(overshoot)
        if not beyond.complete:
            return None
        moved = self.displacement(mobilisation - self.with_reversals(beyond), numbering)
        return _Spread(moved, bool(beyond.reversed.any()))

    def _displacement_by(self, error: Array, path: FollowedPath, numbering: Numbering) -> float:
        """Largest displacement of a node by an error of the slips, see `FollowedPath.certain`, at first order [m]."""
        presliding = self.model.presliding
        which = np.flatnonzero(~path.certain(error, presliding))
        if not which.size:
            return 0.0
        response = self.columns[:, which] @ np.linalg.inv(self.matrix[np.ix_(which, which)])
        return _largest_displacement(np.abs(response) @ np.minimum(error[which], 2.0 * presliding), numbering)


def _largest_displacement(step: Array, numbering: Numbering) -> float:
    """Largest displacement of a node in a change of the unknowns of the reduced scene [m]."""
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
    corrected = substep.with_reversals(path)
    effect = substep.displacement(corrected - substep.after, end.numbering) / length
    turning = _history(start, end, holes, path, corrected) if path.complete and locate else None
    if turning is not None and len(points) > 2:
        error = REFINED_ERROR * effect
        if error > allowed and len(points) % 2 == 1 and _near_path(points, picked, path):
            coarser = substep._replace(model=substep.model.through_every_other_state())
            moved = corrected - coarser.with_reversals(coarser.follow())
            error = min(error, substep.displacement(moved, end.numbering) / length)
        return Reversals(effect, error, 0.5, error, turning, path)
    if path.complete:
        located = Reversals(effect, 0.0, _division(path, corrected - substep.after))
        if effect > allowed and not locate and not substep.is_rough:
            return located
        spread = substep.spread(path, corrected, end.numbering, allowed * length, effect > allowed)
        if spread is not None:
            if not (path.reversed.any() or spread.reverses or again):
                return None
            error = spread.displacement / length
            if not locate:
                return located._replace(error=error)
            uncertain = error + (0.0 if again else CORRECTION_ERROR * effect)
            return Reversals(effect, error, _part(allowed, error), uncertain, turning, path)
    # Reversals are not located well enough; the error falls about with the square of the substep.
    lost = substep.at_worst(path, corrected)
    error = FIRST_ORDER * substep.displacement(corrected - lost, end.numbering) / length
    return Reversals(effect, error, substep.rough_division, np.inf, turning, path if path.complete else None)


def _near_path(points: Sequence[Point], picked: TautTendons, path: FollowedPath) -> bool:
    """Whether all solved states after the start are near a followed path."""
    for at in points[1:]:
        tension = picked.tensions(at.state)
        if float(np.abs(path.at(at.factor)[1] - tension).max()) > NEAR_PATH * float(tension.max()):
            return False
    return True


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
