"""One step of Newton's method, or of a damped motion; friction in it is a small complementarity problem.

Equilibrium is linear in a step, friction is not. With everything but the mobilisations eliminated, their conditions
are a box-constrained linear complementarity problem. Where every hole continues to slip in its direction, as is
usual during loading, the step at fixed friction already satisfies these conditions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array, Flags, Index
from tdcr_fe.elements.coefficients import MAX_ITERATIONS
from tdcr_fe.elements.complementarity import solve_box
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.friction import LEAST_PART, CoefficientCurve
from tdcr_fe.elements.hysteresis import ACCEPTED, Hysteresis
from tdcr_fe.model.loading import SolverSettings
from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.equations.kernel import Residual
from tdcr_fe.solve.equations.layout import Numbering
from tdcr_fe.solve.equations.linearization import BorderedFactors, Linearization, joined_slips
from tdcr_fe.solve.equations.system import SceneSystem

#: Largest damping, over the elastic force times the length: nothing moves any more [1].
MOST_DAMPING = 1e9


class NewtonProblem(NamedTuple):
    """What stays the same in one Newton solve."""

    system: SceneSystem
    numbering: Numbering
    settings: SolverSettings
    softening: float  # Factor on the presliding distance [1]
    damped: bool  # Whether the motion of a heavily damped robot is followed


def slip_changes(
    numbering: Numbering, forces: Sequence[TendonForces], step: Array, inputs: Sequence[Array] | None = None
) -> list[Array]:
    """By robot, linear changes of the slips with a step at fixed friction [m], shape (m, g).

    Parameters
    ----------
    numbering
        Numbering of the unknowns.
    forces
        By robot, in the present configuration.
    step
        At fixed friction, shape (linear,).
    inputs
        By robot, changes of the inputs in the step, shape (m,); None where there are none.
    """
    found = []
    for part in numbering.robots:
        base = np.zeros(len(part.frictional)) if inputs is None else inputs[part.robot].copy()
        base[part.driven] = step[part.tensions]
        found.append(forces[part.robot].slip_change(step[part.nodes], base))
    return found


def all_keep_slipping(mobilisation: Array, residual: Array) -> bool:
    """Whether every hole slips, and continues in the same direction in a step at fixed friction."""
    return bool(np.minimum(np.abs(mobilisation) - 1.0, mobilisation * residual).min() >= 0.0)


class FrictionCoupling(NamedTuple):
    """Derivatives between the unknowns of equilibrium and the mobilisations."""

    columns: Array  # (linear, k): Residual by the mobilisations
    rows: Array  # (k, linear): Slips by the unknowns of equilibrium
    own: Array  # (k, k): Slips by the mobilisations [m]

    @classmethod
    def of(cls, numbering: Numbering, forces: Sequence[TendonForces], slack: Flags) -> FrictionCoupling:
        """Assemble the derivatives of all robots.

        Parameters
        ----------
        numbering, forces
            As in `slip_changes`.
        slack
            Which of all tendons with prescribed displacement are slack, see `Linearization.slack`.
        """
        slips, first = joined_slips(numbering, forces, holes=True), numbering.linear - numbering.reduced
        by_base, to_base = slips.matrix[:first, first:], slips.matrix[first:, :first]
        by_base[slack] = 0.0
        columns = np.concatenate((slips.columns[:, first:], by_base))
        rows = np.concatenate((slips.rows[first:], to_base), axis=1)
        return cls(columns, rows, slips.matrix[first:, first:])

    def response(
        self, solve: Callable[[Array], Array], which: Index, flexibility: Array
    ) -> tuple[Array, Array]:
        """Response of the linearised equilibrium to some of the mobilisations.

        Parameters
        ----------
        solve
            Solves the linearised equilibrium at fixed friction for several right sides, shape (linear, k').
        which
            Numbers of the mobilisations, shape (k',).
        flexibility
            Slopes of the slips by these mobilisations [m], shape (k,).

        Returns
        -------
        columns : ndarray, shape (linear, k')
            Change of the unknowns of equilibrium by the mobilisations.
        matrix : ndarray, shape (k, k')
            Flexibility times identity, minus the derivative of the slips by the mobilisations [m].
        """
        columns = -solve(np.asfortranarray(self.columns[:, which]))
        matrix = -(self.rows @ columns) - self.own[:, which]
        matrix[which, np.arange(len(which))] += flexibility[which]
        return columns, matrix


class NewtonStep(NamedTuple):
    """Change of all unknowns, and where it comes from."""

    change: Array  # (total,)
    linearization: Linearization  # The linearisation used


def full_step(problem: NewtonProblem, residual: Residual, damping: float = 0.0) -> NewtonStep:
    """A step with a new tangent: at fixed friction where every hole keeps slipping, else a complementarity step."""
    numbering = problem.numbering
    linear = problem.system.linearize(residual, numbering, damping)
    linear, fixed = linear.complementarity_step(residual.unbalanced, residual.forces, residual.target.inputs)
    if not numbering.has_friction:
        return NewtonStep(fixed, linear)
    state, forces, pick = residual.state, residual.forces, numbering.at_frictional_holes
    laws = [own.model.law.hysteresis.softened(problem.softening) for own in forces]
    mobilised, changes = pick(state.mobilisation), slip_changes(numbering, forces, fixed)
    ahead = [own.field.slip + change for own, change in zip(forces, changes, strict=True)]
    slips, curves = pick(ahead), _coefficient_curves(residual, ahead)
    by_robot = list(zip(laws, state.mobilisation, state.friction, strict=True))
    travelled = pick([law.slip_of(s, before) for law, s, before in by_robot])
    excess = slips - pick([before.slip for before in state.friction]) - travelled
    if not curves and all_keep_slipping(mobilised, excess):
        unchanged = np.zeros(numbering.total - numbering.linear)
        return NewtonStep(np.append(fixed, unchanged), linear)
    coupling = FrictionCoupling.of(numbering, forces, linear.slack)
    flexibility = pick([law.flexibility(s, np.zeros_like(s)) for law, s, _ in by_robot])
    columns, matrix = coupling.response(linear.factorisation.solve, np.arange(len(mobilised)), flexibility)
    linear_laws, new = all(law.linear for law in laws), mobilised
    if linear_laws:
        new, _ = solve_box(matrix, excess + matrix @ mobilised, mobilised)
    acting = new
    if curves or not linear_laws:
        by_mobilisation = np.diag(flexibility) - matrix
        start = slips + by_mobilisation @ (new - mobilised)
        new, acting = on_curves(numbering, laws, state, slips, by_mobilisation, start, curves)
    change = fixed + columns @ (acting - mobilised)
    return NewtonStep(np.concatenate((change, new - mobilised)), linear)


def _coefficient_curves(residual: Residual, slips: Sequence[Array]) -> list[CoefficientCurve]:
    """By robot, coefficients as functions of the slips; empty where they are linear up to these slips."""
    by_robot = list(zip(residual.forces, residual.state.friction, slips, strict=True))
    if not any(own.model.law.varies and own.field.time > before.time for own, before, _ in by_robot):
        return []
    curves, bent = [], False
    for own, before, slip in by_robot:
        curve = own.model.law.coefficient_curves(own.field, own.measured.shape.angles, before)
        bent = bent or bool((curve(slip, own.field.mobilisation)[0] != 1.0).any())
        curves.append(curve)
    return curves if bent else []


def on_curves(
    numbering: Numbering,
    laws: Sequence[Hysteresis],
    state: SolverState,
    fixed: Array,
    by_mobilisation: Array,
    start: Array,
    curves: Sequence[CoefficientCurve] = (),
) -> tuple[Array, Array]:
    """Mobilisations on their curves, where the slips change linearly with them.

    Curves are bent where the slip turns, and where coefficients depend on slip rates: with straight lines in place of
    them the iteration often returned to where it had been. Newton's method in the slips, its steps halved where they
    increase the error.

    Parameters
    ----------
    numbering
        Numbering of the unknowns.
    laws
        By robot, softened.
    state
        Present mobilisations, and the history.
    fixed
        Slips at the present mobilisations [m], shape (k,).
    by_mobilisation
        Derivatives of the slips by the mobilisations with everything else in equilibrium [m], shape (k, k).
    start
        Slips to begin with [m], shape (k,).
    curves
        By robot, see `TendonLaw.coefficient_curves`; empty where coefficients do not depend on slip rates.

    Returns
    -------
    mobilisation : ndarray, shape (k,)
    acting : ndarray, shape (k,)
        These times the ratios of the coefficients: mobilisations that act alike at the present coefficients.
    """
    present = numbering.at_frictional_holes(state.mobilisation)
    smallest = ACCEPTED * min(law.presliding for law in laws)

    def curve(slips: Array) -> tuple[Array, Array, Array, Array]:
        """Mobilisations of slips, those that act, their slopes [1/m], and the slips less those with them [m]."""
        found, acting, slopes = [], [], []
        own = numbering.with_frictional_holes([before.slip for before in state.friction], slips)
        for i, (law, slip, before) in enumerate(zip(laws, own, state.friction, strict=True)):
            unlimited = law.trial(slip, before)
            mobilised = np.clip(unlimited, -1.0, 1.0)
            flexibility = law.flexibility(mobilised, np.sign(slip - before.slip))
            slope = np.where(np.abs(unlimited) < 1.0, 1.0 / flexibility, 0.0)
            ratio, bend = curves[i](slip, mobilised) if curves else (1.0, 0.0)
            found.append(mobilised)
            acting.append(mobilised * ratio)
            slopes.append(slope * ratio + mobilised * bend)
        acts = numbering.at_frictional_holes(acting)
        error = slips - fixed - by_mobilisation @ (acts - present)
        return numbering.at_frictional_holes(found), acts, numbering.at_frictional_holes(slopes), error

    slips = start
    mobilised, acts, slopes, error = curve(slips)
    for _ in range(MAX_ITERATIONS):
        size = np.linalg.norm(error)
        if not size > smallest:  # ends with nan, too
            break
        change = np.linalg.solve(np.eye(len(slips)) - by_mobilisation * slopes, error)
        part = 1.0
        while True:
            ahead = slips - part * change
            mobilised, acts, slopes, error = curve(ahead)
            if np.linalg.norm(error) < size or part < LEAST_PART:
                break
            part *= 0.5
        slips = ahead
        if curves and part < LEAST_PART:
            # Where a coefficient falls with the slip rate there may be none.
            break
    return mobilised, acts


def damped_step(problem: NewtonProblem, residual: Residual, damping: float) -> tuple[NewtonStep, float]:
    """A step of the damped motion, limited in rotation, never towards a saddle point, nor over a contact.

    Also the damping for the next step [N m]: less, where no section turned by a fifth of what it may.
    """
    system, max_turn = problem.system, problem.settings.max_turn
    nodes = 6 * system.layout.reduction.nodes
    scale = system.layout.scales.elastic_force * system.length
    least, most = 1e-6 * scale, MOST_DAMPING * scale
    limit = system.contact_at(residual.state).motion_limit()
    while True:
        step = full_step(problem, residual, damping)
        change = step.change[:nodes].reshape(-1, 6)
        turn = float(np.max(np.abs(change[:, 3:])))
        moved = float(np.max(np.linalg.norm(change[:, :3], axis=1)))
        climbs = _climbs(system, step.linearization, residual.state)
        if (turn <= max_turn and moved <= limit and not climbs) or damping >= most:
            break
        damping = min(max(4.0 * damping, least), most)
    return step, 0.2 * damping if turn < 0.2 * max_turn else damping


def _climbs(system: SceneSystem, linear: Linearization, state: SolverState) -> bool:
    """Whether a damped step goes towards a saddle point, so that its damping is too small.

    A robot with driven tendons may be held by them although it is unstable at fixed tensions; then both parts of the
    sign are negative. With other items in the scene the sign of a stable state is not known.
    """
    factors = linear.factorisation
    if isinstance(factors, BorderedFactors):
        return system.layout.reduction.other.size == 0 and factors.sign < 0
    return factors.sign * state.tangent_sign < 0


def advanced(problem: NewtonProblem, state: SolverState, step: NewtonStep) -> SolverState:
    """The state after a step, no element turning more than allowed."""
    numbering, space, most = problem.numbering, problem.system.layout.space, problem.settings.max_turn
    chains, change = step.linearization.chains, step.change
    configuration, fraction = space.move(state.configuration, change, chains, most)
    tension, mobilisation = state.base_tension, state.mobilisation
    if numbering.any_driven:
        pulled = numbering.at_driven(tension) + fraction * change[numbering.reduced : numbering.linear]
        pulled = np.maximum(pulled, 0.0)
        if fraction == 1.0:
            # Exactly: round-off in the tension of a slack tendon would count as a miss of its displacement.
            pulled[step.linearization.slack] = 0.0
        tension = numbering.with_driven(tension, pulled)
    slipped = change[numbering.linear :]
    if slipped.any():
        mobilised = numbering.at_frictional_holes(mobilisation) + fraction * slipped
        mobilisation = numbering.with_frictional_holes(mobilisation, np.clip(mobilised, -1.0, 1.0))
    return state._replace(configuration=configuration, base_tension=tension, mobilisation=mobilisation)
