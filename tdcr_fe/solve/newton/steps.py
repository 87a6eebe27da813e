"""One step of Newton's method: with a new tangent, with the last one (chord step), or of a damped motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import ElementChain
from tdcr_fe.solve.equations.factors import BorderedFactors
from tdcr_fe.solve.equations.linearization import Linearization
from tdcr_fe.solve.equations.numbering import Numbering
from tdcr_fe.solve.equations.residual import Residual
from tdcr_fe.solve.equations.state import SolverState
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.newton.friction_step import (
    FrictionCoupling,
    all_keep_slipping,
    friction_step,
    mobilisations,
    slip_residual,
)

Array = NDArray[np.float64]

#: A damped step turns no section by more than this; below a fifth of it the damping is reduced [rad].
DAMPED_TURN = 0.5
#: Largest damping, over the elastic force times the length: nothing moves any more [1].
MOST_DAMPING = 1e9


class NewtonStep(NamedTuple):
    """Change of all unknowns, and where it comes from.

    Attributes
    ----------
    change : ndarray, shape (total,)
    linearization : Linearization
        The linearisation used.
    friction_kept : bool
        Whether every hole continues to slip in its direction, so that a chord step may follow.
    damping : float
        Damping used [N m].
    chords : int
        Chord steps that may still follow with the same linearisation.
    slips : ndarray, shape (k,), or None
        Slip residual after the step at fixed friction, where friction is kept [m].
    """

    change: Array
    linearization: Linearization
    friction_kept: bool
    damping: float = 0.0
    chords: int = 1
    slips: Array | None = None


def full_step(
    system: SceneSystem,
    residual: Residual,
    numbering: Numbering,
    presliding: float,
    damping: float = 0.0,
) -> NewtonStep:
    """A step with a new tangent: at fixed friction where every hole keeps slipping, else a complementarity step."""
    linear = system.linearize(residual, numbering, damping)
    return step_with(linear, system, residual, numbering, presliding, damping)


def step_with(
    linear: Linearization,
    system: SceneSystem,
    residual: Residual,
    numbering: Numbering,
    presliding: float,
    damping: float = 0.0,
) -> NewtonStep:
    """A step with a given linearisation, of this or a near state."""
    linear, fixed = linear.complementarity_step(residual.unbalanced, residual.forces, residual.target.inputs)
    if not numbering.has_friction:
        return NewtonStep(fixed, linear, True, damping)
    state, forces = residual.state, residual.forces
    mobilised = mobilisations(numbering, state)
    slips = slip_residual(numbering, forces, state, fixed, presliding)
    if all_keep_slipping(mobilised, slips):
        return NewtonStep(_padded(fixed, numbering), linear, True, damping, slips=slips)
    coupling = FrictionCoupling.of(numbering, forces, system.layout.clamped, linear.slack)
    change = friction_step(coupling, linear.factorisation.solve, fixed, slips, mobilised, presliding)
    return NewtonStep(change, linear, False, damping)


def chord_step(before: NewtonStep, numbering: Numbering, residual: Residual) -> NewtonStep:
    """Chord step: with the tangent and frames of the previous iteration, at fixed friction."""
    change = before.linearization.step(residual.unbalanced, residual.forces, residual.target.inputs)
    return before._replace(change=_padded(change, numbering), chords=before.chords - 1)


def damped_step(
    system: SceneSystem,
    residual: Residual,
    numbering: Numbering,
    presliding: float,
    damping: float,
) -> NewtonStep:
    """A step of the damped motion, limited in rotation, never towards a saddle point, nor over a contact.

    The damping it returns is that for the next step.
    """
    nodes = 6 * system.layout.reduction.nodes
    scale = system.layout.scales.elastic_force * system.length
    least, most = 1e-6 * scale, MOST_DAMPING * scale
    limit = system.contact_motion_limit(residual.state)
    for _ in range(20):
        step = full_step(system, residual, numbering, presliding, damping)
        change = step.change[:nodes].reshape(-1, 6)
        turn = float(np.max(np.abs(change[:, 3:])))
        moved = float(np.max(np.linalg.norm(change[:, :3], axis=1)))
        climbs = _climbs(system, step.linearization, residual.state)
        if (turn <= DAMPED_TURN and moved <= limit and not climbs) or damping >= most:
            break
        damping = min(max(4.0 * damping, least), most)
    return step._replace(damping=0.2 * damping if turn < 0.2 * DAMPED_TURN else damping)


def _climbs(system: SceneSystem, linear: Linearization, state: SolverState) -> bool:
    """Whether a damped step goes towards a saddle point, so that its damping is too small.

    A robot with driven tendons may be held by them although it is unstable at fixed tensions; then both parts of the
    sign are negative. With other items in the scene the sign of a stable state is not known.
    """
    factors = linear.factorisation
    if isinstance(factors, BorderedFactors):
        return system.layout.reduction.other.size == 0 and factors.sign < 0
    return factors.sign * state.tangent_sign < 0


def _padded(fixed: Array, numbering: Numbering) -> Array:
    """A step at fixed friction as one of all unknowns."""
    step = np.zeros(numbering.total)
    step[: numbering.linear] = fixed
    return step


def advanced(
    system: SceneSystem, state: SolverState, step: NewtonStep, numbering: Numbering, max_turn: float
) -> tuple[SolverState, float]:
    """The state after a step, no element turning more than allowed; and the turn of the whole step [rad]."""
    chains: tuple[ElementChain, ...] = step.linearization.chains
    change = step.change
    move = system.layout.space.move(state.configuration, change, chains, max_turn)
    tension, mobilisation = state.base_tension, state.mobilisation
    for part in numbering.robots:
        i = part.robot
        if part.driven.size:
            new = tension[i].copy()
            pulled = np.maximum(new[part.driven] + move.fraction * change[part.tensions], 0.0)
            if move.fraction == 1.0:
                # Exactly: round-off in the tension of a slack tendon would count as a miss of its displacement.
                pulled[step.linearization.slack[i]] = 0.0
            new[part.driven] = pulled
            tension = (*tension[:i], new, *tension[i + 1 :])
        slipped = change[part.mobilisations]
        if slipped.any():
            new = mobilisation[i].copy()
            new[part.frictional] = np.clip(new[part.frictional] + move.fraction * slipped, -1.0, 1.0)
            mobilisation = (*mobilisation[:i], new, *mobilisation[i + 1 :])
    moved = SolverState(
        move.configuration,
        tension,
        mobilisation,
        state.friction,
        state.prescribed,
        state.loads,
        state.time,
        state.tangent_sign,
    )
    return moved, move.turn
