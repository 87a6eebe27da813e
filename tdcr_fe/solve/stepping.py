"""Substeps of a load step, chosen by convergence and by the path dependence of friction.

With friction the solution depends on the path, but only where a hole changes its state within the step. Where one does,
the step is refined into two, four, eight substeps and so on, until two successive doublings have changed the solution
by less than the tolerance. One is not enough, as slip may reverse and return within a substep.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.model.settings import SolverSettings
from tdcr_fe.solve.convergence import NewtonStatus
from tdcr_fe.solve.linearization import Linearization
from tdcr_fe.solve.newton import NewtonResult, newton
from tdcr_fe.solve.ramp import Ramp
from tdcr_fe.solve.state import SolverState, StoredState
from tdcr_fe.solve.system import SceneSystem

Array = NDArray[np.float64]
#: A jump of a node by more than this fraction of the length in a damped solve is a snap-through [1].
SNAP = 0.02
#: Factors on the presliding distance that are tried where the smallest substep does not converge [1].
RESCUE_FACTORS = (1.0, 10.0, 100.0)


@dataclass(frozen=True)
class Increment:
    """End of an accepted substep.

    Attributes
    ----------
    load_factor : float
        Fraction of the load step, in (0, 1] [1].
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
        Largest change of a node at the last doubling over the length, where refinement has not converged; else 0 [1].
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
        )


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
        Largest change of a node at the last doubling of the substeps over the length, where refinement has not
        converged; else 0 [1].
    """

    iterations: int
    iterations_total: int
    substeps: int
    residual: float
    snapped: bool
    presliding_factor: float
    refinement_error: float

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


@dataclass(frozen=True, eq=False)
class LoadStepper:
    """Solves load steps of a scene.

    Attributes
    ----------
    system : SceneSystem
    ramp : Ramp
        The load step.
    settings : SolverSettings
    """

    system: SceneSystem
    ramp: Ramp
    settings: SolverSettings = field(default_factory=SolverSettings)

    def solve(
        self,
        state: SolverState,
        substeps: int | None = None,
        reference_path: Sequence[Increment] | None = None,
    ) -> Path:
        """Solve the load step.

        Parameters
        ----------
        state
            At its beginning.
        substeps
            A fixed number (each is still halved where it does not converge); None chooses by refinement.
        reference_path
            Increments of a similar run: the same substeps are taken, each from the state of that run. For
            sensitivities by finite differences: the path is then divided in the same way, so that differences are
            smooth, and two iterations a substep are enough.

        Raises
        ------
        StepFailed
        """
        if reference_path is not None:
            return self._along_reference(state, reference_path)
        if substeps is None:
            return self._refined(state)
        return self._equal_substeps(state, substeps)

    def _newton(self, state: SolverState, load_factor: float) -> NewtonResult:
        return newton(self.system, state, self.ramp.apply(self.system, load_factor), self.settings)

    def _equal_substeps(self, state: SolverState, count: int) -> Path:
        path = Path(state)
        for k in range(count):
            path = self._extended(path, k / count, (k + 1) / count)
        return path

    def _extended(self, path: Path, start: float, end: float) -> Path:
        """A path with one more substep."""
        try:
            return path.then(self._substep(path.state, start, end))
        except StepFailed as failure:
            failure.iterations += path.iterations + path.rejected
            raise

    def _substep(self, state: SolverState, start: float, end: float) -> Path:
        """One substep, halved only where it does not converge."""
        result = self._newton(state, end)
        if result.converged:
            return _accepted(result, end)
        if end - start <= self.settings.min_substep:
            solved = self._rescue(state, start, end, result)
        else:
            middle = 0.5 * (start + end)
            solved = self._extended(self._substep(state, start, middle), middle, end)
        return replace(solved, rejected=solved.rejected + result.iterations)

    def _along_reference(self, state: SolverState, reference: Sequence[Increment]) -> Path:
        """The substeps of a reference path, each started from its solution; if one fails, it is solved without."""
        path, start = Path(state), 0.0
        for point in reference:
            end = point.load_factor
            result = self._newton(self.system.warm_start(path.state, point.state), end)
            if result.converged:
                path = path.then(_accepted(result, end))
            else:
                path = self._extended(replace(path, rejected=path.rejected + result.iterations), start, end)
            start = end
        return path

    # ------------------------------------------------------------------ refinement

    def _refined(self, state: SolverState) -> Path:
        """The load step, refined until its path dependence is resolved."""
        path = self._substep(state, 0.0, 1.0)
        path_dependent = path.substeps > 1 or self._path_dependent(state, path.state)
        if not (path_dependent or self._branch_jump_suspected(state, path.state)):
            return path
        needed = 2 if path_dependent else 1
        agreed, count, error = 0, 1, 0.0
        while agreed < needed and 2 * count <= self.settings.max_substeps:
            count *= 2
            try:
                finer = self._equal_substeps(state, count)
            except StepFailed as failure:
                # The coarser path is kept, with its refinement error.
                error = max(error, 2.0 * self.settings.path_tolerance)
                path = replace(path, forces=(), rejected=path.rejected + failure.iterations)
                self.ramp.apply(self.system, 1.0)
                break
            error = self._distance(finer.state, path.state)
            met = error <= self.settings.path_tolerance and not self._slip_reversal_suspected(finer)
            agreed = agreed + 1 if met else 0
            path = replace(finer, rejected=finer.rejected + path.iterations + path.rejected)
        return replace(path, refinement_error=0.0 if agreed >= needed else error)

    def _distance(self, a: SolverState, b: SolverState) -> float:
        """Largest distance of any coordinate of a node between two states over the length [1]."""
        moved = a.configuration.positions - b.configuration.positions
        return float(np.max(np.abs(moved))) / self.system.length

    def _branch_jump_suspected(self, before: SolverState, after: SolverState) -> bool:
        """Whether a substep may have jumped to another branch: large rotation or a sign change of the tangent."""
        space = self.system.layout.space
        turn = space.turn_between(before.configuration, after.configuration)
        return turn > self.settings.max_substep_turn or before.tangent_sign * after.tangent_sign < 0

    def _path_dependent(self, before: SolverState, after: SolverState) -> bool:
        """Whether any hole under tension changed its state.

        A tendon that is pulled from slack and slips towards the base at every hole does not depend on the path. Where
        loads change, slip may reverse and return.
        """
        for i, robot in enumerate(self.system.robots):
            if not robot.law.has_friction:
                continue
            frictional = robot.law.frictional
            taut = (before.base_tension[i] > 0.0)[:, None]
            if self.ramp.loads_change and np.any(taut & frictional):
                return True
            if np.array_equal(before.mobilisation[i], after.mobilisation[i]):
                continue
            old, new = np.trunc(before.mobilisation[i]), np.trunc(after.mobilisation[i])
            pulled = (after.base_tension[i] > 0.0)[:, None] & (new < 1.0)
            if np.any((old != new) & frictional & (taut | pulled)):
                return True
        return False

    def _slip_reversal_suspected(self, path: Path) -> bool:
        """Whether any hole that slips may have reversed within the last substep.

        The slips of the last two substeps are interpolated by a parabola. If it has returned by more than a twentieth
        of the presliding distance at the end, the hole sticks or slips in the opposite direction there, although the
        net slip continues.
        """
        if path.substeps < 3:
            return False
        back = 0.05 * self.settings.presliding
        states = [state for _, state in path.increments[-3:]]
        for i, robot in enumerate(self.system.robots):
            if not robot.law.has_friction:
                continue
            slips = [state.friction[i].slip for state in states]
            first, last = slips[1] - slips[0], slips[2] - slips[1]
            rate, bend = 0.5 * (3.0 * last - first), last - first
            slides = np.abs(path.state.mobilisation[i]) >= 1.0
            slides &= (path.state.base_tension[i] > 0.0)[:, None]
            comes_back = (last * rate < 0.0) & (rate**2 > 2.0 * back * np.abs(bend))
            if np.any(slides & robot.law.frictional & comes_back):
                return True
        return False

    # ------------------------------------------------------------------ failure

    def _rescue(self, state: SolverState, start: float, end: float, failed: NewtonResult) -> Path:
        """For a smallest substep that does not converge: try snap-through, then a larger presliding distance."""
        spent = 0
        for factor in RESCUE_FACTORS:
            result = newton(
                self.system,
                state,
                self.ramp.apply(self.system, end),
                self.settings,
                damped=True,
                presliding=factor * self.settings.presliding,
            )
            if result.converged:
                return replace(
                    _accepted(result, end),
                    rejected=spent,
                    snapped=self._distance(result.state, state) > SNAP,
                    presliding_factor=factor,
                )
            spent += result.iterations
        raise self._failure(state, start, end, failed, spent + failed.iterations)

    def _failure(
        self, state: SolverState, start: float, end: float, failed: NewtonResult, iterations: int
    ) -> StepFailed:
        message = (
            f"{failed.reason(self.settings)}, between load factors {start:.4f} and {end:.4f} of the step, the "
            f"smallest substep allowed. {_advice(failed.status)}"
        )
        return StepFailed(message, start, failed.residual, state, iterations)


def _accepted(result: NewtonResult, load_factor: float) -> Path:
    """A converged solve as one substep."""
    return Path(
        result.state,
        result.forces,
        result.linearization,
        ((load_factor, result.state),),
        result.iterations,
        residual=result.residual,
    )


def _advice(status: NewtonStatus) -> str:
    """What to try where a step fails."""
    if status is NewtonStatus.SINGULAR:
        return "Fix or support what moves freely."
    if status is NewtonStatus.NO_FRICTION_STATE:
        return (
            "Try smaller load steps, or a larger presliding distance: presliding = 1e-5 in the [solver] table "
            "(SolverSettings in Python)."
        )
    return (
        "Try smaller load steps. If the load is near the point where the robot buckles or snaps through, no "
        "equilibrium follows this path. Where holes change between stick and slip, a larger presliding distance "
        "helps: presliding = 1e-5 in the [solver] table (SolverSettings in Python)."
    )


def solve_ramp(
    system: SceneSystem,
    state: SolverState,
    ramp: Ramp,
    settings: SolverSettings,
    substeps: int | None = None,
    reference_path: Sequence[Increment] | None = None,
) -> Path:
    """Take a scene through a load step and leave it in the state reached; the one driver of all load steps.

    Parameters
    ----------
    system
        The scene.
    state
        At the beginning of the step.
    ramp
        The step.
    settings
        Numerics.
    substeps, reference_path
        See `LoadStepper.solve`.

    Returns
    -------
    Path
        All substeps.

    Raises
    ------
    StepFailed
        The scene is then in the last state that converged. Where anything else interrupts, it is back at the beginning
        of the step.
    """
    try:
        path = LoadStepper(system, ramp, settings).solve(state, substeps, reference_path)
    except BaseException as stop:
        reached, load_factor = (
            (stop.state, stop.load_factor) if isinstance(stop, StepFailed) else (state, 0.0)
        )
        ramp.apply(system, load_factor)
        system.store(reached)
        ramp.set_end()
        raise
    system.store(path.state, path.forces)
    return path
