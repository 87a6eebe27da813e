"""Adds Exudyn's items of a robot: backbone, disks, tip mass, gravity, damping, markers, tendons."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import exudyn as exu
import exudyn.graphics as graphics
import exudyn.itemInterface as eii
import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.elements.backbone import BEAM_TO_SECTION, BackboneMesh, reference_poses
from tdcr_fe.elements.native.material_damping import MaterialDamping
from tdcr_fe.elements.poses import euler_parameters_of_rotation
from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.loading import Vector
from tdcr_fe.model.robot import Disks, Robot, Tendon
from tdcr_fe.scene.base import BasePose

#: Colours of backbone and disks (RGBA).
BACKBONE_COLOR = (0.20, 0.25, 0.35, 1.0)
DISK_COLOR = (0.55, 0.65, 0.80, 0.6)
#: Smallest thickness of drawn disks, and radius and thickness of the drawn base plate [disk radius].
DRAWN_DISK, DRAWN_PLATE_RADIUS, DRAWN_PLATE = 0.1, 1.2, 0.2
#: Colours of the tendons in turn (RGBA).
TENDON_COLORS = (
    (0.85, 0.33, 0.10, 1.0),
    (0.00, 0.45, 0.70, 1.0),
    (0.00, 0.60, 0.45, 1.0),
    (0.80, 0.47, 0.65, 1.0),
)


def section_marker(mbs: exu.MainSystem, node: Any, name: str) -> Any:
    """Add a rigid marker to a backbone node, its axes those of the section."""
    turn = exu.HT(rotation=BEAM_TO_SECTION.T, translation=[0.0, 0.0, 0.0])
    return mbs.AddMarker(eii.MarkerNodeRigid(name=name, nodeNumber=node, localHT=turn))


# ---------------------------------------------------------------- bodies


def add_backbone(
    mbs: exu.MainSystem, robot: Robot, mesh: BackboneMesh, pose: BasePose, name: str, color: Sequence[float]
) -> tuple[list[Any], list[Any]]:
    """Add nodes and beam elements of the backbone, of a colour (RGBA), and return their numbers, base first."""
    positions, rotations = reference_poses(mesh, pose.position, pose.rotation @ BEAM_TO_SECTION)
    hidden = {"show": False, "drawSize": -1.0, "color": list(color)}
    nodes = [
        mbs.AddNode(
            eii.NodeRigidBodyEP(
                name=f"{name}.node{k}", referenceCoordinates=[*position, *parameters], visualization=hidden
            )
        )
        for k, (position, parameters) in enumerate(
            zip(positions, euler_parameters_of_rotation(rotations), strict=True)
        )
    ]
    radius, angles = robot.backbone.radius, np.linspace(0.0, 2.0 * np.pi, 13)[:-1]
    outline = exu.BeamSectionGeometry()
    outline.crossSectionRadiusY = outline.crossSectionRadiusZ = radius
    points = radius * np.column_stack((np.cos(angles), np.sin(angles)))
    outline.polygonalPoints = exu.Vector2DList(points.tolist())
    beams = []
    for k, length in enumerate(mesh.lengths):
        section = exu.BeamSection()
        section.stiffnessMatrix = np.diag(mesh.stiffness[k])
        section.massPerLength = float(mesh.mass_per_length[k])
        section.inertia = np.diag(mesh.rotary_inertia[k])
        beam = eii.ObjectBeamGeometricallyExact(
            name=f"{name}.beam{k}",
            nodeNumbers=nodes[k : k + 2],
            length=float(length),
            sectionData=section,
            visualization={"show": True, "sectionGeometry": outline, "color": list(color)},
        )
        beams.append(mbs.AddObject(beam))
    return nodes, beams


def disk_inertia(disks: Disks) -> Array:
    """Inertia of a disk, a solid cylinder, about its centre, in beam axes (axis first) [kg m^2], shape (6,).

    Exudyn's order: Jxx, Jyy, Jzz, Jyz, Jxz, Jxy.
    """
    axial = 0.5 * disks.mass * disks.radius**2
    across = disks.mass * (3.0 * disks.radius**2 + disks.thickness**2) / 12.0
    return np.array([axial, across, across, 0.0, 0.0, 0.0])


def add_disks(
    mbs: exu.MainSystem, robot: Robot, mesh: BackboneMesh, nodes: list[Any], name: str
) -> list[Any]:
    """Add a rigid body for every disk and return the body numbers, base first."""
    disks, bodies = robot.disks, []
    thickness = max(disks.thickness, DRAWN_DISK * disks.radius)
    for k, s in enumerate(disks.positions, start=1):
        drawn = _cylinder((-0.5 * thickness, 0.0, 0.0), (thickness, 0.0, 0.0), disks.radius)
        disk = eii.ObjectRigidBody(
            name=f"{name}.disk{k}",
            nodeNumber=nodes[mesh.node_at(s)],
            mass=disks.mass,
            inertia=disk_inertia(disks),
            visualization=eii.VObjectRigidBody(graphicsData=[drawn]),
        )
        bodies.append(mbs.AddObject(disk))
    return bodies


def base_plate(pose: BasePose, disk_radius: float) -> Any:
    """Graphics of the base plate."""
    below = -DRAWN_PLATE * disk_radius * pose.rotation[:, 2]
    return _cylinder(*map(tuple, (pose.position + below, -below)), DRAWN_PLATE_RADIUS * disk_radius)


@lru_cache(maxsize=64)
def _cylinder(start: tuple[float, ...], axis: tuple[float, ...], radius: float) -> Any:
    """Graphics of a disk or plate, cached: creating them takes as long as solving several steps."""
    color = list(DISK_COLOR)
    return graphics.Cylinder(pAxis=list(start), vAxis=list(axis), radius=radius, color=color, nTiles=32)


def add_tip_mass(mbs: exu.MainSystem, robot: Robot, tip_node: Any, name: str) -> list[Any]:
    """Add the point mass at the tip; return its body number in a list, empty where there is none."""
    if not robot.tip_mass > 0.0:
        return []
    point = {"mass": robot.tip_mass, "inertia": [0.0] * 6}
    return [mbs.AddObject(eii.ObjectRigidBody(name=f"{name}.payload", nodeNumber=tip_node, **point))]


def add_gravity(mbs: exu.MainSystem, bodies: list[Any], gravity: Vector, name: str) -> list[Any]:
    """Add the weight of bodies and return the load numbers; none without gravity [m/s^2]."""
    if not any(gravity):
        return []
    loads = []
    for k, body in enumerate(bodies):
        marker = mbs.AddMarker(eii.MarkerBodyMass(name=f"{name}.mMass{k}", bodyNumber=body))
        loads.append(mbs.AddLoad(eii.Gravity(markerNumber=marker, loadVector=list(gravity))))
    return loads


def add_material_damping(
    mbs: exu.MainSystem, robot: Robot, mesh: BackboneMesh, nodes: Sequence[Any], name: str
) -> MaterialDamping | None:
    """Add the damping by the material of a backbone, by element; None where the backbone has none.

    Here a base that gives way is left out of it, or would get a damping of its own: it is the first element.
    """
    if not robot.backbone.retardation_time > 0.0:
        return None
    retardation = np.full(len(mesh.lengths), robot.backbone.retardation_time)
    if robot.base_stiffness is not None:
        # It is not of the material of the backbone.
        retardation[0] = 0.0
    return MaterialDamping.add(mbs, f"{name}.damping", nodes, mesh, retardation)


# ---------------------------------------------------------------- tendons


def add_tendons(
    mbs: exu.MainSystem, robot: Robot, mesh: BackboneMesh, bodies: Sequence[Any], name: str
) -> tuple[list[list[Any]], list[list[Any]]]:
    """Add markers at all holes and a connector for every tendon segment, which is drawn and carries no force.

    The numbers of the markers are returned, base plate first, anchor last, and those of the connectors, both by tendon.

    Parameters
    ----------
    mbs
        The system.
    robot, mesh
        Description and mesh.
    bodies
        The first beam, which begins at the base and carries the base plate's holes, then the disks.
    name
        Prefix of the items.
    """
    markers, connectors = [], []
    for i, tendon in enumerate(robot.tendons):
        prefix = f"{name}.{tendon.name}"
        places = (_along_backbone if robot.without_disks else _in_disks)(robot, tendon, mesh, bodies)
        holes = []
        for k, (body, at) in enumerate(places):
            where = {"bodyNumber": body, "localPosition": [float(x) for x in at]}
            hole = eii.MarkerBodyRigid(name=f"{prefix}.mHole{k}", **where, visualization={"show": False})
            holes.append(mbs.AddMarker(hole))
        color = list(TENDON_COLORS[i % len(TENDON_COLORS)])
        look = eii.VObjectConnectorSpringDamper(drawSize=0.0, color=color)
        idle = {"referenceLength": 1.0, "stiffness": 0.0, "force": 0.0, "activeConnector": False}
        segments = []
        for k, pair in enumerate(itertools.pairwise(holes), start=1):
            ends = {"name": f"{prefix}.segment{k}", "markerNumbers": list(pair)}
            segments.append(mbs.AddObject(eii.SpringDamper(**ends, **idle, visualization=look)))
        markers.append(holes)
        connectors.append(segments)
    return markers, connectors


#: Bodies of holes, and local positions there [m].
Places = list[tuple[Any, Any]]


def _in_disks(robot: Robot, tendon: Tendon, mesh: BackboneMesh, bodies: Sequence[Any]) -> Places:
    """Where the holes of a tendon are."""
    points = robot.hole_points(tendon)
    along = [-0.5 * mesh.lengths[0]] + [0.0] * (len(points) - 1)
    return [(body, (x + p[2], p[0], p[1])) for body, x, p in zip(bodies, along, points, strict=False)]


def _along_backbone(robot: Robot, tendon: Tendon, mesh: BackboneMesh, bodies: Sequence[Any]) -> Places:
    """The same of a tendon that follows the backbone: every node up to its end, on the beam before it."""
    end = robot.end(tendon)
    s = mesh.arc_lengths[mesh.arc_lengths <= end + ARC_TOLERANCE]
    offsets = tendon.routing.position(np.minimum(s, end), end)
    return [
        (bodies[0] + max(k - 1, 0), ((-0.5 if k == 0 else 0.5) * mesh.lengths[max(k - 1, 0)], *offset))
        for k, offset in enumerate(offsets)
    ]
