"""Draw a random robot and a loading sequence such as a careful experimenter would use."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tdcr_fe.model.loading import Load, LoadStep
from tdcr_fe.model.robot import Backbone, Disks, Robot, Tendon
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting, PointsRouting, Routing
from tdcr_fe.validation.blind.recipes import Drive

#: Slack given to tendons that are not pulled, beyond that needed for the bending [m].
_LET_OUT = 2e-3


def draw_robot(kind: str, rng: np.random.Generator) -> Robot:
    """A robot of a kind of `tdcr_fe.validation.blind.recipes.ROBOTS`, its size drawn.

    Parameters
    ----------
    kind
        One tendon, three of one routing, or two segments.
    rng
        Draws length 0.15 to 0.4 m, 8 to 16 disks, the stiffness, offsets and friction 0.05 to 0.3.
    """
    length = round(float(rng.uniform(0.15, 0.4)), 3)
    radius = round(float(rng.uniform(0.35e-3, 0.6e-3)), 5)
    backbone = Backbone(length, radius, float(round(rng.uniform(50.0, 90.0)) * 1e9), 0.3, 6450.0)
    count = int(rng.integers(8, 17))
    if kind == "two-segment":
        count += count % 2
    disks = Disks.equally_spaced(count, length, mass=round(float(rng.uniform(1e-4, 5e-4)), 5), radius=7e-3)
    mu = round(float(rng.uniform(0.05, 0.3)), 3)
    offset = round(float(rng.uniform(3.5e-3, 6e-3)), 4)
    first = float(rng.integers(0, 12) * 10)
    angles = [first] if kind == "single" else [first + 120.0 * k for k in range(3)]
    if kind == "two-segment":
        middle = disks.positions[count // 2 - 1]
        tendons = [
            Tendon(f"a{k + 1}", ParallelRouting(offset, a), mu, end=middle) for k, a in enumerate(angles)
        ]
        tendons += [Tendon(f"b{k + 1}", ParallelRouting(offset, a + 60.0), mu) for k, a in enumerate(angles)]
        return Robot(backbone, disks, tuple(tendons), name=kind)
    routing = str(rng.choice(["parallel", "helical", "converging", "points"])) if kind == "single" else kind
    turns = round(float(rng.choice([-1, 1]) * rng.uniform(0.2, 0.6)), 2)
    end_offset = round(float(rng.uniform(0.35, 0.7)) * offset, 5)
    bulge = float(rng.uniform(0.1, 0.3))
    places = (0.0, *disks.positions)

    def route(angle: float) -> Routing:
        if routing == "parallel":
            return ParallelRouting(offset, angle)
        if routing == "helical":
            return HelicalRouting(offset, turns, angle)
        if routing == "converging":
            return ConvergingRouting(offset, end_offset, angle)
        size = [offset * (1.0 - bulge * np.sin(np.pi * s / length)) for s in places]
        turn = [np.deg2rad(angle) + 0.4 * np.sin(2.0 * np.pi * s / length) for s in places]
        holes = tuple(
            (round(float(r * np.cos(a)), 6), round(float(r * np.sin(a)), 6))
            for r, a in zip(size, turn, strict=True)
        )
        return PointsRouting(places, holes)

    tendons = [Tendon(f"t{k + 1}", route(a), mu) for k, a in enumerate(angles)]
    return Robot(backbone, disks, tuple(tendons), name=f"{len(tendons)} {routing}")


@dataclass
class _Course:
    """Builder of a loading sequence: commands of all tendons and the tip force."""

    names: tuple[str, ...]
    by_displacement: bool
    length: float
    values: dict[str, float] = field(default_factory=dict)
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    steps: list[LoadStep] = field(default_factory=list)
    branches: list[str] = field(default_factory=list)

    def mark(self, branch: str) -> None:
        """Add a step with the current commands."""
        kept = {n: round(v, 7) for n, v in self.values.items()}
        self.steps.append(
            LoadStep(
                label=str(len(self.steps) + 1),
                tensions={} if self.by_displacement else kept,
                displacements=kept if self.by_displacement else {},
                loads={"tip": Load(self.length, self.force)},
            )
        )
        self.branches.append(branch)

    def go(self, goal: dict[str, float], count: int, branch: str) -> None:
        """Change commands linearly in so many steps."""
        start = dict(self.values)
        for k in range(1, count + 1):
            for name, value in goal.items():
                self.values[name] = start[name] + (value - start[name]) * k / count
            self.mark(branch)

    def push(self, force: tuple[float, float, float], branch: str = "tip force") -> None:
        """Change the tip force in one step."""
        self.force = force
        self.mark(branch)


def largest_commands(robot: Robot, drive: Drive, bend: float) -> dict[str, float]:
    """Tension [N] or displacement [m] of each tendon that bends its part of the robot by about ``bend`` [rad]."""
    result = {}
    for tendon in robot.tendons:
        lever = float(np.mean(np.hypot(*robot.holes(tendon).T)))
        part = robot.end(tendon)
        result[tendon.name] = (
            lever * bend if drive == "displacement" else bend * robot.backbone.EI / (lever * part)
        )
    return result


def draw_loading(
    robot: Robot, drive: Drive, timed: bool, rng: np.random.Generator
) -> tuple[tuple[LoadStep, ...], tuple[str, ...]]:
    """A loading sequence: pulls and releases of each tendon, tip forces, reversals; 25 to 40 steps.

    Parameters
    ----------
    robot
        As declared.
    drive
        Tendons are driven by tension, with some pretension, or by displacement; those that are not pulled
        are then let out.
    timed
        Whether the steps have times.
    rng
        Draws it.

    Returns
    -------
    steps : tuple of LoadStep
    branches : tuple of str
        Label of each step.
    """
    names, pulled_in = robot.tendon_names, drive == "displacement"
    two = any(t.end is not None for t in robot.tendons)
    bend = float(rng.uniform(0.7, 1.0) if two else rng.uniform(1.0, 1.6))
    top = largest_commands(robot, drive, bend)
    length = robot.backbone.length
    push = float(rng.uniform(0.15, 0.35)) * 2.0 * robot.backbone.EI / length**2
    rest = 0.0 if pulled_in else round(float(rng.choice([0.0, 0.05])) * min(top.values()), 3)
    course = _Course(names, pulled_in, length, dict.fromkeys(names, rest))

    def goal(name: str, share: float) -> dict[str, float]:
        value = rest + share * (top[name] - rest)
        if not pulled_in:
            return {name: value}
        # tendons that are not pulled are let out by more than the bending requires
        return {n: value if n == name else -(0.7 * value + _LET_OUT) for n in names}

    def sideways(size: float = 1.0) -> tuple[float, float, float]:
        angle = float(rng.integers(0, 12)) * np.pi / 6.0
        down = float(rng.choice([0.0, 0.0, 0.4, -0.3]))
        x, y = size * push * np.cos(angle), size * push * np.sin(angle)
        return round(float(x), 5), round(float(y), 5), round(float(size * push * down), 5)

    nothing = (0.0, 0.0, 0.0)
    course.mark("start")
    if rng.random() < 0.7:
        course.push(sideways(0.6))
        course.push(nothing, "tip force off")
    order = [str(n) for n in rng.permutation(names)]
    if two:
        order = [
            n
            for pair in zip(*(([n for n in order if n.startswith(x)])[:2] for x in "ab"), strict=True)
            for n in pair
        ]
    cycles = order if len(order) > 1 else order * 3
    fine = 4 if len(cycles) <= 3 else 3
    for k, name in enumerate(cycles):
        high = float(rng.uniform(0.8, 1.0))
        course.go(goal(name, high), fine, f"pull {name}")
        if k % 2 == 0:
            course.push(sideways())
            if rng.random() < 0.5:
                course.push(sideways())
        low = float(rng.uniform(0.2, 0.45))
        course.go(goal(name, low), 2 if two else 3, f"release {name}")
        if k % 2 == 0:
            course.push(nothing, "tip force off")
        if k == 0 and not two:
            course.go(goal(name, 0.7), 2, f"pull {name} again")
        follows = cycles[k + 1] if k + 1 < len(cycles) else None
        if pulled_in or follows is None or two:
            course.go(goal(name, 0.0), 1, f"release {name}")
        else:
            course.go(
                {**goal(name, 0.0), **goal(follows, 0.25)}, 2, f"{name} to {follows}"
            ) if follows != name else None
    if not pulled_in and len(names) > 1:
        a, b = order[0], order[1]
        course.go({**goal(a, 0.55), **goal(b, 0.45)}, 2, f"pull {a} and {b}")
        course.go({**goal(a, 0.0), **goal(b, 0.0)}, 2, f"release {a} and {b}")
    steps = course.steps[:40]
    if timed:
        pace, now, timed_steps = float(rng.uniform(10.0, 40.0)), 0.0, []
        for step in steps:
            now += round(pace * float(rng.uniform(0.6, 1.6)), 1)
            timed_steps.append(
                LoadStep(step.label, step.tensions, step.displacements, step.loads, time=round(now, 1))
            )
        steps = timed_steps
    return tuple(steps), tuple(course.branches[:40])
