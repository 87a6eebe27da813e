"""The tangent of iterates whose axial and shear forces are errors of the iteration."""

from __future__ import annotations

import numpy as np
import pytest
from robots import scene, three

from tdcr_fe.elements.backbone import relative_twists, strain_matrices
from tdcr_fe.elements.native.coordinates import generalized_forces, twists_by_coordinates
from tdcr_fe.elements.native.iterated import constant_wrench_tangent
from tdcr_fe.elements.poses import rotation_of_euler_parameters
from tdcr_fe.elements.section import nodal_sum
from tdcr_fe.native import register
from tdcr_fe.solve.statics import SolveTDCR

register()


def forces(q: np.ndarray, wrenches: np.ndarray) -> np.ndarray:
    """Generalised forces of elements with constant wrenches; shape (7 N,)."""
    nodes = q.reshape(-1, 7)
    rotations = rotation_of_euler_parameters(nodes[:, 3:])
    by_nodes = strain_matrices(relative_twists(nodes[:, :3], rotations))
    return generalized_forces(nodal_sum(-(wrenches[:, None] @ by_nodes)[:, 0]), rotations, nodes[:, 3:])


def bent():
    """A robot at rest under three tensions, and its coordinates with reference values."""
    keep, mbs, handle = scene(three(0.3))
    handle.set_tensions([1.2, 0.0, 0.4])
    SolveTDCR(mbs)
    positions, _, parameters = handle.actuation.scene_poses()
    return keep, mbs, handle, np.concatenate((positions, parameters), axis=1)


def test_it_is_the_derivative_of_the_forces_of_constant_wrenches():
    """By central differences, in all directions that turn and move the sections of a disturbed shape."""
    rng = np.random.default_rng(1)
    *_, nodes = bent()
    nodes[:, :3] += 1e-5 * rng.normal(size=(len(nodes), 3))
    nodes[:, 3:] += 1e-2 * rng.normal(size=nodes[:, 3:].shape)
    nodes[:, 3:] /= np.linalg.norm(nodes[:, 3:], axis=1)[:, None]
    wrenches = rng.normal(size=(len(nodes) - 1, 6))
    rotations = rotation_of_euler_parameters(nodes[:, 3:])
    twists = relative_twists(nodes[:, :3], rotations)
    found = constant_wrench_tangent(wrenches, twists, rotations, nodes[:, 3:])
    to_twist = twists_by_coordinates(rotations, nodes[:, 3:])
    for node, axis in np.ndindex(len(nodes), 6):
        way = np.zeros(nodes.shape)
        way[node] = np.linalg.pinv(to_twist[node])[:, axis]
        step = 1e-6 * way.ravel()
        expected = (forces(nodes.ravel() + step, wrenches) - forces(nodes.ravel() - step, wrenches)) / 2e-6
        assert found @ way.ravel() == pytest.approx(expected, abs=1e-7)
