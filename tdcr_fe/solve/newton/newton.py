"""Newton's method in strain space: the state in equilibrium with a target."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import ElementChain
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.model.settings import SolverSettings
from tdcr_fe.solve.equations.factors import BorderedFactors
from tdcr_fe.solve.equations.linearization import Linearization
from tdcr_fe.solve.equations.numbering import Numbering
from tdcr_fe.solve.equations.residual import Residual
from tdcr_fe.solve.equations.state import SolverState, Target
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.newton.convergence import Iterate, NewtonStatus, Unmet, first_unmet, stalled
from tdcr_fe.solve.newton.friction_step import (
    FrictionCoupling,
    all_keep_slipping,
    friction_step,
    mobilisations,
    slip_residual,
)

Array = NDArray[np.float64]

#: Contraction of a chord step: a step with the tangent of the iteration before leaves about this times the residual,
#: per turn of the elements since [1/rad]; a prediction that met the tolerance in all of 216 steps of three routings.
CHORD_CONTRACTION = 3.0
#: A residual below this fraction of the tolerance is not reduced further [1].
MARGIN = 0.05
#: The first step may use a linearisation from whose elements none has turned by more than this since [rad].
NEAR_TURN = 0.01
#: And only where the relative residual is below this: else the tangent changes more with the loads than with the state.
NEAR_RESIDUAL = 0.01
#: A damped step turns no section by more than this; below a fifth of it the damping is reduced [rad].
DAMPED_TURN = 0.5
#: How often contact that opens or closes is updated in one solve.
MOST_CONTACT_UPDATES = 20
#: Largest damping, over the elastic force times the length: nothing moves any more [1].
MOST_DAMPING = 1e9


class NewtonResult(NamedTuple):
    """Result of one Newton solve.

    Attributes
    ----------
    status : NewtonStatus
    state : SolverState
        If converged, the solution with its history committed; else the last iterate.
    residuals : tuple of float
        Relative residual before each iteration, and at the end [1].
    iterations : int
        Linear solves.
    unmet : Unmet or None
        The convergence test that the last iterate does not meet, where that is why it ended.
    forces : tuple of TendonForces
        By robot, in that state.
    linearization : Linearization or None
        The last one; None if the initial state was a solution.
    target : Target
        What was solved for.
    predicted_slips : ndarray, shape (k,), or None
        Change of the slips predicted by the first iteration, where it has every hole keep slipping [m].
    """

    status: NewtonStatus
    state: SolverState
    residuals: tuple[float, ...]
    iterations: int
    unmet: Unmet | None
    forces: tuple[TendonForces, ...]
    linearization: Linearization | None
    target: Target
    predicted_slips: Array | None = None

    @property
    def converged(self) -> bool:
        """Whether there is a solution."""
        return self.status.converged

    @property
    def residual(self) -> float:
        """Largest unbalanced force over its scale at the end [1]."""
        return self.residuals[-1]

    def reason(self, settings: SolverSettings) -> str:
        """In words, how the solve ended, with its residuals."""
        found = f"relative residual {self.residual:.1e}, tolerance {settings.tolerance:.0e}"
        if self.unmet is not None:
            return f"{self.status.value} after {self.iterations} iterations: {self.unmet.text}"
        return f"{self.status.value} ({found})"


class NewtonStep(NamedTuple):
    """Change of all unknowns, and where it comes from.

    Attributes
    ----------
    change : ndarray, shape (total,)
    linearization : Linearization
        The linearisation used.
    friction_kept : bool
        Whether every hole continues to slip in its direction, so that a chord step may follow.
    damping : float
        Damping used [N m].
    chords : int
        Chord steps that may still follow with the same linearisation.
    slips : ndarray, shape (k,), or None
        Slip residual after the step at fixed friction, where friction is kept [m].
    """

    change: Array
    linearization: Linearization
    friction_kept: bool
    damping: float = 0.0
    chords: int = 1
    slips: Array | None = None


def newton(
    system: SceneSystem,
    state: SolverState,
    target: Target,
    settings: SolverSettings,
    *,
    damped: bool = False,
    presliding: float | None = None,
    linearization: Linearization | None = None,
    friction_fixed: bool = False,
) -> NewtonResult:
    """Solve for equilibrium.

    Parameters
    ----------
    system
        The scene; it is left in the last iterate.
    state
        Initial state, and the history.
    target
        Inputs and time; loads are those already in the scene.
    settings
        Numerics.
    damped
        Follow the motion of a heavily damped robot instead of taking Newton steps: slower, but it finds the
        equilibrium that a robot reaches by snap-through (pseudo-transient continuation; C. T.
        Kelley, D. E. Keyes, SIAM J. Numer. Anal. 35 (1998) 508-523).
    presliding
        Presliding distance, replaces that of the settings [m].
    linearization
        Of a state near the initial one, as that of the last load step. Where it is near enough, the first step is taken
        with it, which saves a factorisation: from a solved state that step is a prediction in any case.
    friction_fixed
        Keep the mobilisations of the initial state, whatever their history.
    """
    presliding = settings.presliding if presliding is None else presliding
    trial = state._replace(
        base_tension=tuple(
            np.where(r.by_displacement, old, new)
            for r, old, new in zip(system.robots, state.base_tension, target.inputs, strict=True)
        ),
        prescribed=tuple(
            np.where(r.by_displacement, new, np.nan)
            for r, new in zip(system.robots, target.inputs, strict=True)
        ),
    )
    numbering = system.numbering(with_friction=not friction_fixed)
    residual = system.residual(trial, target, numbering)
    if not system.clamps_are_closed(residual):
        system.release_clamps()
        numbering = system.numbering(with_friction=not friction_fixed)
        residual = system.residual(trial, target, numbering)
    # Iterates far off may overflow; the residual is then not a number, which ends the solve by name.
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        near = None if damped else _usable(linearization, system, residual, numbering)
        result = _iterate(system, numbering, residual, settings, presliding, damped, near)
        if system.has_contact:
            return _with_contact(system, trial, result, numbering, settings, presliding, damped)
        return result


def _with_contact(
    system: SceneSystem,
    start: SolverState,
    result: NewtonResult,
    numbering: Numbering,
    settings: SolverSettings,
    presliding: float,
    damped: bool,
) -> NewtonResult:
    """Solve again where contact opens or closes in a solution, until it has the contact with which it was found."""
    for _ in range(MOST_CONTACT_UPDATES):
        if not result.converged:
            return result
        found = result.state
        again = start._replace(
            configuration=found.configuration,
            base_tension=found.base_tension,
            mobilisation=found.mobilisation,
        )
        residual = system.residual(again, result.target, numbering)
        if residual.size <= max(settings.tolerance, 2.0 * result.residual):
            return result
        later = _iterate(system, numbering, residual, settings, presliding, damped, None)
        result = later._replace(
            residuals=result.residuals + later.residuals,
            iterations=result.iterations + later.iterations,
            predicted_slips=None,
        )
    return result._replace(status=NewtonStatus.NO_CONTACT_STATE) if result.converged else result


def _usable(
    linearization: Linearization | None, system: SceneSystem, residual: Residual, numbering: Numbering
) -> Linearization | None:
    """A linearisation, if the first step from a state may be taken with it.

    What else is in a scene, such as contact, may change its stiffness without any turn of an element, so there must be
    nothing but robots.
    """
    if (
        linearization is None
        or not residual.size < NEAR_RESIDUAL
        or not numbering.same_unknowns(linearization.numbering)
        or not system.tangent_follows_from_elements()
        or linearization.turn_since(residual.state.configuration.twists) > NEAR_TURN
    ):
        return None
    return linearization


def _iterate(
    system: SceneSystem,
    numbering: Numbering,
    residual: Residual,
    settings: SolverSettings,
    presliding: float,
    damped: bool,
    near: Linearization | None,
) -> NewtonResult:
    """Newton's iteration from a first residual; ``near`` is the linearisation for its first step, if there is one."""
    limit = 10 * settings.max_iterations if damped else settings.max_iterations
    residuals: list[float] = []
    step: NewtonStep | None = None
    turn, predicted = 0.0, None
    damping = system.layout.scales.elastic_force * system.length if damped else 0.0

    def end(status: NewtonStatus, unmet: Unmet | None = None) -> NewtonResult:
        linear = None if step is None else step.linearization
        final = _committed(system, residual, numbering, linear) if status.converged else residual.state
        iterations = len(residuals) - 1
        forces = residual.forces
        return NewtonResult(
            status, final, tuple(residuals), iterations, unmet, forces, linear, residual.target, predicted
        )

    while True:
        residuals.append(residual.size)
        if not isfinite(residual.size):
            return end(NewtonStatus.NOT_FINITE)
        unmet = first_unmet(_iterate_of(system, residual, numbering, step, presliding), settings)
        chord_allowed = step is not None and step.chords > 0 and step.friction_kept and not damped
        # A chord step costs little: it is also taken where the tolerance is only just met.
        if unmet is None and not (chord_allowed and residual.size > MARGIN * settings.tolerance):
            return end(NewtonStatus.CONVERGED)
        if len(residuals) > limit:
            return end(NewtonStatus.CONVERGED if unmet is None else unmet.status, unmet)
        # Where little is left to do, the tangent at hand does it; should it not, the next step has its own.
        left = CHORD_CONTRACTION * turn * residual.size
        chord = chord_allowed and left < MARGIN * settings.tolerance
        try:
            if step is not None and (chord or unmet is None):
                step = _chord_step(step, numbering, residual)
            elif damped:
                step = _damped_step(system, residual, numbering, presliding, damping)
                damping = step.damping
            elif near is not None and step is None:
                # Its chord steps contract less, so two may follow.
                step = _step_with(near, system, residual, numbering, presliding)._replace(chords=2)
            else:
                step = _full_step(system, residual, numbering, presliding)
        except np.linalg.LinAlgError:
            return end(NewtonStatus.SINGULAR)
        if len(residuals) == 1:
            predicted = step.slips
        before = residual.size
        trial, turn = _advance(system, residual.state, step, numbering, settings.max_turn)
        # Newton's steps are taken with the contact of their start, a damped motion opens and closes it on its way.
        residual = system.residual(trial, residual.target, numbering, len(residuals), hold_contact=not damped)
        iterate = _iterate_of(system, residual, numbering, step, presliding)
        last = stalled(before, residual.size, step.change, system.layout.scales, settings)
        if last and first_unmet(iterate, settings, balance=False) is None:
            residuals.append(residual.size)
            return end(NewtonStatus.STALLED)


