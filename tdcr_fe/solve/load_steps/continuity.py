"""Whether the slopes at its ends explain what changed in a substep, which excludes a jump to another branch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.solve.equations.state import SolverState
from tdcr_fe.solve.friction_path.equilibrium import Equilibrium
from tdcr_fe.solve.friction_path.substep_slips import InterpolationPoint
from tdcr_fe.solve.friction_path.taut_tendons import TautTendons
from tdcr_fe.solve.load_steps.states_within import twist_change, twists
from tdcr_fe.solve.load_steps.substep import SubstepSolver

Array = NDArray[np.float64]

#: Largest rotation of an element that the mean of both slopes leaves unexplained, over the largest rotation [1].
UNEXPLAINED = 0.1


def is_continuous(
    solver: SubstepSolver, before: SolverState, start: float, after: SolverState, end: float
) -> bool:
    """Whether the change of all elements in a substep is that by the slopes at its ends, on average.

    On one branch of equilibria the configuration is a smooth function of the tensions of all segments and of the loads,
    whatever friction did on the way. After a jump, the slopes would agree with its size by chance only.

    Parameters
    ----------
    solver
        Of the load step.
    before, after
        Solved states at the ends of the substep.
    start, end
        Their load factors [1].
    """
    ramp, system = solver.ramp, solver.system
    if ramp.nonlinear or ramp.before_increment is not None or not system.tangent_follows_from_elements():
        return False
    first = Equilibrium.at(system, before, ramp.apply(system, start))
    last = Equilibrium.at(system, after, ramp.apply(system, end))
    taut = TautTendons.of((first, last))
    if not (first.balanced and taut.tendons):
        return False
    first, last = (at.with_response(system.layout.clamped, taut.numbers) for at in (first, last))
    from_end = last.load_response(system, ramp.apply(system, start)).times(-1.0)
    from_start = first.load_response(system, ramp.apply(system, end))
    tension = taut.tensions(last) - taut.tensions(first)
    slopes = [
        twist_change(at, tension, 1.0)
        for at in (InterpolationPoint(0.0, first, from_start), InterpolationPoint(1.0, last, from_end))
    ]
    change = twists(last) - twists(first)
    return _rotation(change - 0.5 * (slopes[0] + slopes[1])) <= UNEXPLAINED * _rotation(change)


def _rotation(change: Array) -> float:
    """Largest rotation of an element [rad]."""
    return float(np.abs(change.reshape(-1, 6)[:, 3:]).max())
