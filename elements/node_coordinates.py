"""Coordinates of the nodes of a backbone in Exudyn's scene, and the poses that follow from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.poses import rotation_of_euler_parameters
from tdcr_fe.elements.system import SystemReference

Array = NDArray[np.float64]


class NodeCoordinates:
    """Coordinates of the nodes of one backbone.

    Parameters
    ----------
    system
        The system.
    nodes
        Exudyn's numbers of the nodes, base first.
    """

    def __init__(self, system: SystemReference, nodes: Sequence[Any]) -> None:
        self._system, self._nodes = system, nodes
        self._numbers: NDArray[np.int_] | None = None
        self._reference: Array | None = None

    @property
    def numbers(self) -> NDArray[np.int_]:
        """Exudyn's ODE2 coordinate numbers of all nodes, shape (N, 7); needs an assembled system."""
        if self._numbers is None:
            first = np.array([self._system.mbs.GetNodeODE2Index(n) for n in self._nodes])
            self._numbers = first[:, None] + np.arange(7)
        return self._numbers

    def forget(self) -> None:
        """Read numbers and reference values from Exudyn again, after another `Assemble`."""
        self._numbers = None
        self._reference = None

    @property
    def reference(self) -> Array:
        """Reference values of the coordinates, shape (N, 7).

        Exudyn's own `GetODE2CoordinatesTotal` frees memory wrongly in 1.13.6 (beyond about 100 coordinates the
        process aborts), so the sum of reference and displacement is formed here.
        """
        if self._reference is None:
            data = self._system.mbs.systemData
            everything = np.array(data.GetODE2Coordinates(exu.ConfigurationType.Reference))
            self._reference = everything[self.numbers]
        return self._reference

    def displacements(self) -> Array:
        """Current coordinates in the scene, without reference values, shape (N, 7)."""
        data = self._system.mbs.systemData
        moved: Array = data.GetODE2Coordinates(exu.ConfigurationType.Current, copy=False)
        return moved[self.numbers]

    def poses(self, displacements: Array) -> tuple[Array, Array, Array]:
        """Positions (N, 3), rotations (N, 3, 3) in beam axes and Euler parameters (N, 4) of coordinates, (N, 7)."""
        q = displacements + self.reference
        e = q[:, 3:]
        return q[:, :3], rotation_of_euler_parameters(e), e
