"""The compression at which the bays of a robot buckle, for the search for jumps to other branches of equilibria."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.actuation import TendonActuation
from tdcr_fe.scene.mesh import of_backbone

Array = NDArray[np.float64]


def buckling_shortening(robot: TendonActuation) -> Array:
    """By how much every element is shortened where its bay buckles [m], shape (E,).

    The load is ``pi^2 EI / a^2`` with the smallest bending stiffness EI of the bay and its length a, twice that of a
    last bay without a disk at its end, as in `tdcr_fe.solve.mesh_error.bay_loads`. Infinite where tendons follow the
    backbone, which do not compress bays.

    Parameters
    ----------
    robot
        Assembled in a scene.
    """
    mesh = robot.mesh
    if robot.section is not None and robot.section.tendons is not None:
        return np.full(len(mesh.lengths), np.inf)
    ends = robot.model.hole_nodes[1:]
    bays = np.searchsorted(ends, np.arange(len(mesh.lengths)), side="right")
    free = np.bincount(bays, mesh.lengths)
    if ends[-1] < len(mesh.lengths):
        free[-1] *= 2.0
    # An element that stands for the stiffness of the base is no part of a bay.
    bending = np.where(of_backbone(mesh), mesh.stiffness[:, 4:].min(axis=1), np.inf)
    softest = np.full(len(free), np.inf)
    np.minimum.at(softest, bays, bending)
    return np.asarray(mesh.lengths * np.pi**2 * (softest / free**2)[bays] / mesh.stiffness[:, 0])
