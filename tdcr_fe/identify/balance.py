"""Loads that depend on the state of the robot: the action at which both agree, where the state follows it linearly.

Near a run the state ``x`` follows the action ``a`` by the exact response ``H`` of that run. Loads ``F`` agree with it
where ``a = F(x + H (a - a0))``, which Newton's method solves: ``(I - F' H) da = F - a``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np
from scipy.optimize import least_squares

from tdcr_fe.elements import Array
from tdcr_fe.identify.bay_state import COMPONENTS, FORCE, Action, BayState, Response
from tdcr_fe.identify.causes import PointForce, StateLoad
from tdcr_fe.identify.problem import FitProblem, Point
from tdcr_fe.identify.run import Run
from tdcr_fe.model.robot import Robot

#: Steps at most by which the numbers of a force towards a point are fitted to first order.
EVALUATIONS = 40


class Space(Protocol):
    """Weighted readings that are fitted, less what the parameters of a model can bring."""

    @property
    def rest(self) -> Array:
        """The residual, shape (m,)."""

    def free(self, signature: Array) -> Array:
        """Columns of changes of the predictions over sigma, from shape (n, k) to (m, k)."""


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
    """Loads and state near a run that carries an action, by Newton's method, while what is missing falls by half."""
    assert run.bays is not None and run.acted is not None
    response, start = run.acted.response, run.acted.action.in_frames(run.bays.rotation)
    shape, size = start.values.shape, scale(robot)
    change, sizes = np.zeros((shape[0], shape[1] * COMPONENTS, 1)), list[float]()
    while True:
        state = run.bays.corrected((response.state @ change).reshape(shape))
        action = start.values + change.reshape(shape)
        gap = sum((e.action(state, values[e.name]) for e in loads), -action)
        sizes.append(float(np.max(np.abs(gap) / size)))
        if len(sizes) > 2 and not sizes[-1] < 0.5 * sizes[-2]:
            return Agreement(Action(action, start.rotation), change, state, sizes[0])
        matrix = coupling(loads, values, state, response)
        change = change + np.linalg.solve(matrix, gap.reshape(change.shape))


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


class BestPoint(NamedTuple):
    """A force towards the point that explains a residual best."""

    drop: float  # fall of the sum of squares
    values: dict[str, float]
    change: Array  # of the predictions over sigma, shape (n,)


class _Pulled(NamedTuple):
    """What a force towards a point does."""

    change: Array  # of the predictions over sigma, shape (n,)
    slopes: Array  # its derivatives by the numbers of the force, shape (n, P)
    largest: float  # force [N]


def best_point(
    problem: FitProblem, run: Run, cause: PointForce, space: Space, follows: bool = True
) -> BestPoint | None:
    """The force towards a point that explains a residual best, where the robot follows it linearly; None if none does.

    Parameters
    ----------
    problem, run
        The readings, and a run with its response to actions.
    cause
        The force. It is tried at all points of `PointForce.tries`; from the best one all its numbers are fitted.
        Fits from the best five explained as much in six data sets, at the best disk, but for 3 % in one.
    space
        The residual, less what the parameters of the model can bring.
    follows
        Whether the force moves the robot from where it is in the run; False: the run is where the force holds it.
    """
    assert run.bays is not None and run.acted is not None
    own = slice(COMPONENTS * cause.bay + FORCE.start, COMPONENTS * (cause.bay + 1))
    response, by_force = run.acted.response.state[:, own, own], run.acted.response.readings[:, None, own]
    response = response if follows else np.zeros_like(response)
    names, steps = [p.name for p in cause.parameters], problem.readings.step
    before, none = run.bays.moved[:, cause.bay], np.zeros((len(response), 3, 1))

    @lru_cache(maxsize=1)  # residual and derivatives are asked for one after the other
    def at(*z: float) -> _Pulled:
        """The force with these numbers, by Newton's method."""
        values, force = dict(zip(names, z, strict=True)), none
        for _ in range(3 if follows else 1):
            moved = before + (response @ force)[..., 0]
            missing = cause.force(moved, values)[..., None] - force
            matrix = np.eye(3) - cause.stiffness(moved, values) @ response
            force = force + np.linalg.solve(matrix, missing)
        by_values = np.linalg.solve(matrix, cause.by_values(moved, values))
        largest = float(np.max(np.linalg.norm(force, axis=1)))
        return _Pulled((by_force @ force[steps])[:, 0, 0], (by_force @ by_values[steps])[:, 0], largest)

    def left(z: Array) -> Array:
        return space.rest - space.free(at(*z.tolist()).change[:, None])[:, 0]

    def slopes(z: Array) -> Array:
        return -space.free(at(*z.tolist()).slopes)

    tries = list(cause.tries(before))
    low, high = (np.array([getattr(p, end) for p in cause.parameters]) for end in ("lower", "upper"))
    strength, scales = names.index("k"), [p.scale for p in cause.parameters]
    forces = np.stack([cause.force(before, values) for values in tries], axis=-1)
    columns = space.free((by_force @ forces[steps])[:, 0])
    size = np.maximum(np.sum(columns**2, axis=0), 1e-300)
    amplitudes = columns.T @ space.rest / size
    starts = np.array([[values[n] for n in names] for values in tries])
    strengths = np.clip(amplitudes * starts[:, strength], 0.999 * low[strength], 0.999 * high[strength])
    starts[:, strength] = strengths
    promised = np.where(strengths > low[strength], size * amplitudes**2, 0.0)
    if not np.any(promised > 0.0):
        return None
    start = starts[np.argmax(promised)]
    found = least_squares(left, start, slopes, (low, high), x_scale=scales, max_nfev=EVALUATIONS)
    z = found.x
    if follows:  # a larger force bends or buckles the robot beyond first order
        most = problem.data.robot.backbone.EI / cause.at**2
        z[strength] *= min(1.0, most / max(at(*z.tolist()).largest, 1e-300))
    drop = float(space.rest @ space.rest - np.sum(left(z) ** 2))
    return BestPoint(drop, dict(zip(names, z.tolist(), strict=True)), at(*z.tolist()).change)
