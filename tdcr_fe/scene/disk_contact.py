"""Contact of a robot with an obstacle, with another robot and with itself: spheres on its disks and its backbone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BackboneMesh
from tdcr_fe.model import arguments
from tdcr_fe.model.robot import Robot

Array = NDArray[np.float64]

#: Two spheres of one robot are no pair where they are nearer along the backbone than this times the sum of their radii:
#: they would touch only where the robot bends by more than 217 degrees between them (arc over chord of a circle) [1].
NEAR = 2.0
#: Overlap in the reference configuration that is round-off [m].
OVERLAP = 1e-9


class Sphere(NamedTuple):
    """A sphere in contact.

    Attributes
    ----------
    marker
        At its centre.
    radius : float
        [m].
    center : ndarray, shape (3,)
        In the reference configuration [m].
    arc_length : float
        On its robot [m]; nan of an obstacle.
    name : str
    """

    marker: Any
    radius: float
    center: Array
    arc_length: float
    name: str


@dataclass(frozen=True)
class ContactLaw:
    """Penalty contact of two surfaces, with the parameters of Exudyn's ``ObjectContactSphereSphere``.

    Attributes
    ----------
    contactStiffness : float
        Force over penetration [N/m].
    contactDamping : float
        [N s/m].
    dynamicFriction : float
        Coefficient of friction [1]; acts on velocities, so it is zero at rest.
    frictionProportionalZone : float
        Velocity up to which friction is proportional to it [m/s].
    """

    contactStiffness: float
    contactDamping: float = 0.0
    dynamicFriction: float = 0.0
    frictionProportionalZone: float = 1e-3

    def __post_init__(self) -> None:
        hint = "2000.0 lets a force of 1 N press disk and obstacle 0.5 mm together [N/m]."
        arguments.check_number(
            "add_disk_contact", "contactStiffness", self.contactStiffness, hint, positive=True
        )
        for name, unit in (("contactDamping", "N s/m"), ("dynamicFriction", "1")):
            arguments.check_number("add_disk_contact", name, getattr(self, name), f"It is in [{unit}].")
            if getattr(self, name) < 0.0:
                raise ValueError(f"add_disk_contact: {name} = {getattr(self, name)}; must not be negative")
        zone = self.frictionProportionalZone
        hint = "1e-3 is the default [m/s]."
        arguments.check_number("add_disk_contact", "frictionProportionalZone", zone, hint, positive=True)

    def arguments(self) -> dict[str, float]:
        """As arguments of Exudyn's items."""
        return {
            "contactStiffness": self.contactStiffness,
            "contactDamping": self.contactDamping,
            "dynamicFriction": self.dynamicFriction,
            "frictionProportionalZone": self.frictionProportionalZone,
        }


@dataclass(frozen=True, eq=False)
class DiskContact:
    """Contact items of a robot.

    Attributes
    ----------
    mbs : exudyn.MainSystem
    oContacts : list
        Exudyn's contact objects, one for each pair.
    nGaps : list
        Their data nodes, the first coordinate of which is the gap.
    names : list of tuple of str
        The two partners of every pair.
    law : ContactLaw
    """

    mbs: exu.MainSystem
    oContacts: list[Any]
    nGaps: list[Any]
    names: list[tuple[str, str]]
    law: ContactLaw

    def gaps(self) -> Array:
        """Gap of every pair in the last solved state, negative where it is in contact [m], shape (n_pairs,)."""
        coordinates = exu.OutputVariableType.Coordinates
        return np.array([self.mbs.GetNodeOutput(node, coordinates)[0] for node in self.nGaps])

    def normal_forces(self) -> Array:
        """Force of every pair at rest, that is without damping [N], shape (n_pairs,)."""
        return self.law.contactStiffness * np.maximum(-self.gaps(), 0.0)


