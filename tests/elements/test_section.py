"""Classical tendons along the backbone and superelastic softening, as section forces."""

from dataclasses import replace

import numpy as np
import pytest
from robots import BACKBONE, DISKS, LENGTH, solve
from scipy.optimize import brentq

from tdcr_fe.elements.section import (
    ContinuousTendons,
    NonlinearSection,
    SectionForces,
    gauss_arc_lengths,
)
from tdcr_fe.model.backbone import Superelastic
from tdcr_fe.model.loading import Load, LoadStep
from tdcr_fe.model.robot import Robot

NODES = np.array([0.0, 0.02, 0.05, 0.09])
LENGTHS = np.diff(NODES)


def helix() -> ContinuousTendons:
    """One turn over 0.09 m, in beam axes; the second tendon ends after two elements."""
    s = gauss_arc_lengths(NODES)
    w = 2 * np.pi / 0.09
    zero = np.zeros_like(s)
    offset = 4e-3 * np.stack((zero, np.cos(w * s), np.sin(w * s)), axis=-1)
    slope = 4e-3 * w * np.stack((zero, -np.sin(w * s), np.cos(w * s)), axis=-1)
    return ContinuousTendons(
        np.stack((offset, offset)), np.stack((slope, slope)), np.array([[1, 1, 1], [1, 1, 0.0]])
    )


def twists(seed: int) -> np.ndarray:
    strain = np.array([1.0, 0, 0, 0, 0, 0]) + np.random.default_rng(seed).normal(size=(3, 6)) * [
        1e-3, 1e-3, 1e-3, 5.0, 5.0, 5.0,
    ]  # fmt: skip
    return strain * LENGTHS[:, None]


@pytest.mark.parametrize("seed", range(4))
def test_gradient_of_the_length_against_differences(seed):
    x = twists(seed)
    _, gradient = helix().evaluate(x, LENGTHS)
    h = 1e-6
    for e in range(3):
        for c in range(6):
            d = np.zeros_like(x)
            d[e, c] = h
            change = (helix().evaluate(x + d, LENGTHS)[0] - helix().evaluate(x - d, LENGTHS)[0]) / (2 * h)
            assert gradient[:, e, c] == pytest.approx(change, abs=1e-9)


def test_superelastic_robot_under_a_tip_moment_is_an_arc_of_the_softened_curvature():
    """Constant moment, constant curvature k with M(k) = M; k from the law written out here."""
    strain, ratio, m = 0.002, 0.3, 1.2e-2
    robot = Robot(replace(BACKBONE, superelastic=Superelastic(strain, ratio)), DISKS, ())
    kc = strain / BACKBONE.radius
    w = kc / 40

    def law(k):
        soft = k - w * (np.logaddexp(0, (k - kc) / w) - np.logaddexp(0, -kc / w))
        return BACKBONE.EI * (ratio * k + (1 - ratio) * soft) - m

    k = brentq(law, 0.0, 10 * kc)
    assert k > 1.2 * kc
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
