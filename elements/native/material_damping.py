"""Damping by the material of the backbone (Kelvin-Voigt), as an object of Exudyn with its own Jacobian.

The wrench of a section grows by the retardation time ``tau`` times its stiffness times the rate of its strain. With the
relative twists ``xi`` of the elements, their stiffness ``K`` and the twist velocities ``V`` of the nodes in their own
frames, ``d xi / dt = B(xi) V``, and the wrenches on the nodes are ``-B^T tau K B V``: the gradient of half the
dissipated power, Rayleigh's dissipation function. Exudyn 1.13.6 drops the damping matrix of `BeamSection` for
`ObjectBeamGeometricallyExact`, which is why this is an object of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import relative_twists, strain_matrices
from tdcr_fe.elements.native.coordinates import NodeCoordinates, generalized_forces, twists_by_coordinates
from tdcr_fe.elements.native.items import SystemReference
from tdcr_fe.elements.poses import skew
from tdcr_fe.elements.section import wrenches_on_nodes

Array = NDArray[np.float64]

_EYE6 = np.eye(6)
#: Step of the central differences by the relative twists [1].
_STEP = 1e-5


class Motion(NamedTuple):
    """Elements of a backbone in motion."""

    rotations: Array  # Of the nodes, shapes (N, 3, 3) and (N, 4)
    parameters: Array  # as `rotations`
    velocities: Array  # (N, 6): Twists ``[v, w]`` of the nodes in their own frames
    twists: Array  # (E, 6): Of the elements, length times strain
    by_nodes: Array  # (E, 6, 12): Change of the twists by increments of both nodes
    rates: Array  # (E, 6): Of the twists [m/s, rad/s]

    @property
    def of_both_nodes(self) -> Array:
        """Velocities of both nodes of every element, shape (E, 12)."""
        return np.concatenate((self.velocities[:-1], self.velocities[1:]), axis=1)


class MaterialDamping:
    """Damping of one backbone in a scene.

    Parameters
    ----------
    system
        The system.
    name
        Of the item.
    nodes
        Exudyn's numbers of the nodes, base first.
    retardation
        Retardation time of every element [s], shape (E,).

    Attributes
    ----------
    item
        Exudyn's number of the object; its user functions are set by `tdcr_fe.elements.native.hooks.SceneHooks`.
    retardation : ndarray, shape (E,)
        [s].
    """

    def __init__(self, system: SystemReference, name: str, nodes: Sequence[Any], retardation: Array) -> None:
        self.retardation = retardation
        self._system = system
        self._coordinates = NodeCoordinates(system, nodes)
        n = len(nodes)
        self.item = system.mbs.AddObject(
            eii.ObjectGenericODE2(
                name=name, nodeNumbers=list(nodes), visualization=eii.VObjectGenericODE2(show=False)
            )
        )
        self._at_rest = np.zeros(7 * n)
        # Rows and columns of the blocks of neighbours in a tridiagonal matrix of nodes, 14 x 14 an element.
        of_element = 7 * np.arange(n - 1)[:, None] + np.arange(14)
        self._rows = np.repeat(of_element, 14, axis=1).ravel()
        self._columns = np.tile(of_element, (1, 14)).ravel()

    def motion(self, displacements: Array, velocities: Array) -> Motion:
        """Rates of the elements' twists.

        Parameters
        ----------
        displacements
            Coordinates of the nodes, without reference values, shape (7 N,).
        velocities
            Rates of the coordinates, shape (7 N,).
        """
        positions, rotations, parameters = self._coordinates.poses(displacements.reshape(-1, 7))
        to_twist = twists_by_coordinates(rotations, parameters)
        moving = (to_twist @ velocities.reshape(-1, 7, 1))[:, :, 0]
        twists = relative_twists(positions, rotations)
        by_nodes = strain_matrices(twists)
        both = np.concatenate((moving[:-1], moving[1:]), axis=1)
        rates = (by_nodes @ both[:, :, None])[:, :, 0]
        return Motion(rotations, parameters, moving, twists, by_nodes, rates)

    def power(self, twist_stiffness: Array, displacements: Array, velocities: Array) -> float:
        """Power that the material dissipates [W]; arguments as in `forces`."""
        if not velocities.any():
            return 0.0
        rates = self.motion(displacements, velocities).rates
        return float(np.sum(self._viscosity(twist_stiffness) * rates**2))

    def dissipated(
        self, twist_stiffness: Array, start: tuple[Array, Array], end: tuple[Array, Array]
    ) -> float:
        """Energy that the material dissipates in a step [J]: mean stress times the change of strain, over all elements.

        Parameters
        ----------
        twist_stiffness
            As in `forces`.
        start, end
            Coordinates and velocities of the nodes, see `motion`.
        """
        before, after = self.motion(*start), self.motion(*end)
        stress = 0.5 * self._viscosity(twist_stiffness) * (before.rates + after.rates)
        return float(np.sum(stress * (after.twists - before.twists)))

    def forces(self, twist_stiffness: Array, displacements: Array, velocities: Array) -> Array:
        """Generalised forces on the coordinates of the nodes, shape (7 N,); zero at rest.

        Parameters
        ----------
        twist_stiffness
            Stiffness by the twists of the elements [N/m, N m], shape (E, 6).
        displacements, velocities
            As in `motion`.
        """
        if not velocities.any():
            return self._at_rest
        return self._generalized(twist_stiffness, self.motion(displacements, velocities))

    def jacobian(
        self,
        twist_stiffness: Array,
        displacements: Array,
        velocities: Array,
        by_position: float,
        by_velocity: float,
    ) -> exu.MatrixContainer:
        """Jacobian of the left-hand side, minus the forces, by the coordinates of the nodes.

        Parameters
        ----------
        twist_stiffness, displacements, velocities
            As in `forces`.
        by_position, by_velocity
            Factors that Exudyn gives to derivatives by positions and velocities.
        """
        container = exu.MatrixContainer()
        n = len(self._at_rest)
        if by_velocity == 0.0 and not velocities.any():
            container.SetWithSparseMatrix(np.zeros((0, 3)), n, n)
            return container
        state = self.motion(displacements, velocities)
        resist = self._viscosity(twist_stiffness)
        transposed = state.by_nodes.swapaxes(1, 2)
        blocks = -by_velocity * (transposed @ (resist[:, :, None] * state.by_nodes))
        if by_position != 0.0:
            blocks += by_position * self._by_poses(resist, state)
        # From increments of both nodes to coordinates, on both sides.
        to_twist = twists_by_coordinates(state.rotations, state.parameters)
        both = np.zeros((len(blocks), 12, 14))
        both[:, :6, :7], both[:, 6:, 7:] = to_twist[:-1], to_twist[1:]
        found = both.swapaxes(1, 2) @ blocks @ both
        # Exudyn's left-hand side has the opposite sign.
        triplets = np.column_stack((self._rows, self._columns, -found.ravel()))
        container.SetWithSparseMatrix(triplets, n, n)
        return container

    def _viscosity(self, twist_stiffness: Array) -> Array:
        return np.asarray(self.retardation[:, None] * twist_stiffness)

    def _generalized(self, twist_stiffness: Array, state: Motion) -> Array:
        """Generalised forces on the coordinates of the nodes, shape (7 N,)."""
        resisting = self._viscosity(twist_stiffness) * state.rates
        wrenches = wrenches_on_nodes(resisting, state.by_nodes)
        return generalized_forces(wrenches, state.rotations, state.parameters)

    @staticmethod
    def _by_poses(resist: Array, state: Motion) -> Array:
        """Derivative of the wrenches on both nodes by increments of these, at fixed rates of the coordinates.

        Written so that ``H^T`` times the derivative of the generalised forces follows, with the terms of the turning
        frames. Shape (E, 12, 12).
        """
        both = state.of_both_nodes[:, :, None]
        transposed = state.by_nodes.swapaxes(1, 2)
        # By the twists, at fixed velocities in the nodes' frames.
        shifts = np.concatenate((_EYE6, -_EYE6)) * _STEP
        b = strain_matrices(state.twists + shifts[:, None, :])
        w = -(b.swapaxes(-1, -2) @ (resist[:, :, None] * (b @ both)))[..., 0]
        by_twist = np.moveaxis((w[:6] - w[6:]) / (2.0 * _STEP), 0, -1)
        found = by_twist @ state.by_nodes
        # The velocities in the nodes' frames change as these turn.
        turning = np.zeros((len(found), 12, 12))
        wrench = -(transposed @ (resist * state.rates)[:, :, None])[:, :, 0]
        own = np.zeros_like(turning)
        for k, node in ((0, state.velocities[:-1]), (6, state.velocities[1:])):
            turning[:, k : k + 3, k + 3 : k + 6] = skew(node[:, :3])
            turning[:, k + 3 : k + 6, k + 3 : k + 6] = 0.5 * skew(node[:, 3:])
            own[:, k : k + 3, k + 3 : k + 6] = -skew(wrench[:, k : k + 3])
            own[:, k + 3 : k + 6, k + 3 : k + 6] = -0.5 * skew(wrench[:, k + 3 : k + 6])
        found -= transposed @ (resist[:, :, None] * (state.by_nodes @ turning))
        return found + own
