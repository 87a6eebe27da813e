"""Slip reversals within a solved substep: where they are, what they change, and how certain that is."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.complementarity import solve_box
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.solve.friction_path import ChangingTendons, FollowedPath, SlipRates, follow
from tdcr_fe.solve.friction_step import FrictionResponse, friction_response, mobilisations, slips_after
from tdcr_fe.solve.linearization import Linearization
from tdcr_fe.solve.numbering import Numbering
from tdcr_fe.solve.state import SolverState, Target
from tdcr_fe.solve.system import SceneSystem
from tdcr_fe.solve.tendon_rates import LoadResponse, driven_owners, driven_values, rates_with_tensions

Array = NDArray[np.float64]

#: Slips below this fraction of the presliding distance, and mobilisations below it, are zero [1].
SMALL = 1e-2
#: Largest error of the interpolated slips, over the largest slip, with which reversals are located [1].
ROUGH = 0.1
#: Times the error of the interpolation with which the path is followed once more, for what is uncertain in it [1].
OVERSHOOT = 1.5
#: Slips are monotone where their rates are this many times larger than the rates of the error [1].
SAFETY = 2.0
#: Uncertainty of what located reversals cause, as a fraction of it [1].
CORRECTION_ERROR = 0.03
#: Reversals within this fraction of a substep are at one place [1].
TOGETHER = 0.1
#: Largest turn of an element since the last linearisation with which that is as good as a new one [rad].
EXACT_TURN = 1e-5
#: Nearest to its ends, as a fraction of it, where a substep is divided without and with a reversal located [1].
NEAR, CLOSE = 0.1, 1e-3


class Equilibrium(NamedTuple):
    """A solved state with its linearisation.

    Attributes
    ----------
    state : SolverState
    forces : tuple of TendonForces
        By robot.
    linearization : Linearization
    response : FrictionResponse
        To the mobilisations.
    exact : bool
        Whether it is linearised in this very state, or so near that it makes no difference.
    """

    state: SolverState
    forces: tuple[TendonForces, ...]
    linearization: Linearization
    response: FrictionResponse
    exact: bool = False

    @classmethod
    def of(
        cls,
        system: SceneSystem,
        state: SolverState,
        forces: tuple[TendonForces, ...],
        linearization: Linearization,
        presliding: float,
    ) -> Equilibrium:
        """With the response to the mobilisations computed; presliding distance in m."""
        solve, slack = linearization.factorisation.solve, linearization.slack
        numbering = linearization.numbering
        response = friction_response(numbering, forces, solve, system.layout.clamped, slack, presliding)
        slack_now = [state.base_tension[p.robot][p.driven] <= 0.0 for p in numbering.robots]
        exact = linearization.turn_since(state.configuration.twists) <= EXACT_TURN and (
            not numbering.any_driven or np.array_equal(np.concatenate(slack), np.concatenate(slack_now))
        )
        return cls(state, forces, linearization, response, exact)

    @classmethod
    def at(cls, system: SceneSystem, state: SolverState, target: Target, presliding: float) -> Equilibrium:
        """Linearise in a solved state under its own target, which is in the scene; presliding distance in m."""
        numbering = system.numbering()
        residual = system.residual(state, target, numbering)
        linearization = system.linearize(residual, numbering)
        return cls.of(system, state, residual.forces, linearization, presliding)._replace(exact=True)

    @property
    def numbering(self) -> Numbering:
        """Of the unknowns."""
        return self.linearization.numbering

    @property
    def slips(self) -> Array:
        """Slips of the frictional holes [m], shape (k,)."""
        return self.numbering.at_frictional_holes([own.field.slip for own in self.forces])

    @property
    def mobilisation(self) -> Array:
        """Of the frictional holes [1], shape (k,)."""
        return mobilisations(self.numbering, self.state)

    @property
    def taut(self) -> NDArray[np.bool_]:
        """Which frictional holes belong to tendons under tension, shape (k,)."""
        tension = [np.broadcast_to(own.base_tension[:, None], own.field.slip.shape) for own in self.forces]
        return np.asarray(self.numbering.at_frictional_holes(tension) > 0.0)

    def displacement(self, change: Array) -> float:
        """Largest displacement of a node by a change of the mobilisations, shape (k,), at first order [m]."""
        step = self.response.columns @ change
        nodes = np.concatenate([step[p.nodes] for p in self.numbering.robots]).reshape(-1, 6)
        return float(np.linalg.norm(nodes[:, :3], axis=1).max())


def response_to_load(system: SceneSystem, at: Equilibrium, own: Target, other: Target) -> LoadResponse:
    """Response when inputs and loads change to another target, at fixed mobilisations and at first order.

    Parameters
    ----------
    system
        The scene; the loads of the other target are in it.
    at
        Where equilibrium is linearised.
    own
        Its target.
    other
        The other target.
    """
    numbering = at.numbering
    tension = tuple(
        np.where(r.by_displacement, old, new)
        for r, old, new in zip(system.robots, at.state.base_tension, other.inputs, strict=True)
    )
    residual = system.residual(at.state._replace(base_tension=tension), other, numbering)
    fixed = at.linearization.step(residual.unbalanced, residual.forces, other.inputs)
    slips = numbering.at_frictional_holes(slips_after(numbering, residual.forces, fixed)) - at.slips
    change = driven_values(numbering, other.inputs) - driven_values(numbering, own.inputs)
    return LoadResponse(slips, fixed, driven_values(numbering, own.inputs), change)


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
        friction, mobilisation, first = list(state.friction), list(state.mobilisation), 0
        for part in numbering.robots:
            if not part.has_friction:
                continue
            i, last = part.robot, first + int(np.count_nonzero(part.frictional))
            slip, turned, now = (
                friction[i].slip.copy(),
                friction[i].mobilisation.copy(),
                mobilisation[i].copy(),
            )
            slip[part.frictional] = self.slip[first:last]
            turned[part.frictional] = self.mobilisation[first:last]
            now[part.frictional] = self.at_end[first:last]
            friction[i], mobilisation[i] = replace(friction[i], slip=slip, mobilisation=turned), now
            first = last
        return state._replace(friction=tuple(friction), mobilisation=tuple(mobilisation))


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
    """

    effect: float
    error: float
    division: float
    uncertain: float = np.inf
    turning: History | None = None

    @property
    def total(self) -> float:
        """Largest displacement of a node where they are left out of account, over the length [1]."""
        return self.effect + self.error


