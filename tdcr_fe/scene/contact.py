"""Contact of a robot with an obstacle, with another robot and with itself: spheres on its disks and its backbone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Annotated, Any, NamedTuple

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.elements.poses import ONES3
from tdcr_fe.model.loading import Vector
from tdcr_fe.model.schema import Checked, Keys, Quantity, check_instance
from tdcr_fe.scene.assembled_robot import AssembledRobot

#: Two spheres of one robot are no pair where they are nearer along the backbone than this times the sum of their radii:
#: they would touch only where the robot bends by more than 217 degrees between them (arc over chord of a circle) [1].
NEAR = 2.0
#: Overlap in the reference configuration that is round-off [m].
OVERLAP = 1e-9
#: Of the length of a side, by which one corner of a quadrangle is moved along it [1].
ASIDE = 1e-6


class Sphere(NamedTuple):
    """A sphere in contact."""

    marker: Any  # at its centre
    radius: float  # [m]
    center: Array  # in the reference configuration [m], shape (3,)
    arc_length: float  # on its robot [m]; nan of an obstacle
    name: str


@dataclass(frozen=True)
class ContactLaw(Checked):
    """Penalty contact of two surfaces, with the parameters of Exudyn's ``ObjectContactSphereSphere``.

    Attributes
    ----------
    contactStiffness : float
        Force over penetration [N/m].
    contactDamping : float
        [N s/m].
    dynamicFriction : float
        Coefficient; it acts on velocities, so it is zero at rest [1].
    frictionProportionalZone : float
        Velocity up to which friction is proportional to it [m/s].
    """

    contactStiffness: Annotated[float, Quantity(unit="N/m", gt=0.0)]
    contactDamping: Annotated[float, Quantity(unit="N s/m", ge=0.0)] = 0.0
    dynamicFriction: Annotated[float, Quantity(ge=0.0)] = 0.0
    frictionProportionalZone: Annotated[float, Quantity(unit="m/s", gt=0.0)] = 1e-3


#: Where an obstacle that is a sphere lies on its body [m], and its radius [m].
OBSTACLE = Keys(
    {
        "localPosition": Annotated[Vector, Quantity(note="in m")],
        "sphereRadius": Annotated[float | None, Quantity(note="in m", gt=0.0)],
    }
)


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

    def add_spheres(self, pairs: Sequence[tuple[Sphere, Sphere]], show: bool) -> None:
        """Add contact between pairs of spheres; a ValueError names two that overlap in the reference configuration."""
        for first, second in pairs:
            gap = float(np.linalg.norm(first.center - second.center)) - first.radius - second.radius
            self._add(
                eii.ObjectContactSphereSphere,
                (first.name, second.name),
                gap,
                markerNumbers=[first.marker, second.marker],
                spheresRadii=[first.radius, second.radius],
                contactStiffnessExponent=1.0,
                visualization=eii.VObjectContactSphereSphere(show=show),
            )

    def add_quad(self, spheres: Sequence[Sphere], body: Any, points: Array, show: bool) -> None:
        """Add contact between spheres and a flat quadrangle on a body.

        Parameters
        ----------
        spheres
            Spheres of the robot.
        body
            Number of the body.
        points
            Corners in order, on the body [m], shape (4, 3).
        show
            Whether contact is drawn.

        Raises
        ------
        ValueError
            A sphere overlaps with the quadrangle in the reference configuration.
        """
        carrier = self.mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=body))
        what, reference = exu.OutputVariableType, exu.ConfigurationType.Reference
        turn = np.array(self.mbs.GetMarkerOutput(carrier, what.RotationMatrix, reference)).reshape(3, 3)
        corners = points @ turn.T + _reference(self.mbs, carrier)
        name = f"body {self.mbs.GetObject(body)['name']!r}"
        # A sphere exactly over the edge of two triangles is in contact with both: none is to be in the middle.
        points = np.vstack((points[:3], points[3] + ASIDE * (points[2] - points[3])))
        for sphere in spheres:
            # Two triangles; the edge that they share is none of the quadrangle's.
            for which, edges in (([0, 1, 3], 5), ([1, 2, 3], 3)):
                self._add(
                    eii.ObjectContactSphereTriangle,
                    (sphere.name, name),
                    _distance_to_triangle(sphere.center, corners[which]) - sphere.radius,
                    markerNumbers=[sphere.marker, carrier],
                    sphereRadius=sphere.radius,
                    trianglePoints=exu.Vector3DList(points[which].tolist()),
                    includeEdges=edges,
                    visualization=eii.VObjectContactSphereTriangle(show=show),
                )

    def _add(self, item: Any, names: tuple[str, str], gap: float, **rest: Any) -> None:
        """Add the item of one pair and the data node of its gap in the reference configuration [m]."""
        if gap < -OVERLAP:
            raise ValueError(
                f"add_disk_contact: {names[0]} and {names[1]} overlap by {-1e3 * gap:.4g} mm in the reference "
                "configuration; they must begin apart"
            )
        start = [max(gap, 0.0), 0.0, 0.0, 0.0]
        data = eii.NodeGenericData(initialCoordinates=start, numberOfDataCoordinates=len(start))
        self.nGaps.append(self.mbs.AddNode(data))
        self.oContacts.append(self.mbs.AddObject(item(nodeNumber=self.nGaps[-1], **rest, **asdict(self.law))))
        self.names.append(names)


# ---------------------------------------------------------------- spheres


def spheres_of(arm: AssembledRobot, nodes: Sequence[Any], backbone: bool) -> list[Sphere]:
    """Spheres of a robot: one of the disks' radius about every disk, one of the backbone's radius about other nodes.

    There is none at the base, and none at nodes inside disks.

    Parameters
    ----------
    arm
        The robot.
    nodes
        Exudyn's numbers of its nodes.
    backbone
        Whether the backbone has spheres too; always so for a robot without disks.
    """
    mbs, robot, mesh, name = arm.mbs, arm.robot, arm.mesh, arm.name
    disks = np.array(robot.disks.positions)
    radii = robot.backbone.radius_at(mesh.arc_lengths)
    spheres = []
    for k, s in enumerate(mesh.arc_lengths):
        distance = np.abs(disks - s)
        nearest = float(np.min(distance, initial=np.inf))
        on_disk, inside = nearest < 1e-6, nearest <= 0.5 * robot.disks.thickness + 1e-6
        if k == 0 or not (on_disk or ((backbone or robot.without_disks) and not inside)):
            continue
        what = f"disk {np.argmin(distance) + 1}" if on_disk else f"backbone at {1e3 * s:.4g} mm"
        radius = robot.disks.radius if on_disk else float(radii[k])
        marker = mbs.AddMarker(eii.MarkerNodeRigid(name=f"{name}.mSphere{k}", nodeNumber=nodes[k]))
        spheres.append(Sphere(marker, radius, _reference(mbs, marker), float(s), f"{what} of {name!r}"))
    return spheres


def obstacle_sphere(mbs: exu.MainSystem, other: Any, position: Sequence[float], radius: float) -> Sphere:
    """A sphere of a radius [m] on a body (``ObjectIndex``) of the user at a position [m], or on a marker."""
    if isinstance(other, exu.MarkerIndex):
        if np.any(np.asarray(position, dtype=float)):
            text = "is that on a body; a marker has its own position"
            raise ValueError(f"add_disk_contact: localPosition {text}")
        marker, name = other, f"marker {int(other)}"
    else:
        body = mbs.GetObject(other)
        point = body["objectType"].startswith("MassPoint")
        kind = eii.MarkerBodyPosition if point else eii.MarkerBodyRigid
        marker = mbs.AddMarker(kind(bodyNumber=other, localPosition=list(position)))
        name = f"body {body['name']!r}"
    return Sphere(marker, radius, _reference(mbs, marker), float("nan"), name)


def pairs_within(spheres: Sequence[Sphere]) -> Iterator[tuple[Sphere, Sphere]]:
    """Pairs of spheres of one robot that can touch: not those that are near each other along the backbone."""
    for i, first in enumerate(spheres):
        for second in spheres[i + 1 :]:
            if second.arc_length - first.arc_length > NEAR * (first.radius + second.radius):
                yield first, second


# ---------------------------------------------------------------- checks


def check_obstacle(other: Any, radius: float | None, quad: Any, position: Sequence[float]) -> None:
    """Refuse what is neither a sphere on a body or marker nor a quadrangle on a body."""
    hint = "Give a TDCR, the number of a body (ObjectIndex) or, for a sphere, of a marker (MarkerIndex)."
    kinds = (exu.ObjectIndex, exu.MarkerIndex) if quad is None else exu.ObjectIndex
    check_instance("add_disk_contact", "other", other, kinds, f"a robot, body or marker. {hint}")
    if (radius is None) == (quad is None):
        raise ValueError("add_disk_contact: give sphereRadius or quadPoints of the obstacle, one of them")
    if quad is not None and np.any(np.asarray(position, dtype=float)):
        raise ValueError("add_disk_contact: localPosition is that of a sphere; quadPoints are on the body")


def check_spacing(spheres: Sequence[Sphere], radius: float, name: str) -> None:
    """Refuse an obstacle that gets through the backbone between two spheres of a robot.

    Parameters
    ----------
    spheres
        Spheres of the robot, in order.
    radius
        Radius of the obstacle [m].
    name
        Name of the obstacle.

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
    """Corners of a quadrangle as an array, shape (4, 3); a ValueError where they are not four in one plane."""
    corners = np.asarray(points, dtype=float)
    if corners.shape != (4, 3) or not np.all(np.isfinite(corners)):
        raise ValueError("add_disk_contact: quadPoints must be four points [[x, y, z], ...] on the body [m]")
    edges = corners[1:] - corners[0]
    size = float(np.max(np.linalg.norm(edges, axis=1)))
    if abs(float(np.linalg.det(edges))) > 1e-6 * size**3:
        text = "are not in one plane; divide them into flat quadrangles"
        raise ValueError(f"add_disk_contact: quadPoints {text}")
    sides = np.roll(corners, -1, axis=0) - corners
    turns = np.cross(sides, np.roll(sides, -1, axis=0))
    if not np.all(turns @ turns.sum(axis=0) > 0.0):
        raise ValueError("add_disk_contact: quadPoints must go around a convex quadrangle, corner by corner")
    return corners


def _reference(mbs: exu.MainSystem, marker: Any) -> Array:
    """Position of a marker in the reference configuration [m], shape (3,)."""
    at = mbs.GetMarkerOutput(marker, exu.OutputVariableType.Position, exu.ConfigurationType.Reference)
    return np.array(at, dtype=float)


def _distance_to_triangle(point: Array, corners: Array) -> float:
    """Distance of a point from a triangle of corners of shape (3, 3) [m]."""
    a, u, v = corners[0], corners[1] - corners[0], corners[2] - corners[0]
    inside = np.linalg.lstsq(np.column_stack((u, v)), point - a, rcond=None)[0]
    if np.all(inside >= 0.0) and inside.sum() <= 1.0:
        return float(np.linalg.norm(a + inside[0] * u + inside[1] * v - point))
    edges = np.roll(corners, -1, axis=0) - corners
    along = np.clip(((point - corners) * edges) @ ONES3 / ((edges * edges) @ ONES3), 0.0, 1.0)
    return float(np.linalg.norm(corners + along[:, None] * edges - point, axis=1).min())
