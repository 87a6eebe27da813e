"""Concentrated loads in a scene: SolveTDCR ramps them along a resolved path, as simulate does."""

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
import pytest
from robots import LENGTH, distance, seven, single, solve
from scenes import push, recommended, scene_with, solve_scene, tip_load

from tdcr_fe import Load, LoadStep, SolverSettings, SolveTDCR, StepFailed

SEEDS = [1, pytest.param(2, marks=pytest.mark.integration)]
SEEDS += [pytest.param(seed, marks=pytest.mark.campaign) for seed in range(3, 21)]


@pytest.mark.parametrize("seed", SEEDS)
def test_random_sequences_give_the_shapes_of_simulate(seed):
    """Three tendons by tension or displacement, a load of changing direction in either frame; every step.

    In version 0.1 the load jumped while the tensions were ramped: 20 sequences were 0.9 % of the length off in the
    median and 5.2 % at worst.
    """
    rng = np.random.default_rng(seed)
    robot, frame = seven(0.3), ("world", "section")[seed % 2]
    _keep, mbs, handle, load = scene_with(lambda mbs, arm: arm.add_load("tip", LENGTH, frame), robot)
    steps, shapes = [], []
    for k in range(3):
        tensions = {n: float(rng.uniform(0.0, 1.5)) for n in robot.tendon_names}
        displacements = {"t3": float(rng.uniform(0.0, 2e-3))} if k == 1 else {}
        tensions = {n: t for n, t in tensions.items() if n not in displacements}
        force, moment = rng.normal(size=3) * 0.02, rng.normal(size=3) * 5e-4
        loads = {"tip": Load(LENGTH, tuple(force.tolist()), tuple(moment.tolist()), frame)}
        steps.append(LoadStep("", tensions, displacements, loads))
        handle.set_tensions(tensions)
        if displacements:
            handle.set_displacements(displacements)
        push(mbs, load, force, moment)
        shapes.append(handle.shape()[0])
    for shape, step in zip(shapes, solve(robot, steps).steps, strict=True):
        assert distance(shape, step.positions) < 1e-9


def test_a_load_that_fails_within_the_step_is_kept_as_set_and_resumed():
    """A load of 1e5 N: the scene is left in the last solved state, the set load is kept, and unloading is possible."""
    _keep, mbs, handle, load = scene_with(tip_load, single(0.3))
    start = solve_scene(mbs, handle, [1.0])
    push(mbs, load, [0.0, 0.01, 0.0])
    load.set([0.0, 0.0, -1e5])
    with pytest.raises(StepFailed) as caught:
        SolveTDCR(mbs, SolverSettings(min_substep=0.5))
    reached = caught.value.load_factor
    assert load.value == pytest.approx([0.0, 0.0, -1e5, 0.0, 0.0, 0.0])
    expected = [0.0, 0.01 * (1 - reached), -1e5 * reached, 0.0, 0.0, 0.0]
    assert load.applied == pytest.approx(expected, abs=1e-12)
    push(mbs, load, [0.0, 0.0, 0.0])
    assert distance(handle.shape()[0], start) < 0.05


def test_a_force_over_time_ends_in_one_state_whether_a_load_or_a_spring_applies_it():
    """It rises and falls again; that of the spring was taken as constant: 64 substeps, and tensions 9 % off."""
    ends = []
    for kind in ("load", "spring"):

        def add(mbs, arm, kind=kind):
            def force(t):
                return [0.0, 0.08 * np.sin(2.0 * np.pi * t), 0.0]

            if kind == "load":
                push = {"loadVector": [0.0] * 3, "loadVectorUserFunction": lambda mbs, t, load: force(t)}
                return mbs.AddLoad(eii.Force(markerNumber=arm.mTip, **push))
            ground = mbs.AddMarker(eii.MarkerBodyPosition(bodyNumber=mbs.CreateGround()))
            pull = {"springForceUserFunction": lambda mbs, t, *rest: [-f for f in force(t)]}
            return mbs.AddObject(eii.CartesianSpringDamper(markerNumbers=[ground, arm.mTip], **pull))

        _keep, mbs, handle, _ = scene_with(add, seven(0.3))
        solve_scene(mbs, handle, [1.0, 0.4, 0.4])
        assert mbs.SolveTDCR(endTime=0.35)["refinement_error"] == 0.0
        ends.append((handle.shape()[0], np.concatenate(list(handle.tensions().values()))))
    assert distance(ends[0][0], ends[1][0]) < 1e-8
    assert ends[0][1] == pytest.approx(ends[1][1], abs=1e-8)


