"""What is read in a blind set: markers, the planned readings, and their values without noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Experiment
from tdcr_fe.model.channels import channel
from tdcr_fe.model.observed_step import ObservedStep
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.model.robot import Robot

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
