"""Scenes linearised: modes, gains and sensitivities, against closed forms, differences, and functions of Exudyn."""

from dataclasses import replace

import numpy as np
import pytest
from robots import BACKBONE, LENGTH, seven
from scenes import hinged_platform, pendulum, recommended, scene, scene_with, solve_scene, tip_sensor
from scipy.linalg import eig

from tdcr_fe import CreateTDCR, Disks, ParallelRouting, Robot, Tendon, simulate, track_sensitivities
from tdcr_fe.model.loading import Load, LoadStep, Model, SolverSettings
from tdcr_fe.model.robot import SideSpring

ELASTIC = {"axial_stiffness": 400.0}


# ---------------------------------------------------------------- modes


def frequencies(stiffness, mass, count: int) -> np.ndarray:
    """The lowest ones of a linear system [Hz]."""
    return np.sort(np.sqrt(np.abs(eig(stiffness, mass)[0])))[:count] / (2.0 * np.pi)


def test_modes_without_tension_are_those_of_a_cantilever_and_a_finer_mesh_lowers_them():
    """Backbone without masses on it: ``root^2 sqrt(EI / m) / (2 pi L^2)``, from above, with the square of the mesh.

    Time integration lowers frequencies, so that at a kept step a finer mesh may be worse. W. Weaver, S. P. Timoshenko,
    D. H. Young, Vibration Problems in Engineering, sec. 5.11.
    """
    robot, errors = seven(0.0).with_disks(mass=0.0), []
    unit = np.sqrt(robot.backbone.EI / robot.backbone.mass_per_length) / (2.0 * np.pi * LENGTH**2)
    for elements in (1, 2):
        _keep, mbs, _ = scene(robot, elements_per_bay=elements)
        modes = mbs.TDCREigenvalues(numberOfEigenvalues=6)
        assert np.abs(modes.shapes).max(axis=0) == pytest.approx(np.ones(6))
        expected = unit * np.repeat([1.875104, 4.694091, 7.854757], 2) ** 2
        errors.append(modes.frequencies / expected - 1.0)
    assert errors[1][:2] == pytest.approx([0.0, 0.0], abs=2e-3)
    assert errors[1][4:].min() > 3e-3
    assert errors[0][4:] / errors[1][4:] == pytest.approx([4.0, 4.0], rel=0.1)


@pytest.mark.parametrize(("mu", "rest"), [(0.0, {}), (0.3, {}), (0.0, ELASTIC)])
def test_linearised_systems_of_exudyn_have_the_same_frequencies(mu, rest):
    """`ComputeLinearizedSystem` and `ComputeODE2Eigenvalues` of a bent robot, its holes stuck at the bound of friction.

    Stiffness with friction is not symmetric, as the latter assumes unless complex eigenvalues are asked for. In 0.1
    the tendons were left out: 38 % less with tendons driven by displacement, 46 % less with stuck holes.
    """
    _keep, mbs, handle = scene(seven(mu, **rest))
    inputs, by = ([4e-3, -1.9e-3, -1.9e-3], "displacements") if rest else ([1.0, 0.2, 0.2], "tensions")
    solve_scene(mbs, handle, inputs, by=by)
    modes = mbs.TDCREigenvalues(holes="stuck", numberOfEigenvalues=4)
    expected = modes.frequencies
    assert np.all(modes.growth < 1e-3 * expected) or not rest
    mass, stiffness, _ = mbs.ComputeLinearizedSystem(projectIntoConstraintNullspace=True)[:3]
    assert frequencies(stiffness, mass, 4) == pytest.approx(expected, rel=1e-9)
    assert not rest or expected[1] > 1.4 * expected[0]
    rates = mbs.ComputeODE2Eigenvalues(computeComplexEigenvalues=True, useAbsoluteValues=False)[0]
    assert np.sort(np.abs(np.imag(rates)))[:8:2] / (2.0 * np.pi) == pytest.approx(expected, rel=1e-4)


