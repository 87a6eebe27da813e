"""Numbers of a robot's items in Exudyn, its system, and whether they are where they were made.

A system keeps what is stored in ``mbs.variables`` and the user functions of its items. If these kept the system in
turn, neither would ever be freed: Python does not see the references that Exudyn holds.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import exudyn as exu

from tdcr_fe.elements import Array


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


def item_names(mbs: exu.MainSystem, **numbers: Sequence[Any]) -> dict[tuple[str, int], str]:
    """The present names of items, given by kind (``Object``, ``Node``, ``Load``) and Exudyn's numbers."""
    return {(kind, int(n)): _name(mbs, kind, n) for kind, those in numbers.items() for n in those}


def unchanged(names: Mapping[tuple[str, int], str], mbs: exu.MainSystem) -> bool:
    """Whether every item of these names has its number."""
    counts = item_counts(mbs)
    return all(n < counts[kind] and _name(mbs, kind, n) == name for (kind, n), name in names.items())


def removed(names: Mapping[tuple[str, int], str], mbs: exu.MainSystem) -> bool:
    """Whether none of the items of these names is in the system."""
    present = {(kind, _name(mbs, kind, n)) for kind, count in item_counts(mbs).items() for n in range(count)}
    return not any((kind, name) in present for (kind, _), name in names.items())


def item_counts(mbs: exu.MainSystem) -> dict[str, int]:
    """Number of objects, nodes, loads and sensors of a system."""
    of = mbs.systemData
    items = {"Object": of.NumberOfObjects(), "Node": of.NumberOfNodes()}
    return {**items, "Load": of.NumberOfLoads(), "Sensor": of.NumberOfSensors()}


def data_coordinates(mbs: exu.MainSystem, first: Any, count: int, configuration: Any) -> Array:
    """So many data coordinates in the memory of Exudyn, from those of a data node on, in one of its configurations."""
    data = mbs.systemData
    at = int(data.GetNodeLTGData(first)[0])
    return data.GetDataCoordinates(configuration, copy=False)[at : at + count]


def _name(mbs: exu.MainSystem, kind: str, number: Any) -> str:
    read = getattr(mbs, f"Get{kind}Parameter")
    return str(read(number, "name"))


@dataclass(frozen=True)
class Connectors:
    """Exudyn's numbers of the objects of a robot."""

    forces: Any  # The object that applies the forces of tendons and inside the sections
    springs: list[list[Any]]  # By tendon, the spring-damper of every segment, which is only drawn
    # By tendon, markers of its holes, base plate first; they are moved where tendons shift inside their holes
    hole_markers: list[list[Any]]
    beams: list[Any]  # The beam elements, base first
    # All other objects of the robot, none of which resists a motion of the backbone: disks, masses, base joint
    others: list[Any]

    @property
    def drawn(self) -> list[int]:
        """Numbers of all spring-dampers."""
        return [int(spring) for springs in self.springs for spring in springs]

    @property
    def object_numbers(self) -> list[int]:
        """Numbers of all its objects."""
        return [int(i) for i in (self.forces, *self.beams, *self.drawn, *self.others)]


@dataclass(frozen=True)
class Clamp:
    """A base plate fixed to ground by a joint."""

    joint: Any  # Exudyn's number of the joint, which blocks all six motions
    position: Array  # (3,): Where it fixes the base node [m]
    rotation: Array  # (3, 3): Rotation to which it fixes the base node, in beam axes
