"""Lengths and angles of tendons in solved steps, by what the campaigns check."""

import numpy as np

from tdcr_fe import Model, Robot, StepResult
from tdcr_fe.validation.fuzz.state import State


def cables(robot: Robot, step: StepResult) -> list[tuple[np.ndarray, np.ndarray]]:
    """By tendon, lengths of the segments [m] and angles at the holes between them [rad]."""
    state = State.of(robot, Model(friction="none"), step)
    first, last = state.tendons.first, state.tendons.last
    angles = np.split(state.segments.angles, np.cumsum(last - first - 1)[:-1])
    return list(zip(np.split(state.lengths, last[:-1]), angles, strict=True))
