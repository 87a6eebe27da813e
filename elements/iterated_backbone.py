"""The geometric stiffness of a backbone in iterates whose axial and shear forces are errors of the iteration.

A step of Newton's method turns the sections and moves the nodes along tangents, and what then does not fit, of second
order in the rotations, strains the elements along the backbone. Their large axial and shear stiffness makes forces of
it, up to thousands of newtons, which the next iteration removes. But the geometric stiffness of these forces is many
times the bending stiffness, so that it goes astray. Where a force of an element is larger than those at the beginning
of the step by more than what its bending stiffness may balance, the tangent therefore takes the forces from there. What
the iteration converges to does not change (compare D. Magisano, L. Leonetti, G. Garcea, How to improve efficiency and
robustness of the Newton method in geometrically non-linear structural problem discretized via displacement-based
finite elements, Comput. Methods Appl. Mech. Engrg. 313 (2017) 986-1005).
"""

from __future__ import annotations

from typing import NamedTuple

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BackboneMesh, relative_twists, strain_matrices
from tdcr_fe.elements.generalized import generalized_tangent, twists_by_coordinates
from tdcr_fe.elements.node_coordinates import NodeCoordinates
from tdcr_fe.elements.poses import skew
from tdcr_fe.elements.section import wrenches_on_nodes
from tdcr_fe.elements.system import SystemReference

Array = NDArray[np.float64]

_EYE6 = np.eye(6)
#: Step of the central differences by the relative twists [1].
_STEP = 1e-5


class IteratedBackbone:
    """The elements of one backbone in the iterates of a step.

    Parameters
    ----------
    system
        The system.
    coordinates
        Of the nodes.
    """

    def __init__(self, system: SystemReference, coordinates: NodeCoordinates) -> None:
        self._system, self._coordinates = system, coordinates
        self._limits: Limits | None = None

    def excess_tangent(self, mesh: BackboneMesh, displacements: Array) -> Array | None:
        """Derivative of the generalised forces of the elements by excessive axial and shear forces, at these forces.

        Parameters
        ----------
        mesh
            The backbone.
        displacements
            Coordinates of the nodes in this iterate, without reference values, shape (7 N,).

        Returns
        -------
        ndarray, shape (7 N, 7 N), or None
            None where no element is stretched excessively.
        """
        if self._limits is None or self._limits.mesh is not mesh:
            self._limits = Limits.of(mesh)
        data = self._system.mbs.systemData
        everything: Array = data.GetODE2Coordinates(exu.ConfigurationType.StartOfStep, copy=False)
        before, after = everything[self._coordinates.numbers], displacements.reshape(-1, 7)
        # The lengths of the chords are enough to see it, in a tenth of the time that the twists take.
        nodes = before[:, :3] + self._coordinates.reference[:, :3]
        moved = after[:, :3] - before[:, :3]
        way = moved[1:] - moved[:-1]
        grown = np.abs(np.einsum("ei,ei->e", 2.0 * (nodes[1:] - nodes[:-1]) + way, way))
        if not (grown > self._limits.square).any():
            return None
        positions, rotations, parameters = self._coordinates.poses(after)
        twists = relative_twists(positions, rotations)
        wrenches = mesh.twist_stiffness * (twists - relative_twists(*self._coordinates.poses(before)[:2]))
        wrenches[:, 3:] = 0.0
        wrenches[(np.abs(wrenches) < self._limits.force).all(axis=1)] = 0.0
        return constant_wrench_tangent(wrenches, twists, rotations, parameters)


class Limits(NamedTuple):
    """What is excessive in an iterate.

    Attributes
    ----------
    mesh : BackboneMesh
        The backbone.
    force : float
        Change of an axial or shear force since the beginning of the step whose geometric stiffness is of the order of
        the bending stiffness: ``EI / h^2``, where ``h`` is the length of an element, or that of a twentieth of the
        backbone if it is shorter [N].
    square : ndarray, shape (E,)
        Change of the squared length of the elements by such an axial force [m^2].
    """

    mesh: BackboneMesh
    force: float
    square: Array

    @classmethod
    def of(cls, mesh: BackboneMesh) -> Limits:
        """Of a backbone."""
        lengths = np.maximum(mesh.lengths, mesh.arc_lengths[-1] / 20.0)
        force = float(np.min(mesh.stiffness[:, 4:] / lengths[:, None] ** 2))
        return cls(mesh, force, 2.0 * mesh.lengths * force / mesh.twist_stiffness[:, 0])


def constant_wrench_tangent(wrenches: Array, twists: Array, rotations: Array, parameters: Array) -> Array:
    """Derivative of the generalised forces of elements with constant wrenches by the coordinates, shape (7 N, 7 N).

    Parameters
    ----------
    wrenches
        Conjugate to the twists of the elements [N, N m], shape (E, 6).
    twists
        Of the elements, shape (E, 6).
    rotations, parameters
        Of the nodes, shapes (N, 3, 3) and, of Euler parameters, (N, 4).
    """
    shifts = np.concatenate((_EYE6, -_EYE6)) * _STEP
    on_nodes = -(wrenches[:, None] @ strain_matrices(twists + shifts[:, None, :]))[:, :, 0]
    by_twists = np.moveaxis((on_nodes[:6] - on_nodes[6:]) / (2.0 * _STEP), 0, -1)
    by_nodes = strain_matrices(twists)
    blocks = by_twists @ by_nodes
    n = len(rotations)
    k = np.zeros((6 * n, 6 * n))
    for e, block in enumerate(blocks):
        k[6 * e : 6 * e + 12, 6 * e : 6 * e + 12] += block
    of_nodes = wrenches_on_nodes(wrenches, by_nodes)
    for node, (force, moment) in enumerate(zip(skew(of_nodes[:, :3]), skew(of_nodes[:, 3:]), strict=True)):
        i = 6 * node
        k[i : i + 3, i + 3 : i + 6] -= force
        k[i + 3 : i + 6, i + 3 : i + 6] -= 0.5 * moment
    return generalized_tangent(k, of_nodes[:, 3:], twists_by_coordinates(rotations, parameters))
