"""Reversals in a converged substep: whether it is accepted, solved again with them in it, or divided where they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from tdcr_fe.solve.equilibrium import Equilibrium, near_enough
from tdcr_fe.solve.load_path import Progress
from tdcr_fe.solve.newton import NewtonResult
from tdcr_fe.solve.numbering import Numbering
from tdcr_fe.solve.reversals import History, Reversals, find_reversals
from tdcr_fe.solve.state import SolverState
from tdcr_fe.solve.steady_slip import slips_steadily
from tdcr_fe.solve.substep import SubstepSolver, with_history_of
from tdcr_fe.solve.system import SceneSystem
from tdcr_fe.solve.taut_tendons import TautTendons
from tdcr_fe.solve.tension_response import LoadResponse

#: Largest error of a substep, as a fraction of what is left of the path tolerance, within the load step and at its end;
#: where little is left, of all [1].
SHARE, LAST_SHARE, LEAST_SHARE = 0.3, 0.6, 0.03
#: How often a substep is solved again with the reversals located in it.
MOST_CORRECTIONS = 4


class Attempt(NamedTuple):
    """A converged substep, and what slip reversals within it change.

    Attributes
    ----------
    result : NewtonResult
    error : float
        Largest displacement of a node that reversals may cause, over the length [1].
    division : float
        Where it is to be divided, as a fraction of it; 1 where it is good enough, 0 where forces have to balance first.
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
        if line is None or not line.numbering.has_friction or has_rates(system) or goal == now.load_factor:
            return Attempt(result)
        whole = now.load_factor == 0.0 and goal == 1.0
        if (
            whole
            and not (self.solver.ramp.loads_change or self.solver.ramp.curved)
            and slips_steadily(now.path.state, result, line, system.layout.clamped, settings.presliding)
        ):
            return Attempt(result)
        tolerance = settings.path_tolerance
        start = now.here
        if start is None or not start.numbering.same_unknowns(line.numbering):
            start = self._at_start(now, line.numbering)
        if not start.exact:
            start = self._linearised(start.state, now.load_factor)
        end = Equilibrium.of(result.state, result.forces, line)
        if not start.balanced:
            return Attempt(result, division=0.0, end=end)
        if not end.exact:
            end = self._linearised(result.state, goal)
        share = LAST_SHARE if goal == 1.0 else SHARE
        allowed = max(share * (tolerance - now.error), LEAST_SHARE * tolerance)
        picked, start, end = self._with_responses(start, end)
        attempt = Attempt(result, start=start, end=end)
        found = self._reversals(picked, start, end, now.load_factor, goal, allowed)
        if found is None:
            return attempt
        attempt = attempt._replace(error=found.total, division=found.division)
        if found.total <= allowed:
            return attempt._replace(division=1.0)
        if self.divide or found.turning is None or found.error > allowed:
            return attempt
        return self._located(attempt, now, goal, found, allowed)

    def _located(
        self, attempt: Attempt, now: Progress, goal: float, found: Reversals, allowed: float
    ) -> Attempt:
        """A substep solved with the reversals located in it, until they are where the solution has them."""
        for _ in range(MOST_CORRECTIONS):
            end, turning = attempt.end, found.turning
            assert attempt.start is not None and end is not None and turning is not None
            result = self._corrected(now.path.state, attempt.result, turning, goal, end)
            if not result.converged:
                return attempt._replace(spent=attempt.spent + result.iterations)
            spent = attempt.spent + attempt.result.iterations
            if found.uncertain <= allowed:
                return Attempt(result, found.uncertain, start=attempt.start, spent=spent, located=True)
            end = Equilibrium.of(result.state, result.forces, result.linearization or end.linearization)
            if not end.exact:
                end = self._linearised(result.state, goal)
            picked, start, end = self._with_responses(attempt.start, end)
            again = self._reversals(picked, start, end, now.load_factor, goal, allowed, turning)
            assert again is not None
            found, done = again, again.total <= allowed
            division = 1.0 if done else found.division
            attempt = Attempt(result, found.total, division, start, end, spent, True)
            if done or found.turning is None or found.error > allowed:
                break
        return attempt

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
            if near_enough(state, line):
                return Equilibrium.of(state, forces, line)
        return self._linearised(state, now.load_factor)

    def _linearised(self, state: SolverState, load_factor: float) -> Equilibrium:
        """Linearise in a solved state at a load factor."""
        target = self.solver.ramp.apply(self.solver.system, load_factor)
        return Equilibrium.at(self.solver.system, state, target)

    def _with_responses(
        self, start: Equilibrium, end: Equilibrium
    ) -> tuple[TautTendons, Equilibrium, Equilibrium]:
        """The tendons under tension at either end, and both ends with the responses to their tensions."""
        picked, clamped = TautTendons.of(start, end), self.solver.system.layout.clamped
        first, last = (at.with_response(clamped, picked.numbers) for at in (start, end))
        return picked, first, last

    def _reversals(
        self,
        picked: TautTendons,
        start: Equilibrium,
        end: Equilibrium,
        at: float,
        goal: float,
        allowed: float,
        history: History | None = None,
    ) -> Reversals | None:
        """Slip reversals between two solved states at load factors `at` and `goal`, see `find_reversals`."""
        solver, system = self.solver, self.solver.system
        if not picked.holes.size:
            return None
        first: LoadResponse | None = None
        last: LoadResponse | None = None
        opening = solver.ramp.apply(system, at)
        closing = solver.ramp.apply(system, goal)
        if solver.ramp.changes_loads:
            first = start.load_response(system, closing)
            solver.ramp.apply(system, at)
            last = end.load_response(system, opening).reversed()
        presliding, length = solver.settings.presliding, system.length
        return find_reversals(
            start,
            end,
            picked,
            (opening, closing),
            (first, last),
            presliding,
            length,
            allowed,
            locate=not self.divide,
            history=history,
        )
