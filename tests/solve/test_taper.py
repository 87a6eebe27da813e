"""Tapered backbones: a closed form, the order of convergence, the reference, the file."""

from __future__ import annotations

from dataclasses import replace

import pytest
from robots import BACKBONE, LENGTH, distance, solve, three

from tdcr_fe.io.problems import InputError
from tdcr_fe.io.toml import read_robot
from tdcr_fe.io.write_toml import robot_to_toml
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.reference import solve_reference

R0, R1 = 0.4e-3, 0.2e-3
CONE = replace(BACKBONE, taper=((0.0, R0), (LENGTH, R1)))
BARE = Robot(CONE, Disks.equally_spaced(5, LENGTH))
STEPS = [
    LoadStep(tensions={"t1": 0.3, "t2": 0.1, "t3": 0.1}),
    LoadStep(tensions={"t1": 0.4}, loads={"tip": Load(LENGTH, (0.002, 0.003, 0.0))}),
    LoadStep(tensions={"t1": 0.2, "t2": 0.2}),
]


def test_a_tip_moment_turns_a_cone_by_the_integral_of_its_compliance():
    """The integral of r^-4 along a cone gives L / EI0 q (q^2 + q + 1) / 3 with q = R0 / R1."""
    moment, q = 1e-3, R0 / R1
    found = solve(BARE, [LoadStep(loads={"tip": Load(LENGTH, moment=(0.0, moment, 0.0))})], friction="none")
    expected = moment * LENGTH / BACKBONE.EI * q * (q**2 + q + 1.0) / 3.0
    assert found.steps[0].bending_angle == pytest.approx(expected, rel=1e-4)


@pytest.mark.integration
@pytest.mark.parametrize("path", ["straight", "continuous"])
def test_tapered_robots_converge_to_the_reference_with_order_two(path):
    robot = three(0.2).with_backbone(taper=((0.0, R0), (0.1, 0.35e-3), (LENGTH, R1)))
    model = Model(path, "none", gravity=(0.0, 3.0, -9.81))
    exact = solve_reference(robot, model, STEPS[:2])
    assert exact.converged, exact.message
    found = []
    for n in (1, 2, 4, "auto"):
        run = simulate(robot, replace(model, elements_per_bay=n), STEPS[:2])
        assert run.converged, run.message
        found.append(run.tips)
    ratio = distance(found[0], found[1]) / distance(found[1], found[2])
    assert 3.5 < ratio < 4.6
    assert distance(found[2], exact.tips) < 2e-4 and distance(found[3], exact.tips) < 2e-4


def test_a_taper_goes_through_the_file_as_radius(tmp_path):
    file = tmp_path / "robot.toml"
    file.write_text(robot_to_toml(BARE))
    assert f"radius = [[0.0, {R0}], [{LENGTH}, {R1}]]" in file.read_text()
    assert read_robot(file) == BARE


@pytest.mark.parametrize(
    ("radius", "text"),
    [
        ("[[0.0, 1e-3], [0.2, 5e-4]]", "ascend from 0 to the length"),
        ("[[0.0, 1e-3], [0.25, -5e-4]]", "radii above 0"),
        ("[[0.0, 1e-3]]", "ascend from 0"),
        ("[0.0, 1e-3]", "number"),
    ],
)
def test_a_taper_that_is_none_is_refused_by_name(tmp_path, radius, text):
    file = tmp_path / "robot.toml"
    file.write_text(robot_to_toml(BARE).replace(f"[[0.0, {R0}], [{LENGTH}, {R1}]]", radius))
    with pytest.raises(InputError, match=r"backbone\.radius") as found:
        read_robot(file)
    assert text in str(found.value)
