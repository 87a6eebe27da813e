"""What tendons and friction cost in Exudyn's own solvers: ratios within one process, and processor time."""

from __future__ import annotations

import time
from collections.abc import Callable

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
import pytest
from native_solvers import dynamic_settings
from robots import BACKBONE, DISKS, LENGTH, Robot, scene, tendon, three

from tdcr_fe.elements.native.actuation import TendonActuation
from tdcr_fe.native import register
from tdcr_fe.solve.statics import SolveTDCR

register()


def constant_forces(mbs, handle) -> None:
    """Springs of constant force in place of the tendons, and none of their functions."""
    tensions = handle.tensions()
    handle.actuation.disconnect()
    mbs.SetPostStepUserFunction(0)
    mbs.SetObjectParameter(handle.actuation.connectors.forces, "jacobianUserFunction", 0)
    for springs, values in zip(handle.oTendons, tensions.values(), strict=True):
        for spring, tension in zip(springs, values, strict=True):
            mbs.SetObjectParameter(spring, "force", float(tension))
            mbs.SetObjectParameter(spring, "activeConnector", True)


def time_of_a_step(count: int, change: Callable[[exu.MainSystem, object], None] | None) -> float:
    """Processor time of a step of 1 ms [s], 100 of them, in a swing under a sudden load at the tip."""
    tendons = tuple(tendon(f"t{i + 1}", 120.0 * i, 0.3) for i in range(count))
    _keep, mbs, handle = scene(Robot(BACKBONE, DISKS, tendons, name="robot"), assemble=False)
    load = handle.add_load("tip", LENGTH)
    mbs.Assemble()
    handle.set_tensions([1.0, 0.3, 0.2][:count])
    SolveTDCR(mbs)
    load.set([0.0, 0.005, 0.003])
    if change is not None:
        change(mbs, handle)
    settings = handle.recommended_settings(0.1, 1e-3)
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    assert settings.timeIntegration.newton.useModifiedNewton
    begun = time.process_time()
    assert mbs.SolveDynamic(settings)
    return (time.process_time() - begun) / mbs.sys["dynamicSolver"].it.currentStepIndex


@pytest.mark.campaign
@pytest.mark.parametrize("count", [1, 3])
def test_a_step_with_friction_over_one_with_constant_forces(count, figure):
    """The least of eight runs each, in turn; e3bbe5d took 6 times as long with one tendon, and 6 to 13 with three."""
    times = np.array([[time_of_a_step(count, x) for x in (None, constant_forces)] for _ in range(8)])
    friction, constant = times.min(axis=0)
    figure(f"step {count}", friction / constant)


@pytest.mark.campaign
def test_the_jacobian_is_evaluated_on_the_coordinates_of_the_robot_alone(monkeypatch, figure):
    """Beside a thousand mass points; the least of its times. e3bbe5d took 9.7 ms."""
    _keep, mbs, handle = scene(three(0.3), assemble=False)
    for i in range(1000):
        node = mbs.AddNode(eii.NodePoint(referenceCoordinates=[float(i), 1.0, 1.0]))
        mbs.AddObject(eii.MassPoint(nodeNumber=node, mass=1.0))
    mbs.Assemble()
    assert mbs.systemData.ODE2Size() > 3000
    evaluate, times = TendonActuation.jacobian_on_coordinates, []

    def timed(*arguments):
        begun = time.process_time()
        found = evaluate(*arguments)
        times.append(time.process_time() - begun)
        return found

    monkeypatch.setattr(TendonActuation, "jacobian_on_coordinates", timed)
    handle.set_inputs_over_time(lambda t: [20.0 * t, 0.0, 0.0])
    settings = dynamic_settings(0.01, 1e-3)
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.timeIntegration.newton.adaptInitialResidual = False
    assert mbs.SolveDynamic(settings)
    assert len(times) >= 10
    figure("jacobian", 1e3 * min(times))
