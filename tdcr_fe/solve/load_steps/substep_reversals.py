"""Slip reversals within a substep: states solved within it, and what is done with the reversals found.

Through states within a substep the slips are interpolated better than between both ends alone. Documentation: page
"Theory", sections "Finding reversals" and "Solving with reversals".
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.equations.layout import Numbering
from tdcr_fe.solve.equations.linearization import Linearization
from tdcr_fe.solve.friction_path.path import FrictionPath
from tdcr_fe.solve.friction_path.response import Equilibrium, TautTendons, near_enough
from tdcr_fe.solve.friction_path.reversals import (
    InterpolationPoint,
    Reversals,
    SlipHistory,
    SolvedStates,
    find_reversals,
)
from tdcr_fe.solve.friction_path.steady import slips_steadily
from tdcr_fe.solve.load_steps.loop import Trial
from tdcr_fe.solve.load_steps.substep import SubstepSolver, has_rates
from tdcr_fe.solve.newton.newton import NewtonResult, newton, with_unknowns_of
from tdcr_fe.solve.newton.prediction import moved_elements

Array = NDArray[np.float64]

#: Most intervals into which a substep is divided at first by states within it.
MOST_INTERVALS_AT_FIRST = 4
#: Largest difference between a tension of a state within a substep and that of the followed path, over the largest
#: tension, with which the state is kept where more states are solved; else it is solved again, on the path [1].
NEAR_PATH = 0.01
#: Largest error of a substep as a fraction of what is left of the path tolerance, within the load step and at its end;
#: and as a fraction of all of it, where little is left [1].
SHARE, LAST_SHARE, LEAST_SHARE = 0.3, 0.6, 0.03
#: How often a substep is solved again with the reversals located in it.
MOST_CORRECTIONS = 6
#: Most intervals of a substep, between solved states, through which slips are interpolated.
MOST_INTERVALS = 16


def solve_within(
    solver: SubstepSolver, known: KnownStates, path: FrictionPath, factor: float
) -> Equilibrium | None:
    """Solve a state within a substep, at the mobilisations of the followed path; None where that fails.

    Whether the path leads there exactly does not matter: in any equilibrium slips, angles and their derivatives belong
    to its own tensions. The load factor is that within the substep [1].
    """
    system = solver.system
    guess = _interpolated(solver, known, path, factor)
    if guess is None:
        return None
    target = solver.ramp.apply(system, known.span.load_factor(factor))
    result = newton(system, guess, target, solver.settings, friction_fixed=True)
    if not result.converged:
        return None
    if result.linearization is not None:
        linear = result.linearization._replace(numbering=system.numbering())
        found = Equilibrium.of(result.state, result.forces, linear)
        if found.exact:
            return found
    return Equilibrium.at(system, result.state, target)


def _interpolated(
    solver: SubstepSolver, known: KnownStates, path: FrictionPath, factor: float
) -> SolverState | None:
    """The state at a load factor within the substep, by interpolation; None where an element turns by too much.

    Twists of the elements by a cubic along the line between the tensions of the states on both sides, beside it linear
    in the tensions: as slips are interpolated (`tdcr_fe.solve.friction_path.slips`). Mobilisations and
    tensions at the base are those of the path.
    """
    (unknowns, tension), points, taut = path.at(factor), known.points, known.taut
    last = next(i for i, point in enumerate(points) if point.factor >= factor)
    first, then = points[last - 1], points[last]
    length = then.factor - first.factor
    x = (factor - first.factor) / length
    ends = [taut.tensions(point.state) for point in (first, then)]
    change, off_line = ends[1] - ends[0], tension - ends[0] - x * (ends[1] - ends[0])
    slopes = [twist_change(point, change, length) for point in (first, then)]
    whole = twists(then.state) - twists(first.state)
    defect = whole - 0.5 * (slopes[0] + slopes[1])
    step = x * slopes[0] + x * x * (0.5 * (slopes[1] - slopes[0]) + (3.0 - 2.0 * x) * defect)
    step += (1.0 - x) * twist_change(first, off_line, 0.0) + x * twist_change(then, off_line, 0.0)
    state = first.state.state
    configuration = moved_elements(solver.system, state, step, solver.settings.max_turn)
    if configuration is None:
        return None
    return _with_path_unknowns(first.state, taut, unknowns)._replace(configuration=configuration)


def _with_path_unknowns(point: Equilibrium, taut: TautTendons, unknowns: Array) -> SolverState:
    """A state with other mobilisations, and other tensions at the base of tendons driven by displacement."""
    state, numbering, k = point.state, point.numbering, len(taut.holes)
    mobilised = point.mobilisation.copy()
    mobilised[taut.holes] = unknowns[:k]
    tensions = list(state.base_tension)
    for part in numbering.robots:
        if part.driven.size:
            tensions[part.robot] = tensions[part.robot].copy()
            tensions[part.robot][part.driven] = 0.0
    for own, robot in zip(taut.tendons, taut.robots, strict=True):
        driven = own.which[own.driven]
        tensions[robot][driven] = unknowns[k : k + len(driven)]
        k += len(driven)
    mobilisation = numbering.with_frictional_holes(state.mobilisation, mobilised)
    return state._replace(mobilisation=mobilisation, base_tension=tuple(tensions))


def twists(point: Equilibrium) -> Array:
    """Twists of all elements: translations [m] and rotations [rad], six values each."""
    return np.concatenate([own.reshape(-1) for own in point.state.configuration.twists])


def twist_change(point: InterpolationPoint, tension: Array, load: float) -> Array:
    """Change of the twists of all elements by one of the tensions and of the loads, to first order.

    Parameters
    ----------
    point
        Where it is linearised.
    tension
        Change of the tensions of the segments [N], shape (q,).
    load
        Part of the change of the loads in the substep [1].
    """
    linear, response = point.state.linearization, point.state.response
    assert response is not None
    nodes = response.nodes @ tension
    if point.load is not None and load:
        nodes = nodes + load * point.load.nodes
    return np.concatenate(
        [
            chain.changes(nodes[part.nodes].reshape(-1, 6)).reshape(-1)
            for chain, part in zip(linear.chains, linear.numbering.robots, strict=True)
        ]
    )


class Span(NamedTuple):
    """Load factors of the load step at the ends of a substep [1]."""

    start: float
    end: float

    def load_factor(self, fraction: float) -> float:
        """Load factor of the load step at a fraction of the substep [1]."""
        return self.start + fraction * (self.end - self.start)


class KnownStates(NamedTuple):
    """States of a substep, from its start to its end."""

    span: Span  # The substep
    taut: TautTendons  # The tendons under tension in any of the states
    points: tuple[InterpolationPoint, ...]  # The states, by load factor

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
        ready = [(x, point.with_response(system.layout.clamped, taut.numbers)) for x, point in states]
        if not ramp.changes_beyond_inputs:
            return cls(span, taut, tuple([InterpolationPoint(x, point) for x, point in ready]))
        # What is left of the change of the loads, seen from every state; from the last one, back to the start.
        closing = ramp.apply(system, span.end)
        known = {} if before is None else {id(point.state): point for point in before.points[:-1]}
        points = [
            known[id(point)]
            if id(point) in known
            else InterpolationPoint(x, point, point.load_response(system, closing).times(1.0 / (1.0 - x)))
            for x, point in ready[:-1]
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
        return tuple(
            [(self.span.load_factor(point.factor), point.state.state) for point in self.points[1:-1]]
        )

    @property
    def before_end(self) -> list[tuple[float, Equilibrium]]:
        """All states but the last, with their fractions of the substep."""
        return [(point.factor, point.state) for point in self.points[:-1]]

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
        states = [
            (point.factor, point.state) for point in self.points[:-1] if self._is_near(point, found.path)
        ]
        fractions = {
            first + (last - first) * i / count
            for first, last in pairwise(point.factor for point in self.points)
            for i in range(count)
        }
        for x in sorted(fractions - {x for x, _ in states}):
            state = solve_within(solver, self, found.path, x)
            if state is None:
                return []
            states.append((x, state))
        return sorted(states, key=lambda point: point[0])

    def _is_near(self, point: InterpolationPoint, path: FrictionPath) -> bool:
        """Whether a state's tensions are near those of a followed path, which begins at the first state."""
        tension = self.taut.tensions(point.state)
        off = np.abs(path.at(point.factor)[1] - tension)
        return point.factor == 0.0 or bool(off.max() <= NEAR_PATH * tension.max())


