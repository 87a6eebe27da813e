"""Arbitration: an independent integration of a solved state, with other equations, variables and integrator.

Where the two solvers differ, it determines which of them solves the Cosserat equations. It takes only the wrench at
the base and the tensions from a solution, integrates pose (as a quaternion) and wrench in the world frame from the
base to the tip with scipy's adaptive `solve_ivp`, and tests two properties of the exact solution: the same shape,
and zero wrench beyond the tip.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from tdcr_fe.model.backbone import Superelastic
from tdcr_fe.model.loading import Load, Model
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.tendon import Tendon

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Integration:
    """Deviations found by the independent integration.

    Attributes
    ----------
    shape : float
        Largest distance between the shapes at base, disks and tip, over the length [1].
    force, moment : float
        Wrench beyond the tip, over EI/L^2 and EI/L [1].
    """

    shape: float
    force: float
    moment: float


def integrate_again(robot: Robot, model: Model, step: StepResult, loads: Mapping[str, Load]) -> Integration:
    """Integrate a solved state from its base wrench and tensions.

    Parameters
    ----------
    robot, model
        Description.
    step
        The state; ``details["base_wrench"]`` is the wrench just above the base plate.
    loads
        Concentrated loads that act in it.
    """
    backbone, length = robot.backbone, robot.backbone.length
    gravity = np.asarray(model.gravity, dtype=float)
    jumps = _point_wrenches(robot, model, step, loads, gravity)
    inserts = _rigid_inserts(robot)
    stations = _stations(robot, loads, inserts)
    weight = backbone.mass_per_length * gravity
    pulled = [(t, float(x[0])) for t, x in zip(robot.tendons, step.tensions, strict=True)]
    state = np.concatenate((np.zeros(3), [0.0, 0.0, 0.0, 1.0], step.details["base_wrench"]))
    farthest = 0.0
    for a, b in pairwise(stations):
        if b - a < 1e-9:
            continue
        middle = 0.5 * (a + b)
        rigid = any(i < middle < j for i, j in inserts)
        active = (
            [(t, x) for t, x in pulled if middle < robot.end(t)] if model.tendon_path == "continuous" else []
        )
        bending, torsion = (float(x[0]) for x in backbone.stiffness_factors(np.array([middle])))
        stiffness = np.array([backbone.EI * bending, backbone.EI * bending, backbone.GJ * torsion])

        def slope(s: float, y: Array) -> Array:
            turn = Rotation.from_quat(y[3:7])
            moment, force = turn.inv().apply(y[7:10]), turn.inv().apply(y[10:13])
            if rigid:  # noqa: B023 - used within this pass of the loop only
                curvature, stretch = np.array([*backbone.precurvature, 0.0]), np.array([0.0, 0.0, 1.0])
            else:
                curvature, stretch = _strain(robot, s, moment, force, stiffness, active)  # noqa: B023
            x, y_, z, w = y[3:7]
            p, q, r = curvature
            spin = 0.5 * np.array(
                [
                    w * p + y_ * r - z * q,
                    w * q + z * p - x * r,
                    w * r + x * q - y_ * p,
                    -x * p - y_ * q - z * r,
                ]
            )
            line = turn.apply(stretch)
            return np.concatenate((line, spin, -np.cross(line, y[10:13]), -weight))

        state = np.asarray(
            solve_ivp(slope, (a, b), state, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1], dtype=float
        )
        state[3:7] /= np.linalg.norm(state[3:7])
        node = int(np.argmin(np.abs(step.s - b)))
        if abs(step.s[node] - b) < 1e-9:
            farthest = max(farthest, float(np.linalg.norm(state[:3] - step.positions[node])))
        for at, wrench in jumps:
            if a < at - 1e-9 <= b:
                state[7:] -= wrench
    scale = backbone.EI / length
    return Integration(
        farthest / length,
        float(np.linalg.norm(state[10:])) * length / scale,
        float(np.linalg.norm(state[7:10])) / scale,
    )


def _rigid_inserts(robot: Robot) -> list[tuple[float, float]]:
    """Start and end of the parts of the backbone that disks make rigid [m]."""
    half = robot.disks.thickness / 2.0
    return [(d - half, d + half) for d in robot.disks.positions] if half > 0.0 else []


def _stations(robot: Robot, loads: Mapping[str, Load], inserts: list[tuple[float, float]]) -> list[float]:
    """Arc lengths where the integration stops, since something changes there [m]."""
    length = robot.backbone.length
    cuts = {0.0, length, *robot.disks.positions, *(min(load.at, length) for load in loads.values())}
    cuts |= {min(max(e, 0.0), length) for insert in inserts for e in insert}
    cuts |= {e for patch in robot.backbone.patches for e in (patch.start, patch.end) if 0.0 < e < length}
    return sorted(cuts | {robot.end(t) for t in robot.tendons})


def _point_wrenches(
    robot: Robot, model: Model, step: StepResult, loads: Mapping[str, Load], gravity: Array
) -> list[tuple[float, Array]]:
    """Arc lengths [m] and moments and forces there, world frame [N m, N], shape (6,) each."""
    wrenches: list[tuple[float, Array]] = []

    def node(s: float) -> int:
        return int(np.argmin(np.abs(step.s - s)))

    def add(s: float, force: Array, moment: Array) -> None:
        wrenches.append((s, np.concatenate((moment, force))))

    for s in robot.disks.positions:
        add(s, robot.disks.mass * gravity, np.zeros(3))
    add(robot.backbone.length, robot.tip_mass * gravity, np.zeros(3))
    for load in loads.values():
        turn = step.rotations[node(load.at)] if load.frame == "section" else np.eye(3)
        add(load.at, turn @ np.array(load.force), turn @ np.array(load.moment))
    if model.tendon_path == "straight":
        for tendon, tension in zip(robot.tendons, step.tensions, strict=True):
            arcs = robot.hole_arc_lengths(tendon)
            nodes = [node(s) for s in arcs]
            holes = robot.hole_points(tendon)
            arms = np.einsum("nij,nj->ni", step.rotations[nodes], holes)
            edges = np.diff(step.positions[nodes] + arms, axis=0)
            pull = tension[:, None] * edges / np.linalg.norm(edges, axis=1)[:, None]
            for k, s in enumerate(arcs[1:]):
                force = -pull[k] + (pull[k + 1] if k + 1 < len(pull) else 0.0)
                add(float(s), force, np.cross(arms[k + 1], force))
    return wrenches


def _strain(
    robot: Robot, s: float, moment: Array, force: Array, stiffness: Array, active: list[tuple[Tendon, float]]
) -> tuple[Array, Array]:
    """Curvature and stretch, section frame, from the wrench of rod and tendons together."""
    backbone = robot.backbone
    rest = np.array([*backbone.precurvature, 0.0])
    straight = np.array([backbone.GA, backbone.GA, backbone.EA])
    own_moment, own_force = moment, force
    curvature, stretch = rest, np.array([0.0, 0.0, 1.0])
    for _ in range(100 if active else 1):
        if active:
            own_moment, own_force = moment.copy(), force.copy()
            for tendon, tension in active:
                end = robot.end(tendon)
                routing = tendon.routing
                offset = np.array([*routing.position(np.array([s]), end)[0], 0.0])
                course = (
                    stretch + np.cross(curvature, offset) + [*routing.position(np.array([s]), end, 1)[0], 0.0]
                )
                pull = tension * course / np.linalg.norm(course)
                own_force -= pull
                own_moment -= np.cross(offset, pull)
        before = np.concatenate((curvature, stretch))
        curvature = rest + own_moment / stiffness
        if backbone.superelastic is not None:
            size = float(np.hypot(own_moment[0], own_moment[1]))
            if size > 0.0:
                bent = _softened(size, float(stiffness[0]), backbone.superelastic, backbone.radius)
                curvature[:2] = rest[:2] + own_moment[:2] / size * bent
        stretch = np.array([0.0, 0.0, 1.0]) + own_force / straight
        if np.max(np.abs(np.concatenate((curvature, stretch)) - before)) < 1e-13:
            break
    return curvature, stretch


def _softened(moment: float, stiffness: float, law: Superelastic, radius: float) -> float:
    """Curvature [1/m] at which a superelastic section carries a moment [N m]."""
    knee = law.threshold_strain / radius
    width = 0.025 * knee

    def soft(x: float) -> float:
        return float(np.logaddexp(0.0, x))

    def miss(curvature: float) -> float:
        beyond = width * (soft((curvature - knee) / width) - soft(-knee / width))
        return stiffness * (curvature - (1.0 - law.plateau_ratio) * beyond) - moment

    return float(brentq(miss, 0.0, moment / (stiffness * law.plateau_ratio) + 1e-9, xtol=1e-14, rtol=1e-14))
