"""Simulation of a loading sequence, with automatic mesh refinement: `simulate`."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from itertools import zip_longest
from math import isfinite
from typing import NamedTuple, TypeVar

from tdcr_fe.effects import Experiment
from tdcr_fe.model.loading import Actuation, LoadStep, Model, SolverSettings, resolve
from tdcr_fe.model.messages import issue, warnings_to
from tdcr_fe.model.plausibility import Findings, plausibility, strain_warnings
from tdcr_fe.model.results import Interrupted, SequenceResult, StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.schema import check_instance
from tdcr_fe.scene.mesh import elements_of_bays
from tdcr_fe.solve.equations.configuration import StoredState
from tdcr_fe.solve.load_steps.load_path import Increment, LoadStepReport, StepFailed
from tdcr_fe.solve.load_steps.stepping import SolvedLoadStep
from tdcr_fe.solve.mesh import MOST_MESHES, MeshEstimate, MeshMonitor, error_order, mesh_warnings, refined
from tdcr_fe.solve.sensitivities.linear_response import local_response
from tdcr_fe.solve.sensitivities.parameters import Parameter, parameters
from tdcr_fe.solve.sensitivities.sensitivity import SensitivityHistory
from tdcr_fe.solve.simulation import Simulation, one_thread, step_warnings
from tdcr_fe.solve.stability import ExternalCompression, buckled_under_loads, instability_warnings

#: Messages of a run that solved all steps, and of one that was interrupted.
CONVERGED, INTERRUPTED = "all steps converged", "interrupted"

#: By load step, the ends of its substeps with the states there.
PathRecord = list[list[Increment]]


def simulate(
    robot: Robot,
    model: Model,
    steps: Sequence[LoadStep],
    settings: SolverSettings | None = None,
    progress: Callable[[StepResult], None] | None = None,
    *,
    reference_path: PathRecord | None = None,
    record_path: PathRecord | None = None,
    sensitivities: Sequence[str | Parameter] = (),
    curvatures: bool = True,
    responses: bool = False,
    restarts: Sequence[int] = (),
) -> SequenceResult:
    """Take a robot through a loading sequence.

    Parameters
    ----------
    robot, model
        Description.
    steps
        Load steps in order.
    settings
        Numerics.
    progress
        Called with every solved step; once more from the first step on where the automatic mesh is refined. The
        discretisation error is in the final result only.
    reference_path
        Path of a similar run of the same number of steps: the same substeps are taken, each from the solution of that
        run.
    record_path
        An empty list to fill, as a later reference path.
    sensitivities
        Parameters by which the results are differentiated, such as ``"backbone.youngs_modulus"``; names:
        docs/sensitivities.md.
    curvatures
        Whether the derivatives of the curvature rates are needed; else they are zero.
    responses
        Compute compliance, tendon Jacobians and the stiffness seen by the motors at the tip, in every step.
    restarts
        Numbers of steps, from 0, that begin with the unloaded robot, as the first one does.

    Returns
    -------
    SequenceResult
        Where a step fails, all steps before it, and a message. Where this happens on an automatically refined mesh,
        the steps of the coarser mesh if it solved more of them, and a warning.

    Raises
    ------
    TypeError
        An argument is of another type; the message names the expected type and the function to call.
    ValueError
        The description contradicts itself (see `tdcr_fe.model.loading.resolve` and `tdcr_fe.scene.builder.CreateTDCR`),
        or there is no derivative by a parameter.
    Interrupted
        The user pressed Ctrl-C; its attribute ``result`` has the steps solved before, as where a step fails.
    """
    check_instance("simulate", "robot", robot, Robot, "a Robot. read_robot(path) reads one from robot.toml")
    check_instance("simulate", "model", model, Model, "a Model, such as Model(friction='per-hole')")
    begun = time.perf_counter()
    targets = resolve(robot, steps, restarts=restarts)  # before all else: it says what steps are
    experiment = Experiment(robot, model, tuple(steps), restarts=tuple(restarts))
    recorded = record_path is not None
    asked = reference_path, parameters(experiment, sensitivities), curvatures, responses, recorded
    request = _Request(experiment, targets, settings, progress, *asked)
    findings = plausibility(robot, model, steps).issued()
    automatic = model.elements_per_bay == "auto" and reference_path is None
    with one_thread(), warnings_to():
        runs, stop = refined_runs(partial(_Run, request), elements_of_bays(robot, model), automatic)
    # A run on a refined mesh may have failed, or been interrupted, before the steps that a coarser one has solved.
    last, kept = runs[-1], max(reversed(runs), key=lambda run: len(run.solved))
    if record_path is not None:
        record_path[:] = kept.path
    further = [*instability_warnings(kept.unstable)]
    if kept is not last:
        further.append(_coarser_mesh_kept(kept, last))
        kept.message = _message_on_coarser_mesh(kept, last)
    if (doubts := [*findings.warnings, *findings.remarks]) and kept.message not in (CONVERGED, INTERRUPTED):
        kept.message = f"{kept.message.partition(' Try smaller')[0]} Check the input first: {doubts[0]}"
    result = kept.result(model, time.perf_counter() - begun, findings, further)
    if kept.history is not None:
        result = replace(result, sensitivities=kept.history.result())
    if stop is not None:
        raise Interrupted(result) from stop
    return result


class _Request(NamedTuple):
    """What is asked for."""

    experiment: Experiment
    targets: Sequence[Actuation]
    settings: SolverSettings | None
    progress: Callable[[StepResult], None] | None
    reference_path: PathRecord | None
    parameters: tuple[Parameter, ...]  # By which results are differentiated
    curvatures: bool  # Whether curvature rates are, too
    responses: bool
    records: bool  # Whether the path is recorded


def _coarser_mesh_kept(kept: _Run, last: _Run) -> str:
    """Warning that the steps are those of a coarser mesh than the last one tried."""
    what = "was interrupted" if last.message == INTERRUPTED else f"failed: {last.message}"
    return (
        f"the results are those of a mesh of {sum(kept.elements_per_bay)} elements, on which {len(kept.solved)} "
        f"{'step was' if len(kept.solved) == 1 else 'steps were'} solved; the run on the refined mesh of "
        f"{sum(last.elements_per_bay)} elements got to step {last.next_step} and {what}"
    )


def _message_on_coarser_mesh(kept: _Run, last: _Run) -> str:
    """Why the run ended, where a coarser mesh's steps are kept."""
    if last.message == INTERRUPTED:
        return INTERRUPTED
    if kept.next_step is None:
        return CONVERGED
    return f"step {kept.next_step} was not solved, since the refined mesh failed before it: {last.message}"


