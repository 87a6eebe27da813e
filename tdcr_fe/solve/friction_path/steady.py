"""Whether every hole keeps slipping in its direction through a substep, so that it is exact as a whole.

The check takes at most one solution with factors that are at hand, and settles most load steps that only go on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.equations.linearization import Linearization, input_changes
from tdcr_fe.solve.newton.newton import NewtonResult
from tdcr_fe.solve.newton.steps import slip_changes

Array = NDArray[np.float64]


def slips_steadily(before: SolverState, result: NewtonResult, linear: Linearization) -> bool:
    """Whether every hole of tendons under tension slips in one direction through a substep in which no load changes.

    All of them slip at both ends, in the same direction, unless their tendon had no tension. The slip rates at the end,
    from the last linearisation, have the direction of the friction, and so have those at the start, from these and the
    slips taken as parabolas of the load factor. A substep in which no slip reverses is exact as a whole.

    Parameters
    ----------
    before
        State at the start.
    result
        The solved substep.
    linear
        Linearisation at the end, or at most an iteration before.
    """
    after, numbering = result.state, linear.numbering
    pick, parts = numbering.at_frictional_holes, numbering.robots
    old, new = pick(before.mobilisation), pick(after.mobilisation)
    was_tense, tense = (
        pick([p.frictional & p.may_be_tense(t)[:, None] for p, t in zip(parts, tension, strict=True)])
        for tension in (before.base_tension, after.base_tension)
    )
    # A hole that changes between stick and slip bends the slips of all others, so that they are no parabolas. Where a
    # tendon is pulled from zero, its friction grows with its tension, and such holes have no effect yet.
    if (np.abs(new) < 1.0)[tense].any() or (old * new < 1.0)[was_tense].any():
        return False
    for part in parts:
        was_taut, taut = (state.base_tension[part.robot] > 0.0 for state in (before, after))
        becomes_taut = (taut & ~was_taut)[part.driven].any()
        if part.has_friction and ((was_taut & ~taut).any() or becomes_taut):
            return False
    changes = input_changes(before, result.target)
    rate = pick(slip_changes(numbering, result.forces, linear.response(changes), changes))
    slips = pick(
        [last.slip - first.slip for last, first in zip(after.friction, before.friction, strict=True)]
    )
    side = np.where(tense, new, 0.0)
    first = 2.0 * slips - rate
    return bool(min((side * rate).min(), (side * first).min()) >= 0.0)