class _Substep(NamedTuple):
    """Taut holes of a substep that was solved as a whole, and the tendons that become slack or taut in it.

    Attributes
    ----------
    start, end : SlipRates
        Derivatives of the slips at its ends.
    before, after : ndarray, shape (k,)
        Mobilisations there [1].
    slip : ndarray, shape (k + c,)
        Change of the slips, and minus that of the slack [m].
    tendons : ChangingTendons
    matrix : ndarray, shape (k, k)
        As in `SlipRates` at the end, with the tendons slack and taut as they are there.
    presliding : float
        Presliding distance [m].
    """

    start: SlipRates
    end: SlipRates
    before: Array
    after: Array
    slip: Array
    tendons: ChangingTendons
    matrix: Array
    presliding: float

    @classmethod
    def of(
        cls,
        start: Equilibrium,
        end: Equilibrium,
        by_load: tuple[LoadResponse, LoadResponse],
        holes: NDArray[np.int_],
        presliding: float,
    ) -> _Substep:
        """Pick these of the frictional holes."""
        numbering = end.numbering
        which = np.zeros(0, dtype=int)
        if numbering.any_driven:
            loose = [np.concatenate(at.linearization.slack) for at in (start, end)]
            which = np.flatnonzero(~(loose[0] & loose[1]))
        picked = np.append(holes, len(end.mobilisation) + np.arange(len(which)))

        def rates(at: Equilibrium, load: LoadResponse) -> SlipRates:
            found = rates_with_tensions(at.linearization, at.forces, at.response, load, which, presliding)
            return SlipRates(found.by_load[picked], found.matrix[picked[:, None], picked])

        before, after = start.mobilisation[holes], end.mobilisation[holes]
        slip = (end.slips - start.slips)[holes]
        tendons = _changing_tendons(start, end, by_load[0], which, holes)
        if which.size:
            slip = np.append(slip, -_slack_change(start, end, by_load[0])[which])
        matrix = end.response.matrix[holes[:, None], holes]
        first, last = rates(start, by_load[0]), rates(end, by_load[1])
        return cls(first, last, before, after, slip, tendons, matrix, presliding)

    def follow(self, bulge: Array | None = None) -> FollowedPath:
        """The friction states followed through it, see `tdcr_fe.solve.friction_path.follow`.

        Reversals that change a mobilisation by less than `SMALL` are left out.
        """
        path = follow(self.start, self.end, self.before, self.presliding, bulge, self.tendons)
        lost = path.turning_mobilisation - self.before - path.turning_slip / self.presliding
        slight = path.reversed & (np.abs(lost) < SMALL)
        if not slight.any():
            return path
        return path._replace(
            turning_slip=np.where(slight, 0.0, path.turning_slip),
            turning_mobilisation=np.where(slight, self.before, path.turning_mobilisation),
            turning_factor=np.where(slight, 0.0, path.turning_factor),
        )

    @property
    def hole_slip(self) -> Array:
        """Change of the slips [m], shape (k,)."""
        return self.slip[: len(self.before)]

    def corrected(self, trial: Array) -> Array:
        """Mobilisations at the end for other trial mobilisations there, at first order, shape (k,)."""
        right = self.presliding * (trial - self.after) + self.matrix @ self.after
        return solve_box(self.matrix, right, self.after)[0]

    def with_reversals(self, path: FollowedPath) -> Array:
        """Mobilisations at the end, counted from the last reversals, shape (k,)."""
        since = (self.hole_slip - path.turning_slip) / self.presliding
        return self.corrected(path.turning_mobilisation + since)

    def error(self, path: FollowedPath) -> Array:
        """By how much slips, and minus the slack, exceed the interpolated ones at the end [m], shape (k + c,).

        Both at the same mobilisations and tensions.
        """
        last = np.append(self.after, self.tendons.tension[1])
        stiffness = -self.end.matrix
        holes = np.arange(len(self.before))
        stiffness[holes, holes] += self.presliding
        return np.asarray(self.slip - path.slip + stiffness @ (path.mobilisation - last))

    def at_worst(self, path: FollowedPath, mobilisation: Array, error: Array) -> Array:
        """Mobilisations at the end if every hole that slips there has just reversed by an error, shape (k,)."""
        lost = np.abs(error) if path.complete else np.abs(self.hole_slip) + self.presliding
        side = np.trunc(mobilisation)
        return self.corrected(np.where(side != 0.0, side * (1.0 - lost / self.presliding), mobilisation))