class MeshedRun(ABC):
    """A run with one mesh: what is solved so far, and the estimated error of the mesh.

    Parameters
    ----------
    simulation
        Simulation of the robot, at its beginning.
    elements_per_bay
        Elements per bay of the mesh.
    count
        Number of load steps.

    Attributes
    ----------
    goal : float
        Error of the mesh above which it is too coarse [m].
    monitor : MeshMonitor
    solved : list of StepResult
    warnings : list of str
    message : str
        Why it ended.
    pilots : list of MeshEstimate or None
        Estimates for steps to come; None until there is need of them.
    """

    def __init__(self, simulation: Simulation, elements_per_bay: tuple[int, ...], count: int) -> None:
        self.simulation, self.elements_per_bay, self.count = simulation, elements_per_bay, count
        self.begin = simulation.position
        self.goal = simulation.settings.mesh_tolerance * simulation.handle.robot.backbone.length
        self.monitor = MeshMonitor(simulation, self.goal)
        self.solved: list[StepResult] = []
        self.warnings: list[str] = []
        self.message = CONVERGED
        self.pilots: list[MeshEstimate] | None = []

    @abstractmethod
    def take_steps(self, refine: bool) -> tuple[int, ...] | None:
        """Solve all steps; or, to ``refine``, return the elements per bay of the finer mesh that they need."""

    @property
    def next_step(self) -> int | None:
        """Number of the first step that is not solved."""
        return len(self.solved) + 1 if len(self.solved) < self.count else None

    def end_at(self, step: LoadStep, failure: StepFailed) -> None:
        """Record that the next step, which is this one, has no solution."""
        label = f" ({step.label})" if step.label else ""
        self.message = f"step {self.next_step}{label} did not converge: {failure}"

    @property
    def _estimates(self) -> tuple[MeshEstimate, ...]:
        """Estimates of all steps so far, and of those to come where these were estimated."""
        return (*self.monitor.estimates, *(self.pilots or ()))

    def too_coarse(self) -> bool:
        """Whether any step estimated so far misses the tolerance."""
        return any(not e.largest <= self.goal for e in self._estimates)

    def refined_mesh(self) -> tuple[int, ...] | None:
        """Elements per bay of a finer mesh; None where the limit is reached."""
        order = error_order(self.simulation.handle)
        finer = refined(self.elements_per_bay, self._estimates, self.goal, order)
        return None if finer == self.elements_per_bay else finer

    def result(
        self, model: Model, wall_time: float, findings: Findings, further: Sequence[str] = ()
    ) -> SequenceResult:
        """What was solved; its warnings are issued, but for those on the input.

        Parameters
        ----------
        model
            As the user gave it.
        wall_time
            [s].
        findings
            On the input.
        further
            Other warnings.
        """
        simulation, estimates = self.simulation, self.monitor.estimates
        handle, settings = simulation.handle, simulation.settings
        steps = tuple(_with_estimate(*each) for each in zip_longest(self.solved, estimates))
        of_mesh = mesh_warnings(handle, model, estimates, settings.mesh_tolerance)
        warnings = [*self.warnings, *of_mesh, *further, *strain_warnings(handle.robot, steps)]
        issue(warnings)
        return SequenceResult(
            robot=handle.robot,
            model=model,
            steps=steps,
            converged=self.message == CONVERGED,
            message=self.message,
            failed_step=self.next_step,
            wall_time=wall_time,
            warnings=(*findings.warnings, *warnings),
            remarks=tuple(findings.remarks),
            settings=asdict(settings),
            elements_per_bay=self.elements_per_bay,
        )


