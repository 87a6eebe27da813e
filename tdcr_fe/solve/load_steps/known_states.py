"""Solved states of a substep, through which its slips are interpolated, and further ones solved within it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import ceil
from typing import NamedTuple

import numpy as np

from tdcr_fe.solve.equations.state import SolverState
from tdcr_fe.solve.friction_path.equilibrium import Equilibrium
from tdcr_fe.solve.friction_path.path import FrictionPath
from tdcr_fe.solve.friction_path.reversals import Reversals
from tdcr_fe.solve.friction_path.substep_slips import InterpolationPoint
from tdcr_fe.solve.friction_path.taut_tendons import TautTendons
from tdcr_fe.solve.load_steps.states_within import solve_within
from tdcr_fe.solve.load_steps.substep import SubstepSolver

#: Most intervals into which a substep is divided at first by states within it.
MOST_INTERVALS_AT_FIRST = 4
#: Largest difference between a tension of a state within a substep and that of the followed path, over the largest
#: tension, with which the state is kept where more states are solved; else it is solved again, on the path [1].
NEAR_PATH = 0.01


class Span(NamedTuple):
    """Load factors of the load step at the ends of a substep [1]."""

    start: float
    end: float

    def load_factor(self, fraction: float) -> float:
        """Load factor of the load step at a fraction of the substep [1]."""
        return self.start + fraction * (self.end - self.start)


class KnownStates(NamedTuple):
    """States of a substep, from its start to its end.

    Attributes
    ----------
    span : Span
        The substep.
    taut : TautTendons
        The tendons under tension in any of the states.
    points : tuple of InterpolationPoint
        The states, by load factor.
    """

    span: Span
    taut: TautTendons
    points: tuple[InterpolationPoint, ...]

    @classmethod
    def of(
        cls,
        solver: SubstepSolver,
        states: Sequence[tuple[float, Equilibrium]],
        span: Span,
        before: KnownStates | None = None,
    ) -> KnownStates | None:
        """States with their responses to tensions and loads; None where no friction acts in the substep.

        Parameters
        ----------
        solver
            Of the load step.
        states
            With their fractions of the substep [1].
        span
            The substep.
        before
            States of the same substep, of which some are kept.
        """
        taut = TautTendons.of([state for _, state in states])
        if not taut.holes.size:
            return None
        ramp, system = solver.ramp, solver.system
        ready = [(x, at.with_response(system.layout.clamped, taut.numbers)) for x, at in states]
        if not ramp.changes_beyond_inputs:
            return cls(span, taut, tuple([InterpolationPoint(x, at) for x, at in ready]))
        # What is left of the change of the loads, seen from every state; from the last one, back to the start.
        closing = ramp.apply(system, span.end)
        known = {} if before is None else {id(point.state): point for point in before.points[:-1]}
        points = [
            known[id(at)]
            if id(at) in known
            else InterpolationPoint(x, at, at.load_response(system, closing).times(1.0 / (1.0 - x)))
            for x, at in ready[:-1]
        ]
        opening = ramp.apply(system, span.start)
        end = ready[-1][1]
        last = InterpolationPoint(1.0, end, end.load_response(system, opening).times(-1.0))
        return cls(span, taut, (*points, last))

    @property
    def start(self) -> Equilibrium:
        """The state at the start of the substep."""
        return self.points[0].state

    @property
    def end(self) -> Equilibrium:
        """The state at its end."""
        return self.points[-1].state

    @property
    def within(self) -> tuple[tuple[float, SolverState], ...]:
        """States within the substep with their load factors in the load step."""
        return tuple([(self.span.load_factor(at.factor), at.state.state) for at in self.points[1:-1]])

    @property
    def before_end(self) -> list[tuple[float, Equilibrium]]:
        """All states but the last, with their fractions of the substep."""
        return [(at.factor, at.state) for at in self.points[:-1]]

    def refined(
        self, solver: SubstepSolver, found: Reversals, allowed: float, most: int
    ) -> list[tuple[float, Equilibrium]]:
        """States before the end with new ones between them; empty where there are to be no more of them.

        The number of intervals is doubled, and chosen at first by an error that falls with their cube. States that were
        solved far from the path that is known now are solved again: the interpolation is linear in the tensions, so the
        error that they leave would not fall with the number of states.

        Parameters
        ----------
        solver
            Of the load step.
        found
            The reversals, with the path on which states are solved.
        allowed
            Displacement of a node that is allowed, over the length [1].
        most
            Largest number of intervals.
        """
        intervals = len(self.points) - 1
        count = 2
        if intervals == 1:
            by_error = max(2, ceil(float(np.cbrt(found.error / allowed))))
            count = min(MOST_INTERVALS_AT_FIRST, most, by_error)
        if found.path is None or count < 2 or intervals * count > most:
            return []
        states = [(at.factor, at.state) for at in self.points[:-1] if self._is_near(at, found.path)]
        fractions = {
            first + (last - first) * i / count
            for first, last in pairwise(at.factor for at in self.points)
            for i in range(count)
        }
        for x in sorted(fractions - {x for x, _ in states}):
            state = solve_within(solver, self.points, self.taut, found.path, x, self.span.load_factor(x))
            if state is None:
                return []
            states.append((x, state))
        return sorted(states, key=lambda at: at[0])

    def _is_near(self, at: InterpolationPoint, path: FrictionPath) -> bool:
        """Whether a state's tensions are near those of a followed path, which begins at the first state."""
        tension = self.taut.tensions(at.state)
        off = np.abs(path.at(at.factor)[1] - tension)
        return at.factor == 0.0 or bool(off.max() <= NEAR_PATH * tension.max())
