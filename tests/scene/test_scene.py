"""A robot in an Exudyn scene: its base, other bodies, several robots, user hooks, setting and reading, a rope."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
import pytest
from exudyn.robotics import Robot as Arm
from exudyn.robotics import RobotLink
from exudyn.utilities import InertiaCuboid
from robots import BACKBONE, LENGTH, MODEL, SEVEN, distance, pull, seven, single, solve
from scenes import hinged_platform, pendulum, push, recommended, scene, scene_with, solve_scene, system
from scipy.spatial.transform import Rotation

from tdcr_fe import CreateTDCR, Load, LoadStep, Model, SolverSettings, StepFailed
from tdcr_fe.solve.equations.kernel import StaticKernel
from tdcr_fe.solve.equations.system import SceneSystem

STRAIGHT = np.array([0.0, 0.0, LENGTH])


def single_tip(mu: float = 0.3, tension: float = 1.0, **load) -> np.ndarray:
    """Tip of the paper's robot on ground."""
    loads = {"tip": Load(LENGTH, **load)} if load else {}
    return solve(single(mu), [LoadStep("", {"t1": tension}, loads=loads)]).tips[-1]


# ---------------------------------------------------------------- base


def test_a_moved_base_moves_the_solution():
    turn = Rotation.random(random_state=0).as_matrix()
    at = np.random.default_rng(0).normal(size=3)
    _keep, mbs, handle = scene(single(0.3), referencePosition=at, referenceRotationMatrix=turn)
    assert distance(handle.tip_position, at + turn @ STRAIGHT) < 1e-12
    solve_scene(mbs, handle, [1.0], [2.0], [1.0])
    expected = solve(single(0.3), pull(1.0, 2.0, 1.0)).steps[-1]
    assert distance(handle.tip_position, at + turn @ expected.tip) < 1e-9
    assert handle.tip_rotation == pytest.approx(turn @ expected.rotations[-1], abs=1e-8)


@pytest.mark.parametrize("lever", [0.0, 0.01])
def test_robots_side_by_side_move_as_each_alone(monkeypatch, lever):
    """Pulled, and released so that holes reverse, with weight, damping, loads of both kinds and unlike meshes.

    A force of the user with a lever turns its body, so that the robots are solved as one system. In both cases Exudyn
    finds the scene in equilibrium. Robots that are solved alone evaluate it once under a target: 40 robots took 1.8
    times as long each as 5.
    """
    backbone = replace(BACKBONE, density=7800.0, retardation_time=1e-3)
    robots = [seven(0.2, backbone, replace(SEVEN, mass=1e-3)), seven(0.3, backbone), seven(0.1)]
    kinds = [(1, "per-hole"), (2, "per-hole"), (1, "per-tendon")]
    models = [Model(elements_per_bay=n, friction=x, gravity=(0.0, 0.0, -9.81)) for n, x in kinds]
    steps = [([1.0, 0.3, 0.2], [2e-3, -1e-3, -1e-3], [1.0, 0.0, 0.0])]
    steps += [([0.3, 0.6, 0.2], [1e-3, -4e-4, -5e-4], [0.4, 0.0, 0.0])]

    def solved_scene(which: Sequence[int]) -> tuple[list[np.ndarray], exu.SystemContainer, exu.MainSystem]:
        keep, mbs = system()
        arms, loads = [], []
        for k in which:
            arm = CreateTDCR(mbs, robots[k], models[k], name=f"r{k}", referencePosition=[0.3 * k, 0.0, 0.0])
            marker = eii.MarkerBodyRigid(bodyNumber=arm.bDisks[-1], localPosition=[0.0, lever, 0.0])
            mbs.AddLoad(eii.Force(markerNumber=mbs.AddMarker(marker), loadVector=[0.0, 0.02, 0.0]))
            arms.append(arm)
            loads.append(arm.add_load("tip", LENGTH))
        mbs.Assemble()
        for step in steps:
            for k, arm, load in zip(which, arms, loads, strict=True):
                (arm.set_displacements if k == 1 else arm.set_tensions)(step[k])
                load.set([0.03 * step[k][0], 0.0, 0.0])
            mbs.SolveTDCR()
        return [arm.tip_position for arm in arms], keep, mbs

    tips, _keep, mbs = solved_scene([0, 1, 2])
    assert len(SceneSystem(mbs).independent()) == (3 if lever == 0.0 else 1)
    for k, tip in enumerate(tips):
        assert distance(tip, solved_scene([k])[0][0]) < (1e-9 if lever == 0.0 else 1e-5) * LENGTH
    present = SceneSystem(mbs)
    state = present.current_state()
    target = state.target
    assert present.residual(state, target, present.numbering()).size < 1e-7
    whole, evaluations = StaticKernel.residual, []
    monkeypatch.setattr(StaticKernel, "residual", lambda kernel: evaluations.append(0) or whole(kernel))
    for part in (parts := present.independent()):
        evaluations.clear()
        target = (state := part.current_state()).target
        sizes = [part.residual(state, target, part.numbering()).size for _ in range(3)]
        assert len(evaluations) == (1 if len(parts) == 3 else 3) and max(sizes) < 1e-7


