"""Quasi-static solution of a whole scene with robots in it: `SolveTDCR`, beside Exudyn's own solver calls."""

from __future__ import annotations

from typing import Any

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.settings import SolverSettings
from tdcr_fe.solve.solver import StrainSpaceSolver
from tdcr_fe.solve.stepping import Applied, LoadStepper

Array = NDArray[np.float64]


def SolveTDCR(
    mbs: exu.MainSystem,
    settings: SolverSettings | None = None,
    *,
    startTime: float = 0.0,
    endTime: float = 1.0,
    substeps: int | None = None,
) -> dict[str, Any]:
    """Take all robots of a scene, and the scene with them, to the inputs that were set.

    Every tendon moves from what it has now to what ``set_tensions`` and ``set_displacements`` of its robot said
    last, while time runs from ``startTime`` to ``endTime``: your load user functions and your
    ``PreNewtonResidual`` and ``PreStep`` functions see that time. The solved state is left in the scene as current
    and as initial configuration, so that a next call, ``mbs.SolveStatic`` or ``mbs.SolveDynamic`` goes on from it,
    histories of the holes included.

    Parameters
    ----------
    mbs
        An assembled system with at least one robot.
    settings
        Numerics.
    startTime, endTime
        [s].
    substeps
        Fixed number of substeps; None chooses.

    Returns
    -------
    dict
        ``iterations``, ``iterations_total`` (with those of rejected trials), ``substeps``, ``residual``.

    Raises
    ------
    StepFailed
        Says where, the residual, and what to try. The scene is then in the last state that converged.
    ValueError
        The system is not assembled, has no robot, or has first-order states.
    """
    solver = StrainSpaceSolver(mbs, settings)
    goals: list[Any] = []
    starts: list[Array | None] = []
    for robot in solver.robots:
        robot.restart_time(startTime)
        over_time = robot.inputs if callable(robot.inputs) else None
        if over_time is not None:
            goals.append(over_time)
            starts.append(None)
            continue
        values = robot.input_values()
        # What it has now, whichever solver brought it here.
        starts.append(np.where(robot.by_displacement, robot.displacements, robot.base_tension))
        goals.append(values)
    user_step = _function(mbs.GetPreStepUserFunction())

    def apply(share: float) -> Applied:
        t = startTime + share * (endTime - startTime)
        mbs.systemData.SetTime(t)
        if user_step is not None:
            user_step(mbs, t)
        inputs = []
        for robot, start, goal in zip(solver.robots, starts, goals, strict=True):
            if start is None:
                inputs.append(robot.input_values(t))
            else:
                inputs.append(start + share * (goal - start))
        return Applied(inputs, 0.0, t)

    return LoadStepper(solver).advance(apply, substeps)


def _function(present: Any) -> Any:
    if isinstance(present, dict):
        present = present.get("function")
    return present if callable(present) else None
