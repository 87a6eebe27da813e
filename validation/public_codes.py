"""Equations of two public codes for robots without friction, solved with numpy and scipy at tight tolerance.

Only the formulation of the codes is used; no code is copied.

- Continuous tendons: the distributed wrench of D. C. Rucker, R. J. Webster III, IEEE Trans. Robot. 27 (2011) 1033-1044,
  as solved by the model "Cosserat rod" of SvenLilge/tdcr-modeling (P. Rao et al., Frontiers in Robotics and AI 7 (2021)
  630245) and by the Newtonian model of TIMClab-CAMI/Cosserat-Rod-Modeling-of-Tendon-Actuated-Continuum-Robots
  (M. Tummers et al., IEEE Trans. Robot. 39 (2023) 2360-2378).
- Straight tendons: the model "subsegment Cosserat rod" of the first: between disks a rod without distributed load, at
  every disk the balance of the rod's wrenches and of the tendon segments on both sides; one wrench per bay is unknown.

Where a continuous tendon ends inside the backbone, the strain jumps, and with it the direction of the tendons that go
on. The distributed force of a tendon, its tension times the rate of change of its direction, is a point force there.
The first code leaves it out, the second has it for a jump of the routing only. It vanishes where twist and shear do not
jump; with a tip force it moves the tip by up to 0.12 % of the length (`solve`, argument ``kinks``).

Section frames have their tangent along the third axis; v and u are the linear and angular rates of change of the frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import root

from tdcr_fe.model.robot import Robot
from tdcr_fe.model.routing import ParallelRouting

Array = NDArray[np.float64]
_E3 = np.array([0.0, 0.0, 1.0])
#: Relative and absolute tolerance of the integration along the backbone.
RTOL, ATOL = 1e-11, 1e-13


@dataclass(frozen=True)
class Solution:
    """Solved tip.

    Attributes
    ----------
    tip, tangent : ndarray, shape (3,)
        Position [m] and unit tangent.
    residual : float
        Largest unbalanced force [N] or moment over the tendons' offset [N].
    """

    tip: Array
    tangent: Array
    residual: float


def _hat(a: Array) -> Array:
    """Matrices of cross products: (..., 3) to (..., 3, 3)."""
    m = np.zeros((*a.shape, 3))
    m[..., 0, 1], m[..., 0, 2], m[..., 1, 2] = -a[..., 2], a[..., 1], -a[..., 0]
    return np.asarray(m - np.swapaxes(m, -1, -2))


def _stiffness(robot: Robot) -> tuple[Array, Array]:
    b = robot.backbone
    return np.array([b.GA, b.GA, b.EA]), np.array([b.EI, b.EI, b.GJ])


def solve(
    robot: Robot,
    tensions: dict[str, float],
    tip_force: Array,
    path: str,
    load_steps: int = 1,
    kinks: bool = True,
) -> Solution:
    """Tip of a robot without friction and gravity.

    Parameters
    ----------
    robot
        Straight when unloaded, linearly elastic, with thin disks.
    tensions
        By tendon [N].
    tip_force
        In the world frame [N], shape (3,).
    path
        "straight" or "continuous".
    load_steps
        Number of equal steps in which tensions and force are applied; doubled where a step is not solved.
    kinks
        Whether a continuous tendon that goes on where another ends pulls on the rod there by its kink. See the text of
        this module.

    Raises
    ------
    RuntimeError
        No equilibrium was found.
    """
    model = _StraightModel(robot) if path == "straight" else _ContinuousModel(robot, kinks)
    values = np.array([tensions.get(t.name, 0.0) for t in robot.tendons])
    force = np.asarray(tip_force, dtype=float)
    while True:
        unknown = model.start()
        try:
            for k in range(1, load_steps + 1):
                unknown, solution = model.solve(k / load_steps * values, k / load_steps * force, unknown)
            return solution
        except RuntimeError:
            if load_steps >= 32:
                raise
            load_steps *= 2


class _ContinuousModel:
    """Shooting from the base: its wrench is unknown, the balance at the tip is the residual.

    The rod's wrench is integrated, not its strain: in the strain the small stretch and shear would lose digits.
    """

    def __init__(self, robot: Robot, kinks: bool) -> None:
        self.robot, self.kinks = robot, kinks
        self.shear, self.bend = _stiffness(robot)
        self.ends = sorted({robot.end(t) for t in robot.tendons} | {robot.backbone.length})
        self.lever = max(float(np.max(np.linalg.norm(robot.holes(t), axis=1))) for t in robot.tendons)

    def start(self) -> Array:
        """Wrench at the base of the unloaded robot besides `_guess`, moments over the lever [N]."""
        return np.zeros(6)

    def _guess(self, tensions: Array) -> Array:
        """Wrench with which the rod balances its tendons at the base, their shear left out."""
        routing = self._routings(list(range(len(tensions))))(0.0)
        way = routing[1] + _E3
        pull = tensions[:, None] * way / np.linalg.norm(way, axis=1)[:, None]
        return -np.concatenate((pull.sum(axis=0), np.cross(routing[0], pull).sum(axis=0)))

    def _routings(self, active: list[int]) -> Callable[[float], Array]:
        """Positions of tendons in the section with two derivatives, by arc length, shape (3, k, 3)."""
        tendons = [self.robot.tendons[i] for i in active]

        def evaluate(s: float) -> Array:
            found = np.zeros((3, len(tendons), 3))
            for k, tendon in enumerate(tendons):
                for order in range(3):
                    found[order, k, :2] = tendon.routing.position(
                        np.array([s]), self.robot.end(tendon), order
                    )[0]
            return found

        if all(isinstance(t.routing, ParallelRouting) for t in tendons):
            constant = evaluate(0.0)
            return lambda s: constant
        return evaluate

    def _rates(self, s: float, y: Array, tensions: Array, routing: Callable[[float], Array]) -> Array:
        turn, n, m = y[3:12].reshape(3, 3), y[12:15], y[15:18]
        v, u = _E3 + n / self.shear, m / self.bend
        spin = _hat(u)
        matrix = self.elastic.copy()
        right = np.concatenate((-spin @ n, -spin @ m - _hat(v) @ n))
        if len(tensions):
            r, dr, ddr = routing(s)
            rate = r @ spin.T + dr + v
            cross = _hat(rate)
            size = np.sqrt(np.einsum("ki,ki->k", rate, rate))
            a_matrix = -(tensions / size**3)[:, None, None] * (cross @ cross)
            a_vector = (a_matrix @ ((rate + dr) @ spin.T + ddr)[..., None])[..., 0]
            lever = _hat(r)
            both = lever @ a_matrix
            matrix[:3, :3] += a_matrix.sum(axis=0)
            matrix[:3, 3:] -= (a_matrix @ lever).sum(axis=0)
            matrix[3:, :3] += both.sum(axis=0)
            matrix[3:, 3:] -= (both @ lever).sum(axis=0)
            right[:3] -= a_vector.sum(axis=0)
            right[3:] -= (lever @ a_vector[..., None])[..., 0].sum(axis=0)
        strain = np.linalg.solve(matrix, right)
        return np.concatenate(
            (turn @ v, (turn @ spin).ravel(), self.shear * strain[:3], self.bend * strain[3:])
        )

    @property
    def elastic(self) -> Array:
        """Stiffness of the section, shape (6, 6)."""
        return np.diag(np.concatenate((self.shear, self.bend)))

    def _shoot(self, unknown: Array, tensions: Array, force: Array) -> tuple[Array, Array]:
        """State at the tip, and the balance there [N], for the wrench at the base."""
        guess = self._guess(tensions)
        y = np.concatenate((np.zeros(3), np.eye(3).ravel(), unknown[:3], unknown[3:] * self.lever))
        y[12:] += guess
        start = 0.0
        for end in self.ends:
            active = [
                i
                for i, t in enumerate(self.robot.tendons)
                if self.robot.end(t) >= end - 1e-9 and tensions[i] > 0.0
            ]
            routing = self._routings(active)
            done = solve_ivp(
                self._rates,
                (start, end),
                y,
                method="DOP853",
                rtol=RTOL,
                atol=ATOL,
                args=(tensions[active], routing),
            )
            y = done.y[:, -1].copy()
            ending = np.array(
                [self.robot.end(self.robot.tendons[i]) <= end + 1e-9 for i in active], dtype=bool
            )
            y[12:] = self._across(y[12:], tensions[active], routing(end), ending)
            start = end
        turn = y[3:12].reshape(3, 3)
        return y, np.concatenate((y[12:15] - turn.T @ force, y[15:18] / self.lever))

    def _pulls(self, wrench: Array, tensions: Array, routing: Array) -> Array:
        """Wrenches of the tendons on the section behind them, for the rod's wrench there, shape (k, 6)."""
        v, u = _E3 + wrench[:3] / self.shear, wrench[3:] / self.bend
        rate = np.cross(u, routing[0]) + routing[1] + v
        pull = tensions[:, None] * rate / np.linalg.norm(rate, axis=1)[:, None]
        return np.concatenate((pull, np.cross(routing[0], pull)), axis=1)

    def _across(self, before: Array, tensions: Array, routing: Array, ending: NDArray[np.bool_]) -> Array:
        """The rod's wrench beyond a section where tendons end, from that before it, shape (6,)."""
        pulls = self._pulls(before, tensions, routing)
        after = before + pulls[ending].sum(axis=0)
        if not self.kinks or not np.any(~ending):
            return np.asarray(after)
        going_on = routing[:, ~ending]
        total = before + pulls.sum(axis=0)
        for _ in range(60):
            after = total - self._pulls(after, tensions[~ending], going_on).sum(axis=0)
        return np.asarray(after)

    def solve(self, tensions: Array, force: Array, unknown: Array) -> tuple[Array, Solution]:
        """The wrench at the base and the tip, from a wrench nearby."""

        def balance(x: Array) -> Array:
            return self._shoot(x, tensions, force)[1]

        found = root(balance, unknown, tol=1e-13)
        y, rest = self._shoot(found.x, tensions, force)
        size = float(np.max(np.abs(rest)))
        if size > 1e-8:
            raise RuntimeError(f"no equilibrium: residual {size:.1e} N")
        return found.x, Solution(y[:3], y[3:12].reshape(3, 3)[:, 2], size)