def add_contact(
    mbs: exu.MainSystem,
    own: Sequence[Sphere],
    other: Any,
    law: ContactLaw,
    *,
    radius: float | None,
    quad: Any,
    position: Sequence[float],
    show: bool,
) -> DiskContact:
    """Add contact of the spheres of a robot with a sphere or a quadrangle of the user; see `TDCR.add_disk_contact`."""
    hint = "Give a TDCR, the number of a body (ObjectIndex) or, for a sphere, of a marker (MarkerIndex)."
    kinds = (exu.ObjectIndex, exu.MarkerIndex) if quad is None else exu.ObjectIndex
    arguments.check_instance("add_disk_contact", "other", other, kinds, "a robot, body or marker", hint)
    if (radius is None) == (quad is None):
        raise ValueError("add_disk_contact: give sphereRadius or quadPoints of the obstacle, one of them")
    arguments.check_numbers("add_disk_contact", "localPosition", position, "It is on the body [m].", count=3)
    if quad is not None:
        if np.any(np.asarray(position, dtype=float)):
            raise ValueError(
                "add_disk_contact: localPosition is that of a sphere; quadPoints are on the body"
            )
        return add_quad_contact(mbs, own, other, check_quad(quad), law, show)
    assert radius is not None
    hint = "0.03 is an obstacle of 30 mm radius [m]."
    arguments.check_number("add_disk_contact", "sphereRadius", radius, hint, positive=True)
    obstacle = obstacle_sphere(mbs, other, position, radius)
    check_spacing(own, radius, obstacle.name)
    return add_sphere_pairs(mbs, [(sphere, obstacle) for sphere in own], law, show)


def add_robot_contact(
    mbs: exu.MainSystem, own: Sequence[Sphere], others: Sequence[Sphere], law: ContactLaw, show: bool
) -> DiskContact:
    """Add contact between the spheres of a robot and those of another robot, or the same ones; see `add_contact`."""
    for these, those in ((own, others), (others, own)):
        largest = max(those, key=lambda sphere: sphere.radius)
        check_spacing(these, largest.radius, largest.name)
    if others is own:
        return add_sphere_pairs(mbs, list(pairs_within(own)), law, show)
    return add_sphere_pairs(mbs, [(a, b) for a in own for b in others], law, show)


def spheres_of(
    mbs: exu.MainSystem, robot: Robot, mesh: BackboneMesh, nodes: Sequence[Any], backbone: bool, name: str
) -> list[Sphere]:
    """Spheres of a robot: one of the disks' radius about every disk, one of the backbone's radius about other nodes.

    There is none at the base, and none at nodes inside disks.

    Parameters
    ----------
    mbs
        The system.
    robot, mesh
        Description and mesh.
    nodes
        Exudyn's numbers of its nodes.
    backbone
        Whether the backbone has spheres too; always so for a robot without disks.
    name
        Of the robot in the scene.
    """
    disks = np.array(robot.disks.positions)
    radii = robot.backbone.radius_at(mesh.arc_lengths)
    found = []
    for k, s in enumerate(mesh.arc_lengths):
        distance = np.abs(disks - s)
        here = int(np.argmin(distance)) if disks.size else -1
        on_disk = disks.size > 0 and distance[here] < 1e-6
        inside = disks.size > 0 and distance[here] <= 0.5 * robot.disks.thickness + 1e-6
        if k == 0 or not (on_disk or ((backbone or not disks.size) and not inside)):
            continue
        what = f"disk {here + 1}" if on_disk else f"backbone at {1e3 * s:.4g} mm"
        radius = robot.disks.radius if on_disk else float(radii[k])
        marker = mbs.AddMarker(eii.MarkerNodeRigid(name=f"{name}.mSphere{k}", nodeNumber=nodes[k]))
        found.append(Sphere(marker, radius, _reference(mbs, marker), float(s), f"{what} of {name!r}"))
    return found