def _iterate_of(
    system: SceneSystem,
    residual: Residual,
    numbering: Numbering,
    step: NewtonStep | None,
    presliding: float,
) -> Iterate:
    """What the convergence tests see after a step; None at the start."""
    state = residual.state
    return Iterate(
        residual.size,
        None if step is None else step.change,
        system.layout.scales,
        residual.forces,
        state.mobilisation,
        state.friction,
        presliding,
        numbering.has_friction,
    )


def _full_step(
    system: SceneSystem,
    residual: Residual,
    numbering: Numbering,
    presliding: float,
    damping: float = 0.0,
) -> NewtonStep:
    """A step with a new tangent: at fixed friction where every hole keeps slipping, else a complementarity step."""
    linear = system.linearize(residual, numbering, damping)
    return _step_with(linear, system, residual, numbering, presliding, damping)


def _step_with(
    linear: Linearization,
    system: SceneSystem,
    residual: Residual,
    numbering: Numbering,
    presliding: float,
    damping: float = 0.0,
) -> NewtonStep:
    """A step with a given linearisation, of this or a near state."""
    linear, fixed = linear.complementarity_step(residual.unbalanced, residual.forces, residual.target.inputs)
    if not numbering.has_friction:
        return NewtonStep(fixed, linear, True, damping)
    state, forces = residual.state, residual.forces
    mobilised = mobilisations(numbering, state)
    slips = slip_residual(numbering, forces, state, fixed, presliding)
    if all_keep_slipping(mobilised, slips):
        return NewtonStep(_padded(fixed, numbering), linear, True, damping, slips=slips)
    coupling = FrictionCoupling.of(numbering, forces, system.layout.clamped, linear.slack)
    change = friction_step(coupling, linear.factorisation.solve, fixed, slips, mobilised, presliding)
    return NewtonStep(change, linear, False, damping)


