"""The bodies of a robot in a scene: disks, tip mass, gravity on them, the joint of the base; and springs to ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BEAM_TO_SECTION, BackboneMesh, reference_poses
from tdcr_fe.elements.disks import add_disk, base_plate
from tdcr_fe.elements.forces import GroundSprings
from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.loading import Vector
from tdcr_fe.model.robot import Robot

Array = NDArray[np.float64]

#: Colour of the disks (RGBA).
DISK_COLOR = (0.55, 0.65, 0.80, 0.6)
#: Smallest thickness of drawn disks, and radius and thickness of the drawn base plate [disk radius].
DRAWN_DISK, DRAWN_PLATE_RADIUS, DRAWN_PLATE = 0.1, 1.2, 0.2


@dataclass(frozen=True)
class BasePose:
    """Pose of the base plate in the world.

    Attributes
    ----------
    position : ndarray, shape (3,)
        [m].
    rotation : ndarray, shape (3, 3)
        The robot points along the third column.
    """

    position: Array
    rotation: Array

    @classmethod
    def of(cls, position: Any, rotation: Any) -> BasePose:
        """Pose from the arguments of the user; None is the origin, and the identity.

        Raises
        ------
        ValueError
            The position does not have three finite components, or the rotation is no rotation matrix.
        """
        p = np.zeros(3) if position is None else np.asarray(position, dtype=float)
        r = np.eye(3) if rotation is None else np.asarray(rotation, dtype=float)
        if p.shape != (3,) or not np.all(np.isfinite(p)):
            raise ValueError(f"basePosition {position!r}; must be three finite coordinates [m]")
        if r.shape != (3, 3) or not np.allclose(r @ r.T, np.eye(3), atol=1e-9):
            raise ValueError("baseRotationMatrix must be a rotation matrix of shape (3, 3)")
        if np.linalg.det(r) < 0.0:
            raise ValueError("baseRotationMatrix is a reflection; must be a rotation matrix")
        return cls(p, r)


def base_pose(mbs: exu.MainSystem, position: Any, rotation: Any, marker: Any) -> BasePose:
    """Pose of the base plate: as given, else that of the marker which carries it.

    Parameters
    ----------
    mbs
        The system.
    position, rotation
        As given by the user, or None.
    marker
        Rigid marker that carries the base plate, or None.

    Raises
    ------
    ValueError
        Position or rotation are not valid, or differ from those of the marker in the reference configuration.
    """
    pose = BasePose.of(position, rotation)
    if marker is None:
        return pose
    variable, reference = exu.OutputVariableType, exu.ConfigurationType.Reference
    try:
        at = np.array(mbs.GetMarkerOutput(marker, variable.Position, reference), dtype=float)
        axes = np.array(mbs.GetMarkerOutput(marker, variable.RotationMatrix, reference), dtype=float)
    except Exception as unknown:
        raise ValueError(
            f"baseMarker {marker!r} has no position and rotation; must be a rigid marker"
        ) from unknown
    axes = axes.reshape(3, 3)
    scale = max(1.0, float(np.abs(at).max()))
    if position is not None and not np.allclose(pose.position, at, rtol=0.0, atol=1e-6 * scale):
        raise ValueError(
            f"basePosition {pose.position.tolist()} differs from that of baseMarker {marker}, {at.tolist()}, in the "
            "reference configuration; leave it out to take that of the marker"
        )
    if rotation is not None and not np.allclose(pose.rotation, axes, rtol=0.0, atol=1e-6):
        raise ValueError(
            f"baseRotationMatrix differs from the axes of baseMarker {marker}, {axes.tolist()}, in the reference "
            "configuration; leave it out to take those of the marker"
        )
    return BasePose.of(at, axes)


def section_marker(mbs: exu.MainSystem, node: Any, name: str) -> Any:
    """Add a rigid marker to a backbone node, its axes those of the section."""
    turn = exu.HT(rotation=BEAM_TO_SECTION.T, translation=[0.0, 0.0, 0.0])
    return mbs.AddMarker(eii.MarkerNodeRigid(name=name, nodeNumber=node, localHT=turn))


def add_disks(
    mbs: exu.MainSystem, robot: Robot, mesh: BackboneMesh, nodes: list[Any], name: str
) -> list[Any]:
    """Add a rigid body for every disk and return the body numbers, base first."""
    disks = robot.disks
    return [
        add_disk(
            mbs,
            nodes[mesh.node_at(s)],
            disks.mass,
            disks.radius,
            disks.thickness,
            f"{name}.disk{k}",
            DISK_COLOR,
            DRAWN_DISK * disks.radius,
        )
        for k, s in enumerate(disks.positions, start=1)
    ]


def add_tip_mass(mbs: exu.MainSystem, robot: Robot, tip_node: Any, name: str) -> list[Any]:
    """Add the point mass at the tip; return its body number in a list, empty where there is none."""
    if not robot.tip_mass > 0.0:
        return []
    body = eii.ObjectRigidBody(
        name=f"{name}.payload", nodeNumber=tip_node, mass=robot.tip_mass, inertia=[0.0] * 6
    )
    return [mbs.AddObject(body)]


def add_gravity(mbs: exu.MainSystem, bodies: list[Any], gravity: Vector, name: str) -> list[Any]:
    """Add the weight of bodies and return the load numbers; none without gravity [m/s^2]."""
    if not any(gravity):
        return []
    loads = []
    for k, body in enumerate(bodies):
        marker = mbs.AddMarker(eii.MarkerBodyMass(name=f"{name}.mMass{k}", bodyNumber=body))
        loads.append(mbs.AddLoad(eii.Gravity(markerNumber=marker, loadVector=list(gravity))))
    return loads


def add_ground(
    mbs: exu.MainSystem, pose: BasePose, disk_radius: float, name: str, graphics: Sequence[Any] = ()
) -> Any:
    """Add a base plate on ground and return the marker to which the robot is joined."""
    plate = base_plate(
        pose.position,
        pose.rotation,
        DRAWN_PLATE_RADIUS * disk_radius,
        DRAWN_PLATE * disk_radius,
        DISK_COLOR,
    )
    ground = mbs.AddObject(
        eii.ObjectGround(
            name=f"{name}.ground", visualization=eii.VObjectGround(graphicsData=[plate, *graphics])
        )
    )
    frame = exu.HT(rotation=pose.rotation, translation=pose.position)
    return mbs.AddMarker(eii.MarkerBodyRigid(name=f"{name}.mGround", bodyNumber=ground, localHT=frame))


def ground_springs(robot: Robot, mesh: BackboneMesh, base: BasePose | None = None) -> GroundSprings | None:
    """Springs from the backbone to ground, at rest where the unloaded robot is; None where there are none.

    Parameters
    ----------
    robot, mesh
        Description and mesh, with a node at every spring.
    base
        Pose of the base plate in the world; None is that of the world.
    """
    if not robot.springs:
        return None
    base = BasePose.of((0.0, 0.0, 0.0), None) if base is None else base
    positions, _ = reference_poses(mesh, base.position, base.rotation @ BEAM_TO_SECTION)
    nodes = np.array([mesh.node_at(spring.at, ARC_TOLERANCE) for spring in robot.springs])
    sideways = base.rotation @ np.diag([1.0, 1.0, 0.0]) @ base.rotation.T
    stiffness = np.array([spring.stiffness for spring in robot.springs])[:, None, None] * sideways
    return GroundSprings(nodes, stiffness, positions[nodes])


def add_base_joint(mbs: exu.MainSystem, carrier: Any, base: Any, name: str) -> Any:
    """Join the base marker to the marker that carries it, in all six motions; return the joint."""
    return mbs.AddObject(
        eii.GenericJoint(
            name=f"{name}.baseJoint",
            markerNumbers=[carrier, base],
            constrainedAxes=[1, 1, 1, 1, 1, 1],
            visualization=eii.VObjectJointGeneric(show=False),
        )
    )