def test_the_scene_is_left_as_it_was():
    _keep, mbs, handle = scene(seven(0.3))
    solve_scene(mbs, handle, [1.0, 0.0, 0.0])
    before = np.concatenate(mbs.systemData.GetSystemState())
    modes = mbs.TDCREigenvalues()
    assert np.array_equal(np.concatenate(mbs.systemData.GetSystemState()), before)
    tip = handle.tip_position
    modes.show(mbs, 0, 0.01)
    assert np.linalg.norm(handle.tip_position - tip) > 1e-3
    modes.hide(mbs, 0, 0.01)
    assert handle.tip_position == pytest.approx(tip, abs=1e-15)


# ---------------------------------------------------------------- linear system


PULLS = [
    (0.0, 1e-6, "tensions", [1.0, 0.3, 0.2], 1e-3),
    (0.0, 1e-6, "displacements", [4e-3, -1.5e-3, -1.9e-3], 1e-6),
    (0.3, 1e-3, "tensions", [0.02, 0.005, 0.01], 1e-4),
]


@pytest.mark.parametrize(("mu", "presliding", "drive", "bent", "size"), PULLS)
def test_the_static_gain_is_what_statics_give(mu, presliding, drive, bent, size):
    """Change of the tip by a small change of each input: 1e-4 of the largest.

    With friction the presliding distance is so long that all holes stick.
    """
    robot = seven(mu, **({} if mu else ELASTIC))
    driven = {"by": drive, "settings": SolverSettings(presliding=presliding)}
    _keep, mbs, handle, sensor = scene_with(tip_sensor, robot, presliding=presliding)
    solve_scene(mbs, handle, bent, **driven)
    linear = mbs.TDCRLinearized(holes="stuck", sensors=[sensor])
    gain, (a, b, c) = linear.static_gain(), linear.state_space()
    assert -c @ np.linalg.solve(a, b) == pytest.approx(gain, abs=1e-6 * np.abs(gain).max())
    assert linear.input_names == ("three.t1", "three.t2", "three.t3")
    for k, step in enumerate(size * np.eye(3)):
        more, less = (solve_scene(mbs, handle, bent + x, **driven)[-1] for x in (step, -step))
        expected = (more - less) / (2.0 * size)
        near = gain[:, k] == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())
        assert near if gain[:, k].any() else np.abs(expected).max() < 1e-11  # a slack tendon: round-off


def test_a_viscoelastic_rod_without_tendons_has_the_poles_of_a_cantilever():
    """``s^2 + tau omega^2 s + omega^2 = 0`` in its first three modes; without tendons it has no inputs.

    Damping proportional to the stiffness leaves the modes as they are. W. Weaver, S. P. Timoshenko, D. H. Young,
    Vibration Problems in Engineering, sec. 4.7 and 5.11.
    """
    tau = 1e-3
    rod = replace(seven(0.0).with_backbone(retardation_time=tau).with_disks(mass=0.0), tendons=())
    _keep, mbs, _ = scene(rod, elements_per_bay=2)
    a, b, _ = mbs.TDCRLinearized().state_space()
    assert b.shape[1] == 0
    line = rod.backbone.mass_per_length * LENGTH**4
    omega = np.repeat([1.875104, 4.694091, 7.854757], 4) ** 2 * np.sqrt(rod.backbone.EI / line)
    poles = np.linalg.eigvals(a)
    first = poles[np.argsort(np.abs(poles))[:12]]
    assert np.abs(first) == pytest.approx(omega, rel=2e-2)
    assert np.abs(first[:4]) == pytest.approx(omega[:4], rel=2e-3)
    assert first.real == pytest.approx(-0.5 * tau * np.abs(first) ** 2, rel=1e-3)


