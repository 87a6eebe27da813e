"""Loading sequences: from a description and load steps to solved steps."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from itertools import zip_longest
from math import isfinite
from typing import Any

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BEAM_TO_SECTION
from tdcr_fe.model import arguments
from tdcr_fe.model.loading import Actuation, LoadStep, Model, resolve
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.settings import SolverSettings
from tdcr_fe.scene import TDCR, CreateTDCR, PointLoad
from tdcr_fe.scene.mesh import elements_of_bays
from tdcr_fe.solve.mesh import (
    MOST_MESHES,
    MeshEstimate,
    MeshMonitor,
    error_order,
    mesh_warnings,
    refined,
)
from tdcr_fe.solve.solver import NotConverged, StrainSpaceSolver
from tdcr_fe.solve.stepping import Applied, LoadStepper, StepFailed, Waypoint

Array = NDArray[np.float64]
LoadKey = tuple[str, float, str]

#: By load step, the ends of its substeps with the states there.
Trajectory = list[list[Waypoint]]


class Simulation:
    """One robot alone on ground, taken through load steps.

    Parameters
    ----------
    robot, model
        Description.
    steps
        The loading sequence, resolved with `tdcr_fe.model.loading.resolve`; tells where nodes for loads are needed.
    settings
        Numerics.
    """

    def __init__(
        self, robot: Robot, model: Model, steps: Sequence[Actuation], settings: SolverSettings | None = None
    ) -> None:
        self.settings = settings or SolverSettings()
        keys = {self._key(name, load) for step in steps for name, load in step.loads.items()}
        # Exudyn's system container owns the system: it must live as long as we use it.
        self.container = exu.SystemContainer()
        mbs = self.container.AddSystem()
        self.handle: TDCR = CreateTDCR(
            mbs,
            robot,
            model,
            loadPositions=sorted({at for _, at, _ in keys}),
            presliding=self.settings.presliding,
        )
        self.loads: dict[LoadKey, PointLoad] = {
            key: self.handle.add_load(f"{key[0]}@{key[1]:g}.{key[2]}", key[1], key[2])  # type: ignore[arg-type]
            for key in sorted(keys)
        }
        mbs.Assemble()
        self.solver = StrainSpaceSolver(mbs, self.settings)
        self.stepper = LoadStepper(self.solver)
        self._applied: dict[LoadKey, Array] = {key: np.zeros(6) for key in keys}
        self._time = 0.0

    @staticmethod
    def _key(name: str, load: Any) -> LoadKey:
        return name, float(load.at), load.frame

    def advance(
        self,
        target: Actuation,
        substeps: int | None = None,
        guide: Sequence[Waypoint] | None = None,
        record: list[Waypoint] | None = None,
    ) -> Mapping[str, Any]:
        """Go to the end of a load step and commit its history.

        Parameters
        ----------
        target
            What acts at the end of the step.
        substeps
            Fixed number; None chooses by the error of the path.
        guide, record
            See `tdcr_fe.solve.stepping.LoadStepper.advance`.

        Returns
        -------
        mapping
            ``iterations``, ``substeps``, ``residual``.

        Raises
        ------
        StepFailed
            The state is then that of the last substep that converged.
        """
        robot = self.handle.actuation
        goal_loads = {key: np.zeros(6) for key in self._applied}
        for name, load in target.loads.items():
            goal_loads[self._key(name, load)] = np.array([*load.force, *load.moment])
        start_loads, start_time = self._applied, self._time
        change = any((goal_loads[key] != start_loads[key]).any() for key in goal_loads)
        creep = self.handle.robot.backbone.creep_rate != 0.0
        # Where a tendon changes from tension to displacement or back, the ramp begins at what it has now.
        now, changed = robot.input_values(), target.by_displacement != robot.by_displacement
        if changed.any():
            here = np.where(target.by_displacement, self.displacement, robot.base_tension)
            now = np.where(changed, here, now)
            robot.by_displacement = target.by_displacement.copy()

        def apply(share: float) -> Applied:
            largest = 0.0
            moment = start_time + share * (target.time - start_time)
            for key, item in self.loads.items():
                value = start_loads[key] + share * (goal_loads[key] - start_loads[key])
                item.set(value[:3], value[3:])
                largest = max(largest, float(np.max(np.abs(value[:3]))))
            if creep:
                self.handle.set_compliance_factor(self.handle.robot.backbone.compliance_factor(moment))
            robot.inputs = now + share * (target.values - now)
            return Applied([robot.inputs], largest, moment, change)

        report = self.stepper.advance(apply, substeps, guide, record)
        self._applied, self._time = goal_loads, target.time
        return report

    @property
    def displacement(self) -> Array:
        """Tendons pulled in at the base [m], shape (n_tendons,)."""
        return self.handle.actuation.displacements

    def result(
        self, number: int, label: str, report: Mapping[str, Any], target: Actuation | None = None
    ) -> StepResult:
        """The present state as a result."""
        handle = self.handle
        states, tensions = handle.hole_states(), handle.tensions()
        solver = self.solver
        return StepResult(
            step=number,
            label=label,
            converged=True,
            iterations=report["iterations"],
            substeps=report["substeps"],
            s=handle.arc_lengths.copy(),
            positions=solver.positions(0).copy(),
            rotations=solver.rotations(0) @ BEAM_TO_SECTION.T,
            base_tensions=handle.actuation.base_tension.copy(),
            displacements=self.displacement,
            tensions=tuple(tensions[n] for n in handle.robot.tendon_names),
            hole_states=tuple(states[n] for n in handle.robot.tendon_names),
            residual=report["residual"],
            actuation=target,
            details={k: v for k, v in report.items() if k not in ("iterations", "substeps", "residual")},
        )


def _warnings(number: int, report: Mapping[str, Any]) -> list[str]:
    found = []
    if report["snapped"]:
        found.append(
            f"step {number}: no equilibrium followed the path; the robot snapped through to another one, found "
            "by damped relaxation"
        )
    if report["presliding_factor"] > 1.0:
        found.append(
            f"step {number}: holes did not settle; their presliding distance was taken "
            f"{report['presliding_factor']:g} times as large in a substep"
        )
    if report["path_error"] > 0.0:
        found.append(
            f"step {number}: the path through the holes' states is not resolved; dividing the step further still "
            f"moved a node by {report['path_error']:.1e} of the length"
        )
    return found


def simulate(
    robot: Robot,
    model: Model,
    steps: Sequence[LoadStep],
    settings: SolverSettings | None = None,
    progress: Callable[[StepResult], None] | None = None,
    *,
    guide: Trajectory | None = None,
    record: Trajectory | None = None,
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
    guide
        Trajectory of a similar run of the same number of steps, for sensitivities: the same substeps are taken,
        each from the guide's state, which costs about two iterations a substep.
    record
        An empty trajectory to fill, as a later guide.

    Returns
    -------
    SequenceResult
        Where a step fails, or the user interrupts, all steps before it, and a message.

    Raises
    ------
    TypeError
        An argument is of another type; the message says what is expected and what to call.
    ValueError
        The description contradicts itself (see `tdcr_fe.model.loading.resolve` and `tdcr_fe.scene.builder.CreateTDCR`).
    """
    arguments.check_robot("simulate", robot)
    arguments.check_model("simulate", model)
    arguments.check_steps("simulate", steps)
    arguments.check_settings("simulate", settings)
    settings = settings or SolverSettings()
    begun = time.perf_counter()
    targets = resolve(robot, steps)
    counts = elements_of_bays(robot, model)
    automatic = model.elements_per_bay == "auto" and guide is None
    for meshes in range(1, MOST_MESHES + 1):
        if record is not None:
            record.clear()
        run = _Run(robot, replace(model, elements_per_bay=counts), steps, targets, settings, progress)
        finer = run.take_steps(guide, record, automatic and meshes < MOST_MESHES)
        if finer is None:
            break
        counts = finer
    estimates = run.monitor.estimates
    warnings = run.warnings + mesh_warnings(run.simulation.handle, model, estimates, settings.mesh_tolerance)
    return SequenceResult(
        robot=robot,
        model=model,
        steps=tuple(_estimated(step, e) for step, e in zip_longest(run.solved, estimates)),
        converged=run.failed is None,
        message=run.message,
        failed_step=run.failed,
        wall_time=time.perf_counter() - begun,
        warnings=tuple(warnings),
        settings=asdict(settings),
        elements_per_bay=counts,
    )