def obstacle_sphere(mbs: exu.MainSystem, other: Any, position: Sequence[float], radius: float) -> Sphere:
    """A sphere on a body or marker of the user.

    Parameters
    ----------
    mbs
        The system.
    other
        Number of a body (``ObjectIndex``) or of a marker (``MarkerIndex``).
    position
        Of the centre on the body [m].
    radius
        [m].
    """
    if isinstance(other, exu.MarkerIndex):
        if np.any(np.asarray(position, dtype=float)):
            raise ValueError(
                "add_disk_contact: localPosition is that on a body; a marker has its own position"
            )
        marker, name = other, f"marker {int(other)}"
    else:
        body = mbs.GetObject(other)
        point = body["objectType"].startswith("MassPoint")
        kind = eii.MarkerBodyPosition if point else eii.MarkerBodyRigid
        marker = mbs.AddMarker(kind(bodyNumber=other, localPosition=list(position)))
        name = f"body {body['name']!r}"
    return Sphere(marker, radius, _reference(mbs, marker), float("nan"), name)


def add_sphere_pairs(
    mbs: exu.MainSystem, pairs: Sequence[tuple[Sphere, Sphere]], law: ContactLaw, show: bool
) -> DiskContact:
    """Add contact between pairs of spheres.

    Raises
    ------
    ValueError
        Two spheres overlap in the reference configuration.
    """
    contacts, data, names = [], [], []
    for first, second in pairs:
        gap = float(np.linalg.norm(first.center - second.center)) - first.radius - second.radius
        if gap < -OVERLAP:
            raise _overlaps(first.name, second.name, gap)
        data.append(_gap_node(mbs, gap))
        item = eii.ObjectContactSphereSphere(
            markerNumbers=[first.marker, second.marker],
            nodeNumber=data[-1],
            spheresRadii=[first.radius, second.radius],
            contactStiffnessExponent=1.0,
            visualization=eii.VObjectContactSphereSphere(show=show),
            **law.arguments(),
        )
        contacts.append(mbs.AddObject(item))
        names.append((first.name, second.name))
    return DiskContact(mbs, contacts, data, names, law)


def add_quad_contact(
    mbs: exu.MainSystem, spheres: Sequence[Sphere], body: Any, points: Array, law: ContactLaw, show: bool
) -> DiskContact:
    """Add contact between spheres and a flat quadrangle on a body.

    Parameters
    ----------
    mbs
        The system.
    spheres
        Of the robot.
    body
        Number of the body.
    points
        Corners in order, on the body [m], shape (4, 3).
    law, show
        Parameters; whether contact is drawn.

    Raises
    ------
    ValueError
        A sphere overlaps with the quadrangle in the reference configuration.
    """
    carrier = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=body))
    what, reference = exu.OutputVariableType, exu.ConfigurationType.Reference
    turn = np.array(mbs.GetMarkerOutput(carrier, what.RotationMatrix, reference)).reshape(3, 3)
    corners = points @ turn.T + _reference(mbs, carrier)
    name = f"body {mbs.GetObject(body)['name']!r}"
    contacts, data, names = [], [], []
    for sphere in spheres:
        # Two triangles; the edge that they share is none of the quadrangle's.
        for which, edges in (([0, 1, 3], 5), ([1, 2, 3], 3)):
            gap = _distance_to_triangle(sphere.center, corners[which]) - sphere.radius
            if gap < -OVERLAP:
                raise _overlaps(sphere.name, name, gap)
            data.append(_gap_node(mbs, gap))
            item = eii.ObjectContactSphereTriangle(
                markerNumbers=[sphere.marker, carrier],
                nodeNumber=data[-1],
                sphereRadius=sphere.radius,
                trianglePoints=exu.Vector3DList(points[which].tolist()),
                includeEdges=edges,
                visualization=eii.VObjectContactSphereTriangle(show=show),
                **law.arguments(),
            )
            contacts.append(mbs.AddObject(item))
            names.append((sphere.name, name))
    return DiskContact(mbs, contacts, data, names, law)


