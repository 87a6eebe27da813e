"""Which bodies move freely in a scene whose tangent is singular."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.solve.equations.state import SolverState
from tdcr_fe.solve.equations.system import SceneSystem

Array = NDArray[np.float64]

#: Singular value of the tangent, its rows and columns of length 1, below which a motion meets no resistance [1].
NO_RESISTANCE = 1e-10
#: Part of a free motion above which a coordinate belongs to it [1].
PART = 0.1
#: Most coordinates for which the motion is looked for: its time grows with the third power.
MOST = 1500


def freely_moving(system: SceneSystem, state: SolverState) -> list[str]:
    """Names of the nodes that some motion without resistance displaces; none where that motion is not found.

    Parameters
    ----------
    system
        The scene.
    state
        In which it is at rest.
    """
    system.layout.space.write(state.configuration)
    tangent = system.whole_tangent()
    if len(tangent) > MOST:
        return []
    for axis in (1, 0):
        size = np.linalg.norm(tangent, axis=axis, keepdims=True)
        tangent = np.divide(tangent, size, out=np.zeros_like(tangent), where=size > 0.0)
    _, resistance, motions = np.linalg.svd(tangent)
    free = motions[resistance <= NO_RESISTANCE]
    displaced = np.flatnonzero(np.abs(free).max(axis=0, initial=0.0) > PART)
    return _nodes_with(system, displaced)


def _nodes_with(system: SceneSystem, coordinates: NDArray[np.int_]) -> list[str]:
    """Names of the nodes that have any of the scene's ODE2 coordinates."""
    mbs, data = system.mbs, system.mbs.systemData
    found = []
    for i in range(data.NumberOfNodes()):
        node = mbs.GetNode(i)
        if node["nodeType"] == "GenericData" or node["nodeType"].endswith("Ground"):
            continue
        first = mbs.GetNodeODE2Index(i)
        count = np.size(node["referenceCoordinates"])
        if np.any((coordinates >= first) & (coordinates < first + count)):
            found.append(node["name"] or f"node {i}")
    return found
