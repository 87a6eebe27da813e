"""Newton's method in strain space: the state in equilibrium with a target."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.model.loading import SolverSettings
from tdcr_fe.solve.equations.configuration import SolverState, Target
from tdcr_fe.solve.equations.kernel import Residual
from tdcr_fe.solve.equations.linearization import Linearization
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.newton.convergence import BALANCED, NewtonStatus, Unmet, first_unmet
from tdcr_fe.solve.newton.steps import NewtonProblem, NewtonStep, advanced, damped_step, full_step


class NewtonResult(NamedTuple):
    """Result of one Newton solve."""

    status: NewtonStatus
    state: SolverState  # If converged, the solution with its history committed; else the last iterate
    residual: float  # Largest unbalanced force over its scale at the end [1]
    iterations: int  # Linear solves
    unmet: Unmet | None  # The condition that is not met, where that is why it ended
    forces: tuple[TendonForces, ...]  # By robot, in that state
    linearization: Linearization | None  # The last one; None if the initial state was a solution
    target: Target  # What was solved for
    unstable: bool = False  # Whether the solution is known to be unstable

    @property
    def converged(self) -> bool:
        """Whether there is a solution."""
        return self.status is NewtonStatus.CONVERGED

    def reason(self, settings: SolverSettings) -> str:
        """In words, how the solve ended, with its residuals."""
        if self.unmet is not None:
            return f"{self.status.value} after {self.iterations} iterations: {self.unmet.text}"
        balance = f"relative residual {self.residual:.1e}, tolerance {settings.tolerance:.0e}"
        return f"{self.status.value} ({balance})"


def newton(
    system: SceneSystem,
    state: SolverState,
    target: Target,
    settings: SolverSettings,
    *,
    damped: bool = False,
    softening: float = 1.0,
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
    softening
        Factor on the presliding distance [1].
    friction_fixed
        Keep the mobilisations of the initial state, whatever their history.
    """
    numbering, trial = system.numbering(not friction_fixed), under_inputs(system, state, target)
    residual = system.residual(trial, target, numbering)
    if not system.clamps_are_closed(residual.raw):
        system.release_clamps()
        numbering = system.numbering(not friction_fixed)
        residual = system.residual(trial, target, numbering)
    problem = NewtonProblem(system, numbering, settings, softening, damped)
    # Iterates far off may overflow; the residual is then not a number, which ends the solve by name.
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        result = _iterate(problem, residual)
        return _with_contact(problem, trial, result) if system.has_contact else result


def under_inputs(system: SceneSystem, state: SolverState, target: Target) -> SolverState:
    """A state with the tensions and the prescribed displacements of a target."""
    tensions, prescribed = [], []
    for robot, old, new in zip(system.robots, state.base_tension, target.inputs, strict=True):
        tensions.append(np.where(robot.drives.winds, old, new))
        prescribed.append(np.where(robot.drives.winds, new, np.nan))
    return state._replace(base_tension=tuple(tensions), prescribed=tuple(prescribed))


def with_unknowns_of(state: SolverState, start: SolverState) -> SolverState:
    """The unknowns of a state, as a guess in a step that begins in another one."""
    return start._replace(
        configuration=state.configuration, base_tension=state.base_tension, mobilisation=state.mobilisation
    )


def _with_contact(problem: NewtonProblem, start: SolverState, result: NewtonResult) -> NewtonResult:
    """Solve again where contact opens or closes in a solution, until it has the contact with which it was found."""
    system, settings = problem.system, problem.settings
    for _ in range(settings.max_iterations):
        if not result.converged:
            return result
        again = with_unknowns_of(result.state, start)
        residual = system.residual(again, result.target, problem.numbering)
        if residual.size <= max(settings.tolerance, 2.0 * result.residual):
            return result
        later = _iterate(problem, residual)
        result = later._replace(iterations=result.iterations + later.iterations)
    return result._replace(status=NewtonStatus.NO_CONTACT_STATE) if result.converged else result


def _iterate(problem: NewtonProblem, residual: Residual) -> NewtonResult:
    """Newton's iteration from a first residual."""
    system, numbering, settings, softening, damped = problem
    limit = 10 * settings.max_iterations if damped else settings.max_iterations
    iterations = 0
    step: NewtonStep | None = None
    damping = system.layout.scales.elastic_force * system.length if damped else None

    def end(status: NewtonStatus, unmet: Unmet | None = None) -> NewtonResult:
        linear = None if step is None else step.linearization
        solved = status is NewtonStatus.CONVERGED
        final = _committed(problem, residual, linear) if solved else residual.state
        found = status, final, residual.size, iterations, unmet, residual.forces
        return NewtonResult(*found, linear, residual.target)

    def first(balance: bool = True) -> Unmet | None:
        return first_unmet(residual, softening, not numbering.has_friction, settings, balance)

    while True:
        if not isfinite(residual.size):
            return end(NewtonStatus.NOT_FINITE)
        unmet = first()
        if unmet is None:
            return end(NewtonStatus.CONVERGED)
        if iterations >= limit:
            return end(unmet.status, unmet)
        try:
            if damping is None:
                step = full_step(problem, residual)
            else:
                step, damping = damped_step(problem, residual, damping)
        except np.linalg.LinAlgError:
            return end(NewtonStatus.SINGULAR)
        before, iterations = residual.size, iterations + 1
        trial = advanced(problem, residual.state, step)
        # Newton's steps are taken with the contact of their start, a damped motion opens and closes it on its way.
        residual = system.residual(trial, residual.target, numbering, iterations, hold_contact=not damped)
        # Newton's steps may be so small that the rest of the residual is round-off of very stiff parts.
        stalled = not damped and max(before, residual.size) < BALANCED
        stalled = stalled and system.layout.scales.step_size(step.change) <= settings.step_tolerance
        if stalled and first(balance=False) is None:
            return end(NewtonStatus.CONVERGED)


def _committed(problem: NewtonProblem, residual: Residual, linear: Linearization | None) -> SolverState:
    """A solution with its history committed and the reactions of its clamps recovered."""
    state, sign = residual.state, residual.state.tangent_sign
    # With prescribed displacements the sign also changes where a tendon goes slack, so it is not used.
    if linear is not None and not problem.numbering.any_driven:
        sign = linear.factorisation.sign
    by_robot = zip(residual.forces, state.friction, strict=True)
    return state._replace(
        configuration=problem.system.reactions.balance(residual),
        friction=tuple([own.model.law.commit(own.field, before) for own, before in by_robot]),
        loads=residual.target.loads,
        time=residual.target.time,
        tangent_sign=sign,
    )
