"""Solvers one after the other on one scene: states that are copied or set by hand, files, parameter variations."""

from __future__ import annotations

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
import pytest
from contacts import CONTACTS
from exudyn import robotics
from exudyn.processing import ParameterVariation
from exudyn.utilities import HTtranslate, InertiaCuboid, LoadSolutionFile, SetSolutionState
from native_solvers import static_settings
from robots import LENGTH, distance, scene, three

from tdcr_fe.native import register
from tdcr_fe.scene import TDCR
from tdcr_fe.solve.statics import SolveTDCR

register()
BOTH = (exu.ConfigurationType.Current, exu.ConfigurationType.Initial)


def settings_of(handle: TDCR, end: float, start: float = 0.0):
    settings = handle.recommended_settings(end - start, 1e-3)
    settings.timeIntegration.startTime, settings.timeIntegration.endTime = start, end
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    return settings


def pull(mbs, handle, tension: float) -> np.ndarray:
    """Positions of the nodes after a pull of the first tendon."""
    handle.set_tensions({"t1": tension})
    SolveTDCR(mbs)
    return handle.shape()[0]


# ---------------------------------------------------------------- contact


@pytest.mark.parametrize("mu", [0.0, 0.3])
@pytest.mark.parametrize("kind", CONTACTS)
def test_a_state_recorded_in_contact_is_gone_on_from(kind, mu):
    """By statics: the same pull goes on to the same shape. By dynamics: at rest, and a release moves as the first time.

    The active sets of a `GeneralContact` are in no state of Exudyn: `UpdateContacts` finds them again. Without it
    `mbs.SolveDynamic` began with those of the state before, and moved by 2e-3 of the length.
    """
    _keep, mbs, handle = scene(three(mu), assemble=False)
    CONTACTS[kind](mbs, handle)
    mbs.Assemble()
    pull(mbs, handle, 0.7)
    there = pull(mbs, handle, 1.5)
    recorded = mbs.systemData.GetSystemState()
    onwards = pull(mbs, handle, 1.8)
    assert distance(pull(mbs, handle, 0.2), there) > 0.1

    def restore():
        for configuration in BOTH:
            mbs.systemData.SetSystemState(recorded, configuration)
        if kind.startswith("GeneralContact"):
            mbs.GetGeneralContact(0).UpdateContacts(mbs)

    restore()
    assert distance(pull(mbs, handle, 1.5), there) < 1e-9
    assert distance(pull(mbs, handle, 1.8), onwards) < 1e-9
    pull(mbs, handle, 0.2)
    restore()
    handle.set_tensions({"t1": 1.5})
    assert mbs.SolveDynamic(settings_of(handle, 0.01))
    assert distance(handle.shape()[0], there) < 1e-6
    released = []
    for _ in range(2):
        restore()
        handle.set_tensions({"t1": 0.5})
        assert mbs.SolveDynamic(settings_of(handle, 0.01))
        released.append(handle.shape()[0])
    assert distance(*released) < 1e-12
    assert distance(released[0], there) > 1e-3


# ---------------------------------------------------------------- solvers in turn


def test_static_dynamic_and_quasi_static_solvers_in_turn_stay_at_rest():
    """Under a load whose user function ramps in the first call and is another one, constant, in the next ones."""
    _keep, mbs, handle = scene(three(0.3), assemble=False)
    load = mbs.AddLoad(
        eii.Force(
            markerNumber=handle.mTip,
            loadVector=[0.0] * 3,
            loadVectorUserFunction=lambda mbs, t, vector: [0.02 * min(t, 1.0), 0.0, 0.0],
        )
    )
    mbs.Assemble()
    handle.set_tensions([1.0, 0.1, 0.1])
    SolveTDCR(mbs)
    start = handle.shape()[0]
    mbs.SetLoadParameter(load, "loadVectorUserFunction", lambda mbs, t, vector: [0.02, 0.0, 0.0])
    assert mbs.SolveStatic(static_settings(5), updateInitialValues=True)
    assert mbs.SolveDynamic(settings_of(handle, 0.05), updateInitialValues=True)
    assert distance(handle.shape()[0], start) < 1e-9
    SolveTDCR(mbs)
    assert distance(handle.shape()[0], start) < 1e-9
    # A jump of a load of the user's own is a sudden load: the robot swings, and rests where statics say.
    mbs.SetLoadParameter(load, "loadVectorUserFunction", 0)
    mbs.SetLoadParameter(load, "loadVector", [0.0, 0.01, 0.0])
    assert mbs.SolveDynamic(settings_of(handle, 0.02))
    assert distance(handle.shape()[0], start) > 1e-3


