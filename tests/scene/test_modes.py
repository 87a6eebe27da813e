"""Eigenfrequencies of bent robots by `TDCREigenvalues`, against the spectrum of a swing in `mbs.SolveDynamic`."""

from __future__ import annotations

import numpy as np
import pytest
from native_solvers import dynamic_settings
from robots import LENGTH, Robot, scene, three
from scipy.linalg import eig

from tdcr_fe.model.settings import SolverSettings
from tdcr_fe.native import register
from tdcr_fe.solve.statics import SolveTDCR

register()


def swinging(robot: Robot, friction: str, drive: str, inputs, force, end: float = 1.5):
    """A robot at rest after a pull, its modes in two ways, and the frequency of its swing under a force at the tip.

    The spectrum is that of a time [s] in which modes that are near each other must come apart.
    """
    _keep, mbs, handle = scene(robot, assemble=False, friction=friction)
    load = handle.add_load("tip", LENGTH)
    sensor = handle.add_sensors()["tip_position"]
    mbs.Assemble()
    (handle.set_displacements if drive == "displacement" else handle.set_tensions)(inputs)
    SolveTDCR(mbs)
    stuck, sliding = (mbs.TDCREigenvalues(holes=holes) for holes in ("stuck", "sliding"))
    load.set(force)
    step = 2e-3
    settings = dynamic_settings(end, step)
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.98
    settings.timeIntegration.newton.relativeTolerance = 1e-5
    settings.solution.sensors.writePeriod = step
    assert mbs.SolveDynamic(settings)
    data = mbs.GetSensorStoredData(sensor)[:, 1 + int(np.argmax(np.abs(force)))]
    window = np.hanning(len(data)) * (data - data.mean())
    spectrum = np.abs(np.fft.rfft(window, 64 * len(data)))
    return stuck, sliding, np.fft.rfftfreq(64 * len(data), step)[np.argmax(spectrum)]


def test_a_tendon_driven_by_displacement_makes_the_robot_stiffer(figure):
    """Elastic tendons, no friction: the mode in the plane of the pull. e3bbe5d left the tendons out: 38 % less."""
    robot = three(0.0, axial_stiffness=400.0)
    modes, _, swing = swinging(robot, "none", "displacement", [4e-3, -1.9e-3, -1.9e-3], [1e-3, 0.0, 0.0])
    figure("mode driven", abs(modes.frequencies[1] / swing - 1.0))
    assert modes.frequencies[1] > 1.4 * modes.frequencies[0]
    assert np.all(modes.growth < 1e-3 * modes.frequencies)


def test_a_free_robot_swings_with_its_first_frequency(figure):
    """Tendons driven by tension, no friction, in the plane of the pull and across it."""
    for force, mode in (([0.0, 1e-3, 0.0], 0), ([1e-3, 0.0, 0.0], 1)):
        modes, _, swing = swinging(three(0.0), "none", "tension", [1.0, 0.2, 0.2], force)
        figure("mode free", abs(modes.frequencies[mode] / swing - 1.0))


def test_stuck_holes_make_the_robot_stiffer(figure):
    """A swing of a few micrometres, across the plane of the pull, so small that no hole slips.

    e3bbe5d gave the frequency of the robot without friction, 46 % less.
    """
    pull, force = [1.0, 0.2, 0.2], [0.0, 1e-6, 0.0]
    stuck, sliding, swing = swinging(three(0.3), "per-hole", "tension", pull, force, end=3.0)
    figure("mode stuck", abs(stuck.frequencies[0] / swing - 1.0))
    assert sliding.frequencies[0] < 0.75 * stuck.frequencies[0]


