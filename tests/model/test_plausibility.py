"""Implausible values cause a warning by name before solving; values of real robots do not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from robots import BACKBONE, LENGTH, paper, solve, three

import tdcr_fe
from tdcr_fe.io.toml import read_robot, read_scenario
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.plausibility import plausibility_warnings, strain_warnings
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.validation.crosscheck import cases as crosscheck
from tdcr_fe.validation.paper import cases as paper_cases

DATA = Path(tdcr_fe.__file__).parent / "data" / "demo"
PULL = [LoadStep(tensions={"t1": 1.0})]
WITHOUT_MASS = paper(backbone=replace(BACKBONE, density=0.0)).with_disks(mass=0.0)


def scaled(factor):
    """The paper's robot with every length of disks and routing multiplied, and the backbone's length."""
    disks = Disks.equally_spaced(13, factor * LENGTH, radius=factor * 5e-3)
    return Robot(replace(BACKBONE, length=factor * LENGTH, radius=factor * 0.4e-3), disks)


@pytest.mark.parametrize(
    ("robot", "model", "steps", "words"),
    [
        # The review's examples, all of which ended with exit status 0 and no word in 0.1.
        (paper(backbone=replace(BACKBONE, radius=0.5)), Model(), PULL,
         ["backbone.radius = 0.5 m", "not thinner than its disks", "meant in mm?"]),
        (scaled(800.0), Model(), [], ["backbone.length = 200 m", "was it meant in mm?"]),
        (paper(backbone=replace(BACKBONE, youngs_modulus=60.0)), Model(), [],
         ["backbone.youngs_modulus = 60 Pa", "was it meant in GPa?"]),
        (WITHOUT_MASS, Model(gravity=(0.0, 0.0, -9.81)), PULL,
         ["model.gravity = [0.0, 0.0, -9.81]", "nothing has mass"]),
        (paper(), Model(), [LoadStep(tensions={"t1": 500.0})], ["steps[0].tensions.t1 = 500 N", "strain"]),
        (paper(), Model(), [*PULL, LoadStep(loads={"tip": Load(LENGTH, (1e4, 0.0, 0.0))})],
         ["steps[1].loads.tip.force: 10000 N", "EI/L^2"]),
        # Others.
        (paper(backbone=replace(BACKBONE, density=6.5)), Model(), [],
         ["backbone.density = 6.5 kg/m^3", "was it meant in g/cm^3?"]),
        (paper(backbone=replace(BACKBONE, youngs_modulus=1e13)), Model(), [], ["above 1e+12 Pa"]),
        (paper(backbone=replace(BACKBONE, radius=1e-7)), Model(), [], ["backbone.radius", "times as large"]),
        (paper(), Model(gravity=(0.0, 0.0, -9810.0)), [], ["1000 times that of the earth"]),
        (paper(axial_stiffness=100.0), Model(), [LoadStep(tensions={"t1": 30.0})],
         ["steps[0].tensions.t1 = 30 N", "strains the tendon by 30 %"]),
        (paper(axial_stiffness=100.0), Model(), [LoadStep(displacements={"t1": 5.0})],
         ["steps[0].displacements.t1 = 5 m", "was it meant in mm?"]),
        (paper(), Model(), [LoadStep(loads={"tip": Load(LENGTH, moment=(0.0, 1e3, 0.0))})],
         ["steps[0].loads.tip.moment: 1000 N m"]),
    ],
)  # fmt: skip
def test_value_that_no_robot_has_is_warned_of_by_name(robot, model, steps, words):
    found = plausibility_warnings(robot, model, steps)
    assert any(all(w in sentence for w in words) for sentence in found), found


def test_disks_larger_than_the_robot_are_warned_of():
    (found,) = plausibility_warnings(paper().with_disks(radius=5.0), Model(), [])
    assert found.startswith("disks.radius = 5 m") and found.endswith("was it meant in mm?")


@pytest.mark.parametrize("robot", [paper(), paper(0.3), three(), paper(axial_stiffness=400.0)])
@pytest.mark.parametrize("tension", [1.0, 10.0])
def test_robots_of_the_tests_give_no_warning(robot, tension):
    steps = [LoadStep(tensions={"t1": tension}), LoadStep(loads={"tip": Load(LENGTH, (0.0, 1.0, 0.0))})]
    assert plausibility_warnings(robot, Model(gravity=(0.0, 0.0, -9.81)), steps) == []


def test_demo_and_cases_of_the_paper_give_no_warning():
    folders = [DATA, *sorted((Path(paper_cases.__file__).parent / "data").iterdir())]
    seen = 0
    for folder in folders:
        if (folder / "scenario.toml").exists():
            s = read_scenario(folder / "scenario.toml")
            assert plausibility_warnings(s.robot, s.model, s.steps) == [], folder.name
        elif (folder / "robot.toml").exists():
            assert plausibility_warnings(read_robot(folder / "robot.toml"), Model(), []) == [], folder.name
        else:
            continue
        seen += 1
    assert seen >= 8


def test_cases_of_the_cross_validation_give_no_warning():
    for case in crosscheck.all_cases():
        assert plausibility_warnings(case.robot, case.model, case.steps) == [], case.id


def test_strain_of_a_solved_arc_is_curvature_times_radius():
    """A moment M at the tip bends the rod to kappa = M / EI; the strain of the surface is kappa r (closed form)."""
    thick = replace(BACKBONE, radius=4e-3)
    robot = Robot(thick, Disks.equally_spaced(13, LENGTH, radius=5e-3))
    for strain, count in ((0.19, 0), (0.21, 1)):
        moment = strain / thick.radius * thick.EI
        result = solve(
            robot, [LoadStep(loads={"m": Load(LENGTH, moment=(0.0, moment, 0.0))})], friction="none"
        )
        found = strain_warnings(robot, result.steps)
        assert len(found) == count
    assert f"by {100 * strain:.3g} %" in found[0] and found[0].startswith("step 1: bending strains")


def test_the_turn_of_a_base_that_gives_way_is_no_strain_of_the_backbone():
    """It was reported as a strain of 756 % at s = 2.5e-06 m."""
    moment = 0.05 * BACKBONE.EI / BACKBONE.radius
    robot = Robot(BACKBONE, Disks.equally_spaced(13, LENGTH, radius=5e-3), base_stiffness=moment / 0.5)
    result = solve(robot, [LoadStep(loads={"m": Load(LENGTH, moment=(0.0, moment, 0.0))})], friction="none")
    assert result.converged
    assert strain_warnings(robot, result.steps) == []


def test_a_modulus_that_is_too_small_for_the_tensions_is_named():
    """60 GPa given as 60e3: above that of silicone, so that only the tensions show it."""
    robot = three()
    soft = replace(robot, backbone=replace(robot.backbone, youngs_modulus=6e4))
    (found,) = [w for w in plausibility_warnings(soft, Model(), [LoadStep(tensions={"t1": 2.0})])]
    assert found.startswith("steps[0].tensions.t1 = 2 N: by itself it strains the backbone by ")
    assert found.endswith(" % (backbone.youngs_modulus = 60000 Pa)")
