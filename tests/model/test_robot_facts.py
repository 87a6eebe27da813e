"""Facts of the description: section, holes, routings, what stays from step to step, and checks of its fields."""

from dataclasses import dataclass, replace
from typing import Annotated

import exudyn as exu
import numpy as np
import pytest
from arcs import paper_robot
from hypothesis import given
from hypothesis import strategies as st
from robots import BACKBONE, DISKS, LENGTH, paper
from scenes import scene

from tdcr_fe import Backbone, Disks, Load, LoadStep, Model, Robot, Tendon
from tdcr_fe.model import routing as routings
from tdcr_fe.model.checks import size_contradictions
from tdcr_fe.model.loading import resolve
from tdcr_fe.model.messages import allowed
from tdcr_fe.model.schema import Keys, Quantity

RADIUS, MODULUS, RATIO = 0.5e-3, 60e9, 0.25


def robot_with(*tendons):
    return Robot(Backbone(0.2, RADIUS, MODULUS, RATIO), Disks.equally_spaced(2, 0.2), tendons)


def test_the_section_of_a_round_rod():
    """EI = E pi r^4/4, GJ = G pi r^4/2, EA = E pi r^2, GA = G pi r^2 without shear correction, as in the paper."""
    rod = Backbone(0.2, RADIUS, MODULUS, RATIO, density=6000.0)
    shear = 24e9
    assert pytest.approx(MODULUS * np.pi * RADIUS**4 / 4.0) == rod.EI
    assert pytest.approx(shear * np.pi * RADIUS**4 / 2.0) == rod.GJ
    assert pytest.approx(MODULUS * np.pi * RADIUS**2) == rod.EA
    assert pytest.approx(shear * np.pi * RADIUS**2) == rod.GA
    assert rod.mass_per_length == pytest.approx(6000.0 * np.pi * RADIUS**2)


#: And their holes at the base plate, in the middle and at the tip [mm].
COURSES = {
    "parallel": (routings.ParallelRouting(4e-3, 90.0), [[0.0, 4.0], [0.0, 4.0], [0.0, 4.0]]),
    "helical": (routings.HelicalRouting(4e-3, 0.5, 90.0), [[0.0, 4.0], [-4.0, 0.0], [0.0, -4.0]]),
    "converging": (routings.ConvergingRouting(4e-3, 1e-3, 180.0), [[-4.0, 0.0], [-2.5, 0.0], [-1.0, 0.0]]),
}


@pytest.mark.parametrize(("routing", "expected"), COURSES.values(), ids=COURSES)
def test_holes_are_where_the_angle_in_degrees_and_the_offset_say(routing, expected):
    robot = robot_with(Tendon("t", routing))
    assert 1e3 * robot.hole_points(robot.tendons[0])[:, :2] == pytest.approx(np.array(expected), abs=1e-12)


def test_what_a_step_does_not_name_stays_as_it_was():
    """Inputs of the other tendon, how it is driven, loads and time."""
    tendons = (Tendon(n, routings.ParallelRouting(4e-3, x)) for n, x in (("a", 0.0), ("b", 180.0)))
    push, couple = Load(0.2, (0.0, 0.05, 0.0)), Load(0.1, moment=(1e-3, 0.0, 0.0))
    pushed = LoadStep(tensions={"a": 1.5}, loads={"push": push}, time=2.0)
    bent = LoadStep(tensions={"a": 0.5}, loads={"couple": couple})
    _, second, third = resolve(robot_with(*tendons), [pushed, LoadStep(displacements={"b": 1e-3}), bent])
    assert second.values.tolist() == [1.5, 1e-3] and second.by_displacement.tolist() == [False, True]
    assert dict(second.loads) == {"push": push} and second.time == 2.0
    assert third.values.tolist() == [0.5, 1e-3] and set(third.loads) == {"push", "couple"}


def test_a_printed_robot_is_one_line():
    """In 0.1 it was all of its fields, some thousand characters."""
    assert repr(paper_robot(2)) == "Robot 'single-segment': 250 mm, disks 13, tendons t1, t2"


# ------------------------------------------------------------ routing


S = np.linspace(0.0, LENGTH, 14)
HOLES = tuple((1e-3 * np.cos(k), 1e-3 * np.sin(k)) for k in range(14))
SAMPLES = [
    routings.ParallelRouting(4e-3, 20.0),
    routings.HelicalRouting(4e-3, 1.5, 20.0),
    routings.VaryingHelicalRouting(4e-3, -1.0, 2.0, 20.0),
    routings.ConvergingRouting(4e-3, 1e-3, 20.0),
    routings.PointsRouting(tuple(S), HOLES),
    routings.TwistedRouting(routings.VaryingHelicalRouting(4e-3, 0.5, 2.0), 3.0),
    routings.MisplacedRouting(routings.VaryingHelicalRouting(4e-3, 0.5, 2.0), 1.2, 0.6, 0.3, -0.5),
]


