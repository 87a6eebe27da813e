"""Tangent of a scene: the parts of robots alone, of unbalanced wrenches, of tendons, and of driven tendons."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import NodeStiffness
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.poses import EYE6
from tdcr_fe.solve.equations.kernel import Residual
from tdcr_fe.solve.equations.layout import Numbering, zero_bases

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def backbone_tangent(residual: Residual, damping: float, length: float) -> NodeStiffness:
    """Tangent of the backbone of the only robot, where nothing else resists, with damping of its nodes.

    Parameters
    ----------
    residual
        Of a state.
    damping
        Of the nodes, for pseudo-transient continuation [N m].
    length
        Of the backbone [m].
    """
    configuration, mesh = residual.state.configuration, residual.forces[0].model.mesh
    found = configuration.chains[0].tangent(residual.unbalanced, *configuration.poses[0], mesh)
    if damping > 0.0:
        component = np.arange(6)
        found.itself[:, component, component] -= damping_of_node(damping, length)
    return found


def robot_tangent(backbone: NodeStiffness, forces: TendonForces) -> Array:
    """Tangent of one robot as a full matrix, from that of its backbone, shape (6 N, 6 N)."""
    count = len(backbone.itself)
    k = np.zeros((6 * count, 6 * count))
    backbone.add_to(k, np.arange(count))
    forces.add_tangent(k)
    return k


def add_unbalanced(k: Array, residual: Residual, nodes: Sequence[slice]) -> None:
    """Add to Exudyn's Jacobian the geometric terms of unbalanced wrenches; ``nodes`` by robot among those of all."""
    configuration = residual.state.configuration
    for i, own in enumerate(nodes):
        wrenches = residual.unbalanced[6 * own.start : 6 * own.stop]
        terms = configuration.chains[i].tangent(wrenches, *configuration.poses[i])
        terms.add_to(k, np.arange(own.start, own.stop))


def border(residual: Residual, numbering: Numbering) -> tuple[Array, Array, Array, Flags]:
    """Rows and columns of tensions whose tendons have prescribed displacements.

    Parameters
    ----------
    residual, numbering
        State, and order of the unknowns.

    Returns
    -------
    columns : ndarray, shape (reduced, k)
        Of the reduced residual by the tensions.
    rows : ndarray, shape (k, reduced)
        Displacements at the base by the other unknowns.
    own : ndarray, shape (k,)
        Every displacement by the tension of that tendon [m/N].
    slack : ndarray of bool, shape (k,)
        Which of the tendons have no tension.
    """
    count = numbering.linear - numbering.reduced
    columns = np.zeros((numbering.reduced, count), order="F")
    rows, own, slack = np.zeros((count, numbering.reduced)), np.zeros(count), np.zeros(count, dtype=bool)
    for part in numbering.robots:
        which, at = part.driven, residual.forces[part.robot]
        if not which.size:
            continue
        here = slice(part.tensions.start - numbering.reduced, part.tensions.stop - numbering.reduced)
        columns[part.nodes, here] = at.base_tension_columns()[:, which]
        rows[here, part.nodes] = at.base_slip_rows()[which]
        own[here] = at.base_slip_by_base()[which]
        slack[here] = at.base_tension[which] <= 0.0
    zero_bases(columns, numbering.clamped)
    return columns, rows, own, slack


def damping_of_node(damping: float, length: float) -> Array:
    """Damping [N m] of pseudo-transient continuation by the increments of a node, shape (6,).

    Forces act by a lever of the length [m].
    """
    return damping * np.repeat((1.0 / length**2, 1.0), 3)


def add_damping(k: Array, nodes: int, damping: float, length: float) -> None:
    """Add the damping of all nodes, see `damping_of_node`."""
    # Exudyn's Jacobian is that of the right-hand side: minus the stiffness.
    diagonal = np.arange(6 * nodes)
    k[diagonal, diagonal] -= np.tile(damping_of_node(damping, length), nodes)


def hold(k: Array, bases: Sequence[slice]) -> None:
    """Replace the equations of clamped bases by zero increments."""
    for base in bases:
        rows = k[base]
        rows.fill(0.0)
        rows[:, base] = EYE6
