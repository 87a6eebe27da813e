"""Cables from hole to hole: lengths, angles, and their derivatives against differences."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tdcr_fe.elements.poses import exp_se3
from tdcr_fe.elements.tendons import CableGeometry

NODES = np.array([[0, 1, 2, 3], [0, 1, 2, 2], [0, 1, 1, 1]])
MASK = np.array([[True, True, True], [True, True, False], [True, False, False]])


def geometry(seed: int = 0) -> CableGeometry:
    """Three tendons of three, two and one segments on four nodes."""
    rng = np.random.default_rng(seed)
    offsets = 5e-3 * rng.normal(size=(3, 4, 3)) * [0.0, 1.0, 1.0]
    offsets[1, 3], offsets[2, 2:] = offsets[1, 2], offsets[2, 1]
    return CableGeometry(NODES, offsets, MASK, 4)


def random_poses(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Four nodes some centimetres apart, with random rotations."""
    rng = np.random.default_rng(seed)
    p = np.array([[0.02 * k, 0.0, 0.0] for k in range(4)]) + 0.005 * rng.normal(size=(4, 3))
    return p, Rotation.from_rotvec(0.5 * rng.normal(size=(4, 3))).as_matrix()


def test_quarter_circle_of_holes():
    """Holes in the corners of a regular polygon: equal lengths 2 R sin(a/2), turns of a at every corner."""
    count, radius = 6, 0.1
    a = np.pi / 2 / count
    angle = a * np.arange(count + 1)
    p = radius * np.stack((np.sin(angle), 1 - np.cos(angle), 0 * angle), axis=1)
    r = np.broadcast_to(np.eye(3), (count + 1, 3, 3))
    nodes = np.arange(count + 1)[None]
    cable = CableGeometry(nodes, np.zeros((1, count + 1, 3)), np.ones((1, count), bool), count + 1)
    shape = cable.evaluate(p, r)
    assert shape.lengths == pytest.approx(np.full((1, count), 2 * radius * np.sin(a / 2)), rel=1e-14)
    assert shape.angles == pytest.approx(np.full((1, count - 1), a), rel=1e-12)


@settings(max_examples=25)
@given(st.integers(0, 10**6))
def test_derivatives_against_differences(seed):
    cable, (p, r) = geometry(seed), random_poses(seed + 1)
    # The derivatives of a geometry are overwritten by its next call.
    shape = geometry(seed).evaluate(p, r)
    h = 1e-7
    for column in range(24):
        found = []
        for sign in (1.0, -1.0):
            twist = np.zeros((4, 6))
            twist.reshape(-1)[column] = sign * h
            dr, dp = exp_se3(twist)
            moved = cable.evaluate(p + (r @ dp[..., None])[..., 0], r @ dr)
            found.append((moved.lengths, moved.angles))
        d_length = (found[0][0] - found[1][0]) / (2 * h)
        d_angle = (found[0][1] - found[1][1]) / (2 * h)
        assert shape.d_lengths[..., column] == pytest.approx(d_length, abs=1e-7)
        assert shape.d_angles[..., column] == pytest.approx(d_angle, rel=1e-5, abs=1e-4)


@settings(max_examples=25)
@given(st.integers(0, 10**6))
def test_moving_the_whole_robot_changes_nothing(seed):
    p, r = random_poses(seed + 1)
    turn = Rotation.random(random_state=seed % 1000).as_matrix()
    a, b = geometry(seed).evaluate(p, r), geometry(seed).evaluate(p @ turn.T + [1.0, 2.0, 3.0], turn @ r)
    assert a.lengths == pytest.approx(b.lengths, abs=1e-14)
    assert a.angles == pytest.approx(b.angles, abs=1e-11)
    # A rigid motion of all nodes is no change either: the derivatives balance.
    world = np.concatenate((np.swapaxes(r, 1, 2), np.zeros((4, 3, 3))), axis=1).reshape(24, 3)
    assert a.d_lengths @ world == pytest.approx(np.zeros((3, 3, 3)), abs=1e-12)


def test_clearance_shifts_the_tendon_towards_where_it_is_pulled():
    """At a bend the tendon lies at the inner edge of an oversized hole; at base plate and anchor it is not shifted."""
    count, radius, gap = 3, 0.05, 0.2e-3
    angle = 0.4 * np.arange(count + 1)
    p = radius * np.stack((np.sin(angle), 1 - np.cos(angle), 0 * angle), axis=1)
    r = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    nodes = np.arange(count + 1)[None]
    offsets = np.zeros((1, count + 1, 3))
    offsets[..., 2] = 1e-3
    mask = np.ones((1, count), bool)
    cable = CableGeometry(nodes, offsets, mask, count + 1, np.array([gap]))
    cable.shift_in_holes(p, r)
    shift = cable.offsets - offsets
    assert np.all(np.abs(shift[0, 1:-1, 1] - gap) < 0.01 * gap)
    assert np.all(shift[0, -1] == 0.0) and np.all(shift[..., 0] == 0.0)
    tight = CableGeometry(nodes, offsets, mask, count + 1).evaluate(p, r).lengths.sum()
    assert cable.evaluate(p, r).lengths.sum() < tight
