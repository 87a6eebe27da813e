"""Exudyn's own solvers beside functions of the user, run again, from stored states, and after SolveTDCR."""

from __future__ import annotations

import gc
import os
import weakref
from dataclasses import replace

import exudyn as exu
import numpy as np
import pytest
from native_solvers import damped, dynamic_settings, static_settings
from robots import BACKBONE, LENGTH, distance, paper, pull, scene, solve, three

from tdcr_fe.model.disks import Disks
from tdcr_fe.model.loading import Model
from tdcr_fe.model.material import Superelastic
from tdcr_fe.model.robot import Robot
from tdcr_fe.native import register
from tdcr_fe.scene.builder import CreateTDCR
from tdcr_fe.solve.statics import SolveTDCR

register()


def rise(tension):
    """Tension of the first of three tendons over time [N]."""
    return lambda t: [tension * (1.0 - np.cos(np.pi * min(10.0 * t, 1.0))) / 2.0, 0.0, 0.0]


def run(mbs, handle):
    assert mbs.SolveDynamic(dynamic_settings(0.15, 1e-3))
    return handle.shape()[0]


@pytest.mark.parametrize("reset", [False, True])
@pytest.mark.parametrize("friction", ["none", "per-hole"])
def test_a_second_dynamic_run_is_the_first_one_again(friction, reset, figure):
    """From the same initial configuration.

    In version 0.1 tensions left in the springs entered the initial accelerations, the tip ended kilometres away or
    Newton failed, and `arm.reset()` did not help.
    """
    _keep, mbs, handle = damped(three(0.3), friction=friction)
    handle.set_inputs_over_time(rise(1.5))
    first = run(mbs, handle)
    assert distance(first[-1], [0.0, 0.0, LENGTH]) > 0.05
    if reset:
        handle.reset()
    second = run(mbs, handle)
    figure("repeat", np.abs(second - first).max() / LENGTH)
    assert handle.actuation.state.time == pytest.approx(0.15)


def test_after_a_dynamic_run_the_history_is_kept_and_reset_clears_it():
    _keep, mbs, handle = damped(three(0.3))
    handle.set_inputs_over_time(rise(1.5))
    run(mbs, handle)
    assert np.any(handle.actuation.state.mobilisation == 1.0)
    handle.reset()
    assert not np.any(handle.actuation.state.mobilisation)
    assert not np.any(handle.actuation.base_tension)


# ---------------------------------------------------------------- functions of the user


KINDS = ("PreStep", "PostStep", "PreNewtonResidual", "PostNewton", "SystemJacobian")


def user_functions(calls):
    """Functions that change nothing and count their calls."""

    def step(kind):
        def function(mbs, t):
            calls[kind] += 1
            return True

        return function

    def residual(mbs, t, newton, discontinuous):
        calls["PreNewtonResidual"] += 1

    def post_newton(mbs, t):
        calls["PostNewton"] += 1
        return [0.0, -1.0]

    def jacobian(mbs, t, by_ode2, by_ode2_t, by_ode1):
        calls["SystemJacobian"] += 1
        n = mbs.systemData.ODE2Size() + mbs.systemData.ODE1Size() + mbs.systemData.AEsize()
        container = exu.MatrixContainer()
        container.SetWithDenseMatrix(np.zeros((n, n)), useDenseMatrix=False)
        return container

    return {
        "PreStep": step("PreStep"),
        "PostStep": step("PostStep"),
        "PreNewtonResidual": residual,
        "PostNewton": post_newton,
        "SystemJacobian": jacobian,
    }


def with_functions(when, kinds):
    """A robot on ground with functions of the user, set before or after the robot, or set and taken away."""
    calls = dict.fromkeys(KINDS, 0)
    functions = {kind: f for kind, f in user_functions(calls).items() if kind in kinds}
    keep = exu.SystemContainer()
    mbs = keep.AddSystem()

    def put(taken_away=False):
        for kind, function in functions.items():
            getattr(mbs, f"Set{kind}UserFunction")(0 if taken_away else function)

    if when in ("before", "taken away after"):
        put()
    handle = CreateTDCR(mbs, three(0.3), Model(friction="per-hole", elements_per_bay=1))
    if when in ("after", "taken away"):
        put()
    mbs.Assemble()
    if when == "after assembly":
        put()
    if when.startswith("taken away"):
        put(taken_away=True)
    return keep, mbs, handle, calls


