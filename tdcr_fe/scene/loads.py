"""A concentrated load on a robot in a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.elements.backbone import BEAM_TO_SECTION
from tdcr_fe.elements.native.items import SystemReference, data_coordinates
from tdcr_fe.model.loading import Load

Frame = Literal["world", "section"]


@dataclass
class PointLoad:
    """Exudyn's items of one concentrated load.

    ``mbs.SolveTDCR`` ramps the load from its value in the last solved state, `applied`, to the value `set` since. The
    former is part of the state of the system, so that copies of states, restarts and rejected steps restore it.

    Attributes
    ----------
    system : SystemReference
        The system of the load.
    lForce, lTorque
        Load numbers.
    frame : "world" or "section"
    nApplied
        Data node of `applied`.
    node
        Number of the backbone node that it acts on.
    """

    system: SystemReference
    lForce: Any
    lTorque: Any
    frame: Frame
    nApplied: Any
    node: Any

    def set(self, force: Sequence[float] | Array, moment: Sequence[float] | Array = (0.0, 0.0, 0.0)) -> None:
        """Set force [N] and moment [N m], each of shape (3,), in the load's frame."""
        checked = Load(0.0, force, moment)  # type: ignore[arg-type]
        for load, vector in ((self.lForce, checked.force), (self.lTorque, checked.moment)):
            self.system.mbs.SetLoadParameter(load, "loadVector", self._turn @ vector)

    @property
    def value(self) -> Array:
        """Force [N] and moment [N m] that were set, in the load's frame, shape (6,)."""
        mbs = self.system.mbs
        vectors = [mbs.GetLoadParameter(load, "loadVector") for load in (self.lForce, self.lTorque)]
        return (np.array(vectors, dtype=float) @ self._turn).ravel()

    @property
    def numbers(self) -> tuple[int, int]:
        """Numbers of its two loads of Exudyn."""
        return int(self.lForce), int(self.lTorque)

    @property
    def applied(self) -> Array:
        """Force [N] and moment [N m] in the last solved state, in the load's frame, shape (6,)."""
        if not self.system.mbs.systemIsConsistent:
            return np.zeros(6)
        return self._coordinates(exu.ConfigurationType.Current).copy()

    @applied.setter
    def applied(self, value: Array) -> None:
        self._coordinates(exu.ConfigurationType.Current)[:] = value

    def keep(self) -> None:
        """Make `applied` that of the initial configuration, too."""
        self._coordinates(exu.ConfigurationType.Initial)[:] = self.applied

    def _coordinates(self, configuration: Any) -> Array:
        """Coordinates of the data node in the memory of Exudyn, shape (6,)."""
        return data_coordinates(self.system.mbs, self.nApplied, 6, configuration)

    @property
    def _turn(self) -> Array:
        """Rotation from the load's frame to the axes in which Exudyn applies it."""
        return BEAM_TO_SECTION.T if self.frame == "section" else np.eye(3)


def add_point_load(system: SystemReference, node: Any, robot: str, name: str, frame: Frame) -> PointLoad:
    """Add a force and a torque to a backbone node, zero at first.

    Parameters
    ----------
    system
        The system.
    node
        Number of the backbone node.
    robot, name
        Names of the robot and of the load, for the items.
    frame
        "world", or "section" for a load that follows the section.

    Raises
    ------
    ValueError
        The frame is another.
    """
    if frame not in ("world", "section"):
        raise ValueError(f"load {name!r}: frame {frame!r}; must be 'world' or 'section'")
    mbs = system.mbs
    marker = mbs.AddMarker(eii.MarkerNodeRigid(name=f"{robot}.mLoad.{name}", nodeNumber=node))
    acts = {"markerNumber": marker, "loadVector": [0.0, 0.0, 0.0], "bodyFixed": frame == "section"}
    force = mbs.AddLoad(eii.Force(name=f"{robot}.force.{name}", **acts))
    torque = mbs.AddLoad(eii.Torque(name=f"{robot}.torque.{name}", **acts))
    zero = {"numberOfDataCoordinates": 6, "initialCoordinates": [0.0] * 6}
    applied = mbs.AddNode(eii.NodeGenericData(name=f"{robot}.applied.{name}", **zero))
    return PointLoad(system, force, torque, frame, applied, node)
