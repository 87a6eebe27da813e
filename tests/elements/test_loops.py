"""Loops that numba compiles give the same as numpy's operations on all elements or segments at once."""

import numpy as np
import pytest

from tdcr_fe.elements.backbone import BackboneMesh, ElementChain
from tdcr_fe.elements.backbone_loops import add_blocks, backbone_blocks, chain_maps
from tdcr_fe.elements.cable_loops import (
    add_cable_softening,
    cable_segments,
    cable_shape,
    cable_stiffness,
    cable_turns,
    cable_wrenches,
)
from tdcr_fe.elements.pose_loops import chain_poses
from tdcr_fe.elements.poses import SECOND_SERIES, SERIES, exp_se3, pose_matrix
from tdcr_fe.elements.tendons import CableGeometry

#: Of the largest entry.
ROUND_OFF = 1e-13


def near(found, expected):
    return np.abs(found - expected).max() <= ROUND_OFF * np.abs(expected).max()


@pytest.fixture
def chain():
    """Four elements with turns up to 1 rad, and their mesh."""
    random = np.random.default_rng(1)
    arc = np.array([0.0, 0.02, 0.05, 0.06, 0.1])
    stiffness = random.uniform(0.5, 2.0, (4, 6)) * (1e3, 1e3, 1e3, 1e-2, 1e-2, 1e-2)
    mesh = BackboneMesh(arc, stiffness, np.ones(4), np.ones((4, 3)), random.normal(size=(4, 3)))
    twists = mesh.reference_twists + random.normal(size=(4, 6)) * (1e-3, 1e-3, 1e-3, 0.4, 0.4, 0.4)
    return ElementChain(twists), mesh


def test_maps_and_tangent_of_a_backbone(chain):
    elements, mesh = chain
    powers, b = chain_maps(elements.twists, elements._coefficients)
    for found, expected in zip((powers, b), elements._maps, strict=True):
        assert near(found, expected)

    poses = elements.poses(np.eye(4))
    wrenches = np.random.default_rng(2).normal(size=30)
    tangent = elements.tangent(mesh, wrenches, *poses)
    blocks = backbone_blocks(
        elements.twists, elements.steps, powers, b, mesh.twist_stiffness, mesh.reference_twists, wrenches, *poses,
        SECOND_SERIES,
    )  # fmt: skip
    for found, expected in zip(blocks, tangent, strict=True):
        assert near(found, expected)


def test_blocks_in_a_dense_matrix():
    """Those of three nodes, two of them next to each other, added to what is there."""
    random = np.random.default_rng(4)
    itself, after = random.normal(size=(3, 6, 6)), random.normal(size=(2, 6, 6))
    there, rows = random.normal(size=(27, 27)), np.array([3, 9, 21])
    expected, columns = there.copy(), (rows[:, None] + np.arange(6)).ravel()
    expected[np.ix_(columns, columns)] += np.block(
        [
            [itself[0], after[0], np.zeros((6, 6))],
            [after[0].T, itself[1], after[1]],
            [np.zeros((6, 6)), after[1].T, itself[2]],
        ]
    )
    add_blocks(there, rows, itself, after)
    assert near(there, expected)


def test_poses_of_a_backbone(chain):
    """With small and large turns; Euler parameters have the signs of those given."""
    elements, _ = chain
    twists = elements.twists.copy()
    twists[1, 3:], twists[2, 3:] = (0.9, -0.6, 0.3), (1e-5, 0.0, 2e-5)
    rotation, position = exp_se3(np.array([0.1, 0.2, 0.3, 2.0, -1.0, 0.5]))
    base = pose_matrix(position, rotation)
    signs = np.array([1.0, -1.0, -1.0, 1.0, -1.0])[:, None]
    signed = signs * ElementChain.with_poses(twists, base, np.ones((5, 4)))[1].parameters
    expected, poses = ElementChain.with_poses(twists, base, signed)
    complete, c, steps, *found = chain_poses(twists, base, signed, SERIES)
    assert complete and near(c, expected._coefficients) and near(steps, expected.steps)
    assert all(near(own, other) for own, other in zip(found, poses, strict=True))
    assert near(found[2], signed)


def test_euler_parameters_far_from_those_given_are_left_to_numpy(chain):
    elements, _ = chain
    complete, *_ = chain_poses(elements.twists, np.eye(4), np.tile((0.0, 1.0, 0.0, 0.0), (5, 1)), SERIES)
    assert not complete


def test_derivatives_and_tangent_of_cables(chain):
    """Three tendons through every other node: one straight, one that ends before the others."""
    elements, _ = chain
    positions, rotations = (x[::2] for x in elements.poses(np.eye(4)))
    mask = np.array([[True, True], [True, True], [True, False]])
    nodes = np.array([[0, 1, 2], [0, 1, 2], [0, 1, 1]])
    offsets = np.random.default_rng(3).normal(size=(3, 3, 3)) * 0.01
    offsets[2, 2] = offsets[2, 1]
    straight = positions[0] + np.array([0.0, 0.5, 1.0])[:, None] * (positions[2] - positions[0])
    offsets[0] = np.einsum("kji,kj->ki", rotations, straight - positions)
    geometry = CableGeometry(nodes, offsets, mask, 3)
    shape = geometry.evaluate(positions, rotations)
    for found, expected in zip(
        cable_shape(rotations, positions, offsets, mask.astype(float)),
        geometry._shape(rotations, positions),
        strict=True,
    ):
        assert near(found, expected)
    lines = shape.lines
    segments = cable_segments(lines._frames, lines._offsets, lines.directions)
    assert near(segments, lines.segments)
    bend = lines.directions[:, 1:] - lines.directions[:, :-1]
    turns = cable_turns(segments, lines.directions, lines._inverse, bend, (bend**2).sum(axis=2) * mask[:, 1:])
    assert near(turns, shape.turns)

    tension = np.array([[3.0, 2.0], [5.0, 4.0], [1.0, 0.0]])
    by_angle = np.array([[[0.0], [-1.0]], [[0.0], [-2.0]], [[0.0], [0.0]]])
    given = lines._frames, lines._offsets, lines.directions, lines._inverse, segments, tension
    assert near(cable_wrenches(*given[:3], tension), lines.wrenches(tension))
    for found, expected in zip(cable_stiffness(*given), lines.stiffness(tension), strict=True):
        assert near(found, expected)

    rows = np.array([0, 12, 24])
    found, expected = np.zeros((30, 30)), np.zeros((30, 30))
    columns = (rows[:, None] + np.arange(6)).ravel()
    expected[np.ix_(columns, columns)] = lines.softening(by_angle @ shape.d_angles).reshape(18, 18)
    add_cable_softening(found, rows, segments, turns, by_angle)
    assert near(found, expected)