def test_base_on_an_elastically_supported_body():
    """A robot on a platform on a spring that turns about y: the platform carries the robot's tip load.

    Moment at the hinge by the tip force F along x: F z_tip = k phi, with everything turned by phi.
    """
    stiffness, force = 0.5, 0.05
    _keep, mbs, platform = hinged_platform(stiffness)
    handle = CreateTDCR(mbs, single(0.3), MODEL, baseMarker=platform)
    load = handle.add_load("tip", LENGTH)
    mbs.Assemble()
    load.set([force, 0.0, 0.0])
    solve_scene(mbs, handle, [1.0])
    r = handle.shape()[1][0]
    assert stiffness * np.arctan2(r[0, 2], r[2, 2]) == pytest.approx(force * handle.tip_position[2], rel=1e-6)
    assert distance(r.T @ handle.tip_position, single_tip(force=tuple(r.T @ [force, 0.0, 0.0]))) < 1e-8


def test_weight_alone_holds_a_pendulum_that_carries_a_robot():
    """The moment of all weights about the hinge vanishes.

    It was refused: the stiffness of the weight is that of the force of the hinge, which keeps its lever on the bar.
    """
    robot = single(0.3).with_disks(mass=2e-3)
    _keep, mbs, handle, bar = pendulum(robot)
    x = solve_scene(mbs, handle, [1.0])[:, 0]
    elements = robot.backbone.mass_per_length * np.diff(handle.arc_lengths)
    moment = elements @ (x[1:] + x[:-1]) / 2.0 + robot.disks.mass * x[1:].sum()
    of_bar = 0.16 * mbs.GetObjectOutputBody(bar, exu.OutputVariableType.Position)[0]
    assert abs(moment + of_bar) < 1e-6 * moment and of_bar < -1e-4


def test_a_force_on_the_second_link_of_an_arm_turns_the_first_one_against_its_spring():
    """Its moment grows as the first link turns; this was left out of the tangent, and no equilibrium was found."""
    _keep, mbs = system()
    k, length, force = 0.05, 0.2, (-1.0, 0.0, -0.5)
    link = InertiaCuboid(2e3, [length, 0.02, 0.02]).Translated([length / 2, 0.0, 0.0])
    arm = Arm(gravity=[0.0] * 3)
    for at in (0.0, length):
        there = exu.HT(rotation=np.eye(3), translation=[at, 0.0, 0.0])
        given = {"jointType": "Ry", "preHT": there, "PDcontrol": (k, 0.0)}
        arm.AddLink(RobotLink(link.mass, link.COM(), link.InertiaCOM(), **given))
    items = arm.CreateKinematicTree(mbs)
    node, of_arm = items["nodeGeneric"], {"objectNumber": items["objectKinematicTree"], "linkNumber": 1}
    markers = (eii.MarkerKinematicTreeRigid(**of_arm, localPosition=[x, 0.0, 0.0]) for x in (0.0, length))
    ends = [mbs.AddMarker(marker) for marker in markers]
    mbs.AddLoad(eii.Force(markerNumber=ends[0], loadVector=force))
    handle = CreateTDCR(mbs, single(0.3), MODEL, baseMarker=ends[1])
    mbs.Assemble()
    solve_scene(mbs, handle, [1.0])
    first, second = mbs.GetNodeOutput(node, exu.OutputVariableType.Coordinates)
    x, z = length * np.cos(first), -length * np.sin(first)
    assert k * first == pytest.approx(z * force[0] - x * force[2], rel=1e-6)
    assert abs(second) < 1e-6


def test_a_pendulum_that_swings_in_a_dynamic_run_comes_to_rest_below_its_hinge():
    """From 43 degrees. The forces of joints have another sign there: it took 132 iterations, and a snap-through."""
    _keep, mbs, handle, bar = pendulum(seven(0.0).with_backbone(radius=2e-3))
    marker = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=bar))
    force = mbs.AddLoad(eii.Force(markerNumber=marker, loadVector=[2.0, 0.0, 0.0]))
    mbs.Assemble()
    assert mbs.SolveDynamic(recommended(handle, 0.2, 1e-3))
    assert mbs.GetObjectOutputBody(bar, exu.OutputVariableType.Position)[0] > 0.06
    mbs.SetLoadParameter(force, "loadVector", [0.0, 0.0, 0.0])
    report = mbs.SolveTDCR()
    assert not report["snapped"] and report["iterations_total"] < 30
    assert abs(mbs.GetObjectOutputBody(bar, exu.OutputVariableType.Position)[0]) < 1e-7


