"""Damping by the material of the backbone (Kelvin-Voigt, ``retardation_time``) in Exudyn's own solvers."""

from __future__ import annotations

from dataclasses import replace

import exudyn as exu
import numpy as np
import pytest
from native_solvers import dynamic_settings
from robots import BACKBONE, LENGTH, Robot, scene, three
from scipy.optimize import curve_fit

from tdcr_fe.elements.poses import euler_rate_matrix
from tdcr_fe.model.robot import Disks
from tdcr_fe.native import register
from tdcr_fe.solve.statics import SolveTDCR

register()


def viscous(robot: Robot, time: float, **rest) -> Robot:
    """The robot with a retardation time [s]."""
    return replace(robot, backbone=replace(robot.backbone, retardation_time=time, **rest))


def rod(time: float) -> Robot:
    """A backbone with five disks that have no mass, and no tendon."""
    return viscous(Robot(BACKBONE, Disks.equally_spaced(5, LENGTH, radius=1e-3), (), name="rod"), time)


# ---------------------------------------------------------------- closed form


@pytest.mark.parametrize(
    ("mode", "root", "elements"),
    [
        (1, 1.8751041, 2),
        pytest.param(2, 4.6940911, 4, marks=pytest.mark.integration),
        pytest.param(3, 7.8547574, 8, marks=pytest.mark.integration),
    ],
)
def test_bending_modes_decay_as_those_of_a_viscoelastic_cantilever(mode, root, elements):
    """A mode of angular frequency ``w`` falls as ``exp(-tau w^2 t / 2)`` and swings at ``w sqrt(1 - (tau w / 2)^2)``.

    ``w = root^2 sqrt(EI / m) / L^2``; W. Weaver, S. P. Timoshenko, D. H. Young, Vibration Problems in Engineering,
    sec. 5.11; damping proportional to the stiffness leaves the modes as they are (sec. 4.7). Within 0.5 % here.
    """
    w = root**2 * np.sqrt(BACKBONE.EI / BACKBONE.mass_per_length) / LENGTH**2
    tau = 0.1 / w  # 5 % of critical damping
    _keep, mbs, handle = scene(rod(tau), assemble=False, elements_per_bay=elements)
    sensor = handle.add_sensors()["tip_position"]
    mbs.Assemble()
    shape = mbs.TDCREigenvalues(numberOfEigenvalues=2 * mode).shapes[:, 2 * mode - 1]
    mbs.systemData.SetODE2Coordinates((1e-4 * LENGTH * shape).tolist(), exu.ConfigurationType.Initial)
    period = 2.0 * np.pi / w
    settings = dynamic_settings(3.0 * period, period / 100)
    settings.timeIntegration.generalizedAlpha.spectralRadius = 1.0
    settings.timeIntegration.newton.relativeTolerance = 1e-8
    settings.solution.sensors.writePeriod = period / 100
    assert mbs.SolveDynamic(settings)
    data = mbs.GetSensorStoredData(sensor)
    x = data[:, 1:3] @ shape[handle.actuation.coordinates[-1, :2]]

    def decaying(t, amplitude, decay, frequency, phase):
        return amplitude * np.exp(-decay * t) * np.cos(frequency * t + phase)

    damped_frequency = w * np.sqrt(1.0 - (tau * w / 2.0) ** 2)
    start = [np.abs(x).max(), tau * w**2 / 2.0, damped_frequency, 0.0]
    (_, decay, frequency, _), _ = curve_fit(decaying, data[:, 0], x, start)
    assert decay == pytest.approx(tau * w**2 / 2.0, rel=1e-2)
    assert frequency == pytest.approx(damped_frequency, rel=3e-3)


def test_a_rigid_motion_of_a_bent_robot_is_not_damped():
    """Translation and rotation of the whole robot, against a bending of its last element at the same rates."""
    _keep, mbs, handle = scene(viscous(three(0.0), 1e-2))
    handle.set_tensions([1.5, 0.2, 0.0])
    SolveTDCR(mbs)
    positions, rotations, parameters = handle.actuation.scene_poses()
    spin, speed = np.array([3.0, -2.0, 5.0]), np.array([0.3, 0.1, -0.2])
    own_spin = (rotations.swapaxes(1, 2) @ spin[:, None])[:, :, 0]
    velocity = np.zeros((len(positions), 7))
    velocity[:, :3] = speed + np.cross(spin, positions)
    velocity[:, 3:] = (euler_rate_matrix(parameters) @ own_spin[:, :, None])[:, :, 0]
    bending = velocity.copy()
    bending[:-1] = 0.0
    rigid, bent = (wrenches(mbs, handle, v) for v in (velocity, bending))
    assert np.abs(rigid).max() < 1e-3 * np.abs(bent).max()


def wrenches(mbs, handle, velocity):
    """Wrenches of the dampers at velocities of the coordinates, in their middle [N, N m], shape (E, 6)."""
    mbs.systemData.SetODE2Coordinates_t(velocity.ravel())
    kinds = exu.OutputVariableType.ForceLocal, exu.OutputVariableType.TorqueLocal
    found = [[mbs.GetObjectOutput(i, kind) for kind in kinds] for i in handle.damping.dampers]
    return np.array(found).reshape(-1, 6)


# ---------------------------------------------------------------- statics
