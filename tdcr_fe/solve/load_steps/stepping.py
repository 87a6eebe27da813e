"""A load step: the substeps that are proposed, and what they have to pass.

With friction the solution depends on the path, but only through slips that reverse: a substep in which every slip is
monotone is exact, however many holes change between stick and slip in it. So the rest of a load step is proposed as a
whole. Documentation: docs/algorithms.md, section "Substeps, jumps, snap-through".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.load_steps.judges import MUST_CONVERGE, PATH_RESOLVED
from tdcr_fe.solve.load_steps.load_path import Increment, Position, SolvedPath, StepFailed
from tdcr_fe.solve.load_steps.loop import Judge, Proposal, take_substeps
from tdcr_fe.solve.load_steps.solve_with_reversals import follows_path
from tdcr_fe.solve.load_steps.substep import SubstepSolver, has_rates

#: Parts of a load step to begin with where functions of the user set inputs or loads.
NONLINEAR_PARTS = 8


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
        proposals = [Proposal(p.load_factor, system.warm_start(begin.state, p.state)) for p in near]
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
    start = SolvedPath(begin.state, linearization=begin.linearization, end=begin.end)
    path = take_substeps(solver, start, proposals, judges)
    resolved = path.refinement_error <= solver.settings.path_tolerance
    return replace(path, refinement_error=0.0) if resolved else path


def _with_path_resolved(solver: SubstepSolver, begin: Position, proposals: Sequence[Proposal]) -> SolvedPath:
    """The load step with its path dependence resolved.

    It begins with the proposed substeps, or as a whole. Where the path of the friction cannot be followed, it is
    also solved in parts of half its longest substep, again and again, until two in succession agree with the last.
    """
    tolerance = 2.0 * solver.settings.path_tolerance
    count = NONLINEAR_PARTS if solver.ramp.nonlinear else 1
    path = _taken(solver, begin, proposals or equal_parts(count), PATH_RESOLVED)
    # Where the longest substep is so small that there is nothing to compare with, the path counts as not resolved.
    agreed, error = (0, tolerance) if _is_compared(solver, begin.state, path.state) else (2, 0.0)
    while agreed < 2:
        ends = [0.0, *(each.load_factor for each in path.increments)]
        count = 2 * max(count, round(1.0 / np.diff(ends).max()))
        if count > solver.settings.max_substeps:
            break
        try:
            finer = _taken(solver, begin, equal_parts(count), PATH_RESOLVED)
        except StepFailed as failure:
            # The coarser path is kept, with its refinement error.
            error = max(error, tolerance)
            path = replace(path, rejected=path.rejected + failure.iterations)
            solver.ramp.apply(solver.system, 1.0)
            break
        error = solver.distance(finer.state, path.state)
        agreed = agreed + 1 if error <= tolerance else 0
        path = replace(finer, rejected=finer.rejected + path.iterations_total)
    return path if agreed == 2 else replace(path, refinement_error=max(path.refinement_error, error))


def _is_compared(solver: SubstepSolver, before: SolverState, after: SolverState) -> bool:
    """Whether the path cannot be followed, for laws of the coefficients or of Dahl, and may matter.

    That is, a hole under tension changed its state, or loads change, so that slip may reverse and return. Slip rates
    are means over a substep, so the result depends on its length; and halves may agree with the whole by chance.
    """
    if follows_path(solver.system) and not has_rates(solver.system):
        return False
    for i, robot in enumerate(solver.system.robots):
        taut = (np.maximum(before.base_tension[i], after.base_tension[i]) > 0.0)[:, None]
        changed = np.trunc(before.mobilisation[i]) != np.trunc(after.mobilisation[i])
        if np.any((changed | solver.ramp.loads_change) & taut & robot.law.frictional):
            return True
    return False
