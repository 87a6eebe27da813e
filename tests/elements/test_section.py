"""Superelastic softening, as section forces."""

from dataclasses import replace

import numpy as np
import pytest
from robots import BACKBONE, DISKS, LENGTH, solve

from tdcr_fe.elements.section import NonlinearSection, SectionForces
from tdcr_fe.model.backbone import Superelastic
from tdcr_fe.model.loading import Load, LoadStep
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.reference.section import bending_moment


def test_superelastic_robot_under_a_tip_moment_is_an_arc_of_the_softened_curvature():
    """Constant moment, constant curvature k with M(k) = M, by the law as the reference has it."""
    law, k = Superelastic(0.002, 0.3), 12.0
    (m,), _ = bending_moment(np.array([k]), np.array([BACKBONE.EI]), law, BACKBONE.radius)
    assert BACKBONE.EI * k > 1.2 * m
    robot = Robot(replace(BACKBONE, superelastic=law), DISKS, ())
    step = solve(robot, [LoadStep("", loads={"tip": Load(LENGTH, moment=(0.0, m, 0.0))})]).steps[0]
    assert np.trace(step.rotations[-1]) == pytest.approx(1 + 2 * np.cos(k * LENGTH), abs=1e-7)
    assert step.tip[0] == pytest.approx((1 - np.cos(k * LENGTH)) / k, abs=1e-7)


@pytest.mark.parametrize("length", [2e-2, 2e-6])
def test_tangent_of_the_nonlinear_section_is_its_stiffness_in_elements_of_any_length(length):
    """Moments in the node in front change by stiffness over length, also where two nodes nearly coincide."""
    law = NonlinearSection(*np.array([[36.0], [1.3e-4], [3.8e-3], [-1.6], [2.5]]), np.zeros((1, 3)))
    lengths = np.array([length, 0.1])
    twists = lengths[:, None] * np.array([[1.01, 0.0, 0.0, 0.0, 4.0, -7.0], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    exact = law.stiffness(*law.strain(twists[:1], lengths[:1]))[0] / length
    tangent = SectionForces(lengths, material=law).wrench_tangent(twists, np.zeros(0))[0]
    which = np.ix_([6, 10, 11], [6, 10, 11])
    # The wrench also turns with the node, which is small beside the stiffness of so short an element.
    assert tangent[which] == pytest.approx(-exact, rel=1e-2, abs=1e-3 * np.abs(exact).max())
