"""The corrected robot over the measured loading sequence, with the measured markers: for the 3D panel and as tables."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.identify.outcome import IdentificationResult
from tdcr_fe.identify.simulate_run import solve_commanded_steps
from tdcr_fe.io.result_folder import CORRECTED, write_markers
from tdcr_fe.io.tables import write_results
from tdcr_fe.model.results import SequenceResult
from tdcr_fe.report.geometry import spread
from tdcr_fe.report.motion import Markers, Motion, motion_of

Array = NDArray[np.float64]

#: Points at most that the backbone of the declared model is drawn with.
DECLARED_POINTS = 80


def replay(result: IdentificationResult, deadline: float = math.inf) -> SequenceResult:
    """Repeat the run of the corrected robot on its own path, with tensions along the tendons and states of the holes.

    A law that was found acts as the concentrated loads that it gives on this loading.

    Parameters
    ----------
    result
        What was found.
    deadline
        Reading of `tdcr_fe.identify.time_limit.clock` at which the simulation ends [s].

    Returns
    -------
    SequenceResult
        One step for each of ``loading.csv``, with its number and its branch as the label.

    Raises
    ------
    KeyboardInterrupt
        The simulation was interrupted.
    OutOfTime
        The deadline has passed.
    """
    mesh = result.commanded.model.elements_per_bay
    experiment = replace(result.corrected, model=replace(result.corrected.model, elements_per_bay=mesh))
    path = result.path
    if result.law is not None:
        experiment, path = replace(experiment, steps=result.law.steps), None
    solved = solve_commanded_steps(experiment, result.solver, deadline, path)
    named = zip(solved.steps, result.data.step_ids, result.data.branches, strict=False)
    return replace(solved, steps=tuple(replace(s, step=n, label=branch) for s, n, branch in named))


def markers(result: IdentificationResult, steps: int) -> Markers:
    """Measured markers and the declared model's backbone of the first steps, turned into the robot's frame.

    An identified misalignment of the measuring frame moves what was measured, not the robot.
    """
    shapes = result.shapes
    observation = result.corrected.observation
    points = spread(shapes.backbone_before.shape[1], DECLARED_POINTS)
    return Markers(
        shapes.arc_lengths,
        observation.in_base(shapes.measured[:steps]),
        observation.in_base(shapes.backbone_before[:steps, points]),
    )


def corrected_motion(result: IdentificationResult, out: Path, deadline: float = math.inf) -> Motion | None:
    """Simulate the corrected robot, write its tables into the folder ``corrected``, and give its motion.

    Parameters
    ----------
    result
        What was found.
    out
        Folder of the results.
    deadline
        Reading of `tdcr_fe.identify.time_limit.clock` at which the simulation ends [s].

    Returns
    -------
    Motion or None
        None where no step of the corrected robot could be solved.

    Raises
    ------
    KeyboardInterrupt
        The simulation was interrupted.
    OutOfTime
        The deadline has passed.
    """
    sequence = replay(result, deadline)
    if not sequence.steps:
        return None
    seen = markers(result, len(sequence.steps))
    write_results(sequence, out / CORRECTED, result.data.digests, len(result.data.steps), pictures=False)
    write_markers(seen, [s.step for s in sequence.steps], out / CORRECTED)
    return motion_of(sequence, seen)