def test_a_robot_ten_times_as_large_swings_at_a_tenth_of_the_frequency():
    """Its inextensible tendons driven by displacement, too: with EA of 1e5 N in every size it was 2 % less."""
    found = []
    for size in (1.0, 10.0):
        tendons = tuple(Tendon(f"t{k}", ParallelRouting(4.5e-3 * size, 120.0 * k)) for k in range(3))
        disks = Disks.equally_spaced(7, LENGTH * size, mass=0.3e-3 * size**3, radius=5e-3 * size)
        backbone = replace(BACKBONE, length=LENGTH * size, radius=0.4e-3 * size)
        _keep, mbs, handle = scene(Robot(backbone, disks, tendons, name="scaled"))
        solve_scene(mbs, handle, size * np.array([4e-3, -1.5e-3, -1.9e-3]), by="displacements")
        found.append(size * mbs.TDCREigenvalues(numberOfEigenvalues=3).frequencies)
    assert found[1] == pytest.approx(found[0], rel=1e-5)


def test_a_pendulum_that_carries_a_robot_has_the_frequency_of_its_weight():
    """``omega^2 = m g l / J``; it had no stiffness, and 0.02 Hz. The stiff robot of 0.2 g changes it by 1e-3.

    After a dynamic run, of which the forces of joints have another sign, the pendulum was unstable.
    """
    robot = seven(0.0).with_backbone(radius=2e-3, density=10.0).with_disks(mass=1e-5)
    _keep, mbs, handle, _ = pendulum(robot)
    mbs.SolveTDCR()
    expected = np.sqrt(9.81 * 0.1 / (0.1**2 + (0.2**2 + 0.02**2) / 12.0)) / (2.0 * np.pi)
    for _ in range(2):
        assert mbs.TDCREigenvalues(numberOfEigenvalues=1).frequencies[0] == pytest.approx(expected, rel=2e-3)
        assert mbs.SolveDynamic(recommended(handle, 1e-2, 1e-3))


def test_the_gain_has_forces_that_turn_with_their_section():
    """Of a robot bent by such a force, against differences of `SolveTDCR`: it was twice as large."""
    _keep, mbs, handle, (sensor, load) = scene_with(
        lambda mbs, handle: (tip_sensor(mbs, handle), handle.add_load("tip", LENGTH, "section")), seven(0.0)
    )
    load.set([0.05, 0.02, 0.0], [0.0, 0.0, 1e-3])
    solve_scene(mbs, handle, [0.5, 0.1, 0.1])
    gain = mbs.TDCRLinearized(sensors=[sensor]).static_gain()[:, 0]
    less, more = (solve_scene(mbs, handle, [0.5 + x, 0.1, 0.1])[-1] for x in (-1e-4, 1e-4))
    expected = (more - less) / 2e-4
    assert gain == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("rest", [{}, ELASTIC], ids=["inextensible", "elastic"])
def test_after_slip_the_gain_is_that_of_a_pull_that_goes_on_and_with_stuck_holes_that_of_a_release(rest):
    """A controller moves the tendons at once: with stuck holes the tip would seem to move by less than half of that."""
    _keep, mbs, handle, sensor = scene_with(tip_sensor, seven(0.3, **rest), presliding=1e-5)

    def tip(tension):
        return solve_scene(mbs, handle, [tension, 0.0, 0.0], settings=SolverSettings(presliding=1e-5))[-1]

    before, there = tip(1.0), tip(1.001)
    found = [mbs.TDCRLinearized(sensors=[sensor], **x) for x in ({}, {"holes": "stuck"})]
    sliding, stuck = (x.static_gain()[:, 0] for x in found)
    pulled, released = (there - before) / 1e-3, (there - tip(1.001 - 1e-5)) / 1e-5
    assert sliding == pytest.approx(pulled, abs=1e-2 * np.abs(pulled).max())
    assert stuck == pytest.approx(released, abs=1e-3 * np.abs(released).max())
    assert np.abs(stuck).max() < 0.6 * np.abs(sliding).max()


