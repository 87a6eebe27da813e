"""Path of a load step: its accepted substeps, how far it is solved, the report on it, and its failure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.solve.equations.linearization import Linearization
from tdcr_fe.solve.equations.state import SolverState, StoredState
from tdcr_fe.solve.friction_path.equilibrium import Equilibrium
from tdcr_fe.solve.newton.newton import NewtonResult


@dataclass(frozen=True)
class Increment:
    """End of an accepted substep.

    Attributes
    ----------
    load_factor : float
        Fraction of the load step, in [0, 1] [1]; 0 where weight acts on a robot that was never loaded.
    state : StoredState
        The solved state, history committed.
    """

    load_factor: float
    state: StoredState


@dataclass(frozen=True, eq=False)
class Path:
    """A solved part of a load step.

    Attributes
    ----------
    state : SolverState
        At its end.
    forces : tuple of TendonForces
        By robot, in that state; empty if the scene was last evaluated in another state.
    linearization : Linearization or None
        The last one of the last substep; None if that substep needed no iteration.
    increments : tuple of (float, SolverState)
        Load factor and state at the end of every substep.
    iterations : int
        Of the accepted substeps.
    rejected : int
        Iterations of attempts that were not accepted.
    residual : float
        Relative residual at the end [1].
    snapped : bool
        Whether the robot jumped to another equilibrium.
    presliding_factor : float
        Largest factor on the presliding distance that a substep needed [1].
    refinement_error : float
        Estimated displacement of a node by what is not resolved of the path, over the length, where it is beyond the
        tolerance; else 0 [1].
    end : Equilibrium or None
        The state at its end with its linearisation, where friction needed it.
    located : bool
        Whether any substep was solved with the reversals located in it, so that its history is not that of the one
        before.
    unstable : bool
        Whether the state at its end is known to be unstable; this is examined in scenes with contact.
    """

    state: SolverState
    forces: tuple[TendonForces, ...] = ()
    linearization: Linearization | None = None
    increments: tuple[tuple[float, SolverState], ...] = ()
    iterations: int = 0
    rejected: int = 0
    residual: float = 0.0
    snapped: bool = False
    presliding_factor: float = 1.0
    refinement_error: float = 0.0
    end: Equilibrium | None = None
    located: bool = False
    unstable: bool = False

    @property
    def substeps(self) -> int:
        """Number of accepted substeps."""
        return len(self.increments)

    def then(self, other: Path) -> Path:
        """Join another part that begins where this one ends."""
        return Path(
            other.state,
            other.forces,
            other.linearization,
            self.increments + other.increments,
            self.iterations + other.iterations,
            self.rejected + other.rejected,
            other.residual,
            self.snapped or other.snapped,
            max(self.presliding_factor, other.presliding_factor),
            max(self.refinement_error, other.refinement_error),
            other.end,
            self.located or other.located,
            other.unstable,
        )


def one_substep(result: NewtonResult, load_factor: float) -> Path:
    """A converged solve as one substep."""
    return Path(
        result.state,
        result.forces,
        result.linearization,
        ((load_factor, result.state),),
        result.iterations,
        residual=result.residual,
        unstable=result.unstable,
    )


class Progress(NamedTuple):
    """How far a load step has been solved.

    Attributes
    ----------
    path : Path
        Of the accepted substeps.
    load_factor : float
        At its end [1].
    error : float
        Largest displacement of a node that reversals left out of account may cause, over the length [1].
    equilibrium : Equilibrium or None
        The state at its end with its linearisation, where known.
    rescues_left : float
        So many more smallest substeps may be solved by a rescue (`SubstepSolver.rescue`).
    """

    path: Path
    load_factor: float = 0.0
    error: float = 0.0
    equilibrium: Equilibrium | None = None
    rescues_left: float = math.inf

    def with_rejected(self, iterations: int) -> Progress:
        """The same after an attempt that was not accepted."""
        if iterations == 0:
            return self
        return self._replace(path=replace(self.path, rejected=self.path.rejected + iterations))


@dataclass(frozen=True)
class LoadStepReport:
    """Report on a solved load step.

    Attributes
    ----------
    iterations : int
        Newton iterations of the accepted path.
    iterations_total : int
        With those of rejected attempts.
    substeps : int
        Of the accepted path.
    residual : float
        Relative residual at the end [1].
    snapped : bool
        Whether the robot jumped to another equilibrium within the step.
    presliding_factor : float
        Largest factor on the presliding distance that a substep needed for the stick-slip iteration to converge [1].
    refinement_error : float
        Estimated displacement of a node by what is not resolved of the path, over the length, where it is beyond the
        tolerance; else 0 [1].
    unstable : bool
        Whether the equilibrium at its end is known to be unstable; this is examined in scenes with contact.
    """

    iterations: int
    iterations_total: int
    substeps: int
    residual: float
    snapped: bool
    presliding_factor: float
    refinement_error: float
    unstable: bool = False

    @classmethod
    def of(cls, path: Path) -> LoadStepReport:
        """Report on a load step that was solved along a path."""
        return cls(
            path.iterations,
            path.iterations + path.rejected,
            path.substeps,
            path.residual,
            path.snapped,
            path.presliding_factor,
            path.refinement_error,
            path.unstable,
        )


class StepFailed(Exception):
    """A load step could not be solved.

    Attributes
    ----------
    load_factor : float
        Load factor up to which the step was solved [1].
    residual : float
        Relative residual of the failed attempt [1].
    state : SolverState
        At `load_factor`.
    iterations : int
        Spent on the step.
    """

    def __init__(
        self, message: str, load_factor: float, residual: float, state: SolverState, iterations: int
    ) -> None:
        super().__init__(message)
        self.load_factor = load_factor
        self.residual = residual
        self.state = state
        self.iterations = iterations
