"""Draw what is declared: a robot, a loading sequence of a careful experimenter, markers and readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Experiment
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.channels import channel
from tdcr_fe.model.loading import Load, LoadStep
from tdcr_fe.model.observed_step import ObservedStep
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting, PointsRouting, Routing
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.validation.blind.recipes import Drive


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
        return Robot(backbone, disks, _two_segments(disks, offset, angles, mu), name=kind)
    routing = str(rng.choice(["parallel", "helical", "converging", "points"])) if kind == "single" else kind
    routes = _draw_routes(routing, offset, angles, length, (0.0, *disks.positions), rng)
    tendons = tuple(Tendon(f"t{k + 1}", route, mu) for k, route in enumerate(routes))
    return Robot(backbone, disks, tendons, name=f"{len(tendons)} {routing}")


def _two_segments(disks: Disks, offset: float, angles: list[float], mu: float) -> tuple[Tendon, ...]:
    """Tendons a1, a2, ... up to the middle disk, and b1, b2, ... up to the tip, turned by 60 degrees."""
    middle = disks.positions[len(disks.positions) // 2 - 1]
    return (
        *(Tendon(f"a{k + 1}", ParallelRouting(offset, a), mu, end=middle) for k, a in enumerate(angles)),
        *(Tendon(f"b{k + 1}", ParallelRouting(offset, a + 60.0), mu) for k, a in enumerate(angles)),
    )


def _draw_routes(
    routing: str,
    offset: float,
    angles: list[float],
    length: float,
    holes_at: tuple[float, ...],
    rng: np.random.Generator,
) -> list[Routing]:
    """Routing at every angle [deg]. The same numbers are drawn for every kind of routing."""
    turns = round(float(rng.choice([-1, 1]) * rng.uniform(0.2, 0.6)), 2)
    end_offset = round(float(rng.uniform(0.35, 0.7)) * offset, 5)
    bulge = float(rng.uniform(0.1, 0.3))
    if routing == "parallel":
        return [ParallelRouting(offset, a) for a in angles]
    if routing == "helical":
        return [HelicalRouting(offset, turns, a) for a in angles]
    if routing == "converging":
        return [ConvergingRouting(offset, end_offset, a) for a in angles]
    return [_wavy_route(offset, a, bulge, length, holes_at) for a in angles]


def _wavy_route(
    offset: float, angle: float, bulge: float, length: float, holes_at: tuple[float, ...]
) -> PointsRouting:
    """Holes nearer to the backbone in the middle by a fraction ``bulge``, and swinging 0.4 rad to both sides."""
    size = [offset * (1.0 - bulge * np.sin(np.pi * s / length)) for s in holes_at]
    turn = [np.deg2rad(angle) + 0.4 * np.sin(2.0 * np.pi * s / length) for s in holes_at]
    holes = tuple(
        (round(float(r * np.cos(a)), 6), round(float(r * np.sin(a)), 6))
        for r, a in zip(size, turn, strict=True)
    )
    return PointsRouting(holes_at, holes)


#: Slack given to tendons that are not pulled, beyond that needed for the bending [m].
_LET_OUT = 2e-3

#: Longest loading sequence; what is drawn beyond it is cut off.
_MOST_STEPS = 40

_NO_FORCE = (0.0, 0.0, 0.0)


def largest_commands(robot: Robot, drive: Drive, bend: float) -> dict[str, float]:
    """Tension [N] or displacement [m] of each tendon that bends its part of the robot by about ``bend`` [rad]."""
    result = {}
    for tendon in robot.tendons:
        lever = float(np.mean(np.hypot(*robot.holes(tendon).T)))
        tension = bend * robot.backbone.EI / (lever * robot.end(tendon))
        result[tendon.name] = lever * bend if drive == "displacement" else tension
    return result


@dataclass(frozen=True)
class _Inputs:
    """Largest inputs of one loading sequence.

    Attributes
    ----------
    names : tuple of str
        Tendons.
    by_displacement : bool
    two_segments : bool
    highest : dict
        Largest tension [N] or displacement [m] of each tendon.
    rest : float
        Tension of a tendon that is not pulled [N]; zero where displacements are prescribed.
    tip_force : float
        Size of the forces across the tip [N].
    """

    names: tuple[str, ...]
    by_displacement: bool
    two_segments: bool
    highest: dict[str, float]
    rest: float
    tip_force: float

    @classmethod
    def draw(cls, robot: Robot, drive: Drive, rng: np.random.Generator) -> _Inputs:
        """Inputs that bend the robot by 0.7 to 1.6 rad."""
        by_displacement = drive == "displacement"
        two_segments = any(t.end is not None for t in robot.tendons)
        bend = float(rng.uniform(0.7, 1.0) if two_segments else rng.uniform(1.0, 1.6))
        highest = largest_commands(robot, drive, bend)
        force = float(rng.uniform(0.15, 0.35)) * 2.0 * robot.backbone.EI / robot.backbone.length**2
        rest = 0.0 if by_displacement else round(float(rng.choice([0.0, 0.05])) * min(highest.values()), 3)
        return cls(tuple(robot.tendon_names), by_displacement, two_segments, highest, rest, force)

    def pull(self, name: str, fraction: float) -> dict[str, float]:
        """Commands that pull one tendon to a fraction of its largest input."""
        value = self.rest + fraction * (self.highest[name] - self.rest)
        if not self.by_displacement:
            return {name: value}
        # tendons that are not pulled are let out by more than the bending requires
        return {n: value if n == name else -(0.7 * value + _LET_OUT) for n in self.names}

    def draw_force(self, rng: np.random.Generator, size: float = 1.0) -> tuple[float, float, float]:
        """A tip force in one of twelve directions across the robot, sometimes with a part along it [N]."""
        angle = float(rng.integers(0, 12)) * np.pi / 6.0
        along = float(rng.choice([0.0, 0.0, 0.4, -0.3]))
        force = size * self.tip_force
        x, y = force * np.cos(angle), force * np.sin(angle)
        return round(float(x), 5), round(float(y), 5), round(float(force * along), 5)


@dataclass
class _Sequence:
    """Builder of a loading sequence: the present commands of all tendons and tip force, and the steps so far."""

    names: tuple[str, ...]
    by_displacement: bool
    length: float
    values: dict[str, float] = field(default_factory=dict)
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    steps: list[LoadStep] = field(default_factory=list)
    branches: list[str] = field(default_factory=list)

    def add(self, branch: str) -> None:
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

    def command(self, goal: dict[str, float], count: int, branch: str) -> None:
        """Change commands linearly in so many steps."""
        start = dict(self.values)
        for k in range(1, count + 1):
            for name, value in goal.items():
                self.values[name] = start[name] + (value - start[name]) * k / count
            self.add(branch)

    def load(self, force: tuple[float, float, float], branch: str = "tip force") -> None:
        """Change the tip force in one step."""
        self.force = force
        self.add(branch)


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
    inputs = _Inputs.draw(robot, drive, rng)
    sequence = _Sequence(
        inputs.names, inputs.by_displacement, robot.backbone.length, dict.fromkeys(inputs.names, inputs.rest)
    )
    sequence.add("start")
    if rng.random() < 0.7:
        sequence.load(inputs.draw_force(rng, 0.6))
        sequence.load(_NO_FORCE, "tip force off")
    order = _draw_order(inputs, rng)
    _add_cycles(sequence, inputs, order if len(order) > 1 else order * 3, rng)
    if not inputs.by_displacement and len(inputs.names) > 1:
        a, b = order[0], order[1]
        sequence.command({**inputs.pull(a, 0.55), **inputs.pull(b, 0.45)}, 2, f"pull {a} and {b}")
        sequence.command({**inputs.pull(a, 0.0), **inputs.pull(b, 0.0)}, 2, f"release {a} and {b}")
    steps = sequence.steps[:_MOST_STEPS]
    return tuple(_draw_times(steps, rng) if timed else steps), tuple(sequence.branches[:_MOST_STEPS])


def _draw_order(inputs: _Inputs, rng: np.random.Generator) -> list[str]:
    """Order in which tendons are pulled; of two segments two tendons each, in turn."""
    order = [str(n) for n in rng.permutation(inputs.names)]
    if not inputs.two_segments:
        return order
    by_segment = [[n for n in order if n.startswith(segment)][:2] for segment in "ab"]
    return [name for pair in zip(*by_segment, strict=True) for name in pair]


def _add_cycles(
    sequence: _Sequence, inputs: _Inputs, cycles: Sequence[str], rng: np.random.Generator
) -> None:
    """Add pull and release of one tendon after another, every second time with tip forces in between."""
    two = inputs.two_segments
    fine = 4 if len(cycles) <= 3 else 3
    for k, (name, following) in enumerate(zip(cycles, [*cycles[1:], None], strict=True)):
        high = float(rng.uniform(0.8, 1.0))
        sequence.command(inputs.pull(name, high), fine, f"pull {name}")
        if k % 2 == 0:
            sequence.load(inputs.draw_force(rng))
            if rng.random() < 0.5:
                sequence.load(inputs.draw_force(rng))
        low = float(rng.uniform(0.2, 0.45))
        sequence.command(inputs.pull(name, low), 2 if two else 3, f"release {name}")
        if k % 2 == 0:
            sequence.load(_NO_FORCE, "tip force off")
        if k == 0 and not two:
            sequence.command(inputs.pull(name, 0.7), 2, f"pull {name} again")
        if inputs.by_displacement or following is None or two:
            sequence.command(inputs.pull(name, 0.0), 1, f"release {name}")
        elif following != name:
            goal = {**inputs.pull(name, 0.0), **inputs.pull(following, 0.25)}
            sequence.command(goal, 2, f"{name} to {following}")


def _draw_times(steps: Sequence[LoadStep], rng: np.random.Generator) -> list[LoadStep]:
    """The steps with times that grow by 10 to 40 s a step on average [s]."""
    pace, now = float(rng.uniform(10.0, 40.0)), 0.0
    timed = []
    for step in steps:
        now += round(pace * float(rng.uniform(0.6, 1.6)), 1)
        timed.append(replace(step, time=round(now, 1)))
    return timed


Array = NDArray[np.float64]

#: Step from 0, quantity and location of a reading.
Mark = tuple[int, str, float | str | None]


def draw_markers(robot: Robot, rng: np.random.Generator) -> tuple[float, ...]:
    """Arc lengths of about five disks, the last one among them [m]."""
    count = len(robot.disks.positions)
    chosen = {round(x) for x in np.linspace(count / 5.0, count, 5) + rng.uniform(-0.4, 0.4, 5)}
    return tuple(robot.disks.positions[min(max(k, 1), count) - 1] for k in sorted({*chosen, count}))


def planned_readings(setup: Experiment, arc_lengths: tuple[float, ...], more: list[str]) -> list[Mark]:
    """Step from 0, quantity and location of every reading."""
    marks: list[Mark] = []
    for k in range(len(setup.steps)):
        marks += [(k, f"position_{axis}", s) for s in arc_lengths for axis in "xyz"]
        marks.append((k, "bending_angle", None))
        marks += [(k, quantity, name) for quantity in more for name in setup.robot.tendon_names]
    return marks


def measured(marks: list[Mark], exact: Array, sigma: Array, rng: np.random.Generator) -> tuple[Reading, ...]:
    """Readings with noise; ``exact`` and ``sigma`` are in the order of the marks [m, rad, N]."""
    values = exact + sigma * rng.standard_normal(len(exact))
    return tuple(
        Reading(step + 1, quantity, location, round(float(v), 8), float(u))
        for (step, quantity, location), v, u in zip(marks, values, sigma, strict=True)
    )


def read(result: SequenceResult, setup: Experiment, marks: list[Mark]) -> Array:
    """Readings without noise.

    Parameters
    ----------
    result
        With nodes at all markers.
    setup
        Its observation: ``measured = shift + Exp(rotation) (p + R offset)``, tangents turned as well.
    marks
        Step from 0, quantity and location of every reading.

    Returns
    -------
    numpy.ndarray
        In the order of the marks [m, rad, N].
    """
    # Where effects divide a step, its end is read.
    end = {k: j for j, (k, _) in enumerate(setup.step_ends)}
    observed = {k: _observed(result.steps[end[k]], setup) for k, _, _ in marks}
    return np.array([float(channel(q).predict(observed[k], [location])[0]) for k, q, location in marks])


def _observed(step: StepResult, setup: Experiment) -> ObservedStep:
    """A step of the reference as it is observed."""
    return setup.observation.step(
        step.s,
        step.positions,
        step.rotations,
        np.asarray(step.displacements, dtype=float),
        np.array([t[-1] for t in step.tensions], dtype=float),
        tuple(setup.robot.tendon_names),
    )
