"""What is read of a simulated robot: markers, plan of the readings, the reference as the true robot, and noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from tdcr_fe.effects import Experiment
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.channels import channel
from tdcr_fe.model.observed_step import ObservedStep
from tdcr_fe.model.results import SequenceResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.reference import Extras, ReferenceSettings, solve_reference
from tdcr_fe.validation.reference.settings import Array

#: Step from 0, quantity and location of a reading.
Mark = tuple[int, str, float | str | None]
Made = TypeVar("Made")


class NotMade(Exception):
    """A true robot cannot be solved; the message names the step."""


def attempts(seed: int, make: Callable[[np.random.Generator], Made]) -> Made:
    """What is made of the first of four series of random numbers that gives a robot that can be solved.

    Raises
    ------
    NotMade
        None does.
    """
    reason = ""
    for attempt in range(4):
        try:
            return make(np.random.default_rng([seed, attempt]))
        except NotMade as problem:
            reason = str(problem)
    raise NotMade(f"seed {seed}: {reason}")


def draw_markers(robot: Robot, rng: np.random.Generator) -> tuple[float, ...]:
    """Arc lengths of about five disks, the last one among them [m]."""
    count = len(robot.disks.positions)
    chosen = {round(x) for x in np.linspace(count / 5.0, count, 5) + rng.uniform(-0.4, 0.4, 5)}
    return tuple(robot.disks.positions[min(max(k, 1), count) - 1] for k in sorted({*chosen, count}))


def planned(setup: Experiment, arc_lengths: Sequence[float], of_tendons: Sequence[str] = ()) -> list[Mark]:
    """Positions at all markers and the bending angle in every step, and quantities of all tendons."""
    marks: list[Mark] = []
    for k in range(len(setup.steps)):
        marks += [(k, f"position_{axis}", s) for s in arc_lengths for axis in "xyz"]
        marks.append((k, "bending_angle", None))
        marks += [(k, quantity, name) for quantity in of_tendons for name in setup.robot.tendon_names]
    return marks


def solved(setup: Experiment, settings: ReferenceSettings, extras: Extras | None = None) -> SequenceResult:
    """The true robot, by the reference.

    Raises
    ------
    NotMade
        It is not solved, or bends so far that the tip turns back to the base.
    """
    result = solve_reference(setup.robot, setup.model, setup.steps, settings=settings, extras=extras)
    if not result.converged:
        raise NotMade(result.message)
    if max(step.bending_angle for step in result.steps) > 2.8:
        raise NotMade("the tip turns back to the base")
    return result


def read(result: SequenceResult, setup: Experiment, marks: Sequence[Mark]) -> Array:
    """Readings without noise, in the order of the marks [m, rad, N].

    Parameters
    ----------
    result
        With nodes at all markers.
    setup
        Its observation: ``measured = shift + Exp(rotation) (p + R offset)``, tangents turned as well.
    marks
        Step from 0, quantity and location of every reading.
    """
    names = tuple(setup.robot.tendon_names)
    # Where effects divide a step, its end is read.
    steps = {k: result.steps[j] for j, (k, _) in enumerate(setup.ends)}
    marked = {k for k, _, _ in marks}
    observed = {k: ObservedStep.of(steps[k], names, setup.observation) for k in marked}
    return np.array([float(channel(q).predict(observed[k], [location])[0]) for k, q, location in marks])


def sigmas(marks: Sequence[Mark], sigma: float) -> Array:
    """Standard deviation of every reading where that of positions is ``sigma`` [m, rad, N]."""
    by_unit = {"m": sigma, "rad": sigma / 0.06, "N": 5e-3}
    return np.array([5e-5 if q == "tendon_displacement" else by_unit[channel(q).unit] for _, q, _ in marks])


#: Marks, values and standard deviations of readings [m, rad, N].
Noisy = tuple[Sequence[Mark], Array, Array]


def measured(name: str, declared: Experiment, branches: Sequence[str], noisy: Noisy) -> MeasuredData:
    """Data of a declared robot."""
    values = [(round(float(v), 8), float(u)) for v, u in zip(*noisy[1:], strict=True)]
    readings = [Reading(k + 1, q, location, *x) for (k, q, location), x in zip(noisy[0], values, strict=True)]
    steps = tuple(declared.steps)
    ids = tuple(range(1, len(steps) + 1))
    return MeasuredData(name, declared.robot, declared.model, ids, steps, tuple(branches), tuple(readings))