@pytest.mark.parametrize(("mu", "drive"), [(0.0, "tension"), (0.3, "tension"), (0.0, "displacement")])
def test_linearised_systems_of_exudyn_have_the_same_frequencies(mu, drive):
    """`ComputeLinearizedSystem` and `ComputeODE2Eigenvalues` of a bent robot, its holes stuck at the bound of friction.

    Stiffness with friction is not symmetric, as the latter assumes unless complex eigenvalues are asked for. e3bbe5d
    knew nothing of the tendons; the one-sided derivative gave 4.4 Hz in place of 4.9.
    """
    _keep, mbs, handle = scene(three(mu, **({"axial_stiffness": 400.0} if drive == "displacement" else {})))
    if drive == "tension":
        handle.set_tensions([1.0, 0.2, 0.2])
    else:
        handle.set_displacements([4e-3, -1.9e-3, -1.9e-3])
    SolveTDCR(mbs)
    expected = mbs.TDCREigenvalues(holes="stuck", numberOfEigenvalues=4).frequencies
    mass, stiffness, _ = mbs.ComputeLinearizedSystem(projectIntoConstraintNullspace=True)[:3]
    found = np.sort(np.sqrt(np.abs(eig(stiffness, mass)[0])))[:4] / (2.0 * np.pi)
    assert found == pytest.approx(expected, rel=1e-9)
    rates = mbs.ComputeODE2Eigenvalues(computeComplexEigenvalues=True, useAbsoluteValues=False)[0]
    found = np.sort(np.abs(np.imag(rates)))[:8:2] / (2.0 * np.pi)
    assert found == pytest.approx(expected, rel=1e-4)
    if mu == 0.0:
        found = mbs.ComputeODE2Eigenvalues(convert2Frequencies=True, numberOfEigenvalues=4)[0]
        assert found == pytest.approx(expected, rel=1e-4)


def test_before_anything_slips_stuck_holes_are_the_derivative_of_the_forces():
    """A pull within the presliding: exactly the linearised system that Exudyn gives."""
    _keep, mbs, handle = scene(three(0.3), presliding=1e-3)
    handle.set_tensions([0.02, 0.0, 0.01])
    SolveTDCR(mbs, SolverSettings(presliding=1e-3))
    assert np.abs(handle.actuation.state.mobilisation).max() < 1.0
    found = mbs.TDCREigenvalues(holes="stuck", numberOfEigenvalues=6).frequencies
    mass, stiffness, _ = mbs.ComputeLinearizedSystem(projectIntoConstraintNullspace=True)[:3]
    expected = np.sort(np.sqrt(np.abs(eig(stiffness, mass)[0])))[:6] / (2.0 * np.pi)
    assert found == pytest.approx(expected, rel=1e-6)


def test_first_modes_without_tension_are_those_of_a_cantilever():
    """Free backbone without masses on it: ``1.8751^2 sqrt(EI / m) / (2 pi L^2)``.

    W. Weaver, S. P. Timoshenko, D. H. Young, Vibration Problems in Engineering, sec. 5.11.
    """
    robot = three(0.0).with_disks(mass=0.0)
    _keep, mbs, _ = scene(robot, elements_per_bay=2)
    backbone = robot.backbone
    first = 1.875104**2 * np.sqrt(backbone.EI / backbone.mass_per_length) / (2.0 * np.pi * LENGTH**2)
    modes = mbs.TDCREigenvalues(numberOfEigenvalues=2)
    assert modes.frequencies == pytest.approx([first, first], rel=2e-3)
    assert np.abs(modes.shapes).max(axis=0) == pytest.approx([1.0, 1.0])


def test_the_scene_is_left_as_it_was_and_wrong_arguments_are_refused():
    _keep, mbs, handle = scene(three(0.3))
    handle.set_tensions([1.0, 0.0, 0.0])
    SolveTDCR(mbs)
    before = [np.concatenate(mbs.systemData.GetSystemState())]
    mbs.TDCREigenvalues()
    assert np.array_equal(np.concatenate(mbs.systemData.GetSystemState()), before[0])
    with pytest.raises(ValueError, match="must be 'stuck' or 'sliding'"):
        mbs.TDCREigenvalues(holes="free")
