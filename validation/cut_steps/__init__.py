"""Whole load steps of random robots against the same steps cut in parts.

With friction the result depends on the path, which `tdcr_fe.simulate` resolves within a load step. Cut in many parts,
each with a tight tolerance, the same history leaves little to resolve. Both at one element a bay: the mesh is the same.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tdcr_fe.model.loading import Load, LoadStep
from tdcr_fe.model.settings import SolverSettings
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.random_robots.drawing import RandomCase

#: Largest difference of a node's position that goes unsaid, over the length [1].
ALLOWED = 1e-5
#: Path tolerance of the parts [1].
TIGHT = 1e-7


class Difference(NamedTuple):
    """Difference of one load step.

    Attributes
    ----------
    number, step : int
        Seed of the robot, and number of its step.
    moved : float
        Largest difference of a node's coordinate, over the length [1].
    reported : bool
        Whether a warning of either run names the friction path or a snap-through.
    """

    number: int
    step: int
    moved: float
    reported: bool


def cut(case: RandomCase, parts: int) -> list[LoadStep]:
    """The history of a random robot with every load step cut in equal parts; loads remain until they are changed."""
    found, length = [], case.robot.backbone.length
    inputs, force = dict.fromkeys(case.robot.tendon_names, 0.0), np.zeros(3)
    for step in case.steps:
        goal = dict(step.displacements if case.by_displacement else step.tensions)
        end = np.array(step.loads["tip"].force) if step.loads else force
        for x in np.arange(1, parts + 1) / parts:
            now = {name: start + x * (goal[name] - start) for name, start in inputs.items()}
            given = {"displacements": now} if case.by_displacement else {"tensions": now}
            acting = tuple((force + x * (end - force)).tolist())
            loads = {"tip": Load(length, acting)} if any(acting) else {}
            found.append(replace(step, loads=loads, **given))  # type: ignore[arg-type]
        inputs, force = goal, end
    return found


def differences(case: RandomCase, parts: int) -> list[Difference]:
    """Differences of all load steps of a robot.

    Raises
    ------
    RuntimeError
        A run did not converge.
    """
    model = replace(case.model, elements_per_bay=1)
    settings = SolverSettings(path_tolerance=TIGHT, mesh_tolerance=np.inf)
    whole = simulate(case.robot, model, case.steps)
    fine = simulate(case.robot, model, cut(case, parts), settings)
    for run in (whole, fine):
        if not run.converged:
            raise RuntimeError(f"robot {case.number}: {run.message}")
    reported = any("Friction path" in w or "snapped" in w for w in (*whole.warnings, *fine.warnings))
    return [
        Difference(
            case.number,
            step.step,
            float(np.abs(step.positions - other.positions).max()) / case.robot.backbone.length,
            reported,
        )
        for step, other in zip(whole.steps, fine.steps[parts - 1 :: parts], strict=True)
    ]