def with_reversals(trial: Trial) -> Trial:
    """A converged substep: as it is, solved again with its reversals, or to be divided.

    Parameters
    ----------
    trial
        The substep; `Trial.division` of what is returned says where it is to be divided, if it is.
    """
    system, result = trial.solver.system, trial.result
    if not system.numbering().has_friction or has_rates(system) or trial.length == 0.0:
        return trial
    if trial.predicted and result.linearization is None:
        # Nothing changes.
        return trial
    linear = result.linearization or trial.linearization
    if linear is None:
        linear = _linearised(trial.solver, result.state, trial.end).linearization
    if _is_steady(trial, linear):
        return trial
    first, final = _first(trial, linear.numbering), Equilibrium.of(result.state, result.forces, linear)
    if not first.balanced:
        return trial._replace(division=0.0, final=final)
    if not final.exact:
        final = _linearised(trial.solver, result.state, trial.end)
    return _examined(trial._replace(first=first, final=final), first, final)


def _is_steady(trial: Trial, linear: Linearization) -> bool:
    """Whether a substep is a whole load step without change of the loads in which all holes slip steadily."""
    ramp, system = trial.solver.ramp, trial.solver.system
    if trial.length != 1.0 or ramp.loads_change or ramp.nonlinear:
        return False
    result = trial.result if trial.predicted else trial.result._replace(predicted_slips=None)
    presliding = trial.solver.settings.presliding
    return slips_steadily(trial.before, result, linear, system.layout.clamped, presliding)


