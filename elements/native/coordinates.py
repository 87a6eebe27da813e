"""Coordinates of Exudyn's nodes, the poses that follow from them, and generalised forces on them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import exudyn as exu
import numpy as np

from tdcr_fe.elements import Array, Index
from tdcr_fe.elements.backbone import node_frames
from tdcr_fe.elements.native.items import SystemReference
from tdcr_fe.elements.poses import euler_rate_matrix, rotation_of_euler_parameters


class NodeCoordinates:
    """Coordinates of the nodes of one backbone.

    Parameters
    ----------
    system
        The system.
    nodes
        Exudyn's numbers of the nodes, base first.
    """

    def __init__(self, system: SystemReference, nodes: Sequence[Any]) -> None:
        self._system, self._nodes = system, nodes

    @cached_property
    def numbers(self) -> Index:
        """Exudyn's ODE2 coordinate numbers of all nodes, shape (N, 7); needs an assembled system."""
        first = np.array([self._system.mbs.GetNodeODE2Index(n) for n in self._nodes])
        return first[:, None] + np.arange(7)

    def forget(self) -> None:
        """Read numbers and reference values from Exudyn again, after another `Assemble`."""
        for name in ("numbers", "reference"):
            vars(self).pop(name, None)

    @cached_property
    def reference(self) -> Array:
        """Reference values of the coordinates, shape (N, 7).

        Exudyn's own `GetODE2CoordinatesTotal` frees memory wrongly in 1.13.6 (beyond about 100 coordinates the
        process aborts), so the sum of reference and displacement is formed here.
        """
        data = self._system.mbs.systemData
        everything = np.array(data.GetODE2Coordinates(exu.ConfigurationType.Reference))
        return np.asarray(everything[self.numbers])

    def displacements(self, configuration: Any = exu.ConfigurationType.Current) -> Array:
        """Coordinates in a configuration of the scene, without reference values, shape (N, 7)."""
        return self._system.mbs.systemData.GetODE2Coordinates(configuration, copy=False)[self.numbers]

    def velocities(self, configuration: Any) -> Array:
        """Rates of the coordinates in a configuration of the scene, shape (N, 7)."""
        return self._system.mbs.systemData.GetODE2Coordinates_t(configuration)[self.numbers]

    def poses(self, displacements: Array) -> tuple[Array, Array, Array]:
        """Positions (N, 3), rotations (N, 3, 3) in beam axes and Euler parameters (N, 4) of coordinates, (N, 7)."""
        q = displacements + self.reference
        e = q[:, 3:]
        return q[:, :3], rotation_of_euler_parameters(e), e


def twists_by_coordinates(rotations: Array, parameters: Array) -> Array:
    """From rates of the coordinates of nodes to body-frame twists, shape (N, 6, 7).

    Parameters
    ----------
    rotations, parameters
        Rotation matrices (N, 3, 3) and Euler parameters (N, 4) of the nodes.
    """
    found = node_frames(rotations, parameters).swapaxes(1, 2).copy()
    found[:, 3:, 3:] *= 4.0
    return found


class NodeMotion(NamedTuple):
    """Nodes of one backbone at one time."""

    coordinates: Array  # (N, 7): Without reference values
    velocities: Array  # (N, 7): Their rates
    positions: Array  # (N, 3)
    rotations: Array  # (N, 3, 3)
    twists: Array  # (N, 6): Body-frame twists: velocities [m/s] and angular velocities [rad/s] in own axes

    @classmethod
    def of(cls, nodes: NodeCoordinates, configuration: Any) -> NodeMotion:
        """In one of Exudyn's configurations."""
        moved, rates = nodes.displacements(configuration), nodes.velocities(configuration)
        positions, rotations, parameters = nodes.poses(moved)
        twists = (twists_by_coordinates(rotations, parameters) @ rates[:, :, None])[:, :, 0]
        return cls(moved, rates, positions, rotations, twists)


def generalized_forces(wrenches: Array, rotations: Array, parameters: Array) -> Array:
    """Generalised forces on the coordinates of nodes, shape (7 N,).

    Parameters
    ----------
    wrenches
        ``[f, m]`` on every node in its own frame [N, N m], shape (N, 6).
    rotations, parameters
        As in `twists_by_coordinates`.
    """
    found = np.empty((len(wrenches), 7))
    found[:, :3] = (rotations @ wrenches[:, :3, None])[:, :, 0]
    found[:, 3:] = 4.0 * (euler_rate_matrix(parameters) @ wrenches[:, 3:, None])[:, :, 0]
    return found.reshape(-1)


def generalized_tangent(k: Array, moments: Array, to_twist: Array) -> Array:
    """Derivative of `generalized_forces` by the coordinates, shape (7 N, 7 N).

    Parameters
    ----------
    k
        ``H^T J H`` of this derivative ``J``, where ``H`` takes body-frame increments to coordinates; shape (6 N, 6 N).
    moments
        On every node in its own frame [N m], shape (N, 3). Along the Euler parameters themselves, which no increment
        moves, the derivative follows from them alone, because the forces are linear in these parameters.
    to_twist
        See `twists_by_coordinates`.
    """
    n, found = len(to_twist), k
    for _ in range(2):
        # By node, its six rows become seven; then the same of the columns.
        found = (to_twist.swapaxes(1, 2) @ found.reshape(n, 6, -1)).reshape(7 * n, -1).T
    # Sum over the axes of the moment of a constant antisymmetric matrix: G(de)^T m as a matrix times de.
    own = (moments @ _LINEAR).reshape(n, 4, 4)
    tangent = 0.25 * to_twist[:, 3:, 3:].swapaxes(1, 2) @ to_twist[:, 3:, 3:]
    every = np.arange(n)
    found.reshape(n, 7, n, 7)[every, 3:, every, 3:] += own - tangent.swapaxes(1, 2) @ own @ tangent
    return found


#: ``(m @ _LINEAR).reshape(4, 4) @ e`` is ``4 H(e) m``, with ``H`` of `euler_rate_matrix`.
_LINEAR: Array = 4.0 * euler_rate_matrix(np.eye(4)).transpose(2, 1, 0).reshape(3, 16)
