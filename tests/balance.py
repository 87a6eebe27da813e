"""Lengths, angles and bounds of tendons in solved steps, by what the campaigns check; and random cycles."""

from __future__ import annotations

import numpy as np

from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.fuzz.checks import check_step
from tdcr_fe.validation.fuzz.state import State


def cables(robot: Robot, step: StepResult) -> list[tuple[np.ndarray, np.ndarray]]:
    """By tendon, lengths of the segments [m] and angles at the holes between them [rad]."""
    state = State.of(robot, Model(friction="none"), step)
    first, last = state.tendons.first, state.tendons.last
    angles = np.split(state.segments.angles, np.cumsum(last - first - 1)[:-1])
    return list(zip(np.split(state.lengths, last[:-1]), angles, strict=True))


def capstan_violation(robot: Robot, step: StepResult) -> float:
    """How far a tension lies beyond the bounds of friction (paper, Eq. 28), over the largest one."""
    return check_step(robot, Model(), step)["Capstan bounds"]


def random_cycles(robot: Robot, cycles: int, seed: int) -> list[LoadStep]:
    """Loading to random tensions up to 2 N with a random force at the tip up to 50 mN, and unloading to zero."""
    rng = np.random.default_rng(seed)
    steps, length = [], robot.backbone.length
    for k in range(cycles):
        up = dict(zip(robot.tendon_names, rng.uniform(0.0, 2.0, len(robot.tendons)).tolist(), strict=True))
        push = Load(length, tuple(rng.uniform(-0.05, 0.05, 3).tolist()))
        steps.append(LoadStep(f"load {k}", up, loads={"tip": push}))
        steps.append(LoadStep(f"unload {k}", dict.fromkeys(up, 0.0), loads={"tip": Load(length)}))
    return steps
