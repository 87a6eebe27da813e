"""Routings as functions of arc length: derivatives, limits, and lengths of unloaded tendons against quadrature."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from robots import BACKBONE, DISKS, LENGTH, solve
from scipy.integrate import quad

from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import (
    ROUTINGS,
    ConvergingRouting,
    HelicalRouting,
    MisplacedRouting,
    ParallelRouting,
    PointsRouting,
    TwistedRouting,
    VaryingHelicalRouting,
)
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.validation.reference import solve_reference

S = np.linspace(0.0, LENGTH, 14)
HOLES = tuple((1e-3 * np.cos(k), 1e-3 * np.sin(k)) for k in range(14))
SAMPLES = [
    ParallelRouting(4e-3, 20.0),
    HelicalRouting(4e-3, 1.5, 20.0),
    VaryingHelicalRouting(4e-3, -1.0, 2.0, 20.0),
    ConvergingRouting(4e-3, 1e-3, 20.0),
    PointsRouting(tuple(S), HOLES),
    TwistedRouting(VaryingHelicalRouting(4e-3, 0.5, 2.0), 3.0),
    MisplacedRouting(VaryingHelicalRouting(4e-3, 0.5, 2.0), 1.2, 0.6, 0.3, -0.5),
]
turns = st.floats(-5.0, 5.0)


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


@given(turns, st.floats(-360.0, 360.0), st.sampled_from([0, 1, 2]))
def test_varying_helix_with_equal_rates_is_the_helix(rate, angle, derivative):
    varying = VaryingHelicalRouting(4e-3, rate, rate, angle).position(S, LENGTH, derivative)
    np.testing.assert_allclose(
        varying, HelicalRouting(4e-3, rate, angle).position(S, LENGTH, derivative), atol=1e-11
    )


@given(turns, turns)
def test_varying_helix_turns_by_the_mean_of_its_rates(base, end):
    routing = VaryingHelicalRouting(4e-3, base, end)
    x, y = routing.position(np.array([LENGTH]), LENGTH)[0]
    angle = 2.0 * np.pi * 0.5 * (base + end)
    np.testing.assert_allclose((x, y), (4e-3 * np.cos(angle), 4e-3 * np.sin(angle)), atol=1e-15)


@given(turns, turns)
def test_length_of_a_varying_helix_is_its_closed_form(base, end):
    """``L = integral of sqrt(1 + (r phi')^2)`` with a rate of turning linear in s, by quadrature."""
    r, routing = 4e-3, VaryingHelicalRouting(4e-3, base, end)
    closed, _ = quad(
        lambda s: np.hypot(1.0, r * 2.0 * np.pi * (base + (end - base) * s / LENGTH) / LENGTH), 0.0, LENGTH
    )
    nodes, weights = np.polynomial.legendre.leggauss(40)
    s = 0.5 * LENGTH * (nodes + 1.0)
    slope = np.linalg.norm(routing.position(s, LENGTH, 1), axis=1)
    assert 0.5 * LENGTH * weights @ np.hypot(1.0, slope) == pytest.approx(closed, rel=1e-10)


def helix(disks=DISKS, **rest):
    return Robot(BACKBONE, disks, (Tendon("t1", VaryingHelicalRouting(4e-3, 0.0, 1.0), **rest),))


def test_unloaded_tendon_along_holes_tends_to_the_helix_by_quadrature():
    """The chords of n bays are shorter than the curve by an error that falls as 1 / n^2."""
    routing = VaryingHelicalRouting(4e-3, 0.0, 1.0)
    exact, _ = quad(
        lambda s: np.hypot(1.0, np.linalg.norm(routing.position(np.array([s]), LENGTH, 1))), 0.0, LENGTH
    )
    gaps = []
    for count in (10, 20, 40):
        robot = helix(Disks.equally_spaced(count, LENGTH))
        tendon = robot.tendons[0]
        points = np.column_stack((robot.holes(tendon), robot.hole_arc_lengths(tendon)))
        gaps.append(exact - np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    assert gaps[0] > gaps[1] > gaps[2] > 0.0
    np.testing.assert_allclose([gaps[0] / gaps[1], gaps[1] / gaps[2]], 4.0, rtol=0.05)


@pytest.mark.parametrize(
    ("tendon_path", "friction"), [("straight", "none"), ("straight", "per-hole"), ("continuous", "none")]
)
def test_finite_elements_with_a_varying_helix_meet_the_reference(tendon_path, friction):
    robot = helix(friction_coefficient=0.3)
    steps = [LoadStep(tensions={"t1": 1.5}), LoadStep(loads={"tip": Load(LENGTH, (0.0, 0.03, 0.0))})]
    found = solve(robot, steps, tendon_path=tendon_path, friction=friction, elements_per_bay=4)
    expected = solve_reference(robot, Model(tendon_path, friction), steps)
    for a, b in zip(found.steps, expected.steps, strict=True):
        assert np.linalg.norm(a.tip - b.tip) < 2e-4 * LENGTH
    assert np.linalg.norm(found.steps[0].tip - [0.0, 0.0, LENGTH]) > 0.02 * LENGTH


def test_a_routing_is_named_in_one_module_of_the_package():
    """Readers, writers and schema take the fields of a routing from its class."""
    root = Path(__file__).parents[2]
    files = [*(root / "tdcr_fe").rglob("*.py"), *(root / "elements").glob("*.py")]
    named = {
        p.name for p in files if re.search(r"VaryingHelical|helical-varying|turns_base", p.read_text("utf-8"))
    }
    assert named - {"__init__.py"} == {"routing.py"}  # the other gives the public names
    assert "helical-varying" in ROUTINGS
