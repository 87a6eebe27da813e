"""`SolveTDCR` continues from the state that Exudyn's dynamics ended with."""

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
import pytest

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.disks import Disks
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.routing import ParallelRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.native import register

register()


@pytest.fixture
def scene():
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    robot = Robot(
        backbone=Backbone(0.25, 0.4e-3, 85e9, 0.3, 5600.0),
        disks=Disks.equally_spaced(5, 0.25, mass=0.5e-3),
        tendons=(Tendon("t", ParallelRouting(4.5e-3), friction_coefficient=0.3),),
    )
    arm = mbs.CreateTDCR(robot, Model(elements_per_bay=1))
    ground = mbs.CreateGround()
    fixed = mbs.AddMarker(eii.MarkerBodyPosition(bodyNumber=ground, localPosition=[0.0, 0.0, 0.25]))
    drag = eii.CartesianSpringDamper(markerNumbers=[fixed, arm.mTip], stiffness=[0.0] * 3, damping=[0.02] * 3)
    mbs.AddObject(drag)
    mbs.Assemble()
    return container, mbs, arm


def test_statics_after_dynamics_begin_at_the_last_tension_of_the_dynamics(scene):
    _, mbs, arm = scene
    arm.set_tensions([2.0])
    mbs.SolveTDCR()
    pulled = arm.tip_position

    arm.set_inputs_over_time(lambda t: [2.0 - 1.2 * min(t, 1.0) ** 2 * (3.0 - 2.0 * min(t, 1.0))])
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps = 300
    settings.timeIntegration.endTime = 2.0
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.6
    settings.timeIntegration.newton.relativeTolerance = 1e-6
    settings.timeIntegration.newton.absoluteTolerance = 1e-8
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    mbs.SolveDynamic(settings)
    assert arm.tensions()["t"][0] == pytest.approx(0.8, abs=1e-12)

    arm.set_tensions([0.8])
    seen = []
    mbs.SetPreStepUserFunction(lambda mbs, t: bool(seen.append(arm.tensions()["t"][0])) or True)
    mbs.SolveTDCR(substeps=4)
    np.testing.assert_allclose(seen, 0.8, rtol=0, atol=1e-12)
    # Friction opposes the release: the robot stays more bent than one that was never pulled farther.
    released = arm.tip_position
    arm.set_tensions([0.0])
    mbs.SolveTDCR()
    arm.set_tensions([0.8])
    mbs.SolveTDCR()
    assert pulled[0] > released[0] > arm.tip_position[0] + 1e-3