def test_a_mass_on_a_thread_hangs_below_the_tip():
    """In the first solution of the scene, too, where the force of the thread is not known yet: its weight is a load."""
    mass, thread = 2e-3, 0.05
    _keep, mbs, handle = scene(single(0.3), assemble=False)
    ball = mbs.CreateMassPoint(referencePosition=STRAIGHT - [0, 0, thread], mass=mass, gravity=[0, 0, -9.81])
    ends = [handle.mTip, mbs.AddMarker(eii.MarkerBodyPosition(bodyNumber=ball))]
    mbs.AddObject(eii.DistanceConstraint(markerNumbers=ends, distance=thread))
    mbs.Assemble()
    solve_scene(mbs, handle, [0.5], [1.0])
    expected = single_tip(force=(0.0, 0.0, -9.81 * mass))
    assert distance(handle.tip_position, expected) < 1e-6
    hanging = mbs.GetObjectOutputBody(ball, exu.OutputVariableType.Position)
    assert distance(hanging, expected - [0.0, 0.0, thread]) < 1e-6


def test_base_on_the_tip_of_another_robot():
    """The second robot is joined to the first one's tip; unloaded it follows as a rigid body."""
    _keep, mbs = system()
    first = CreateTDCR(mbs, single(0.3), MODEL, name="first")
    at_tip = {"referencePosition": STRAIGHT, "baseMarker": first.mTip}
    second = CreateTDCR(mbs, single(0.3), MODEL, name="second", **at_tip)
    mbs.Assemble()
    solve_scene(mbs, first, [1.0])
    assert distance(first.tip_position, single_tip()) < 1e-8
    assert distance(second.tip_position, first.tip_position + first.tip_rotation @ STRAIGHT) < 1e-7
    solve_scene(mbs, second, [1.0])
    assert distance(first.tip_position, single_tip()) < 1e-8
    assert distance(second.tip_position, first.tip_position + first.tip_rotation @ single_tip()) < 1e-7


def test_no_time_passes_and_motion_goes_on_from_a_base_that_is_driven():
    """By a user function of time: with time from 0 to 1 the base stood where it is at 1 s, and the motion failed."""
    _keep, mbs = system()
    bodies = (mbs.CreateRigidBody(inertia=InertiaCuboid(1e3, [0.05] * 3)), mbs.CreateGround())
    marker, ground = (mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=x)) for x in bodies)

    def offset(mbs, t, item, parameters):
        return [0.1 * np.sin(t), 0.0, 0.0, 0.0, 0.0, 0.0]

    drive = {"constrainedAxes": [1] * 6, "offsetUserFunction": offset}
    mbs.AddObject(eii.GenericJoint(markerNumbers=[ground, marker], **drive))
    handle = CreateTDCR(mbs, single(0.3), MODEL, baseMarker=marker)
    mbs.Assemble()
    solve_scene(mbs, handle, [1.0])
    assert distance(handle.tip_position, single_tip()) < 1e-8
    assert mbs.SolveDynamic(recommended(handle, 0.01, 1e-3))
    assert handle.position_at(0.0) == pytest.approx([0.1 * np.sin(0.01), 0.0, 0.0], abs=1e-9)
    mbs.SolveTDCR(endTime=0.5)
    assert handle.position_at(0.0) == pytest.approx([0.1 * np.sin(0.5), 0.0, 0.0], abs=1e-9)


def test_what_nothing_holds_is_named():
    """A cart on a rail, pushed along it by the tip force of its robot."""
    _keep, mbs = system()
    cart = mbs.CreateRigidBody(name="cart", inertia=InertiaCuboid(1e3, [0.05] * 3))
    mbs.CreatePrismaticJoint(itemNumbers=[mbs.CreateGround(), cart], position=[0, 0, 0], axis=[1, 0, 0])
    marker = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=cart))
    load = CreateTDCR(mbs, single(0.3), MODEL, baseMarker=marker).add_load("tip", LENGTH)
    mbs.Assemble()
    load.set([0.01, 0.0, 0.0])
    with pytest.raises(StepFailed, match="Nothing holds robot 'paper', 'cart': fix or support"):
        mbs.SolveTDCR(SolverSettings(min_substep=1.0))