def _slack_change(start: Equilibrium, end: Equilibrium, load: LoadResponse) -> Array:
    """Change of the slack of the tendons driven by displacement [m], shape (d,)."""
    first, last = (
        driven_values(at.numbering, [own.field.base_slip for own in at.forces]) for at in (start, end)
    )
    return last - first - load.displacement


def _changing_tendons(
    start: Equilibrium,
    end: Equilibrium,
    load: LoadResponse,
    which: NDArray[np.int_],
    holes: NDArray[np.int_],
) -> ChangingTendons:
    """Tendons that become slack or taut, by their numbers among those driven by displacement."""
    if not which.size:
        return ChangingTendons(
            np.full(len(holes), -1), np.zeros((2, 0)), np.zeros((2, len(holes))), np.zeros(0)
        )
    numbering = end.numbering
    owner = driven_owners(numbering)[holes]
    among = np.full(owner.shape, -1)
    for number, tendon in enumerate(which):
        among[owner == tendon] = number
    tension = np.array([driven_values(numbering, at.state.base_tension)[which] for at in (start, end)])
    at_start = driven_values(numbering, [own.field.base_slip for own in start.forces])
    slack = np.maximum((at_start - load.start)[which], 0.0)
    slack[tension[0] > 0.0] = 0.0
    return ChangingTendons(
        among, tension, np.array((start.mobilisation[holes], end.mobilisation[holes])), slack
    )


