"""Facts of the description: stiffness of the section, places of the holes, what stays from step to step."""

from __future__ import annotations

import numpy as np
import pytest
from arcs import paper_robot

from tdcr_fe import (
    Backbone,
    ConvergingRouting,
    Disks,
    HelicalRouting,
    Load,
    LoadStep,
    ParallelRouting,
    Robot,
    Tendon,
)
from tdcr_fe.model.loading import resolve

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


def test_what_a_step_does_not_name_stays_as_it_was():
    """Inputs of the other tendon, how it is driven, loads and time."""
    tendons = tuple(Tendon(name, ParallelRouting(4e-3, angle)) for name, angle in (("a", 0.0), ("b", 180.0)))
    robot = Robot(Backbone(0.2, RADIUS, MODULUS, RATIO), Disks.equally_spaced(2, 0.2), tendons)
    push = Load(0.2, (0.0, 0.05, 0.0))
    steps = (
        LoadStep(tensions={"a": 1.5}, loads={"push": push}, time=2.0),
        LoadStep(displacements={"b": 1e-3}),
        LoadStep(tensions={"a": 0.5}, loads={"couple": Load(0.1, moment=(1e-3, 0.0, 0.0))}),
    )
    _, second, third = resolve(robot, steps)
    assert second.values.tolist() == [1.5, 1e-3] and second.by_displacement.tolist() == [False, True]
    assert dict(second.loads) == {"push": push} and second.time == 2.0
    assert third.values.tolist() == [0.5, 1e-3] and set(third.loads) == {"push", "couple"}


def test_a_printed_robot_is_one_line():
    """In 0.1 it was all of its fields, some thousand characters."""
    assert repr(paper_robot(2)) == "Robot 'single-segment': 250 mm, disks 13, tendons t1, t2"