def test_a_force_that_rises_and_falls_within_a_step_leaves_its_trace():
    """Friction holds what the force has moved, as where it rises in one step and falls in the next."""
    _keep, mbs, handle, load = scene_with(tip_load, single(0.3))
    start = solve_scene(mbs, handle, [1.0])
    for force in (0.08, 0.0):
        push(mbs, load, [0.0, force, 0.0])

    def add(mbs, arm):
        push = {"loadVectorUserFunction": lambda mbs, t, load: [0.0, 0.08 * np.sin(np.pi * t), 0.0]}
        return mbs.AddLoad(eii.Force(markerNumber=arm.mTip, loadVector=[0.0] * 3, **push))

    _keep_other, other, same, _ = scene_with(add, single(0.3))
    solve_scene(other, same, [1.0])
    SolveTDCR(other, endTime=1.0)
    assert distance(handle.shape()[0], start) > 1e-3
    assert distance(same.shape()[0], handle.shape()[0]) < 1e-6


def test_copies_of_the_state_have_the_load_that_acted_in_it():
    """Back to the state before a load, the ramp begins there again: the same path to the last digits.

    As long as the last load was no part of the state, the second ramp began at the load of the first.
    """
    _keep, mbs, handle, load = scene_with(tip_load, single(0.3))
    handle.set_tensions([2.0])
    push(mbs, load, [0.0, 0.01, 0.0])
    before = mbs.systemData.GetSystemState()
    shapes = []
    for _ in range(2):
        report = push(mbs, load, [-0.05, 0.0, 0.0])
        shapes.append(handle.shape()[0])
        assert load.applied == pytest.approx([-0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
        for kind in (exu.ConfigurationType.Current, exu.ConfigurationType.Initial):
            mbs.systemData.SetSystemState(before, kind)
        assert load.applied == pytest.approx([0.0, 0.01, 0.0, 0.0, 0.0, 0.0])
    assert report["substeps"] > 1 and distance(*shapes) < 1e-9


def test_a_scene_that_was_changed_is_solved_anew():
    """A softer backbone, a load of the user: what the last step left is used only where nothing has changed."""
    _keep, mbs, handle, _ = scene_with(tip_load, single(0.0), friction="none")
    own = mbs.AddLoad(eii.Force(markerNumber=handle.mTip, loadVector=[0.0, 0.0, 0.0]))
    mbs.Assemble()
    solve_scene(mbs, handle, [1.0])
    mbs.SetLoadParameter(own, "loadVector", [0.0, 0.02, 0.0])
    handle.set_compliance_factor(1.1)
    SolveTDCR(mbs)
    _keep_other, other, compared, load = scene_with(tip_load, single(0.0), friction="none")
    compared.set_compliance_factor(1.1)
    solve_scene(other, compared, [1.0])
    push(other, load, [0.0, 0.02, 0.0])
    assert distance(handle.tip_position, compared.tip_position) < 1e-7


def test_a_load_solved_by_exudyn_counts_as_applied():
    """After mbs.SolveStatic the next ramp begins at that load, so nothing changes."""
    _keep, mbs, handle, load = scene_with(tip_load, single(0.0), friction="none")
    load.set([0.0, 0.02, 0.0])
    assert mbs.SolveStatic(recommended(handle, 1.0, 0.1))
    assert load.applied == pytest.approx([0.0, 0.02, 0.0, 0.0, 0.0, 0.0])
    before = handle.tip_position
    SolveTDCR(mbs)
    assert distance(handle.tip_position, before) < 1e-5


def test_the_solution_is_at_rest():
    """After dynamics, statics leave no velocity behind, in the current and in the initial configuration."""
    _keep, mbs, handle, load = scene_with(tip_load, single(0.0), friction="none")
    load.set([0.0, 0.005, 0.0])
    assert mbs.SolveDynamic(recommended(handle, 0.02, 1e-3))
    data = mbs.systemData
    assert np.max(np.abs(data.GetODE2Coordinates_t())) > 1e-3
    SolveTDCR(mbs)
    for kind in (exu.ConfigurationType.Current, exu.ConfigurationType.Initial):
        assert not np.any(data.GetODE2Coordinates_t(kind))
