"""`TDCR.add_disk_contact` against Exudyn's static solver and closed forms; what cannot be solved is refused by name."""

import exudyn as exu
import numpy as np
import pytest
from contacts import CENTRE, DISK, QUAD, SPHERE, STIFFNESS
from exudyn.itemInterface import CoordinateConstraint, MarkerNodeCoordinate, NodePointGround
from exudyn.utilities import InertiaCuboid
from robots import BACKBONE, LENGTH, distance, seven, three
from scenes import pulled_in_steps, push, scene_with, solve_by_exudyn, solve_scene, system, tip_load

from tdcr_fe import TDCR, Backbone, CreateTDCR, Disks, Model, StepFailed

#: Disks of 9 mm radius: a robot whose tip comes back to its first disk.
LARGE = Disks.equally_spaced(13, LENGTH, mass=0.17e-3, radius=9e-3)


def ball(mbs: exu.MainSystem, handle: TDCR):
    """A fixed sphere, against disks and backbone."""
    ground = mbs.CreateGround(referencePosition=list(CENTRE))
    return handle.add_disk_contact(ground, STIFFNESS, sphereRadius=SPHERE)


def wall(mbs: exu.MainSystem, handle: TDCR):
    """A wall across x."""
    return handle.add_disk_contact(mbs.CreateGround(), STIFFNESS, quadPoints=QUAD)


def load_and_plate(stiffness, corners):
    """A load at the tip, and a fixed plate."""
    plate = {"contactStiffness": stiffness, "quadPoints": corners}
    return lambda mbs, arm: (tip_load(mbs, arm), arm.add_disk_contact(mbs.CreateGround(), **plate))


def itself(mbs: exu.MainSystem, handle: TDCR):
    """The robot against itself."""
    return handle.add_disk_contact(handle, STIFFNESS)


def pulled(robot, add, tensions, **model):
    """A robot taken through tensions of its first tendon by SolveTDCR."""
    keep, mbs, handle, contact = scene_with(add, robot, **model)
    assert all(report["iterations"] <= 30 for report in pulled_in_steps(mbs, handle, tensions))
    return keep, mbs, handle, contact


OBSTACLES = [(ball, 0.0, 1), pytest.param(wall, 0.3, 2, marks=pytest.mark.integration)]


@pytest.mark.parametrize(("add", "mu", "elements"), OBSTACLES)
def test_an_obstacle_gives_the_shape_of_the_static_solver_of_exudyn(add, mu, elements):
    """A pull to 2 N in ten steps, in contact from the fourth on; 1e-8 of the length were seen."""
    tensions = np.linspace(0.2, 2.0, 10)
    _keep, _mbs, handle, contact = pulled(seven(mu), add, tensions, elements_per_bay=elements)
    _keep, other, compared, forces = scene_with(add, seven(mu), elements_per_bay=elements)
    solve_by_exudyn(other, compared, lambda t: [2.0 * t, 0.0, 0.0], 1.0 / 80.0)
    assert distance(handle.shape()[0], compared.shape()[0]) < (1e-3 if mu else 1e-4)
    assert contact.normal_forces().max() > 0.03
    assert contact.normal_forces() == pytest.approx(forces.normal_forces(), abs=1e-4)
    assert contact.gaps().min() > -1e-4


@pytest.mark.integration
def test_a_robot_bent_to_a_ring_touches_itself():
    """Its tip against its first disk, with the shape of the static solver of Exudyn from shortly before on."""
    robot = three(0.0, disks=LARGE)
    _keep, _mbs, handle, contact = pulled(robot, itself, np.arange(0.5, 9.1, 0.5))
    touching = np.flatnonzero(contact.normal_forces())
    assert [contact.names[k] for k in touching] == [("disk 1 of 'three'", "disk 13 of 'three'")]
    _keep_other, other, compared, _ = pulled(robot, itself, np.arange(0.5, 7.1, 0.5))
    solve_by_exudyn(other, compared, lambda t: [7.0 + 2.0 * t, 0.0, 0.0], 1.0 / 240.0)
    p = handle.shape()[0]
    assert distance(p, compared.shape()[0]) < 1e-4
    gap = contact.gaps()[touching][0]
    assert np.linalg.norm(p[-1] - p[1]) == pytest.approx(2 * LARGE.radius + gap, abs=1e-9)


