"""Measured channels against closed forms of a constant-curvature arc, and against the independent reference."""

import math
from dataclasses import replace

import numpy as np
import pytest
from robots import LENGTH, paper
from scipy.spatial.transform import Rotation

from tdcr_fe.model.channels import CHANNELS, QUANTITIES, channel
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.observed_step import ObservedChange, ObservedStep
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.reference import ReferenceSettings, solve_reference

#: Bending moment of an arc by closed form [1/m], towards +x: the section turns about +y.
KAPPA = 6.0


def arc(kappa=KAPPA, nodes=9, **more):
    """An arc of constant curvature in the x-z plane, with nodes as a solver gives them."""
    s = np.linspace(0.0, LENGTH, nodes)
    angle = kappa * s
    positions = np.stack((1.0 - np.cos(angle), 0.0 * s, np.sin(angle)), axis=1) / kappa
    rotations = Rotation.from_rotvec(np.stack((0.0 * s, angle, 0.0 * s), axis=1)).as_matrix()
    return ObservedStep(s, positions, rotations, np.array([1e-3]), np.array([0.7]), ("t1",), **more)


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
    assert predicted("tendon_displacement", step, "t1") == 1e-3
    assert predicted("distal_tension", step, "t1") == 0.7


def test_curvature_belongs_to_the_section_and_not_to_the_measuring_frame():
    frame = Rotation.from_rotvec((0.3, -0.2, 0.1)).as_matrix()
    step = arc(frame=frame, offset=np.array([1e-3, 2e-3, 0.0]))
    assert predicted("curvature_y", step, 0.1) == pytest.approx(KAPPA, rel=1e-12)
    assert predicted("position_x", step, 0.1) != pytest.approx(predicted("position_x", arc(), 0.1), abs=1e-4)


def test_curvature_of_a_finite_element_model_is_that_of_the_reference():
    robot, model = paper(0.2), Model(elements_per_bay=4)
    steps = (LoadStep(tensions={"t1": 1.0}), LoadStep(tensions={"t1": 0.6}))
    s = [float(np.mean(robot.disks.positions[k : k + 2])) + 1.3e-3 for k in (1, 5, 9)]
    sampled = tuple(x + d for x in s for d in (-1e-4, 1e-4))
    fe = simulate(robot, model, steps)
    reference = solve_reference(robot, model, steps, settings=ReferenceSettings(sample_at=sampled))
    names = tuple(robot.tendon_names)
    for a, b in zip(fe.steps, reference.steps, strict=True):
        found, exact = (
            np.array([channel(f"curvature_{axis}").predict(ObservedStep.of(x, names), s) for axis in "xy"])
            for x in (a, b)
        )
        size = np.max(np.abs(exact))
        assert size > 1.0
        np.testing.assert_allclose(found, exact, atol=2e-3 * size)


def test_the_straight_robot_shows_the_rest_values():
    s = np.linspace(0.0, LENGTH, 5)
    straight = ObservedStep(
        s,
        np.stack((0.0 * s, 0.0 * s, s), axis=1),
        np.tile(np.eye(3), (5, 1, 1)),
        np.zeros(1),
        np.zeros(1),
        ("t1",),
    )
    for c in CHANNELS:
        location = {"arc length": 0.1, "tendon": "t1", "": None}[c.location]
        assert c.predict(straight, [location])[0] == pytest.approx(c.at_rest(location), abs=1e-15)
        low, high = c.limits(LENGTH)
        assert low <= c.at_rest(location) <= high


def test_an_unknown_quantity_names_those_that_exist():
    assert len(set(QUANTITIES)) == len(CHANNELS)
    with pytest.raises(KeyError, match="curvature_x"):
        channel("strain")


def bent_step(seed: int, moving: bool) -> tuple[ObservedStep, ObservedChange]:
    """A bent and twisted backbone of ten elements seen by a turned instrument, and random derivatives."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 0.2, 11)
    position, rotation = np.zeros(3), np.eye(3)
    positions, rotations = [position], [rotation]
    for _ in range(10):
        turn = Rotation.from_rotvec(rng.normal([0.2, 0.1, 0.0], 0.1)).as_matrix()
        position = position + rotation @ np.array([*rng.normal(0.0, 1e-3, 2), 0.02])
        rotation = rotation @ turn
        positions.append(position)
        rotations.append(rotation)
    step = ObservedStep(
        s,
        np.array(positions),
        np.array(rotations),
        rng.normal(0.0, 1e-3, 2),
        rng.normal(1.0, 0.1, 2),
        ("t1", "t2"),
        Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix(),
        np.array([1e-3, -2e-3, 0.0]),
    )
    change = ObservedChange(
        rng.normal(0.0, 0.1, (11, 3, 4)),
        rng.normal(0.0, 1.0, (11, 3, 4)),
        rng.normal(0.0, 0.1, (2, 4)),
        rng.normal(0.0, 1.0, (2, 4)),
        rng.normal(0.0, 0.01, (11, 4)) if moving else np.zeros((11, 4)),
    )
    return step, change


@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("between", [False, True])
def test_derivatives_equal_central_differences(quantity: str, between: bool) -> None:
    """Of every channel, at nodes and between them, with the instrument turned and markers off the backbone."""
    known = channel(quantity)
    step, change = bent_step(3, moving=between)
    arcs: tuple[float, ...] = (0.033, 0.117, 0.2) if between else (0.04, 0.12, 0.2)
    locations = {"arc length": arcs, "tendon": ("t2", "t1"), "": (None,)}[known.location]
    found = known.derivatives(step, change, locations)
    expected = replace(known, derive=None).derivatives(step, change, locations)
    assert known.derive is not None
    assert np.max(np.abs(found - expected)) < 1e-7 * np.max(np.abs(expected))


def test_derivatives_of_angles_on_the_axis_are_to_one_side() -> None:
    """A straight robot along z: the angle grows by the rotation of the tip, whatever its direction."""
    s = np.linspace(0.0, 0.1, 3)
    straight = ObservedStep(
        s, np.outer(s, [0.0, 0.0, 1.0]), np.tile(np.eye(3), (3, 1, 1)), np.zeros(1), np.zeros(1), ("t1",)
    )
    rotations = np.zeros((3, 3, 2))
    rotations[2, 0, 0], rotations[2, 1, 1] = 0.3, -0.4
    positions = np.zeros((3, 3, 2))
    positions[2, 1, 0], positions[2, 0, 1] = -0.02, 0.03
    change = ObservedChange(positions, rotations, np.zeros((1, 2)), np.zeros((1, 2)), np.zeros((3, 2)))
    assert channel("bending_angle").derivatives(straight, change, [None]) == pytest.approx(
        np.array([[0.3, 0.4]])
    )
    assert channel("tip_offset").derivatives(straight, change, [None]) == pytest.approx(
        np.array([[0.02, 0.03]])
    )
    assert channel("chord_angle").derivatives(straight, change, [None]) == pytest.approx(
        np.array([[0.2, 0.3]])
    )
