"""Slip reversals within a solved substep: where they are, what they change, and how certain that is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.complementarity import solve_box
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.solve.friction_path import FollowedPath, SlipRates, follow
from tdcr_fe.solve.friction_step import FrictionResponse, friction_response, mobilisations, slips_after
from tdcr_fe.solve.linearization import Linearization
from tdcr_fe.solve.numbering import Numbering
from tdcr_fe.solve.state import SolverState, Target
from tdcr_fe.solve.system import SceneSystem

Array = NDArray[np.float64]

#: Slips below this fraction of the presliding distance, and mobilisations below it, are zero [1].
SMALL = 1e-2
#: Largest error of the interpolated slips, over the largest slip, with which reversals are located [1].
ROUGH = 0.1
#: Times the error of the interpolation with which the path is followed once more, for what is uncertain in it [1].
OVERSHOOT = 1.5
#: Factor on the uncertainty where a tendon becomes taut or slack within a substep, which bends the slips' rates [1].
KINK = 4.0
#: Slips are monotone where their rates are this many times larger than the rates of the error [1].
SAFETY = 2.0
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
        Whether it is linearised in this very state; else an iteration or two before.
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
        response = friction_response(
            linearization.numbering, forces, solve, system.layout.clamped, slack, presliding
        )
        return cls(state, forces, linearization, response)

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


def slips_by_load(system: SceneSystem, at: Equilibrium, other: Target) -> Array:
    """Change of the slips when inputs and loads change to another target, at fixed mobilisations.

    Parameters
    ----------
    system
        The scene; the loads of the other target are in it.
    at
        Where equilibrium is linearised.
    other
        The other target.

    Returns
    -------
    ndarray, shape (k,)
        At first order [m].
    """
    numbering = at.numbering
    tension = tuple(
        np.where(r.by_displacement, old, new)
        for r, old, new in zip(system.robots, at.state.base_tension, other.inputs, strict=True)
    )
    residual = system.residual(at.state._replace(base_tension=tension), other, numbering)
    fixed = at.linearization.step(residual.unbalanced, residual.forces, other.inputs)
    slips = slips_after(numbering, residual.forces, fixed)
    return numbering.at_frictional_holes(slips) - at.slips


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
    """

    effect: float
    error: float
    division: float

    @property
    def total(self) -> float:
        """Largest displacement of a node where they are left out of account, over the length [1]."""
        return self.effect + self.error


class _Substep(NamedTuple):
    """Taut holes of a substep that was solved as a whole.

    Attributes
    ----------
    start, end : SlipRates
        Derivatives of the slips at its ends.
    before, after : ndarray, shape (k,)
        Mobilisations there [1].
    slip : ndarray, shape (k,)
        Change of the slips [m].
    presliding : float
        Presliding distance [m].
    """

    start: SlipRates
    end: SlipRates
    before: Array
    after: Array
    slip: Array
    presliding: float

    @classmethod
    def of(
        cls,
        start: Equilibrium,
        end: Equilibrium,
        by_load: tuple[Array, Array],
        holes: NDArray[np.int_],
        presliding: float,
    ) -> _Substep:
        """Pick these of the frictional holes."""
        pairs = holes[:, None], holes
        first, last = (
            SlipRates(rate[holes], at.response.matrix[pairs])
            for rate, at in zip(by_load, (start, end), strict=True)
        )
        slip = (end.slips - start.slips)[holes]
        return cls(first, last, start.mobilisation[holes], end.mobilisation[holes], slip, presliding)

    def follow(self, bulge: Array | None = None) -> FollowedPath:
        """The friction states followed through it, see `tdcr_fe.solve.friction_path.follow`.

        Reversals that change a mobilisation by less than `SMALL` are left out.
        """
        path = follow(self.start, self.end, self.before, self.presliding, bulge)
        lost = path.turning_mobilisation - self.before - path.turning_slip / self.presliding
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
        right = self.presliding * (trial - self.after) + self.end.matrix @ self.after
        return solve_box(self.end.matrix, right, self.after)[0]

    def with_reversals(self, path: FollowedPath) -> Array:
        """Mobilisations at the end, counted from the last reversals, shape (k,)."""
        return self.corrected(path.turning_mobilisation + (self.slip - path.turning_slip) / self.presliding)

    def error(self, path: FollowedPath, mobilisation: Array) -> Array:
        """By how much the slips at the end exceed the interpolated ones at the same mobilisations [m], shape (k,)."""
        stiffness = self.presliding * np.eye(len(self.slip)) - self.end.matrix
        slip = self.slip + stiffness @ (mobilisation - self.after)
        return np.asarray(slip - path.slip - stiffness @ (mobilisation - path.mobilisation))

    def at_worst(self, path: FollowedPath, mobilisation: Array, error: Array) -> Array:
        """Mobilisations at the end if every hole that slips there has just reversed by an error, shape (k,)."""
        lost = np.abs(error) if path.complete else np.abs(self.slip) + self.presliding
        side = np.trunc(mobilisation)
        return self.corrected(np.where(side != 0.0, side * (1.0 - lost / self.presliding), mobilisation))


