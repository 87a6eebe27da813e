"""Exudyn's solvers beside functions of the user, run again and in turn, from stored states, files and restarts."""

import gc
import weakref
from contextlib import nullcontext

import exudyn as exu
import numpy as np
import pytest
from contacts import CONTACTS
from exudyn.utilities import LoadSolutionFile, SetSolutionState
from robots import LENGTH, distance, seven
from scenes import damped, recommended, scene, scene_with, solve_scene

from tdcr_fe.solve.statics import SolveTDCR

BOTH = (exu.ConfigurationType.Current, exu.ConfigurationType.Initial)


def swing(t: float) -> list[float]:
    """Tensions over time [N]."""
    return [1.0 - np.cos(50.0 * t), 0.1, 0.1]


# ---------------------------------------------------------------- functions of the user


def test_a_second_dynamic_run_is_the_first_one_again():
    """From the same initial configuration, with friction; a reset clears the history.

    In version 0.1 tensions left in the springs entered the initial accelerations: the tip ended kilometres away.
    """
    _keep, mbs, handle = damped(seven(0.3))
    handle.set_inputs_over_time(lambda t: [0.75 * (1.0 - np.cos(np.pi * min(10.0 * t, 1.0))), 0.0, 0.0])
    shapes = []
    for _ in range(2):
        assert mbs.SolveDynamic(recommended(handle, 0.15, 1e-3))
        shapes.append(handle.shape()[0])
        assert np.any(handle.actuation.state.mobilisation == 1.0)
    assert distance(shapes[0][-1], [0.0, 0.0, LENGTH]) > 0.05
    assert distance(*shapes) < 1e-12
    assert handle.actuation.state.time == pytest.approx(0.15)
    handle.reset()
    assert not np.any(handle.actuation.state.mobilisation)
    assert not np.any(handle.actuation.base_tension)


def test_tensions_set_in_a_prestep_function_are_those_of_inputs_over_time():
    """A control loop: the tensions of a step are set at its beginning, from what the last one has measured."""
    _keep, mbs, expected = scene(seven(0.3))
    expected.set_inputs_over_time(swing)
    assert mbs.SolveDynamic(recommended(expected, 0.04, 1e-3))
    _keep_other, other, handle = scene(seven(0.3))
    handle.set_tensions(swing(0.0))
    seen = []

    def before_step(mbs, t):
        seen.append(handle.tip_position[0])
        handle.set_tensions(swing(t))
        return True

    other.SetPreStepUserFunction(before_step)
    assert other.SolveDynamic(recommended(handle, 0.04, 1e-3))
    assert distance(handle.shape()[0], expected.shape()[0]) < 1e-12 and len(set(seen)) > 30


# ---------------------------------------------------------------- states


def test_a_stored_state_restores_tensions_and_holes():
    """By `GetSystemState` and `SetSystemState`; in version 0.1 the holes kept their later states."""
    _keep, mbs, handle = scene(seven(0.3))
    solve_scene(mbs, handle, [1.5, 0.2, 0.1], [1.0, 0.2, 0.1])
    stored = mbs.systemData.GetSystemState()
    shape, tensions, holes = handle.shape()[0], handle.tensions(), handle.hole_states()
    onwards = solve_scene(mbs, handle, [0.4, 0.8, 0.1])
    assert handle.hole_states() != holes
    mbs.systemData.SetSystemState(stored)
    assert np.array_equal(handle.shape()[0], shape) and handle.hole_states() == holes
    for name, before in tensions.items():
        assert handle.tensions()[name] == pytest.approx(before, rel=1e-12)
    SolveTDCR(mbs)
    assert distance(handle.shape()[0], onwards) <= 1e-12


FIRST, *OTHERS = CONTACTS


@pytest.mark.parametrize("kind", [FIRST, *(pytest.param(k, marks=pytest.mark.integration) for k in OTHERS)])
def test_a_state_recorded_in_contact_is_gone_on_from(kind):
    """By statics: the same pull goes on to the same shape. By dynamics: at rest.

    The active sets of a `GeneralContact` are in no state of Exudyn: `UpdateContacts` finds them again. Without it
    `mbs.SolveDynamic` began with those of the state before, and moved by 2e-3 of the length.
    """
    _keep, mbs, handle, _ = scene_with(CONTACTS[kind], seven(0.3))
    solve_scene(mbs, handle, {"t1": 0.7})
    there = solve_scene(mbs, handle, {"t1": 1.5})
    recorded = mbs.systemData.GetSystemState()
    onwards = solve_scene(mbs, handle, {"t1": 1.8})
    assert distance(solve_scene(mbs, handle, {"t1": 0.2}), there) > 0.1

    def restore():
        for configuration in BOTH:
            mbs.systemData.SetSystemState(recorded, configuration)
        if kind.startswith("GeneralContact"):
            mbs.GetGeneralContact(0).UpdateContacts(mbs)

    restore()
    assert distance(solve_scene(mbs, handle, {"t1": 1.5}), there) < 1e-9
    assert distance(solve_scene(mbs, handle, {"t1": 1.8}), onwards) < 1e-9
    solve_scene(mbs, handle, {"t1": 0.2})
    restore()
    handle.set_tensions({"t1": 1.5})
    assert mbs.SolveDynamic(recommended(handle, 0.01, 1e-3))
    assert distance(handle.shape()[0], there) < 1e-6


