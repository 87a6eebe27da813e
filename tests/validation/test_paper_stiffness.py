"""Section 3.4: the stiffness from loads and displacements, on data from the reference."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_fe.io.toml import read_robot
from tdcr_fe.io.write_toml import robot_to_toml
from tdcr_fe.validation.paper.cases import prototype
from tdcr_fe.validation.paper.studies.stiffness import (
    bending_stiffness_of_tip,
    identify_stiffness,
    validation_error,
    with_identified_stiffness,
)
from tdcr_fe.validation.paper.studies.stiffness_study import made_experiments

ANGLES = np.arange(8) * np.pi / 4.0
FORCES = 2e-3 * np.stack((np.cos(ANGLES), np.sin(ANGLES)), axis=1)
DECLARED = prototype(1)
TRUE = DECLARED.with_backbone(bending_stiffness=1.35 * DECLARED.backbone.EI)


def displacements(robot, forces, error=0.0):
    return made_experiments(robot, np.pad(forces, ((0, 0), (0, 1))), error)[:, :2]


@pytest.fixture(scope="module")
def measured():
    return displacements(TRUE, FORCES, error=5e-5)


def test_equation_38_is_solved_exactly_without_noise():
    """A known stiffness matrix is recovered to round-off."""
    k = np.array([[2.0, 0.3, 0.1], [0.3, 1.5, -0.2], [0.1, -0.2, 4.0]])
    u = np.random.default_rng(0).standard_normal((12, 3))
    found = identify_stiffness(u @ k.T, u, 0.0)
    assert found.matrix == pytest.approx(k, abs=1e-12)
    assert found.residual < 1e-12


def test_stiffness_of_the_reference_is_found_to_one_per_cent(measured):
    found = with_identified_stiffness(DECLARED, identify_stiffness(FORCES, measured))
    assert pytest.approx(TRUE.backbone.EI, rel=0.01) == found.backbone.EI
    assert pytest.approx(1.35 * DECLARED.backbone.GJ, rel=0.01) == found.backbone.GJ


def test_equation_40_predicts_a_new_load(measured):
    new = np.array([[1.1e-3, -1.7e-3]])
    assert validation_error(identify_stiffness(FORCES, measured), new[0], displacements(TRUE, new)[0]) < 0.01


def test_identified_robot_goes_into_robot_toml(measured, tmp_path):
    found = with_identified_stiffness(DECLARED, identify_stiffness(FORCES, measured))
    (tmp_path / "robot.toml").write_text(robot_to_toml(found), encoding="utf-8")
    assert read_robot(tmp_path / "robot.toml") == found


def test_equation_39_shrinks_the_stiffness(measured):
    free = identify_stiffness(FORCES, measured, 0.0)
    held = identify_stiffness(FORCES, measured, 1.0)
    assert np.linalg.norm(held.matrix) < 0.01 * np.linalg.norm(free.matrix)


def test_regularisation_makes_an_unloaded_direction_harmless():
    """Forces along x alone: without lambda it is refused, with it the stiffness along x is right."""
    forces = np.array([[1e-3, 0.0], [2e-3, 0.0], [-1e-3, 0.0]])
    moved = forces / 0.7
    with pytest.raises(ValueError, match="do not span all directions"):
        identify_stiffness(forces, moved, 0.0)
    found = identify_stiffness(forces, moved, 1e-12)
    assert found.matrix[0, 0] == pytest.approx(0.7, rel=1e-5)


def test_tip_stiffness_of_a_cantilever_is_inverted_exactly():
    rod = TRUE.backbone
    transverse = 1.0 / (rod.length**3 / (3.0 * rod.EI) + rod.length / rod.GA)
    assert bending_stiffness_of_tip(transverse, TRUE) == pytest.approx(rod.EI, rel=1e-12)


def test_impossible_stiffness_is_refused():
    with pytest.raises(ValueError, match="shear alone"):
        bending_stiffness_of_tip(1e9, TRUE)


def test_shapes_must_match():
    with pytest.raises(ValueError, match="must be the same"):
        identify_stiffness(np.zeros((3, 2)), np.zeros((3, 3)))
