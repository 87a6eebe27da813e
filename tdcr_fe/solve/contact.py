"""Contact of Exudyn in quasi-static steps: which items can be solved, and their states in every iteration.

Exudyn's contact items decide by a state whether they act (a gap in a data coordinate, or the active sets of a
``GeneralContact``), which its own solvers update after Newton's iteration. The contact force is a continuous function
of the present gap, so here the states follow the configuration in every residual: Newton's method then solves the
penalty contact itself, as a semismooth equation (L. Qi, J. Sun, Math. Program. 58 (1993) 353-367).
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Objects whose states are functions of the present gap alone. Friction of these depends on the slip rate, and is zero
#: at rest.
SOLVED = ("ContactSphereSphere", "ContactSphereTriangle", "ContactCoordinate")
#: Part of the gap and of the size of a contact by which a node may move in one substep, so that none is jumped over.
ROOM = 0.5


class ContactStates:
    """States of the contact items of a scene.

    Parameters
    ----------
    mbs
        An assembled system.
    own_data
        Numbers of the data coordinates that belong to robots.

    Attributes
    ----------
    present : bool
        Whether there is any contact.

    Raises
    ------
    ValueError
        An item has states that quasi-static steps do not solve; the message names it.
    """

    def __init__(self, mbs: exu.MainSystem, own_data: Collection[int]) -> None:
        data = mbs.systemData
        items = [i for i in range(data.NumberOfObjects()) if len(data.GetObjectLTGData(i))]
        for i in items:
            _check(mbs.GetObject(i))
        self.present = bool(items) or mbs.NumberOfGeneralContacts() > 0
        sizes = {i: _size(mbs.GetObject(i)) for i in items}
        self._gaps = np.array(
            [data.GetObjectLTGData(i)[0] for i in items if np.isfinite(sizes[i])], dtype=int
        )
        self._sizes = np.array([size for size in sizes.values() if np.isfinite(size)])
        self._general_size = min(
            (_general_size(mbs, k) for k in range(mbs.NumberOfGeneralContacts())), default=np.inf
        )
        self._mbs = mbs
        self._foreign = np.setdiff1d(np.arange(data.DataSize()), np.fromiter(own_data, dtype=int))
        settings = exu.SimulationSettings()
        settings.solution.file.write = False
        settings.solution.sensors.active = False
        settings.timeIntegration.verboseMode = 0
        settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = False
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

    def room(self) -> float:
        """By how much a node may move from the present configuration without jumping over a contact [m]."""
        room = ROOM * self._general_size
        if self._gaps.size:
            data: Array = self._mbs.systemData.GetDataCoordinates(exu.ConfigurationType.Current, copy=False)
            reach = np.maximum(data[self._gaps], 0.0) + self._sizes
            room = min(room, ROOM * float(reach.min()))
        return float(room)

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


def _general_size(mbs: exu.MainSystem, number: int) -> float:
    """The same for a ``GeneralContact``: of its two smallest spheres, or its smallest one and a triangle."""
    contact = mbs.GetGeneralContact(number)
    counts = contact.GetPythonObject()
    if counts["numberOfANCFCable2D"]:
        raise ValueError("GeneralContact with ANCF cables is not solved by the quasi-static solver")
    radii = sorted(
        float(contact.GetSphereMarkerBased(i, addData=True)["radius"])
        for i in range(counts["numberOfSpheresMarkerBased"])
    )
    if not radii:
        return float("inf")
    return radii[0] if counts["numberOfTrigsRigidBodyBased"] else sum(radii[:2])


def _check(item: dict[str, Any]) -> None:
    """Refuse an object with states that are not functions of the present gap."""
    kind, name = item["objectType"], item["name"]
    if kind in SOLVED and not item.get("contactPlasticityRatio", 0.0):
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
