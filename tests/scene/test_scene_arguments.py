"""Arguments of CreateTDCR and inputs of the handle; systems that are edited; what is refused by name."""

import exudyn as exu
import exudyn.graphics as graphics
import exudyn.itemInterface as eii
import numpy as np
import pytest
from exudyn.utilities import InertiaCuboid
from robots import LENGTH, MODEL, distance, seven, single
from scenes import HEAVY, TURN, recommended, scene, solve_by_exudyn, solve_scene, system
from scipy.spatial.transform import Rotation

from tdcr_fe import CreateTDCR, SolveTDCR


def test_gravity_colour_graphics_and_a_dict_are_as_in_exudyns_functions():
    _keep, mbs, handle = scene(seven(0.0), gravity=tuple(HEAVY), referenceRotationMatrix=TURN)
    _keep, other = system()
    brick = graphics.Brick([0.1, 0.2, -0.02], [0.05, 0.05, 0.01])
    given = {"referenceRotationMatrix": TURN, "gravity": HEAVY, "graphicsDataList": [brick]}
    made = CreateTDCR(other, seven(0.0), MODEL, color=[1.0, 0.0, 0.0, 1.0], returnDict=True, **given)
    other.Assemble()
    bent = [solve_scene(*each, [0.5, 0.1, 0.0]) for each in ((mbs, handle), (other, made["tdcr"]))]
    assert np.array_equal(*bent)
    assert made["nodeNumbers"] == made["tdcr"].nNodes and made["diskNumbers"] == made["tdcr"].bDisks
    ground = other.GetObject(other.GetObjectNumber("three.ground"), addGraphicsData=True)
    assert len(ground["VgraphicsData"]) == 2
    assert list(other.GetObject(made["beamNumbers"][0])["Vcolor"]) == pytest.approx([1.0, 0.0, 0.0, 1.0])


# ---------------------------------------------------------------- base marker


def test_the_pose_of_the_base_is_that_of_its_marker():
    turn = Rotation.from_euler("xyz", [0.3, -0.4, 1.0]).as_matrix()
    _keep, mbs = system()
    body = mbs.CreateRigidBody(inertia=InertiaCuboid(1e3, [0.05] * 3), referencePosition=[0.1, 0.2, 0.3])
    at_body = exu.HT(rotation=turn, translation=[0.4, -0.2, -0.2])
    marker = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=body, localHT=at_body))
    handle = CreateTDCR(mbs, single(), MODEL, baseMarker=marker)
    mbs.Assemble()
    assert distance(handle.tip_position, [0.5, 0.0, 0.1] + turn @ [0.0, 0.0, LENGTH]) < 1e-12


def test_a_robot_on_a_body_in_free_flight_moves_with_it():
    """Body and robot begin with one velocity and one spin, about the axis of all centres of mass, and keep them."""
    velocity, spin, end = [0.3, -0.2, 0.1], [0.0, 0.0, 2.0], 0.05
    _keep, mbs = system()
    motion = {"initialVelocity": velocity, "initialAngularVelocity": spin}
    body = mbs.CreateRigidBody(inertia=InertiaCuboid(500.0, [0.05] * 3), **motion)
    marker = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=body))
    handle = CreateTDCR(mbs, seven(0.3), MODEL, baseMarker=marker, **motion)
    mbs.Assemble()
    assert mbs.SolveDynamic(recommended(handle, end, 1e-3))
    position, rotation = handle.shape()
    expected = handle.arc_lengths[:, None] * [0, 0, 1] + end * np.array(velocity)
    assert position == pytest.approx(expected, abs=1e-9)
    assert np.abs(rotation - Rotation.from_rotvec(end * np.array(spin)).as_matrix()).max() < 1e-6


def test_a_robot_whose_body_begins_displaced_is_refused_in_dynamics_until_it_is_solved():
    """The base joint closed within the first step: both were thrown about, or 200 tiny steps ended the run."""
    _keep, mbs = system()
    body = mbs.CreateRigidBody(inertia=InertiaCuboid(1e3, [0.05] * 3), initialDisplacement=[0.01, 0.0, 0.0])
    marker = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=body))
    ground = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
    spring = {"stiffness": np.eye(6), "damping": np.zeros((6, 6)), "offset": [0.01, 0.0, 0.0, 0.0, 0.0, 0.0]}
    mbs.AddObject(eii.RigidBodySpringDamper(markerNumbers=[ground, marker], **spring))
    handle = CreateTDCR(mbs, single(), MODEL, baseMarker=marker)
    mbs.Assemble()
    settings = recommended(handle, 5e-3, 1e-3)
    with pytest.raises((ValueError, RuntimeError), match="not begin at the marker that carries its base"):
        mbs.SolveDynamic(settings)
    mbs.SolveTDCR()
    assert mbs.SolveDynamic(settings)
    assert distance(handle.tip_position, [0.01, 0.0, LENGTH]) < 1e-9


# ---------------------------------------------------------------- inputs


def test_a_tension_set_after_inputs_over_time_leaves_the_other_tendons_as_they_are():
    """In version 0.1 the tensions of t2 and t3 were set to zero."""
    _keep, mbs, handle = scene(seven(0.0), friction="none")
    solve_by_exudyn(mbs, handle, lambda t: [0.2 * t, 0.5 * t, 0.1 * t], 0.05)
    solve_scene(mbs, handle, {"t1": 0.3})
    assert [handle.tensions()[t][0] for t in ("t1", "t2", "t3")] == pytest.approx([0.3, 0.5, 0.1])