@pytest.mark.parametrize("solver", ["SolveStatic", "SolveDynamic", "SolveTDCR"])
@pytest.mark.parametrize("when", ["before", "after", "after assembly", "taken away", "taken away after"])
def test_functions_of_the_user_change_nothing_whenever_they_are_set(solver, when, figure):
    """In version 0.1 a `PreNewtonResidual` set after the robot left all tendons without tension in Exudyn's solvers.

    One that was taken away again took the tendons with it, or went on being called.
    """
    settings = {"SolveStatic": (static_settings(60),), "SolveDynamic": (dynamic_settings(0.1, 1e-3),)}.get(
        solver, ()
    )
    shapes, counted = [], []
    for kinds in ((), KINDS):
        _keep, mbs, handle, calls = with_functions(when, kinds)
        handle.set_inputs_over_time(rise(1.5) if solver == "SolveDynamic" else lambda t: [1.5 * t, 0.0, 0.0])
        getattr(mbs, solver)(*settings)
        shapes.append(handle.shape()[0])
        counted.append(calls)
        assert handle.tensions()["t1"][0] == pytest.approx(1.5)
        assert np.any(handle.actuation.state.mobilisation == 1.0)
    figure("functions", np.abs(shapes[1] - shapes[0]).max() / LENGTH)
    expected = set() if when.startswith("taken away") else set(KINDS)
    if solver == "SolveTDCR":
        # It has no function after Newton, and calls none after a step.
        expected -= {"PostNewton", "PostStep"}
    assert {kind for kind, count in counted[1].items() if count} == expected


def test_a_function_after_every_step_is_replaced_and_taken_away_between_runs():
    calls = []
    _keep, mbs, handle = damped(three(0.3))
    handle.set_inputs_over_time(rise(1.5))
    for function, expected in (
        (lambda m, t: calls.append("a") or True, {"a"}),
        (lambda m, t: calls.append("b") or True, {"b"}),
        (0, set()),
    ):
        calls.clear()
        mbs.SetPostStepUserFunction(function)
        run(mbs, handle)
        assert set(calls) == expected
        assert np.any(handle.actuation.state.mobilisation == 1.0)


# ---------------------------------------------------------------- states


def test_a_stored_state_restores_tensions_and_holes():
    """By `GetSystemState` and `SetSystemState`; in version 0.1 the holes kept their later states."""
    _keep, mbs, handle = scene(three(0.3))
    handle.set_tensions([1.5, 0.2, 0.1])
    SolveTDCR(mbs)
    handle.set_tensions([1.0, 0.2, 0.1])
    SolveTDCR(mbs)
    stored = mbs.systemData.GetSystemState()
    shape, tensions, holes = handle.shape()[0], handle.tensions(), handle.hole_states()
    handle.set_tensions([0.4, 0.8, 0.1])
    SolveTDCR(mbs)
    onwards = handle.shape()[0]
    assert handle.hole_states() != holes
    mbs.systemData.SetSystemState(stored)
    assert np.array_equal(handle.shape()[0], shape)
    assert handle.hole_states() == holes
    for name, before in tensions.items():
        assert handle.tensions()[name] == pytest.approx(before, rel=1e-12)
    SolveTDCR(mbs)
    assert np.abs(handle.shape()[0] - onwards).max() <= 1e-12 * LENGTH


def test_a_run_goes_on_from_the_restart_file(tmp_path):
    """The second half of a run, begun in another system from the state at the middle, ends where the whole run does."""

    def pull_and_release(t):
        return [1.5 * np.sin(np.pi * min(t / 0.2, 1.0)) + 0.1, 0.0, 0.0]

    def made():
        keep, mbs, handle = damped(three(0.3))
        handle.set_inputs_over_time(pull_and_release)
        return keep, mbs, handle

    def tight(end):
        # The runs begin with Jacobians of other steps: their tolerance must not matter.
        settings = dynamic_settings(end, 1e-3)
        settings.timeIntegration.newton.relativeTolerance = 1e-8
        return settings

    _keep, mbs, whole = made()
    assert mbs.SolveDynamic(tight(0.2))
    settings = tight(0.1)
    _keep, mbs, half = made()
    assert mbs.SolveDynamic(settings)
    np.save(tmp_path / "state.npy", np.concatenate(mbs.systemData.GetSystemState()))
    sizes = np.cumsum([len(x) for x in mbs.systemData.GetSystemState()])[:-1]
    _keep, mbs, other = made()
    state = [list(x) for x in np.split(np.load(tmp_path / "state.npy"), sizes)]
    for kind in (exu.ConfigurationType.Current, exu.ConfigurationType.Initial):
        mbs.systemData.SetSystemState(state, kind)
    assert np.abs(other.shape()[0] - half.shape()[0]).max() == 0.0
    assert other.hole_states() == half.hole_states()
    settings.timeIntegration.startTime, settings.timeIntegration.endTime = 0.1, 0.2
    assert mbs.SolveDynamic(settings)
    # The state has no accelerations of the integrator, which begins anew in the middle: 1.2e-5.
    assert distance(other.shape()[0], whole.shape()[0]) < 2e-5
    assert other.hole_states() == whole.hole_states()


