"""Derivative of the contact forces between spheres and triangles of a ``GeneralContact``, for the quasi-static solver.

Exudyn 1.13.6 takes the nearest point of a triangle as one that is fixed to it. On a face that point moves along with
the sphere, so Exudyn's Jacobian has an additional ``F / d`` along the face, of the contact force F and the distance d
of the sphere's centre, as for a sphere on a point. On an edge it has the same along the edge, and twice the stiffness
along the normal, because the force of a triangle is halved there. Derivatives by the rotation of a body that carries
triangles are missing, and all of them where contact between spheres is switched off. The forces themselves are right:
their derivative is taken from them by central differences, alike for faces, edges and vertices, fixed and moving.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import exudyn as exu
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Array = NDArray[np.float64]
Index = NDArray[np.int_]

#: Change of a coordinate for the differences, over the smallest radius of a sphere.
RELATIVE_STEP = 1e-4


class GeneralTriangles(NamedTuple):
    """A ``GeneralContact`` with spheres and triangles.

    Attributes
    ----------
    contact : exudyn.GeneralContact
    spheres : int
        Number of its spheres.
    first : int
        Number of the first triangle in its lists of active contacts.
    """

    contact: Any
    spheres: int
    first: int

    @property
    def touching(self) -> bool:
        """Whether a sphere is in contact with a triangle, by the present active sets."""
        return any(bool(np.any(np.abs(found) >= self.first)) for found in self.active)

    @property
    def active(self) -> list[Index]:
        """By sphere, Exudyn's numbers of what it is in contact with."""
        kind = exu.ContactTypeIndex.IndexSpheresMarkerBased
        return [np.array(self.contact.GetActiveContacts(kind, i), dtype=int) for i in range(self.spheres)]


class TriangleContact:
    """All ``GeneralContact`` of a scene that have spheres and triangles.

    Parameters
    ----------
    mbs
        An assembled system.
    """

    def __init__(self, mbs: exu.MainSystem) -> None:
        self._mbs = mbs
        self._all: list[GeneralTriangles] = []
        radii = []
        for contact in map(mbs.GetGeneralContact, range(mbs.NumberOfGeneralContacts())):
            about = contact.GetPythonObject()
            spheres = int(about["numberOfSpheresMarkerBased"])
            if spheres and about["numberOfTrigsRigidBodyBased"]:
                offsets = about["globalContactIndexOffsets"]
                first = int(offsets[int(exu.ContactTypeIndex.IndexTrigsRigidBodyBased)])
                self._all.append(GeneralTriangles(contact, spheres, first))
                radii += [contact.GetSphereMarkerBased(i, addData=True)["radius"] for i in range(spheres)]
        self._step = RELATIVE_STEP * min(radii, default=0.0)
        self._nodes = _nodes_of_coordinates(mbs)
        self._couplings: tuple[list[bytes], NDArray[np.bool_]] | None = None

    def couplings(self, compute: Callable[[], Array]) -> NDArray[np.bool_]:
        """Which coordinates these contacts couple, shape (n2, n2), found anew where active sets have changed.

        Parameters
        ----------
        compute
            Gives Exudyn's Jacobian of their forces, shape (n2, n2), of which only the pattern is used.
        """
        active = [found.tobytes() for each in self._all for found in each.active]
        if self._couplings is None or self._couplings[0] != active:
            self._couplings = active, compute() != 0.0
        return self._couplings[1]

    @property
    def present(self) -> bool:
        """Whether there is any."""
        return bool(self._all)

    @property
    def touching(self) -> bool:
        """Whether a sphere is in contact with a triangle, by the present active sets."""
        return any(each.touching for each in self._all)

    @contextmanager
    def switched_off(self) -> Iterator[None]:
        """Let these contacts exert no forces."""
        before = [each.contact.isActive for each in self._all]
        try:
            for each in self._all:
                each.contact.isActive = False
            yield
        finally:
            for each, active in zip(self._all, before, strict=True):
                each.contact.isActive = active

    def derivative(self, evaluate: Callable[[], object], couplings: NDArray[np.bool_]) -> Array:
        """Derivative of the forces of these contacts by the ODE2 coordinates, shape (n2, n2).

        Parameters
        ----------
        evaluate
            Lets Exudyn compute the forces in the current configuration, which is left as it is.
        couplings
            See `couplings`: bodies that are not coupled are moved at the same time.
        """
        found = np.zeros(couplings.shape)
        current: Array = self._mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Current, copy=False)
        start = current.copy()
        with self._forces_kept():
            evaluate()
            groups = self._coupled(self._forces(), couplings)
            for k in range(max(map(len, groups), default=0)):
                columns = np.array([group[k] for group in groups if k < len(group)])
                change = np.zeros(len(start))
                for step in (self._step, -self._step):
                    current[columns] = start[columns] + step
                    evaluate()
                    change += self._forces() / (2.0 * step)
                current[columns] = start[columns]
                for group in groups:
                    if k < len(group):
                        found[group, group[k]] = change[group]
            evaluate()
        return found

    def _coupled(self, forces: Array, couplings: NDArray[np.bool_]) -> list[Index]:
        """Coordinates of the bodies on which contact acts, those of bodies that are coupled together."""
        touched = np.flatnonzero(np.isin(self._nodes, self._nodes[np.flatnonzero(forces)]))
        _, body = np.unique(self._nodes[touched], return_inverse=True)
        size = int(body.max(initial=-1)) + 1
        if not all(each.contact.sphereSphereContact for each in self._all):
            # Then Exudyn's Jacobian has nothing of these contacts, so no pattern either.
            return [touched]
        row, column = np.nonzero(couplings[np.ix_(touched, touched)])
        graph = coo_array((np.ones(len(row)), (body[row], body[column])), shape=(size, size))
        count, group = connected_components(graph, directed=False)
        return [touched[group[body] == g] for g in range(count)]

    def _forces(self) -> Array:
        """Generalised forces of these contacts, as last evaluated, shape (n2,)."""
        return np.sum([each.contact.GetSystemODE2RhsContactForces(copy=True) for each in self._all], axis=0)

    @contextmanager
    def _forces_kept(self) -> Iterator[None]:
        """Let Exudyn keep the forces of these contacts by themselves."""
        before = [each.contact.computeContactForces for each in self._all]
        try:
            for each in self._all:
                each.contact.computeContactForces = True
            yield
        finally:
            for each, kept in zip(self._all, before, strict=True):
                each.contact.computeContactForces = kept


def _nodes_of_coordinates(mbs: exu.MainSystem) -> Index:
    """Number of the node of every ODE2 coordinate, shape (n2,)."""
    data = mbs.systemData
    found = np.full(data.ODE2Size(), -1)
    for node in range(data.NumberOfNodes()):
        found[np.asarray(data.GetNodeLTGODE2(node), dtype=int)] = node
    return found
