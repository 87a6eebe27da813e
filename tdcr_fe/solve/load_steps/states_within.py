"""States within a substep, solved at the mobilisations of the followed path.

Through them the slips are interpolated better than between both ends alone. Documentation: page "Theory", section
"Solving with reversals".
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.solve.equations.state import SolverState
from tdcr_fe.solve.friction_path.equilibrium import Equilibrium
from tdcr_fe.solve.friction_path.path import FrictionPath
from tdcr_fe.solve.friction_path.substep_slips import InterpolationPoint
from tdcr_fe.solve.friction_path.taut_tendons import TautTendons
from tdcr_fe.solve.load_steps.substep import SubstepSolver
from tdcr_fe.solve.newton.newton import newton
from tdcr_fe.solve.newton.prediction import moved_elements

Array = NDArray[np.float64]


def solve_within(
    solver: SubstepSolver,
    points: Sequence[InterpolationPoint],
    taut: TautTendons,
    path: FrictionPath,
    factor: float,
    load_factor: float,
) -> Equilibrium | None:
    """Solve a state within a substep, at the mobilisations of the followed path; None where that fails.

    Whether the path leads there exactly does not matter: in any equilibrium slips, angles and their derivatives belong
    to its own tensions.

    Parameters
    ----------
    solver
        Of the load step.
    points
        The states known so far, by load factor.
    taut
        The tendons whose slips are followed.
    path
        The followed path.
    factor
        Load factor within the substep [1].
    load_factor
        Of the load step [1].
    """
    system = solver.system
    guess = _interpolated(solver, points, taut, path, factor)
    if guess is None:
        return None
    target = solver.ramp.apply(system, load_factor)
    result = newton(system, guess, target, solver.settings, friction_fixed=True)
    if not result.converged:
        return None
    if result.linearization is not None:
        line = result.linearization._replace(numbering=system.numbering())
        found = Equilibrium.of(result.state, result.forces, line)
        if found.exact:
            return found
    return Equilibrium.at(system, result.state, target)


def _interpolated(
    solver: SubstepSolver,
    points: Sequence[InterpolationPoint],
    taut: TautTendons,
    path: FrictionPath,
    factor: float,
) -> SolverState | None:
    """The state at a load factor within the substep, by interpolation; None where an element turns by too much.

    Twists of the elements by a cubic along the line between the tensions of the states on both sides, beside it linear
    in the tensions: as slips are interpolated (`tdcr_fe.solve.friction_path.slip_interpolation`). Mobilisations and
    tensions at the base are those of the path.
    """
    unknowns, tension = path.at(factor)
    last = next(i for i, at in enumerate(points) if at.factor >= factor)
    first, then = points[last - 1], points[last]
    length = then.factor - first.factor
    x = (factor - first.factor) / length
    ends = [taut.tensions(at.state) for at in (first, then)]
    change, off_line = ends[1] - ends[0], tension - ends[0] - x * (ends[1] - ends[0])
    slopes = [twist_change(at, change, length) for at in (first, then)]
    whole = twists(then.state) - twists(first.state)
    defect = whole - 0.5 * (slopes[0] + slopes[1])
    step = x * slopes[0] + x * x * (0.5 * (slopes[1] - slopes[0]) + (3.0 - 2.0 * x) * defect)
    step += (1.0 - x) * twist_change(first, off_line, 0.0) + x * twist_change(then, off_line, 0.0)
    state = first.state.state
    configuration = moved_elements(solver.system, state, step, solver.settings.max_turn)
    if configuration is None:
        return None
    return _with_path_unknowns(first.state, taut, unknowns)._replace(configuration=configuration)


def _with_path_unknowns(at: Equilibrium, taut: TautTendons, unknowns: Array) -> SolverState:
    """A state with other mobilisations, and other tensions at the base of tendons driven by displacement.

    Parameters
    ----------
    at
        The state.
    taut
        The tendons under tension; those driven by displacement that are not among them have none.
    unknowns
        Mobilisations of their frictional holes [1], then tensions at the base [N], shape (k + c,).
    """
    state, numbering, k = at.state, at.numbering, len(taut.holes)
    mobilised = at.mobilisation.copy()
    mobilised[taut.holes] = unknowns[:k]
    tensions = list(state.base_tension)
    for part in numbering.robots:
        if part.driven.size:
            tensions[part.robot] = tensions[part.robot].copy()
            tensions[part.robot][part.driven] = 0.0
    for own, robot in zip(taut.tendons, taut.robots, strict=True):
        driven = own.which[own.driven]
        tensions[robot][driven] = unknowns[k : k + len(driven)]
        k += len(driven)
    mobilisation = numbering.with_frictional_holes(state.mobilisation, mobilised)
    return state._replace(mobilisation=mobilisation, base_tension=tuple(tensions))


def twists(at: Equilibrium) -> Array:
    """Twists of all elements: translations [m] and rotations [rad], six values each."""
    return np.concatenate([own.reshape(-1) for own in at.state.configuration.twists])


def twist_change(at: InterpolationPoint, tension: Array, load: float) -> Array:
    """Change of the twists of all elements by one of the tensions and of the loads, to first order.

    Parameters
    ----------
    at
        Where it is linearised.
    tension
        Change of the tensions of the segments [N], shape (q,).
    load
        Part of the change of the loads in the substep [1].
    """
    line, response = at.state.linearization, at.state.response
    assert response is not None
    nodes = response.nodes @ tension
    if at.load is not None and load:
        nodes = nodes + load * at.load.nodes
    return np.concatenate(
        [
            chain.changes(nodes[part.nodes].reshape(-1, 6)).reshape(-1)
            for chain, part in zip(line.chains, line.numbering.robots, strict=True)
        ]
    )