def test_coordinates_that_were_set_by_hand_do_not_change_the_solution_without_friction():
    """The robot straight again, and every coordinate off by a thousandth: the same equilibrium is found."""
    _keep, mbs, handle = scene(three(0.0))
    handle.set_tensions([1.0, 0.1, 0.1])
    SolveTDCR(mbs)
    expected, rng = handle.shape()[0], np.random.default_rng(0)
    bent = np.array(mbs.systemData.GetODE2Coordinates())
    for by_hand in (0.0 * bent, bent + 1e-3 * rng.normal(size=bent.shape)):
        mbs.systemData.SetODE2Coordinates(by_hand)
        assert distance(handle.shape()[0], expected) > 1e-3
        SolveTDCR(mbs)
        assert distance(handle.shape()[0], expected) < 1e-8


def test_explicit_integrators_are_refused_and_both_implicit_ones_agree():
    """Nodes with Euler parameters have algebraic equations, which Exudyn's explicit integrators do not solve.

    At 0.25 ms, without numerical damping; at 1 ms the truncation errors of the implicit ones differ by 1e-5.
    """
    tips = []
    kinds = exu.DynamicSolverType
    for kind in (
        kinds.ExplicitMidpoint,
        kinds.RK44,
        kinds.DOPRI5,
        kinds.GeneralizedAlpha,
        kinds.TrapezoidalIndex2,
    ):
        _keep, mbs, handle = scene(three(0.3))
        handle.set_inputs_over_time(lambda t: [1.0 - np.cos(50.0 * t), 0.1, 0.1])
        settings = settings_of(handle, 0.02)
        settings.timeIntegration.numberOfSteps = 80
        settings.timeIntegration.generalizedAlpha.spectralRadius = 1.0
        if kind in (kinds.GeneralizedAlpha, kinds.TrapezoidalIndex2):
            assert mbs.SolveDynamic(settings, solverType=kind)
            tips.append(handle.tip_position)
        else:
            with pytest.raises(exu.ModelError, match="node 0 which contains algebraic variables"):
                mbs.SolveDynamic(settings, solverType=kind)
    assert distance(*tips) < 1e-6
    assert distance(tips[0], [0.0, 0.0, LENGTH]) > 1e-3


# ---------------------------------------------------------------- files and variations


def test_a_run_goes_on_from_a_frame_of_a_solution_file(tmp_path):
    """The second half again, from the frame in the middle: where the whole run ends, tensions and holes as there."""
    _keep, mbs, handle = scene(three(0.3))
    handle.set_inputs_over_time(lambda t: [1.0 - np.cos(50.0 * t), 0.1, 0.1])
    settings = settings_of(handle, 0.04)
    settings.solution.file.write, settings.solution.file.writePeriod = True, 0.01
    settings.solution.file.name = str(tmp_path / "motion.txt")
    settings.solution.file.binary, settings.solution.precision = False, 16
    assert mbs.SolveDynamic(settings)
    end, tensions, holes = handle.shape()[0], handle.tensions(), handle.hole_states()
    SetSolutionState(
        mbs, LoadSolutionFile(settings.solution.file.name, verbose=False), 2, sendRedrawSignal=False
    )
    middle = mbs.systemData.GetSystemState()
    mbs.systemData.SetSystemState(middle, exu.ConfigurationType.Initial)
    assert mbs.SolveDynamic(settings_of(handle, 0.04, 0.02))
    # The state has no accelerations of the integrator, which begins anew in the middle.
    assert distance(handle.shape()[0], end) < 1e-3
    assert handle.hole_states() == holes
    for name, values in tensions.items():
        assert handle.tensions()[name] == pytest.approx(values, rel=1e-3)


