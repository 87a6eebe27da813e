"""Substeps of a load step, chosen by convergence and by the path dependence of friction.

With friction the solution depends on the path, but only through slips that reverse: a substep in which every slip is
monotone is exact, however many holes change between stick and slip in it. So the rest of a load step is solved as a
whole, and slip reversals within it are located. It is divided where that fails. Documentation: page "Theory", section
"Loading path and substeps".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.equations.linearization import Linearization
from tdcr_fe.solve.friction_path.response import Equilibrium, TautTendons
from tdcr_fe.solve.friction_path.reversals import InterpolationPoint
from tdcr_fe.solve.load_steps.load_path import (
    Increment,
    Position,
    SolvedPath,
    StepFailed,
    StepProgress,
    one_substep,
)
from tdcr_fe.solve.load_steps.substep import SMALLEST_PART, SubstepSolver, has_rates
from tdcr_fe.solve.load_steps.substep_reversals import Attempt, SubstepReversals, twist_change, twists
from tdcr_fe.solve.newton.newton import NewtonResult, with_unknowns_of

Array = NDArray[np.float64]

#: Largest rotation of an element that the mean of both slopes leaves unexplained, over the largest rotation [1].
UNEXPLAINED = 0.1
#: Parts of a load step to begin with where functions of the user set inputs or loads.
NONLINEAR_PARTS = 8
#: A path is refined no further where so many of its smallest substeps converge only by a rescue.
MOST_RESCUED = 16


def is_continuous(
    solver: SubstepSolver, before: SolverState, start: float, after: SolverState, end: float
) -> bool:
    """Whether the change of all elements in a substep is that by the slopes at its ends, on average.

    On one branch of equilibria the configuration is a smooth function of the tensions of all segments and of the loads,
    whatever friction did on the way. After a jump, the slopes would agree with its size by chance only.

    Parameters
    ----------
    solver
        Of the load step.
    before, after
        Solved states at the ends of the substep.
    start, end
        Their load factors [1].
    """
    ramp, system = solver.ramp, solver.system
    if ramp.nonlinear or ramp.before_increment is not None or not system.tangent_follows_from_elements():
        return False
    first = Equilibrium.at(system, before, ramp.apply(system, start))
    last = Equilibrium.at(system, after, ramp.apply(system, end))
    taut = TautTendons.of((first, last))
    if not (first.balanced and taut.tendons):
        return False
    first, last = (point.with_response(system.layout.clamped, taut.numbers) for point in (first, last))
    from_end = last.load_response(system, ramp.apply(system, start)).times(-1.0)
    from_start = first.load_response(system, ramp.apply(system, end))
    tension = taut.tensions(last) - taut.tensions(first)
    slopes = [
        twist_change(point, tension, 1.0)
        for point in (InterpolationPoint(0.0, first, from_start), InterpolationPoint(1.0, last, from_end))
    ]
    change = twists(last) - twists(first)
    return _rotation(change - 0.5 * (slopes[0] + slopes[1])) <= UNEXPLAINED * _rotation(change)


def _rotation(change: Array) -> float:
    """Largest rotation of an element [rad]."""
    return float(np.abs(change.reshape(-1, 6)[:, 3:]).max())


def equal_parts(count: int) -> list[float]:
    """Load factors at the ends of so many equal parts of a load step [1]."""
    return [(k + 1) / count for k in range(count)]


class _Goal(NamedTuple):
    """End of a part of a load step that is still to be solved."""

    load_factor: float  # [1]
    warm_start: SolverState | None = None  # A state there that is near the one looked for
    linearization: Linearization | None = None  # In that state, where known


@dataclass(frozen=True, eq=False)
class LoadStepper:
    """Takes a scene through a load step, in substeps."""

    solver: SubstepSolver  # Solves the substeps
    begin: Position  # Where the load step begins
    # Whether substeps always end where slips reverse, so that each has the history of the one before, as
    # derivatives along the path need it. Else a substep may be solved with the reversals located in it.
    divide: bool = False
    # A state that is near the end of the load step, from which its solution begins
    warm_start: SolverState | None = None

    def solve(
        self, substeps: int | None = None, reference_path: Sequence[Increment] | None = None
    ) -> SolvedPath:
        """Take the scene through the load step and leave it in the state reached; all load steps are solved so.

        Parameters
        ----------
        substeps
            A fixed number (each is still halved where it does not converge); None divides it where slips
            reverse.
        reference_path
            Increments of a similar run: the same substeps are taken, each from the state of that run. For
            sensitivities by finite differences: the path is then divided in the same way, so that differences are
            smooth, and two iterations a substep are enough.

        Raises
        ------
        StepFailed
            The scene is then in the last state that converged. Where anything else interrupts, it is back at the
            beginning of the step.
        """
        system, ramp = self.solver.system, self.solver.ramp
        try:
            if reference_path is not None:
                path = self._along_reference(reference_path)
            elif substeps is not None:
                path = self._through(self._begun(), equal_parts(substeps), resolve=False)
            else:
                path = self._with_path_resolved()
        except BaseException as stop:
            failed = stop if isinstance(stop, StepFailed) else None
            ramp.apply(system, 0.0 if failed is None else failed.load_factor)
            system.store(self.begin.state if failed is None else failed.state)
            ramp.set_end()
            raise
        system.store(path.state, path.forces)
        return path

    def _begun(self, rescues: float = math.inf) -> StepProgress:
        """The beginning of the load step; so many smallest substeps may be solved by a rescue."""
        path = SolvedPath(self.begin.state, linearization=self.begin.linearization)
        return StepProgress(path, equilibrium=self.begin.end, rescues_left=rescues)

    def _along_reference(self, reference: Sequence[Increment]) -> SolvedPath:
        """The substeps of a reference path, each started from its solution; if one fails, it is solved without."""
        progress = self._begun()
        for point in reference:
            guess = self.solver.system.warm_start(progress.path.state, point.state)
            goals = [_Goal(point.load_factor, guess, progress.path.linearization)]
            while goals:
                progress = self._advanced(progress, goals, None)
        return progress.path

    def _with_path_resolved(self) -> SolvedPath:
        """The load step with its path dependence resolved.

        Slip reversals are resolved in every solution. Where coefficients of friction depend on slip rates, or where a
        jump is suspected, the step is also solved in twice as many parts, again and again, until one solution agrees
        with the one before; with slip rates two in succession.
        """
        count = NONLINEAR_PARTS if self.solver.ramp.nonlinear else 1
        path = self._through(self._begun(), equal_parts(count), self.warm_start if count == 1 else None)
        needed = 2 if self._depends_on_rates(self.begin.state, path.state) else 0
        if not needed:
            spent, confirmed = self._jumps_examined(path)
            path, needed = replace(path, rejected=path.rejected + spent), 0 if confirmed else 1
        agreed, error = 0, 0.0
        while agreed < needed and 2 * count <= self.solver.settings.max_substeps:
            count *= 2
            try:
                finer = self._through(self._begun(MOST_RESCUED), equal_parts(count))
            except StepFailed as failure:
                # The coarser path is kept, with its refinement error.
                error = max(error, 2.0 * self.solver.settings.path_tolerance)
                path = replace(path, rejected=path.rejected + failure.iterations)
                self.solver.ramp.apply(self.solver.system, 1.0)
                break
            error = self.solver.distance(finer.state, path.state)
            agreed = agreed + 1 if error <= 2.0 * self.solver.settings.path_tolerance else 0
            path = replace(finer, rejected=finer.rejected + path.iterations + path.rejected)
        return path if agreed >= needed else replace(path, refinement_error=max(path.refinement_error, error))

    def _jumps_examined(self, path: SolvedPath) -> tuple[int, bool]:
        """Solve substeps that may have jumped to another branch again, in halves, unless their slopes exclude it."""
        spent, start, before, confirmed = 0, 0.0, self.begin.state, True
        for end, after in path.increments:
            if self._jump_possible(before, start, after, end):
                try:
                    progress = StepProgress(SolvedPath(before), start)
                    halves = self._through(progress, (0.5 * (start + end), end))
                    spent += halves.iterations + halves.rejected
                    away = self.solver.distance(halves.state, after)
                    confirmed = away <= 2.0 * self.solver.settings.path_tolerance
                except StepFailed as failure:
                    spent, confirmed = spent + failure.iterations, False
                if not confirmed:
                    break
            start, before = end, after
        self.solver.ramp.apply(self.solver.system, 1.0)
        return spent, confirmed

    def _jump_possible(self, before: SolverState, start: float, after: SolverState, end: float) -> bool:
        """Whether a substep may have jumped: its rotations are large, and neither sign nor slopes exclude it."""
        if not self.solver.jump_suspected(before, after):
            return False
        unstable = before.tangent_sign * after.tangent_sign < 0
        return unstable or not is_continuous(self.solver, before, start, after, end)

    def _through(
        self,
        progress: StepProgress,
        ends: Sequence[float],
        warm_start: SolverState | None = None,
        *,
        resolve: bool = True,
    ) -> SolvedPath:
        """From a state on, in parts with these ends, each divided further where that is needed.

        A state near the last one may be known. Without ``resolve`` reversals within the parts are left out of account.
        """
        reversals = SubstepReversals(self.solver, self.divide) if resolve else None
        goals = [_Goal(end) for end in reversed(ends)]
        goals[0] = _Goal(ends[-1], warm_start)
        while goals:
            progress = self._advanced(progress, goals, reversals)
        if progress.equilibrium is not None:
            # The search for reversals looked at other loads.
            self.solver.ramp.apply(self.solver.system, 1.0)
        error = progress.error if progress.error > self.solver.settings.path_tolerance else 0.0
        if error == 0.0 and progress.equilibrium is None:
            return progress.path
        return replace(progress.path, refinement_error=error, end=progress.equilibrium)

    def _advanced(
        self, progress: StepProgress, goals: list[_Goal], reversals: SubstepReversals | None
    ) -> StepProgress:
        """One attempt at the next part: it is solved, or its end is replaced by a nearer one."""
        goal, warm_start, linear = goals[-1]
        guess = progress.path.state
        if warm_start is None:
            linear = progress.path.linearization
        else:
            guess = with_unknowns_of(warm_start, guess)
        result = self.solver.solve(guess, goal, linear, progress.path.state)
        middle = 0.5 * (progress.load_factor + goal)
        if not result.converged:
            if warm_start is not None:
                goals[-1] = _Goal(goal)
            elif self.solver.may_be_halved(goal - progress.load_factor, result.status):
                goals.append(_Goal(middle))
            else:
                goals.pop()
                return self._rescued(progress, goal, result)
            return progress.with_rejected(result.iterations)
        if reversals is None:
            goals.pop()
            return _accepted(progress, goal, Attempt(result))
        if self._leaves_branch(progress, goal, result):
            goals.append(_Goal(middle))
            return progress.with_rejected(result.iterations)
        part = reversals.attempt(progress, goal, result, linear, predicted=warm_start is None)
        progress = progress.with_rejected(part.rejected)
        length = goal - progress.load_factor
        room = (
            progress.path.substeps + len(goals) < self.solver.settings.max_substeps and length > SMALLEST_PART
        )
        if part.division < 1.0 and room:
            goals[-1] = self._again(goal, progress.path.state, part)
            goals.append(_Goal(progress.load_factor + part.division * length))
            return progress.with_rejected(part.result.iterations)._replace(equilibrium=part.start)
        goals.pop()
        return _accepted(progress, goal, part)

    def _leaves_branch(self, progress: StepProgress, goal: float, result: NewtonResult) -> bool:
        """Whether a solution is likely on a branch of bays that buckled, and a shorter substep may stay on this one.

        Where tendons are driven by displacement, a straight backbone under great compression is a solution, too.
        """
        before, system = progress.path.state, self.solver.system
        shorter = self.solver.may_be_halved(goal - progress.load_factor, result.status)
        if not (shorter and self.solver.passes_buckling(before, result.state)):
            return False
        continuous = is_continuous(self.solver, before, progress.load_factor, result.state, goal)
        self.solver.ramp.apply(system, goal)
        return not continuous

    def _again(self, goal: float, before: SolverState, part: Attempt) -> _Goal:
        """The end of a substep that is divided now, with its solution as warm start where that is on this branch."""
        if part.end is None or self.solver.jump_suspected(before, part.result.state):
            return _Goal(goal)
        return _Goal(goal, part.end.state, part.end.linearization)

    def _rescued(self, progress: StepProgress, goal: float, failed: NewtonResult) -> StepProgress:
        """After a smallest substep that does not converge."""
        try:
            if progress.rescues_left <= 0:
                raise self.solver.failure(
                    progress.path.state, progress.load_factor, goal, failed, failed.iterations
                )
            part = self.solver.rescue(progress.path.state, progress.load_factor, goal, failed)
        except StepFailed as failure:
            failure.iterations += progress.path.iterations + progress.path.rejected
            raise
        path = progress.path.then(replace(part, rejected=part.rejected + failed.iterations))
        return StepProgress(path, goal, progress.error, rescues_left=progress.rescues_left - 1)

    def _depends_on_rates(self, before: SolverState, after: SolverState) -> bool:
        """Whether slip rates may matter: coefficients follow laws, and a hole under tension changed its state.

        Slip rates are means over a substep, so the result depends on its length. Where loads change, slip may reverse
        and return.
        """
        if not has_rates(self.solver.system):
            return False
        for i, robot in enumerate(self.solver.system.robots):
            taut = (np.maximum(before.base_tension[i], after.base_tension[i]) > 0.0)[:, None]
            changed = np.trunc(before.mobilisation[i]) != np.trunc(after.mobilisation[i])
            if np.any((changed | self.solver.ramp.loads_change) & taut & robot.law.frictional):
                return True
        return False


def _accepted(progress: StepProgress, goal: float, part: Attempt) -> StepProgress:
    """After a substep that is accepted, with the states that were solved within it."""
    solved = one_substep(part.result, goal)
    if part.located:
        solved = replace(solved, located=True, increments=(*part.within, *solved.increments))
    return StepProgress(
        progress.path.then(solved), goal, progress.error + part.error, part.end, progress.rescues_left
    )