# ------------------------------------------------------------ sensitivities


SETTINGS = SolverSettings(tolerance=1e-11)
NAMES = ["backbone.youngs_modulus", "tendons.friction_coefficient", "inputs.t1", "loads.tip.force_y"]
NAMES += ["backbone.length", "springs[0].stiffness"]


def test_a_robot_alone_has_the_derivatives_of_simulate():
    """Wherever its base is: springs to ground are at rest where the unloaded robot is. Also beside another robot.

    A force that turns with the tip has both solved together. After it, this ended in an error of `zip`.
    """
    robot = replace(seven(0.3), springs=(SideSpring(0.15, 1.5),))
    pulls = [{"t1": 1.0, "t2": 0.3}, {"t1": 0.6}, {"t1": 0.9}]
    loads = [Load(LENGTH, (0.0, f, 0.0), frame="section") for f in (0.0, 0.02, 0.0)]
    both = zip(pulls, loads, strict=True)
    steps = [LoadStep("", pull, loads={"tip": load}, substeps=2) for pull, load in both]
    expected = simulate(robot, Model(elements_per_bay=1), steps, SETTINGS, sensitivities=NAMES).sensitivities
    at = {"referencePosition": [0.1, 0.05, 0.2]}
    _keep, mbs, arm, tip = scene_with(lambda mbs, arm: arm.add_load("tip", LENGTH, "section"), robot, **at)
    CreateTDCR(mbs, seven(0.3), arm.model, name="other")
    mbs.Assemble()
    tracked = track_sensitivities(arm, NAMES)
    for step in steps:
        arm.set_tensions(step.tensions)
        tip.set(step.loads["tip"].force)
        mbs.SolveTDCR(SETTINGS, substeps=2, sensitivities=[tracked])
    result = tracked.result()
    for name in NAMES:
        for kind in ("positions", "tensions"):
            found, known = (np.array(getattr(x[name], kind)) for x in (result, expected))
            np.testing.assert_allclose(found, known, rtol=0.0, atol=1e-7 * np.abs(known).max())


@pytest.mark.parametrize("field", ["youngs_modulus", "radius"])
def test_the_platform_that_gives_way_and_another_robot_are_in_the_derivative(field):
    """Against central differences of whole solutions; the weight of the robot turns the platform.

    Of another robot on a spring some holes stick, and remember where they were: without that it was 18 % off. Several
    robots with friction, and a base that gives way, ended in errors of shapes.
    """
    robot = replace(seven(0.2), base_stiffness=0.5)
    value = getattr(robot.backbone, field)

    def solved(factor: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Shapes after two pulls, and their derivatives."""
        _keep, mbs, platform = hinged_platform(0.5)
        model = Model(elements_per_bay=1, gravity=(9.81, 0.0, 0.0))
        arm = CreateTDCR(mbs, robot.with_backbone(**{field: value * factor}), model, baseMarker=platform)
        other = CreateTDCR(mbs, seven(0.3), model, referencePosition=[0.05, 0.0, 0.0], name="other")
        mbs.CreateCartesianSpringDamper(itemNumbers=[arm.mTip, other.mTip], stiffness=[3.0] * 3)
        mbs.Assemble()
        tracked, shapes = track_sensitivities(arm, [f"backbone.{field}"]), []
        for tension in (0.8, 0.5):
            arm.set_tensions({"t1": tension})
            other.set_tensions({"t1": 1.0 + 0.1 * tension})
            mbs.SolveTDCR(SETTINGS, substeps=4, sensitivities=[tracked])
            shapes.append(arm.shape()[0])
        return np.array(shapes), tracked.result()[f"backbone.{field}"].positions

    h = 1e-4
    found, expected = solved()[1], (solved(1.0 + h)[0] - solved(1.0 - h)[0]) / (2.0 * h * value)
    assert np.abs(found - expected).max() < 1e-5 * np.abs(expected).max()
