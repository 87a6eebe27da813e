"""Measured channels against closed forms of a constant-curvature arc; derivatives are in `tests/identify`."""

import math

import numpy as np
import pytest
from robots import LENGTH
from scipy.spatial.transform import Rotation

from tdcr_fe.model.channels import CHANNELS, by_differences, channel
from tdcr_fe.model.observed_step import Observation, ObservedChange, ObservedStep

#: Bending moment of an arc by closed form [1/m], towards +x: the section turns about +y.
KAPPA = 6.0
#: Arc lengths of nodes [m].
NODES = np.linspace(0.0, LENGTH, 9)


def arc(kappa=KAPPA, s=NODES, **more):
    """An arc of constant curvature in the x-z plane, with nodes as a solver gives them."""
    angle = kappa * s
    positions = np.stack((1.0 - np.cos(angle), 0.0 * s, np.sin(angle)), axis=1) / kappa
    rotations = Rotation.from_rotvec(np.stack((0.0 * s, angle, 0.0 * s), axis=1)).as_matrix()
    return ObservedStep(s, positions, rotations, *np.array([[1e-3], [0.9], [0.7]]), ("t1",), **more)


def straight(length):
    """A robot along z, with three nodes."""
    s = np.linspace(0.0, length, 3)
    turns = np.tile(np.eye(3), (3, 1, 1))
    return ObservedStep(s, np.outer(s, [0.0, 0.0, 1.0]), turns, *np.zeros((3, 1)), ("t1",))


def predicted(quantity, step, location=None):
    return float(channel(quantity).predict(step, [location])[0])


@pytest.mark.parametrize("s", [0.0, 0.03, LENGTH / 2.0, 0.2, LENGTH])
def test_an_arc_has_its_positions_and_its_curvature_everywhere(s):
    step = arc()
    assert predicted("curvature_x", step, s) == pytest.approx(0.0, abs=1e-12)
    assert predicted("curvature_y", step, s) == pytest.approx(KAPPA, rel=1e-12)
    exact = ((1.0 - math.cos(KAPPA * s)) / KAPPA, 0.0, math.sin(KAPPA * s) / KAPPA)
    assert [predicted(f"position_{a}", step, s) for a in "xyz"] == pytest.approx(exact, abs=1e-12)


def test_angles_and_offset_of_an_arc():
    step = arc()
    assert predicted("bending_angle", step) == pytest.approx(KAPPA * LENGTH)
    assert predicted("chord_angle", step) == pytest.approx(0.5 * KAPPA * LENGTH)
    assert predicted("tip_offset", step) == pytest.approx((1.0 - math.cos(KAPPA * LENGTH)) / KAPPA)
    for quantity, value in {"tendon_displacement": 1e-3, "base_tension": 0.9, "distal_tension": 0.7}.items():
        assert predicted(quantity, step, "t1") == value
    # Curvature belongs to the section and not to the measuring frame.
    step = arc(observation=Observation((0.3, -0.2, 0.1), (1e-3, 2e-3, 0.0)))
    assert predicted("curvature_y", step, 0.1) == pytest.approx(KAPPA, rel=1e-12)
    assert predicted("position_x", step, 0.1) != pytest.approx(predicted("position_x", arc(), 0.1), abs=1e-4)


def test_the_straight_robot_shows_the_rest_values():
    for c in CHANNELS:
        location = {"arc length": 0.1, "tendon": "t1", "": None}[c.location]
        at_rest = 0.1 if c.quantity == "position_z" else 0.0
        assert c.predict(straight(LENGTH), [location])[0] == pytest.approx(at_rest, abs=1e-15)
        plausible = c.plausible(LENGTH)
        assert plausible.low <= at_rest <= plausible.high


def test_derivatives_of_angles_on_the_axis_are_to_one_side() -> None:
    """A straight robot along z: the angle grows by the rotation of the tip, whatever its direction."""
    rotations = np.zeros((3, 3, 2))
    rotations[2, 0, 0], rotations[2, 1, 1] = 0.3, -0.4
    positions = np.zeros((3, 3, 2))
    positions[2, 1, 0], positions[2, 0, 1] = -0.02, 0.03
    still = np.zeros((3, 1, 2))
    change = ObservedChange(np.zeros((3, 2)), positions, rotations, *still)
    slopes = {"bending_angle": (0.3, 0.4), "tip_offset": (0.02, 0.03), "chord_angle": (0.2, 0.3)}
    for quantity, expected in slopes.items():
        step = straight(0.1)
        h = change.difference_steps(step)
        found = by_differences(channel(quantity).predict(step.moved(change, h), [None]), h)
        assert found == pytest.approx(np.array([expected]))
