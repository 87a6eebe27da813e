"""How a solved robot moves with its inputs, forces on its nodes and its history of friction: `Response`.

The history of a hole that the next step sees is its plastic slip ``p = u - delta s``: the slip ``u`` less the
presliding distance ``delta`` times the mobilisation ``s``. A hole that sticks keeps it, and a hole that slips leaves it
behind itself at full friction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.model.observed_step import ObservedChange
from tdcr_fe.solve.equations.configuration import SolverState, Target
from tdcr_fe.solve.sensitivities.linear_response import AT_BOUND, Disturbance, SolvedPoint
from tdcr_fe.solve.simulation import Simulation

Array = NDArray[np.float64]

#: Holes that stick with a probability less than this slip [1].
LEAST_STICKING = 1e-3


def plastic_slips(simulation: Simulation, state: SolverState) -> Array:
    """Of all holes with friction at the end of a solved step [m], shape (k,)."""
    law, friction = simulation.handle.actuation.law, state.friction[0]
    return (friction.slip - law.hysteresis.presliding * friction.mobilisation)[law.frictional]


def with_plastic_slips(simulation: Simulation, state: SolverState, change: Array) -> SolverState:
    """A state whose history has other plastic slips, by a change of shape (k,) [m]."""
    own = state.friction[0]
    slip = own.slip.copy()
    slip[simulation.handle.actuation.law.frictional] += change
    return state._replace(friction=(replace(own, slip=slip),))


def sticking_within(trial: Array, spread: Array) -> tuple[Array, Array]:
    """Least-squares line through the mobilisation of holes as it follows an uncertain slip, which is normal.

    Parameters
    ----------
    trial
        Mean of what the mobilisation would be if it had no bounds, shape (k,).
    spread
        Its standard deviation, shape (k,).

    Returns
    -------
    slope, left : ndarray, shape (k,)
        Slope, which is the probability that the hole sticks, or zero where that is next to nothing, and standard
        deviation of what the line misses [1].
    """
    spread = np.maximum(spread, 1e-9)
    low, high = (-1.0 - trial) / spread, (1.0 - trial) / spread
    below, above = ndtr(low), ndtr(-high)
    at_low, at_high = (np.exp(-0.5 * x**2) / math.sqrt(2.0 * math.pi) for x in (low, high))
    slope = ndtr(high) - below
    mean = above - below + trial * slope + spread * (at_low - at_high)
    square = above + below + (trial**2 + spread**2) * slope
    square += 2.0 * trial * spread * (at_low - at_high) + spread**2 * (low * at_low - high * at_high)
    left = np.sqrt(np.maximum(square - mean**2 - (slope * spread) ** 2, 0.0))
    return np.where(slope > LEAST_STICKING, slope, 0.0), left


@dataclass(frozen=True, eq=False)
class Response(ObservedChange):
    """Derivatives of a solved state, also of its history of friction; parameters are the last axis.

    These are the inputs of the tendons (m), the six components of a load on each of some nodes, and the plastic slips
    of the holes at the beginning of the step (k).
    """

    plastic_slips: Array  # (k, P): At the end of the step [m]
    mobilisations: Array  # (k, P): as `plastic_slips` [1]

    @classmethod
    def of(cls, simulation: Simulation, loaded: NDArray[np.int_], sticking: Array | None = None) -> Response:
        """Of the last solved state.

        Parameters
        ----------
        simulation
            In that state.
        loaded
            Nodes on which loads may act, shape (q,).
        sticking
            How much of the slip of each hole its mobilisation follows, shape (k,) [1]; None is 1 where it sticks.
        """
        system, state, law = simulation.system, simulation.state, simulation.handle.actuation.law
        target, mobilisation = Target(state.inputs, state.loads, state.time), state.mobilisation[0]
        share = np.where(np.abs(mobilisation) < 1.0 - AT_BOUND, 1.0, 0.0)
        if sticking is not None:
            share[law.frictional] = sticking
        sticks = share > 0.0
        solved = SolvedPoint.of(
            system, state, target, sticking=(sticks,), linearization=simulation.linearization()
        )
        flexibility = solved.flexibility[0] / np.where(sticks, share, 1.0)
        solved = replace(solved, flexibility=(flexibility,))
        changes = solved.respond((_disturbance(solved.forces[0], state, loaded),))
        tendons, (positions, rotations) = changes.tendons[0], state.configuration.poses[0]
        moved = changes.unknowns[solved.numbering.robots[0].nodes].reshape(len(positions), 2, 3, -1)
        moved = rotations[:, None] @ moved
        displacements, m = tendons.released.sum(axis=1), len(law.frictional)
        winds = simulation.handle.actuation.drives.winds
        displacements[winds] = np.eye(m, displacements.shape[1])[winds]
        ends = [len(x) - 1 for x in simulation.handle.tensions().values()]
        mobilisations = tendons.mobilisation[law.frictional]
        slips = (law.slip_operator @ tendons.released)[law.frictional]
        return cls(
            moved[:, 0],
            moved[:, 1],
            displacements,
            tendons.base_tension,
            tendons.tension[np.arange(m), ends],
            np.zeros((len(positions), displacements.shape[1])),  # nodes stay where they are on the backbone
            slips - law.hysteresis.presliding * mobilisations,
            mobilisations,
        )

    def combined(self, weights: Array) -> Response:
        """By other parameters, of which these are linear functions: ``weights`` has shape (P, Q)."""
        return Response(*(x @ weights for x in vars(self).values()))


def _disturbance(own: TendonForces, state: SolverState, loaded: NDArray[np.int_]) -> Disturbance:
    """Unit inputs, unit forces and moments in the world on nodes, and unit plastic slips before the step."""
    frictional = own.model.law.frictional
    m, k = len(frictional), int(frictional.sum())
    first = m + 6 * len(loaded)
    found = Disturbance.none(own, first + k)
    found.inputs[:, :m] = np.eye(m)
    rotations = state.configuration.poses[0][1]
    for j, node in enumerate(loaded):
        turn, start = rotations[node].T, m + 6 * j
        found.wrenches[6 * node : 6 * node + 3, start : start + 3] = turn
        found.wrenches[6 * node + 3 : 6 * node + 6, start + 3 : start + 6] = turn
    found.slip[(*np.nonzero(frictional), first + np.arange(k))] = 1.0
    return found