def test_a_load_step_that_is_repeated_with_a_smaller_size_keeps_the_history_of_its_beginning():
    """Adaptive load steps of `mbs.SolveStatic`, some of them rejected, to 1.6 N and back to 0.6 N."""
    _keep, mbs, handle = scene(paper(0.3))
    handle.set_inputs_over_time(lambda t: [3.2 * min(t, 0.5) - 2.0 * max(t - 0.5, 0.0)])
    tried = []
    mbs.SetPreStepUserFunction(lambda m, t: tried.append(t) or True)
    assert mbs.SolveStatic(static_settings(10))
    assert len(tried) > mbs.sys["staticSolver"].it.currentStepIndex
    expected = solve(paper(0.3), pull(1.6, 0.6)).tips[-1]
    assert distance(handle.tip_position, expected) < 1e-4


# ---------------------------------------------------------------- hand-over, mass, explicit solvers


@pytest.mark.parametrize("drive", ["tension", "displacement"])
def test_dynamics_after_statics_begin_at_rest(drive, figure):
    """Inextensible tendons.

    In version 0.1 those driven by displacement lengthened by T L / EA at once: a jolt of 0.6 mm, and holes remembered a
    release, or the tension became 1e13 N.
    """
    _keep, mbs, handle = scene(three(0.3))
    if drive == "tension":
        handle.set_tensions([1.5, 0.3, 0.2])
    else:
        handle.set_displacements([6e-3, -2.8e-3, -2.9e-3])
    SolveTDCR(mbs)
    start, tensions, friction = handle.shape()[0], handle.tensions(), handle.actuation.state
    assert max(t[0] for t in tensions.values()) > 0.5
    furthest = [0.0]
    mbs.SetPostStepUserFunction(
        lambda m, t: furthest.append(max(furthest[-1], np.abs(handle.shape()[0] - start).max())) or True
    )
    settings = dynamic_settings(0.1, 1e-3)
    assert mbs.SolveDynamic(settings)
    figure("hand-over", furthest[-1] / LENGTH)
    for name, before in tensions.items():
        figure("hand-over tension", np.abs(handle.tensions()[name] - before).max() / max(1e-3, before[0]))
    assert handle.actuation.state.mobilisation == pytest.approx(friction.mobilisation, abs=0.1)


def massless(**rest):
    backbone = replace(BACKBONE, density=0.0)
    return Robot(
        backbone,
        Disks.equally_spaced(13, LENGTH, mass=0.0, radius=5e-3),
        three(0.3).tendons,
        name="light",
        **rest,
    )


def test_a_robot_without_mass_is_refused_in_dynamics_and_solved_at_rest():
    """In version 0.1 Newton failed in the first step, for no reason given."""
    _keep, mbs, handle = scene(massless())
    handle.set_tensions([0.5, 0.0, 0.0])
    SolveTDCR(mbs)
    assert handle.tip_position[0] > 0.01
    with pytest.raises((ValueError, RuntimeError), match="robot 'light' has no mass"):
        mbs.SolveDynamic(dynamic_settings(0.01, 1e-3))


@pytest.mark.parametrize("thickness", [0.0, 1e-3, 4e-3])
def test_recommended_settings_solve_thin_and_thick_disks_alike(thickness):
    """Every step of a pull within 30 ms; thick disks failed in version 0.1 at the tolerances of its documentation.

    The tip does not depend on the tolerance: one 30 times as large gives the same within 1e-6 of the length.
    """
    disks = Disks.equally_spaced(13, LENGTH, mass=0.17e-3, radius=5e-3, thickness=thickness)
    _keep, mbs, handle = damped(three(0.3, disks=disks))
    handle.set_inputs_over_time(rise(1.0))
    tips = []
    for scale in (1.0, 30.0):
        settings = handle.recommended_settings(0.03, 1e-3)
        settings.timeIntegration.newton.absoluteTolerance *= scale
        settings.timeIntegration.verboseMode = 0
        settings.solution.file.write = False
        assert mbs.SolveDynamic(settings)
        tips.append(handle.tip_position)
    assert distance(*tips) < 1e-6


