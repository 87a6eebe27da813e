"""Geometry for pictures of a run: backbone curves, rims of disks, lines of tendons, loads, in metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.model.tendon import Tendon

Array = NDArray[np.float64]

#: Number of steps drawn with disks, tendons and loads; the others are drawn as a thin backbone.
DETAILED_STEPS = 6
#: Largest number of steps drawn, spread over the sequence, the first and the last among them.
DRAWN_STEPS = 60
#: A tendon is slack where its tension is below this part of the largest tension of the run [1].
SLACK = 1e-6


def spread(count: int, at_most: int) -> list[int]:
    """Indices spread evenly over ``count`` steps, first and last among them."""
    return sorted({int(k) for k in np.linspace(0, count - 1, min(count, at_most)).round()})


def distinct_steps(result: SequenceResult) -> list[int]:
    """Indices of steps whose tips lie apart from each other: the most bent, the last, then always the farthest."""
    tips = result.tips
    chosen = [int(np.argmax(result.bending_angles)), len(tips) - 1]
    gap = np.min(np.linalg.norm(tips[:, None] - tips[chosen], axis=2), axis=1)
    while len(chosen) < min(DETAILED_STEPS, len(tips)):
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(tips - tips[chosen[-1]], axis=1))
    return sorted(set(chosen))


def poses(step: StepResult, s: Array) -> tuple[Array, Array]:
    """Positions [m], shape (n, 3), and rotations of the sections, shape (n, 3, 3), at arc lengths ``s`` [m]."""
    s = np.clip(np.asarray(s, dtype=float), step.s[0], step.s[-1])
    rotations = Slerp(step.s, Rotation.from_matrix(step.rotations))(s).as_matrix()
    return step.position_at(s), rotations


def backbone(result: SequenceResult, step: StepResult, per_bay: int = 8) -> Array:
    """A smooth curve along the backbone [m], shape (m, 3)."""
    n = max(per_bay * len(result.robot.bay_ends), 60)
    return step.position_at(np.linspace(step.s[0], step.s[-1], n))


def rims(result: SequenceResult, step: StepResult, points: int = 25) -> Array:
    """Rims of base plate and disks [m], shape (n_disks + 1, points, 3)."""
    position, rotation = poses(step, np.array([0.0, *result.robot.disks.positions]))
    around = np.linspace(0.0, 2.0 * np.pi, points)
    rim = result.robot.plate_radius * np.stack((np.cos(around), np.sin(around)), axis=-1)
    return np.asarray(position[:, None, :] + np.einsum("nij,pj->npi", rotation[:, :, :2], rim))


def tendon_line(result: SequenceResult, step: StepResult, tendon: Tendon) -> Array:
    """The tendon from the base plate to its anchor [m], shape (m, 3)."""
    robot = result.robot
    end = robot.end(tendon)
    if result.model.tendon_path == "continuous":
        s = np.linspace(0.0, end, 120)
    else:
        s = robot.hole_arc_lengths(tendon)
    position, rotation = poses(step, s)
    return position + np.einsum("nij,nj->ni", rotation[:, :, :2], tendon.routing.position(s, end))


def box(result: SequenceResult, drawn: Sequence[int]) -> Array:
    """World box around everything drawn, none of its sides slim [m], shape (3, 2)."""
    points = np.concatenate([backbone(result, result.steps[k]) for k in drawn])
    around = 2.0 * result.robot.plate_radius
    low = np.minimum(points.min(axis=0), 0.0) - around
    high = np.maximum(points.max(axis=0), 0.0) + around
    slim = np.maximum(0.45 * (high - low).max() - (high - low), 0.0) / 2.0
    return np.stack((low - slim, high + slim), axis=1)


def slack(result: SequenceResult, step: StepResult) -> list[NDArray[np.bool_]]:
    """By tendon, whether each of its segments carries no tension."""
    largest = max((float(np.max(t, initial=0.0)) for s in result.steps for t in s.tensions), default=0.0)
    return [t <= SLACK * largest for t in step.tensions]


@dataclass(frozen=True)
class LoadVector:
    """A force or moment of one step, in the world frame."""

    at: Array  # where it acts [m], shape (3,)
    vector: Array  # [N] or [N m], shape (3,)
    moment: bool  # whether it is a moment


def load_vectors(step: StepResult) -> list[LoadVector]:
    """Forces and moments that act at the end of a step; none where the result does not contain them."""
    found = []
    for load in (step.actuation.loads if step.actuation is not None else {}).values():
        position, rotation = poses(step, np.array([load.at]))
        for value, moment in ((np.array(load.force), False), (np.array(load.moment), True)):
            if np.any(value):
                turned = rotation[0] @ value if load.frame == "section" else value
                found.append(LoadVector(position[0], turned, moment))
    return found