def _examined(trial: Trial, first: Equilibrium, final: Equilibrium) -> Trial:
    """A substep with exact linearisations at both ends: accepted, solved again with its reversals, or divided."""
    solver, settings = trial.solver, trial.solver.settings
    share = LAST_SHARE if trial.end == 1.0 else SHARE
    left = settings.path_tolerance - trial.progress.error
    allowed = max(share * left, LEAST_SHARE * settings.path_tolerance)
    known = KnownStates.of(solver, [(0.0, first), (1.0, final)], Span(trial.start, trial.end))
    if known is None:
        return trial
    found = _reversals(solver, known, allowed)
    trial = trial._replace(first=known.start, final=known.end)
    if found is None:
        return trial
    trial = trial._replace(error=found.total, division=found.division)
    if found.total <= allowed:
        return trial._replace(division=1.0)
    if solver.divide or found.path is None or not (found.error <= allowed or _may_be_refined(solver)):
        return trial
    return _located(trial, known, found, allowed)


def _may_be_refined(solver: SubstepSolver) -> bool:
    """Whether states may be solved within a substep: nothing but robots, and inputs and loads linear in it."""
    linear = not solver.ramp.nonlinear and solver.ramp.before_increment is None
    return linear and solver.system.tangent_follows_from_elements()


def _located(trial: Trial, known: KnownStates, found: Reversals, allowed: float) -> Trial:
    """A substep solved with the reversals located in it, again until the path to the solution has the same ones.

    Where they are uncertain, the slips are interpolated through more states within the substep.
    """
    solver, division = trial.solver, found.division
    most = min(MOST_INTERVALS, solver.settings.max_substeps - trial.progress.path.substeps)
    for _ in range(MOST_CORRECTIONS):
        if found.history is None:
            break
        result = _corrected(trial, found.history, known)
        if not result.converged:
            return trial._replace(rejected=trial.rejected + result.iterations)
        corrected = trial._replace(
            result=result,
            first=known.start,
            rejected=trial.rejected + trial.result.iterations,
            located=True,
            within=known.within,
        )
        # It ends where the path led, and not in another solution with this history.
        close = allowed * solver.system.length
        if found.remaining_error <= allowed and found.history.distance(result.state) <= close:
            return corrected._replace(error=found.remaining_error, division=1.0, final=None)
        states = known.before_end
        if found.error > allowed:
            states = known.refined(solver, found, allowed, most)
        if not states:
            return trial._replace(rejected=trial.rejected + result.iterations)
        states = [*states, (1.0, _final(solver, result, known))]
        linked = KnownStates.of(solver, states, known.span, known)
        assert linked is not None
        again = _reversals(solver, linked, allowed, solved_with_reversals=True)
        assert again is not None
        diverges = again.effect > found.effect
        known, found = linked, again
        accepted = found.total <= allowed
        trial = corrected._replace(
            error=found.total,
            division=1.0 if accepted else min(division, found.division),
            first=known.start,
            final=known.end,
            within=known.within,
        )
        if accepted or diverges or (found.error > allowed and not _may_be_refined(solver)):
            break
    return trial


def _corrected(trial: Trial, history: SlipHistory, known: KnownStates) -> NewtonResult:
    """A substep solved again, with the mobilisations counted from where the slips reversed."""
    guess = history.of(with_unknowns_of(trial.result.state, trial.before))
    return trial.solver.solve(guess, trial.end, known.end.linearization, trial.before)


def _first(trial: Trial, numbering: Numbering) -> Equilibrium:
    """The state at the beginning of a substep, linearised exactly."""
    solver, first = trial.solver, trial.progress.equilibrium
    if first is not None and first.numbering.same_unknowns(numbering):
        return first if first.exact else _linearised(solver, first.state, trial.start)
    state, linear = trial.before, trial.progress.path.linearization
    if linear is not None and numbering.same_unknowns(linear.numbering) and near_enough(state, linear):
        return Equilibrium.of(state, solver.system.forces(state, state.time), linear)
    return _linearised(solver, state, trial.start)


def _final(solver: SubstepSolver, result: NewtonResult, known: KnownStates) -> Equilibrium:
    """The end of a substep that was solved once more, linearised exactly."""
    linear = result.linearization or known.end.linearization
    final = Equilibrium.of(result.state, result.forces, linear)
    return final if final.exact else _linearised(solver, result.state, known.span.end)


def _linearised(solver: SubstepSolver, state: SolverState, load_factor: float) -> Equilibrium:
    """Linearise in a solved state at a load factor."""
    return Equilibrium.at(solver.system, state, solver.ramp.apply(solver.system, load_factor))


def _reversals(
    solver: SubstepSolver, known: KnownStates, allowed: float, solved_with_reversals: bool = False
) -> Reversals | None:
    """Slip reversals in a substep, see `find_reversals`."""
    system, ramp = solver.system, solver.ramp
    targets = ramp.apply(system, known.span.start), ramp.apply(system, known.span.end)
    presliding = solver.settings.presliding
    states = SolvedStates(known.points, known.taut, targets, presliding, system.length, allowed)
    return find_reversals(states, locate=not solver.divide, solved_with_reversals=solved_with_reversals)