WRONG_INPUTS = [
    ([1.0], r"returned \[1.0\]; must be a list with one number for every tendon"),
    ([0.1, -0.5, 0.1], r"returned -0.5 for tendon 't2'; must be finite, a tension >= 0"),
    ([0.1, 0.1, float("nan")], "returned nan for tendon 't3'"),
    ("fast", "must return a list with one number for every tendon"),
]


@pytest.mark.parametrize(("values", "words"), WRONG_INPUTS)
@pytest.mark.parametrize("solver", ["SolveTDCR", "SolveStatic", "SolveDynamic"])
def test_wrong_inputs_over_time_are_refused_by_every_solver(solver, values, words):
    """In version 0.1 one value acted on three tendons, and -0.5 N pushed."""
    _keep, mbs, handle = scene(seven(0.3))
    handle.set_inputs_over_time(lambda t: values)
    settings = [] if solver == "SolveTDCR" else [recommended(handle, 0.01, 1e-3)]
    with pytest.raises((ValueError, RuntimeError), match=words):
        getattr(mbs, solver)(*settings)


def test_round_off_below_zero_tension_is_zero():
    _keep, mbs, handle = scene(seven(0.3))
    handle.set_inputs_over_time(lambda t: [-1e-16, 0.1 * t, 0.0])
    mbs.SolveTDCR()
    assert handle.tensions()["t1"][0] == 0.0


# ------------------------------------------------------------ edited systems


INPUTS = [0.5, 0.1, 0.1]


def solved(mbs, handle):
    """Tip after a pull."""
    return solve_scene(mbs, handle, INPUTS)[-1]


def test_a_system_is_built_again_after_a_reset_with_other_items_first():
    _keep, mbs, old = scene(seven(0.3), elements_per_bay=1)
    expected = solved(mbs, old)
    mbs.Reset()
    mbs.AddNode(eii.NodePointGround())
    new = mbs.CreateTDCR(seven(0.3), old.model)
    mbs.Assemble()
    assert np.abs(solved(mbs, new) - expected).max() < 1e-9 * LENGTH
    for use in (lambda: old.tip_position, lambda: old.set_tensions(INPUTS)):
        with pytest.raises(ValueError, match="not in the system any more"):
            use()


USES = [
    lambda mbs, handle: handle.set_tensions(INPUTS),
    lambda mbs, handle: SolveTDCR(mbs),
    lambda mbs, handle: mbs.SolveDynamic(recommended(handle, 2e-3, 1e-3)),
]


@pytest.mark.parametrize("use", USES)
def test_items_deleted_before_those_of_a_robot_are_refused(use):
    _keep, mbs = system()
    ground = mbs.CreateGround(referencePosition=[1.0, 0.0, 0.0])
    handle = mbs.CreateTDCR(seven(0.3))
    mbs.DeleteObject(ground)
    mbs.Assemble()
    with pytest.raises((ValueError, RuntimeError), match="because items were deleted"):
        use(mbs, handle)


def test_solve_tdcr_in_a_step_function_is_refused():
    _keep, mbs, handle = scene(seven(0.3))

    def before(mbs, t):
        SolveTDCR(mbs)
        return True

    mbs.SetPreStepUserFunction(before)
    with pytest.raises(ValueError, match="it is solving already"):
        solved(mbs, handle)
    mbs.SetPreStepUserFunction(0)
    assert np.isfinite(solved(mbs, handle)).all()
    assert handle.tensions()["t1"][0] == pytest.approx(0.5)


# ---------------------------------------------------------------- base joint


def test_a_robot_whose_base_joint_is_switched_off_is_refused_unless_something_else_holds_it():
    """Without its base it has no position at rest."""
    _keep, mbs, handle = scene(seven(0.3), assemble=False)
    expected = solved(*scene(seven(0.3))[1:])
    ground = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
    stiffness = {"stiffness": np.diag([1e6] * 3 + [1e3] * 3), "damping": np.zeros((6, 6))}
    spring = mbs.AddObject(eii.RigidBodySpringDamper(markerNumbers=[ground, handle.mBase], **stiffness))
    mbs.SetObjectParameter(handle.oBaseJoint, "activeConnector", False)
    mbs.Assemble()
    assert distance(solved(mbs, handle), expected) < 1e-9
    mbs.SetObjectParameter(spring, "activeConnector", False)
    with pytest.raises(ValueError, match="robot 'three': its base joint is switched off"):
        SolveTDCR(mbs)
    mbs.SetObjectParameter(handle.oBaseJoint, "activeConnector", True)
    assert distance(solved(mbs, handle), expected) < 1e-9


def test_a_robot_without_its_base_joint_is_refused_however_many_elements_it_has():
    """Each of 1700 coordinates has a small part in the motion that nothing resists."""
    _keep, mbs, handle = scene(single(0.3), assemble=False, elements_per_bay=30)
    mbs.SetObjectParameter(handle.oBaseJoint, "activeConnector", False)
    mbs.Assemble()
    with pytest.raises(ValueError, match="its base joint is switched off"):
        SolveTDCR(mbs)
