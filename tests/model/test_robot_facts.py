"""Closed forms of the description: stiffness of the section, places of the holes."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_fe import Backbone, ConvergingRouting, Disks, HelicalRouting, ParallelRouting, Robot, Tendon

RADIUS, MODULUS, RATIO = 0.5e-3, 60e9, 0.25


def test_the_section_of_a_round_rod():
    """EI = E pi r^4/4, GJ = G pi r^4/2, EA = E pi r^2, GA = G pi r^2 without shear correction, as in the paper."""
    rod = Backbone(0.2, RADIUS, MODULUS, RATIO, density=6000.0)
    shear = 24e9
    assert pytest.approx(MODULUS * np.pi * RADIUS**4 / 4.0) == rod.EI
    assert pytest.approx(shear * np.pi * RADIUS**4 / 2.0) == rod.GJ
    assert pytest.approx(MODULUS * np.pi * RADIUS**2) == rod.EA
    assert pytest.approx(shear * np.pi * RADIUS**2) == rod.GA
    assert rod.mass_per_length == pytest.approx(6000.0 * np.pi * RADIUS**2)


@pytest.mark.parametrize(
    ("routing", "expected"),
    [
        (ParallelRouting(4e-3, 90.0), [[0.0, 4.0], [0.0, 4.0], [0.0, 4.0]]),
        (HelicalRouting(4e-3, 0.5, 90.0), [[0.0, 4.0], [-4.0, 0.0], [0.0, -4.0]]),
        (ConvergingRouting(4e-3, 1e-3, 180.0), [[-4.0, 0.0], [-2.5, 0.0], [-1.0, 0.0]]),
    ],
    ids=["parallel", "helical", "converging"],
)
def test_holes_are_where_the_angle_in_degrees_and_the_offset_say(routing, expected):
    """At the base plate, in the middle and at the tip [mm]."""
    robot = Robot(
        Backbone(0.2, RADIUS, MODULUS, RATIO), Disks.equally_spaced(2, 0.2), (Tendon("t", routing),)
    )
    assert 1e3 * robot.hole_points(robot.tendons[0])[:, :2] == pytest.approx(np.array(expected), abs=1e-12)
