"""Exudyn's items of a robot, and the markers by which its tendons are drawn in their holes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class Connectors:
    """Exudyn's numbers of the objects of a robot.

    Attributes
    ----------
    forces : object
        The object that applies the forces of tendons and inside the sections.
    springs : list of list
        By tendon, the spring-damper of every segment, which is only drawn.
    hole_markers : list of list
        By tendon, markers of its holes, base plate first; they are moved where tendons shift inside their holes.
    beams : list
        The beam elements, base first.
    others : list
        All other objects of the robot, none of which resists a motion of the backbone: disks, masses, base joint.
    """

    forces: Any
    springs: list[list[Any]]
    hole_markers: list[list[Any]] = field(default_factory=list)
    beams: list[Any] = field(default_factory=list)
    others: list[Any] = field(default_factory=list)

    @property
    def object_numbers(self) -> list[int]:
        """Numbers of all its objects."""
        springs = [spring for springs in self.springs for spring in springs]
        return [int(i) for i in (self.forces, *self.beams, *springs, *self.others)]


@dataclass(frozen=True)
class Clamp:
    """A base plate fixed to ground by a joint.

    Attributes
    ----------
    joint : object
        Exudyn's number of the joint, which blocks all six motions.
    position, rotation : ndarray
        Pose to which it fixes the base node, the rotation in beam axes; shapes (3,) and (3, 3).
    """

    joint: Any
    position: Array
    rotation: Array


def show_shifts(
    mbs: exu.MainSystem, connectors: Connectors, first_element: float, offsets: Array | None
) -> None:
    """Move the markers of the drawn tendons to where these lie in their holes.

    Parameters
    ----------
    mbs
        The system.
    connectors
        Items of the robot.
    first_element
        Length of its first beam [m].
    offsets
        Of the tendons in their holes, see `tdcr_fe.elements.forces.Measurement`; None where they cannot shift.
    """
    if offsets is None:
        return
    half = 0.5 * first_element
    for markers, of_tendon in zip(connectors.hole_markers, offsets, strict=True):
        for k, (marker, offset) in enumerate(zip(markers, of_tendon.tolist(), strict=False)):
            # The base plate's holes sit on the first beam, whose origin is its middle.
            x = -half if k == 0 else 0.0
            mbs.SetMarkerParameter(marker, "localPosition", [x, offset[1], offset[2]])
