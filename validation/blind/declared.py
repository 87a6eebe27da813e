"""Draw what is declared: a robot, and a loading sequence of a careful experimenter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import Load, LoadStep
from tdcr_fe.model.robot import Disks, Robot, Tendon
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting, PointsRouting, Routing
from tdcr_fe.validation.blind.recipes import Drive

#: Slack given to tendons that are not pulled, beyond that needed for the bending [m].
_LET_OUT = 2e-3
#: Longest loading sequence; what is drawn beyond it is cut off.
_MOST_STEPS = 40
_NO_FORCE = (0.0, 0.0, 0.0)


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
        parts = (("a", 0.0, disks.positions[count // 2 - 1]), ("b", 60.0, None))
        rows = [(f"{name}{k + 1}", x + turn, end) for name, turn, end in parts for k, x in enumerate(angles)]
        tendons = [Tendon(name, ParallelRouting(offset, angle), mu, end=end) for name, angle, end in rows]
        return Robot(backbone, disks, tuple(tendons), name=kind)
    routing = str(rng.choice(["parallel", "helical", "converging", "points"])) if kind == "single" else kind
    # The same numbers are drawn for every kind of routing.
    turns = round(float(rng.choice([-1, 1]) * rng.uniform(0.2, 0.6)), 2)
    end_offset = round(float(rng.uniform(0.35, 0.7)) * offset, 5)
    bulge = float(rng.uniform(0.1, 0.3))
    routes: dict[str, list[Routing]] = {
        "parallel": [ParallelRouting(offset, a) for a in angles],
        "helical": [HelicalRouting(offset, turns, a) for a in angles],
        "converging": [ConvergingRouting(offset, end_offset, a) for a in angles],
        "points": [_wavy(offset, a, bulge, (0.0, *disks.positions)) for a in angles],
    }
    tendons = [Tendon(f"t{k + 1}", route, mu) for k, route in enumerate(routes[routing])]
    return Robot(backbone, disks, tuple(tendons), name=f"{len(tendons)} {routing}")


def _wavy(offset: float, angle: float, bulge: float, at: tuple[float, ...]) -> PointsRouting:
    """Holes nearer to the backbone in the middle by a fraction ``bulge``, and swinging 0.4 rad to both sides."""
    share = np.array(at) / at[-1]
    r = offset * (1.0 - bulge * np.sin(np.pi * share))
    turn = np.deg2rad(angle) + 0.4 * np.sin(2.0 * np.pi * share)
    points = zip((r * np.cos(turn)).tolist(), (r * np.sin(turn)).tolist(), strict=True)
    return PointsRouting(at, tuple((round(x, 6), round(y, 6)) for x, y in points))


def largest_commands(robot: Robot, drive: Drive, bend: float) -> dict[str, float]:
    """Tension [N] or displacement [m] of each tendon that bends its part of the robot by about ``bend`` [rad]."""
    result = {}
    for tendon in robot.tendons:
        lever = float(np.mean(np.hypot(*robot.holes(tendon).T)))
        tension = bend * robot.backbone.EI / (lever * robot.end(tendon))
        result[tendon.name] = lever * bend if drive == "displacement" else tension
    return result


class _Sequence:
    """Builder of a loading sequence that bends the robot by 0.7 to 1.6 rad.

    It has the largest commands, tension at rest and size of tip forces; the present commands of all tendons and tip
    force; and the steps so far.
    """

    def __init__(self, robot: Robot, drive: Drive, rng: np.random.Generator) -> None:
        self.rng, self.names, self.length = rng, robot.tendon_names, robot.backbone.length
        self.by_displacement = drive == "displacement"
        self.two_segments = any(t.end is not None for t in robot.tendons)
        bend = float(rng.uniform(0.7, 1.0) if self.two_segments else rng.uniform(1.0, 1.6))
        self.highest = largest_commands(robot, drive, bend)  # tension [N] or displacement [m]
        #: Size of the forces across the tip [N].
        self.size = float(rng.uniform(0.15, 0.35)) * 2.0 * robot.backbone.EI / self.length**2
        #: Tension of a tendon that is not pulled [N].
        self.rest = 0.0
        if not self.by_displacement:
            self.rest = round(float(rng.choice([0.0, 0.05])) * min(self.highest.values()), 3)
        self.values, self.force = dict.fromkeys(self.names, self.rest), _NO_FORCE
        self.steps: list[LoadStep] = []
        self.branches: list[str] = []

    def add(self, branch: str) -> None:
        """Add a step with the present commands."""
        kept = {n: round(v, 7) for n, v in self.values.items()}
        tensions, displacements = ({}, kept) if self.by_displacement else (kept, {})
        loads = {"tip": Load(self.length, self.force)}
        self.steps.append(LoadStep(str(len(self.steps) + 1), tensions, displacements, loads))
        self.branches.append(branch)

    def pull(self, name: str, fraction: float) -> dict[str, float]:
        """Commands that pull one tendon to a fraction of its largest input."""
        value = self.rest + fraction * (self.highest[name] - self.rest)
        if not self.by_displacement:
            return {name: value}
        # tendons that are not pulled are let out by more than the bending requires
        return {n: value if n == name else -(0.7 * value + _LET_OUT) for n in self.names}

    def command(self, goal: dict[str, float], count: int, branch: str) -> None:
        """Change commands linearly in so many steps."""
        start = dict(self.values)
        for k in range(1, count + 1):
            for name, value in goal.items():
                self.values[name] = start[name] + (value - start[name]) * k / count
            self.add(branch)

    def push(self, size: float = 1.0) -> None:
        """A tip force in one of twelve directions across the robot, sometimes with a part along it."""
        angle = float(self.rng.integers(0, 12)) * np.pi / 6.0
        along = float(self.rng.choice([0.0, 0.0, 0.4, -0.3]))
        force = size * self.size
        x, y, z = (round(float(force * f), 5) for f in (np.cos(angle), np.sin(angle), along))
        self.force = (x, y, z)
        self.add("tip force")

    def let_go(self) -> None:
        """No tip force."""
        self.force = _NO_FORCE
        self.add("tip force off")

    def order(self) -> list[str]:
        """Order in which tendons are pulled; of two segments two tendons each, in turn."""
        order = [str(n) for n in self.rng.permutation(self.names)]
        if self.two_segments:
            by_segment = [[n for n in order if n.startswith(segment)][:2] for segment in "ab"]
            order = [name for pair in zip(*by_segment, strict=True) for name in pair]
        return order

    def cycles(self, cycles: Sequence[str]) -> None:
        """Pull and release of one tendon after another, every second time with tip forces in between."""
        rng, two = self.rng, self.two_segments
        fine = 4 if len(cycles) <= 3 else 3
        for k, (name, following) in enumerate(zip(cycles, [*cycles[1:], None], strict=True)):
            self.command(self.pull(name, float(rng.uniform(0.8, 1.0))), fine, f"pull {name}")
            if k % 2 == 0:
                self.push()
                if rng.random() < 0.5:
                    self.push()
            low = float(rng.uniform(0.2, 0.45))
            self.command(self.pull(name, low), 2 if two else 3, f"release {name}")
            if k % 2 == 0:
                self.let_go()
            if k == 0 and not two:
                self.command(self.pull(name, 0.7), 2, f"pull {name} again")
            if self.by_displacement or following is None or two:
                self.command(self.pull(name, 0.0), 1, f"release {name}")
            elif following != name:
                goal = {**self.pull(name, 0.0), **self.pull(following, 0.25)}
                self.command(goal, 2, f"{name} to {following}")


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
    sequence = _Sequence(robot, drive, rng)
    sequence.add("start")
    if rng.random() < 0.7:
        sequence.push(0.6)
        sequence.let_go()
    order = sequence.order()
    sequence.cycles(order if len(order) > 1 else order * 3)
    if drive == "tension" and len(order) > 1:
        a, b = order[:2]
        sequence.command({**sequence.pull(a, 0.55), **sequence.pull(b, 0.45)}, 2, f"pull {a} and {b}")
        sequence.command({**sequence.pull(a, 0.0), **sequence.pull(b, 0.0)}, 2, f"release {a} and {b}")
    steps = sequence.steps[:_MOST_STEPS]
    if timed:  # growing by 10 to 40 s a step on average
        pace, now = float(rng.uniform(10.0, 40.0)), 0.0
        for k, step in enumerate(steps):
            now += round(pace * float(rng.uniform(0.6, 1.6)), 1)
            steps[k] = replace(step, time=round(now, 1))
    return tuple(steps), tuple(sequence.branches[:_MOST_STEPS])