def find_reversals(
    start: Equilibrium,
    end: Equilibrium,
    by_load: tuple[LoadResponse, LoadResponse],
    presliding: float,
    length: float,
    allowed: float,
    *,
    locate: bool,
) -> Reversals | None:
    """Reversals of slips between two solved states.

    Parameters
    ----------
    start, end
        The states, linearised exactly; `end` is solved from `start` as a whole.
    by_load
        Responses of both to the change of the load from the first to the second.
    presliding
        Presliding distance [m].
    length
        Of the longest backbone [m].
    allowed
        Largest displacement of a node that they may cause, over the length [1].
    locate
        Whether they are located where they cause more than that; else only where to divide is found.

    Returns
    -------
    Reversals or None
        None where every slip is monotone, so that the substep is exact.
    """
    taut = start.taut | end.taut
    holes = np.flatnonzero(taut)
    if not holes.size:
        return None
    substep = _Substep.of(start, end, by_load, holes, presliding)
    path = substep.follow()
    plain = substep.with_reversals(path)
    bulge = substep.error(path)
    at_holes = np.abs(bulge[: holes.size])
    worst = float(at_holes.max())
    sure = worst <= SMALL * presliding or np.all(path.margin >= SAFETY * at_holes)
    if path.complete and sure and not path.reversed.any():
        return None

    def displacement(mobilisation: Array, other: Array) -> float:
        change = np.zeros(len(taut))
        change[holes] = mobilisation - other
        return end.displacement(change) / length

    scale = max(float(np.abs(substep.hole_slip).max()), presliding)
    if path.complete and worst <= ROUGH * scale:
        better = substep.follow(bulge)
        if better.complete:
            corrected = substep.with_reversals(better)
            effect, error = displacement(corrected, substep.after), displacement(corrected, plain)
            located = Reversals(effect, error, _division(better, corrected - substep.after))
            if located.total > allowed and not locate:
                return located
            beyond = substep.follow(OVERSHOOT * bulge)
            if beyond.complete:
                none = not (path.reversed.any() or better.reversed.any() or beyond.reversed.any())
                if none:
                    return None
                spread = displacement(corrected, substep.with_reversals(beyond))
                turning = _history(start, end, holes, better, corrected)
                error = max(error, spread)
                if locate:
                    uncertain = spread + CORRECTION_ERROR * effect
                    located = located._replace(uncertain=uncertain)
                    if _spread_out(better, corrected - substep.after):
                        located = located._replace(division=_part(allowed, uncertain))
                return located._replace(error=error, turning=turning)
    # Reversals are not located well enough; the error falls about with the square of the substep.
    division = min(0.5, max(NEAR, float(np.sqrt(ROUGH * scale / max(worst, ROUGH * scale)))))
    error = displacement(plain, substep.at_worst(path, plain, at_holes))
    return Reversals(displacement(plain, substep.after), error, division)


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


def _turning_factors(path: FollowedPath, change: Array) -> Array:
    """Where slips reverse, of reversals that change a mobilisation [1]."""
    return path.turning_factor[path.reversed & (np.abs(change) > SMALL)]


def _spread_out(path: FollowedPath, change: Array) -> bool:
    """Whether reversals are at so different places that a division at one of them does not help much."""
    factors = _turning_factors(path, change)
    return bool(factors.max(initial=0.0) - factors.min(initial=1.0) > TOGETHER)


def _division(path: FollowedPath, change: Array) -> float:
    """Where to divide the substep: at the first reversal that changes a mobilisation; else in the middle [1]."""
    first = float(_turning_factors(path, change).min(initial=1.0))
    return first if CLOSE < first < 1.0 - CLOSE else 0.5