def facing_each_other(robot, apart, elements=1):
    """Two robots, the second turned towards the first and apart from it [m], in contact."""
    keep, mbs = system()
    model = Model(friction="per-hole", elements_per_bay=elements)
    a = CreateTDCR(mbs, robot, model, name="a")
    there = {"referencePosition": [apart, 0.0, 0.0], "referenceRotationMatrix": np.diag([-1.0, -1.0, 1.0])}
    b = CreateTDCR(mbs, robot, model, name="b", **there)
    contact = a.add_disk_contact(b, STIFFNESS)
    mbs.Assemble()
    return keep, mbs, a, b, contact


def test_mirror_images_press_their_tips_together():
    """Pulled alike: the shapes are mirror images, and the tips apart by two radii less the penetration."""
    _keep, mbs, a, b, contact = facing_each_other(three(0.0), 0.08, elements=2)
    for tension in np.linspace(0.25, 1.5, 6):
        a.set_tensions({"t1": float(tension)})
        solve_scene(mbs, b, {"t1": float(tension)})
    pa, pb = a.shape()[0], b.shape()[0]
    assert distance(pa * [-1.0, 1.0, 1.0] + [0.08, 0.0, 0.0], pb) < 1e-8
    assert contact.gaps().min() < 0.0
    assert np.linalg.norm(pb[-1] - pa[-1]) == pytest.approx(2 * DISK, abs=2e-4)


def test_a_wall_carries_what_a_cantilever_does_not():
    """A force at the tip against a wall 1 mm away: the wall takes what is beyond the force for that deflection.

    ``w = F L^3 / (3 EI) + F L / GA`` (S. P. Timoshenko, Strength of Materials I, sec. 40).
    """
    robot = seven(0.0).with_disks(mass=0.0)
    w = 0.001 + robot.disks.radius
    corners = [[w, -0.2, 0.0], [w, -0.2, 0.4], [w, 0.2, 0.4], [w, 0.2, 0.0]]

    _keep, mbs, handle, (load, contact) = scene_with(load_and_plate(1e5, corners), robot, elements_per_bay=2)
    push(mbs, load, [0.005, 0.0, 0.0])
    free = 0.005 * LENGTH**3 / (3 * BACKBONE.EI) + 0.005 * LENGTH / BACKBONE.GA
    carried = 0.005 * (1.0 - handle.tip_position[0] / free)
    assert contact.normal_forces().max() == pytest.approx(carried, rel=1e-3)


def test_a_tip_pressed_along_the_axis_onto_the_middle_of_a_plate_compresses_backbone_and_contact():
    """``(F - R) L / EA = R / k``. In the middle, over the edge of both triangles, contact was twice as stiff."""
    corners = [[x, y, LENGTH + DISK] for x, y in ((-0.02, -0.02), (0.02, -0.02), (0.02, 0.02), (-0.02, 0.02))]
    stiffness, axial = 1e5, BACKBONE.EA / LENGTH
    robot = seven(0.0).with_disks(mass=0.0)
    _keep, mbs, _, (load, contact) = scene_with(load_and_plate(stiffness, corners), robot)
    push(mbs, load, [0.0, 0.0, 5.0])
    assert contact.normal_forces().sum() == pytest.approx(5.0 * stiffness / (stiffness + axial), rel=1e-6)


def test_a_load_too_large_for_the_stiffness_of_the_contact_is_refused_by_name():
    """50 N at the tip against a ball of 2000 N/m: disks would be inside it."""
    _keep, mbs, handle, (load, _) = scene_with(lambda *to: (tip_load(*to), ball(*to)), seven(0.0))
    with pytest.raises(StepFailed, match=r"contact is too soft.*your own loads in several calls"):
        push(mbs, load, [50.0, 0.0, 0.0])
    assert np.linalg.norm(handle.shape()[0] - CENTRE, axis=1).min() > SPHERE


