"""Scales of residuals and steps: sizes relative to forces, moments and lengths of the robots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.actuation import TendonActuation
from tdcr_fe.elements.backbone import BackboneMesh
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.scene.mesh import of_backbone
from tdcr_fe.solve.equations.reduction import BodyFrameReduction

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ResidualScales:
    """Scales of the residuals.

    Attributes
    ----------
    weights : ndarray
        By unknown: forces by one, moments by a lever of a fiftieth of the length, gaps in joints by the length.
    nodes : int
        Number of beam nodes.
    forces : int
        Number of unknowns whose residual is a force or moment; gaps follow.
    length : float
        Of the longest backbone [m].
    elastic_force : float
        EI / L^2 of the softest robot, the smallest scale of forces [N]; a base that gives way is no part of it.
    """

    weights: Array
    nodes: int
    forces: int
    length: float
    elastic_force: float

    @classmethod
    def of(cls, robots: Sequence[TendonActuation], reduction: BodyFrameReduction) -> ResidualScales:
        """Scales of a scene."""
        length = max(float(r.mesh.arc_lengths[-1]) for r in robots)
        nodes = np.tile(np.repeat((1.0, 50.0 / length), 3), reduction.nodes)
        other = np.ones(len(reduction.other_coordinates))
        gaps = np.full(len(reduction.other_multipliers), 1.0 / length)
        elastic = min(_elastic_force(r.mesh) for r in robots)
        return cls(
            np.concatenate((nodes, other, gaps)), reduction.nodes, len(nodes) + len(other), length, elastic
        )

    def relative_residual(self, unbalanced: Array, base_tension: Sequence[Array], load_size: float) -> float:
        """Largest unbalanced force, moment or gap over its scale [1].

        Parameters
        ----------
        unbalanced
            Reduced residual.
        base_tension
            By robot [N].
        load_size
            Size of the applied loads [N].
        """
        size = np.abs(unbalanced * self.weights)
        largest = max([max(t.tolist(), default=0.0) for t in base_tension])
        scale = largest + self.elastic_force + load_size
        if size.size == self.forces:
            return float(size.max()) / scale
        return max(float(size[: self.forces].max()) / scale, float(size[self.forces :].max()))

    def displacement_error(self, forces: TendonForces, displacement: Array, which: NDArray[np.int_]) -> float:
        """Largest deviation from prescribed tendon displacements over the length [1].

        Taut: the displacement is met. Slack: the base has let out more than the tendon needs.

        Parameters
        ----------
        forces
            Of the robot.
        displacement
            Of every tendon [m], shape (m,).
        which
            The tendons whose displacement is prescribed.
        """
        gap = (forces.field.base_slip - displacement)[which]
        error = np.where(forces.base_tension[which] > 0.0, np.abs(gap), np.maximum(-gap, 0.0))
        return float(np.max(error)) / self.length

    def step_size(self, step: Array) -> float:
        """Largest displacement over the length, or rotation, of any node in a step [1]."""
        largest = np.abs(step[: 6 * self.nodes].reshape(-1, 6)).max(axis=0).tolist()
        return max(max(largest[:3]) / self.length, *largest[3:])


def _elastic_force(mesh: BackboneMesh) -> float:
    """Smallest EI of the backbone over the square of its length [N], without the element that stands for the base."""
    length = float(mesh.arc_lengths[-1])
    bending = mesh.stiffness[of_backbone(mesh), 5]
    return float(np.min(bending)) / length**2