def test_sensors_write_the_files_of_exudyn(tmp_path):
    """Of the tip, in every step of `mbs.SolveDynamic`; what `mbs.SolveTDCR` solves is read from the sensor."""
    _keep, mbs, handle = scene(three(0.3), assemble=False)
    sensors = handle.add_sensors(fileName=str(tmp_path / "arm"))
    mbs.Assemble()
    pull(mbs, handle, 1.0)
    assert mbs.GetSensorValues(sensors["tip_position"]) == pytest.approx(handle.tip_position, rel=1e-12)
    settings = settings_of(handle, 0.02)
    settings.solution.sensors.writePeriod = 1e-3
    assert mbs.SolveDynamic(settings)
    files = sorted(tmp_path.iterdir())
    tip = next(file for file in files if "tip_position" in file.name)
    rows = np.loadtxt(tip, comments="#", delimiter=",")
    assert rows.shape == (21, 4)
    assert distance(rows[-1, 1:], handle.tip_position) < 1e-6


def test_a_parameter_variation_of_exudyn_gives_the_tips_of_single_runs():
    def tip(parameters):
        _keep, mbs, handle = scene(three(parameters["mu"]))
        return float(pull(mbs, handle, parameters["tension"])[-1, 0])

    grid, found = ParameterVariation(
        parameterFunction=tip,
        parameters={"mu": (0.0, 0.3, 2), "tension": (0.5, 1.0, 2)},
        useMultiProcessing=False,
        showProgress=False,
    )
    for mu, tension, value in zip(grid["mu"], grid["tension"], found, strict=True):
        assert value == pytest.approx(tip({"mu": mu, "tension": tension}), rel=1e-12)
    assert len(set(found)) == 4


# ---------------------------------------------------------------- control, restarts, minimal coordinates


def swing(t: float) -> list[float]:
    """Tensions over time [N]."""
    return [1.0 - np.cos(50.0 * t), 0.1, 0.1]


def test_tensions_set_in_a_prestep_function_are_those_of_inputs_over_time():
    """A control loop: the tensions of a step are set at its beginning, from what the last one has measured."""
    _keep, mbs, expected = scene(three(0.3))
    expected.set_inputs_over_time(swing)
    assert mbs.SolveDynamic(settings_of(expected, 0.04))
    _keep_other, other, handle = scene(three(0.3))
    handle.set_tensions(swing(0.0))
    seen = []

    def before_step(mbs, t):
        seen.append(handle.tip_position[0])
        handle.set_tensions(swing(t))
        return True

    other.SetPreStepUserFunction(before_step)
    assert other.SolveDynamic(settings_of(handle, 0.04))
    assert distance(handle.shape()[0], expected.shape()[0]) < 1e-12
    assert len(set(seen)) > 30


def test_tensions_first_set_in_a_prestep_function_miss_the_initial_accelerations():
    """Exudyn computes these before: a pull that begins at once comes late by a part of the first step."""

    def shape(step, before):
        _keep, mbs, handle = scene(three(0.3))

        def before_step(mbs, t):
            handle.set_tensions([0.5, 0.1, 0.1])
            return True

        if before:
            before_step(mbs, 0.0)
        mbs.SetPreStepUserFunction(before_step)
        settings = settings_of(handle, 0.04)
        settings.timeIntegration.numberOfSteps = round(0.04 / step)
        assert mbs.SolveDynamic(settings)
        return handle.shape()[0]

    gaps = [distance(shape(step, True), shape(step, False)) for step in (1e-3, 5e-4)]
    assert gaps[0] < 2e-3
    assert gaps[1] == pytest.approx(0.5 * gaps[0], rel=0.2)


