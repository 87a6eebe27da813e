"""Robots that the tests of the finite-element model share."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tdcr_fe import Backbone, Disks, Robot, SequenceResult, Simulation, StepResult, Tendon, simulate
from tdcr_fe.model.loading import LoadStep, Model, resolve
from tdcr_fe.model.routing import ParallelRouting, Routing
from tdcr_fe.validation.fuzz.state import State

LENGTH = 0.25
#: With per-hole friction.
MODEL = Model(elements_per_bay=1)
BACKBONE = Backbone(LENGTH, 0.4e-3, 85e9, 0.3, 5600.0)
DISKS = Disks.equally_spaced(13, LENGTH, mass=0.17e-3, radius=5e-3)
SEVEN = Disks.equally_spaced(7, LENGTH, mass=0.3e-3, radius=5e-3)


def tendon(name: str = "t1", angle_deg: float = 0.0, mu: float = 0.3, **rest: Any) -> Tendon:
    """A parallel tendon 4.5 mm off the backbone."""
    return Tendon(name, ParallelRouting(4.5e-3, angle_deg), friction_coefficient=mu, **rest)


def paper(mu: float = 0.0, backbone: Backbone = BACKBONE, disks: Disks = DISKS, **rest: Any) -> Robot:
    """The paper's single-segment robot with one tendon."""
    return Robot(backbone, disks, (tendon("t1", 0.0, mu, **rest),), name="paper")


def three(mu: float = 0.3, backbone: Backbone = BACKBONE, disks: Disks = DISKS, **rest: Any) -> Robot:
    """The same with three tendons, 120 degrees apart."""
    tendons = (tendon(f"t{i + 1}", 120.0 * i, mu, **rest) for i in range(3))
    return Robot(backbone, disks, tuple(tendons), name="three")


def seven(mu: float = 0.3, backbone: Backbone = BACKBONE, disks: Disks = SEVEN, **rest: Any) -> Robot:
    """The same with seven disks, which costs half as much."""
    return three(mu, backbone, disks, **rest)


def single(mu: float = 0.0, **rest: Any) -> Robot:
    """Seven disks and one tendon."""
    return paper(mu, disks=SEVEN, **rest)


def routed(*routings: Routing, disks: int = 13, mu: float = 0.0, **rest: Any) -> Robot:
    """Tendons t1, t2, ... of these routings through so many disks, or one parallel tendon."""
    named = enumerate(routings or (ParallelRouting(4.5e-3),), start=1)
    tendons = (Tendon(f"t{k}", routing, friction_coefficient=mu, **rest) for k, routing in named)
    return Robot(BACKBONE, Disks.equally_spaced(disks, LENGTH, mass=0.17e-3), tuple(tendons))


def wire(
    angles: Sequence[float] = (0.0, 120.0, 240.0),
    routing: Callable[[float], Routing] = lambda angle: ParallelRouting(6.5e-3, angle),
    **rest: Any,
) -> Robot:
    """1 mm of steel wire, 200 mm long, with ten thick disks and three tendons."""
    given = {"friction_coefficient": 0.15, "axial_stiffness": 5e3} | rest
    tendons = tuple(Tendon(f"t{k}", routing(a), **given) for k, a in enumerate(angles, start=1))
    disks = Disks.equally_spaced(10, 0.2, mass=0.9e-3, thickness=3e-3, radius=8e-3)
    return Robot(Backbone(0.2, 0.5e-3, 200e9, 0.3, 7850.0), disks, tendons)


def pull(*tensions: float, name: str = "t1", **rest: Any) -> list[LoadStep]:
    """One load step per tension of one tendon [N]."""
    return [LoadStep(f"{x:g} N", {name: x}, **rest) for x in tensions]


def solve(robot: Robot, steps: list[LoadStep], settings: Any = None, **model: Any) -> SequenceResult:
    """Solve a sequence with one element per bay and per-hole friction unless given otherwise; it must converge."""
    result = simulate(robot, Model(**{"elements_per_bay": 1, **model}), steps, settings)
    assert result.converged, result.message
    assert len(result.steps) == len(steps)
    return result


def degrees(result: SequenceResult) -> np.ndarray:
    """Tip bending angles [deg]."""
    return np.degrees(result.bending_angles)


def simulation(robot: Robot, model: Model, steps: Sequence[LoadStep], settings: Any = None) -> Simulation:
    """A robot that has gone through load steps."""
    targets = resolve(robot, steps)
    found = Simulation(robot, model, targets, settings)
    for step, target in zip(steps, targets, strict=True):
        found.advance(target, step.substeps)
    return found


def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Largest distance of points, over the length of the paper's robot [1]."""
    return float(np.max(np.linalg.norm(np.atleast_2d(a - b), axis=-1))) / LENGTH


def cables(robot: Robot, step: StepResult) -> list[tuple[np.ndarray, np.ndarray]]:
    """By tendon, lengths of the segments [m] and angles at the holes between them [rad], as the campaigns check."""
    state = State.of(robot, Model(friction="none"), step)
    first, last = state.tendons.first, state.tendons.last
    angles = np.split(state.segments.angles, np.cumsum(last - first - 1)[:-1])
    return list(zip(np.split(state.lengths, last[:-1]), angles, strict=True))
