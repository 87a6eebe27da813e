"""Newton's method in strain space: the state in equilibrium with a target."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.model.loading import SolverSettings
from tdcr_fe.solve.equations.configuration import SolverState, Target
from tdcr_fe.solve.equations.kernel import Residual
from tdcr_fe.solve.equations.layout import Numbering
from tdcr_fe.solve.equations.linearization import Linearization
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.newton.convergence import Iterate, NewtonStatus, Unmet, first_unmet, stalled
from tdcr_fe.solve.newton.steps import (
    NewtonStep,
    advanced,
    chord_step,
    damped_step,
    full_step,
    step_with,
)

Array = NDArray[np.float64]

#: Contraction of a chord step: a step with the tangent of the iteration before leaves about this times the residual,
#: per turn of the elements since [1/rad]; a prediction that met the tolerance in all of 216 steps of three routings.
CHORD_CONTRACTION = 3.0
#: A residual below this fraction of the tolerance is not reduced further [1]. With four times as much, twenty random
#: robots took 3 % fewer iterations; with a quarter, 10 % more; their errors were the same.
MARGIN = 0.05
#: The first step may use a linearisation from whose elements none has turned by more than this since [rad].
NEAR_TURN = 0.01
#: And only where the relative residual is below this: else the tangent changes more with the loads than with the state.
NEAR_RESIDUAL = 0.01
#: How often contact that opens or closes is updated in one solve.
MOST_CONTACT_UPDATES = 20
#: Iterations after which a solve with triangles is given up where the residual is not below the first one: a sphere is
#: then too far inside, as where an equilibrium without contact was found first, and goes from triangle to triangle.
CONTACT_TRIALS = 5


class NewtonResult(NamedTuple):
    """Result of one Newton solve."""

    status: NewtonStatus
    state: SolverState  # If converged, the solution with its history committed; else the last iterate
    residuals: tuple[float, ...]  # Relative residual before each iteration, and at the end [1]
    iterations: int  # Linear solves
    unmet: (
        Unmet | None
    )  # The convergence test that the last iterate does not meet, where that is why it ended
    forces: tuple[TendonForces, ...]  # By robot, in that state
    linearization: Linearization | None  # The last one; None if the initial state was a solution
    target: Target  # What was solved for
    # (k,): Change of the slips predicted by the first iteration, where it has every hole keep slipping [m]
    predicted_slips: Array | None = None
    unstable: bool = False  # Whether the solution is known to be unstable

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
    trial = under_inputs(system, state, target)
    numbering = system.numbering(with_friction=not friction_fixed)
    residual = system.residual(trial, target, numbering)
    if not system.clamps_are_closed(residual):
        system.release_clamps()
        numbering = system.numbering(with_friction=not friction_fixed)
        residual = system.residual(trial, target, numbering)
    # Iterates far off may overflow; the residual is then not a number, which ends the solve by name.
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        near = None if damped else _if_usable(linearization, system, residual, numbering)
        result = _iterate(system, numbering, residual, settings, presliding, damped, near)
        if system.has_contact:
            return _with_contact(system, trial, result, numbering, settings, presliding, damped)
        return result


def under_inputs(system: SceneSystem, state: SolverState, target: Target) -> SolverState:
    """A state with the tensions and the prescribed displacements of a target."""
    return state._replace(
        base_tension=tuple(
            np.where(r.by_displacement, old, new)
            for r, old, new in zip(system.robots, state.base_tension, target.inputs, strict=True)
        ),
        prescribed=tuple(
            np.where(r.by_displacement, new, np.nan)
            for r, new in zip(system.robots, target.inputs, strict=True)
        ),
    )


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


def _if_usable(
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
    damping = system.layout.scales.elastic_force * system.length if damped else None

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
        if len(residuals) > limit or (not damped and _lost_among_triangles(system, residuals)):
            return end(NewtonStatus.CONVERGED if unmet is None else unmet.status, unmet)
        # Expected after a chord step; if it does not suffice, the next step has its own tangent.
        left = CHORD_CONTRACTION * turn * residual.size
        chord = chord_allowed and (unmet is None or left < MARGIN * settings.tolerance)
        try:
            step = _next_step(system, residual, numbering, presliding, step, chord, damping, near)
        except np.linalg.LinAlgError:
            return end(NewtonStatus.SINGULAR)
        if damped:
            damping = step.damping
        if len(residuals) == 1:
            predicted = step.slips
        before = residual.size
        trial, turn = advanced(system, residual.state, step, numbering, settings.max_turn)
        # Newton's steps are taken with the contact of their start, a damped motion opens and closes it on its way.
        residual = system.residual(trial, residual.target, numbering, len(residuals), hold_contact=not damped)
        iterate = _iterate_of(system, residual, numbering, step, presliding)
        last = stalled(before, residual.size, step.change, system.layout.scales, settings)
        if last and first_unmet(iterate, settings, balance=False) is None:
            residuals.append(residual.size)
            return end(NewtonStatus.STALLED)


def _lost_among_triangles(system: SceneSystem, residuals: list[float]) -> bool:
    """Whether the iterations have not come nearer to a solution in contact with triangles."""
    return system.has_triangles and len(residuals) > CONTACT_TRIALS and residuals[-1] >= residuals[0]


def _next_step(
    system: SceneSystem,
    residual: Residual,
    numbering: Numbering,
    presliding: float,
    last: NewtonStep | None,
    chord: bool,
    damping: float | None,
    near: Linearization | None,
) -> NewtonStep:
    """The next step of an iteration."""
    if chord and last is not None:
        return chord_step(last, numbering, residual)
    if damping is not None:
        return damped_step(system, residual, numbering, presliding, damping)
    if near is not None and last is None:
        # Its chord steps contract less, so two may follow.
        return step_with(near, system, residual, numbering, presliding)._replace(chords=2)
    return full_step(system, residual, numbering, presliding)


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