def test_a_body_that_spins_freely_on_its_joint_is_named():
    """On a spherical joint at the tip, held by springs at its centre, about the line through both."""
    _keep, mbs, handle = scene(single(0.3), assemble=False, gravity=(1.0, 2.0, -9.0))
    weight = {"gravity": [1.0, 2.0, -9.0], "inertia": InertiaCuboid(1e3, [0.01, 0.01, 0.02])}
    top = mbs.CreateRigidBody(name="top", referencePosition=[0.0, 0.0, LENGTH + 0.02], **weight)
    foot = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=top, localPosition=[0, 0, -0.02]))
    mbs.AddObject(eii.SphericalJoint(markerNumbers=[handle.mTip, foot]))
    ends = {"itemNumbers": [mbs.CreateGround(), top], "localPosition0": [0.0, 0.0, LENGTH + 0.02]}
    mbs.CreateCartesianSpringDamper(**ends, stiffness=[2.0] * 3)
    mbs.Assemble()
    handle.set_tensions([1.0])
    with pytest.raises(StepFailed, match="Nothing holds 'top': fix or support"):
        mbs.SolveTDCR(SolverSettings(min_substep=1.0))


# ---------------------------------------------------------------- hooks


@pytest.mark.parametrize("when", ["before", "after"])
def test_user_hooks_are_called_beside_those_of_the_robot(when):
    """A spring that the user sets from a hook, with its Jacobian, acts in `SolveTDCR` as a spring item does."""
    k, calls, made = 3.0, Counter(), []
    _keep, mbs = system()

    def residual(mbs, t, newton, discontinuous):
        calls["residual"] += 1
        handle, load = made
        load.set([-k * handle.tip_position[0], 0.0, 0.0])

    def jacobian(mbs, t, f2, f2t, f1):
        calls["jacobian"] += 1
        n = mbs.systemData.ODE2Size() + mbs.systemData.ODE1Size() + mbs.systemData.AEsize()
        m = np.zeros((n, n))
        i = mbs.GetNodeODE2Index(made[0].nNodes[-1])
        m[i, i] = -f2 * k  # derivative of the force
        container = exu.MatrixContainer()
        container.SetWithDenseMatrix(m, useDenseMatrix=False)
        return container

    def hook():
        mbs.SetPreNewtonResidualUserFunction(residual)
        mbs.SetSystemJacobianUserFunction(jacobian)

    if when == "before":
        hook()
    handle = CreateTDCR(mbs, single(0.3), MODEL)
    made += [handle, handle.add_load("user", LENGTH)]
    if when == "after":
        hook()
    mbs.Assemble()
    solve_scene(mbs, handle, [1.0])
    assert calls["residual"] > 0 and calls["jacobian"] > 0
    assert distance(handle.tip_position, single_tip(force=(-k * handle.tip_position[0], 0.0, 0.0))) < 1e-7
    assert handle.tensions()["t1"][-1] < 0.99


# ---------------------------------------------------------------- handle


def test_the_handle_lists_all_items_and_holes_are_at_their_positions():
    _keep, mbs, handle, sensors = scene_with(lambda mbs, arm: arm.add_sensors(), seven(0.3))
    assert len(handle.nNodes) == 8 and len(handle.oBeams) == 7 and len(handle.bDisks) == 7
    assert [len(m) for m in handle.mHoles] == [8] * 3
    assert [len(o) for o in handle.oTendons] == [7] * 3
    assert {"tip_position", "tip_rotation", "tension_t1", "anchor_tension_t3"} <= set(sensors)
    position = exu.OutputVariableType.Position, exu.ConfigurationType.Reference
    for markers, tendon in zip(handle.mHoles, handle.robot.tendons, strict=True):
        found = [mbs.GetMarkerOutput(marker, *position) for marker in markers]
        s = handle.robot.hole_arc_lengths(tendon)
        np.testing.assert_allclose(found, np.column_stack((handle.robot.holes(tendon), s)), atol=1e-12)


def test_inputs_are_set_and_results_read_by_tendon():
    _keep, mbs, handle = scene(seven(0.3))
    handle.set_tensions({"t1": 1.0})
    solve_scene(mbs, handle, {"t2": -8e-3}, by="displacements")
    assert handle.tensions()["t2"][0] == 0.0  # let out: slack, and the prescribed length is reported
    assert handle.displacements()["t2"] == -8e-3
    solve_scene(mbs, handle, {"t2": 1e-3}, by="displacements")
    t, states = handle.tensions(), handle.hole_states()
    assert t["t1"].shape == (7,) and t["t1"][0] == 1.0
    assert np.all(t["t3"] == 0.0)
    assert handle.displacements()["t2"] == pytest.approx(1e-3, abs=1e-9)
    assert len(states["t1"]) == 7 and states["t1"][-1] == "anchor"
    assert handle.position_at(0.0) == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    assert handle.position_at(np.array([0.1, LENGTH]))[1] == pytest.approx(handle.tip_position, abs=1e-12)
    assert handle.shape()[0].shape == (8, 3)
    assert np.linalg.det(handle.shape()[1]) == pytest.approx(np.ones(8))


