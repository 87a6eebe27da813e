"""Friction in one Newton step: every hole sticks or slips, a small complementarity problem. Pure functions.

Equilibrium is linear in a step, friction is not. With everything but the mobilisations eliminated, their conditions
are a box-constrained linear complementarity problem. Where every hole continues to slip in its direction, as is
usual during loading, the step at fixed friction already satisfies these conditions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.complementarity import solve_box
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.solve.equations.numbering import Numbering, zero_bases
from tdcr_fe.solve.equations.state import SolverState

Array = NDArray[np.float64]
Index = NDArray[np.int_]
#: Slips against the direction of a hole are round-off below this fraction of the presliding distance [1].
ROUND_OFF = 1e-8


def mobilisations(numbering: Numbering, state: SolverState) -> Array:
    """Mobilisations that are unknowns, of all robots one after the other, shape (k,)."""
    return numbering.at_frictional_holes(state.mobilisation)


def slips_after(numbering: Numbering, forces: Sequence[TendonForces], step: Array) -> list[Array]:
    """By robot, slips after a step at fixed friction, linearised [m], shape (m, g); arguments as in `slip_residual`."""
    slips = []
    for part in numbering.robots:
        own, base = forces[part.robot], None
        slip = own.field.slip
        if part.has_friction:
            if part.driven.size:
                base = np.zeros(len(part.frictional))
                base[part.driven] = step[part.tensions]
            slip = slip + own.slip_change(step[part.nodes], base)
        slips.append(slip)
    return slips


def slip_changes(
    numbering: Numbering, forces: Sequence[TendonForces], step: Array, inputs: Sequence[Array]
) -> Array:
    """Linear changes of the slips with a step at fixed friction [m], shape (k,).

    Parameters
    ----------
    numbering, forces, step
        As in `slip_residual`.
    inputs
        By robot, changes of the inputs in the step, shape (m,).
    """
    found = []
    for part in numbering.robots:
        base = inputs[part.robot].copy()
        base[part.driven] = step[part.tensions]
        found.append(forces[part.robot].slip_change(step[part.nodes], base))
    return numbering.at_frictional_holes(found)


def slip_residual(
    numbering: Numbering, forces: Sequence[TendonForces], state: SolverState, step: Array, presliding: float
) -> Array:
    """Slip residual: excess of the slips over those of their mobilisations after a fixed-friction step [m], shape (k,).

    Parameters
    ----------
    numbering
        Of the unknowns.
    forces
        By robot, in the present configuration.
    state
        Present mobilisations, and the history.
    step
        At fixed friction, shape (linear,).
    presliding
        Presliding distance [m].
    """
    excess = [
        slip - before.slip - presliding * (mobilisation - before.mobilisation)
        for slip, before, mobilisation in zip(
            slips_after(numbering, forces, step), state.friction, state.mobilisation, strict=True
        )
    ]
    return numbering.at_frictional_holes(excess)


def all_keep_slipping(mobilisation: Array, residual: Array) -> bool:
    """Whether every hole slips, and continues in the same direction in a step at fixed friction."""
    return bool(np.minimum(np.abs(mobilisation) - 1.0, mobilisation * residual).min() >= 0.0)


class FrictionCoupling(NamedTuple):
    """Derivatives between the unknowns of equilibrium and the mobilisations.

    Attributes
    ----------
    columns : ndarray, shape (linear, k)
        Residual by the mobilisations.
    rows : ndarray, shape (k, linear)
        Slips by the unknowns of equilibrium.
    own : ndarray, shape (k, k)
        Slips by the mobilisations [m].
    """

    columns: Array
    rows: Array
    own: Array

    @classmethod
    def of(
        cls,
        numbering: Numbering,
        forces: Sequence[TendonForces],
        clamped: Sequence[slice],
        slack: Sequence[NDArray[np.bool_]],
    ) -> FrictionCoupling:
        """Assemble the derivatives of all robots.

        Parameters
        ----------
        numbering, forces
            As in `slip_residual`.
        clamped
            Unknowns of clamped bases.
        slack
            By robot, which of the tendons with prescribed displacement are slack.
        """
        count = numbering.total - numbering.linear
        columns = np.zeros((numbering.linear, count), order="F")
        rows = np.zeros((count, numbering.linear))
        own = np.zeros((count, count))
        for part in numbering.robots:
            if not part.has_friction:
                continue
            at = forces[part.robot]
            start, stop = part.mobilisations.start, part.mobilisations.stop
            here = slice(start - numbering.linear, stop - numbering.linear)
            columns[part.nodes, here] = at.mobilisation_columns()
            by_nodes, by_tension, own[here, here] = at.slip_rows()
            rows[here, part.nodes] = by_nodes
            if part.driven.size:
                by_base = at.base_slip_by_mobilisation()[part.driven]
                by_base[slack[part.robot]] = 0.0
                columns[part.tensions, here] = by_base
                rows[here, part.tensions] = by_tension[:, part.driven]
        zero_bases(columns, clamped)
        return cls(columns, rows, own)

    def response(self, solve: Callable[[Array], Array], which: Index, presliding: float) -> FrictionResponse:
        """Response to some of the mobilisations.

        Parameters
        ----------
        solve
            Solves the linearised equilibrium at fixed friction for several right sides, shape (linear, k').
        which
            Numbers of the mobilisations, shape (k',).
        presliding
            Presliding distance [m].
        """
        columns = -solve(np.asfortranarray(self.columns[:, which]))
        matrix = -(self.rows @ columns) - self.own[:, which]
        matrix[which, np.arange(len(which))] += presliding
        return FrictionResponse(columns, matrix)


class FrictionResponse(NamedTuple):
    """Response of the linearised equilibrium to mobilisations.

    Attributes
    ----------
    columns : ndarray, shape (linear, k')
        Change of the unknowns of equilibrium by the mobilisations.
    matrix : ndarray, shape (k, k')
        Presliding distance times identity, minus the derivative of the slips by the mobilisations [m].
    """

    columns: Array
    matrix: Array

    def then(self, other: FrictionResponse) -> FrictionResponse:
        """The response to further mobilisations beside these."""
        return FrictionResponse(
            np.concatenate((self.columns, other.columns), axis=1),
            np.concatenate((self.matrix, other.matrix), axis=1),
        )


def friction_step(
    coupling: FrictionCoupling,
    solve: Callable[[Array], Array],
    fixed: Array,
    residual: Array,
    mobilisation: Array,
    presliding: float,
) -> Array:
    """Complementarity step: the step with the mobilisations as unknowns, shape (total,).

    Most holes keep slipping. The problem is solved for those that stick or would reverse in the step at fixed friction;
    any other that then reverses joins them.

    Parameters
    ----------
    coupling
        Between the unknowns of equilibrium and the mobilisations.
    solve
        Solves the linearised equilibrium at fixed friction for several right sides, shape (linear, k).
    fixed
        Step at fixed friction, shape (linear,).
    residual, mobilisation
        See `slip_residual` and `mobilisations`, shape (k,).
    presliding
        Presliding distance [m].
    """
    side = np.trunc(mobilisation)
    which = np.flatnonzero((side == 0.0) | (side * residual < 0.0))
    response = coupling.response(solve, which, presliding)
    while True:
        before, matrix = mobilisation[which], response.matrix[which]
        new, _ = solve_box(matrix, residual[which] + matrix @ before, before)
        change = new - before
        excess = residual - response.matrix @ change
        reversing = side * excess < -ROUND_OFF * presliding
        reversing[which] = False
        further = np.flatnonzero(reversing)
        if not further.size:
            break
        response = response.then(coupling.response(solve, further, presliding))
        which = np.concatenate((which, further))
    changes = np.zeros(len(mobilisation))
    changes[which] = change
    return np.concatenate((fixed + response.columns @ change, changes))
