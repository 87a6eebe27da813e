"""Motion of the nodes of a robot in a scene, and the inertia of its backbone and disks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.disks import disk_inertia
from tdcr_fe.elements.native.actuation import TendonActuation
from tdcr_fe.elements.native.coordinates import NodeCoordinates, generalized_forces, twists_by_coordinates
from tdcr_fe.elements.native.items import SystemReference
from tdcr_fe.model.loading import Vector
from tdcr_fe.model.robot import Robot

Array = NDArray[np.float64]


class Motion(NamedTuple):
    """Nodes of a robot at one time.

    Attributes
    ----------
    coordinates, velocities, accelerations : ndarray, shape (7 N,)
        The coordinates without reference values.
    positions, rotations, parameters : ndarray
        Shapes (N, 3), (N, 3, 3) and, of Euler parameters, (N, 4).
    linear, angular : ndarray, shape (N, 3)
        Velocities, of the positions in world axes, of the rotations in the nodes' own.
    """

    coordinates: Array
    velocities: Array
    accelerations: Array
    positions: Array
    rotations: Array
    parameters: Array
    linear: Array
    angular: Array

    @classmethod
    def of(cls, system: SystemReference, nodes: NodeCoordinates, configuration: Any) -> Motion:
        """In one of Exudyn's configurations of a system."""
        data, numbers = system.mbs.systemData, nodes.numbers
        moved = np.asarray(data.GetODE2Coordinates(configuration))[numbers]
        rates = np.asarray(data.GetODE2Coordinates_t(configuration))[numbers]
        accelerations = np.asarray(data.GetODE2Coordinates_tt(configuration))[numbers]
        positions, rotations, parameters = nodes.poses(moved)
        twists = (twists_by_coordinates(rotations, parameters) @ rates[:, :, None])[:, :, 0]
        return cls(
            moved.ravel(), rates.ravel(), accelerations.ravel(),
            positions, rotations, parameters, rates[:, :3], twists[:, 3:],
        )  # fmt: skip


@dataclass(frozen=True)
class Masses:
    """Inertia of a robot.

    Attributes
    ----------
    of_elements : ndarray, shape (E,)
        [kg].
    rotary : ndarray, shape (E, 3)
        About the beam's axes [kg m^2].
    of_nodes : ndarray, shape (N,)
        Of disks and tip [kg].
    inertia : ndarray, shape (N, 3)
        Of the disks, about the beam's axes [kg m^2].
    gravity : ndarray, shape (3,)
        [m/s^2].
    """

    of_elements: Array
    rotary: Array
    of_nodes: Array
    inertia: Array
    gravity: Array

    @classmethod
    def of(cls, robot: Robot, actuation: TendonActuation, gravity: Vector) -> Masses:
        """Of a robot and its mesh, with the acceleration of gravity."""
        mesh, disks = actuation.mesh, robot.disks
        masses = np.zeros(len(mesh.arc_lengths))
        inertia = np.zeros((len(masses), 3))
        for s in disks.positions:
            k = mesh.node_at(s)
            masses[k] += disks.mass
            inertia[k] += disk_inertia(disks.mass, disks.radius, disks.thickness)[:3]
        masses[-1] += robot.tip_mass
        lengths = mesh.lengths
        rotary = mesh.rotary_inertia * lengths[:, None]
        return cls(mesh.mass_per_length * lengths, rotary, masses, inertia, np.array(gravity, dtype=float))

    def kinetic(self, motion: Motion) -> float:
        """Kinetic energy [J]: velocities are linear between the nodes, as in Exudyn's beams."""
        found = np.sum(self.of_nodes[:, None] * motion.linear**2) + np.sum(self.inertia * motion.angular**2)
        for of_elements, v in ((self.of_elements[:, None], motion.linear), (self.rotary, motion.angular)):
            near, far = v[:-1], v[1:]
            found += np.sum(of_elements * (near**2 + near * far + far**2)) / 3.0
        return 0.5 * float(found)

    def potential(self, positions: Array) -> float:
        """Potential energy in the field of gravity [J], zero at the origin of the world."""
        middle = 0.5 * (positions[:-1] + positions[1:])
        moment = self.of_elements @ middle + self.of_nodes @ positions
        return -float(self.gravity @ moment)

    def inertial_forces(self, motion: Motion) -> Array:
        """Forces that accelerate the masses, on the coordinates of the nodes, shape (7 N,); zero in statics."""
        rotations, parameters = motion.rotations, motion.parameters
        rates = motion.accelerations.reshape(-1, 7)
        turning = (twists_by_coordinates(rotations, parameters) @ rates[:, :, None])[:, 3:, 0]
        linear = _distributed(self.of_elements[:, None], self.of_nodes[:, None], rates[:, :3])
        moment = _distributed(self.rotary, self.inertia, turning)
        moment += np.cross(motion.angular, _distributed(self.rotary, self.inertia, motion.angular))
        linear = (rotations.swapaxes(1, 2) @ linear[:, :, None])[:, :, 0]
        return generalized_forces(np.concatenate((linear, moment), axis=1), rotations, parameters)


def _distributed(of_elements: Array, of_nodes: Array, rates: Array) -> Array:
    """Masses or inertias times what is linear between the nodes, by node, shape (N, 3)."""
    found = of_nodes * rates
    found[:-1] += of_elements * (2.0 * rates[:-1] + rates[1:]) / 6.0
    found[1:] += of_elements * (2.0 * rates[1:] + rates[:-1]) / 6.0
    return np.asarray(found)
