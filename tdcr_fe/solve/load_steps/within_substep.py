"""Slip reversals within a substep: states solved within it, what is done with reversals, and states there.

Through states within a substep the slips are interpolated better than between both ends alone. Documentation:
docs/algorithms.md, section "Slip reversals within a substep".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import ceil
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array, Flags
from tdcr_fe.elements.friction import TendonLaw
from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.equations.layout import Numbering, RobotUnknowns
from tdcr_fe.solve.equations.linearization import Linearization, input_changes
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.friction_path.follow import FrictionPath, PathReversal
from tdcr_fe.solve.friction_path.response import (
    Equilibrium,
    InterpolationPoint,
    KnownStates,
    SegmentResponse,
    TautTendons,
    interpolated,
    near_enough,
    with_path_unknowns,
)
from tdcr_fe.solve.friction_path.reversals import Reversals, find_reversals
from tdcr_fe.solve.load_steps.load_path import LocatedReversals, SolvedSubstep, StepFailed
from tdcr_fe.solve.load_steps.loop import Trial
from tdcr_fe.solve.load_steps.substep import SubstepSolver, has_rates
from tdcr_fe.solve.newton.newton import NewtonResult, newton, with_unknowns_of
from tdcr_fe.solve.newton.steps import slip_changes

#: Largest error of a substep as a fraction of what is left of the path tolerance, or of all of it where nothing is
#: left and the load step will be reported [1].
SHARE = 0.6
#: Most intervals of a substep, between solved states, through which slips are interpolated.
MOST_INTERVALS = 16
#: Most intervals into which a substep is divided at first by states within it.
MOST_INTERVALS_AT_FIRST = 4


def known_states(
    solver: SubstepSolver, states: Sequence[tuple[float, Equilibrium]], span: tuple[float, float]
) -> KnownStates:
    """States with their responses to tensions and loads.

    Parameters
    ----------
    solver
        Solver of the load step.
    states
        With their fractions of the substep [1].
    span
        Load factors of the load step at the ends of the substep [1].
    """
    taut, points = TautTendons.of([state for _, state in states]), []
    for x, at in states:
        load = np.zeros(at.numbering.reduced)
        if solver.ramp.changes_beyond_inputs:
            # What is left of the change of the loads, seen from every state; from the last one, back to the start.
            other, factor = (span[0], -1.0) if x == 1.0 else (span[1], 1.0 / (1.0 - x))
            target = solver.ramp.apply(solver.system, other)
            residual = solver.system.residual(at.state, target, at.numbering, forces=at.forces)
            load = factor * residual.unbalanced
        points.append(InterpolationPoint(x, at, SegmentResponse.of(at, taut.numbers, load)))
    start, end = (solver.ramp.apply(solver.system, factor) for factor in span)
    return KnownStates(span, (start, end), taut, tuple(points))


def solve_within(
    solver: SubstepSolver, known: KnownStates, path: FrictionPath, factor: float
) -> Equilibrium | None:
    """Solve a state within a substep, at the mobilisations of the followed path; None where that fails.

    Whether the path leads there exactly does not matter: in any equilibrium slips, angles and their derivatives belong
    to its own tensions. The load factor is that within the substep [1].
    """
    guess = interpolated(solver.system, known, path, factor, solver.settings.max_turn)
    if guess is None:
        return None
    return _at_fixed_friction(solver, guess, known.load_factor(factor))


def _at_fixed_friction(solver: SubstepSolver, guess: SolverState, load_factor: float) -> Equilibrium | None:
    """Solve at the mobilisations of a guess; None where that fails."""
    system = solver.system
    target = solver.ramp.apply(system, load_factor)
    result = newton(system, guess, target, solver.settings, friction_fixed=True)
    if not result.converged:
        return None
    if result.linearization is None:
        return Equilibrium.at(system, result.state, target)
    linear = result.linearization._replace(numbering=system.numbering())
    return _final(solver, result, linear, load_factor)


def refined(
    solver: SubstepSolver, known: KnownStates, path: FrictionPath, error: float, most: int
) -> list[tuple[float, Equilibrium]]:
    """States before the end with new ones between them; empty where there are to be no more of them.

    The number of intervals is doubled, and chosen at first by an error that falls with their cube.

    Parameters
    ----------
    solver
        Solver of the load step.
    known
        The present states.
    path
        On which states are solved.
    error
        Displacement of a node that the reversals leave uncertain, over that allowed [1].
    most
        Largest number of intervals.
    """
    intervals = len(known.points) - 1
    count = min(MOST_INTERVALS_AT_FIRST, most, max(2, ceil(float(np.cbrt(error))))) if intervals == 1 else 2
    if count < 2 or intervals * count > most:
        return []
    states = []
    for first, last in pairwise(known.points):
        states.append((first.factor, first.state))
        for i in range(1, count):
            x = first.factor + (last.factor - first.factor) * i / count
            state = solve_within(solver, known, path, x)
            if state is None:
                return []
            states.append((x, state))
    return states


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
    if trial.from_start and result.linearization is None:
        # Nothing changes.
        return trial
    linear = result.linearization or _linearised(trial.solver, result.state, trial.end).linearization
    if is_steady(trial, linear):
        return trial
    first, final = _first(trial, linear.numbering), _final(trial.solver, result, linear, trial.end)
    if not first.balanced:
        return trial._replace(division=0.0, final=final)
    return _examined(trial, first, final)


def follows_path(system: SceneSystem) -> bool:
    """Whether the friction path within a substep can be followed: mobilisations are linear in the slips up to 1."""
    return all(robot.law.hysteresis.linear for robot in system.robots)


def _examined(trial: Trial, first: Equilibrium, final: Equilibrium) -> Trial:
    """A substep with exact linearisations at both ends: accepted, solved again with its reversals, or divided."""
    solver, allowed = trial.solver, allowed_error(trial)
    known = known_states(solver, [(0.0, first), (1.0, final)], (trial.start, trial.end))
    trial = trial._replace(begin=replace(trial.begin, end=known.start), final=known.end)
    if not known.taut.holes.size:
        return trial
    smooth = solver.is_smooth(trial.end)
    found = find_reversals(known, solver.system.length, refinable=smooth)
    if found.error <= allowed and not found.possible:
        return trial
    if smooth and found.error > 0.0:
        # States within the substep decide. Without them, 1e-3 of the length was missing once in 700 load steps of
        # random robots.
        found = found._replace(error=max(found.error, 2.0 * allowed))
    trial = trial._replace(error=found.total, division=None if found.total <= allowed else 0.5)
    if trial.division is None or not (smooth or found.error <= allowed):
        return trial
    return _located(trial, known, found, allowed)


def allowed_error(trial: Trial) -> float:
    """Displacement of a node that what is not resolved of a substep may cause, over the length [1]."""
    tolerance = trial.solver.settings.path_tolerance
    left = tolerance - trial.begin.refinement_error
    return SHARE * (left if left > 0.0 else tolerance)


def _located(trial: Trial, known: KnownStates, found: Reversals, allowed: float) -> Trial:
    """A substep solved with the reversals located in it, again until the path to the solution has the same ones.

    Where they are uncertain, the slips are interpolated through more states within the substep.
    """
    solver = trial.solver
    most = min(MOST_INTERVALS, solver.settings.max_substeps - trial.begin.substeps)
    for _ in range(solver.settings.max_iterations):
        if not found.path.complete:
            break
        guess = found.of(with_unknowns_of(trial.result.state, trial.before))
        result = solver.solve(trial.begin, trial.end, guess)
        if not result.converged:
            return trial._replace(rejected=trial.rejected + result.iterations)
        located = LocatedReversals(known, found.path, found.of(trial.before).friction)
        spent = trial.rejected + trial.result.iterations
        corrected = trial._replace(result=result, rejected=spent, located=located)
        if found.error <= allowed:
            return corrected._replace(error=found.error, division=None, final=None)
        states = refined(solver, known, found.path, found.error / allowed, most)
        if not states:
            return trial._replace(rejected=trial.rejected + result.iterations)
        linear = result.linearization or known.end.linearization
        states = [*states, (1.0, _final(solver, result, linear, trial.end))]
        linked = known_states(solver, states, known.span)
        again = find_reversals(linked, solver.system.length, refinable=True)
        diverges = again.effect > found.effect
        known, found = linked, again
        accepted = found.total <= allowed
        trial = corrected._replace(
            error=found.total,
            division=None if accepted else 0.5,
            final=known.end,
            located=located._replace(known=known, path=found.path if found.path.complete else located.path),
        )
        if accepted or diverges:
            break
    return trial


def _first(trial: Trial, numbering: Numbering) -> Equilibrium:
    """The state at the beginning of a substep, linearised exactly."""
    solver, first = trial.solver, trial.begin.end
    if first is not None and first.numbering.same_unknowns(numbering):
        return first
    state, linear = trial.before, trial.begin.linearization
    if linear is not None and numbering.same_unknowns(linear.numbering) and near_enough(state, linear):
        return Equilibrium(state, solver.system.forces(state, state.time), linear)
    return _linearised(solver, state, trial.start)


def _final(
    solver: SubstepSolver, result: NewtonResult, linear: Linearization, load_factor: float
) -> Equilibrium:
    """The end of a substep, linearised exactly: by a linearisation near it where that is as good."""
    if near_enough(result.state, linear):
        return Equilibrium(result.state, result.forces, linear)
    return _linearised(solver, result.state, load_factor)


def _linearised(solver: SubstepSolver, state: SolverState, load_factor: float) -> Equilibrium:
    """Linearise in a solved state at a load factor."""
    return Equilibrium.at(solver.system, state, solver.ramp.apply(solver.system, load_factor))


def is_steady(trial: Trial, linear: Linearization) -> bool:
    """Whether a substep is a whole load step in which the loads stay and every hole slips in one direction only.

    Such a substep is exact as a whole. It is recognised by two signs. Every hole of a tendon under tension slips at the
    end, and at the start, if its tendon was under tension there, in the same direction. And its slip rate has the
    direction of the friction at both ends: at one of them by a linearisation, at the start where the substep was
    predicted; at the other by the parabola of the load factor through its slips.

    Parameters
    ----------
    trial
        The solved substep.
    linear
        Linearisation at the end, or at most an iteration before.
    """
    before, result, ramp = trial.before, trial.result, trial.solver.ramp
    if trial.length != 1.0 or ramp.loads_change or ramp.nonlinear:
        return False
    after, pick = result.state, linear.numbering.at_frictional_holes
    robots = list(zip(linear.numbering.robots, [own.model.law for own in result.forces], strict=True))
    if not all(_slips_at_both_ends(part, law, before, after) for part, law in robots):
        return False
    rates = None if linear.solved is None else linear.solved.slips
    if rates is None:
        changes = input_changes(before, result.target)
        rates = pick(slip_changes(linear.numbering, result.forces, linear.response(changes), changes))
    slips = [end.slip - start.slip for end, start in zip(after.friction, before.friction, strict=True)]
    others = 2.0 * pick(slips) - rates
    side = pick([_tense(part, law, after) * after.mobilisation[part.robot] for part, law in robots])
    return bool(min((side * rates).min(), (side * others).min()) >= 0.0)


def _slips_at_both_ends(part: RobotUnknowns, law: TendonLaw, before: SolverState, after: SolverState) -> bool:
    """Whether every hole of a tendon under tension slips after a substep, and before it in the same direction.

    A hole that changes between stick and slip bends the slips of all others, so that they are no parabolas. Where a
    tendon is pulled from zero, its friction grows with its tension, and such holes have no effect yet.
    """
    i = part.robot
    if not part.frictional.any():
        return True
    was_taut, taut = before.base_tension[i] > 0.0, after.base_tension[i] > 0.0
    if (was_taut & ~taut).any() or (taut & ~was_taut)[part.driven].any():
        return False
    old, new = before.mobilisation[i], after.mobilisation[i]
    if (np.abs(new) < 1.0)[_tense(part, law, after)].any():
        return False
    return not (old * new < 1.0)[_tense(part, law, before)].any()


def _tense(part: RobotUnknowns, law: TendonLaw, state: SolverState) -> Flags:
    """Frictional holes of tendons that may be under tension: adhesion may hold one that is slack at the base."""
    return np.asarray(part.frictional & ((state.base_tension[part.robot] > 0.0) | law.adhesive)[:, None])


class ReversalPoint(NamedTuple):
    """A state within a substep in which slips reverse."""

    load_factor: float  # Within the load step [1]
    state: SolverState
    sticking: tuple[Flags, ...]  # (m, g): By robot, holes that stuck just before
    reverses: tuple[Flags, ...]  # (m, g): By robot, holes whose slips reverse
    # Which frictional hole of all robots begins to slip here, (k,), and which tendon driven by displacement becomes
    # slack or taut, (c,), so that slip rates jump; at most one in all. None: rates go through zero
    slipping: Flags
    pulling: Flags
    input_rates: tuple[Array, ...]  # (m,): By robot, derivatives of the inputs by the load factor [N, m]
    load_rates: Array | None  # (reduced,): Of the residual, by loads and time; None where only inputs change


def reversal_points(solver: SubstepSolver, substep: SolvedSubstep) -> list[ReversalPoint]:
    """The reversals on which the end of a solved substep depends, by load factor.

    Raises
    ------
    StepFailed
        No equilibrium was found at one of them.
    """
    if substep.located is None:
        return []
    known, path, _ = substep.located
    numbering, holes = known.end.numbering, known.taut.holes
    ends = np.abs(numbering.at_frictional_holes(substep.state.mobilisation)) < 1.0
    return [_point(solver, substep, here) for here in path.reversals(ends[holes])]


def _point(solver: SubstepSolver, substep: SolvedSubstep, here: PathReversal) -> ReversalPoint:
    """The state at one reversal."""
    assert substep.located is not None
    known, path, _ = substep.located
    numbering, taut, k = known.end.numbering, known.taut, len(known.taut.holes)
    load_factor = known.load_factor(here.factor)
    found = solve_within(solver, known, path, here.factor)
    if found is None:
        # From the shape at the end of the substep.
        guess = with_path_unknowns(known.end, taut, path.at(here.factor)[0])
        found = _at_fixed_friction(solver, guess, load_factor)
    if found is None:
        where = f"where slips reverse, at load factor {load_factor:.4f}"
        message = f"no equilibrium {where}, for the derivatives there"
        raise StepFailed(message, load_factor, np.nan, known.start.state, 0)
    state, tension = found.state, found.driven_tension
    # A tendon that begins to pull has any tension at all, unlike a slack one.
    pulled = np.maximum(tension[taut.driven], np.finfo(float).tiny)
    tension[taut.driven] = np.where(here.side[k:] == 0.0, pulled, 0.0)
    sticks = np.abs(found.mobilisation) < 1.0
    sticks[taut.holes] = here.side[:k] == 0.0
    reverses, slipping = np.zeros_like(sticks), np.zeros_like(sticks)
    reverses[taut.holes], slipping[taut.holes] = here.reverses, here.arrives[:k]
    pulling = np.zeros(len(tension), dtype=bool)
    pulling[taut.driven] = here.arrives[k:]
    none = [np.zeros(own.shape, dtype=bool) for own in state.mobilisation]
    base_tension = numbering.with_driven(state.base_tension, tension)
    state = state._replace(base_tension=base_tension, friction=substep.located.history)
    sticking, turned = (numbering.with_frictional_holes(none, which) for which in (sticks, reverses))
    rates = _rates(solver, known, found, load_factor)
    return ReversalPoint(load_factor, state, sticking, turned, slipping, pulling, *rates)


def _rates(
    solver: SubstepSolver, known: KnownStates, point: Equilibrium, load_factor: float
) -> tuple[tuple[Array, ...], Array | None]:
    """Derivatives of inputs and residual by the load factor, as differences to the ends of the substep."""
    (first, last), (start, end) = known.span, known.targets
    inputs = tuple([(b - a) / (last - first) for a, b in zip(start.inputs, end.inputs, strict=True)])
    if not solver.ramp.changes_beyond_inputs:
        return inputs, None
    far = max(known.span, key=lambda end: abs(end - load_factor))
    target = solver.ramp.apply(solver.system, far)
    residual = solver.system.residual(point.state, target, point.numbering, forces=point.forces)
    return inputs, residual.unbalanced / (far - load_factor)
