"""A load step: the substeps that are proposed, and what they have to pass: the judges.

With friction the solution depends on the path, but only through slips that reverse: a substep in which every slip is
monotone is exact, however many holes change between stick and slip in it. So the rest of a load step is proposed as a
whole. Each judge returns the substep, perhaps solved better, or what is to be solved instead. Adding a judge takes its
function here and its place in `PATH_RESOLVED`. Documentation: docs/algorithms.md, section "Substeps, jumps,
snap-through".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.friction_path.response import Equilibrium, twist_change, twists
from tdcr_fe.solve.friction_path.reversals import ROUGH
from tdcr_fe.solve.load_steps.load_path import Increment, Position, SolvedPath, StepFailed
from tdcr_fe.solve.load_steps.loop import Instead, Judge, Proposal, Trial, take_substeps
from tdcr_fe.solve.load_steps.substep import SMALLEST_PART, SubstepSolver, has_rates
from tdcr_fe.solve.load_steps.within_substep import follows_path, known_states, with_reversals

#: Parts of a load step to begin with where functions of the user set inputs or loads.
NONLINEAR_PARTS = 8
#: A load factor of the load step, and the state that was solved there.
Point = tuple[float, SolverState]


def converged(trial: Trial) -> Trial | Instead:
    """Whether Newton's method has found a solution, with contact that was not jumped over; else it is halved."""
    if trial.result.converged:
        return trial
    if trial.solver.may_be_halved(trial.length, trial.result.status):
        return trial.divided()
    return Instead(trial.begin, ())