def _chord_step(before: NewtonStep, numbering: Numbering, residual: Residual) -> NewtonStep:
    """Chord step: with the tangent and frames of the previous iteration, at fixed friction."""
    change = before.linearization.step(residual.unbalanced, residual.forces, residual.target.inputs)
    return before._replace(change=_padded(change, numbering), chords=before.chords - 1)


def _damped_step(
    system: SceneSystem,
    residual: Residual,
    numbering: Numbering,
    presliding: float,
    damping: float,
) -> NewtonStep:
    """A step of the damped motion, limited in rotation, never towards a saddle point, nor over a contact.

    The damping it returns is that for the next step.
    """
    nodes = 6 * system.layout.reduction.nodes
    scale = system.layout.scales.elastic_force * system.length
    least, most = 1e-6 * scale, MOST_DAMPING * scale
    limit = system.contact_motion_limit(residual.state)
    for _ in range(20):
        step = _full_step(system, residual, numbering, presliding, damping)
        change = step.change[:nodes].reshape(-1, 6)
        turn = float(np.max(np.abs(change[:, 3:])))
        moved = float(np.max(np.linalg.norm(change[:, :3], axis=1)))
        climbs = _climbs(system, step.linearization, residual.state)
        if (turn <= DAMPED_TURN and moved <= limit and not climbs) or damping >= most:
            break
        damping = min(max(4.0 * damping, least), most)
    return step._replace(damping=0.2 * damping if turn < 0.2 * DAMPED_TURN else damping)


