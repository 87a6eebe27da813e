"""Contact items of Exudyn in `SolveTDCR`, against Exudyn's own static solver; what is not solved is refused by name."""

import numpy as np
import pytest
from contacts import CENTRE, CONTACTS, DISK, WALL, general_triangles, limit_stops, soft_wall, spheres, wall
from robots import LENGTH, distance, seven, three
from scenes import pulled_in_steps, push, scene, scene_with, solve_by_exudyn, solve_scene, tip_load


def with_contact(add, mu=0.0, **rest):
    return scene_with(lambda *to: add(*to, **rest), seven(mu))[:3]


#: Ten equal steps to 2 N.
STEPS = np.linspace(0.2, 2.0, 10)
QUICK = ("CreateSphereSphereContact", "GeneralContact, triangles")
CASES = [(kind, 0.0) for kind in QUICK]
CASES += [pytest.param(kind, 0.3 * (kind in QUICK), marks=pytest.mark.integration) for kind in CONTACTS]


@pytest.mark.parametrize(("kind", "mu"), CASES)
def test_every_contact_gives_the_shape_of_the_static_solver_of_exudyn(kind, mu):
    """A pull to 2 N in ten steps, in contact from about the fourth on.

    Version 0.1 ran no discontinuous iteration: the robot went through the obstacle, and the step counted as solved. The
    static solver of Exudyn fails with triangles of a GeneralContact; there the reference is the same wall as objects.
    """
    _keep, mbs, handle = with_contact(CONTACTS[kind], mu)
    assert all(x["iterations"] <= 30 and x["residual"] < 1e-6 for x in pulled_in_steps(mbs, handle, STEPS))
    reference = soft_wall if kind == "GeneralContact, triangles" else CONTACTS[kind]
    _keep_other, other, compared = with_contact(reference, mu)
    solve_by_exudyn(other, compared, lambda t: [2.0 * t, 0.0, 0.0], 1.0 / 80.0)
    assert distance(handle.shape()[0], compared.shape()[0]) < (1e-3 if mu else 1e-4)
    _keep_free, free_mbs, free = scene(seven(mu))
    assert distance(handle.shape()[0], solve_scene(free_mbs, free, {"t1": 2.0})) > 0.05


def test_modes_at_a_wall_of_triangles_are_those_at_the_same_wall_of_objects():
    """With Exudyn's derivative of triangles in a GeneralContact the first frequency was 12.5 Hz, not 2.5 Hz."""
    found = []
    for add in (soft_wall, general_triangles):
        _keep, mbs, handle = with_contact(add)
        pulled_in_steps(mbs, handle, STEPS[1::2])
        found.append(mbs.TDCREigenvalues(numberOfEigenvalues=4).frequencies)
    assert found[1] == pytest.approx(found[0], rel=1e-4)


@pytest.mark.parametrize("substeps", [None, 3])
def test_a_thin_wall_is_not_jumped_over_in_one_large_step(substeps):
    """In one step to 2 N, the tip moves by 100 mm without the wall; disks have a radius of 5 mm."""
    _keep, mbs, handle = with_contact(wall)
    handle.set_tensions({"t1": 2.0})
    mbs.SolveTDCR(substeps=substeps)
    assert WALL - DISK - 1e-3 < handle.tip_position[0] < WALL


def test_a_robot_slides_off_a_sphere_in_large_steps_as_in_small_ones():
    """In two steps the solution beyond the stability limit was that of a robot balancing on the sphere, 0.08 m away.

    The sphere is 1 mm beside the plane in which the robot bends.
    """
    tips = []
    for count in (2, 20):
        _keep, mbs, handle = with_contact(spheres, at=(CENTRE[0], 1e-3, CENTRE[2]))
        assert not pulled_in_steps(mbs, handle, np.linspace(2.0 / count, 2.0, count))[-1]["unstable"]
        tips.append(handle.tip_position)
    assert np.linalg.norm(tips[0] - tips[1]) < 1e-6 * LENGTH
    assert tips[0][0] > 0.15


def test_a_robot_that_balances_on_a_sphere_in_a_symmetric_scene_is_called_unstable():
    """Nothing leads to either side, so the path is followed as by Exudyn's solver; a push of 1 mN makes it fall."""
    _keep, mbs, handle, (_, side) = scene_with(lambda *to: (spheres(*to), tip_load(*to)), three(0.0))
    handle.set_tensions({"t1": 1.4})
    assert not mbs.SolveTDCR()["unstable"]
    handle.set_tensions({"t1": 2.0})
    assert mbs.SolveTDCR()["unstable"]
    assert abs(handle.tip_position[1]) < 1e-9 * LENGTH
    assert not push(mbs, side, [0.0, 1e-3, 0.0])["unstable"] and handle.tip_position[0] > 0.15


def test_contact_opens_again_and_leaves_nothing_behind():
    _keep, mbs, handle = with_contact(spheres)
    found = solve_scene(mbs, handle, {"t1": 0.4}, {"t1": 2.0}, {"t1": 0.4})
    _keep_free, free_mbs, free = scene(seven(0.0))
    assert distance(found, solve_scene(free_mbs, free, {"t1": 0.4})) < 1e-9


def test_what_cannot_be_solved_is_refused_by_name():
    """Friction and plasticity with a history of their own."""
    _keep, mbs, handle = with_contact(limit_stops, dynamicFrictionForce=0.1, stickingStiffness=10.0)
    handle.set_tensions({"t1": 0.1})
    with pytest.raises(ValueError, match=r"ConnectorCoordinateSpringDamperExt.* has states with a history"):
        mbs.SolveTDCR()
    _keep, mbs, handle = with_contact(spheres)
    for k in range(mbs.systemData.NumberOfObjects()):
        if "spheresRadii" in mbs.GetObject(k):
            mbs.SetObjectParameter(k, "contactPlasticityRatio", 0.5)
    with pytest.raises(ValueError, match="has plastic contact"):
        mbs.SolveTDCR()


#: A tetrahedron whose ridge is in the way of the robot: the faces, outward.
POINTS = np.array([[0.045, -0.04, 0.19], [0.042, 0.05, 0.182], [0.12, 0.0, 0.30], [0.12, 0.01, 0.08]])
TETRAHEDRON = POINTS[[[2, 1, 0], [1, 3, 0], [3, 2, 0], [2, 3, 1]]]


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_a_robot_leans_on_a_ridge(mu):
    """An oblique edge where two faces meet. With Exudyn's Jacobian this ended as not converged."""
    _keep, mbs, handle = with_contact(general_triangles, mu, triangles=TETRAHEDRON, last=4)
    assert all(report["iterations"] <= 30 for report in pulled_in_steps(mbs, handle, 0.5 * STEPS))
    _keep_free, free_mbs, free = scene(seven(mu))
    assert distance(handle.shape()[0], solve_scene(free_mbs, free, {"t1": 1.0})) > DISK / LENGTH
