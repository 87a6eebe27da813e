"""Random robots of one to six tendons with their loading histories, drawn by a seed."""

from __future__ import annotations

import numpy as np

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot, Tendon
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting, Routing
from tdcr_fe.validation.drawing import Draw, RandomCase

#: Largest number of tendons.
MOST_TENDONS = 6
#: Stiffness EA of elastic tendons [N].
AXIAL_STIFFNESS = 400.0
#: All tensions together stay below this [N], and below this share of the buckling load of a bay.
MOST_TENSION, MOST_COMPRESSION = 4.0, 0.3


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
    d = Draw(np.random.default_rng([11, number]))
    length, disks = d.number(0.15, 0.3), int(d.rng.integers(4, 14))
    backbone = Backbone(length, d.number(0.3e-3, 0.5e-3), 85e9, 0.3, density=5600.0)
    drive = d.one(["tension", "tension", "displacement", "elastic"], [0.34, 0.33, 0.165, 0.165])
    count, stiffness = 1 + number % MOST_TENDONS, AXIAL_STIFFNESS if drive == "elastic" else None
    tendons = []
    for i in range(count):
        angle, offset = 360.0 * i / count + d.number(-20.0, 20.0), d.number(3e-3, 5e-3)
        routings: tuple[Routing, ...] = (
            ParallelRouting(offset, angle),
            HelicalRouting(offset, d.number(-1.0, 1.0), angle),
            ConvergingRouting(offset, 0.4 * offset, angle),
        )
        last = disks if i == 0 or d.chance(0.7) else int(d.rng.integers(disks // 2, disks))
        routing, mu = routings[int(d.rng.integers(3))], d.number(0.05, 0.5)
        tendons.append(Tendon(f"t{i + 1}", routing, mu, end=length * last / disks, axial_stiffness=stiffness))
    equal = Disks.equally_spaced(disks, length, mass=0.2e-3, radius=6e-3)
    robot = Robot(backbone, equal, tuple(tendons), name=f"random-{number}")
    x, y, z = d.numbers(-6.0, 6.0, 3) if d.chance(1 / 3) else (0.0, 0.0, 0.0)
    steps = _steps(d, robot, by_displacement=drive != "tension")
    return RandomCase(number, robot, Model(gravity=(x, y, z)), steps)


def _steps(d: Draw, robot: Robot, *, by_displacement: bool) -> tuple[LoadStep, ...]:
    """Inputs up and down, with a force at the tip in every second step."""
    backbone, names = robot.backbone, robot.tendon_names
    bay = backbone.length / len(robot.disks.positions)
    most = min(MOST_TENSION, MOST_COMPRESSION * np.pi**2 * backbone.EI / bay**2)
    steps = []
    for k in range(int(d.rng.integers(3, 6))):
        force = backbone.EI / backbone.length**2 * d.rng.uniform(-1.2, 1.2, 3)
        loads = {"tip": Load(backbone.length, tuple(force.tolist()))} if k % 2 else {}
        if by_displacement:
            steps.append(LoadStep(f"{k + 1}", displacements=_displacements(d, robot), loads=loads))
        else:
            tensions = (d.shares(len(names)) * most).tolist()
            steps.append(LoadStep(f"{k + 1}", dict(zip(names, tensions, strict=True)), loads=loads))
    return tuple(steps)


def _displacements(d: Draw, robot: Robot) -> dict[str, float]:
    """What parallel tendons are pulled in by in a circular arc, less up to 0.5 mm [m]."""
    bend, plane = d.number(0.0, 1.5), d.number(0.0, 2.0 * np.pi)
    found = {}
    for tendon in robot.tendons:
        x, y = robot.hole_points(tendon)[0, :2]
        share = robot.end(tendon) / robot.backbone.length
        arc = bend * share * (x * np.cos(plane) + y * np.sin(plane))
        found[tendon.name] = float(arc - d.number(0.0, 0.5e-3))
    return found
