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


def slips_steadily(
    before: SolverState,
    result: NewtonResult,
    linear: Linearization,
) -> bool:
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
    if not _all_slip(before, result.state, linear) or _any_changes(before, result.state, linear):
        return False
    return _rates_agree(before, result, linear)


def _rates_agree(
    before: SolverState,
    result: NewtonResult,
    linear: Linearization,
) -> bool:
    """Whether all slip rates at both ends of the substep have the direction of the friction."""
    after, numbering = result.state, linear.numbering
    changes = input_changes(before, result.target)
    pick, moved = numbering.at_frictional_holes, linear.response(changes)
    rate = pick(slip_changes(numbering, result.forces, moved, changes))
    slips = pick([new.slip - old.slip for new, old in zip(after.friction, before.friction, strict=True)])
    tense = [p.may_be_tense(t)[:, None] for p, t in zip(numbering.robots, after.base_tension, strict=True)]
    side = pick([s * own for s, own in zip(after.mobilisation, tense, strict=True)])
    first = 2.0 * slips - rate
    return bool(min((side * rate).min(), (side * first).min()) >= 0.0)


def _any_changes(before: SolverState, after: SolverState, linear: Linearization) -> bool:
    """Whether any hole changes between stick and slip or its direction, while its tendon is under tension.

    That bends the slips of all others, so that they are no parabolas. Where a tendon is pulled from zero, its friction
    grows with its tension, and holes that begin to slip have no effect yet.
    """
    for part in linear.numbering.robots:
        i = part.robot
        if part.has_friction:
            tense = part.frictional & part.may_be_tense(before.base_tension[i])[:, None]
            if (before.mobilisation[i] * after.mobilisation[i])[tense].min(initial=1.0) < 1.0:
                return True
    return False


def _all_slip(before: SolverState, after: SolverState, linear: Linearization) -> bool:
    """Whether every hole of tendons under tension slips at the end, and no tendon becomes slack or taut on the way.

    A tendon driven by tension may be pulled from zero: it is under tension all through the substep.
    """
    for part in linear.numbering.robots:
        i = part.robot
        if not part.has_friction:
            continue
        taut = after.base_tension[i] > 0.0
        tense = part.frictional & part.may_be_tense(after.base_tension[i])[:, None]
        if (np.abs(after.mobilisation[i]) < tense).any():
            return False
        was_taut = before.base_tension[i] > 0.0
        if was_taut[~taut].any() or not was_taut[part.driven][taut[part.driven]].all():
            return False
    return True
