"""Tangent of a robot's forces where holes stick or slide, and tendons are driven by displacement, all condensed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import TendonForces

Array = NDArray[np.float64]


def add_condensed(k: Array, forces: TendonForces, driven: NDArray[np.bool_], stuck: bool) -> None:
    """Add the change of tensions at the base and of mobilisations with the nodes to a tangent.

    Without it the tangent is that at fixed tensions at the base and fixed mobilisations. The mobilisation of a hole
    that sticks follows its slip, ``ds = du / delta``; a tendon that is driven by displacement keeps its displacement.
    Both are linear equations beside those of the nodes, and are eliminated.

    Parameters
    ----------
    k
        By body-frame increments of the nodes, changed in place, shape (6 N, 6 N).
    forces
        At the mobilisations of a solved state; tendons that are driven by displacement are elastic.
    driven
        Which tendons are driven by displacement and taut, shape (m,).
    stuck
        Whether every frictional hole sticks; where not, every one slides on in its direction, or is at rest without
        resistance.
    """
    law = forces.model.law
    which = np.flatnonzero(driven)
    holes = int(np.count_nonzero(law.frictional)) if stuck and law.has_friction else 0
    count = len(which) + holes
    if count == 0:
        return
    matrix, by_nodes = np.zeros((count, count)), np.zeros((count, len(k)))
    columns = np.zeros((len(k), count))
    first = slice(0, len(which))
    matrix[first, first] = np.diag(forces.base_slip_by_base()[which])
    by_nodes[first] = forces.base_slip_rows()[which]
    columns[:, first] = forces.base_tension_columns()[:, which]
    if holes:
        rest = slice(len(which), count)
        slip_by_nodes, slip_by_base, slip_by_mobilisation = forces.slip_rows()
        matrix[first, rest] = forces.base_slip_by_mobilisation()[which]
        matrix[rest, first] = slip_by_base[:, which]
        matrix[rest, rest] = slip_by_mobilisation - law.presliding * np.eye(holes)
        by_nodes[rest] = slip_by_nodes
        columns[:, rest] = forces.mobilisation_columns()
    k -= columns @ np.linalg.solve(matrix, by_nodes)
