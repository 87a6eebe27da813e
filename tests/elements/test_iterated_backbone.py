"""The tangent of iterates whose axial and shear forces are errors of the iteration."""

from __future__ import annotations

import exudyn as exu
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


def test_only_iterates_with_excessive_forces_have_it():
    """All nodes from the sixth on are shifted by a tenth of a millimetre, which strains one element excessively."""
    _keep, mbs, handle, _ = bent()
    data = mbs.systemData
    data.SetODE2Coordinates(data.GetODE2Coordinates(), exu.ConfigurationType.StartOfStep)
    own = handle.actuation
    moved = own._node_coordinates.displacements()
    assert own._backbone.excess_tangent(handle.mesh, moved.ravel()) is None
    slightly = moved.copy()
    slightly[:, :3] += 1e-9 * np.random.default_rng(2).normal(size=(len(moved), 3))
    assert own._backbone.excess_tangent(handle.mesh, slightly.ravel()) is None
    moved[6:, :3] += [0.0, 0.0, 1e-4]
    found = own._backbone.excess_tangent(handle.mesh, moved.ravel())
    assert found is not None
    touched = np.flatnonzero(np.abs(found).max(axis=1))
    assert {int(i) // 7 for i in touched} == {5, 6}


def test_derivatives_for_linearised_systems_are_those_of_the_forces():
    """Exudyn asks for them without velocities: the geometric stiffness is that of all forces, and all holes stick."""
    _keep, mbs, handle, _ = bent()
    data = mbs.systemData
    zero = np.zeros(data.ODE2Size())
    data.SetODE2Coordinates(zero, exu.ConfigurationType.StartOfStep)
    own = handle.actuation
    moved = own._node_coordinates.displacements().ravel()
    moved[-7:-4] += [0.0, 0.0, 1e-3]
    assert own._backbone.excess_tangent(handle.mesh, moved) is not None
    alone = own.jacobian_on_coordinates(moved, 0.0, 1.0, 0.0).Convert2DenseMatrix()
    in_time = own.jacobian_on_coordinates(moved, 0.0, 1.0, 1e3).Convert2DenseMatrix()
    tangent = own._scene_forces.tangent(moved, 0.0, own.inputs, own._elastic(), "stuck")
    assert np.array_equal(alone, -tangent)
    assert not np.allclose(in_time, alone)
