"""Exudyn's items of a robot: its system, the numbers of its items, and whether they are where they were made.

A system keeps what is stored in ``mbs.variables`` and the user functions of its items. If these kept the system in
turn, neither would ever be freed: Python does not see the references that Exudyn holds.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class SystemReference:
    """A reference to a system that does not keep it alive; shared by all items of the system.

    Parameters
    ----------
    mbs
        The system.
    """

    def __init__(self, mbs: exu.MainSystem) -> None:
        self._reference = weakref.ref(mbs)

    def bind(self, mbs: exu.MainSystem) -> None:
        """Refer to the same system by another Python object; Exudyn makes a new one where the last was dropped."""
        self._reference = weakref.ref(mbs)

    @property
    def mbs(self) -> exu.MainSystem:
        """The system.

        Raises
        ------
        ReferenceError
            No Python object of the system is left.
        """
        mbs = self._reference()
        if mbs is None:
            raise ReferenceError(
                "the Exudyn system of this robot has been deleted; keep mbs and its SystemContainer"
            )
        return mbs


@dataclass(frozen=True)
class RecordedItems:
    """Names of some objects, nodes and loads, by their numbers."""

    objects: tuple[tuple[int, str], ...]  # Number and name of each
    nodes: tuple[tuple[int, str], ...]  # as `objects`
    loads: tuple[tuple[int, str], ...] = ()  # as `objects`

    @classmethod
    def of(
        cls, mbs: exu.MainSystem, objects: Sequence[Any], nodes: Sequence[Any], loads: Sequence[Any] = ()
    ) -> RecordedItems:
        """The present names of objects, nodes and loads, given by Exudyn's numbers."""
        return cls(
            tuple((int(n), str(mbs.GetObjectParameter(n, "name"))) for n in objects),
            tuple((int(n), str(mbs.GetNodeParameter(n, "name"))) for n in nodes),
            tuple((int(n), str(mbs.GetLoadParameter(n, "name"))) for n in loads),
        )

    def joined(self, other: RecordedItems) -> RecordedItems:
        """These items and others."""
        return RecordedItems(self.objects + other.objects, self.nodes + other.nodes, self.loads + other.loads)

    def unchanged(self, mbs: exu.MainSystem) -> bool:
        """Whether every item has its number."""
        objects, nodes, loads = item_counts(mbs)
        return (
            all(n < objects and mbs.GetObjectParameter(n, "name") == name for n, name in self.objects)
            and all(n < nodes and mbs.GetNodeParameter(n, "name") == name for n, name in self.nodes)
            and all(n < loads and mbs.GetLoadParameter(n, "name") == name for n, name in self.loads)
        )

    def removed(self, mbs: exu.MainSystem) -> bool:
        """Whether none of the items is in the system."""
        objects, nodes, loads = item_counts(mbs)
        present = {("object", mbs.GetObjectParameter(n, "name")) for n in range(objects)}
        present |= {("node", mbs.GetNodeParameter(n, "name")) for n in range(nodes)}
        present |= {("load", mbs.GetLoadParameter(n, "name")) for n in range(loads)}
        own = {("object", name) for _, name in self.objects} | {("node", name) for _, name in self.nodes}
        own |= {("load", name) for _, name in self.loads}
        return not present & own


def item_counts(mbs: exu.MainSystem) -> tuple[int, int, int]:
    """Number of objects, of nodes and of loads of a system."""
    data = mbs.systemData
    return data.NumberOfObjects(), data.NumberOfNodes(), data.NumberOfLoads()


@dataclass
class Connectors:
    """Exudyn's numbers of the objects of a robot."""

    forces: Any  # The object that applies the forces of tendons and inside the sections
    springs: list[list[Any]]  # By tendon, the spring-damper of every segment, which is only drawn
    # By tendon, markers of its holes, base plate first; they are moved where tendons shift inside their holes
    hole_markers: list[list[Any]] = field(default_factory=list)
    beams: list[Any] = field(default_factory=list)  # The beam elements, base first
    # All other objects of the robot, none of which resists a motion of the backbone: disks, masses, base joint
    others: list[Any] = field(default_factory=list)

    @property
    def object_numbers(self) -> list[int]:
        """Numbers of all its objects."""
        springs = [spring for springs in self.springs for spring in springs]
        return [int(i) for i in (self.forces, *self.beams, *springs, *self.others)]


@dataclass(frozen=True)
class Clamp:
    """A base plate fixed to ground by a joint."""

    joint: Any  # Exudyn's number of the joint, which blocks all six motions
    position: Array  # Pose to which it fixes the base node, the rotation in beam axes; shapes (3,) and (3, 3)
    rotation: Array  # as `position`


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
