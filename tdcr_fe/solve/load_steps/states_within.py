"""States solved within a substep: for the interpolation of slips, and where slips reverse, for derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import ceil
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array, Flags
from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.friction_path.follow import FrictionPath, PathReversal
from tdcr_fe.solve.friction_path.response import (
    Equilibrium,
    InterpolationPoint,
    KnownStates,
    TautTendons,
    TensionResponse,
    interpolated,
    near_enough,
    with_path_unknowns,
)
from tdcr_fe.solve.load_steps.load_path import SolvedSubstep, StepFailed
from tdcr_fe.solve.load_steps.substep import SubstepSolver
from tdcr_fe.solve.newton.newton import newton

#: Most intervals into which a substep is divided at first by states within it.
MOST_INTERVALS_AT_FIRST = 4


def known_states(
    solver: SubstepSolver, states: Sequence[tuple[float, Equilibrium]], span: tuple[float, float]
) -> KnownStates:
    """States with their responses to tensions and loads.

    Parameters
    ----------
    solver
        Of the load step.
    states
        With their fractions of the substep [1].
    span
        Load factors of the load step at the ends of the substep [1].
    """
    taut, points = TautTendons.of([state for _, state in states]), []
    for factor, at in states:
        response, load = TensionResponse.of(at.linearization, at.forces, taut.numbers), None
        if solver.ramp.changes_beyond_inputs:
            # What is left of the change of the loads, seen from every state; from the last one, back to the start.
            end, other = (0.0, span[0]) if factor == 1.0 else (1.0, span[1])
            target = solver.ramp.apply(solver.system, other)
            unbalanced = solver.system.unbalanced(at.state, target, at.forces, at.numbering)
            load = response.to_load(at.linearization, at.forces, unbalanced / (end - factor))
        points.append(InterpolationPoint(factor, at, response, load))
    return KnownStates(span, taut, tuple(points))


def solve_within(
    solver: SubstepSolver, known: KnownStates, path: FrictionPath, factor: float
) -> Equilibrium | None:
    """Solve a state within a substep, at the mobilisations of the followed path; None where that fails.

    Whether the path leads there exactly does not matter: in any equilibrium slips, angles and their derivatives belong
    to its own tensions. The load factor is that within the substep [1].
    """
    guess = interpolated(solver.system, known, path, factor, solver.settings.max_turn)
    if guess is None:
        return None
    return _at_fixed_friction(solver, guess, known.load_factor(factor))


def _at_fixed_friction(solver: SubstepSolver, guess: SolverState, load_factor: float) -> Equilibrium | None:
    """Solve at the mobilisations of a guess; None where that fails."""
    system = solver.system
    target = solver.ramp.apply(system, load_factor)
    result = newton(system, guess, target, solver.settings, friction_fixed=True)
    if not result.converged:
        return None
    if result.linearization is not None:
        linear = result.linearization._replace(numbering=system.numbering())
        if near_enough(result.state, linear):
            return Equilibrium(result.state, result.forces, linear)
    return Equilibrium.at(system, result.state, target)


def refined(
    solver: SubstepSolver, known: KnownStates, path: FrictionPath, error: float, most: int
) -> list[tuple[float, Equilibrium]]:
    """States before the end with new ones between them; empty where there are to be no more of them.

    The number of intervals is doubled, and chosen at first by an error that falls with their cube.

    Parameters
    ----------
    solver
        Of the load step.
    known
        The present states.
    path
        On which states are solved.
    error
        Displacement of a node that the reversals leave uncertain, over that allowed [1].
    most
        Largest number of intervals.
    """
    intervals = len(known.points) - 1
    count = 2
    if intervals == 1:
        by_error = max(2, ceil(float(np.cbrt(error))))
        count = min(MOST_INTERVALS_AT_FIRST, most, by_error)
    if count < 2 or intervals * count > most:
        return []
    states = []
    for first, last in pairwise(known.points):
        states.append((first.factor, first.state))
        for i in range(1, count):
            x = first.factor + (last.factor - first.factor) * i / count
            state = solve_within(solver, known, path, x)
            if state is None:
                return []
            states.append((x, state))
    return states


class ReversalPoint(NamedTuple):
    """A state within a substep in which slips reverse."""

    load_factor: float  # Within the load step [1]
    state: SolverState
    sticking: tuple[Flags, ...]  # (m, g): By robot, holes that stuck just before
    reverses: tuple[Flags, ...]  # (m, g): By robot, holes whose slips reverse
    # Which frictional hole of all robots begins to slip here, (k,), and which tendon driven by displacement becomes
    # slack or taut, (c,), so that slip rates jump; at most one in all. None: rates go through zero
    slipping: Flags
    pulling: Flags
    input_rates: tuple[Array, ...]  # (m,): By robot, derivatives of the inputs by the load factor [N, m]
    load_rates: Array | None  # (reduced,): Of the residual, by loads and time; None where only inputs change


def reversal_points(solver: SubstepSolver, substep: SolvedSubstep) -> list[ReversalPoint]:
    """The reversals on which the end of a solved substep depends, by load factor.

    Raises
    ------
    StepFailed
        No equilibrium was found at one of them.
    """
    if substep.located is None:
        return []
    known, path, _ = substep.located
    numbering, holes = known.end.numbering, known.taut.holes
    ends = np.abs(numbering.at_frictional_holes(substep.state.mobilisation)) < 1.0
    return [_point(solver, substep, here) for here in path.reversals(ends[holes])]


def _point(solver: SubstepSolver, substep: SolvedSubstep, here: PathReversal) -> ReversalPoint:
    """The state at one reversal."""
    assert substep.located is not None
    known, path, _ = substep.located
    numbering, taut, k = known.end.numbering, known.taut, len(known.taut.holes)
    load_factor = known.load_factor(here.factor)
    found = solve_within(solver, known, path, here.factor)
    if found is None:
        # From the shape at the end of the substep.
        guess = with_path_unknowns(known.end, taut, path.at(here.factor)[0])
        found = _at_fixed_friction(solver, guess, load_factor)
    if found is None:
        message = (
            f"no equilibrium where slips reverse, at load factor {load_factor:.4f}, for the derivatives there"
        )
        raise StepFailed(message, load_factor, np.nan, known.start.state, 0)
    state, tension = found.state, found.driven_tension
    # A tendon that begins to pull has any tension at all, unlike a slack one.
    pulled = np.maximum(tension[taut.driven], np.finfo(float).tiny)
    tension[taut.driven] = np.where(here.side[k:] == 0.0, pulled, 0.0)
    sticks = np.abs(found.mobilisation) < 1.0
    sticks[taut.holes] = here.side[:k] == 0.0
    reverses, slipping = np.zeros_like(sticks), np.zeros_like(sticks)
    reverses[taut.holes], slipping[taut.holes] = here.reverses, here.arrives[:k]
    pulling = np.zeros(len(tension), dtype=bool)
    pulling[taut.driven] = here.arrives[k:]
    none = [np.zeros(own.shape, dtype=bool) for own in state.mobilisation]
    return ReversalPoint(
        load_factor,
        state._replace(
            base_tension=numbering.with_driven(state.base_tension, tension),
            friction=substep.located.history,
        ),
        numbering.with_frictional_holes(none, sticks),
        numbering.with_frictional_holes(none, reverses),
        slipping,
        pulling,
        *_rates(solver, known.span, found, load_factor),
    )


def _rates(
    solver: SubstepSolver, span: tuple[float, float], point: Equilibrium, load_factor: float
) -> tuple[tuple[Array, ...], Array | None]:
    """Derivatives of inputs and residual by the load factor, as differences to the ends of the substep."""
    ramp, system = solver.ramp, solver.system
    start, end = (ramp.apply(system, at) for at in span)
    inputs = tuple([(b - a) / (span[1] - span[0]) for a, b in zip(start.inputs, end.inputs, strict=True)])
    if not ramp.changes_beyond_inputs:
        return inputs, None
    far = max(span, key=lambda end: abs(end - load_factor))
    target = ramp.apply(system, far)
    unbalanced = system.unbalanced(point.state, target, point.forces, point.numbering)
    return inputs, unbalanced / (far - load_factor)
