"""Slip reversals in a converged substep: it is accepted, solved again with them, or divided.

Documentation: page "Theory", section "Finding reversals".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from tdcr_fe.solve.equations.linearization import Linearization
from tdcr_fe.solve.equations.numbering import Numbering
from tdcr_fe.solve.equations.state import SolverState
from tdcr_fe.solve.friction_path.equilibrium import Equilibrium, near_enough
from tdcr_fe.solve.friction_path.reversals import History, Reversals, find_reversals
from tdcr_fe.solve.friction_path.steady_slip import slips_steadily
from tdcr_fe.solve.load_steps.known_states import KnownStates, Span
from tdcr_fe.solve.load_steps.load_path import Progress
from tdcr_fe.solve.load_steps.substep import SubstepSolver, has_rates, with_history_of
from tdcr_fe.solve.newton.newton import NewtonResult

#: Largest error of a substep as a fraction of what is left of the path tolerance, within the load step and at its end;
#: and as a fraction of all of it, where little is left [1].
SHARE, LAST_SHARE, LEAST_SHARE = 0.3, 0.6, 0.03
#: How often a substep is solved again with the reversals located in it.
MOST_CORRECTIONS = 6
#: Most intervals of a substep, between solved states, through which slips are interpolated.
MOST_INTERVALS = 16


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
    rejected : int
        Iterations of former solutions of the substep.
    located : bool
        Whether `result` has the reversals located in it.
    within : tuple of (float, SolverState)
        Load factors and states that were solved within it.
    """

    result: NewtonResult
    error: float = 0.0
    division: float = 1.0
    start: Equilibrium | None = None
    end: Equilibrium | None = None
    rejected: int = 0
    located: bool = False
    within: tuple[tuple[float, SolverState], ...] = ()


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

    def attempt(
        self, now: Progress, goal: float, result: NewtonResult, line: Linearization | None, *, predicted: bool
    ) -> Attempt:
        """A converged substep: as it is, solved again with its reversals, or to be divided.

        Parameters
        ----------
        now
            Where it begins.
        goal
            Load factor at its end [1].
        result
            The solve.
        line
            Linearisation with which it began, for a solve without any iteration.
        predicted
            Whether Newton's method began at its start. From a state near the solution, the first iteration predicts
            nothing about the way there.
        """
        system = self.solver.system
        if not system.numbering().has_friction or has_rates(system) or goal == now.load_factor:
            return Attempt(result)
        if predicted and result.linearization is None:
            # Nothing changes.
            return Attempt(result)
        line = result.linearization or line
        if line is None:
            line = self._linearised(result.state, goal).linearization
        if self._is_steady(now, goal, result if predicted else result._replace(predicted_slips=None), line):
            return Attempt(result)
        start = self._start(now, line.numbering)
        end = Equilibrium.of(result.state, result.forces, line)
        if not start.balanced:
            return Attempt(result, division=0.0, end=end)
        if not end.exact:
            end = self._linearised(result.state, goal)
        return self._examined(now, Attempt(result, start=start, end=end), Span(now.load_factor, goal))

    def _is_steady(self, now: Progress, goal: float, result: NewtonResult, line: Linearization) -> bool:
        """Whether a substep is a whole load step without change of the loads in which all holes slip steadily."""
        ramp, system = self.solver.ramp, self.solver.system
        if now.load_factor != 0.0 or goal != 1.0 or ramp.loads_change or ramp.nonlinear:
            return False
        clamped, presliding = system.layout.clamped, self.solver.settings.presliding
        return slips_steadily(now.path.state, result, line, clamped, presliding)

    def _examined(self, now: Progress, attempt: Attempt, span: Span) -> Attempt:
        """A substep with exact linearisations at both ends: accepted, solved again with its reversals, or divided."""
        start, end = attempt.start, attempt.end
        assert start is not None and end is not None
        settings = self.solver.settings
        share = LAST_SHARE if span.end == 1.0 else SHARE
        allowed = max(share * (settings.path_tolerance - now.error), LEAST_SHARE * settings.path_tolerance)
        known = KnownStates.of(self.solver, [(0.0, start), (1.0, end)], span)
        if known is None:
            return attempt
        found = self._reversals(known, allowed)
        attempt = attempt._replace(start=known.start, end=known.end)
        if found is None:
            return attempt
        attempt = attempt._replace(error=found.total, division=found.division)
        if found.total <= allowed:
            return attempt._replace(division=1.0)
        if self.divide or found.path is None or not (found.error <= allowed or self._may_be_refined):
            return attempt
        most = min(MOST_INTERVALS, settings.max_substeps - now.path.substeps)
        return self._located(attempt, now.path.state, known, found, allowed, most)

    @property
    def _may_be_refined(self) -> bool:
        """Whether states may be solved within a substep: nothing but robots, and inputs and loads linear in it."""
        ramp = self.solver.ramp
        linear = not ramp.nonlinear and ramp.before_increment is None
        return linear and self.solver.system.tangent_follows_from_elements()

    def _located(
        self,
        attempt: Attempt,
        before: SolverState,
        known: KnownStates,
        found: Reversals,
        allowed: float,
        most: int,
    ) -> Attempt:
        """A substep solved with the reversals located in it, again until the path to the solution has the same ones.

        Where they are uncertain, the slips are interpolated through more states within the substep.

        Parameters
        ----------
        attempt
            The substep solved as a whole.
        before
            State at its start.
        known
            The solved states.
        found
            The reversals.
        allowed
            Displacement of a node that is allowed, over the length [1].
        most
            Largest number of intervals between solved states.
        """
        division = found.division
        for _ in range(MOST_CORRECTIONS):
            if found.history is None:
                break
            result = self._corrected(before, attempt.result, found.history, known)
            if not result.converged:
                return attempt._replace(rejected=attempt.rejected + result.iterations)
            rejected = attempt.rejected + attempt.result.iterations
            if found.remaining_error <= allowed and self._ends_as_followed(
                result, found.history, known, allowed
            ):
                error, start, within = found.remaining_error, known.start, known.within
                return Attempt(result, error, start=start, rejected=rejected, located=True, within=within)
            states = known.before_end
            if found.error > allowed:
                states = known.refined(self.solver, found, allowed, most)
            if not states:
                return attempt._replace(rejected=attempt.rejected + result.iterations)
            states = [*states, (1.0, self._end(result, known))]
            linked = KnownStates.of(self.solver, states, known.span, known)
            assert linked is not None
            again = self._reversals(linked, allowed, solved_with_reversals=True)
            assert again is not None
            diverges = again.effect > found.effect
            known, found = linked, again
            accepted = found.total <= allowed
            attempt = Attempt(
                result,
                found.total,
                1.0 if accepted else min(division, found.division),
                known.start,
                known.end,
                rejected,
                True,
                known.within,
            )
            if accepted or diverges or (found.error > allowed and not self._may_be_refined):
                break
        return attempt

    def _corrected(
        self, before: SolverState, result: NewtonResult, history: History, known: KnownStates
    ) -> NewtonResult:
        """A substep solved again, with the mobilisations counted from where the slips reversed."""
        end = known.end
        guess = history.of(with_history_of(result.state, before), end.numbering)
        return self.solver.solve(guess, known.span.end, end.linearization, before)

    def _ends_as_followed(
        self, result: NewtonResult, history: History, known: KnownStates, allowed: float
    ) -> bool:
        """Whether a substep solved again ends where the path led, and not in another solution with its history."""
        return history.distance(result.state, known.end.numbering) <= allowed * self.solver.system.length

    def _start(self, now: Progress, numbering: Numbering) -> Equilibrium:
        """The state at the beginning of a substep, linearised exactly."""
        start = now.equilibrium
        if start is None or not start.numbering.same_unknowns(numbering):
            state, line = now.path.state, now.path.linearization
            if line is not None and numbering.same_unknowns(line.numbering) and near_enough(state, line):
                return Equilibrium.of(state, self.solver.system.forces(state, state.time), line)
            return self._linearised(state, now.load_factor)
        return start if start.exact else self._linearised(start.state, now.load_factor)

    def _end(self, result: NewtonResult, known: KnownStates) -> Equilibrium:
        """The end of a substep that was solved once more, linearised exactly."""
        line = result.linearization or known.end.linearization
        end = Equilibrium.of(result.state, result.forces, line)
        return end if end.exact else self._linearised(result.state, known.span.end)

    def _linearised(self, state: SolverState, load_factor: float) -> Equilibrium:
        """Linearise in a solved state at a load factor."""
        target = self.solver.ramp.apply(self.solver.system, load_factor)
        return Equilibrium.at(self.solver.system, state, target)

    def _reversals(
        self, known: KnownStates, allowed: float, solved_with_reversals: bool = False
    ) -> Reversals | None:
        """Slip reversals in a substep, see `find_reversals`."""
        system, ramp = self.solver.system, self.solver.ramp
        targets = ramp.apply(system, known.span.start), ramp.apply(system, known.span.end)
        return find_reversals(
            known.points,
            known.taut,
            targets,
            self.solver.settings.presliding,
            system.length,
            allowed,
            locate=not self.divide,
            solved_with_reversals=solved_with_reversals,
        )