def _with_estimate(step: StepResult, estimate: MeshEstimate | None) -> StepResult:
    """A step with its discretisation error, where that was estimated."""
    if estimate is None:
        return step
    load = float(estimate.bay_loads.max())
    return replace(step, discretisation_error=estimate.largest, buckling_load_fraction=load)


Run = TypeVar("Run", bound=MeshedRun)


def refined_runs(
    begin: Callable[[tuple[int, ...], Run | None], Run], counts: tuple[int, ...], automatic: bool
) -> tuple[list[Run], KeyboardInterrupt | None]:
    """Runs on finer and finer meshes, until the error of the mesh is met, and what interrupted the last one.

    Parameters
    ----------
    begin
        Makes a run from its elements per bay and the run on the coarser mesh, which the first one has none of.
    counts
        Elements per bay of the first one.
    automatic
        Whether the mesh is refined.
    """
    runs: list[Run] = []
    while True:
        run = begin(counts, runs[-1] if runs else None)
        runs.append(run)
        try:
            finer = run.take_steps(automatic and len(runs) < MOST_MESHES)
        except KeyboardInterrupt as stop:
            run.message = INTERRUPTED
            return runs, stop
        if finer is None:
            return runs, None
        counts = finer


class _Run(MeshedRun):
    """One run through a loading sequence with one mesh."""

    def __init__(self, request: _Request, counts: tuple[int, ...], before: _Run | None) -> None:
        experiment, model = request.experiment, replace(request.experiment.model, elements_per_bay=counts)
        simulation = Simulation(experiment.robot, model, request.targets, request.settings)
        super().__init__(simulation, counts, len(experiment.steps))
        self.request, self.steps = request, experiment.steps
        self.history: SensitivityHistory | None = None
        if request.parameters:
            meshed = replace(experiment, model=model)
            history = SensitivityHistory.of(self.simulation, meshed, request.parameters)
            self.history = replace(history, curvatures=request.curvatures)
        self.path: PathRecord = []
        self.compression = ExternalCompression.of(self.simulation)
        self.unstable: list[int] = []
        # A refined mesh is one for the steps to come as well.
        self.pilots = None if before is None else []
        #: States that are near the ends of the steps, from which their solutions begin.
        self.warm_starts = {} if before is None else before.warm_starts_on(self.simulation)

    def take_steps(self, refine: bool) -> tuple[int, ...] | None:
        """See `MeshedRun.take_steps`."""
        request, estimated = self.request, isfinite(self.goal)
        for number, (step, target) in enumerate(zip(self.steps, request.targets, strict=True), start=1):
            if number - 1 in request.experiment.restarts:
                self.simulation.return_to(self.begin)
                if self.history is not None:
                    self.history.begin_anew()
            try:
                near = self._near(number, step.substeps)
                report = self.simulation.advance(target, step.substeps, near, self._follow)
                if refine:
                    self._keep_warm_start(number, report)
                result = self._result(number, step, report, target)
            except StepFailed as failure:
                self.end_at(step, failure)
                break
            self.solved.append(result)
            examined = request.reference_path is None
            if report.unstable or (
                examined and buckled_under_loads(self.simulation, self.compression, result)
            ):
                self.unstable.append(number)
            self.warnings.extend(step_warnings(number, report))
            if estimated and self._enough_estimated(number, report, refine) and refine and self.too_coarse():
                finer = self.refined_mesh()
                if finer is not None:
                    return finer
                refine = False
            if request.progress is not None:
                request.progress(self.solved[-1])
        self.monitor.flush()
        return self.refined_mesh() if refine and self.too_coarse() else None

    def _near(self, number: int, substeps: int | None) -> Sequence[Increment]:
        """States near the solution of a load step: of the reference path, or from a coarser mesh."""
        if self.request.reference_path is not None:
            return self.request.reference_path[number - 1]
        warm = self.warm_starts.get(number)
        return () if warm is None or substeps is not None else (Increment(1.0, warm),)

    def _follow(self, solved: SolvedLoadStep) -> None:
        """Record the path of a load step, and differentiate along it."""
        if self.request.records:
            self.path.append(solved.path.recorded())
        if self.history is not None:
            self.history.advance(solved)

    def _enough_estimated(self, number: int, report: LoadStepReport, refine: bool) -> bool:
        """Record the solved state for the estimate of the mesh; return whether there are new estimates.

        Before much is spent on friction paths, the steps that are left are solved whole, so that a mesh that is too
        coarse for them is refined at once: without it, 24 random robots take 1.3 times as long.
        """
        changed = self.monitor.record()
        costly = report.iterations_total > report.iterations
        if not refine or self.pilots is not None or not costly or number == self.count:
            return changed
        self.monitor.flush()
        self.pilots = [] if self.too_coarse() else self._pilot(number)
        return True

    def _pilot(self, solved: int) -> list[MeshEstimate]:
        """Estimates for the steps after those solved, each solved whole, whatever its friction path.

        The state is as before; those of the steps to come are kept, as near those that they will have.
        """
        start, monitor = self.simulation.position, MeshMonitor(self.simulation, self.goal)
        try:
            for number, target in enumerate(self.request.targets[solved:], start=solved + 1):
                report = self.simulation.advance(target, substeps=1)
                monitor.record()
                self._keep_warm_start(number, report)
        except StepFailed:
            pass
        monitor.flush()
        self.simulation.return_to(start)
        return monitor.estimates

    def _keep_warm_start(self, number: int, report: LoadStepReport) -> None:
        """Keep the present state as near the end of a step; not after a snap-through, which must be found again."""
        if report.snapped or report.presliding_factor > 1.0:
            self.warm_starts.pop(number, None)
        else:
            self.warm_starts[number] = self.simulation.state.stored()

    def warm_starts_on(self, finer: Simulation) -> dict[int, StoredState]:
        """The states of the steps as far as they are known, on a finer mesh."""
        old, new = (run.handle.mesh.arc_lengths for run in (self.simulation, finer))
        return {n: state.on_mesh(old, new) for n, state in self.warm_starts.items()}

    def _result(self, number: int, step: LoadStep, report: LoadStepReport, target: Actuation) -> StepResult:
        """The present state as a result, with the responses of the tip where they are asked for."""
        found = self.simulation.result(number, step.label, report, target)
        if not self.request.responses:
            return found
        responses = tuple(local_response(self.simulation, reversal=x) for x in (False, True))
        return replace(found, responses=responses)


__all__ = ["PathRecord", "Simulation", "SolverSettings", "StepFailed", "simulate"]
