"""Contact items of Exudyn on robots of the tests."""

from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np

from tdcr_fe.scene import TDCR

STIFFNESS, SPHERE, DISK = 2000.0, 0.03, 0.005
CENTRE = (0.06, 0.0, 0.15)
#: Position of the wall and of the stop along x [m].
WALL, STOP = 0.06, 0.07
QUAD = [[WALL, -0.2, 0.0], [WALL, -0.2, 0.4], [WALL, 0.2, 0.4], [WALL, 0.2, 0.0]]
#: Its two triangles.
WALL_OF_TWO = np.array(QUAD)[[[0, 1, 2], [0, 2, 3]]]
#: Data of a contact item whose partners begin apart.
APART = (0.1, 0.0, 0.0, 0.0)


def centre_marker(mbs: exu.MainSystem, at: Any = CENTRE) -> Any:
    """A marker on ground."""
    ground = mbs.AddObject(eii.ObjectGround())
    return mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=ground, localPosition=list(at)))


def node_markers(handle: TDCR) -> list[Any]:
    """Markers on all nodes but the base."""
    return [handle.marker_at(float(s)) for s in handle.arc_lengths[1:]]


def spheres(mbs: exu.MainSystem, handle: TDCR, at: Any = CENTRE) -> None:
    """A fixed sphere against one on every disk."""
    ground = mbs.CreateGround(referencePosition=list(at))
    given = {"contactStiffness": STIFFNESS, "dataInitialCoordinates": list(APART)}
    for disk in handle.bDisks:
        mbs.CreateSphereSphereContact(itemNumbers=[ground, disk], spheresRadii=[SPHERE, DISK], **given)


def wall(mbs: exu.MainSystem, handle: TDCR, stiffness: float = STIFFNESS) -> None:
    """A thin wall across x, by `mbs.CreateSphereQuadContact`."""
    ground = mbs.CreateGround()
    given = {"contactStiffness": stiffness, "dataInitialCoordinates": list(APART)}
    for disk in handle.bDisks[-6:]:
        mbs.CreateSphereQuadContact(itemNumbers=[disk, ground], sphereRadius=DISK, quadPoints=QUAD, **given)


def soft_wall(mbs: exu.MainSystem, handle: TDCR) -> None:
    """The wall with half the stiffness: that of a sphere and a triangle in series."""
    wall(mbs, handle, 0.5 * STIFFNESS)


def general_contact(mbs: exu.MainSystem, friction: float = 0.0) -> Any:
    """A GeneralContact without partners."""
    contact = mbs.AddGeneralContact()
    contact.SetFrictionPairings(np.full((1, 1), friction))
    contact.SetSearchTreeCellSize([4, 4, 4])
    contact.SetSearchTreeBox([-0.5, -0.5, -0.5], [0.5, 0.5, 0.5])
    return contact


SPRING = {"contactStiffness": STIFFNESS, "contactDamping": 0.0}


def add_sphere(contact: Any, marker: Any, radius: float = DISK) -> None:
    """A sphere of a GeneralContact on a marker."""
    contact.AddSphereWithMarker(marker, radius=radius, **SPRING, frictionMaterialIndex=0)


def add_triangles(contact: Any, marker: Any, triangles: np.ndarray) -> None:
    """Triangles of a GeneralContact, shape (n, 3, 3), on a rigid marker."""
    points = triangles.reshape(-1, 3)
    corners = {"pointList": points.tolist(), "triangleList": np.arange(len(points)).reshape(-1, 3).tolist()}
    contact.AddTrianglesRigidBodyBased(marker, **corners, **SPRING, frictionMaterialIndex=0)


def general_spheres(mbs: exu.MainSystem, handle: TDCR) -> None:
    """A fixed sphere and spheres on the nodes in a GeneralContact."""
    contact = general_contact(mbs)
    add_sphere(contact, centre_marker(mbs), SPHERE)
    for node in node_markers(handle):
        add_sphere(contact, node)


def general_triangles(mbs: exu.MainSystem, handle: TDCR, triangles: Any = WALL_OF_TWO, last: int = 6) -> None:
    """Triangles, and spheres on the last nodes, in a GeneralContact."""
    contact = general_contact(mbs)
    add_triangles(contact, centre_marker(mbs, (0.0, 0.0, 0.0)), triangles)
    for node in node_markers(handle)[-last:]:
        add_sphere(contact, node)


def _tip_and_ground(mbs: exu.MainSystem, handle: TDCR) -> list[Any]:
    tip = mbs.AddMarker(eii.MarkerNodeCoordinate(nodeNumber=handle.nNodes[-1], coordinate=0))
    ground = mbs.AddNode(eii.NodePointGround())
    return [tip, mbs.AddMarker(eii.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))]


def coordinate_contact(mbs: exu.MainSystem, handle: TDCR) -> None:
    """A stop for the x coordinate of the tip, by ObjectContactCoordinate."""
    data = mbs.AddNode(eii.NodeGenericData(initialCoordinates=[STOP], numberOfDataCoordinates=1))
    both = _tip_and_ground(mbs, handle)
    mbs.AddObject(eii.ObjectContactCoordinate(markerNumbers=both, nodeNumber=data, **SPRING, offset=-STOP))


def limit_stops(mbs: exu.MainSystem, handle: TDCR, **friction: float) -> None:
    """The same by the limit stops of a CoordinateSpringDamperExt."""
    data = mbs.AddNode(eii.NodeGenericData(initialCoordinates=[0.0] * 3, numberOfDataCoordinates=3))
    both = _tip_and_ground(mbs, handle)[::-1]
    stops = {"limitStopsUpper": STOP, "limitStopsLower": -STOP, "limitStopsStiffness": STIFFNESS, **friction}
    item = eii.CoordinateSpringDamperExt(markerNumbers=both, nodeNumber=data, useLimitStops=True, **stops)
    mbs.AddObject(item)


#: All of them by name.
CONTACTS = {
    "CreateSphereSphereContact": spheres,
    "CreateSphereQuadContact": wall,
    "GeneralContact, spheres": general_spheres,
    "GeneralContact, triangles": general_triangles,
    "ObjectContactCoordinate": coordinate_contact,
    "limit stops": limit_stops,
}
