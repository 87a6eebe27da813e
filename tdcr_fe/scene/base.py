"""The base of a robot in a scene: its pose, the ground, and the joint to what carries it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from exudyn.rigidBodyUtilities import AngularVelocity2EulerParameters_t

from tdcr_fe.elements import Array


@dataclass(frozen=True)
class BasePose:
    """Pose of the base plate in the world."""

    position: Array  # [m], shape (3,)
    rotation: Array  # the robot points along the third column, shape (3, 3)


def base_pose(mbs: exu.MainSystem, position: Any, rotation: Any, marker: Any) -> BasePose:
    """Pose of the base plate: as given by the user, else that of the marker which carries it.

    Parameters
    ----------
    mbs
        The system.
    position, rotation
        As given by the user; None is the origin and the identity, or the marker's.
    marker
        Rigid marker that carries the base plate, or None.

    Raises
    ------
    ValueError
        Position or rotation are not valid, or differ from those of the marker in the reference configuration.
    """
    p = np.zeros(3) if position is None else np.array(position, dtype=float)
    r = np.eye(3) if rotation is None else np.array(rotation, dtype=float)
    if r.shape != (3, 3) or not np.allclose(r @ r.T, np.eye(3), atol=1e-9) or np.linalg.det(r) < 0.0:
        text = "must be a rotation matrix of shape (3, 3), and not a reflection"
        raise ValueError(f"referenceRotationMatrix {text}")
    if marker is None:
        return BasePose(p, r)
    variable, reference = exu.OutputVariableType, exu.ConfigurationType.Reference
    try:
        at = np.array(mbs.GetMarkerOutput(marker, variable.Position, reference), dtype=float)
        axes = np.array(mbs.GetMarkerOutput(marker, variable.RotationMatrix, reference), dtype=float)
    except Exception as unknown:
        text = "has no position and rotation; must be a rigid marker"
        raise ValueError(f"baseMarker {marker!r} {text}") from unknown
    axes = axes.reshape(3, 3)
    size = max(1.0, float(np.abs(at).max()))
    for name, given, of_marker, scale in (
        ("referencePosition", position, at, size),
        ("referenceRotationMatrix", rotation, axes, 1.0),
    ):
        if given is not None and not np.allclose(given, of_marker, rtol=0.0, atol=1e-6 * scale):
            raise ValueError(
                f"{name} {np.array(given).tolist()} differs from that of baseMarker {marker}, {of_marker.tolist()}, in "
                "the reference configuration; leave it out to take that of the marker"
            )
    return BasePose(at, axes)


def set_moving(mbs: exu.MainSystem, nodes: Sequence[Any], at: Array, motion: Array) -> None:
    """Give nodes initial velocities as of a rigid body, of velocity and angular velocity at a place, shape (2, 3)."""
    for node in nodes:
        reference = np.array(mbs.GetNodeParameter(node, "referenceCoordinates"))
        velocity = motion[0] + np.cross(motion[1], reference[:3] - at)
        rates = AngularVelocity2EulerParameters_t(motion[1], reference[3:])
        mbs.SetNodeParameter(node, "initialVelocities", [*velocity, *rates])


def add_ground(mbs: exu.MainSystem, pose: BasePose, drawn: Sequence[Any], name: str) -> Any:
    """Add ground below the base, with its graphics; return the marker to which the robot is joined."""
    ground = eii.ObjectGround(
        name=f"{name}.ground", visualization=eii.VObjectGround(graphicsData=list(drawn))
    )
    frame = exu.HT(rotation=pose.rotation, translation=pose.position)
    number = mbs.AddObject(ground)
    return mbs.AddMarker(eii.MarkerBodyRigid(name=f"{name}.mGround", bodyNumber=number, localHT=frame))


def add_base_joint(mbs: exu.MainSystem, carrier: Any, base: Any, name: str) -> Any:
    """Join the base marker to the marker that carries it, in all six motions; return the joint."""
    fixed = {"constrainedAxes": [1] * 6, "visualization": eii.VObjectJointGeneric(show=False)}
    return mbs.AddObject(eii.GenericJoint(name=f"{name}.baseJoint", markerNumbers=[carrier, base], **fixed))
