"""How a solved robot moves with inputs, forces on its nodes, friction history and parameters: `Response`.

The history of a hole that the next step sees is its plastic slip ``p = u - delta s``: the slip ``u`` less the
presliding distance ``delta`` times the mobilisation ``s``. A hole that sticks keeps it, and a hole that slips leaves it
behind itself at full friction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from tdcr_fe.effects import Observation
from tdcr_fe.elements import Array, Flags, Index
from tdcr_fe.elements.backbone import BEAM_TO_SECTION
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.hysteresis import ACCEPTED
from tdcr_fe.model.observed_step import ObservedChange, ObservedStep
from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.equations.linearization import BorderedFactors
from tdcr_fe.solve.sensitivities.linear_response import Disturbance, SolvedPoint
from tdcr_fe.solve.sensitivities.robot_model import ExplicitDerivatives, Inherited
from tdcr_fe.solve.simulation import Simulation

#: Holes that stick, or tendons that are taut, with a probability less than this slip or are slack [1].
LEAST_INSIDE = 1e-3


def plastic_slips(simulation: Simulation, state: SolverState) -> Array:
    """Plastic slips of all holes with friction at the end of a solved step [m], shape (k,)."""
    law, friction = simulation.handle.actuation.law, state.friction[0]
    return (friction.slip - law.hysteresis.presliding * friction.mobilisation)[law.frictional]


def with_plastic_slips(simulation: Simulation, state: SolverState, change: Array) -> SolverState:
    """A state whose history has other plastic slips, by a change of shape (k,) [m]."""
    own = state.friction[0]
    slip = own.slip.copy()
    slip[simulation.handle.actuation.law.frictional] += change
    return state._replace(friction=(replace(own, slip=slip),))


def within_bounds(trial: Array, spread: Array, low: float, high: float) -> tuple[Array, Array]:
    """Least-squares line through what is cut off at bounds, as it follows an uncertain value, which is normal.

    Mobilisations of holes are cut off at full friction, and tensions of tendons at zero.

    Parameters
    ----------
    trial
        Mean of what it would be if it had no bounds, shape (k,).
    spread
        Its standard deviation, shape (k,).
    low, high
        Bounds; they may be infinite.

    Returns
    -------
    slope, left : ndarray, shape (k,)
        Slope, which is the probability to be inside (the hole sticks, the tendon is taut), or zero where that is next
        to nothing, and standard deviation of what the line misses.
    """
    spread = np.maximum(spread, 1e-9)
    a, b = (((x - trial) / spread).clip(-40.0, 40.0) for x in (low, high))
    below, above = ndtr(a), ndtr(-b)
    at_a, at_b = (np.exp(-0.5 * x**2) / math.sqrt(2.0 * math.pi) for x in (a, b))
    slope = ndtr(b) - below
    # In standard deviations from the trial.
    mean = a * below + b * above + at_a - at_b
    square = a**2 * below + b**2 * above + slope + a * at_a - b * at_b
    left = spread * np.sqrt(np.maximum(square - mean**2 - slope**2, 0.0))
    return np.where(slope > LEAST_INSIDE, slope, 0.0), left


def tensions_without_bounds(simulation: Simulation) -> tuple[Array, Array]:
    """Tensions at the base of the last solved state if tendons that are wound could push, and their compliances.

    The compliance is the change of a tendon's displacement by its tension, while the others stay taut or slack.

    Returns
    -------
    tensions : ndarray, shape (m,)
        [N].
    compliances : ndarray, shape (m,)
        [m/N]; where the tension is given, one of its inputs [1].
    """
    state, linear = simulation.state, simulation.linearization()
    tensions, compliances = state.base_tension[0].copy(), np.ones(len(state.base_tension[0]))
    if isinstance(linear.factorisation, BorderedFactors):
        winds = simulation.handle.actuation.drives.winds
        compliances[winds] = linear.factorisation.compliances()
        gaps = simulation.system.forces(state, state.time)[0].field.base_slip - state.inputs[0]
        slack = winds & (tensions <= 0.0)
        tensions[slack] = -gaps[slack] / compliances[slack]
    return tensions, compliances


def at_anchors(simulation: Simulation, tensions: Array) -> Array:
    """From tensions of all segments, shape (m, n, ...), those at the anchors, shape (m, ...)."""
    exists = simulation.handle.actuation.law.parameters.mask
    return tensions[np.arange(len(exists)), exists.sum(axis=1) - 1]


def observed(simulation: Simulation, observation: Observation, curvatures: bool = True) -> ObservedStep:
    """The last solved state as an instrument sees it; for ``curvatures`` see `Response.of`."""
    handle, configuration, rates = simulation.handle, simulation.state.configuration, None
    (positions, rotations), own = configuration.poses[0], handle.actuation.current_forces()
    if curvatures:
        strained = own.model.strain_state(configuration.twists[0], own.base_tension)
        rates = strained.curvature_rates() @ BEAM_TO_SECTION.T
    shape = handle.arc_lengths, positions, rotations @ BEAM_TO_SECTION.T
    tensions = simulation.displacement, own.base_tension, at_anchors(simulation, own.field.tension)
    return ObservedStep(*shape, *tensions, handle.robot.tendon_names, observation, curvature_rates=rates)


@dataclass(frozen=True, eq=False)
class Response(ObservedChange):
    """Derivatives of a solved state, also of its history of friction; parameters are the last axis.

    These are the inputs of the tendons (m), the six components of a load on each of some nodes, the plastic slips at
    the beginning of the step of the holes that stick (on those that slip nothing depends), and parameters of the robot
    (q).
    """

    plastic_slips: Array  # (k, P): At the end of the step [m]
    mobilisations: Array  # (k, P): as `plastic_slips` [1]
    # (m, P): By how much more tendons reach than they are wound, zero where they are taut [m]; less tension [N] where
    # that is given
    gaps: Array
    sticking: Flags  # (k,): Holes that stick

    @classmethod
    def of(
        cls,
        simulation: Simulation,
        loaded: Index,
        explicit: ExplicitDerivatives,
        sticking: Array | None = None,
        giving: Array | None = None,
        curvatures: bool = True,
    ) -> Response:
        """Response of the last solved state.

        Parameters
        ----------
        simulation
            In that state.
        loaded
            Nodes on which loads may act.
        explicit
            Derivatives by the parameters of the robot while its nodes stay where they are.
        sticking
            How much of the slip of each hole its mobilisation follows, shape (k,) [1]; None is 1 where it sticks.
        giving
            How much each tendon that is wound gives way at its base, shape (m,) [m/N]: infinitely where it is slack;
            None is nothing where it is taut.
        curvatures
            Whether `curvature_rates` are needed; else they are zero, which saves a tenth of the time of a frame.
        """
        system, state, law = simulation.system, simulation.state, simulation.handle.actuation.law
        share = np.where(np.abs(state.mobilisation[0]) < 1.0 - ACCEPTED, 1.0, 0.0)
        if sticking is not None:
            share[law.frictional] = sticking
        sticks = law.frictional & (share > 0.0)
        linear, winds = simulation.linearization(), simulation.handle.actuation.drives.winds
        if giving is not None and isinstance(linear.factorisation, BorderedFactors):
            linear = linear._replace(factorisation=linear.factorisation.giving_way(giving[winds]))
        solved = SolvedPoint.of(system, state, state.target, sticking=(sticks,), linearization=linear)
        solved = replace(solved, flexibility=(solved.flexibility[0] / np.where(sticks, share, 1.0),))
        changes = solved.respond((_disturbance(solved.forces[0], state, loaded, sticks, explicit),))
        tendons, (positions, rotations) = changes.tendons[0], state.configuration.poses[0]
        in_sections = changes.unknowns[solved.numbering.robots[0].nodes].reshape(len(positions), 2, 3, -1)
        moved = rotations[:, None] @ in_sections
        chain, size = state.configuration.chains[0], changes.unknowns.shape[-1]
        first = size - explicit.arc_lengths.shape[1]  # of the parameters of the robot
        rates = np.zeros((len(chain.twists), 2, 3, size))
        if curvatures:
            twists = chain.changes(in_sections.reshape(len(positions), 6, size))
            at, tension = (chain.twists, state.base_tension[0]), tendons.base_tension
            rates = solved.forces[0].model.curvature_rates_change(*at, twists, tension)
            own = explicit.curvature_rates(*at, twists[..., first:], tension[:, first:], state.time)
            rates = BEAM_TO_SECTION @ np.concatenate((rates[..., :first], own), axis=-1)
        displacements, m = tendons.released.sum(axis=1), len(law.frictional)
        wound = np.eye(m, displacements.shape[1])
        gaps = np.where(winds[:, None], displacements, 0.0) - wound
        displacements[winds] = wound[winds]
        mobilisations = tendons.mobilisation[law.frictional]
        slips = tendons.slip[law.frictional]
        return cls(
            np.pad(explicit.arc_lengths, ((0, 0), (first, 0))),
            moved[:, 0],
            moved[:, 1],
            displacements,
            tendons.base_tension,
            at_anchors(simulation, tendons.tension),
            slips - law.hysteresis.presliding * mobilisations,
            mobilisations,
            gaps,
            sticks[law.frictional],
            curvature_rates=rates,
        )

    def combined(self, weights: Array) -> Response:
        """By other parameters, of which these are linear functions: ``weights`` has shape (P, Q)."""
        changes = {name: x @ weights for name, x in vars(self).items() if name != "sticking"}
        return replace(self, **changes)


def _disturbance(
    own: TendonForces, state: SolverState, loaded: Index, sticks: Flags, explicit: ExplicitDerivatives
) -> Disturbance:
    """Unit inputs, forces and moments in the world on nodes, plastic slips before the step, and parameters."""
    m, k = len(sticks), int(sticks.sum())
    first = m + 6 * len(loaded)
    found = Disturbance.none(own, first + k + explicit.arc_lengths.shape[1])
    found.inputs[:, :m] = np.eye(m)
    for j, node in enumerate(loaded):
        turn, start = own.measured.poses[1][node].T, m + 6 * j
        found.wrenches[6 * node : 6 * node + 3, start : start + 3] = turn
        found.wrenches[6 * node + 3 : 6 * node + 6, start + 3 : start + 6] = turn
    found.slip[(*np.nonzero(sticks), first + np.arange(k))] = 1.0
    if count := explicit.arc_lengths.shape[1]:
        history, none = state.friction[0], np.zeros((*sticks.shape, count))
        rate = np.zeros(sticks.shape) if history.slip_rate is None else history.slip_rate
        still = Inherited(none, none, np.zeros(count), np.zeros(count))
        values = explicit.at(own, state.mobilisation[0], rate, (history.time, state.time), still)
        found.wrenches[:, first + k :] = values.wrenches.reshape(-1, count)
        found.tension[..., first + k :] = values.tension
        found.released[..., first + k :] = values.released
    return found