def robots_of_the_tests() -> dict[str, tuple[Robot, dict]]:
    """By what is special about them, and arguments of the model."""
    thick = Disks.equally_spaced(13, LENGTH, mass=0.17e-3, radius=5e-3, thickness=4e-3)
    backbones = {
        "superelastic": {"superelastic": Superelastic(0.005, 0.3)},
        "precurved": {"precurvature": (1.0, 4.0)},
        "tapered": {"taper": ((0.0, 0.4e-3), (LENGTH, 0.2e-3))},
    }
    found = {
        "one tendon": (paper(0.3), {}),
        "three tendons": (three(0.3), {}),
        "thick disks": (three(0.3, disks=thick), {}),
        "thick disks, damped": (
            three(0.3, disks=thick, backbone=replace(BACKBONE, retardation_time=1e-2)),
            {},
        ),
        "elastic tendons": (three(0.3, axial_stiffness=400.0), {}),
        "continuous": (three(0.0), {"tendon_path": "continuous", "friction": "none"}),
        "per tendon": (three(0.3), {"friction": "per-tendon"}),
        "five heavy disks": (
            three(0.3, disks=Disks.equally_spaced(5, LENGTH, mass=0.5e-3)),
            {"elements_per_bay": 4},
        ),
        "disks without mass": (three(0.3).with_disks(mass=0.0), {}),
        "gravity": (three(0.3), {"gravity": (9.81, 0.0, 0.0)}),
    }
    for name, changes in backbones.items():
        found[name] = three(0.3, backbone=replace(BACKBONE, **changes)), {}
    return found


def test_recommended_settings_solve_all_robots_of_the_tests(figure):
    """A pull to 1 N within 30 ms in steps of 1 ms; thick disks failed in version 0.1."""
    unsolved = []
    for name, (robot, model) in robots_of_the_tests().items():
        _keep, mbs, handle = scene(robot, **model)
        others = [0.0] * (len(robot.tendons) - 1)
        handle.set_inputs_over_time(
            lambda t, others=others: [0.5 * (1.0 - np.cos(np.pi * min(t / 0.03, 1.0))), *others]
        )
        settings = handle.recommended_settings(0.03, 1e-3)
        settings.timeIntegration.verboseMode = 0
        settings.solution.file.write = False
        try:
            assert mbs.SolveDynamic(settings)
            assert distance(handle.tip_position, [0.0, 0.0, LENGTH]) > 1e-3
        except exu.SolverError:
            unsolved.append(name)
    figure("recommended", len(unsolved))


def test_a_run_with_tolerances_below_round_off_ends_by_name():
    """Exudyn's default tolerances and full Newton: e3bbe5d took 5000 steps in place of 30."""
    _keep, mbs, handle = scene(three(0.3))
    handle.set_inputs_over_time(lambda t: [0.5 * (1.0 - np.cos(np.pi * min(t / 0.03, 1.0))), 0.0, 0.0])
    settings = dynamic_settings(0.03, 1e-3)
    settings.timeIntegration.newton = exu.SimulationSettings().timeIntegration.newton
    settings.timeIntegration.newton.useModifiedNewton = False
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
    with pytest.raises(exu.ModelError, match=r"below the round-off .* arm.recommended_settings"):
        mbs.SolveDynamic(settings)
    assert mbs.sys["dynamicSolver"].it.currentStepIndex < 1000
    assert mbs.SolveDynamic(handle.recommended_settings(0.03, 1e-3))


def test_recommended_settings_refuse_wrong_times():
    handle = scene(paper())[2]
    for times in ((0.0, 1e-3), (1.0, 2.0), (float("nan"), 1e-3)):
        with pytest.raises(ValueError, match="recommended_settings"):
            handle.recommended_settings(*times)


# ---------------------------------------------------------------- memory


def resident() -> float:
    """Memory of this process [MB]."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def made_and_dropped(solve: bool) -> weakref.ref:
    _keep, mbs, handle = scene(three(0.3))
    if solve:
        handle.set_tensions([0.1, 0.0, 0.0])
        SolveTDCR(mbs)
    return weakref.ref(handle.actuation)


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="memory is read from /proc")
@pytest.mark.parametrize("count", [150, pytest.param(500, marks=pytest.mark.campaign)])
def test_a_scene_that_is_dropped_is_freed(count, figure):
    """In version 0.1 every scene kept 0.35 MB: the system, its variables and the functions there kept each other."""
    dropped = made_and_dropped(solve=True)
    gc.collect()
    assert dropped() is None
    for _ in range(30):
        made_and_dropped(solve=False)
    gc.collect()
    before = resident()
    for _ in range(count):
        made_and_dropped(solve=False)
    gc.collect()
    figure("memory", (resident() - before) / count)