class _StraightModel:
    """Multiple shooting: one wrench per bay is unknown, the balance at every disk is the residual."""

    def __init__(self, robot: Robot) -> None:
        self.shear, self.bend = _stiffness(robot)
        positions = np.array(robot.disks.positions)
        if abs(positions[-1] - robot.backbone.length) > 1e-9:
            raise ValueError("the last disk must be at the tip")
        self.bays = np.diff(positions, prepend=0.0)
        self.holes = []
        for tendon in robot.tendons:
            xy = robot.holes(tendon)
            self.holes.append(np.column_stack((xy, np.zeros(len(xy)))))
        self.lever = max(float(np.max(np.linalg.norm(h, axis=1))) for h in self.holes)

    def start(self) -> Array:
        """Wrenches at the beginning of the bays besides `_guess`, moments over the lever [N]."""
        return np.zeros((len(self.bays), 6))

    def _guess(self, tensions: Array) -> Array:
        """Wrenches with which the straight rod balances its tendons, by bay."""
        found = np.zeros((len(self.bays), 6))
        for hole, tension in zip(self.holes, tensions, strict=True):
            pull = tension * _E3
            found[: len(hole) - 1, :3] -= pull
            found[: len(hole) - 1, 3:] -= np.cross(hole[:-1], pull) / self.lever
        return found

    def _integrate(self, wrenches: Array, bays: Array) -> Array:
        """Pose (3, 4) of the bays' ends, by wrench at their beginning, and wrench there: (K, 6) to (K, 18)."""
        count = len(wrenches)
        y = np.zeros((count, 18))
        y[:, 3:12] = np.eye(3).ravel()
        y[:, 12:15] = wrenches[:, :3]
        y[:, 15:] = wrenches[:, 3:] * self.lever

        def rates(_: float, flat: Array) -> Array:
            state = flat.reshape(count, 18)
            turn, n, m = state[:, 3:12].reshape(-1, 3, 3), state[:, 12:15], state[:, 15:]
            v, u = _E3 + n / self.shear, m / self.bend
            d = np.empty_like(state)
            d[:, :3] = (turn @ v[..., None])[..., 0]
            d[:, 3:12] = (turn @ _hat(u)).reshape(count, 9)
            d[:, 12:15] = -np.cross(u, n)
            d[:, 15:] = -np.cross(u, m) - np.cross(v, n)
            return np.asarray((d * bays[:, None]).ravel())

        done = solve_ivp(rates, (0.0, 1.0), y.ravel(), method="DOP853", rtol=RTOL, atol=ATOL)
        end = done.y[:, -1].reshape(count, 18)
        end[:, 15:] /= self.lever
        return np.asarray(end)

    def _frames(self, ends: Array) -> tuple[Array, Array]:
        """World positions and rotations of base plate and disks, from the bays' ends."""
        positions, rotations = [np.zeros(3)], [np.eye(3)]
        for end in ends:
            positions.append(positions[-1] + rotations[-1] @ end[:3])
            rotations.append(rotations[-1] @ end[3:12].reshape(3, 3))
        return np.array(positions), np.array(rotations)

    def _residual(self, unknown: Array, ends: Array, tensions: Array, force: Array) -> Array:
        """Balance at every disk in its own frame [N], shape (6 n,)."""
        positions, rotations = self._frames(ends)
        n, lever = len(ends), self.lever
        rest = np.zeros((n, 6))
        rest[:, :6] = -ends[:, 12:]
        rest[:-1] += unknown[1:]
        rest[-1, :3] += rotations[-1].T @ force
        for hole, tension in zip(self.holes, tensions, strict=True):
            if tension == 0.0:
                continue
            last = len(hole) - 1
            at = positions[: last + 1] + (rotations[: last + 1] @ hole[..., None])[..., 0]
            way = np.diff(at, axis=0)
            pull = tension * way / np.linalg.norm(way, axis=1)[:, None]
            onto = -pull
            onto[:-1] += pull[1:]
            local = (np.swapaxes(rotations[1 : last + 1], 1, 2) @ onto[..., None])[..., 0]
            rest[:last, :3] += local
            rest[:last, 3:] += np.cross(hole[1:], local) / lever
        return rest.ravel()

    def solve(self, tensions: Array, force: Array, unknown: Array) -> tuple[Array, Solution]:
        """The wrenches at the bays' beginnings and the tip, from wrenches nearby; Newton with differences."""
        n = len(self.bays)
        shifts = np.concatenate((np.zeros((1, 6)), 1e-6 * np.eye(6)))
        repeated = np.tile(self.bays, len(shifts))
        guess = self._guess(tensions)
        x = unknown + guess
        size = np.inf
        for _ in range(60):
            trials = self._integrate((x + shifts[:, None]).reshape(-1, 6), repeated).reshape(-1, n, 18)
            ends = trials[0]
            rest = self._residual(x, ends, tensions, force)
            before, size = size, float(np.max(np.abs(rest)))
            if size < 1e-11 or (size < 1e-9 and size > 0.5 * before):
                break
            jacobian = np.empty((6 * n, 6 * n))
            for k in range(n):
                for c in range(6):
                    moved, other = ends.copy(), x.copy()
                    moved[k] = trials[1 + c, k]
                    other[k] += shifts[1 + c]
                    jacobian[:, 6 * k + c] = (self._residual(other, moved, tensions, force) - rest) / 1e-6
            step: Array = np.linalg.solve(jacobian, -rest).astype(np.float64).reshape(n, 6)
            x = x + self._damped(x, step, tensions, force, size)
        if size > 1e-8:
            raise RuntimeError(f"no equilibrium: residual {size:.1e} N")
        positions, rotations = self._frames(ends)
        return x - guess, Solution(positions[-1], rotations[-1][:, 2], size)

    def _damped(self, x: Array, step: Array, tensions: Array, force: Array, size: float) -> Array:
        """The step, halved until it lowers the residual."""
        for _ in range(8):
            rest = self._residual(x + step, self._integrate(x + step, self.bays), tensions, force)
            if np.max(np.abs(rest)) < size:
                break
            step = 0.5 * step
        return step