def pairs_within(spheres: Sequence[Sphere]) -> Iterator[tuple[Sphere, Sphere]]:
    """Pairs of spheres of one robot that can touch: not those that are near each other along the backbone."""
    for i, first in enumerate(spheres):
        for second in spheres[i + 1 :]:
            if second.arc_length - first.arc_length > NEAR * (first.radius + second.radius):
                yield first, second


def check_spacing(spheres: Sequence[Sphere], radius: float, name: str) -> None:
    """Refuse an obstacle that gets through the backbone between two spheres of a robot.

    Parameters
    ----------
    spheres
        Of the robot, in order.
    radius
        Of the obstacle [m].
    name
        Of the obstacle.

    Raises
    ------
    ValueError
        Names the obstacle, the spheres, and what helps.
    """
    for first, second in pairwise(spheres):
        length = second.arc_length - first.arc_length
        a, b = first.radius + radius, second.radius + radius
        # Where it touches both: ``along`` from the first one, and so far beside the backbone.
        along = min(max(0.5 * (a**2 - b**2 + length**2) / length, 0.0), length)
        beside = np.sqrt(max(min(a**2 - along**2, b**2 - (length - along) ** 2), 0.0))
        if beside < radius:
            raise ValueError(
                f"add_disk_contact: {name}, of {1e3 * radius:.4g} mm radius, would get through the backbone between "
                f"{first.name} and {second.name}, {1e3 * length:.4g} mm apart; set backbone=True, and more "
                "elements_per_bay in the model or loadPositions in CreateTDCR, each of which adds a sphere"
            )


def check_quad(points: Any) -> Array:
    """Corners of a quadrangle as an array, shape (4, 3).

    Raises
    ------
    ValueError
        Not four finite points in one plane.
    """
    corners = np.asarray(points, dtype=float)
    if corners.shape != (4, 3) or not np.all(np.isfinite(corners)):
        raise ValueError("add_disk_contact: quadPoints must be four points [[x, y, z], ...] on the body [m]")
    edges = corners[1:] - corners[0]
    size = float(np.max(np.linalg.norm(edges, axis=1)))
    if abs(float(np.linalg.det(edges))) > 1e-6 * size**3:
        raise ValueError(
            "add_disk_contact: quadPoints are not in one plane; divide them into flat quadrangles"
        )
    return corners


def _reference(mbs: exu.MainSystem, marker: Any) -> Array:
    """Position of a marker in the reference configuration [m], shape (3,)."""
    found = mbs.GetMarkerOutput(marker, exu.OutputVariableType.Position, exu.ConfigurationType.Reference)
    return np.array(found, dtype=float)


def _gap_node(mbs: exu.MainSystem, gap: float) -> Any:
    """Data node of a contact object, with its gap in the reference configuration [m]."""
    return mbs.AddNode(
        eii.NodeGenericData(initialCoordinates=[max(gap, 0.0), 0.0, 0.0, 0.0], numberOfDataCoordinates=4)
    )


def _overlaps(first: str, second: str, gap: float) -> ValueError:
    return ValueError(
        f"add_disk_contact: {first} and {second} overlap by {-1e3 * gap:.4g} mm in the reference configuration; they "
        "must begin apart"
    )


def _distance_to_triangle(point: Array, corners: Array) -> float:
    """Distance of a point from a triangle of corners of shape (3, 3) [m]."""
    a, u, v = corners[0], corners[1] - corners[0], corners[2] - corners[0]
    inside = np.linalg.lstsq(np.column_stack((u, v)), point - a, rcond=None)[0]
    if np.all(inside >= 0.0) and inside.sum() <= 1.0:
        return float(np.linalg.norm(a + inside[0] * u + inside[1] * v - point))
    nearest = np.inf
    for begin, end in ((0, 1), (1, 2), (2, 0)):
        edge = corners[end] - corners[begin]
        along = np.clip((point - corners[begin]) @ edge / (edge @ edge), 0.0, 1.0)
        nearest = min(nearest, float(np.linalg.norm(corners[begin] + along * edge - point)))
    return nearest
