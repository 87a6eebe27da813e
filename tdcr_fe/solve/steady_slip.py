"""Substeps in which every hole keeps slipping in its direction: a check that costs one right side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.solve.linearization import Linearization
from tdcr_fe.solve.state import SolverState, Target

Array = NDArray[np.float64]

#: Slips below this fraction of the presliding distance are zero [1].
SMALL = 1e-2


def slips_steadily(
    before: SolverState,
    after: SolverState,
    forces: Sequence[TendonForces],
    target: Target,
    line: Linearization,
    clamped: Sequence[slice],
    presliding: float,
) -> bool:
    """Whether every hole of tendons under tension slips in one direction through a substep in which no load changes.

    All of them slip at its end. The slip rates there follow from the last linearisation, those at the start from these
    and the slips, which are taken as parabolas of the load factor. A substep in which no slip reverses is exact as a
    whole, see `tdcr_fe.solve.reversals`.

    Parameters
    ----------
    before, after
        States at both ends.
    forces
        By robot, at the end.
    target
        At the end.
    line
        Linearisation at the end, or at most an iteration before.
    clamped
        Unknowns of clamped bases.
    presliding
        Presliding distance [m].
    """
    if not _all_slip(before, after, line):
        return False
    numbering, driven = line.numbering, line.numbering.any_driven
    right = np.zeros(numbering.linear)
    starts = before.inputs if driven else before.base_tension
    pulled: list[Array] = []
    for part in numbering.robots:
        tension = target.inputs[part.robot] - starts[part.robot]
        if driven:
            change = tension[part.driven]
            right[part.tensions] = np.where(line.slack[part.robot], 0.0, change)
            tension[part.driven] = 0.0
        right[part.nodes] = -(forces[part.robot].base_tension_columns() @ tension)
        pulled.append(tension)
    for base in clamped:
        right[base] = 0.0
    moved = line.factorisation.solve(right)
    for part, tension in zip(numbering.robots, pulled, strict=True):
        if not part.has_friction:
            continue
        i = part.robot
        if driven:
            tension[part.driven] = moved[part.tensions]
        rate = forces[i].slip_change(moved[part.nodes], tension)
        first = 2.0 * (after.friction[i].slip - before.friction[i].slip) - rate
        side = after.mobilisation[i] * part.frictional
        side *= after.base_tension[i][:, None] > 0.0
        if min((side * rate).min(), (side * first).min()) < -SMALL * presliding:
            return False
    return True


def _all_slip(before: SolverState, after: SolverState, line: Linearization) -> bool:
    """Whether every hole of tendons under tension slips at the end, and no tendon goes slack."""
    for part in line.numbering.robots:
        i = part.robot
        if not part.has_friction:
            continue
        taut = after.base_tension[i] > 0.0
        if (np.abs(after.mobilisation[i]) < (part.frictional & taut[:, None])).any():
            return False
        if (before.base_tension[i] > 0.0)[~taut].any():
            return False
    return True
