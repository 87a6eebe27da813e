"""Where slips reverse within a solved substep: the states there, with which derivatives along the path go on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.friction_path.known_states import Span
from tdcr_fe.solve.friction_path.path import PathReversal
from tdcr_fe.solve.friction_path.response import Equilibrium
from tdcr_fe.solve.load_steps.load_path import SolvedSubstep, StepFailed
from tdcr_fe.solve.load_steps.states_within import solve_from_end, solve_within
from tdcr_fe.solve.load_steps.substep import SubstepSolver

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


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
    load_factor = known.span.load_factor(here.factor)
    found = solve_within(solver, known, path, here.factor) or solve_from_end(solver, known, path, here.factor)
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
    arrives = np.arange(len(here.side)) == here.arrives
    reverses, slipping = np.zeros_like(sticks), np.zeros_like(sticks)
    reverses[taut.holes], slipping[taut.holes] = here.reverses, arrives[:k]
    pulling = np.zeros(len(tension), dtype=bool)
    pulling[taut.driven] = arrives[k:]
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
    solver: SubstepSolver, span: Span, point: Equilibrium, load_factor: float
) -> tuple[tuple[Array, ...], Array | None]:
    """Derivatives of inputs and residual by the load factor, as differences to the ends of the substep."""
    ramp, system = solver.ramp, solver.system
    start, end = (ramp.apply(system, at) for at in span)
    inputs = tuple([(b - a) / (span.end - span.start) for a, b in zip(start.inputs, end.inputs, strict=True)])
    if not ramp.changes_beyond_inputs:
        return inputs, None
    far = max(span, key=lambda end: abs(end - load_factor))
    target = ramp.apply(system, far)
    unbalanced = system.unbalanced(point.state, target, point.forces, point.numbering)
    return inputs, unbalanced / (far - load_factor)
