"""Reversals in a converged substep: whether it is accepted, solved again with them in it, or divided where they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from typing import NamedTuple

import numpy as np

from tdcr_fe.solve.equations.linearization import Linearization
from tdcr_fe.solve.equations.numbering import Numbering
from tdcr_fe.solve.equations.state import SolverState
from tdcr_fe.solve.friction_path.equilibrium import Equilibrium, near_enough
from tdcr_fe.solve.friction_path.friction_path import FollowedPath
from tdcr_fe.solve.friction_path.reversals import History, Point, Reversals, find_reversals
from tdcr_fe.solve.friction_path.steady_slip import slips_steadily
from tdcr_fe.solve.friction_path.taut_tendons import TautTendons
from tdcr_fe.solve.load_steps.load_path import Progress
from tdcr_fe.solve.load_steps.states_within import solve_within
from tdcr_fe.solve.load_steps.substep import SubstepSolver, has_rates, with_history_of
from tdcr_fe.solve.newton.newton import NewtonResult

#: Largest error of a substep, as a fraction of what is left of the path tolerance, within the load step and at its end;
#: where little is left, of all [1].
SHARE, LAST_SHARE, LEAST_SHARE = 0.3, 0.6, 0.03
#: How often a substep is solved again with the reversals located in it.
MOST_CORRECTIONS = 6
#: Largest number of states within a substep, its start included, through which slips are interpolated.
MOST_STATES = 16
#: And those at first.
MOST_AT_FIRST = 4
#: Largest difference between a tension of a state within a substep and that of the followed path, over the largest
#: tension, with which the state is kept where more states are solved; else it is solved again, on the path [1].
NEAR_PATH = 0.01


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
    within : tuple of (float, SolverState)
        Load factors and states that were solved within it.
    """

    result: NewtonResult
    error: float = 0.0
    division: float = 1.0
    start: Equilibrium | None = None
    end: Equilibrium | None = None
    spent: int = 0
    located: bool = False
    within: tuple[tuple[float, SolverState], ...] = ()


class _Span(NamedTuple):
    """Load factors at the ends of a substep."""

    start: float
    end: float

    def load_factor(self, factor: float) -> float:
        """Load factor of the load step at a fraction of the substep."""
        return self.start + factor * (self.end - self.start)

    def states(self, points: Sequence[Point]) -> tuple[tuple[float, SolverState], ...]:
        """States within the substep with their load factors."""
        return tuple([(self.load_factor(at.factor), at.state.state) for at in points])


