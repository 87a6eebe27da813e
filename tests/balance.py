"""Energy, work, tendon lengths and angles from solved steps alone: node poses, tensions, displacements."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.linalg import logm

from tdcr_fe.model.loading import Load, LoadStep
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.model.robot import Robot


def elastic_energy(robot: Robot, step: StepResult) -> float:
    """Half of strain times section force, the strain from the matrix logarithm of neighbouring poses [J]."""
    b = robot.backbone
    stiffness = np.array([b.GA, b.GA, b.EA, b.EI, b.EI, b.GJ])
    energy = 0.0
    for k, length in enumerate(np.diff(step.s)):
        relative = np.eye(4)
        r = step.rotations[k].T
        relative[:3, :3] = r @ step.rotations[k + 1]
        relative[:3, 3] = r @ (step.positions[k + 1] - step.positions[k])
        x = np.real(logm(relative))
        strain = np.array([*x[:3, 3], x[2, 1], x[0, 2], x[1, 0]]) / length
        strain[2] -= 1.0
        energy += 0.5 * length * float(strain @ (stiffness * strain))
    return energy


def cables(robot: Robot, step: StepResult) -> list[tuple[np.ndarray, np.ndarray]]:
    """By tendon, lengths of the segments [m] and angles at the holes between them [rad]."""
    found = []
    for tendon in robot.tendons:
        at = robot.hole_arc_lengths(tendon)
        node = np.argmin(np.abs(step.s[:, None] - at), axis=0)
        local = np.column_stack((robot.holes(tendon), np.zeros(len(at))))
        holes = step.positions[node] + np.einsum("kij,kj->ki", step.rotations[node], local)
        d = np.diff(holes, axis=0)
        length = np.linalg.norm(d, axis=1)
        e = d / length[:, None]
        sine = np.linalg.norm(np.cross(e[:-1], e[1:]), axis=1)
        found.append((length, np.arctan2(sine, np.sum(e[:-1] * e[1:], axis=1))))
    return found


def capstan_violation(robot: Robot, step: StepResult) -> float:
    """How far any ratio of tensions lies beyond ``exp(+- mu theta)`` (paper, Eq. 28); negative is within."""
    worst = -1.0
    for tendon, tension, (_, angle) in zip(robot.tendons, step.tensions, cables(robot, step), strict=True):
        if tension[0] > 0.0 and len(tension) > 1:
            excess = np.abs(np.log(tension[1:] / tension[:-1])) - tendon.friction_coefficient * angle
            worst = max(worst, float(np.max(excess)))
    return worst


class Ledger:
    """Energy balance over a sequence of fine load steps with inextensible tendons.

    Attributes
    ----------
    work, stored : float
        Of actuators and loads; in the backbone [J].
    dissipated : ndarray
        At every hole of every tendon [J], shape (n_holes,).
    """

    def __init__(self, result: SequenceResult, forces: np.ndarray) -> None:
        """``forces``: force at the tip after every step [N], shape (n_steps, 3)."""
        robot = result.robot
        first = _straight(robot, result.steps[0])
        steps = [first, *result.steps]
        force = np.concatenate((np.zeros((1, 3)), forces))
        shapes = [cables(robot, s) for s in steps]
        counts = [len(c[0]) - 1 for c in shapes[0]]
        self.work = 0.0
        self.dissipated = np.zeros(sum(counts))
        for (a, b), (fa, fb), (ca, cb) in zip(
            pairwise(steps), pairwise(force), pairwise(shapes), strict=True
        ):
            mean = 0.5 * (a.base_tensions + b.base_tensions)
            self.work += float(mean @ (b.displacements - a.displacements))
            self.work += float(0.5 * (fa + fb) @ (b.tip - a.tip))
            at = 0
            for i, count in enumerate(counts):
                drop = 0.5 * (a.tensions[i][:-1] - a.tensions[i][1:] + b.tensions[i][:-1] - b.tensions[i][1:])
                given = ca[i][0] - cb[i][0]
                passed = np.cumsum(given[::-1])[::-1][1:]
                self.dissipated[at : at + count] += drop * passed
                at += count
        self.stored = elastic_energy(robot, steps[-1])

    @property
    def gap(self) -> float:
        """Residual of the energy balance: work less stored and dissipated energy [J]."""
        return self.work - self.stored - float(np.sum(self.dissipated))


def _straight(robot: Robot, like: StepResult) -> StepResult:
    """The unloaded state."""
    n = len(like.s)
    return StepResult(
        0,
        "",
        True,
        0,
        1,
        like.s,
        np.column_stack((np.zeros((n, 2)), like.s)),
        np.broadcast_to(np.eye(3), (n, 3, 3)),
        np.zeros(len(robot.tendons)),
        np.zeros(len(robot.tendons)),
        tuple(np.zeros(len(t)) for t in like.tensions),
        like.hole_states,
    )


def random_cycles(
    robot: Robot, cycles: int, seed: int, tension: float = 2.0, force: float = 0.05
) -> list[LoadStep]:
    """Loading to random tensions on all tendons with a random force at the tip, and unloading to zero."""
    rng = np.random.default_rng(seed)
    steps = []
    for k in range(cycles):
        up = dict(
            zip(robot.tendon_names, rng.uniform(0.0, tension, len(robot.tendons)).tolist(), strict=True)
        )
        push = tuple(float(x) for x in rng.uniform(-force, force, 3))
        length = robot.backbone.length
        steps.append(LoadStep(f"load {k}", up, loads={"tip": Load(length, push)}))
        steps.append(LoadStep(f"unload {k}", dict.fromkeys(up, 0.0), loads={"tip": Load(length)}))
    return steps


def divide(robot: Robot, steps: list[LoadStep], parts: int) -> tuple[list[LoadStep], np.ndarray]:
    """Every step in equal parts, each a load step of its own; and the force at the tip after each [N]."""
    tension = dict.fromkeys(robot.tendon_names, 0.0)
    force = np.zeros(3)
    fine, forces = [], []
    for step in steps:
        goal = {**tension, **step.tensions}
        push = np.array(step.loads["tip"].force) if "tip" in step.loads else force
        for i in range(1, parts + 1):
            x = i / parts
            now = {n: (1 - x) * tension[n] + x * goal[n] for n in goal}
            forces.append((1 - x) * force + x * push)
            load = Load(robot.backbone.length, tuple(float(c) for c in forces[-1]))
            fine.append(LoadStep(step.label, now, loads={"tip": load}, substeps=1))
        tension, force = goal, push
    return fine, np.array(forces)
