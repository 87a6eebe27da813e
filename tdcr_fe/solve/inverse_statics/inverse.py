"""Inverse statics: tensions or displacements that take the tip to a target, or through a path of them.

The step to a target is solved by Gauss-Newton iterations on the exact derivatives of trial steps. Every trial begins
in the state that the last target was left in, so that the loading sequence, solved again, ends where the trials ended.
Derivation: docs/algorithms.md, section "Derivatives along the history".
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tdcr_fe.effects import Experiment
from tdcr_fe.elements import Array
from tdcr_fe.model.loading import LoadStep, Model, SolverSettings, resolve
from tdcr_fe.model.messages import warnings_to
from tdcr_fe.model.plausibility import Findings, plausibility
from tdcr_fe.model.results import Interrupted, StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.schema import check_instance
from tdcr_fe.model.targets import (
    DriveBy,
    EffortKind,
    FollowResult,
    ReachedTarget,
    ReachStatus,
    TensionLimits,
    TipTarget,
    tip_targets,
)
from tdcr_fe.scene.mesh import elements_of_bays
from tdcr_fe.solve.inverse_statics.target_search import (
    AGREEMENT,
    Objective,
    SearchResult,
    TargetSearch,
    TrialSteps,
)
from tdcr_fe.solve.load_steps.load_path import Position, StepFailed
from tdcr_fe.solve.simulate import MeshedRun, refined_runs
from tdcr_fe.solve.simulation import Simulation, one_thread, step_warnings

#: Tolerance of the error, where none is given [fraction of the length].
TOLERANCE = 1e-3
#: Tensions from which the search is started at most before a target is said to be out of reach.
MOST_STARTS = 4


def follow_path(
    robot: Robot,
    model: Model,
    targets: ArrayLike | Sequence[TipTarget],
    limits: TensionLimits,
    settings: SolverSettings | None = None,
    progress: Callable[[ReachedTarget], None] | None = None,
    *,
    drive_by: DriveBy = "tension",
    effort: EffortKind = "tension",
    before: Sequence[LoadStep] = (),
    tolerance: float | None = None,
) -> FollowResult:
    """Find the loading sequence that takes the tip through targets, one after the other.

    Parameters
    ----------
    robot, model
        Description.
    targets
        An array of shape (n, 3) with positions [m], or (n, 6) with positions and directions of the tangent, or
        `TipTarget` objects. None leaves a coordinate open. An error of direction of 1 rad counts as much as one of
        position of the robot's length.
    limits
        Bounds of the tensions.
    settings
        Numerics.
    progress
        Called with what was found for every target; once more from the first on where the automatic mesh is refined.
    drive_by
        What the load steps prescribe: tensions or displacements. With displacements the pretension must be above zero.
    effort
        Where several tensions come as near to a target, those with the smallest sum of squares are taken ("tension"),
        or those whose change from the target before has the smallest one ("change").
    before
        Load steps before the first target, such as loads that go on acting.
    tolerance
        Error with which a target counts as reached [m]; None is 0.1 % of the length. Where coming nearer by it would
        need much higher tensions, the tip stays away.

    Returns
    -------
    FollowResult
        A target that is out of reach is approached as far as possible, and says so. Where a load step has no solution,
        all targets before it, and a message.

    Raises
    ------
    TypeError, ValueError
        An argument is of another type, or contradicts the robot.
    Interrupted
        The user pressed Ctrl-C; its attribute ``result`` has the targets reached before, as where a step fails.
    """
    hint = "a Robot. read_robot(path) reads one from robot.toml"
    check_instance("follow_path", "robot", robot, Robot, hint)
    hint = "TensionLimits, such as TensionLimits(largest=5.0, pretension=0.2)"
    check_instance("follow_path", "limits", limits, TensionLimits, hint)
    for name, value, other in (("drive_by", drive_by, "displacement"), ("effort", effort, "change")):
        if value not in ("tension", other):
            raise ValueError(f'follow_path: {name} = {value!r}: must be "tension" or "{other}"')
    if not robot.tendons:
        raise ValueError(f"follow_path: robot {robot.name!r} has no tendons")
    lower, upper = limits.bounds(robot.tendon_names)
    if drive_by == "displacement" and not (lower > 0.0).all():
        raise ValueError(
            "follow_path: driven by displacement, every tendon needs a pretension above zero, since the displacement "
            "of a slack tendon acts on nothing"
        )
    tolerance = TOLERANCE * robot.backbone.length if tolerance is None else tolerance
    if not 0.0 < tolerance < robot.backbone.length:
        raise ValueError(f"follow_path: tolerance = {tolerance:g}: must be above 0, below the length [m]")
    tips, first = tip_targets(targets), tuple(before)
    task = _Task(robot, model, tips, lower, upper, settings, progress, drive_by, effort, first, tolerance)
    begun = time.perf_counter()
    positions = [target.position for target in task.targets]
    findings = plausibility(robot, model, task.before, positions, upper.tolist()).issued()
    with one_thread(), warnings_to():
        automatic = model.elements_per_bay == "auto"
        runs, stop = refined_runs(partial(_FollowRun, task), elements_of_bays(robot, model), automatic)
    result = runs[-1].follow_result(time.perf_counter() - begun, findings)
    if stop is not None:
        raise Interrupted(result) from stop
    return result


def reach(
    robot: Robot,
    model: Model,
    target: ArrayLike | TipTarget,
    limits: TensionLimits,
    settings: SolverSettings | None = None,
    **options: Any,
) -> ReachedTarget:
    """Find the tensions or displacements that take the tip to one target.

    Arguments, and ``drive_by``, ``effort``, ``before`` and ``tolerance``, are as those of `follow_path`.

    Returns
    -------
    ReachedTarget

    Raises
    ------
    RuntimeError
        No load step towards the target has a solution.
    TypeError, ValueError
        See `follow_path`.
    """
    found = follow_path(robot, model, tip_targets(target)[:1], limits, settings, **options)
    if not found.targets:
        raise RuntimeError(found.simulation.message)
    return found.targets[0]


@dataclass(frozen=True, eq=False)
class _Task:
    """What `follow_path` was asked for; bounds of the tensions have shape (n_tendons,) [N]."""

    robot: Robot
    model: Model
    targets: tuple[TipTarget, ...]
    lower: Array
    upper: Array
    settings: SolverSettings | None
    progress: Callable[[ReachedTarget], None] | None
    drive_by: DriveBy
    effort: EffortKind
    before: tuple[LoadStep, ...]
    tolerance: float  # [m]

    @property
    def scale(self) -> float:
        """Tension that bends the backbone by about 1 rad [N]."""
        backbone = self.robot.backbone
        return backbone.EI / (backbone.length * self.robot.plate_radius)


class _FollowRun(MeshedRun):
    """One pass through all targets with one mesh.

    Parameters
    ----------
    task
        What is asked for.
    counts
        Elements of every bay.
    coarser
        The run on a coarser mesh; None for the first one.
    """

    def __init__(self, task: _Task, counts: tuple[int, ...], coarser: _FollowRun | None) -> None:
        self.task = task
        #: Tensions found on the coarser mesh, by target [N].
        self.guesses = [x.tensions for x in coarser.found] if coarser is not None else []
        self.model = replace(task.model, elements_per_bay=counts)
        simulation = Simulation(task.robot, self.model, resolve(task.robot, task.before), task.settings)
        super().__init__(simulation, counts, len(task.before) + len(task.targets))
        experiment = Experiment(task.robot, self.model, (*task.before, LoadStep()))
        self.trials = TrialSteps(self.simulation, experiment)
        # Squares, since the tensions of least effort are small in most tendons.
        points = np.random.default_rng(1).random((MOST_STARTS, len(task.lower))) ** 2
        self.points = task.lower + (task.upper - task.lower) * points
        self.steps: list[LoadStep] = []
        self.found: list[ReachedTarget] = []

    def take_steps(self, refine: bool) -> tuple[int, ...] | None:
        """Reach for all targets, see `MeshedRun.take_steps`."""
        simulation, task = self.simulation, self.task
        for step, actuation in zip(task.before, resolve(task.robot, task.before), strict=True):
            try:
                report = simulation.advance(actuation, step.substeps)
            except StepFailed as failure:
                self.end_at(step, failure)
                return None
            self.trials.begin(actuation)
            self._keep(step, simulation.result(len(self.solved) + 1, step.label, report, actuation))
            self.warnings.extend(step_warnings(len(self.solved), report))
        for number, target in enumerate(task.targets):
            found = self._reach(number, target)
            if found is None:
                self.message = (
                    f"target {number + 1} ({target.label or 'no label'}): no load step towards it has a solution; "
                    "try targets closer together, or a smaller pretension"
                )
                break
            self.found.append(found)
            if task.progress is not None:
                task.progress(found)
        self.monitor.flush()
        return self.refined_mesh() if refine and self.too_coarse() else None

    def _keep(self, step: LoadStep, result: StepResult) -> None:
        """Take the present state of the simulation as the end of a load step."""
        self.steps.append(step)
        self.solved.append(result)
        if isfinite(self.goal):
            self.monitor.record()

    def _reach(self, number: int, target: TipTarget) -> ReachedTarget | None:
        """Reach for one target from the present state; None where no trial step has a solution."""
        task, simulation = self.task, self.simulation
        start = simulation.state
        present = np.clip(start.base_tension[0], task.lower, task.upper)
        reference = np.zeros_like(present) if task.effort == "tension" else start.base_tension[0]
        length, bounds = task.robot.backbone.length, (task.lower, task.upper)
        objective = Objective(target, length, task.tolerance / length, *bounds, reference, task.scale)
        label = target.label or f"target {number + 1}"
        search = TargetSearch(self.trials, start, objective, label)
        starts = [*self.guesses[number : number + 1], present, *self.points][:MOST_STARTS]
        best, count = search.best(starts, task.model.friction != "none")
        if best is not None and task.drive_by == "displacement":
            best = search.run(best.trial.displacements, by_displacement=True)
        if best is None:
            return None
        trial = best.trial
        simulation.return_to(Position(trial.state))
        self.trials.begin(trial.actuation)
        result = simulation.result(len(self.solved) + 1, label, trial.report, trial.actuation)
        self._keep(trial.step, result)
        self.warnings.extend(step_warnings(result.step, trial.report))
        return self._outcome(objective, best, search.count, count, result)

    def _outcome(
        self, objective: Objective, best: SearchResult, trials: int, starts: int, result: StepResult
    ) -> ReachedTarget:
        task, trial, gain = self.task, best.trial, best.possible_gain
        if objective.size(trial) <= objective.tolerance:
            status = ReachStatus.REACHED
        elif gain <= AGREEMENT * objective.tolerance:
            status = ReachStatus.OUT_OF_REACH
        else:
            status = ReachStatus.NOT_CONVERGED
        most = trial.tensions >= task.upper - 1e-6 * task.scale
        at_largest = tuple(n for n, x in zip(task.robot.tendon_names, most, strict=True) if x)
        errors, inputs = objective.errors(trial), (trial.tensions, trial.displacements)
        return ReachedTarget(
            objective.target, status, *errors, *inputs, at_largest, gain, trials, starts, trial.step, result
        )

    def follow_result(self, wall_time: float, findings: Findings) -> FollowResult:
        """The loading sequence, and what it reaches."""
        task = self.task
        sequence = self.result(task.model, wall_time, findings)
        steps = sequence.steps[len(task.before) :]
        found = tuple(replace(x, result=step) for x, step in zip(self.found, steps, strict=False))
        sequence = replace(sequence, model=self.model)
        return FollowResult(found, tuple(self.steps), sequence, task.tolerance, wall_time)