@pytest.mark.parametrize("routing", SAMPLES, ids=lambda r: r.kind)
def test_derivatives_are_those_of_the_position(routing):
    """Central differences of order two: the error falls by four where the step halves."""
    s = np.linspace(0.03, 0.21, 7) + 1e-4
    errors = []
    for h in (2e-4, 1e-4):
        up, down = routing.position(s + h, LENGTH), routing.position(s - h, LENGTH)
        first = (up - down) / (2.0 * h) - routing.position(s, LENGTH, 1)
        second = (up - 2.0 * routing.position(s, LENGTH) + down) / h**2 - routing.position(s, LENGTH, 2)
        errors.append((np.abs(first).max(), np.abs(second).max()))
    (first, second), (first_half, second_half) = errors
    assert first_half <= 0.26 * first + 1e-9
    assert second_half <= 0.26 * second + 1e-5 or routing.kind == "points"  # whose third derivative jumps
    with pytest.raises(ValueError, match="orders 0, 1 and 2"):
        routing.position(s, LENGTH, 3)


@given(st.floats(-5.0, 5.0), st.floats(-360.0, 360.0), st.sampled_from([0, 1, 2]))
def test_varying_helix_with_equal_rates_is_the_helix(rate, angle, derivative):
    both = routings.VaryingHelicalRouting(4e-3, rate, rate, angle), routings.HelicalRouting(4e-3, rate, angle)
    varying, helix = (r.position(S, LENGTH, derivative) for r in both)
    np.testing.assert_allclose(varying, helix, atol=1e-11)


@dataclass(frozen=True)
class TiltedDisks(routings.Routing):
    """Another routing through disks that are turned about their x and y axes by small angles [rad]."""

    base: routings.Routing
    tilt_x: float
    tilt_y: float

    def position(self, s, end, derivative=0):
        return self.base.position(s, end, derivative)

    def axial(self, s, end):
        x, y = self.base.position(s, end).T
        return np.where(np.asarray(s) > 0.0, self.tilt_x * y - self.tilt_y * x, 0.0)  # not the base plate


def test_holes_of_tilted_disks_lie_in_the_plane_of_the_disk():
    """The normal of a tilted disk is (tilt_y, -tilt_x, 1) to first order; the base plate stays upright."""
    robot = paper(0.3).with_tendons(routing=TiltedDisks(routings.ParallelRouting(4.5e-3, 30.0), 0.1, -0.2))
    points = robot.hole_points(robot.tendons[0])
    assert points[1:] @ [-0.2, -0.1, 1.0] == pytest.approx(0.0, abs=1e-15)
    assert points[0, 2] == 0.0 and np.all(np.abs(points[1:, 2]) > 1e-4)
    _keep, mbs, handle = scene(robot)
    markers = [np.array(mbs.GetMarkerOutput(m, exu.OutputVariableType.Position)) for m in handle.mHoles[0]]
    expected = points + np.outer(robot.hole_arc_lengths(robot.tendons[0]), [0.0, 0.0, 1.0])
    assert np.array(markers) == pytest.approx(expected, abs=1e-12)


# ------------------------------------------------------------ fields


def test_numbers_of_numpy_lists_and_whole_numbers_are_taken_and_kept_as_floats_and_tuples():
    backbone = Backbone(np.float64(1.0), np.float32(0.5), 1, 0, precurvature=np.array([0.0, 1.0]))
    robot = Robot(backbone, Disks([0.5, 1]), [Tendon("t1", routings.ParallelRouting(0))])
    assert (backbone.length, backbone.precurvature) == (1.0, (0.0, 1.0))
    assert {type(x) for x in (backbone.length, backbone.radius, *robot.disks.positions)} == {float}
    assert hash(robot) == hash(replace(robot))


def test_memory_of_the_tangent_and_of_the_results_limits_mesh_and_steps():
    """In 0.1 a thousand elements a bay ended in a MemoryError, and ten thousand disks were silent for minutes."""
    rest = Model(elements_per_bay=1)
    for tendons, most in [((), 1407), ((Tendon("t1", routings.ParallelRouting(4e-3)),), 1221)]:
        for count in (most, most + 1):
            robot = Robot(BACKBONE, Disks.equally_spaced(count, LENGTH), tendons)
            assert bool(size_contradictions(robot, rest)) == (count > most)
    robot = Robot(BACKBONE, DISKS)
    assert size_contradictions(robot, rest, 100_000) == []
    (found,) = size_contradictions(robot, rest, 10_000_000)
    assert (found.key, found.value) == ("steps", "10000000 steps")


def test_bounds_in_words():
    for bounds, text in [
        ({}, "a finite number [m]"),
        ({"gt": 0.0}, "a positive number [m]"),
        ({"ge": 0.0}, "a number [m], zero or more"),
        ({"gt": 0.0, "le": 3.0}, "a positive number [m], at most 3"),
        ({"gt": -1.0, "le": 0.5}, "a number [m], above -1, at most 0.5"),
        ({"ge": -2.0, "le": 2.0}, "a number [m] from -2 to 2"),
        ({"gt": 1.0}, "a number [m], above 1"),
    ]:
        keys = Keys({"x": Annotated[float, Quantity("", unit="m", **bounds)]})
        assert allowed(keys.json_schema["properties"]["x"]) == text