def converged_at_once(trial: Trial) -> Trial:
    """Whether Newton's method has found a solution; else the whole path is given up.

    It is not halved as in `converged`: where a coefficient falls with the slip rate, the shorter a substep, the less
    likely it has a solution.
    """
    if trial.result.converged:
        return trial
    spent = trial.begin.iterations_total + trial.rejected + trial.result.iterations
    raise StepFailed("a finer path failed", trial.start, trial.result.residual, trial.before, spent)


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

    Where no more substeps are allowed, it passes, with its error; and where its path cannot be followed.
    """
    if not follows_path(trial.solver.system):
        return trial
    trial = with_reversals(trial)
    return trial if trial.division is None or not _has_room(trial) else trial.divided(trial.division)


def _has_room(trial: Trial) -> bool:
    """Whether a substep may be divided for the sake of its path."""
    return trial.substeps < trial.solver.settings.max_substeps and trial.length > SMALLEST_PART


def did_not_jump(trial: Trial) -> Trial | Instead:
    """Whether its halves lead to the same state, where it may have jumped to another branch; else it is halved.

    Where it ends near a similar run it did not jump, as that did not. Where no more substeps are allowed, it passes,
    with its distance from the end of the halves as its error.
    """
    solver, first, after = trial.solver, (trial.start, trial.before), trial.result.state
    same_sign = trial.before.tangent_sign * after.tangent_sign >= 0
    if trial.beside is not None and same_sign and not _is_suspect(solver, trial.beside, after):
        return trial
    for last in (*trial.within, (trial.end, after)):
        if _jump_possible(solver, first, last):
            away, spent = _distance_of_halves(solver, first, last)
            solver.ramp.apply(solver.system, trial.end)
            trial = trial._replace(rejected=trial.rejected + spent)
            if away > 2.0 * solver.settings.path_tolerance:
                return trial.divided() if _has_room(trial) else trial._replace(error=trial.error + away)
        first = last
    return trial


def _jump_possible(solver: SubstepSolver, first: Point, last: Point) -> bool:
    """Whether a substep may have jumped: the tangent changed its sign, or slopes do not exclude that it did."""
    before, after = first[1], last[1]
    if before.tangent_sign * after.tangent_sign < 0:
        return True
    return _is_suspect(solver, before, after) and not is_continuous(solver, first, last)


def _is_suspect(solver: SubstepSolver, before: SolverState, after: SolverState) -> bool:
    """Whether a state may be on another branch than one before: a section turned far, or a bay passed its buckling."""
    turn = before.configuration.turn_to(after.configuration)
    return turn > solver.settings.max_substep_turn or solver.passes_buckling(before, after)


def _distance_of_halves(solver: SubstepSolver, first: Point, last: Point) -> tuple[float, int]:
    """How far from its end the halves of a substep end, over the length [1], infinite where they fail; and their cost.

    The cost is the number of their iterations.
    """
    (start, before), (end, after) = first, last
    halves = (Proposal(0.5 * (start + end)), Proposal(end, after))
    try:
        path = take_substeps(solver, SolvedPath(before, start), halves, ON_THE_WAY)
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
        Solver of the load step.
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
#: Of the halves of a substep that may have jumped.
ON_THE_WAY: tuple[Judge, ...] = (converged, on_this_branch, reversals_resolved)
#: Of substeps that resolve the path of the friction, in this order.
PATH_RESOLVED: tuple[Judge, ...] = (*ON_THE_WAY, did_not_jump)
#: The same of parts with which a path is compared.
COMPARED: tuple[Judge, ...] = (converged_at_once, *PATH_RESOLVED[1:])


def equal_parts(count: int) -> list[Proposal]:
    """So many equal parts of a load step."""
    return [Proposal((k + 1) / count) for k in range(count)]


class SolvedLoadStep(NamedTuple):
    """A load step that was solved."""

    solver: SubstepSolver
    before: SolverState  # Where it begins
    path: SolvedPath


def solve_load_step(
    solver: SubstepSolver, begin: Position, substeps: int | None = None, near: Sequence[Increment] = ()
) -> SolvedLoadStep:
    """Take a scene through a load step and leave it in the state reached; all load steps are solved so.

    Parameters
    ----------
    solver
        Solves its substeps.
    begin
        Where it begins.
    substeps
        A fixed number (each is still halved where it does not converge); None divides it where slips reverse.
    near
        The substeps of a similar run: the same ones are taken, each from the state in which that run ended it.

    Raises
    ------
    StepFailed
        The scene is then in the last state that converged. Where anything else interrupts, it is back at the beginning
        of the step.
    """
    system, ramp = solver.system, solver.ramp
    try:
        proposals = [Proposal(p.load_factor, system.warm_start(begin.state, p.state), p.judged) for p in near]
        if substeps is not None:
            path = _taken(solver, begin, proposals or equal_parts(substeps), MUST_CONVERGE)
        else:
            path = _with_path_resolved(solver, begin, proposals)
    except BaseException as stop:
        failed = stop if isinstance(stop, StepFailed) else None
        ramp.apply(system, 0.0 if failed is None else failed.load_factor)
        system.store(begin.state if failed is None else failed.state)
        ramp.set_end()
        raise
    system.store(path.state, path.forces)
    return SolvedLoadStep(solver, begin.state, path)


def _taken(
    solver: SubstepSolver, begin: Position, proposals: Sequence[Proposal], judges: Sequence[Judge]
) -> SolvedPath:
    """The load step in substeps."""
    state = begin.state._replace(friction=tuple(own.anew for own in begin.state.friction))
    start = SolvedPath(state, linearization=begin.linearization, end=begin.end)
    path = take_substeps(solver, start, proposals, judges)
    resolved = path.refinement_error <= solver.settings.path_tolerance
    return replace(path, refinement_error=0.0) if resolved else path


def _with_path_resolved(solver: SubstepSolver, begin: Position, proposals: Sequence[Proposal]) -> SolvedPath:
    """The load step with its path dependence resolved.

    It begins with the proposed substeps, or as a whole. Where the path of the friction cannot be followed, it is
    also solved in parts of half its longest substep, again and again, until three in succession agree with the last. Of
    laws of the coefficients two are enough: their error falls with the square of the parts. Where a coefficient falls
    with the slip rate there may be no limit: parts fail, or differ by twice as much as before. Then the path before
    them is kept, with its error.
    """
    tolerance, rates = 2.0 * solver.settings.path_tolerance, has_rates(solver.system)
    count = NONLINEAR_PARTS if solver.ramp.nonlinear else 1
    path = _taken(solver, begin, proposals or equal_parts(count), PATH_RESOLVED)
    if not _is_compared(solver, begin.state, path):
        return path
    # Where the longest substep is so small that there is nothing to compare with, the path counts as not resolved.
    agreed, error, former = 0, tolerance, np.inf
    while agreed < (2 if rates else 3):
        ends = [0.0, *(each.load_factor for each in path.increments)]
        count = 2 * max(count, round(1.0 / np.diff(ends).max()))
        if count > solver.settings.max_substeps:
            break
        # With Dahl's law the shortest parts may be divided further. Otherwise all finer paths might fail, and there
        # would be nothing from which to estimate the error of this one.
        last = 2 * count > solver.settings.max_substeps and not rates
        try:
            finer = _taken(solver, begin, equal_parts(count), PATH_RESOLVED if last else COMPARED)
        except StepFailed as failure:
            path, agreed = replace(path, rejected=path.rejected + failure.iterations), 0
            if rates:
                break
            continue
        apart = solver.distance(finer.state, path.state)
        if rates and apart > 2.0 * max(former, tolerance):
            path, error = replace(path, rejected=path.rejected + finer.iterations_total), apart
            break
        agreed = agreed + 1 if apart <= tolerance else 0
        path, error, former = replace(finer, rejected=finer.rejected + path.iterations_total), apart, apart
    else:
        return path
    solver.ramp.apply(solver.system, 1.0)
    return replace(path, refinement_error=max(path.refinement_error, error))


def _is_compared(solver: SubstepSolver, before: SolverState, path: SolvedPath) -> bool:
    """Whether the path cannot be followed, for laws of the coefficients or of Dahl, and may matter.

    That is, a hole under tension changed its state, or slip may have reversed and returned (`Ramp.several_change`); or
    a coefficient changed with its slip rate. Rates are means over a substep, so the result depends on its length; and
    halves may agree with the whole by chance.
    """
    if follows_path(solver.system) and not has_rates(solver.system):
        return False
    after, several = path.state, solver.ramp.several_change
    for i, robot in enumerate(solver.system.robots):
        taut = (np.maximum(before.base_tension[i], after.base_tension[i]) > 0.0)[:, None]
        old, new = before.mobilisation[i], after.mobilisation[i]
        changed = np.trunc(old) != np.trunc(new) if robot.law.hysteresis.linear else old != new
        if np.any((changed | several) & taut & robot.law.frictional):
            return True
        own = path.forces[i]
        change = robot.law.coefficient_change(own.field, own.measured.shape.angles, before.friction[i])
        if np.any((change > solver.settings.path_tolerance) & taut):
            return True
    return False
