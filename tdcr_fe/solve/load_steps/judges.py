"""What a substep has to pass: the list of judges.

Each judge returns the substep, perhaps solved better, or what is to be solved instead. Adding a judge takes its
function here and its place in `PATH_RESOLVED`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.friction_path.response import Equilibrium, twist_change, twists
from tdcr_fe.solve.friction_path.reversals import ROUGH
from tdcr_fe.solve.load_steps.load_path import SolvedPath, StepFailed
from tdcr_fe.solve.load_steps.loop import Instead, Judge, Proposal, Trial, take_substeps
from tdcr_fe.solve.load_steps.solve_with_reversals import (
    allowed_error,
    follows_path,
    is_steady,
    with_reversals,
)
from tdcr_fe.solve.load_steps.states_within import known_states
from tdcr_fe.solve.load_steps.substep import SMALLEST_PART, SubstepSolver

#: A load factor of the load step, and the state that was solved there.
Point = tuple[float, SolverState]


def converged(trial: Trial) -> Trial | Instead:
    """Whether Newton's method has found a solution, with contact that was not jumped over; else it is halved."""
    if trial.result.converged:
        return trial
    if trial.solver.may_be_halved(trial.length, trial.result.status):
        return trial.divided()
    return Instead(trial.begin, ())


def on_this_branch(trial: Trial) -> Trial | Instead:
    """Whether no bay has buckled, as far as a shorter substep may avoid it; else it is halved.

    Where tendons are driven by displacement, a straight backbone under great compression is a solution, too.
    """
    solver, after = trial.solver, trial.result.state
    shorter = solver.may_be_halved(trial.length, trial.result.status)
    if not (shorter and solver.passes_buckling(trial.before, after)):
        return trial
    continuous = is_continuous(solver, (trial.start, trial.before), (trial.end, after))
    solver.ramp.apply(solver.system, trial.end)
    return trial if continuous else trial.divided()


def reversals_resolved(trial: Trial) -> Trial | Instead:
    """Whether slip reversals within it are located, or move no node; else it is divided where one is.

    Where no more substeps are allowed, it passes, with its error.
    """
    trial = with_reversals(trial) if follows_path(trial.solver.system) else _compared(trial)
    return trial if trial.division is None or not _has_room(trial) else trial.divided(trial.division)


def _compared(trial: Trial) -> Trial:
    """A substep with friction whose path is not followed: it is halved where the halves end elsewhere."""
    solver, start, linear = trial.solver, trial.start, trial.result.linearization
    if not solver.system.numbering().has_friction or trial.length == 0.0 or is_steady(trial, linear):
        return trial
    away, spent = _distance_of_halves(solver, (start, trial.before), (trial.end, trial.result.state), HALVES)
    solver.ramp.apply(solver.system, trial.end)
    division = None if away <= allowed_error(trial) else 0.5
    return trial._replace(error=trial.error + away, division=division, rejected=trial.rejected + spent)


def _has_room(trial: Trial) -> bool:
    """Whether a substep may be divided for the sake of its path."""
    return trial.substeps < trial.solver.settings.max_substeps and trial.length > SMALLEST_PART


def did_not_jump(trial: Trial) -> Trial | Instead:
    """Whether its halves lead to the same state, where it may have jumped to another branch; else it is halved.

    Where no more substeps are allowed, it passes, with its distance from the end of the halves as its error.
    """
    solver, first = trial.solver, (trial.start, trial.before)
    for last in (*trial.within, (trial.end, trial.result.state)):
        if _jump_possible(solver, first, last):
            away, spent = _distance_of_halves(solver, first, last, ON_THE_WAY)
            solver.ramp.apply(solver.system, trial.end)
            trial = trial._replace(rejected=trial.rejected + spent)
            if away > 2.0 * solver.settings.path_tolerance:
                return trial.divided() if _has_room(trial) else trial._replace(error=trial.error + away)
        first = last
    return trial


def _jump_possible(solver: SubstepSolver, first: Point, last: Point) -> bool:
    """Whether a substep may have jumped: the tangent changed its sign, or slopes do not exclude it where it is suspect.

    Suspect are a large rotation, and a bay beyond its buckling load.
    """
    before, after = first[1], last[1]
    if before.tangent_sign * after.tangent_sign < 0:
        return True
    turn = before.configuration.turn_to(after.configuration)
    suspect = turn > solver.settings.max_substep_turn or solver.passes_buckling(before, after)
    return suspect and not is_continuous(solver, first, last)


def _distance_of_halves(
    solver: SubstepSolver, first: Point, last: Point, judges: Sequence[Judge]
) -> tuple[float, int]:
    """How far from its end the halves of a substep end, over the length [1], infinite where they fail; and their cost.

    The cost is the number of their iterations.
    """
    (start, before), (end, after) = first, last
    halves = (Proposal(0.5 * (start + end)), Proposal(end, after))
    try:
        path = take_substeps(solver, SolvedPath(before, start), halves, judges)
    except StepFailed as failure:
        if solver.is_late:
            raise
        return np.inf, failure.iterations
    return solver.distance(path.state, after), path.iterations_total


def is_continuous(solver: SubstepSolver, first: Point, last: Point) -> bool:
    """Whether the change of all elements in a substep is that by the slopes at its ends, on average.

    On one branch of equilibria the configuration is a smooth function of the tensions of all segments and of the loads,
    whatever friction did on the way. After a jump, the slopes would agree with its size by chance only.

    Parameters
    ----------
    solver
        Of the load step.
    first, last
        The ends of the substep.
    """
    (start, before), (end, after) = first, last
    ramp, system = solver.ramp, solver.system
    if not solver.is_smooth(end):
        return False
    try:
        there = Equilibrium.at(system, before, ramp.apply(system, start))
        here = Equilibrium.at(system, after, ramp.apply(system, end))
    except np.linalg.LinAlgError:
        return False
    known = known_states(solver, [(0.0, there), (1.0, here)], (start, end))
    tension = known.taut.tensions(here) - known.taut.tensions(there)
    if not (there.balanced and tension.size):
        return False
    slopes = [twist_change(point, tension, 1.0) for point in known.points]
    change = twists(here) - twists(there)
    return _rotation(change - 0.5 * (slopes[0] + slopes[1])) <= ROUGH * _rotation(change)


def _rotation(change: Array) -> float:
    """Largest rotation of an element [rad]."""
    return float(np.abs(change.reshape(-1, 6)[:, 3:]).max())


#: Of substeps whose number is given: reversals within them are left out of account.
MUST_CONVERGE: tuple[Judge, ...] = (converged,)
#: Of the halves with which a substep is compared where no path is followed.
HALVES: tuple[Judge, ...] = (converged, on_this_branch)
#: Of the halves of a substep that may have jumped.
ON_THE_WAY: tuple[Judge, ...] = (converged, on_this_branch, reversals_resolved)
#: Of substeps that resolve the path of the friction, in this order.
PATH_RESOLVED: tuple[Judge, ...] = (*ON_THE_WAY, did_not_jump)
