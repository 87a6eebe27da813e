"""How a solved robot moves with its inputs, forces on its nodes and its history of friction: `Response`.

The history of a hole that the next step sees is its plastic slip ``p = u - delta s``: the slip ``u`` less the
presliding distance ``delta`` times the mobilisation ``s``. A hole that sticks keeps it, and a hole that slips leaves it
behind itself at full friction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.model.observed_step import ObservedChange
from tdcr_fe.solve.equations.configuration import SolverState, Target
from tdcr_fe.solve.sensitivities.linear_response import AT_BOUND, Disturbance, SolvedPoint
from tdcr_fe.solve.simulation import Simulation

Array = NDArray[np.float64]


def plastic_slips(simulation: Simulation, state: SolverState) -> Array:
    """Of all holes with friction at the end of a solved step [m], shape (k,)."""
    law, friction = simulation.handle.actuation.law, state.friction[0]
    return (friction.slip - law.hysteresis.presliding * friction.mobilisation)[law.frictional]


def with_plastic_slips(simulation: Simulation, state: SolverState, change: Array) -> SolverState:
    """A state whose history has other plastic slips, by a change of shape (k,) [m]."""
    if not change.size:
        return state
    own = state.friction[0]
    slip = own.slip.copy()
    slip[simulation.handle.actuation.law.frictional] += change
    return state._replace(friction=(replace(own, slip=slip),))


@dataclass(frozen=True, eq=False)
class Response:
    """Derivatives of a solved state; parameters are the last axis.

    These are the inputs of the tendons (m), the six components of a load on each of some nodes, and the plastic slips
    of the holes at the beginning of the step (k).
    """

    nodes: Array  # (n, 3, P): Positions of the nodes in the world [m]
    rotations: Array  # (n, 3, P): World rotation vectors [rad]
    displacements: Array  # (m, P): At the base plate [m]
    base_tensions: Array  # (m, P): [N]
    distal_tensions: Array  # (m, P): [N]
    plastic_slips: Array  # (k, P): At the end of the step [m]
    mobilisations: Array  # (k, P): as `plastic_slips` [1]

    @classmethod
    def of(cls, simulation: Simulation, loaded: NDArray[np.int_]) -> Response:
        """Of the last solved state; ``loaded``: nodes on which loads may act, shape (q,)."""
        system, state = simulation.system, simulation.state
        presliding = simulation.handle.actuation.law.hysteresis.presliding
        target = Target(state.inputs, state.loads, state.time)
        solved = SolvedPoint.of(system, state, target, linearization=simulation.linearization())
        # The friction is a parameter at first; which holes stick is taken into account below.
        solved = replace(solved, sticking=tuple(np.zeros_like(x) for x in solved.sticking))
        own = solved.forces[0]
        frictional = own.model.law.frictional
        m, k = len(frictional), int(frictional.sum())
        changes = solved.respond((_disturbance(own, state, loaded),))
        tendons = changes.tendons[0]
        slips = (own.model.law.slip_operator @ tendons.released)[frictional]
        poses = state.configuration.poses[0]
        moved = poses[1][:, None] @ changes.unknowns[solved.numbering.robots[0].nodes].reshape(
            len(poses[0]), 2, 3, -1
        )
        displacements = tendons.released.sum(axis=1)
        by_displacement = simulation.handle.actuation.drives.winds
        displacements[by_displacement] = np.eye(m, displacements.shape[1])[by_displacement]
        ends = [len(x) - 1 for x in simulation.handle.tensions().values()]
        found = cls(
            moved[:, 0],
            moved[:, 1],
            displacements,
            tendons.base_tension,
            tendons.tension[np.arange(m), ends],
            slips,
            np.eye(k, slips.shape[1], slips.shape[1] - k),
        )
        if not k:
            return found
        mobilisation = state.mobilisation[0][frictional]
        return found._with_holes(np.abs(mobilisation) < 1.0 - AT_BOUND, presliding)

    def _with_holes(self, sticks: NDArray[np.bool_], presliding: float) -> Response:
        """By the plastic slips in place of the mobilisations, which are the last k parameters; holes keep sticking."""
        k = len(sticks)
        first, count = self.nodes.shape[-1] - k, int(sticks.sum())
        by_friction = self.plastic_slips[:, first:]
        # Slips of sticking holes: slip = plastic slip + presliding * mobilisation.
        right = self.plastic_slips[sticks].copy()
        right[:, first:] = -np.eye(k)[sticks]
        matrix = by_friction[np.ix_(sticks, sticks)] - presliding * np.eye(count)
        mobilisations = np.zeros((k, first + k))
        mobilisations[sticks] = -np.linalg.solve(matrix, right)

        def held(values: Array) -> Array:
            at_fixed = values.copy()
            at_fixed[..., first:] = 0.0
            return at_fixed + values[..., first:] @ mobilisations

        found = Response(*(held(x) for x in vars(self).values()))
        return replace(found, plastic_slips=found.plastic_slips - presliding * mobilisations)

    def combined(self, weights: Array) -> Response:
        """By other parameters, of which these are linear functions: ``weights`` has shape (P, Q)."""
        return Response(*(x @ weights for x in vars(self).values()))

    @property
    def observed(self) -> ObservedChange:
        """As the channels of measurement need it."""
        still = np.zeros((len(self.nodes), self.nodes.shape[-1]))
        return ObservedChange(
            self.nodes, self.rotations, self.displacements, self.base_tensions, self.distal_tensions, still
        )


def _disturbance(own: TendonForces, state: SolverState, loaded: NDArray[np.int_]) -> Disturbance:
    """Unit inputs, unit forces and moments in the world on nodes, and unit mobilisations."""
    frictional, field = own.model.law.frictional, own.field
    m, k = len(frictional), int(frictional.sum())
    first = m + 6 * len(loaded)
    found = Disturbance.none(own, first + k)
    found.inputs[:, :m] = np.eye(m)
    rotations = state.configuration.poses[0][1]
    for j, node in enumerate(loaded):
        turn, start = rotations[node].T, m + 6 * j
        found.wrenches[6 * node : 6 * node + 3, start : start + 3] = turn
        found.wrenches[6 * node + 3 : 6 * node + 6, start + 3 : start + 6] = turn
    if k:
        found.wrenches[:, first:] = own.mobilisation_columns()
        tendon, group = np.nonzero(frictional)
        found.tension[tendon, :, first + np.arange(k)] = field.by_mobilisation[tendon, :, group]
        released = field.released_d_tension[tendon] * field.by_mobilisation[tendon, :, group]
        found.released[tendon, :, first + np.arange(k)] = released
    return found
