"""The loop of every load step: propose a substep, solve it, judge it, accept it or solve others instead.

A substep on trial is a value that the judges hand on (`tdcr_fe.solve.load_steps.stepping`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.friction_path.response import Equilibrium
from tdcr_fe.solve.load_steps.load_path import LocatedReversals, SolvedPath, SolvedSubstep, StepFailed
from tdcr_fe.solve.load_steps.substep import SubstepSolver
from tdcr_fe.solve.newton.newton import NewtonResult, with_unknowns_of


class Proposal(NamedTuple):
    """A substep that is still to be solved, from where the one before ends."""

    end: float  # Load factor [1]
    warm_start: SolverState | None = None  # A state that is near its end
    judged: bool = False  # Whether that state has passed the judges in a similar run


class Trial(NamedTuple):
    """A substep that was solved, and what the judges have found out about it."""

    solver: SubstepSolver
    begin: SolvedPath  # The path up to where it begins
    end: float  # Load factor at its end [1]
    # Number of substeps of the load step, if this one is accepted and nothing is divided further
    substeps: int
    result: NewtonResult
    # Whether Newton's method began at its start, and not at a state near the solution
    from_start: bool = True
    beside: SolverState | None = None  # The state near its end that has passed the judges in a similar run
    error: float = 0.0  # Largest displacement of a node that is not resolved of its path, over the length [1]
    rejected: int = 0  # Iterations of former solutions of the substep
    # At which fraction of it the substep is to be divided because of its path; 0 where forces have to balance first
    division: float | None = None
    final: Equilibrium | None = None  # The state at its end with its linearisation, where it was needed
    located: LocatedReversals | None = None  # Reversals with which `result` was solved; None: without any

    @property
    def before(self) -> SolverState:
        """The state in which it begins."""
        return self.begin.state

    @property
    def start(self) -> float:
        """Load factor at its beginning [1]."""
        return self.begin.load_factor

    @property
    def within(self) -> tuple[tuple[float, SolverState], ...]:
        """Load factors and states that were solved within it."""
        if self.located is None:
            return ()
        known = self.located.known
        return tuple([(known.load_factor(x.factor), x.state.state) for x in known.points[1:-1]])

    @property
    def length(self) -> float:
        """As a part of the load step [1]."""
        return self.end - self.start

    def accepted(self) -> SolvedPath:
        """The path with it."""
        history = self.before.friction if self.located is None else self.located.history
        substep = SolvedSubstep(self.end, self.result.state, history, located=self.located)
        path = SolvedPath.of(self.result, substep)
        path = replace(path, rejected=self.rejected, refinement_error=self.error, end=self.final)
        return self.begin.then(path)

    def rescued(self) -> SolvedPath:
        """The path with it, where no smaller substep is allowed and this one did not converge."""
        spent = self.rejected + self.result.iterations
        try:
            path = self.solver.rescue(self.before, self.start, self.end, self.result)
        except StepFailed as failure:
            failure.iterations += self.begin.iterations_total + self.rejected
            raise
        return self.begin.then(replace(path, rejected=path.rejected + spent))

    def divided(self, fraction: float = 0.5) -> Instead:
        """Proposes a first part of it, a fraction of it [1], and the rest; what is known of its start is kept."""
        spent = self.begin.rejected + self.rejected + self.result.iterations
        path = replace(self.begin, rejected=spent)
        return Instead(path, (Proposal(self.start + fraction * self.length), Proposal(self.end)))


class Instead(NamedTuple):
    """A refusal by a judge: what is to be solved instead of the substep; nothing where it cannot be any smaller."""

    path: SolvedPath  # The path up to where these begin
    proposals: tuple[Proposal, ...]


def solved(solver: SubstepSolver, path: SolvedPath, proposal: Proposal, ahead: int) -> Trial:
    """Solve a proposed substep: from the state near its end, or where that fails or is not known, from its start.

    Parameters
    ----------
    solver
        Solver of the load step.
    path
        Up to where the substep begins.
    proposal
        The substep.
    ahead
        How many others are proposed after it.
    """
    substeps, spent = path.substeps + ahead + 1, 0
    if proposal.warm_start is not None:
        result = solver.solve(path, proposal.end, with_unknowns_of(proposal.warm_start, path.state))
        if result.converged:
            beside = proposal.warm_start if proposal.judged else None
            return Trial(solver, path, proposal.end, substeps, result, from_start=False, beside=beside)
        spent = result.iterations
    result = solver.solve(path, proposal.end)
    return Trial(solver, path, proposal.end, substeps, result, rejected=spent)


#: Returns the substep, perhaps solved better, or what is to be solved instead.
Judge = Callable[[Trial], Trial | Instead]


def take_substeps(
    solver: SubstepSolver, path: SolvedPath, proposals: Sequence[Proposal], judges: Sequence[Judge]
) -> SolvedPath:
    """Solve substeps one after the other; what does not pass the judges is replaced by what they propose.

    Parameters
    ----------
    solver
        Solver of the load step.
    path
        Up to where the first substep begins.
    proposals
        The substeps, in order.
    judges
        What a substep has to pass.

    Raises
    ------
    StepFailed
        A substep that cannot be any smaller does not converge, or the deadline of the solver is over.
    """
    ahead = list(reversed(proposals))
    while ahead:
        if solver.is_late:
            message = f"its time limit was reached at {path.load_factor:.0%} of the load"
            raise StepFailed(message, path.load_factor, np.nan, path.state, path.iterations_total)
        trial = solved(solver, path, ahead.pop(), len(ahead))
        verdict = _judged(trial, judges)
        if isinstance(verdict, Trial):
            path = verdict.accepted()
        elif verdict.proposals:
            path = verdict.path
            ahead.extend(reversed(verdict.proposals))
        else:
            path = trial.rescued()
    if path.end is not None:
        # The search for reversals looked at other loads.
        solver.ramp.apply(solver.system, 1.0)
    return path


def _judged(trial: Trial, judges: Sequence[Judge]) -> Trial | Instead:
    """The substep as the judges leave it, or what the first of them that it does not pass proposes."""
    for judge in judges:
        verdict = judge(trial)
        if isinstance(verdict, Instead):
            return verdict
        trial = verdict
    return trial