def _climbs(system: SceneSystem, linear: Linearization, state: SolverState) -> bool:
    """Whether a damped step goes towards a saddle point, so that its damping is too small.

    A robot with driven tendons may be held by them although it is unstable at fixed tensions; then both parts of the
    sign are negative. With other items in the scene the sign of a stable state is not known.
    """
    factors = linear.factorisation
    if isinstance(factors, BorderedFactors):
        return system.layout.reduction.other.size == 0 and factors.sign < 0
    return factors.sign * state.tangent_sign < 0


def _padded(fixed: Array, numbering: Numbering) -> Array:
    """A step at fixed friction as one of all unknowns."""
    step = np.zeros(numbering.total)
    step[: numbering.linear] = fixed
    return step


def _advance(
    system: SceneSystem, state: SolverState, step: NewtonStep, numbering: Numbering, max_turn: float
) -> tuple[SolverState, float]:
    """The state after a step, no element turning more than allowed; and the turn of the whole step [rad]."""
    chains: tuple[ElementChain, ...] = step.linearization.chains
    change = step.change
    move = system.layout.space.move(state.configuration, change, chains, max_turn)
    tension, mobilisation = state.base_tension, state.mobilisation
    for part in numbering.robots:
        i = part.robot
        if part.driven.size:
            new = tension[i].copy()
            pulled = np.maximum(new[part.driven] + move.fraction * change[part.tensions], 0.0)
            if move.fraction == 1.0:
                # Exactly: round-off in the tension of a slack tendon would count as a miss of its displacement.
                pulled[step.linearization.slack[i]] = 0.0
            new[part.driven] = pulled
            tension = (*tension[:i], new, *tension[i + 1 :])
        slipped = change[part.mobilisations]
        if slipped.any():
            new = mobilisation[i].copy()
            new[part.frictional] = np.clip(new[part.frictional] + move.fraction * slipped, -1.0, 1.0)
            mobilisation = (*mobilisation[:i], new, *mobilisation[i + 1 :])
    moved = SolverState(
        move.configuration,
        tension,
        mobilisation,
        state.friction,
        state.prescribed,
        state.loads,
        state.time,
        state.tangent_sign,
    )
    return moved, move.turn


def _committed(
    system: SceneSystem, residual: Residual, numbering: Numbering, linear: Linearization | None
) -> SolverState:
    """A solution with its history committed and the reactions of its clamps recovered."""
    state, sign = residual.state, residual.state.tangent_sign
    # With prescribed displacements the sign also changes where a tendon goes slack, so it is not used.
    if linear is not None and not numbering.any_driven:
        sign = linear.factorisation.sign
    return SolverState(
        system.with_base_reactions(residual),
        state.base_tension,
        state.mobilisation,
        tuple(own.model.law.commit(own.field) for own in residual.forces),
        state.prescribed,
        residual.target.loads,
        residual.target.time,
        sign,
    )
