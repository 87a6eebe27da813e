"""Quasi-static solution of a whole scene with robots in it: `SolveTDCR`, beside Exudyn's own solver calls."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import exudyn as exu

from tdcr_fe.model import arguments
from tdcr_fe.model.settings import SolverSettings
from tdcr_fe.scene.builder import check_system
from tdcr_fe.solve.ramp import Ramp
from tdcr_fe.solve.stepping import LoadStepReport, Path, solve_ramp
from tdcr_fe.solve.system import SceneSystem
from tdcr_fe.solve.threads import one_thread


def SolveTDCR(
    mbs: exu.MainSystem,
    settings: SolverSettings | None = None,
    *,
    startTime: float = 0.0,
    endTime: float = 1.0,
    substeps: int | None = None,
) -> dict[str, Any]:
    """Take all robots of a scene, and the scene with them, to the inputs that were set.

    Every tendon input is ramped from its current value to that of the last ``set_tensions`` or ``set_displacements`` of
    its robot, every concentrated load of a robot from its value in the last solved state to that of the last ``set``,
    and time from ``startTime`` to ``endTime``: your load user functions and your ``PreNewtonResidual`` and ``PreStep``
    functions are called with that time. Loads of your own act in full from the beginning. The step is refined as in
    `tdcr_fe.solve.simulate.simulate`, so that the path of the friction is resolved. The solved state is left in the
    scene, at rest, as current and as initial configuration, so that a next call, ``mbs.SolveStatic`` or
    ``mbs.SolveDynamic`` continues from it, histories of the holes included.

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
        The fields of `tdcr_fe.solve.stepping.LoadStepReport`: ``iterations``, ``iterations_total`` (with those of
        rejected attempts), ``substeps``, ``residual``, ``snapped``, ``presliding_factor``, ``refinement_error``.

    Raises
    ------
    StepFailed
        The message has the load factor, the residual, and what to try. The scene is then in the last converged state.
    TypeError
        An argument is of another type; the message names the expected type.
    ValueError
        The system is not assembled, has no robot, or has first-order states.
    """
    check_system("SolveTDCR", mbs)
    arguments.check_settings("SolveTDCR", settings)
    arguments.check_count("SolveTDCR", "substeps", substeps)
    for name, value in (("startTime", startTime), ("endTime", endTime)):
        arguments.check_number("SolveTDCR", name, value, "It is a time [s].")
    system = SceneSystem(mbs)
    try:
        path = _solve(system, settings or SolverSettings(), startTime, endTime, substeps)
        system.bring_to_rest()
    finally:
        system.connect()
    return asdict(LoadStepReport.of(path))


def _solve(
    system: SceneSystem, settings: SolverSettings, start_time: float, end_time: float, substeps: int | None
) -> Path:
    """The load step from the scene's current state to the inputs and loads as set."""
    mbs = system.mbs
    user_step = _function(mbs.GetPreStepUserFunction())
    before = None if user_step is None else lambda t: user_step(mbs, t)
    user_loads = (
        system.layout.user_loads
        or user_step is not None
        or system.hooks.user_function("PreNewtonResidual") is not None
    )
    state = system.current_state(start_time)
    ramp = Ramp.of(system, state, start_time, end_time, before, user_loads)
    with one_thread():
        return solve_ramp(system, state, ramp, settings, substeps)


def _function(present: Any) -> Any:
    if isinstance(present, dict):
        present = present.get("function")
    return present if callable(present) else None
