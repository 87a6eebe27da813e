"""Loads that depend on the state of the robot: the action at which both agree, where the state follows it linearly.

Near a run the state ``x`` follows the action ``a`` by the exact response ``H`` of that run. Loads ``F`` agree with it
where ``a = F(x + H (a - a0))``, which Newton's method solves: ``(I - F' H) da = F - a``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.identify.bay_state import COMPONENTS, Action, BayState, Response
from tdcr_fe.identify.causes import StateLoad
from tdcr_fe.identify.problem import FitProblem, Point
from tdcr_fe.identify.run import Run
from tdcr_fe.model.robot import Robot

#: Loads agree with the state where less is missing: moments over EI/L, forces over EI/L^2 [1].
AGREED = 1e-8


class Agreement(NamedTuple):
    """Loads and state near a run."""

    action: Action
    change: Array  # of the action from that of the run, shape (K, 6 n_bays, 1)
    state: BayState  # with the change
    missing: float  # what the loads give beyond the action of the run, over `scale` [1]


def scale(robot: Robot) -> Array:
    """Moments and forces that bend a backbone by about its length, in the order of an action, shape (6,)."""
    backbone = robot.backbone
    return np.array([backbone.EI / backbone.length] * 3 + [backbone.EI / backbone.length**2] * 3)


def agreed(loads: Sequence[StateLoad], values: Point, run: Run, robot: Robot) -> Agreement:
    """Loads and state near a run that carries an action, by Newton's method.

    What depends on the rows before is right for one row more with each iteration: there are as many as rows.
    """
    assert run.bays is not None and run.acted is not None
    response, start = run.acted.response, run.acted.action.in_frames(run.bays.rotation)
    shape, size = start.values.shape, scale(robot)
    change, missing, best = np.zeros((shape[0], shape[1] * COMPONENTS, 1)), list[float](), None
    while True:
        state = run.bays.corrected((response.state @ change).reshape(shape))
        action = start.values + change.reshape(shape)
        gap = sum((e.action(state, values[e.name]) for e in loads), -action)
        missing.append(float(np.max(np.abs(gap) / size)))
        if best is None or missing[-1] <= min(missing):
            best = Agreement(Action(action, start.rotation), change, state, missing[0])
        if missing[-1] < AGREED or len(missing) > len(start.values):
            return best
        change = change + np.linalg.solve(coupling(loads, values, state, response), gap.reshape(change.shape))


def through_state(loads: Sequence[StateLoad], values: Point, state: BayState, moved: Array) -> Array:
    """Change of the action by changes of the state, shape (K, 6 n_bays, P) both."""
    none = np.zeros((*state.shape, COMPONENTS, COMPONENTS))
    slope = sum((e.slope(state, values[e.name]) for e in loads), none)
    rows = moved.reshape(*state.shape, COMPONENTS, -1)
    return np.einsum("kbij,kbjp->kbip", slope, rows).reshape(moved.shape)


def coupling(loads: Sequence[StateLoad], values: Point, state: BayState, response: Response) -> Array:
    """The matrix ``I - F' H`` of every step, shape (K, 6 n_bays, 6 n_bays)."""
    through = through_state(loads, values, state, response.state)
    return np.asarray(np.eye(through.shape[1]) - through)


def of_readings(problem: FitProblem, actions: Array, response: Response) -> Array:
    """Change of the predictions over sigma by actions of shape (K, 6 n_bays, q) to first order, shape (n, q)."""
    out = np.zeros((problem.count, actions.shape[-1]))
    steps = problem.readings.step
    for k in np.unique(steps):
        mine = steps == k
        out[mine] = response.readings[mine] @ actions[k]
    return out