def _estimated(step: StepResult, estimate: MeshEstimate | None) -> StepResult:
    """A step with its discretisation error, where that was estimated."""
    if estimate is None:
        return step
    return replace(
        step,
        discretisation_error=estimate.largest,
        buckling_load_fraction=float(estimate.bay_loads.max()),
    )


class _Run:
    """One run through a loading sequence with one mesh."""

    def __init__(
        self,
        robot: Robot,
        model: Model,
        steps: Sequence[LoadStep],
        targets: Sequence[Actuation],
        settings: SolverSettings,
        progress: Callable[[StepResult], None] | None,
    ) -> None:
        self.steps, self.targets, self.progress = steps, targets, progress
        self.simulation = Simulation(robot, model, targets, settings)
        self.tolerance = settings.mesh_tolerance
        self.goal = self.tolerance * robot.backbone.length
        self.monitor = MeshMonitor(self.simulation.handle, self.simulation.solver, self.goal)
        self.solved: list[StepResult] = []
        self.warnings: list[str] = []
        self.failed: int | None = None
        self.message = "all steps converged"

    def take_steps(
        self, guide: Trajectory | None, record: Trajectory | None, refine: bool
    ) -> tuple[int, ...] | None:
        """Solve all steps; or return the elements per bay of the finer mesh that they need."""
        estimated = isfinite(self.tolerance)
        for number, (step, target) in enumerate(zip(self.steps, self.targets, strict=True), start=1):
            try:
                waypoints: list[Waypoint] = []
                report = self.simulation.advance(
                    target, step.substeps, None if guide is None else guide[number - 1], waypoints
                )
                if record is not None:
                    record.append(waypoints)
            except StepFailed as failure:
                label = f" ({step.label})" if step.label else ""
                self.failed, self.message = number, f"step {number}{label} did not converge: {failure}"
                break
            except KeyboardInterrupt:
                self.failed, self.message = number, "interrupted"
                return None
            if estimated and self.monitor.record() and refine and self._too_coarse():
                return self._finer()
            self.solved.append(self.simulation.result(number, step.label, report, target))
            self.warnings += _warnings(number, report)
            if self.progress is not None:
                self.progress(self.solved[-1])
        self.monitor.flush()
        return self._finer() if refine and self._too_coarse() else None

    def _too_coarse(self) -> bool:
        """Whether any step estimated so far misses the tolerance."""
        return any(not e.largest <= self.goal for e in self.monitor.estimates)

    def _finer(self) -> tuple[int, ...] | None:
        """Elements per bay of a finer mesh; None where the limit is reached."""
        counts = self.simulation.handle.model.elements_per_bay
        assert isinstance(counts, tuple)
        order = error_order(self.simulation.handle)
        finer = refined(counts, self.monitor.estimates, self.goal, order)
        return None if finer == counts else finer


__all__ = ["NotConverged", "Simulation", "SolverSettings", "Trajectory", "simulate"]
