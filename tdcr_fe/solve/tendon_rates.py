"""Derivatives of slips at one solved state, with the tensions of some displacement-driven tendons as unknowns.

The linearised equilibrium has the slack of a taut tendon prescribed, and the tension of a slack one. Where a tendon
changes between both within a substep, its tension is taken as the unknown at both ends, by a principal pivot.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.solve.friction_path import SlipRates
from tdcr_fe.solve.friction_step import FrictionResponse, slips_after
from tdcr_fe.solve.linearization import Linearization
from tdcr_fe.solve.numbering import Numbering

Array = NDArray[np.float64]
Index = NDArray[np.int_]


class LoadResponse(NamedTuple):
    """Response to a change of inputs and loads at fixed mobilisations.

    Attributes
    ----------
    slips : ndarray, shape (k,)
        Change of the slips [m].
    step : ndarray, shape (linear,)
        Change of the unknowns of equilibrium.
    start : ndarray, shape (d,)
        Displacements of the tendons driven by displacement, before the change [m].
    displacement : ndarray, shape (d,)
        Their change [m].

    All at first order.
    """

    slips: Array
    step: Array
    start: Array
    displacement: Array

    def reversed(self) -> LoadResponse:
        """The response to the opposite change, to the load at which it was linearised."""
        return LoadResponse(-self.slips, -self.step, self.start + self.displacement, -self.displacement)


def driven_values(numbering: Numbering, by_robot: Sequence[Array]) -> Array:
    """Values of the tendons driven by displacement, of all robots one after the other, shape (d,).

    Parameters
    ----------
    numbering
        Of the unknowns.
    by_robot
        Of all tendons, shape (m,).
    """
    if not numbering.any_driven:
        return np.zeros(0)
    return np.concatenate([by_robot[p.robot][p.driven] for p in numbering.robots])


def driven_owners(numbering: Numbering) -> Index:
    """By frictional hole, the number of its tendon among those driven by displacement, else -1, shape (k,)."""
    found = []
    for part in numbering.robots:
        if part.has_friction:
            number = np.full(len(part.frictional), -1)
            number[part.driven] = part.tensions.start - numbering.reduced + np.arange(part.driven.size)
            found.append(number[np.nonzero(part.frictional)[0]])
    return np.concatenate(found)


def _slack_rows(numbering: Numbering, forces: Sequence[TendonForces], which: Index) -> Array:
    """Derivatives of the slack of some tendons driven by displacement by the unknowns, shape (c, linear)."""
    rows = np.zeros((len(which), numbering.linear))
    for part in numbering.robots:
        first = part.tensions.start - numbering.reduced
        for row, number in enumerate(which - first):
            if 0 <= number < part.driven.size:
                own, tendon = forces[part.robot], part.driven[number]
                rows[row, part.nodes] = own.base_slip_rows()[tendon]
                rows[row, part.tensions.start + number] = own.base_slip_by_base()[tendon]
    return rows


def rates_with_tensions(
    linear: Linearization,
    forces: Sequence[TendonForces],
    response: FrictionResponse,
    load: LoadResponse,
    which: Index,
    presliding: float,
) -> SlipRates:
    """Derivatives of the slips and of the slack of some tendons, by load factor, mobilisations and their tensions.

    Parameters
    ----------
    linear, forces, response
        The solved state.
    load
        Response to the load factor.
    which
        Numbers of the tendons among those driven by displacement, shape (c,).
    presliding
        Presliding distance [m].
    """
    if not which.size:
        return SlipRates(load.slips, response.matrix)
    numbering = linear.numbering
    k, c = len(load.slips), len(which)
    taut = ~np.concatenate(linear.slack)[which]
    unknowns = numbering.reduced + which
    unit = np.zeros((numbering.linear, c), order="F")
    unit[unknowns, np.arange(c)] = 1.0
    moved = linear.factorisation.solve(unit)
    slips = numbering.at_frictional_holes([own.field.slip for own in forces])
    table = np.empty((k + c, k + c + 1))
    table[:k, :k] = -response.matrix
    table[np.arange(k), np.arange(k)] += presliding
    for j in range(c):
        table[:k, k + j] = numbering.at_frictional_holes(slips_after(numbering, forces, moved[:, j])) - slips
    table[:k, -1] = load.slips
    steps = np.concatenate((response.columns, moved, load.step[:, None]), axis=1)
    table[k:] = steps[unknowns]
    loose = np.flatnonzero(~taut)
    if loose.size:
        table[k + loose] = _slack_rows(numbering, forces, which[loose]) @ steps
        table[k + loose, -1] -= load.displacement[which[loose]]
    pulled = k + np.flatnonzero(taut)
    if pulled.size:
        table = _exchanged(table, pulled)
    table[k:] *= -1.0
    matrix = -table[:, :-1]
    matrix[np.arange(k), np.arange(k)] += presliding
    return SlipRates(table[:, -1].copy(), matrix)


def _exchanged(table: Array, which: Index) -> Array:
    """Principal pivot: outputs with these numbers become inputs, and the inputs of the same numbers outputs."""
    others = np.setdiff1d(np.arange(len(table)), which)
    rest = np.append(others, table.shape[1] - 1)
    inverse = np.linalg.inv(table[which[:, None], which])
    new = np.empty_like(table)
    new[which[:, None], which] = inverse
    new[which[:, None], rest] = -inverse @ table[which[:, None], rest]
    new[others[:, None], which] = table[others[:, None], which] @ inverse
    new[others[:, None], rest] = (
        table[others[:, None], rest] + table[others[:, None], which] @ new[which[:, None], rest]
    )
    return new