# ---------------------------------------------------------------- files and variations


def test_after_a_failed_run_inputs_over_time_are_asked_anew():
    """They are kept in a step; the run after one that failed in its only step has the same time and history."""
    _keep, mbs, handle = scene(seven(0.3))
    settings, given = recommended(handle, 1.0, 1.0), [0.0, 0.0, 0.0]
    handle.set_inputs_over_time(lambda t: given)
    settings.staticSolver.adaptiveStep = False
    for tension, iterations, fails in ((0.07, 50, False), (9.0, 3, True), (0.05, 50, False)):
        given[0], settings.staticSolver.newton.maxIterations = tension, iterations
        mbs.SetPostStepUserFunction(lambda mbs, t: True)
        with pytest.raises(exu.SolverError) if fails else nullcontext():
            mbs.SolveStatic(settings)
    assert handle.tensions()["t1"][0] == pytest.approx(0.05)


def test_frames_of_a_solution_file_restore_the_run(tmp_path):
    """As `SolutionViewer` sets them: shape, tensions and holes of every frame. Inputs are asked once in a step."""
    _keep, mbs, handle = scene(seven(0.3))
    settings, seen, asked = recommended(handle, 0.08, 1e-3), {}, []
    handle.set_inputs_over_time(lambda t: asked.append(t) or swing(t))
    settings.solution.file.write, settings.solution.file.writePeriod = True, 0.02
    settings.solution.file.name = str(tmp_path / "motion.txt")
    settings.solution.file.binary, settings.solution.precision = False, 16

    def after_step(mbs, t):
        seen[round(t, 9)] = handle.shape()[0].copy()
        return True

    mbs.SetPostStepUserFunction(after_step)
    assert mbs.SolveDynamic(settings)
    assert len(asked) < 1.2 * len(seen)
    tensions, holes = handle.tensions(), handle.hole_states()
    solution = LoadSolutionFile(settings.solution.file.name, verbose=False)
    assert solution["nRows"] == 5
    for row in (1, 3, 4):
        SetSolutionState(mbs, solution, row, sendRedrawSignal=False)
        assert np.abs(handle.shape()[0] - seen[round(0.02 * row, 9)]).max() < 1e-12
    assert handle.hole_states() == holes
    for name, values in tensions.items():
        assert handle.tensions()[name] == pytest.approx(values, abs=1e-9)


def test_a_run_goes_on_from_the_restart_file_of_exudyn(tmp_path):
    """In another system, after the run was stopped by an error: the same end, holes and sums of energy too."""

    def made():
        made = scene_with(lambda mbs, arm: arm.add_energy_sensor(), seven(0.3))
        made[2].set_inputs_over_time(swing)
        return made

    def settings(handle, end):
        found = recommended(handle, end, 1e-3)
        found.solution.restart.name, found.solution.restart.writePeriod = str(tmp_path / "restart.txt"), 0.01
        return found

    _keep, mbs, expected, sensor = made()
    assert mbs.SolveDynamic(settings(expected, 0.04))
    energy = np.array(mbs.GetSensorValues(sensor))
    _keep, mbs, handle, sensor = made()
    first = settings(handle, 0.04)
    first.solution.restart.write = True

    def stop(mbs, t):
        if t > 0.0255:
            raise ArithmeticError("stopped")
        return True

    mbs.SetPreStepUserFunction(stop)
    with pytest.raises(exu.ModelError, match="stopped"):
        mbs.SolveDynamic(first)
    _keep, mbs, handle, sensor = made()
    second = settings(handle, 0.04)
    second.solution.restart.continueIfAvailable = True
    assert mbs.SolveDynamic(second)
    assert distance(handle.shape()[0], expected.shape()[0]) < 1e-10
    assert handle.hole_states() == expected.hole_states()
    assert mbs.GetSensorValues(sensor) == pytest.approx(energy, abs=1e-9 * np.abs(energy).max())


# ---------------------------------------------------------------- memory


def made_and_dropped() -> weakref.ref:
    _keep, mbs, handle = scene(seven(0.3))
    solve_scene(mbs, handle, {"t1": 0.1})
    return weakref.ref(handle.actuation)


def test_a_robot_whose_scene_is_dropped_is_freed():
    """In version 0.1 the system, its variables and the functions there kept each other."""
    dropped = made_and_dropped()
    gc.collect()
    assert dropped() is None
