"""Quasi-static solution of a whole scene with robots in it: `SolveTDCR`, beside Exudyn's own solver calls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Annotated, Any

import exudyn as exu

from tdcr_fe.elements.native.hooks import SceneHooks
from tdcr_fe.model.loading import SolverSettings
from tdcr_fe.model.schema import Keys, Quantity, check_arguments, check_instance
from tdcr_fe.scene.builder import check_system
from tdcr_fe.scene.handle import TDCR
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.load_steps.load_path import LoadStepReport, Position, Ramp, SolvedPath
from tdcr_fe.solve.load_steps.stepping import solve_load_step
from tdcr_fe.solve.load_steps.substep import SubstepSolver
from tdcr_fe.solve.newton.unstable_motions import freely_moving
from tdcr_fe.solve.sensitivities.parameters import Parameter
from tdcr_fe.solve.sensitivities.sensitivity import SensitivityHistory
from tdcr_fe.solve.simulation import one_thread

_TIME = Annotated[float | None, Quantity(note="in s")]
#: Arguments of `SolveTDCR` that are checked as they stand.
ARGUMENTS = Keys({"startTime": _TIME, "endTime": _TIME, "substeps": Annotated[int | None, Quantity(ge=1)]})


def SolveTDCR(
    mbs: exu.MainSystem,
    settings: SolverSettings | None = None,
    *,
    startTime: float | None = None,
    endTime: float | None = None,
    substeps: int | None = None,
    sensitivities: Sequence[SensitivityHistory] = (),
) -> dict[str, Any]:
    """Take all robots of a scene, and the scene with them, to the inputs that were set.

    Every tendon input is ramped from its current value to that of the last ``set_tensions`` or ``set_displacements`` of
    its robot, and every concentrated load of a robot from its value in the last solved state to that of the last
    ``set``. Loads of your own act in full from the beginning; your load user functions and your ``PreNewtonResidual``
    and ``PreStep`` functions are called with the time, which stands unless ``endTime`` is given. The step is refined as
    in `tdcr_fe.solve.simulate.simulate`, so that the path of the friction is resolved. The solved state is left in the
    scene, at rest, as current and as initial configuration, so that a next call, ``mbs.SolveStatic`` or
    ``mbs.SolveDynamic`` continues from it, histories of the holes included.

    Parameters
    ----------
    mbs
        An assembled system with at least one robot.
    settings
        Numerics.
    startTime, endTime
        Between which time passes [s]. Defaults: the present time of the scene, and that no time passes, so that what
        user functions drive over time stays where it is.
    substeps
        Fixed number of substeps; None chooses.
    sensitivities
        Derivatives to carry along this step, one of each robot for which `track_sensitivities` has begun them.

    Returns
    -------
    dict
        The fields of `tdcr_fe.solve.load_steps.load_path.LoadStepReport`: ``iterations``, ``iterations_total``
        (with those of rejected attempts), ``substeps``, ``residual``, ``snapped``, ``presliding_factor``,
        ``refinement_error``, and ``unstable``: whether the equilibrium reached is unstable, which is examined in
        contact and beyond the buckling load of a bay. Robots that nothing couples are solved one by one, but
        with ``sensitivities`` together; these are the largest values of all.

    Raises
    ------
    StepFailed
        The message has the load factor, the residual, and what to try. The scene is then in the last converged state;
        of robots that nothing couples, each is in its own, and those after the one that failed have not moved.
    TypeError
        An argument is of another type; the message names the expected type.
    ValueError
        The system is not assembled, has no robot, has first-order states, a motor winds a tendon, the base joint of a
        robot is switched off and nothing else holds it, time would run backwards, or holes have slipped in a call
        without the sensitivities.
    """
    check_system("SolveTDCR", mbs)
    hint = "SolverSettings, such as SolverSettings(max_substeps=128)"
    check_instance("SolveTDCR", "settings", settings, (SolverSettings, type(None)), hint)
    check_arguments("SolveTDCR", ARGUMENTS, locals())
    start = mbs.systemData.GetTime() if startTime is None else startTime
    end = start if endTime is None else endTime
    if end < start:
        raise ValueError(f"SolveTDCR: endTime = {end:g} s; must not be before the start, {start:g} s")
    hooks = SceneHooks.of(mbs)
    _check_sensitivities(hooks, sensitivities)
    hooks.refuse_motors("SolveTDCR")
    if not all(robot.connected for robot in hooks.robots):
        raise ValueError(
            "SolveTDCR: it is solving already, and was called from a user function of the system (such as PreStep); "
            "call it before or after"
        )
    settings = settings or SolverSettings()
    system = SceneSystem(mbs)
    try:
        _refuse_free_bases(system, start)
        _refuse_other_presliding(system, settings.presliding)
        paths = _solve(system, settings, start, end, substeps, sensitivities)
        system.bring_to_rest()
        _draw(mbs)
    finally:
        system.connect()
    return asdict(LoadStepReport.of(*paths))


def _check_sensitivities(hooks: SceneHooks, sensitivities: Any) -> None:
    """Refuse what is no list of derivatives of robots of the system, or has missed a slip."""
    hint = "a list of what track_sensitivities returns"
    check_instance("SolveTDCR", "sensitivities", sensitivities, (list, tuple), hint)
    for each in sensitivities:
        check_instance("SolveTDCR", "an entry of sensitivities", each, SensitivityHistory, hint)
        if each.handle.actuation not in hooks.robots:
            raise ValueError(f"SolveTDCR: robot {each.handle.name!r} of sensitivities is not in the system")
        each.refuse_others()


def _refuse_free_bases(system: SceneSystem, time: float) -> None:
    """Refuse a robot whose base joint is switched off, where nothing else holds it."""
    mbs = system.mbs
    off = [
        robot
        for robot in system.robots
        if not all(mbs.GetObject(i).get("activeConnector", True) for i in robot.connectors.others)
    ]
    free = freely_moving(system, system.current_state(time)) if off else []
    for robot in off:
        if f"robot {robot.name!r}" in free:
            raise ValueError(
                f"robot {robot.name!r}: its base joint is switched off (activeConnector), and nothing else holds it; "
                "switch the joint on, join the base to something, or use mbs.SolveDynamic"
            )


def _refuse_other_presliding(system: SceneSystem, presliding: float) -> None:
    """Refuse settings with a presliding distance of their own [m]: a robot brings its own into the scene."""
    for robot in system.robots:
        own = robot.law.hysteresis.presliding
        if presliding not in (own, SolverSettings.presliding):
            raise ValueError(
                f"SolveTDCR: settings.presliding = {presliding:g}, but robot {robot.name!r} was made with {own:g}; "
                "give the distance to CreateTDCR(..., presliding=...)"
            )


def _draw(mbs: exu.MainSystem) -> None:
    """Show the solved state in the window of the renderer, if there is one."""
    data = mbs.systemData
    data.SetODE2Coordinates(data.GetODE2Coordinates(), exu.ConfigurationType.Visualization)
    mbs.SendRedrawSignal()


def _solve(
    system: SceneSystem,
    settings: SolverSettings,
    start_time: float,
    end_time: float,
    substeps: int | None,
    sensitivities: Sequence[SensitivityHistory],
) -> list[SolvedPath]:
    """The load step from the scene's current state to the inputs and loads as set, with its derivatives.

    Robots that nothing couples are solved one by one; with derivatives together, as those of one may follow from what
    another did while they touched.
    """
    mbs = system.mbs
    user_step = system.hooks.user_function("PreStep")
    before = None if user_step is None else lambda t: user_step(mbs, t)
    user_loads = (
        system.layout.user_loads
        or user_step is not None
        or system.hooks.user_function("PreNewtonResidual") is not None
        or (end_time != start_time and _objects_have_functions(system))
    )
    paths = []
    with one_thread():
        for part in [system] if sensitivities else system.independent():
            begin = part.with_reactions(part.current_state(start_time))
            ramp = Ramp.of(part, begin, end_time, before, user_loads)
            solved = solve_load_step(SubstepSolver(part, ramp, settings), Position(begin), substeps)
            paths.append(solved.path)
            for each in sensitivities:
                each.advance(solved)
    return paths


def _objects_have_functions(system: SceneSystem) -> bool:
    """Whether the user's objects have functions, which may move joints or change forces over time."""
    mbs, own = system.mbs, {int(robot.connectors.forces) for robot in system.robots}
    others = (mbs.GetObject(i) for i in range(mbs.systemData.NumberOfObjects()) if i not in own)
    return any(value for each in others for key, value in each.items() if key.endswith("UserFunction"))


def track_sensitivities(arm: TDCR, names: Sequence[str | Parameter]) -> SensitivityHistory:
    """Begin derivatives of a robot in a scene, before it is solved for the first time.

    Give what it returns to every `SolveTDCR` from then on, and read ``result()`` of it: one entry for each call.
    Names are those of the robot's and the model's fields and of effects on them, and of inputs of the current call
    (``"inputs.t1"``, ``"loads.tip.force_x"``). The base plate may be joined to a body that moves; what other bodies and
    robots do in response is in the derivatives, but for the slip rates of other robots in laws that depend on them.

    Parameters
    ----------
    arm
        The robot, after ``mbs.Assemble()``.
    names
        As in `tdcr_fe.solve.simulate.simulate`.

    Raises
    ------
    ValueError
        There is no derivative by a parameter, or the backbone creeps.
    """
    return SensitivityHistory.of_scene(arm, names)