class _Known(NamedTuple):
    """States of a substep, from its start to its end, and the tendons under tension in any of them."""

    picked: TautTendons
    points: tuple[Point, ...]

    def near_path(self, at: Point, path: FollowedPath) -> bool:
        """Whether a state's tensions are near those of a followed path."""
        tension = self.picked.tensions(at.state)
        off = np.abs(path.at(at.factor)[1] - tension)
        return at.factor == 0.0 or bool(off.max() <= NEAR_PATH * tension.max())


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
        self, now: Progress, goal: float, result: NewtonResult, near: Linearization | None, *, predicted: bool
    ) -> Attempt:
        """A converged substep: as it is, or to be divided where slips reverse.

        Parameters
        ----------
        now
            Where it begins.
        goal
            Load factor at its end [1].
        result
            The solve.
        near
            Linearisation with which it began, for a solve without any iteration.
        predicted
            Whether it began at its start. From a guess near the solution, the first iteration predicts nothing about
            the way there.
        """
        settings, system = self.solver.settings, self.solver.system
        if not system.numbering().has_friction or has_rates(system) or goal == now.load_factor:
            return Attempt(result)
        if predicted and result.linearization is None:
            # Nothing changes.
            return Attempt(result)
        line = result.linearization or near
        if line is None:
            line = self._linearised(result.state, goal).linearization
        whole = now.load_factor == 0.0 and goal == 1.0
        steady = result if predicted else result._replace(predicted_slips=None)
        if (
            whole
            and not (self.solver.ramp.loads_change or self.solver.ramp.curved)
            and slips_steadily(now.path.state, steady, line, system.layout.clamped, settings.presliding)
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
        attempt = Attempt(result, start=start, end=end)
        span = _Span(now.load_factor, goal)
        known = self._linked([(0.0, start), (1.0, end)], span)
        if known is None:
            return attempt
        found = self._reversals(known, span, allowed)
        attempt = attempt._replace(start=known.points[0].state, end=known.points[-1].state)
        if found is None:
            return attempt
        attempt = attempt._replace(error=found.total, division=found.division)
        if found.total <= allowed:
            return attempt._replace(division=1.0)
        if self.divide or found.path is None or not (found.error <= allowed or self._may_be_refined):
            return attempt
        most = min(MOST_STATES, settings.max_substeps - now.path.substeps)
        return self._located(attempt, now.path.state, known, span, found, allowed, most)

    @property
    def _may_be_refined(self) -> bool:
        """Whether states may be solved within a substep: nothing but robots, and inputs and loads linear in it."""
        ramp = self.solver.ramp
        linear = not ramp.curved and ramp.before_increment is None
        return linear and self.solver.system.tangent_follows_from_elements()

    def _located(
        self,
        attempt: Attempt,
        before: SolverState,
        known: _Known,
        span: _Span,
        found: Reversals,
        allowed: float,
        most: int,
    ) -> Attempt:
        """A substep solved with the reversals located in it, until they are where the solution has them.

        Where that is uncertain, the slips are interpolated through more states within the substep, up to a number.
        """
        first = found.division
        for _ in range(MOST_CORRECTIONS):
            turning, points = found.turning, known.points
            if turning is None:
                break
            end = points[-1].state
            result = self._corrected(before, attempt.result, turning, span.end, end)
            if not result.converged:
                return attempt._replace(spent=attempt.spent + result.iterations)
            spent = attempt.spent + attempt.result.iterations
            if found.uncertain <= allowed:
                start, within = points[0].state, span.states(points[1:-1])
                return Attempt(result, found.uncertain, start=start, spent=spent, located=True, within=within)
            states = [(at.factor, at.state) for at in points[:-1]]
            if found.error > allowed:
                states = self._with_more_states(known, found, span, allowed, most)
                if not states:
                    return attempt._replace(spent=attempt.spent + result.iterations)
            end = Equilibrium.of(result.state, result.forces, result.linearization or end.linearization)
            if not end.exact:
                end = self._linearised(result.state, span.end)
            linked = self._linked([*states, (1.0, end)], span)
            assert linked is not None
            again = self._reversals(linked, span, allowed, again=True)
            assert again is not None
            diverges = again.effect > found.effect
            known, found = linked, again
            start, end, within = (
                known.points[0].state,
                known.points[-1].state,
                span.states(known.points[1:-1]),
            )
            division = 1.0 if found.total <= allowed else min(first, found.division)
            attempt = Attempt(result, found.total, division, start, end, spent, True, within)
            if found.total <= allowed or diverges or (found.error > allowed and not self._may_be_refined):
                break
        return attempt

    def _with_more_states(
        self, known: _Known, found: Reversals, span: _Span, allowed: float, most: int
    ) -> list[tuple[float, Equilibrium]]:
        """States at the start of a substep and within it, with new ones; empty where there are to be no more of them.

        Their number is at least doubled, and chosen at first by an error that falls with its cube. States that were
        solved far from the path that is known now are solved again: the interpolation is linear in the tensions, so
        the error that they leave would not fall with the number of states.
        """
        parts = len(known.points) - 1
        count = 2
        if parts == 1:
            count = min(MOST_AT_FIRST, most, max(2, ceil(float(np.cbrt(found.error / allowed)))))
        if found.path is None or count < 2 or parts * count > most:
            return []
        states = [(at.factor, at.state) for at in known.points[:-1] if known.near_path(at, found.path)]
        factors = {
            first + (last - first) * i / count
            for first, last in pairwise(at.factor for at in known.points)
            for i in range(count)
        }
        for factor in sorted(factors - {factor for factor, _ in states}):
            load_factor = span.load_factor(factor)
            state = solve_within(self.solver, known.points, known.picked, found.path, factor, load_factor)
            if state is None:
                return []
            states.append((factor, state))
        return sorted(states, key=lambda at: at[0])

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

    def _linked(self, states: Sequence[tuple[float, Equilibrium]], span: _Span) -> _Known | None:
        """States of a substep with their responses to tensions and loads; None where no friction acts in it.

        Parameters
        ----------
        states
            With their fractions of the substep [1].
        span
            The substep.
        """
        picked = TautTendons.of([state for _, state in states])
        if not picked.holes.size:
            return None
        ramp, system = self.solver.ramp, self.solver.system
        ready = [(x, at.with_response(system.layout.clamped, picked.numbers)) for x, at in states]
        if not ramp.changes_loads:
            return _Known(picked, tuple([Point(x, at) for x, at in ready]))
        # What is left of the change of the loads, seen from every state; from the last one, back to the start.
        closing = ramp.apply(system, span.end)
        points = [
            Point(x, at, at.load_response(system, closing).times(1.0 / (1.0 - x))) for x, at in ready[:-1]
        ]
        opening = ramp.apply(system, span.start)
        end = ready[-1][1]
        last = Point(1.0, end, end.load_response(system, opening).times(-1.0))
        return _Known(picked, (*points, last))

    def _reversals(self, known: _Known, span: _Span, allowed: float, again: bool = False) -> Reversals | None:
        """Slip reversals in a substep, see `find_reversals`."""
        system, ramp = self.solver.system, self.solver.ramp
        targets = ramp.apply(system, span.start), ramp.apply(system, span.end)
        return find_reversals(
            known.points,
            known.picked,
            targets,
            self.solver.settings.presliding,
            system.length,
            allowed,
            locate=not self.divide,
            again=again,
        )
