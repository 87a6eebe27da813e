"""Contact in a scene: how far nodes may move, when it is too deep, and contact with triangles.

Exudyn 1.13.6 takes the nearest point of a triangle as one that is fixed to it. On a face that point moves along with
the sphere, so Exudyn's Jacobian has an additional ``F / d`` along the face, of the contact force F and the distance d
of the sphere's centre, as for a sphere on a point. On an edge it has the same along the edge, and twice the stiffness
along the normal, because the force of a triangle is halved there. Derivatives by the rotation of a body that carries
triangles are missing, and all of them where contact between spheres is switched off. The forces themselves are right:
their derivative is taken from them by central differences, alike for faces, edges and vertices, fixed and moving.

Exudyn's contact items decide by a state whether they act (a gap in a data coordinate, or the active sets of a
``GeneralContact``), which its own solvers update after Newton's iteration. The contact force is a continuous function
of the present gap, so here the states follow the configuration in every residual: Newton's method then solves the
penalty contact itself, as a semismooth equation (L. Qi, J. Sun, Math. Program. 58 (1993) 353-367).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import exudyn as exu
import numpy as np
from scipy.spatial.distance import cdist

from tdcr_fe.elements import Array, Flags, Index
from tdcr_fe.elements.section_forces import DIFFERENCE

#: Objects whose states are functions of the present gap alone. Friction of these depends on the slip rate, and is zero
#: at rest.
SOLVED = ("ContactSphereSphere", "ContactSphereTriangle", "ContactCoordinate")
#: Objects whose state counts full turns, up to which the present angle is unique.
TURNS = ("ConnectorTorsionalSpringDamper",)


class GeneralSpheres(NamedTuple):
    """Spheres of a ``GeneralContact``."""

    contact: Any
    markers: Index  # (n,)
    radii: Array  # (n,): [m]
    # Number of the first triangle in its lists of active contacts; None where there are no triangles
    first_triangle: int | None

    @classmethod
    def of(cls, contact: Any) -> GeneralSpheres:
        """The spheres of a general contact."""
        about = contact.GetPythonObject()
        if about["numberOfANCFCable2D"]:
            raise ValueError("GeneralContact with ANCF cables is not solved by the quasi-static solver")
        count, first = about["numberOfSpheresMarkerBased"], None
        spheres = [contact.GetSphereMarkerBased(i, addData=True) for i in range(count)]
        if about["numberOfTrigsRigidBodyBased"]:
            offsets = about["globalContactIndexOffsets"]
            first = int(offsets[int(exu.ContactTypeIndex.IndexTrigsRigidBodyBased)])
        markers = np.array([int(s["markerIndex"]) for s in spheres], dtype=int)
        return cls(contact, markers, np.array([float(s["radius"]) for s in spheres]), first)

    @property
    def size(self) -> float:
        """How far a body may move into a contact without leaving it on the other side [m].

        That of the two smallest spheres, or of the smallest one and a triangle.
        """
        smallest = np.sort(self.radii)[: 2 if self.first_triangle is None else 1]
        return float(smallest.sum()) if smallest.size else np.inf

    @property
    def touch_triangles(self) -> bool:
        """Whether any is in contact with a triangle, by the present active sets."""
        if self.first_triangle is None:
            return False
        kind = exu.ContactTypeIndex.IndexSpheresMarkerBased
        active = [self.contact.GetActiveContacts(kind, i) for i in range(len(self.radii))]
        return any(abs(int(number)) >= self.first_triangle for numbers in active for number in numbers)

    def centers_inside(self, mbs: exu.MainSystem, configuration: Any) -> Flags:
        """Which pairs have the centre of one inside the other, shape (n, n), false below the diagonal."""
        position = exu.OutputVariableType.Position
        found = [mbs.GetMarkerOutput(int(m), position, configuration) for m in self.markers]
        at = np.reshape(found, (-1, 3))
        inside = cdist(at, at) < np.maximum(self.radii[:, None], self.radii)
        return np.triu(inside, 1)


def general_spheres(mbs: exu.MainSystem) -> list[GeneralSpheres]:
    """The spheres of every ``GeneralContact`` of a system."""
    return [GeneralSpheres.of(mbs.GetGeneralContact(k)) for k in range(mbs.NumberOfGeneralContacts())]


class TriangleContact:
    """All ``GeneralContact`` of a scene that have spheres and triangles.

    Parameters
    ----------
    mbs
        An assembled system.
    """

    def __init__(self, mbs: exu.MainSystem) -> None:
        self._mbs = mbs
        spheres = [each for each in general_spheres(mbs) if each.radii.size]
        self._all = [each for each in spheres if each.first_triangle is not None]
        self._step = DIFFERENCE * min((float(each.radii.min()) for each in self._all), default=0.0)
        self._nodes = _nodes_of_coordinates(mbs)

    @property
    def touching(self) -> bool:
        """Whether a sphere is in contact with a triangle, by the present active sets."""
        return any(each.touch_triangles for each in self._all)

    @contextmanager
    def all_with(self, attribute: str, value: bool) -> Iterator[None]:
        """Set an attribute of all of them, as ``isActive``: without it they exert no forces."""
        before = [getattr(each.contact, attribute) for each in self._all]
        try:
            for each in self._all:
                setattr(each.contact, attribute, value)
            yield
        finally:
            for each, own in zip(self._all, before, strict=True):
                setattr(each.contact, attribute, own)

    def derivative(self, evaluate: Callable[[], object]) -> Array:
        """Derivative of the forces of these contacts by the ODE2 coordinates, shape (n2, n2).

        Parameters
        ----------
        evaluate
            Lets Exudyn compute the forces in the current configuration, which is left as it is.
        """
        current: Array = self._mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Current, copy=False)
        found = np.zeros((len(current), len(current)))
        with self.all_with("computeContactForces", True):
            evaluate()
            for k in np.flatnonzero(np.isin(self._nodes, self._nodes[np.flatnonzero(self._forces())])):
                start = current[k]
                for step in (self._step, -self._step):
                    current[k] = start + step
                    evaluate()
                    found[:, k] += self._forces() / (2.0 * step)
                current[k] = start
            evaluate()
        return found

    def _forces(self) -> Array:
        """Generalised forces of these contacts, as last evaluated, shape (n2,)."""
        return np.sum([each.contact.GetSystemODE2RhsContactForces(copy=True) for each in self._all], axis=0)


def _nodes_of_coordinates(mbs: exu.MainSystem) -> Index:
    """Number of the node of every ODE2 coordinate, shape (n2,)."""
    data = mbs.systemData
    found = np.full(data.ODE2Size(), -1)
    for node in range(data.NumberOfNodes()):
        found[np.asarray(data.GetNodeLTGODE2(node), dtype=int)] = node
    return found


class ContactStates:
    """States of the contact items of a scene.

    Parameters
    ----------
    mbs
        An assembled system.
    own_data
        Numbers of the data coordinates that belong to robots.
    settings
        Settings of Exudyn's solvers.

    Attributes
    ----------
    present : bool
        Whether there is any contact.
    general_motion_limit : float
        By how much a node may move without jumping over one of a ``GeneralContact`` that moves as far [m].
    """

    def __init__(
        self, mbs: exu.MainSystem, own_data: Collection[int], settings: exu.SimulationSettings
    ) -> None:
        data = mbs.systemData
        items = {i: mbs.GetObject(i) for i in range(data.NumberOfObjects()) if len(data.GetObjectLTGData(i))}
        self.present = bool(items) or mbs.NumberOfGeneralContacts() > 0
        sized = {i: item for i, item in items.items() if np.isfinite(_size(item))}
        self._gaps = np.array([data.GetObjectLTGData(i)[0] for i in sized], dtype=int)
        self._sizes = np.array([_size(item) for item in sized.values()])
        self._flat = np.array(["trianglePoints" in item for item in sized.values()], dtype=bool)
        #: Penetrations at which the centre of a sphere is on the surface of another one [m]; none for triangles.
        self._depths = np.array([min(item.get("spheresRadii", [np.inf])) for item in sized.values()])
        pairs = np.array([item["markerNumbers"] for item in sized.values()], dtype=int).reshape(-1, 2)
        # A marker belongs to many pairs, and is read once.
        self._markers, numbers = np.unique(pairs, return_inverse=True)
        self._pairs = numbers.reshape(-1, 2)
        general = general_spheres(mbs)
        self.general_motion_limit = 0.5 * min((spheres.size for spheres in general), default=np.inf)
        # Spheres that lie in each other from the beginning are built so, as those of a wall.
        reference = exu.ConfigurationType.Reference
        self._general_spheres = [(spheres, spheres.centers_inside(mbs, reference)) for spheres in general]
        self._mbs = mbs
        self._foreign = np.setdiff1d(np.arange(data.DataSize()), np.fromiter(own_data, dtype=int))
        self._settings = settings
        self._solver: Any = None

    def initialise(self) -> None:
        """Initialise Exudyn's solver, which alone updates states; it sets the scene to its initial configuration."""
        if not self.present:
            return
        self._solver = exu.MainSolverImplicitSecondOrder()
        if not self._solver.InitializeSolver(self._mbs, self._settings):
            raise RuntimeError("Exudyn could not initialise the update of contact states for this system")

    def follow(self) -> None:
        """Set all states to those of the present configuration."""
        if self.present:
            self._solver.PostNewton(self._mbs, self._settings)

    def motion_limit(self) -> float:
        """By how much a node may move from the present configuration without jumping over a contact [m]."""
        return min(self.general_motion_limit, 0.5 * float(np.min(self.approach_limits(), initial=np.inf)))

    def too_deep(self) -> bool:
        """Whether the centre of a sphere is inside another one in the present configuration."""
        data: Array = self._mbs.systemData.GetDataCoordinates(exu.ConfigurationType.Current, copy=False)
        if np.any(data[self._gaps] < -self._depths):
            return True
        now = self._mbs, exu.ConfigurationType.Current
        return any((spheres.centers_inside(*now) & ~built).any() for spheres, built in self._general_spheres)

    def approach_limits(self) -> Array:
        """By how much the bodies of every pair may approach without jumping over each other [m], shape (n_pairs,)."""
        data: Array = self._mbs.systemData.GetDataCoordinates(exu.ConfigurationType.Current, copy=False)
        return np.asarray(np.maximum(data[self._gaps], 0.0) + self._sizes)

    def relative_positions(self) -> Array:
        """Position of the first body of every pair, seen from the second [m], shape (n_pairs, 3).

        In the axes of the world or, where the second one is a triangle, in its own.
        """
        variable = exu.OutputVariableType
        found = [self._mbs.GetMarkerOutput(int(m), variable.Position) for m in self._markers]
        at = np.reshape(found, (-1, 3))
        first, second = self._pairs.T
        relative: Array = at[first] - at[second]
        for carrier in np.unique(second[self._flat]):
            turn = self._mbs.GetMarkerOutput(int(self._markers[carrier]), variable.RotationMatrix)
            on_it = self._flat & (second == carrier)
            relative[on_it] = relative[on_it] @ np.reshape(turn, (3, 3))
        return relative

    def keep(self) -> None:
        """Make the states of the present configuration those of the initial one, too."""
        if self.present:
            self.follow()
            kinds = exu.ConfigurationType
            data = self._mbs.systemData
            now = data.GetDataCoordinates(kinds.Current, copy=False)
            data.GetDataCoordinates(kinds.Initial, copy=False)[self._foreign] = now[self._foreign]