@pytest.mark.parametrize("end", ["whole", "stopped"])
def test_a_run_goes_on_from_the_restart_file_of_exudyn(tmp_path, end):
    """In another system, after the run was over or stopped by an error: the same end, holes and sums of energy too."""

    def made():
        keep, mbs, handle = scene(three(0.3), assemble=False)
        sensor = handle.add_energy_sensor()
        mbs.Assemble()
        handle.set_inputs_over_time(swing)
        return keep, mbs, handle, sensor

    def settings(handle, end):
        found = settings_of(handle, end)
        found.solution.restart.name, found.solution.restart.writePeriod = str(tmp_path / "restart.txt"), 0.01
        return found

    _keep, mbs, expected, sensor = made()
    assert mbs.SolveDynamic(settings(expected, 0.04))
    energy = np.array(mbs.GetSensorValues(sensor))
    _keep, mbs, handle, sensor = made()
    first = settings(handle, 0.02 if end == "whole" else 0.04)
    first.solution.restart.write = True
    if end == "stopped":

        def stop(mbs, t):
            if t > 0.0255:
                raise ArithmeticError("stopped")
            return True

        mbs.SetPreStepUserFunction(stop)
        with pytest.raises(exu.ModelError, match="stopped"):
            mbs.SolveDynamic(first)
    else:
        assert mbs.SolveDynamic(first)
    _keep, mbs, handle, sensor = made()
    second = settings(handle, 0.04)
    second.solution.restart.continueIfAvailable = True
    assert mbs.SolveDynamic(second)
    assert distance(handle.shape()[0], expected.shape()[0]) < 1e-10
    assert handle.hole_states() == expected.hole_states()
    assert mbs.GetSensorValues(sensor) == pytest.approx(energy, abs=1e-9 * np.abs(energy).max())


def test_a_kinematic_tree_of_exudyn_robotics_carries_a_robot():
    """Minimal coordinates: a force at the robot's tip turns two joints by its moments over their stiffness."""
    keep = exu.SystemContainer()
    mbs = keep.AddSystem()
    arm = robotics.Robot(gravity=[0.0] * 3, base=robotics.RobotBase(), tool=robotics.RobotTool())
    inertia = InertiaCuboid(density=1000.0, sideLengths=[0.05, 0.05, 0.3]).Translated([0.0, 0.0, 0.15])
    for offset in (0.0, 0.3):
        arm.AddLink(
            robotics.RobotLink(
                mass=inertia.Mass(),
                COM=inertia.COM(),
                inertia=inertia.InertiaCOM(),
                preHT=HTtranslate([0.0, 0.0, offset]),
                jointType="Ry",
                PDcontrol=(2.0, 0.1),
            )
        )
    tree = arm.CreateKinematicTree(mbs)
    end = eii.MarkerKinematicTreeRigid(
        objectNumber=tree["objectKinematicTree"], linkNumber=1, localPosition=[0.0, 0.0, 0.3]
    )
    handle = mbs.CreateTDCR(three(0.3), baseMarker=mbs.AddMarker(end))
    load = handle.add_load("tip", LENGTH)
    mbs.Assemble()
    assert handle.shape()[0][0] == pytest.approx([0.0, 0.0, 0.6], abs=1e-12)
    handle.set_tensions([0.5, 0.0, 0.0])
    load.set([0.05, 0.0, -0.02])
    SolveTDCR(mbs)
    first, second = mbs.GetNodeOutput(tree["nodeGeneric"], exu.OutputVariableType.Coordinates)
    elbow = 0.3 * np.array([np.sin(first), 0.0, np.cos(first)])
    for angle, joint in ((first, np.zeros(3)), (second, elbow)):
        lever = handle.tip_position - joint
        assert angle == pytest.approx((lever[2] * 0.05 + lever[0] * 0.02) / 2.0, rel=1e-6)
    there = handle.shape()[0]
    assert mbs.SolveDynamic(settings_of(handle, 0.02))
    assert distance(handle.shape()[0], there) < 1e-9
