"""Random robots of one to six tendons with their loading histories, drawn by a seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting, Routing
from tdcr_fe.model.tendon import Tendon

#: Largest number of tendons.
MOST_TENDONS = 6
#: Stiffness EA of elastic tendons [N].
AXIAL_STIFFNESS = 400.0
#: All tensions together stay below this [N], and below this share of the buckling load of a bay.
MOST_TENSION, MOST_COMPRESSION = 4.0, 0.3


@dataclass(frozen=True)
class RandomCase:
    """One robot and its history."""

    number: int  # seed
    robot: Robot
    model: Model
    steps: tuple[LoadStep, ...]

    @property
    def by_displacement(self) -> bool:
        """Whether the tendons are driven by displacement."""
        return any(step.displacements for step in self.steps)


def draw(number: int) -> RandomCase:
    """A robot with friction at every hole, and three to five load steps.

    One to six tendons in turn (by the seed), of parallel, helical and converging routing and of two segments; a third
    of the robots is driven by displacement, half of these with elastic tendons. A force at the tip in every second
    step; gravity in a third of the robots.

    Parameters
    ----------
    number
        Seed.
    """
    rng = np.random.default_rng([11, number])
    length, disks = float(rng.uniform(0.15, 0.3)), int(rng.integers(4, 14))
    backbone = Backbone(length, float(rng.uniform(0.3e-3, 0.5e-3)), 85e9, 0.3, density=5600.0)
    drive = rng.choice(["tension", "tension", "displacement", "elastic"], p=[0.34, 0.33, 0.165, 0.165])
    tendons = _tendons(
        rng, 1 + number % MOST_TENDONS, length, disks, AXIAL_STIFFNESS if drive == "elastic" else None
    )
    robot = Robot(
        backbone,
        Disks.equally_spaced(disks, length, mass=0.2e-3, radius=6e-3),
        tendons,
        name=f"random-{number}",
    )
    gravity = tuple(float(x) for x in rng.uniform(-6.0, 6.0, 3)) if rng.random() < 1 / 3 else (0.0, 0.0, 0.0)
    steps = _steps(rng, robot, by_displacement=drive != "tension")
    return RandomCase(number, robot, Model(gravity=gravity), steps)  # type: ignore[arg-type]


def _tendons(
    rng: np.random.Generator, count: int, length: float, disks: int, axial_stiffness: float | None
) -> tuple[Tendon, ...]:
    """Tendons about the backbone; beyond the first, three in ten end before the tip."""
    found = []
    for i in range(count):
        angle = 360.0 * i / count + float(rng.uniform(-20.0, 20.0))
        offset = float(rng.uniform(3e-3, 5e-3))
        routings: tuple[Routing, ...] = (
            ParallelRouting(offset, angle),
            HelicalRouting(offset, float(rng.uniform(-1.0, 1.0)), angle),
            ConvergingRouting(offset, 0.4 * offset, angle),
        )
        last = disks if i == 0 or rng.random() < 0.7 else int(rng.integers(disks // 2, disks))
        found.append(
            Tendon(
                f"t{i + 1}",
                routings[int(rng.integers(3))],
                float(rng.uniform(0.05, 0.5)),
                end=length * last / disks,
                axial_stiffness=axial_stiffness,
            )
        )
    return tuple(found)


def _steps(rng: np.random.Generator, robot: Robot, *, by_displacement: bool) -> tuple[LoadStep, ...]:
    """Inputs up and down, with a force at the tip in every second step."""
    backbone, names = robot.backbone, robot.tendon_names
    bay = backbone.length / len(robot.disks.positions)
    most = min(MOST_TENSION, MOST_COMPRESSION * np.pi**2 * backbone.EI / bay**2)
    steps = []
    for k in range(int(rng.integers(3, 6))):
        force = backbone.EI / backbone.length**2 * rng.uniform(-1.2, 1.2, 3)
        loads = {"tip": Load(backbone.length, tuple(force.tolist()))} if k % 2 else {}
        if by_displacement:
            pulled = _displacements(rng, robot)
            steps.append(LoadStep(f"{k + 1}", displacements=pulled, loads=loads))
        else:
            share = rng.uniform(0.0, 1.0, len(names))
            tensions = (share / max(1.0, float(share.sum())) * most).tolist()
            steps.append(LoadStep(f"{k + 1}", dict(zip(names, tensions, strict=True)), loads=loads))
    return tuple(steps)


def _displacements(rng: np.random.Generator, robot: Robot) -> dict[str, float]:
    """What parallel tendons are pulled in by in a circular arc, less up to 0.5 mm [m]."""
    bend, plane = rng.uniform(0.0, 1.5), rng.uniform(0.0, 2.0 * np.pi)
    found = {}
    for tendon in robot.tendons:
        x, y = robot.hole_points(tendon)[0, :2]
        share = robot.end(tendon) / robot.backbone.length
        arc = bend * share * (x * np.cos(plane) + y * np.sin(plane))
        found[tendon.name] = float(arc - rng.uniform(0.0, 0.5e-3))
    return found
