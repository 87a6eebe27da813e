"""A base that gives way: closed forms and the reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from robots import BACKBONE, LENGTH, distance, solve, three

from tdcr_fe.effects import Experiment, with_effect
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.validation.reference import solve_reference

K = 0.02
BARE = Robot(BACKBONE, Disks.equally_spaced(5, LENGTH), base_stiffness=K)


def loaded(**load: tuple[float, float, float]) -> list[LoadStep]:
    """One step with a load at the tip."""
    return [LoadStep(loads={"tip": Load(LENGTH, **load)})]


def test_a_tip_moment_turns_base_and_backbone():
    moment = 5e-3
    found = solve(BARE, loaded(moment=(0.0, moment, 0.0)), friction="none").steps[0]
    assert found.bending_angle == pytest.approx(moment * (LENGTH / BACKBONE.EI + 1.0 / K), rel=1e-4)
    # The backbone is an arc from the turned base on.
    turn, kappa = moment / K, moment / BACKBONE.EI
    arc = np.array([(1.0 - np.cos(kappa * LENGTH)) / kappa, np.sin(kappa * LENGTH) / kappa])
    x = np.cos(turn) * arc[0] + np.sin(turn) * arc[1]
    assert found.tip[0] == pytest.approx(x, rel=1e-4)


def test_a_small_tip_force_deflects_the_tip_by_both_compliances():
    force = 1e-5
    found = solve(BARE, loaded(force=(0.0, force, 0.0)), friction="none", elements_per_bay=4).steps[0]
    expected = force * (LENGTH**3 / (3.0 * BACKBONE.EI) + LENGTH**2 / K)
    assert found.tip[1] == pytest.approx(expected, rel=1e-3)


@pytest.mark.integration
def test_tendons_and_friction_agree_with_the_reference():
    robot = with_effect(Experiment(three(0.2), Model(), ()), "base_compliance", stiffness=K).robot
    assert robot == replace(three(0.2), base_stiffness=K)
    steps = [LoadStep(tensions={"t1": 1.0, "t2": 0.3}), LoadStep(tensions={"t1": 0.5, "t3": 0.4})]
    ours = solve(robot, steps, elements_per_bay=2)
    theirs = solve_reference(robot, Model(), steps)
    assert theirs.converged, theirs.message
    assert distance(ours.tips, theirs.tips) < 1e-4
    assert distance(ours.tips, solve(three(0.2), steps, elements_per_bay=2).tips) > 0.05