def _size(item: dict[str, Any]) -> float:
    """How far a body may move into a contact without leaving it on the other side [m]."""
    # Exudyn 1.13.6 calls a sphere and a triangle ContactSphereSphere, too.
    if "trianglePoints" in item:
        return float(item["sphereRadius"])
    if "spheresRadii" in item and not item["isHollowSphere1"]:
        return float(sum(item["spheresRadii"]))
    return float("inf")


def refuse_other_states(mbs: exu.MainSystem) -> None:
    """Refuse states that quasi-static steps do not solve: first-order ones, and those with a history but robots'."""
    data = mbs.systemData
    if data.ODE1Size():
        raise ValueError(
            "the scene has first-order (ODE1) states, which the quasi-static solver does not solve; "
            "use mbs.SolveDynamic, or leave these items out"
        )
    for i in range(data.NumberOfObjects()):
        if len(data.GetObjectLTGData(i)):
            _refuse_history(mbs.GetObject(i))


def _refuse_history(item: dict[str, Any]) -> None:
    """Refuse an object with states that are not functions of the present gap."""
    kind, name = item["objectType"], item["name"]
    if kind in TURNS or (kind in SOLVED and not item.get("contactPlasticityRatio", 0.0)):
        return
    stops_only = kind == "ConnectorCoordinateSpringDamperExt" and not (
        item["dynamicFrictionForce"] or item["staticFrictionOffsetForce"] or item["stickingStiffness"]
    )
    if stops_only:
        return
    reason = "plastic contact" if kind in SOLVED else "states with a history"
    raise ValueError(
        f"object {name!r} ({kind}) has {reason}, which the quasi-static solver does not solve; use mbs.SolveStatic or "
        f"mbs.SolveDynamic, or one of {', '.join(SOLVED)}, GeneralContact, or the limit stops of a "
        "CoordinateSpringDamperExt without friction"
    )
