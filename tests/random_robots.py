"""Random robots with friction at every hole, and histories of tensions and tip forces."""

from __future__ import annotations

import numpy as np

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import Load, LoadStep
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting
from tdcr_fe.model.tendon import Tendon


def random_robot(tendons, seed):
    """A robot with 5 to 8 disks, every routing, and tendons that may end before the tip."""
    draw = np.random.default_rng([tendons, seed])
    length, disks = float(draw.uniform(0.18, 0.3)), int(draw.integers(5, 9))
    found = []
    for i in range(tendons):
        angle, offset = (
            360.0 * i / tendons + float(draw.uniform(-20.0, 20.0)),
            float(draw.uniform(3e-3, 5e-3)),
        )
        routing = (
            ParallelRouting(offset, angle),
            HelicalRouting(offset, float(draw.uniform(-1.0, 1.0)), angle),
            ConvergingRouting(offset, 0.4 * offset, angle),
        )[int(draw.integers(3))]
        end = length if i == 0 or draw.random() < 0.7 else length * (disks - 1) / disks
        found.append(Tendon(f"t{i}", routing, float(draw.uniform(0.1, 0.5)), end=end))
    return Robot(Backbone(length, 0.4e-3, 85e9, 0.3), Disks.equally_spaced(disks, length), tuple(found))


def random_steps(robot, seed, count=3):
    """Tensions up and down, with a tip force that changes in every second step; below 30 % of a bay's buckling load."""
    draw = np.random.default_rng([seed, len(robot.tendons)])
    backbone = robot.backbone
    most = min(4.0, 0.3 * np.pi**2 * backbone.EI / (backbone.length / len(robot.disks.positions)) ** 2)
    steps = []
    for k in range(count):
        share = draw.uniform(0.0, 1.0, len(robot.tendons))
        tensions = share / max(1.0, share.sum()) * most
        force = backbone.EI / backbone.length**2 * draw.uniform(-1.5, 1.5, 3)
        loads = {"tip": Load(backbone.length, tuple(map(float, force)))} if k % 2 else {}
        steps.append(
            LoadStep(
                f"{k + 1}",
                {t.name: float(x) for t, x in zip(robot.tendons, tensions, strict=True)},
                loads=loads,
            )
        )
    return steps


def largest_gap(a, b):
    """By load step, the largest distance between two shapes over the length."""
    length = a.robot.backbone.length
    return np.array(
        [
            np.max(np.linalg.norm(x.positions - y.positions, axis=1)) / length
            for x, y in zip(a.steps, b.steps, strict=True)
        ]
    )