@pytest.mark.integration
def test_two_tips_slip_past_each_other():
    """Tip against tip: pulled on, they slip off each other, which is found by damped relaxation and said."""
    _keep, mbs, a, b, contact = facing_each_other(three(0.0), 0.08, elements=2)
    snapped = []
    for share in np.linspace(0.1, 0.7, 7):
        a.set_tensions({"t1": 1.5 * share})
        b.set_tensions({"t1": 1.2 * share})
        snapped.append(mbs.SolveTDCR()["snapped"])
        assert contact.gaps().min() > -1e-4
    assert snapped == [False] * 6 + [True]
    assert a.tip_position[0] > b.tip_position[0]


@pytest.mark.integration
def test_a_ball_that_is_pushed_past_a_robot_and_back_is_slipped_off_with_friction():
    """The robot snaps round the ball, from a state that is unstable: the damped motion must not take it for stable."""
    _keep, mbs = system()
    backbone = Backbone(LENGTH, 0.5e-3, 70e9, 0.3, density=6450.0)
    disks = Disks.equally_spaced(10, LENGTH, mass=0.2e-3, radius=6e-3)
    arm = CreateTDCR(mbs, three(0.2, backbone, disks), Model(friction="per-hole", elements_per_bay=2))
    body = mbs.CreateMassPoint(referencePosition=[0.06, 0.002, 0.18], mass=0.01)
    moving, base = mbs.GetObject(body)["nodeNumber"], mbs.AddNode(NodePointGround())
    fixed = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=base, coordinate=0))
    there_and_back = {"offsetUserFunction": lambda _mbs, t, _item, _offset: -0.06 * (1.0 - abs(1.0 - t))}
    for k, offset in enumerate((there_and_back, {}, {})):
        marker = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=moving, coordinate=k))
        mbs.AddObject(CoordinateConstraint(markerNumbers=[fixed, marker], **offset))
    contact = arm.add_disk_contact(body, 2e3, sphereRadius=0.02)
    mbs.Assemble()
    arm.set_tensions({"t1": 1.0, "t2": 0.4, "t3": 0.3})
    assert not any(mbs.SolveTDCR(endTime=t)["snapped"] for t in (0.0, 1.0))
    assert mbs.SolveTDCR(endTime=1.3)["snapped"]
    assert contact.gaps().min() > -1e-4


def test_a_tip_that_slips_off_a_plate_on_a_spring_leaves_both_as_if_they_had_not_met():
    """The tip is on the diagonal of the two forces, and the plate at rest; the damped motion holds the plate, too."""
    at = [DISK + 0.002, 0.0, LENGTH]
    corners = [[0.0, y, z] for y, z in ((-0.05, -0.05), (-0.05, 0.05), (0.01, 0.05), (0.01, -0.05))]

    def load_and_spring(mbs: exu.MainSystem, arm: TDCR):
        ground = mbs.CreateGround()
        plate = mbs.CreateRigidBody(referencePosition=at, inertia=InertiaCuboid(1000.0, [0.01] * 3))
        mbs.CreatePrismaticJoint(itemNumbers=[ground, plate], position=at, axis=[1, 0, 0])
        spring = {"localPosition0": at, "stiffness": [30.0, 0.0, 0.0]}
        mbs.CreateCartesianSpringDamper(itemNumbers=[ground, plate], **spring)
        return tip_load(mbs, arm), arm.add_disk_contact(plate, 1e4, quadPoints=corners), plate

    _keep, mbs, handle, (load, contact, plate) = scene_with(load_and_spring, seven(0.0))
    for aside in (0.0, 0.01, 0.05):
        push(mbs, load, [0.05, aside, 0.0])
        assert (contact.normal_forces().max() > 0.0) == (aside == 0.0)
    assert handle.tip_position[0] == pytest.approx(handle.tip_position[1], abs=1e-9)
    assert np.allclose(mbs.GetObjectOutputBody(plate, exu.OutputVariableType.Displacement), 0.0, atol=1e-9)
