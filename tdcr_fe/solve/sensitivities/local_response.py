"""Compliance, tendon Jacobians and stiffness seen by the motors, in one solved state: `local_response`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.results import LocalResponse
from tdcr_fe.scene.handle import TDCR
from tdcr_fe.solve.equations.configuration import SolverState, Target
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.sensitivities.linear_response import Disturbance, SolvedPoint
from tdcr_fe.solve.simulation import Simulation, one_thread

Array = NDArray[np.float64]


def local_response(where: Simulation | TDCR, s: float | None = None, reversal: bool = False) -> LocalResponse:
    """Motion of one node under small changes of loads and tendon inputs.

    The tangent at the solved state is used, with everything else in the scene.

    Parameters
    ----------
    where
        A simulation, or a robot in a scene that `SolveTDCR` has solved.
    s
        Arc length of the node [m]; None is the tip.
    reversal
        Let all holes stick, as where every motion reverses. Else holes that slip go on slipping in their direction.

    Raises
    ------
    KeyError
        There is no node at this arc length.
    numpy.linalg.LinAlgError
        The tangent is singular.
    """
    with one_thread():
        if isinstance(where, Simulation):
            found = response_at(where.system, where.state, 0, s, reversal)
            where.system.store(where.state)
            return found
        system = SceneSystem(where.mbs)
        number = system.robots.index(where.actuation)
        state = system.current_state(where.mbs.systemData.GetTime())
        try:
            found = response_at(system, state, number, s, reversal)
            system.store(state)
        finally:
            system.connect()
        return found


def response_at(
    system: SceneSystem, state: SolverState, robot: int, s: float | None, reversal: bool
) -> LocalResponse:
    """`local_response` of a robot in a system, by its number; the scene is left in this state."""
    actuation = system.robots[robot]
    mesh, m = actuation.mesh, actuation.count
    node = len(mesh.arc_lengths) - 1 if s is None else mesh.node_at(s, 1e-6)
    target = Target(state.inputs, state.loads, state.time)
    numbering = system.numbering(by_tension=robot)
    solved = SolvedPoint.of(system, state, target, numbering=numbering, all_stick=reversal)
    disturbances = [Disturbance.none(own, 6 + m) for own in solved.forces]
    rotation = state.configuration.poses[robot][1][node]
    own = disturbances[robot]
    rows = own.wrenches[6 * node : 6 * node + 6]
    rows[:3, :3] = rows[3:, 3:6] = rotation.T
    own.inputs[:, 6:] = np.eye(m)
    response = solved.respond(tuple(disturbances))
    moved = response.unknowns[numbering.robots[robot].nodes][6 * node : 6 * node + 6]
    motion = np.concatenate((rotation @ moved[:3], rotation @ moved[3:]))
    slip = response.tendons[robot].released.sum(axis=1)
    taut = state.base_tension[robot] > 0.0
    driven = np.flatnonzero(actuation.drives.winds & taut)
    compliance = motion[:, :6].copy()
    if driven.size:
        kept = np.linalg.solve(slip[np.ix_(driven, 6 + driven)], slip[driven, :6])
        compliance -= motion[:, 6 + driven] @ kept
    pulled = np.flatnonzero(taut)
    stiffness = np.zeros((m, m))
    stiffness[np.ix_(pulled, pulled)] = np.linalg.inv(slip[np.ix_(pulled, 6 + pulled)])
    return LocalResponse(
        float(mesh.arc_lengths[node]),
        reversal,
        compliance,
        motion[:, 6:],
        motion[:, 6:] @ stiffness,
        stiffness,
    )
