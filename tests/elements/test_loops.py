"""Loops that numba compiles give the same as numpy's operations on all elements or segments at once."""

import numpy as np
import pytest

from tdcr_fe.elements.backbone import BackboneMesh, ElementChain
from tdcr_fe.elements.backbone_loops import add_backbone_tangent, chain_maps
from tdcr_fe.elements.cable_loops import add_cable_tangent, cable_segments, cable_turns
from tdcr_fe.elements.poses import SECOND_SERIES
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
    wrenches = np.random.default_rng(2).normal(size=36)
    tangent = elements.tangent(mesh, wrenches[6:], *poses)
    expected = np.zeros((36, 36))
    for n in range(5):
        own, after = slice(6 + 6 * n, 12 + 6 * n), slice(12 + 6 * n, 18 + 6 * n)
        expected[own, own] = tangent.itself[n]
        if n < 4:
            expected[own, after], expected[after, own] = tangent.after[n], tangent.after[n].T
    # The robot comes after another node in the scene.
    found = np.zeros((36, 36))
    add_backbone_tangent(
        found, 6, elements.twists, elements.steps, powers, b, mesh.twist_stiffness, mesh.reference_twists,
        wrenches, *poses, SECOND_SERIES,
    )  # fmt: skip
    assert near(found, expected)


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
    lines = shape.lines
    segments = cable_segments(lines._frames, lines._offsets, lines.directions)
    assert near(segments, lines.segments)
    bend = lines.directions[:, 1:] - lines.directions[:, :-1]
    turns = cable_turns(segments, lines.directions, lines._inverse, bend, (bend**2).sum(axis=2) * mask[:, 1:])
    assert near(turns, shape.turns)

    tension = np.array([[3.0, 2.0], [5.0, 4.0], [1.0, 0.0]])
    by_angle = np.array([[[0.0], [-1.0]], [[0.0], [-2.0]], [[0.0], [0.0]]])
    rows = np.array([0, 12, 24])
    stiffness, expected = lines.stiffness(tension), np.zeros((30, 30))
    columns = (rows[:, None] + np.arange(6)).ravel()
    expected[np.ix_(columns, columns)] = lines.softening(by_angle @ shape.d_angles).reshape(18, 18)
    for n, row in enumerate(rows):
        expected[row : row + 6, row : row + 6] += stiffness.itself[n]
        if n < 2:
            then = rows[n + 1]
            expected[row : row + 6, then : then + 6] += stiffness.after[n]
            expected[then : then + 6, row : row + 6] += stiffness.after[n].T
    found = np.zeros((30, 30))
    add_cable_tangent(
        found, rows, lines._frames, lines._offsets, lines.directions, lines._inverse, segments, turns, tension,
        by_angle,
    )  # fmt: skip
    assert near(found, expected)
