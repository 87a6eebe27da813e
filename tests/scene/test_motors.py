"""Motors with inertia that wind tendons, in Exudyn's dynamics."""

from __future__ import annotations

from dataclasses import replace

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
import pytest
from native_solvers import recommended
from robots import BACKBONE, LENGTH, Robot, paper, scene

from tdcr_fe.model.robot import Disks
from tdcr_fe.model.routing import ParallelRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.solve.statics import SolveTDCR

EA, INERTIA, RADIUS, TORQUE = 400.0, 1e-4, 0.01, 1e-3


def test_a_motor_swings_on_its_elastic_tendon_as_a_single_oscillator():
    """A straight, stiff backbone: ``omega = r sqrt(EA / (L J))``, 6.37 Hz, about the angle where tension is torque."""
    stiff = replace(BACKBONE, radius=4e-3)
    straight = Tendon("t1", ParallelRouting(1e-4, 0.0), axial_stiffness=EA)
    robot = Robot(stiff, Disks.equally_spaced(4, LENGTH, mass=1e-3), (straight,), name="stiff")
    _keep, mbs, handle = scene(robot, assemble=False, friction="none")
    motor = handle.add_motor("t1", INERTIA, RADIUS)
    marker = mbs.AddMarker(eii.MarkerNodeCoordinate(nodeNumber=motor, coordinate=0))
    load = mbs.AddLoad(eii.LoadCoordinate(markerNumber=marker, load=TORQUE))
    angle = mbs.AddSensor(
        eii.SensorNode(
            nodeNumber=motor, outputVariableType=exu.OutputVariableType.Coordinates, storeInternal=True
        )
    )
    mbs.Assemble()
    assert mbs.GetLoadParameter(load, "load") == TORQUE
    settings = recommended(handle, 0.4, 1e-3)
    settings.solution.sensors.writePeriod = 1e-3
    mbs.SolveDynamic(settings)
    time, moved = np.array(mbs.GetSensorStoredData(angle)).T
    rest = TORQUE / (RADIUS**2 * EA / LENGTH)
    omega = RADIUS * np.sqrt(EA / (LENGTH * INERTIA))
    expected = rest * (1.0 - np.cos(omega * time))
    assert np.abs(moved - expected).max() < 0.005 * rest
    assert handle.tensions()["t1"][0] == pytest.approx(moved[-1] * RADIUS * EA / LENGTH, rel=5e-3)


def test_what_does_not_turn_motors_refuses_them_and_wrong_arguments_are_named():
    _keep, mbs, handle = scene(paper(0.0), assemble=False)
    for arguments, words in (
        (("x", 1.0, 1.0), "no tendon 'x'"),
        (("t1", 0.0, 1.0), "inertia = 0.0"),
        (("t1", 1.0, -1.0), "radius = -1.0"),
    ):
        with pytest.raises(ValueError, match=words):
            handle.add_motor(*arguments)
    handle.add_motor("t1", INERTIA, RADIUS)
    with pytest.raises(ValueError, match="has a motor already"):
        handle.add_motor("t1", INERTIA, RADIUS)
    mbs.Assemble()
    with pytest.raises(ValueError, match="SolveTDCR: a tendon of robot 'paper' is wound by a motor"):
        SolveTDCR(mbs)
