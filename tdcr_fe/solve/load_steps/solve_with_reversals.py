"""Slip reversals within a substep: states solved within it, and what is done with the reversals found.

Through states within a substep the slips are interpolated better than between both ends alone. Documentation:
docs/algorithms.md, section "Slip reversals within a substep".
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.equations.layout import Numbering
from tdcr_fe.solve.equations.linearization import Linearization, input_changes
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.friction_path.response import Equilibrium, KnownStates, near_enough
from tdcr_fe.solve.friction_path.reversals import Reversals, find_reversals
from tdcr_fe.solve.load_steps.load_path import LocatedReversals
from tdcr_fe.solve.load_steps.loop import Trial
from tdcr_fe.solve.load_steps.states_within import known_states, refined
from tdcr_fe.solve.load_steps.substep import SubstepSolver, has_rates
from tdcr_fe.solve.newton.newton import NewtonResult, with_unknowns_of
from tdcr_fe.solve.newton.steps import slip_changes

#: Largest error of a substep as a fraction of what is left of the path tolerance, or of all of it where nothing is
#: left and the load step will be reported [1].
SHARE = 0.6
#: Most intervals of a substep, between solved states, through which slips are interpolated.
MOST_INTERVALS = 16


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
    found = _reversals(solver, known, allowed)
    if found is None:
        return trial
    trial = trial._replace(error=found.total, division=None if found.total <= allowed else 0.5)
    if trial.division is None:
        return trial
    if found.history is None or not (found.error <= allowed or solver.is_smooth(trial.end)):
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
        if found.history is None:
            break
        guess = found.history.of(with_unknowns_of(trial.result.state, trial.before))
        result = solver.solve(guess, trial.end, known.end.linearization, trial.before)
        if not result.converged:
            return trial._replace(rejected=trial.rejected + result.iterations)
        located = LocatedReversals(known, found.history.path, found.history.of(trial.before).friction)
        corrected = trial._replace(
            result=result,
            rejected=trial.rejected + trial.result.iterations,
            located=located,
        )
        # It ends where the path led, and not in another solution with this history.
        close = allowed * solver.system.length
        if found.error <= allowed and found.history.distance(result.state) <= close:
            return corrected._replace(error=found.error, division=None, final=None)
        states = [(point.factor, point.state) for point in known.points[:-1]]
        if found.error > allowed:
            states = refined(solver, known, found.history.path, found.error / allowed, most)
        if not states:
            return trial._replace(rejected=trial.rejected + result.iterations)
        linear = result.linearization or known.end.linearization
        states = [*states, (1.0, _final(solver, result, linear, trial.end))]
        linked = known_states(solver, states, known.span)
        again = _reversals(solver, linked, allowed, solved_with_reversals=True)
        assert again is not None
        diverges = again.effect > found.effect
        known, found = linked, again
        accepted = found.total <= allowed
        trial = corrected._replace(
            error=found.total,
            division=None if accepted else 0.5,
            final=known.end,
            located=located._replace(known=known, path=found.history.path if found.history else located.path),
        )
        if accepted or diverges or (found.error > allowed and not solver.is_smooth(trial.end)):
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


def _reversals(
    solver: SubstepSolver, known: KnownStates, allowed: float, solved_with_reversals: bool = False
) -> Reversals | None:
    """Slip reversals in a substep, see `find_reversals`."""
    system, ramp = solver.system, solver.ramp
    start, end = known.span
    targets = ramp.apply(system, start), ramp.apply(system, end)
    return find_reversals(known, targets, system.length, allowed, solved_with_reversals)


def is_steady(trial: Trial, linear: Linearization | None) -> bool:
    """Whether a substep is a whole load step without change of the loads in which all holes slip steadily.

    That is, every hole of tendons under tension slips in one direction.

    All of them slip at both ends, in the same direction, unless their tendon had no tension. The slip rates at the end,
    from the last linearisation, have the direction of the friction, and so have those at the start, from these and the
    slips taken as parabolas of the load factor. A substep in which no slip reverses is exact as a whole.

    Parameters
    ----------
    trial
        The solved substep.
    linear
        Linearisation at the end, or at most an iteration before; None where there is none.
    """
    before, result, ramp = trial.before, trial.result, trial.solver.ramp
    if linear is None or trial.length != 1.0 or ramp.loads_change or ramp.nonlinear:
        return False
    after, numbering = result.state, linear.numbering
    pick, parts = numbering.at_frictional_holes, numbering.robots
    old, new = pick(before.mobilisation), pick(after.mobilisation)
    # Adhesion may hold tendons under tension while they are slack at the base.
    adhesive = [own.model.law.parameters.adhesion.any(axis=1) for own in result.forces]
    was_tense, tense = (
        pick([p.frictional & (t | a)[:, None] for p, t, a in zip(parts, taut, adhesive, strict=True)])
        for taut in ([t > 0.0 for t in state.base_tension] for state in (before, after))
    )
    # A hole that changes between stick and slip bends the slips of all others, so that they are no parabolas. Where a
    # tendon is pulled from zero, its friction grows with its tension, and such holes have no effect yet.
    if (np.abs(new) < 1.0)[tense].any() or (old * new < 1.0)[was_tense].any():
        return False
    for part in parts:
        was_taut, taut = (state.base_tension[part.robot] > 0.0 for state in (before, after))
        becomes_taut = (taut & ~was_taut)[part.driven].any()
        if part.has_friction and ((was_taut & ~taut).any() or becomes_taut):
            return False
    changes = input_changes(before, result.target)
    rate = pick(slip_changes(numbering, result.forces, linear.response(changes), changes))
    slips = pick(
        [last.slip - first.slip for last, first in zip(after.friction, before.friction, strict=True)]
    )
    side = np.where(tense, new, 0.0)
    first = 2.0 * slips - rate
    return bool(min((side * rate).min(), (side * first).min()) >= 0.0)
