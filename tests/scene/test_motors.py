"""Motors with inertia that wind tendons, in Exudyn's dynamics."""

from __future__ import annotations

from dataclasses import replace

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
import pytest
from native_solvers import recommended
from robots import BACKBONE, LENGTH, Robot, paper, scene, three

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


def test_the_jacobian_has_the_motors():
    """By the angles of two motors, and of their torques by the positions of the nodes, against central differences."""
    _keep, mbs, handle = scene(three(0.2, axial_stiffness=EA), assemble=False)
    for name in ("t1", "t3"):
        handle.add_motor(name, INERTIA, RADIUS)
    mbs.Assemble()
    handle.set_displacements({"t1": 1e-3, "t3": 5e-4})
    actuation = handle.actuation
    count = 7 * len(handle.nNodes)
    rng = np.random.default_rng(0)
    start = np.zeros(count + 2)
    start[:count].reshape(-1, 7)[:, :3] = 1e-5 * rng.normal(size=(count // 7, 3))
    start[count:] = 0.05, 0.02

    def forces(q):
        return actuation.forces_on_coordinates(q.tolist(), 0.01)

    tangent = -np.array(
        actuation.jacobian_on_coordinates(start.tolist(), 0.01, 1.0, 0.0).Convert2DenseMatrix()
    )
    assert np.all(forces(start)[count:] < -0.01)
    for column, step in ((count, 1e-6), (count + 1, 1e-6), (35, 1e-8), (50, 1e-8)):
        shift = np.zeros(count + 2)
        shift[column] = step
        slope = (forces(start + shift) - forces(start - shift)) / (2.0 * step)
        rows = slice(None) if column >= count else slice(count, None)
        assert tangent[rows, column] == pytest.approx(slope[rows], abs=1e-4 * np.abs(slope[rows]).max())


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
