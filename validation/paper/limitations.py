"""Influence of what the paper neglects: disk thickness, nonlinear friction, dynamics, each on the robot of Fig. 3."""

from __future__ import annotations

from typing import Any

import exudyn as exu
import numpy as np

from tdcr_fe.model.friction import ForceDependentFriction
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.scene.builder import CreateTDCR
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.paper.cases import paper_case

#: Tension of the only tendon [N].
TENSION = 1.5
#: Times in which the tendon is pulled, time to wait, and time step [s].
RAMPS, REST, TIME_STEP = (0.3, 1.0, 3.0), 1.5, 5e-3


def changed_robots(robot: Robot) -> dict[str, Robot]:
    """The robot with thick disks, with adhesion, and with a coefficient that depends on the force across the hole."""
    disks = {f"disks {1e3 * t:g} mm thick": robot.with_disks(thickness=t) for t in (1e-3, 2e-3, 3e-3, 5e-3)}
    adhesion = {
        f"{1e3 * a:g} mN of adhesion at every hole": robot.with_tendons(adhesion=a)
        for a in (5e-3, 20e-3, 50e-3)
    }
    laws = {
        f"friction coefficient ~ force^-1/3, {mu:g} at {at:g} N": robot.with_tendons(
            friction_coefficient=0.0, friction=ForceDependentFriction(mu, at)
        )
        for mu, at in ((0.3, 0.1), (0.3, 0.4))
    }
    return {**disks, **adhesion, **laws}


def study_limitations() -> dict[str, Any]:
    """Distance of the tip from that of the model as it is in the paper, for each change."""
    robot = paper_case("fig3").robot
    pull = [LoadStep("pull", {robot.tendon_names[0]: TENSION})]
    base = simulate(robot, Model(), pull).steps[-1]
    rows = []
    for name, other in changed_robots(robot).items():
        step = simulate(other, Model(), pull).steps[-1]
        shift = float(np.linalg.norm(step.tip - base.tip))
        turn = float(np.rad2deg(step.bending_angle - base.bending_angle))
        share = 100.0 * shift / robot.backbone.length
        rows.append(
            {"change": name, "tip moves [mm]": 1e3 * shift, "% of length": share, "bending angle [deg]": turn}
        )
    return {"changes": rows}


def dynamic_run(robot: Robot, ramp: float) -> dict[str, float]:
    """The tendon pulled in finite time in Exudyn's implicit integrator, with no damping but friction.

    Returns
    -------
    dict
        "overshoot [mm]": largest excess of the tip over its quasi-static position, across the backbone; "left [mm]":
        distance of the tip from it, averaged over the last third of the rest.
    """
    model = Model("straight", "per-hole", 1)
    still = simulate(robot, model, [LoadStep("pull", {robot.tendon_names[0]: TENSION})]).steps[-1].tip
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    handle = CreateTDCR(mbs, robot, model, presliding=1e-5)
    sensors = handle.add_sensors()
    mbs.Assemble()

    def inputs(t: float) -> list[float]:
        x = min(t / ramp, 1.0)
        return [TENSION * x * x * (3.0 - 2.0 * x)]

    handle.set_inputs_over_time(inputs)
    settings = exu.SimulationSettings()
    integration = settings.timeIntegration
    integration.endTime = ramp + REST
    integration.numberOfSteps = round((ramp + REST) / TIME_STEP)
    integration.generalizedAlpha.spectralRadius = 0.6
    integration.newton.relativeTolerance, integration.newton.absoluteTolerance = 1e-6, 1e-8
    integration.verboseMode = 0
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = TIME_STEP
    mbs.SolveDynamic(settings)
    data = np.asarray(mbs.GetSensorStoredData(sensors["tip_position"]))
    times, tips = data[:, 0], data[:, 1:4]
    side = still[:2] / np.linalg.norm(still[:2])
    late = tips[times > ramp + 2.0 / 3.0 * REST].mean(axis=0)
    return {
        "pulled in [s]": ramp,
        "overshoot [mm]": 1e3 * float(np.max(tips[:, :2] @ side) - still[:2] @ side),
        "left [mm]": 1e3 * float(np.linalg.norm(late - still)),
    }


def study_dynamics() -> dict[str, Any]:
    """Pulls of different duration on the robot of Fig. 3."""
    robot = paper_case("fig3").robot
    return {"runs": [dynamic_run(robot, ramp) for ramp in RAMPS]}