def test_sensors_give_tip_tensions_displacement_and_friction():
    _keep, mbs, handle, sensors = scene_with(lambda mbs, arm: arm.add_sensors(), single(0.3))
    solve_scene(mbs, handle, [1.0], [0.9])
    values = {name: mbs.GetSensorValues(sensor) for name, sensor in sensors.items()}
    tensions = handle.tensions()["t1"]
    assert values["tip_position"] == pytest.approx(handle.tip_position, abs=1e-12)
    assert values["tensions_t1"] == pytest.approx(tensions, abs=1e-12)
    assert values["tension_t1"] == tensions[0] == 0.9
    assert values["anchor_tension_t1"] == pytest.approx(tensions[-1])
    assert values["displacement_t1"] == pytest.approx(handle.displacements()["t1"], abs=1e-15)
    states = [{1.0: "pull", -1.0: "release"}.get(x, "stick") for x in values["mobilisation_t1"]]
    assert (*states, "anchor") == handle.hole_states()["t1"]
    # What has passed a hole is what the segments beyond it have released; no part of the tendon stretches.
    released = handle.actuation.current_forces().field.released_length[0]
    assert values["slip_t1"] == pytest.approx([released[k:].sum() for k in range(1, 7)], abs=1e-15)
    disks = [values[f"disk_position_{k}"] for k in range(1, 8)]
    assert np.array(disks) == pytest.approx(handle.position_at(np.array(SEVEN.positions)), abs=1e-12)


def test_a_force_sensor_on_a_segment_that_is_only_drawn_is_refused():
    """It read zero."""
    _keep, mbs, handle = scene(single(0.3), assemble=False)
    force = exu.OutputVariableType.Force
    mbs.AddSensor(eii.SensorObject(name="pull", objectNumber=handle.oTendons[0][0], outputVariableType=force))
    mbs.Assemble()
    with pytest.raises(ValueError, match=r"sensor 'pull': .* only drawn, .* arm.add_sensors\(\)"):
        handle.set_tensions([1.0])


def test_the_base_joint_carries_the_load_and_the_robot_follows_its_support():
    """Force of the base joint against the tip force; the robot follows the ground moved between two solves."""
    _keep, mbs, handle, load = scene_with(lambda mbs, arm: arm.add_load("tip", LENGTH), single(0.3))
    handle.set_tensions({"t1": 1.0})
    force = np.array([0.01, 0.02, -0.03])
    push(mbs, load, force)
    # The forces of tendons between base node and anchor are internal.
    reaction = np.array(mbs.GetObjectOutput(handle.oBaseJoint, exu.OutputVariableType.ForceLocal))
    assert np.sign(reaction @ force) * reaction == pytest.approx(force, abs=1e-8)
    before = handle.tip_position.copy()
    ground = mbs.GetObjectNumber(f"{handle.name}.ground")
    mbs.SetObjectParameter(ground, "referencePosition", [0.01, 0.02, 0.0])
    mbs.SolveTDCR()
    assert handle.tip_position - before == pytest.approx([0.01, 0.02, 0.0], abs=1e-9)


def test_nothing_is_drawn_of_a_robot_that_is_not_shown():
    """In version 0.1 only the tendons were hidden."""
    _keep, mbs, handle = scene(seven(0.3), show=False)
    assert not any(mbs.GetObject(k)["Vshow"] for k in range(mbs.systemData.NumberOfObjects()))
    assert not any(mbs.GetNode(node)["Vshow"] for node in handle.nNodes)
    shown = scene(seven(0.3))[1]
    assert sum(shown.GetObject(k)["Vshow"] for k in range(shown.systemData.NumberOfObjects())) > 30


def test_a_window_of_the_renderer_shows_the_solved_state():
    """Seen in a window: the robot stayed straight while it was bent by `SolveTDCR`."""
    _keep, mbs, handle = scene(single(0.0))
    solve_scene(mbs, handle, [1.0])
    shown = mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Visualization)
    assert np.array_equal(shown, mbs.systemData.GetODE2Coordinates()) and np.abs(shown).max() > 0.01
