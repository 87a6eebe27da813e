"""Tangent of a scene: the parts of robots alone, of unbalanced wrenches, of tendons, and of driven tendons."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.solve.numbering import Numbering
from tdcr_fe.solve.reduction import SceneTangent
from tdcr_fe.solve.residual import Residual

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
_EYE6 = np.eye(6)


def add_elastic(tangent: SceneTangent, residual: Residual, nodes: Sequence[slice]) -> None:
    """Put the tangent of the backbones, in the unknowns of the solver, into a tangent of zeros.

    Parameters
    ----------
    tangent
        Its blocks are changed.
    residual
        Of a state where nothing but robots resists.
    nodes
        By robot, its nodes among those of all robots.
    """
    configuration = residual.state.configuration
    for i, own in enumerate(nodes):
        mesh, wrenches = residual.forces[i].model.mesh, residual.unbalanced[6 * own.start : 6 * own.stop]
        terms = configuration.chains[i].tangent(mesh, wrenches, *configuration.poses[i])
        tangent.put(tangent.pattern.robots[i].backbone, terms)


def add_unbalanced(tangent: SceneTangent, residual: Residual, nodes: Sequence[slice]) -> None:
    """Add to Exudyn's Jacobian the geometric terms of unbalanced wrenches; arguments as in `add_elastic`."""
    configuration = residual.state.configuration
    for i, own in enumerate(nodes):
        wrenches = residual.unbalanced[6 * own.start : 6 * own.stop]
        terms = configuration.chains[i].unbalanced_terms(wrenches, *configuration.poses[i])
        tangent.add(tangent.pattern.robots[i].backbone, terms)


def add_geometric_stiffness(tangent: SceneTangent, residual: Residual) -> None:
    """Add the geometric stiffness of straight tendon segments to the blocks of a tangent."""
    for own, robot in zip(residual.forces, tangent.pattern.robots, strict=True):
        if own.model.geometry is not None:
            tangent.add(robot.holes, own.geometric_stiffness())


def add_couplings(k: Array, residual: Residual, nodes: Sequence[slice]) -> None:
    """Add the change of the tensions with the nodes, and section forces, to a dense tangent."""
    for own, at in zip(residual.forces, nodes, strict=True):
        if len(own.base_tension) or own.model.section is not None:
            inside = slice(6 * at.start, 6 * at.stop)
            own.add_coupling(k[inside, inside])


def slack_tendons(residual: Residual, numbering: Numbering, stiffness: float) -> tuple[Flags, ...]:
    """By robot, which of the tendons with prescribed displacement are slack.

    Parameters
    ----------
    residual, numbering
        State, target, and order of the unknowns.
    stiffness
        With which a displacement deficit counts against a tension [N/m].
    """
    found = []
    for part in numbering.robots:
        which, own = part.driven, residual.forces[part.robot]
        gap = (own.field.base_slip - residual.target.inputs[part.robot])[which]
        # A tendon is taut where its tension, or else its displacement deficit, is positive.
        found.append(own.base_tension[which] - gap * stiffness <= 0.0)
    return tuple(found)


def add_driven(k: Array, residual: Residual, numbering: Numbering, slack: Sequence[Flags]) -> None:
    """Fill rows and columns of tensions whose tendons have prescribed displacements."""
    for part in numbering.robots:
        which, own, loose = part.driven, residual.forces[part.robot], slack[part.robot]
        if not which.size:
            continue
        k[part.nodes, part.tensions] = own.base_tension_columns()[:, which]
        rows = own.base_slip_rows()[which]
        rows[loose] = 0.0
        k[part.tensions, part.nodes] = rows
        k[part.tensions, part.tensions] = np.diag(np.where(loose, 1.0, own.base_slip_by_base()[which]))


def add_damping(k: Array, nodes: int, damping: float, length: float) -> None:
    """Add the damping [N m] of pseudo-transient continuation on all nodes; forces by a lever of the length [m]."""
    # Exudyn's Jacobian is that of the right-hand side: minus the stiffness.
    diagonal = np.arange(6 * nodes)
    k[diagonal, diagonal] -= damping * np.tile(np.repeat((1.0 / length**2, 1.0), 3), nodes)


def hold(k: Array, bases: Sequence[slice]) -> None:
    """Replace the equations of clamped bases by zero increments."""
    for base in bases:
        rows = k[base]
        rows.fill(0.0)
        rows[:, base] = _EYE6
