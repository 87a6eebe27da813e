"""Substeps of a load step, chosen by convergence and by the path dependence of friction.

With friction the solution depends on the path, but only through slips that reverse: a substep in which every slip is
monotone is exact, however many holes change between stick and slip in it. So the rest of a load step is solved as a
whole, reversals within it are located, and it is divided where they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.model.settings import SolverSettings
from tdcr_fe.solve.convergence import NewtonStatus
from tdcr_fe.solve.linearization import Linearization
from tdcr_fe.solve.newton import NewtonResult, newton
from tdcr_fe.solve.numbering import Numbering
from tdcr_fe.solve.ramp import Ramp
from tdcr_fe.solve.reversals import Equilibrium, History, Reversals, find_reversals, response_to_load
from tdcr_fe.solve.state import SolverState, StoredState
from tdcr_fe.solve.steady_slip import slips_steadily
from tdcr_fe.solve.system import SceneSystem

Array = NDArray[np.float64]
#: A jump of a node by more than this fraction of the length in a damped solve is a snap-through [1].
SNAP = 0.02
#: Factors on the presliding distance that are tried where the smallest substep does not converge [1].
RESCUE_FACTORS = (1.0, 10.0, 100.0)
#: Smallest part of a load step that is divided further for the sake of slip reversals [1].
SMALLEST_PART = 1e-4
#: Parts of a load step to begin with where functions of the user set inputs or loads.
CURVED_PARTS = 8
#: Largest error of a substep, as a fraction of what is left of the path tolerance; where little is left, of all [1].
SHARE, LEAST_SHARE = 0.3, 0.03


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
        Estimated displacement of a node by what is not resolved of the path, over the length, where it is beyond the
        tolerance; else 0 [1].
    end : Equilibrium or None
        The state at its end with its linearisation, where friction needed it.
    located : bool
        Whether any substep was solved with the reversals located in it, so that its history is not that of the one
        before.
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
        )


class _Goal(NamedTuple):
    """End of a part of a load step that is still to be solved.

    Attributes
    ----------
    load_factor : float
        [1].
    near : Equilibrium or None
        A solution there that is near the one looked for.
    """

    load_factor: float
    near: Equilibrium | None = None


class _Progress(NamedTuple):
    """How far a load step has been solved.

    Attributes
    ----------
    path : Path
        Of the accepted substeps.
    load_factor : float
        At its end [1].
    error : float
        Largest displacement of a node that reversals left out of account may cause, over the length [1].
    here : Equilibrium or None
        At its end, where known.
    """

    path: Path
    load_factor: float = 0.0
    error: float = 0.0
    here: Equilibrium | None = None

    def with_rejected(self, iterations: int) -> _Progress:
        """The same after an attempt that was not accepted."""
        return self._replace(path=replace(self.path, rejected=self.path.rejected + iterations))


class _Attempt(NamedTuple):
    """A converged substep, and what slip reversals within it change.

    Attributes
    ----------
    result : NewtonResult
    error : float
        Largest displacement of a node that reversals may cause, over the length [1].
    division : float
        Where it is to be divided, as a fraction of it; 1 where it is good enough.
    start, end : Equilibrium or None
        At its ends, where they were needed.
    spent : int
        Further iterations on the substep.
    located : bool
        Whether the reversals within it are solved with.
    """

    result: NewtonResult
    error: float = 0.0
    division: float = 1.0
    start: Equilibrium | None = None
    end: Equilibrium | None = None
    spent: int = 0
    located: bool = False


def _with_history_of(state: SolverState, start: SolverState) -> SolverState:
    """The unknowns of a state, as a guess in a step that begins in another one."""
    return start._replace(
        configuration=state.configuration, base_tension=state.base_tension, mobilisation=state.mobilisation
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
        Estimated displacement of a node by what is not resolved of the path, over the length, where it is beyond the
        tolerance; else 0 [1].
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
    start : Equilibrium or None
        The state at the beginning of the load step with its linearisation, where known.
    linearization : Linearization or None
        The last one of the load step before, with which the first iteration begins.
    divide : bool
        Whether substeps always end where slips reverse, so that each has the history of the one before, as derivatives
        along the path need it. Else a substep may be solved with the reversals located in it.
    """

    system: SceneSystem
    ramp: Ramp
    settings: SolverSettings = field(default_factory=SolverSettings)
    start: Equilibrium | None = None
    linearization: Linearization | None = None
    divide: bool = False

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
            A fixed number (each is still halved where it does not converge); None divides it where slips
            reverse.
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
            return self._resolved(state)
        return self._equal_substeps(state, substeps)

    def _newton(
        self,
        state: SolverState,
        load_factor: float,
        linearization: Linearization | None,
        start: SolverState,
    ) -> NewtonResult:
        """Solve at a load factor, from a guess, a substep that begins in the state `start`."""
        target = self.ramp.apply(self.system, load_factor)
        result = newton(self.system, state, target, self.settings, linearization=linearization)
        return self._unless_contact_passed(result, start)

    def _unless_contact_passed(self, result: NewtonResult, start: SolverState) -> NewtonResult:
        """A solve, not converged where a node may have jumped over a contact since the beginning of its substep."""
        if not (self.system.has_contact and result.converged):
            return result
        moved = result.state.configuration.positions - start.configuration.positions
        if float(np.linalg.norm(moved, axis=1).max()) <= self.system.contact_room(start):
            return result
        return replace(result, status=NewtonStatus.CONTACT_PASSED, unmet=None)

    def _may_be_halved(self, length: float, status: NewtonStatus) -> bool:
        """Whether a substep of this length that did not converge is divided."""
        passed = status is NewtonStatus.CONTACT_PASSED
        return length > (
            min(SMALLEST_PART, self.settings.min_substep) if passed else self.settings.min_substep
        )

    def _equal_substeps(self, state: SolverState, count: int) -> Path:
        path = Path(state, linearization=self.linearization)
        for k in range(count):
            path = self._extended(path, k / count, (k + 1) / count)
        return path

    def _extended(self, path: Path, start: float, end: float) -> Path:
        """A path with one more substep."""
        try:
            return path.then(self._substep(path, start, end))
        except StepFailed as failure:
            failure.iterations += path.iterations + path.rejected
            raise

    def _substep(self, before: Path, start: float, end: float) -> Path:
        """One substep after a path, halved only where it does not converge."""
        state = before.state
        result = self._newton(state, end, before.linearization, state)
        if result.converged:
            return _accepted(result, end)
        if not self._may_be_halved(end - start, result.status):
            solved = self._rescue(state, start, end, result)
        else:
            middle = 0.5 * (start + end)
            solved = self._extended(self._substep(before, start, middle), middle, end)
        return replace(solved, rejected=solved.rejected + result.iterations)

    def _along_reference(self, state: SolverState, reference: Sequence[Increment]) -> Path:
        """The substeps of a reference path, each started from its solution; if one fails, it is solved without."""
        path, start = Path(state, linearization=self.linearization), 0.0
        for point in reference:
            end = point.load_factor
            guess = self.system.warm_start(path.state, point.state)
            result = self._newton(guess, end, path.linearization, path.state)
            if result.converged:
                path = path.then(_accepted(result, end))
            else:
                path = self._extended(replace(path, rejected=path.rejected + result.iterations), start, end)
            start = end
        return path

    # ------------------------------------------------------------------ path

    def _resolved(self, state: SolverState) -> Path:
        """The load step with its path dependence resolved; halved where reversals are not all there is to it."""
        count = CURVED_PARTS if self.ramp.curved else 1
        path = self._divided(state, count)
        if self._depends_on_rates(state, path.state):
            needed = 2
        else:
            needed = 1 if self._any_jump_suspected(state, path) else 0
        agreed, error = 0, 0.0
        while agreed < needed and 2 * count <= self.settings.max_substeps:
            count *= 2
            try:
                finer = self._divided(state, count)
            except StepFailed as failure:
                # The coarser path is kept, with its refinement error.
                error = max(error, 2.0 * self.settings.path_tolerance)
                path = replace(path, rejected=path.rejected + failure.iterations)
                self.ramp.apply(self.system, 1.0)
                break
            error = self._distance(finer.state, path.state)
            agreed = agreed + 1 if error <= 2.0 * self.settings.path_tolerance else 0
            path = replace(finer, rejected=finer.rejected + path.iterations + path.rejected)
        return path if agreed >= needed else replace(path, refinement_error=max(path.refinement_error, error))

    def _divided(self, state: SolverState, count: int) -> Path:
        """The load step in equal parts, each divided further where slips reverse."""
        now = _Progress(Path(state, linearization=self.linearization), here=self.start)
        goals = [_Goal(k / count) for k in range(count, 0, -1)]
        while goals:
            goal, near = goals[-1]
            guess, line = now.path.state, now.path.linearization
            if near is not None:
                guess, line = _with_history_of(near.state, guess), near.linearization
            result = self._newton(guess, goal, line, now.path.state)
            if not result.converged:
                if near is not None:
                    goals[-1] = _Goal(goal)
                elif self._may_be_halved(goal - now.load_factor, result.status):
                    goals.append(_Goal(0.5 * (now.load_factor + goal)))
                else:
                    now = _Progress(self._rescued(now, goal, result), goal, now.error)
                    goals.pop()
                    continue
                now = now.with_rejected(result.iterations)
                continue
            part = self._attempt(now, goal, result, near)
            now = now.with_rejected(part.spent)
            length = goal - now.load_factor
            room = now.path.substeps + len(goals) < self.settings.max_substeps and length > SMALLEST_PART
            if part.division < 1.0 and room:
                goals[-1] = _Goal(
                    goal, None if self._jump_suspected(now.path.state, part.result.state) else part.end
                )
                goals.append(_Goal(now.load_factor + part.division * length))
                now = now.with_rejected(part.result.iterations)._replace(here=part.start)
            else:
                accepted = replace(_accepted(part.result, goal), located=part.located)
                now = _Progress(now.path.then(accepted), goal, now.error + part.error, part.end)
                goals.pop()
        if now.here is not None:
            # The search for reversals looked at other loads.
            self.ramp.apply(self.system, 1.0)
        error = now.error if now.error > self.settings.path_tolerance else 0.0
        return replace(now.path, refinement_error=error, end=now.here)

    def _attempt(
        self, now: _Progress, goal: float, result: NewtonResult, near: Equilibrium | None
    ) -> _Attempt:
        """A converged substep: as it is, or to be divided where slips reverse."""
        settings, system = self.settings, self.system
        line = result.linearization
        if line is None and near is not None:
            line = near.linearization
        if line is None or not line.numbering.has_friction or self._has_rates():
            return _Attempt(result)
        if not (self.ramp.loads_change or self.ramp.curved) and slips_steadily(
            now.path.state, result, line, system.layout.clamped, settings.presliding
        ):
            return _Attempt(result)
        tolerance = settings.path_tolerance
        start = now.here
        if start is None or not start.numbering.same_unknowns(line.numbering):
            start = self._at_start(now, line.numbering)
        if not start.exact:
            start = self._linearised(start.state, now.load_factor)
        end = Equilibrium.of(system, result.state, result.forces, line, settings.presliding)
        if not end.exact:
            end = self._linearised(result.state, goal)
        allowed = max(SHARE * (tolerance - now.error), LEAST_SHARE * tolerance)
        found = self._reversals(start, end, now.load_factor, goal, allowed)
        attempt = _Attempt(result, start=start, end=end)
        if found is not None and found.turning is not None and found.uncertain <= allowed < found.total:
            corrected = self._corrected(now.path.state, result, found.turning, goal, end)
            if corrected.converged:
                return _Attempt(
                    corrected, found.uncertain, start=start, spent=result.iterations, located=True
                )
            attempt = attempt._replace(spent=corrected.iterations)
        if found is None:
            return attempt
        return attempt._replace(error=found.total, division=found.division if found.total > allowed else 1.0)

    def _corrected(
        self, before: SolverState, result: NewtonResult, turning: History, goal: float, end: Equilibrium
    ) -> NewtonResult:
        """A substep solved again, with the mobilisations counted from where the slips reversed."""
        guess = turning.of(_with_history_of(result.state, before), end.numbering)
        return self._newton(guess, goal, end.linearization, before)

    def _at_start(self, now: _Progress, numbering: Numbering) -> Equilibrium:
        """The state at the beginning of a substep, with the last linearisation where that will do."""
        state, line = now.path.state, now.path.linearization
        if line is not None and numbering.same_unknowns(line.numbering):
            forces = self.system.forces(state, state.time)
            near = Equilibrium.of(self.system, state, forces, line, self.settings.presliding)
            if near.exact:
                return near
        return self._linearised(state, now.load_factor)

    def _linearised(self, state: SolverState, load_factor: float) -> Equilibrium:
        """Linearise in a solved state at a load factor."""
        target = self.ramp.apply(self.system, load_factor)
        return Equilibrium.at(self.system, state, target, self.settings.presliding)

    def _reversals(
        self,
        start: Equilibrium,
        end: Equilibrium,
        at: float,
        goal: float,
        allowed: float,
    ) -> Reversals | None:
        """Slip reversals between two solved states at load factors `at` and `goal`, see `find_reversals`."""
        opening = self.ramp.apply(self.system, at)
        closing = self.ramp.apply(self.system, goal)
        first = response_to_load(self.system, start, opening, closing)
        self.ramp.apply(self.system, at)
        last = response_to_load(self.system, end, closing, opening).reversed()
        presliding, length = self.settings.presliding, self.system.length
        return find_reversals(
            start,
            end,
            (first, last),
            presliding,
            length,
            allowed,
            locate=not self.divide,
        )

    def _rescued(self, now: _Progress, goal: float, failed: NewtonResult) -> Path:
        """The path with a smallest substep that does not converge."""
        try:
            part = self._rescue(now.path.state, now.load_factor, goal, failed)
        except StepFailed as failure:
            failure.iterations += now.path.iterations + now.path.rejected
            raise
        return now.path.then(replace(part, rejected=part.rejected + failed.iterations))

    def _distance(self, a: SolverState, b: SolverState) -> float:
        """Largest distance of any coordinate of a node between two states over the length [1]."""
        moved = a.configuration.positions - b.configuration.positions
        return float(np.max(np.abs(moved))) / self.system.length

    def _jump_suspected(self, before: SolverState, after: SolverState) -> bool:
        """Whether a substep may have jumped to another branch: large rotation or a sign change of the tangent."""
        turn = self.system.layout.space.turn_between(before.configuration, after.configuration)
        return turn > self.settings.max_substep_turn or before.tangent_sign * after.tangent_sign < 0

    def _any_jump_suspected(self, state: SolverState, path: Path) -> bool:
        """Whether any substep of a path from a state may have jumped to another branch."""
        states = [state, *(after for _, after in path.increments)]
        return any(self._jump_suspected(a, b) for a, b in pairwise(states))

    def _has_rates(self) -> bool:
        """Whether coefficients of friction follow laws, which may depend on slip rates."""
        return any(law is not None for robot in self.system.robots for law in robot.law.parameters.laws)

    def _depends_on_rates(self, before: SolverState, after: SolverState) -> bool:
        """Whether slip rates may matter: coefficients follow laws, and a hole under tension changed its state.

        Slip rates are means over a substep, so the result depends on its length. Where loads change, slip may reverse
        and return.
        """
        if not self._has_rates():
            return False
        for i, robot in enumerate(self.system.robots):
            taut = (np.maximum(before.base_tension[i], after.base_tension[i]) > 0.0)[:, None]
            changed = np.trunc(before.mobilisation[i]) != np.trunc(after.mobilisation[i])
            if np.any((changed | self.ramp.loads_change) & taut & robot.law.frictional):
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
            result = self._unless_contact_passed(result, state)
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
    if status is NewtonStatus.CONTACT_PASSED:
        return "No equilibrium in contact was found near the last one; try smaller load steps."
    if status is NewtonStatus.NO_CONTACT_STATE:
        return "Try smaller load steps, or a smaller contact stiffness."
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
    start: Equilibrium | None = None,
    linearization: Linearization | None = None,
    divide: bool = False,
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
    start
        The end of the path before, where nothing has changed since.
    linearization
        The last one of the path before, for the first iteration.
    divide
        See `LoadStepper`.

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
        path = LoadStepper(system, ramp, settings, start, linearization, divide).solve(
            state, substeps, reference_path
        )
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
