"""Influence of what the paper neglects: disk thickness, nonlinear friction, dynamics, each on one of its cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.friction import TendonLaw
from tdcr_fe.model.loading import LoadStep, Model, resolve
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.scene.builder import CreateTDCR
from tdcr_fe.solve.simulate import Simulation, simulate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Influence:
    """Influence of one change on the tip.

    Attributes
    ----------
    name : str
    tip_shift : float
        Distance of the tip from that of the model as it is in the paper [m].
    percent : float
        The same in per cent of the length.
    angle_shift : float
        Change of the bending angle [rad].
    """

    name: str
    tip_shift: float
    percent: float
    angle_shift: float


def influence(name: str, base: StepResult, changed: StepResult, length: float) -> Influence:
    """Compare two states."""
    shift = float(np.linalg.norm(changed.tip - base.tip))
    return Influence(name, shift, 100.0 * shift / length, changed.bending_angle - base.bending_angle)


def _variants(robot: Robot, steps: Sequence[LoadStep], changed: Mapping[str, Robot]) -> list[Influence]:
    """Robots, by what was changed, against the case as it is."""
    base = simulate(robot, Model(), steps).steps[-1]
    return [
        influence(name, base, simulate(other, Model(), steps).steps[-1], robot.backbone.length)
        for name, other in changed.items()
    ]


def disk_thickness(robot: Robot, steps: Sequence[LoadStep], thicknesses: Sequence[float]) -> list[Influence]:
    """Disks that make their own length of backbone rigid.

    Parameters
    ----------
    robot, steps
        The case; its last step is compared.
    thicknesses
        Of each disk [m].
    """
    return _variants(
        robot, steps, {f"disks {1e3 * t:g} mm thick": robot.with_disks(thickness=t) for t in thicknesses}
    )


def adhesion(robot: Robot, steps: Sequence[LoadStep], drops: Sequence[float]) -> list[Influence]:
    """A tension drop at every hole that does not grow with the tension.

    Parameters
    ----------
    robot, steps
        The case; its last step is compared.
    drops
        At each hole [N].
    """
    return _variants(
        robot,
        steps,
        {f"{1e3 * a:g} mN of adhesion at every hole": robot.with_tendons(adhesion=a) for a in drops},
    )


@dataclass(frozen=True)
class PressureDependence:
    """A friction coefficient that depends on the force across the hole, ``mu (N / N_0)^exponent``, within limits.

    Attributes
    ----------
    exponent : float
        -1/3 is that of an elastic contact whose shear strength is constant (F. P. Bowden, D. Tabor, The Friction
        and Lubrication of Solids, 1950) [1].
    reference : float
        ``N_0``, where the coefficient is the declared one [N].
    largest : float
        Limit of the coefficient [1].
    """

    exponent: float = -1.0 / 3.0
    reference: float = 0.1
    largest: float = 0.9

    def coefficient(self, declared: Array, force: Array) -> Array:
        """At every hole [1]; forces across the holes [N], both of shape (m, n-1)."""
        ratio = np.maximum(force / self.reference, 1e-6)
        return np.where(declared > 0.0, np.minimum(declared * ratio**self.exponent, self.largest), 0.0)


def pressure_dependent_friction(
    robot: Robot, step: LoadStep, law: PressureDependence, tolerance: float = 1e-6
) -> Influence:
    """Friction coefficients that follow from the forces across the holes, by repeated substitution.

    Parameters
    ----------
    robot
        The case.
    step
        One monotone load step.
    law
        See `PressureDependence`.
    tolerance
        Largest change of a coefficient in the last repetition [1].

    Raises
    ------
    RuntimeError
        The fixed-point iteration does not converge.
    """
    targets = resolve(robot, [step])
    base = simulate(robot, Model(), [step]).steps[-1]
    coefficients: Array | None = None
    for _ in range(60):
        simulation = Simulation(robot, Model(), targets)
        forces = simulation.handle.actuation
        declared = forces.law.parameters.friction
        if coefficients is not None:
            forces.model = replace(forces.model, law=_with_friction(forces.law, coefficients))
        report = simulation.advance(targets[0])
        solved = forces.current_forces()
        across = 2.0 * solved.field.tension[:, 1:] * np.sin(0.5 * solved.measured.shape.angles)
        new = law.coefficient(declared, across)
        converged = coefficients is not None and float(np.max(np.abs(new - coefficients))) < tolerance
        coefficients = new if coefficients is None else 0.5 * (coefficients + new)
        if converged:
            result = simulation.result(1, step.label, report)
            inside = new[declared > 0.0]
            name = (
                f"friction coefficient ~ force^{law.exponent:.2f}: {inside.min():.2f} to {inside.max():.2f} "
                "along the tendon"
            )
            return influence(name, base, result, robot.backbone.length)
    raise RuntimeError("the fixed-point iteration of the friction coefficients did not converge")


def _with_friction(law: TendonLaw, coefficients: Array) -> TendonLaw:
    return law.with_parameters(friction=coefficients)


@dataclass(frozen=True)
class DynamicRun:
    """The tendon pulled in finite time, in Exudyn's implicit integrator, nothing damping it but friction.

    Attributes
    ----------
    ramp : float
        Time in which the tension rises, smoothly [s].
    times : ndarray, shape (n,)
        [s].
    tips : ndarray, shape (n, 3)
        [m].
    overshoot : float
        Largest excess of the tip over its quasi-static position, across the backbone [m].
    left : float
        Distance of the tip, averaged over the last third of the run's rest, from the quasi-static one [m].
    swing : float
        Range of the tip's motion in that time [m].
    """

    ramp: float
    times: Array
    tips: Array
    overshoot: float
    left: float
    swing: float


def dynamic_run(
    robot: Robot,
    tension: float,
    ramp: float,
    rest: float = 1.5,
    step: float = 5e-3,
    friction: str = "per-hole",
) -> DynamicRun:
    """Pull the first tendon and wait.

    Parameters
    ----------
    robot
        The case; its first tendon is pulled.
    tension
        [N].
    ramp, rest, step
        Time of the pull, time to wait, and time step [s].
    friction
        As in `Model`.
    """
    name = robot.tendon_names[0]
    model = Model("straight", friction, 1)  # type: ignore[arg-type]
    still = simulate(robot, model, [LoadStep("pull", {name: tension})]).steps[-1]
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    handle = CreateTDCR(mbs, robot, model, presliding=1e-5)
    sensors = handle.add_sensors()
    mbs.Assemble()

    def inputs(t: float) -> list[float]:
        x = min(t / ramp, 1.0)
        return [tension * x * x * (3.0 - 2.0 * x), *([0.0] * (len(robot.tendons) - 1))]

    handle.set_inputs_over_time(inputs)
    settings = exu.SimulationSettings()
    integration = settings.timeIntegration
    integration.endTime = ramp + rest
    integration.numberOfSteps = round((ramp + rest) / step)
    integration.generalizedAlpha.spectralRadius = 0.6
    integration.newton.relativeTolerance, integration.newton.absoluteTolerance = 1e-6, 1e-8
    integration.verboseMode = 0
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = step
    mbs.SolveDynamic(settings)
    data = np.asarray(mbs.GetSensorStoredData(sensors["tip_position"]))
    times, tips = data[:, 0], data[:, 1:4]
    side = still.tip[:2] / np.linalg.norm(still.tip[:2])
    late = times > ramp + 2.0 / 3.0 * rest
    return DynamicRun(
        ramp,
        times,
        tips,
        float(np.max(tips[:, :2] @ side) - still.tip[:2] @ side),
        float(np.linalg.norm(tips[late].mean(axis=0) - still.tip)),
        float(np.max(np.ptp(tips[late], axis=0))),
    )
