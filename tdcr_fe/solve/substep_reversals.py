"""Reversals in a converged substep: whether it is accepted, solved again with them in it, or divided where they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from tdcr_fe.solve.load_path import Progress
from tdcr_fe.solve.newton import NewtonResult
from tdcr_fe.solve.numbering import Numbering
from tdcr_fe.solve.reversals import Equilibrium, History, Reversals, find_reversals, response_to_load
from tdcr_fe.solve.state import SolverState
from tdcr_fe.solve.steady_slip import slips_steadily
from tdcr_fe.solve.substep import SubstepSolver, with_history_of
from tdcr_fe.solve.system import SceneSystem

#: Largest error of a substep, as a fraction of what is left of the path tolerance; where little is left, of all [1].
SHARE, LEAST_SHARE = 0.3, 0.03


class Attempt(NamedTuple):
    """A converged substep, and what slip reversals within it change.

    Attributes
    ----------
    result : NewtonResult
    error : float
        Largest displacement of a node that reversals may cause, over the length [1].
    division : float
        Where it is to be divided, as a fraction of it; 1 where it is good enough.
    start, end : Equilibrium or None
        At its ends, where they were needed.
    spent : int
        Further iterations on the substep.
    located : bool
        Whether the reversals within it are solved with.
    """

    result: NewtonResult
    error: float = 0.0
    division: float = 1.0
    start: Equilibrium | None = None
    end: Equilibrium | None = None
    spent: int = 0
    located: bool = False


def has_rates(system: SceneSystem) -> bool:
    """Whether coefficients of friction follow laws, which may depend on slip rates."""
    return any(law is not None for robot in system.robots for law in robot.law.parameters.laws)


@dataclass(frozen=True, eq=False)
class SubstepReversals:
    """Examines converged substeps of a load step for slip reversals.

    Attributes
    ----------
    solver : SubstepSolver
        Of the load step.
    divide : bool
        Whether substeps always end where slips reverse. Else a substep may be solved with the reversals located in it.
    """

    solver: SubstepSolver
    divide: bool = False

    def attempt(self, now: Progress, goal: float, result: NewtonResult, near: Equilibrium | None) -> Attempt:
        """A converged substep: as it is, or to be divided where slips reverse."""
        settings, system = self.solver.settings, self.solver.system
        line = result.linearization
        if line is None and near is not None:
            line = near.linearization
        if line is None or not line.numbering.has_friction or has_rates(system):
            return Attempt(result)
        if not (self.solver.ramp.loads_change or self.solver.ramp.curved) and slips_steadily(
            now.path.state, result, line, system.layout.clamped, settings.presliding
        ):
            return Attempt(result)
        tolerance = settings.path_tolerance
        start = now.here
        if start is None or not start.numbering.same_unknowns(line.numbering):
            start = self._at_start(now, line.numbering)
        if not start.exact:
            start = self._linearised(start.state, now.load_factor)
        end = Equilibrium.of(system, result.state, result.forces, line, settings.presliding)
        if not end.exact:
            end = self._linearised(result.state, goal)
        allowed = max(SHARE * (tolerance - now.error), LEAST_SHARE * tolerance)
        found = self._reversals(start, end, now.load_factor, goal, allowed)
        attempt = Attempt(result, start=start, end=end)
        if found is not None and found.turning is not None and found.uncertain <= allowed < found.total:
            corrected = self._corrected(now.path.state, result, found.turning, goal, end)
            if corrected.converged:
                return Attempt(corrected, found.uncertain, start=start, spent=result.iterations, located=True)
            attempt = attempt._replace(spent=corrected.iterations)
        if found is None:
            return attempt
        return attempt._replace(error=found.total, division=found.division if found.total > allowed else 1.0)

    def _corrected(
        self, before: SolverState, result: NewtonResult, turning: History, goal: float, end: Equilibrium
    ) -> NewtonResult:
        """A substep solved again, with the mobilisations counted from where the slips reversed."""
        guess = turning.of(with_history_of(result.state, before), end.numbering)
        return self.solver.solve(guess, goal, end.linearization, before)

    def _at_start(self, now: Progress, numbering: Numbering) -> Equilibrium:
        """The state at the beginning of a substep, with the last linearisation where that will do."""
        state, line = now.path.state, now.path.linearization
        if line is not None and numbering.same_unknowns(line.numbering):
            forces = self.solver.system.forces(state, state.time)
            near = Equilibrium.of(self.solver.system, state, forces, line, self.solver.settings.presliding)
            if near.exact:
                return near
        return self._linearised(state, now.load_factor)

    def _linearised(self, state: SolverState, load_factor: float) -> Equilibrium:
        """Linearise in a solved state at a load factor."""
        target = self.solver.ramp.apply(self.solver.system, load_factor)
        return Equilibrium.at(self.solver.system, state, target, self.solver.settings.presliding)

    def _reversals(
        self,
        start: Equilibrium,
        end: Equilibrium,
        at: float,
        goal: float,
        allowed: float,
    ) -> Reversals | None:
        """Slip reversals between two solved states at load factors `at` and `goal`, see `find_reversals`."""
        opening = self.solver.ramp.apply(self.solver.system, at)
        closing = self.solver.ramp.apply(self.solver.system, goal)
        first = response_to_load(self.solver.system, start, opening, closing)
        self.solver.ramp.apply(self.solver.system, at)
        last = response_to_load(self.solver.system, end, closing, opening).reversed()
        presliding, length = self.solver.settings.presliding, self.solver.system.length
        return find_reversals(
            start,
            end,
            (first, last),
            presliding,
            length,
            allowed,
            locate=not self.divide,
        )
