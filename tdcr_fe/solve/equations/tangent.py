"""Parts of the tangent of a scene: of backbones, of driven tendons, and of clamped bases."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BackboneMesh, NodeStiffness
from tdcr_fe.elements.poses import EYE6
from tdcr_fe.solve.equations.kernel import Residual
from tdcr_fe.solve.equations.layout import Numbering, zero_bases

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def backbone_tangent(
    residual: Residual, robot: int, nodes: slice, damping: Array, mesh: BackboneMesh | None = None
) -> NodeStiffness:
    """What Exudyn's Jacobian leaves out of the tangent of a backbone, or with a mesh all of it.

    These are the geometric terms of unbalanced wrenches, and the damping of pseudo-transient continuation.

    Parameters
    ----------
    residual
        Of a state.
    robot, nodes
        Its number, and its nodes among those of all robots.
    damping
        See `damping_of_node`, shape (6,).
    mesh
        Of the only robot, where nothing else resists.
    """
    configuration, wrenches = (
        residual.state.configuration,
        residual.unbalanced[6 * nodes.start : 6 * nodes.stop],
    )
    found = configuration.chains[robot].tangent(wrenches, *configuration.poses[robot], mesh)
    component = np.arange(6)
    # Exudyn's Jacobian is that of the right-hand side: minus the stiffness.
    found.itself[:, component, component] -= damping
    return found


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
    """Damping of pseudo-transient continuation [N m] by the increments of a node, shape (6,).

    Forces act by a lever of the length [m].
    """
    return damping * np.repeat((1.0 / length**2, 1.0), 3)


def hold(k: Array, bases: Sequence[slice]) -> None:
    """Replace the equations of clamped bases by zero increments."""
    for base in bases:
        rows = k[base]
        rows.fill(0.0)
        rows[:, base] = EYE6