def find_reversals(
    start: Equilibrium,
    end: Equilibrium,
    by_load: tuple[Array, Array],
    presliding: float,
    length: float,
    allowed: float,
) -> Reversals | None:
    """Reversals of slips between two solved states.

    Parameters
    ----------
    start, end
        The states; `end` is solved from `start` as a whole.
    by_load
        Derivatives of the slips in both, by the load factor from one to the other, each of shape (k,) [m].
    presliding
        Presliding distance [m].
    length
        Of the longest backbone [m].
    allowed
        Largest displacement of a node that they may cause, over the length: beyond it their effect is not looked at
        more closely [1].

    Returns
    -------
    Reversals or None
        None where every slip is monotone, so that the substep is exact. Infinite where that is not certain, and the
        linearisations are not exact enough for more.
    """
    taut = start.taut | end.taut
    holes = np.flatnonzero(taut)
    if not holes.size:
        return None
    substep = _Substep.of(start, end, by_load, holes, presliding)
    path = substep.follow()
    plain = substep.with_reversals(path)
    bulge = substep.error(path, plain)
    worst = float(np.abs(bulge).max())
    sure = worst <= SMALL * presliding or np.all(path.margin >= SAFETY * np.abs(bulge))
    if path.complete and sure and not path.reversed.any():
        return None
    if not (start.exact and end.exact):
        return Reversals(np.inf, np.inf, 0.5)

    slack = zip(start.linearization.slack, end.linearization.slack, strict=True)
    kink = 1.0 if all(np.array_equal(*both) for both in slack) else KINK

    def displacement(mobilisation: Array, other: Array) -> float:
        change = np.zeros(len(taut))
        change[holes] = mobilisation - other
        return end.displacement(change) / length

    def found(mobilisation: Array, others: Sequence[Array], division: float) -> Reversals:
        error = kink * max(displacement(mobilisation, other) for other in others)
        return Reversals(displacement(mobilisation, substep.after), error, division)

    scale = max(float(np.abs(substep.slip).max()), presliding)
    if path.complete and worst <= ROUGH * scale:
        better = substep.follow(bulge)
        if better.complete:
            corrected = substep.with_reversals(better)
            located = found(corrected, (plain,), _division(better, corrected - substep.after))
            if located.total > allowed:
                return located
            beyond = substep.follow(OVERSHOOT * bulge)
            if beyond.complete:
                if not (path.reversed.any() or better.reversed.any() or beyond.reversed.any()):
                    return None
                return found(corrected, (plain, substep.with_reversals(beyond)), located.division)
    # Reversals are not located well enough; the error falls about with the square of the substep.
    division = min(0.5, max(NEAR, float(np.sqrt(ROUGH * scale / max(worst, ROUGH * scale)))))
    return found(plain, (substep.at_worst(path, plain, bulge),), division)


def _division(path: FollowedPath, change: Array) -> float:
    """Where to divide the substep: at the first reversal that changes a mobilisation; else in the middle [1]."""
    factors = path.turning_factor[path.reversed & (np.abs(change) > SMALL)]
    first = float(factors.min(initial=1.0))
    return first if CLOSE < first < 1.0 - CLOSE else 0.5
