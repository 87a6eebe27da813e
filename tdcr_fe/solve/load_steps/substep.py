"""One substep of a load step: its Newton solve, the checks of it, and what is tried where it does not converge."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from tdcr_fe.elements import Array, Flags
from tdcr_fe.model.loading import SolverSettings
from tdcr_fe.solve.equations.configuration import SolverState, Target
from tdcr_fe.solve.equations.linearization import input_changes
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.load_steps.load_path import Ramp, SolvedPath, SolvedSubstep, StepFailed
from tdcr_fe.solve.newton.convergence import NewtonStatus
from tdcr_fe.solve.newton.newton import NewtonResult, newton
from tdcr_fe.solve.newton.prediction import predict
from tdcr_fe.solve.newton.steps import MOST_DAMPING
from tdcr_fe.solve.newton.unstable_motions import ROUND_OFF, freely_moving, unstable_motions

#: A jump of a node by more than this fraction of the length in a damped solve is a snap-through [1].
SNAP = 0.02
#: By so much of the length a state is pushed off an unstable equilibrium [1].
PUSH = 1e-3
#: Factors on the presliding distance that are tried where the smallest substep does not converge [1].
RESCUE_FACTORS = (1.0, 10.0)


#: Smallest part of a load step that is divided further for the sake of slip reversals [1].
SMALLEST_PART = 1e-4
#: What to try where a step fails, by the status of the last solve, where that alone says it.
ADVICE = {
    NewtonStatus.SINGULAR: "Fix or support what moves freely.",
    NewtonStatus.CONTACT_TOO_DEEP: "Give contact a larger stiffness, or the robot a smaller load.",
    NewtonStatus.CONTACT_PASSED: "No equilibrium in contact was found near the last one. Try smaller load steps.",
    NewtonStatus.UNSTABLE: (
        "A real robot slides off or buckles to one side, and no equilibrium was found there. Try smaller load steps."
    ),
    NewtonStatus.NO_CONTACT_STATE: "Try smaller load steps, or a smaller contact stiffness.",
}


def has_rates(system: SceneSystem) -> bool:
    """Whether coefficients of friction follow laws, which may depend on slip rates."""
    return any(robot.law.varies for robot in system.robots)


def _along(motion: Array, before: SolverState, after: SolverState) -> float:
    """Part of the displacement of all nodes from a state to another that is along a motion, in [-1, 1] [1]."""
    rotations = np.concatenate([r for _, r in after.configuration.poses])
    way = np.einsum("nij,nj->ni", rotations, motion.reshape(-1, 6)[:, :3])
    moved = after.configuration.positions - before.configuration.positions
    size = float(np.linalg.norm(way) * np.linalg.norm(moved))
    return float(np.sum(way * moved)) / size if size > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class SubstepSolver:
    """Solves substeps of one load step of a scene."""

    system: SceneSystem
    ramp: Ramp  # The load step
    settings: SolverSettings
    deadline: float = math.inf  # No further substep begins after it, see `Simulation.advance` [s]

    def solve(self, begin: SolvedPath, end: float, guess: SolverState | None = None) -> NewtonResult:
        """Solve a substep up to a load factor, from a guess; None is predicted, or where the substep begins."""
        system, settings, start, before = self.system, self.settings, begin.state, begin.linearization
        target = self.ramp.apply(system, end)
        changes, first = input_changes(start, target), None
        if guess is None and before is not None:
            first = predict(system, start, target, changes, before, settings)
        result = newton(system, guess or (first or begin).state, target, settings)
        if first is not None and not result.converged:
            spent, first = result.iterations, None
            result = newton(system, start, target, settings)
            result = result._replace(iterations=result.iterations + spent)
        # Where a prediction takes no iteration, the linearisation is that of the step before.
        linear = result.linearization if first is None else result.linearization or before
        if linear is not None and result.converged:
            slopes = (None, None) if first is None else (first.slope, first.slips)
            linear = linear.ended_by(np.concatenate(changes), start, result.state, *slopes)
            result = result._replace(linearization=linear)
        return self._unless_wrong(result, start)

    def _unless_wrong(
        self, result: NewtonResult, start: SolverState, *, may_jump: bool = False
    ) -> NewtonResult:
        """A solve, not converged where it is unstable, or contact is too deep or was perhaps jumped over in it.

        An unstable solution counts so where it lies aside of the path. In a symmetric scene the path itself
        goes on through unstable equilibria, and is followed: of the displacement a part of 1e-8 was seen along an
        unstable motion there, and of 6e-3 with a ball that is 10 um beside the plane in which a robot bends.

        ``may_jump``: where a robot snaps through, it may pass a contact.
        """
        if not result.converged:
            return result
        if not (self.system.has_contact or any(x.any() for x in self._buckled(result.state, False))):
            return result
        if self.system.contact_at(result.state).too_deep():
            return result._replace(status=NewtonStatus.CONTACT_TOO_DEEP, unmet=None)
        if not may_jump and self.system.may_jump_over_contact(start, result.state):
            return result._replace(status=NewtonStatus.CONTACT_PASSED, unmet=None)
        motions = self._unstable_motions(result)
        if any(abs(_along(motion, start, result.state)) > ROUND_OFF for motion in motions):
            return result._replace(status=NewtonStatus.UNSTABLE, unmet=None)
        return result._replace(unstable=len(motions) > 0)

    def _unstable_motions(self, result: NewtonResult) -> Array:
        """Increments of the nodes along which a solution is unstable, see `unstable_motions`."""
        residual = self.system.residual(result.state, result.target, self.system.numbering())
        return unstable_motions(self.system, residual)

    def may_be_halved(self, length: float, status: NewtonStatus) -> bool:
        """Whether a substep of this length that did not converge is divided."""
        least = self.settings.min_substep
        return length > (min(SMALLEST_PART, least) if status is NewtonStatus.CONTACT_PASSED else least)

    def is_smooth(self, load_factor: float) -> bool:
        """Whether nothing but a robot resists at a load factor, and inputs and loads are linear in the load step."""
        ramp = self.ramp
        return not (ramp.nonlinear or ramp.before_increment) and self.system.tangent_follows_from_elements(
            ramp.loads_at(load_factor)
        )

    @property
    def is_late(self) -> bool:
        """Whether there is no time for another solve."""
        return perf_counter() > self.deadline

    def distance(self, a: SolverState, b: SolverState) -> float:
        """Largest distance of any coordinate of a node between two states over the length [1]."""
        moved = a.configuration.positions - b.configuration.positions
        return float(np.max(np.abs(moved))) / self.system.length

    def _buckled(self, state: SolverState, by_displacement: bool) -> list[Flags]:
        """Which elements are beyond the buckling load of their bay, by robot.

        Of robots with tendons of prescribed displacement, which hold what they buckle, or of those driven by tensions
        alone, which do not grow with the compression.
        """
        robots = zip(self.system.robots, state.configuration.twists, self.system.layout.buckling, strict=True)
        wanted = [r for r in robots if r[0].drives.winds.any() == by_displacement]
        return [robot.mesh.lengths - twists[:, 0] > limit for robot, twists, limit in wanted]

    def passes_buckling(self, before: SolverState, after: SolverState) -> bool:
        """Whether a bay of a robot driven by displacement is beyond its buckling load after a substep, not before."""
        if not self.system.numbering().any_driven:
            return False
        both = zip(self._buckled(before, True), self._buckled(after, True), strict=True)
        return any(np.any(new & ~old) for old, new in both)

    def rescue(self, state: SolverState, start: float, end: float, failed: NewtonResult) -> SolvedPath:
        """For a smallest substep that does not converge: try snap-through, then a larger presliding distance."""
        # A damped motion would take what nothing holds along, or leave it where it is, and pass what is too soft.
        if failed.status is NewtonStatus.CONTACT_TOO_DEEP or self._free(state):
            raise self.failure(state, start, end, failed, failed.iterations)
        guess = state
        if failed.status is NewtonStatus.UNSTABLE:
            guess = self._pushed(state, failed)
        elif self.system.has_contact:
            # The path may have been unstable before: where it is symmetric, nothing else leads aside of it.
            own = failed._replace(state=state, target=self.ramp.apply(self.system, start))
            guess = self._pushed(state, own)
        target = self.ramp.apply(self.system, end)
        guess, spent = guess._replace(tangent_sign=self._stable_sign(guess, target)), 0
        for factor in RESCUE_FACTORS:
            if self.is_late:
                break
            result = newton(self.system, guess, target, self.settings, damped=True, softening=factor)
            result = self._unless_wrong(result, state, may_jump=True)
            if result.converged:
                path = SolvedPath.of(result, SolvedSubstep(end, result.state, state.friction, factor))
                snapped = self.distance(result.state, state) > SNAP
                return replace(path, rejected=spent, snapped=snapped)
            spent += result.iterations
        raise self.failure(state, start, end, failed, spent + failed.iterations)

    def _free(self, state: SolverState) -> list[str]:
        """Names of what moves freely, in scenes with other items than robots."""
        return [] if self.system.layout.no_others else freely_moving(self.system, state)

    def _stable_sign(self, state: SolverState, target: Target) -> int:
        """Sign of the tangent of stable states, that under a damping of any size; 0 where it is unknown."""
        numbering = self.system.numbering()
        if numbering.any_driven:
            return 0
        residual = self.system.residual(state, target, numbering)
        damping = MOST_DAMPING * self.system.layout.scales.elastic_force * self.system.length
        return self.system.linearize(residual, numbering, damping).factorisation.sign

    def _pushed(self, state: SolverState, unstable: NewtonResult) -> SolverState:
        """A state a little farther from an unstable solution, along the motion in which that is unstable."""
        motions, system, start = self._unstable_motions(unstable), self.system, state.configuration
        if not len(motions):
            return state
        along = np.array([_along(motion, state, unstable.state) for motion in motions])
        most = int(np.argmax(np.abs(along)))
        change = np.zeros(system.numbering().total)
        change[: motions.shape[1]] = -np.copysign(PUSH * system.length, along[most]) * motions[most]
        configuration, _ = system.layout.space.move(start, change, start.chains, self.settings.max_turn)
        return state._replace(configuration=configuration)

    def failure(
        self, state: SolverState, start: float, end: float, failed: NewtonResult, iterations: int
    ) -> StepFailed:
        """The error for a smallest substep that did not converge, with the state at its beginning."""
        moments = any(load[3:].any() for load in self.ramp.apply(self.system, end).loads)
        free = self._free(state)
        hint = f"Nothing holds {', '.join(free)}: fix or support what moves freely."
        # A scene with other items has loads of the user's own, which are not divided with the step.
        own = "" if self.system.layout.no_others else " Or raise your own loads in several calls."
        message = (
            f"{failed.reason(self.settings)}, between load factors {start:.4f} and {end:.4f} of the step, the smallest "
            f"substep allowed. {hint if free else advice(failed.status, moments, has_rates(self.system)) + own}"
        )
        return StepFailed(message, start, failed.residual, state, iterations)


def advice(status: NewtonStatus, moments: bool = False, rates: bool = False) -> str:
    """What to try where a step fails.

    Parameters
    ----------
    status
        Status of the last solve.
    moments, rates
        Whether there are concentrated moments, and coefficients of friction that may depend on slip rates.
    """
    if status in ADVICE:
        return ADVICE[status]
    larger = "presliding distance: presliding = 1e-5 in the [solver] table (SolverSettings in Python)."
    if status is NewtonStatus.NO_FRICTION_STATE and not moments:
        return f"Try smaller load steps, or a larger {larger}"
    if status is NewtonStatus.NOT_FINITE and rates:
        return (
            "Give the load step more time: a coefficient of friction that falls with the slip rate has no unique "
            "solution in a short step."
        )
    if moments:
        return (
            "Try smaller load steps. A concentrated moment is not conservative: beyond a critical size no equilibrium "
            "is stable, and the robot whirls instead of coming to rest."
        )
    return (
        "Try smaller load steps. If the load is near the point where the robot buckles or snaps through, no "
        f"equilibrium follows this path. Where holes change between stick and slip, take a larger {larger}"
    )
