"""Disks as rigid bodies on backbone nodes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import exudyn as exu
import exudyn.graphics as graphics
import exudyn.itemInterface as eii
import numpy as np

from tdcr_fe.elements import Array


def disk_inertia(mass: float, radius: float, thickness: float) -> Array:
    """Inertia of a solid cylinder about its centre, in beam axes (axis first) [kg m^2], shape (6,).

    Exudyn's order: Jxx, Jyy, Jzz, Jyz, Jxz, Jxy.
    """
    axial = 0.5 * mass * radius**2
    across = mass * (3.0 * radius**2 + thickness**2) / 12.0
    return np.array([axial, across, across, 0.0, 0.0, 0.0])


def add_disk(
    mbs: exu.MainSystem,
    node: Any,
    mass: float,
    radius: float,
    thickness: float,
    name: str,
    color: Sequence[float],
    draw_thickness: float,
) -> Any:
    """Add one disk to a backbone node and return its body number.

    Parameters
    ----------
    mbs
        The system.
    node
        Number of its backbone node.
    mass, radius, thickness
        Of the disk [kg], [m], [m].
    name
        Name of the item.
    color
        RGBA.
    draw_thickness
        Smallest drawn thickness [m].
    """
    half = 0.5 * max(thickness, draw_thickness)
    cylinder = _cylinder((-half, 0.0, 0.0), (2.0 * half, 0.0, 0.0), radius, tuple(color))
    return mbs.AddObject(
        eii.ObjectRigidBody(
            name=name,
            nodeNumber=node,
            mass=mass,
            inertia=disk_inertia(mass, radius, thickness),
            visualization=eii.VObjectRigidBody(graphicsData=[cylinder]),
        )
    )


@lru_cache(maxsize=64)
def _cylinder(
    start: tuple[float, ...], axis: tuple[float, ...], radius: float, color: tuple[float, ...]
) -> Any:
    """Graphics of a disk or plate, cached: creating them takes as long as solving several steps."""
    return graphics.Cylinder(pAxis=list(start), vAxis=list(axis), radius=radius, color=list(color), nTiles=32)


def base_plate(
    position: Array, rotation: Array, radius: float, thickness: float, color: Sequence[float]
) -> Any:
    """Graphics of a base plate, for a ground object.

    Parameters
    ----------
    position, rotation
        Pose of the base; the plate is below it along the third axis; shapes (3,) and (3, 3).
    radius, thickness
        Of the plate [m].
    color
        RGBA.
    """
    axis = thickness * np.asarray(rotation)[:, 2]
    return _cylinder(tuple((position - axis).tolist()), tuple(axis.tolist()), radius, tuple(color))
