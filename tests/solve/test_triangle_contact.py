"""Spheres of a robot against triangles of a ``GeneralContact``: tangent, and `SolveTDCR` against Exudyn's solver."""

from typing import Any, NamedTuple

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
import pytest
from contacts import DISK, STIFFNESS, add_sphere, add_triangles, general_contact
from robots import distance, scene, seven, solve

from tdcr_fe.elements.native.hooks import SceneHooks
from tdcr_fe.model.loading import LoadStep
from tdcr_fe.solve.equations.kernel import StaticKernel

#: Of sphere and triangle in series.
SERIES = 0.5 * STIFFNESS
NORMAL = np.array([-2.0, 1.0, 0.5]) / np.linalg.norm([-2.0, 1.0, 0.5])
AXES = np.array([np.cross(NORMAL, [0.0, 0.0, 1.0]), np.cross(NORMAL, np.cross(NORMAL, [0.0, 0.0, 1.0]))])
AXES /= np.linalg.norm(AXES, axis=1)[:, None]
#: By the nearest point of a triangle, where the sphere's centre is over its plane, in the axes of the plane [m].
OVER = {"face": (0.0, 0.0), "edge": (0.0, -0.0215), "vertex": (0.0, 0.0415)}
CORNERS = np.array([[-0.03, -0.02], [0.03, -0.02], [0.0, 0.04]])


class Touching(NamedTuple):
    """A straight robot whose tip and one further node touch a triangle each.

    Attributes
    ----------
    keep, mbs
        The system.
    kernel : StaticKernel
    contact : exudyn.GeneralContact
    tip, columns : ndarray of int
        Coordinates of the tip, and of all that is in contact.
    """

    keep: exu.SystemContainer
    mbs: exu.MainSystem
    kernel: StaticKernel
    contact: Any
    tip: np.ndarray
    columns: np.ndarray

    def differences(self) -> np.ndarray:
        """Derivative of the contact forces by these coordinates, from Exudyn's residual."""
        q = self.mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Current, copy=False)
        found = np.zeros((len(q), len(self.columns)))
        for k, column in enumerate(self.columns):
            start, step = q[column], 1e-6
            for change in (step, -step):
                q[column] = start + change
                found[:, k] += self.force() / (2.0 * change)
            q[column] = start
        return found

    def force(self) -> np.ndarray:
        """Generalised forces of the contact: the residual with it less that without."""
        size, found = self.mbs.systemData.ODE2Size(), []
        for active in (True, False):
            self.contact.isActive = active
            found.append(np.array(self.kernel.residual()))
        self.contact.isActive = True
        return (found[0] - found[1])[:size]

    def tangent(self) -> np.ndarray:
        """Its derivative in the kernel's Jacobian, shape (n2, n2)."""
        size, found = self.mbs.systemData.ODE2Size(), []
        for active in (True, False):
            self.contact.isActive = active
            self.kernel.contact.follow()
            found.append(self.kernel.jacobian()[:size, :size].copy())
        self.contact.isActive = True
        self.kernel.contact.follow()
        return found[0] - found[1]


def touching(over: str, *, moving: bool, spheres: bool = True, friction: float = 0.0) -> Touching:
    """Triangles across the tip and the node before it, on ground or on a body that moves."""
    keep, mbs, handle = scene(seven(0.0), assemble=False)
    contact = general_contact(mbs, friction)
    contact.sphereSphereContact = spheres
    offset = np.array([0.01, 0.02, -0.01])
    carrier = np.array([0.03, -0.02, 0.2])
    if moving:
        node = mbs.AddNode(
            eii.NodeRigidBodyEP(referenceCoordinates=[*(carrier - offset), 1.0, 0.0, 0.0, 0.0])
        )
        body = mbs.AddObject(eii.ObjectRigidBody(nodeNumber=node, mass=1.0, inertia=[1.0] * 3 + [0.0] * 3))
    else:
        body, offset = mbs.AddObject(eii.ObjectGround()), carrier
    marker = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=body, localPosition=list(offset)))
    near = NORMAL * (DISK - 6e-4)
    triangles, ends = [], [handle.nNodes[-1], handle.nNodes[-2]]
    for number in (-1, -2):
        centre = np.array([0.0, 0.0, handle.arc_lengths[number]])
        triangles.append(centre - near + (CORNERS - OVER[over]) @ AXES)
        add_sphere(contact, handle.marker_at(float(handle.arc_lengths[number])))
    add_triangles(contact, marker, np.array(triangles) - carrier)
    mbs.Assemble()
    columns = [i for end in ends for i in mbs.systemData.GetNodeLTGODE2(end)]
    if moving:
        columns += list(mbs.systemData.GetNodeLTGODE2(node))
    hooks = SceneHooks.of(mbs)
    for robot in hooks.actuations:
        robot.disconnect()
    kernel = StaticKernel(mbs, hooks)
    kernel.contact.follow()
    tip = np.array(mbs.systemData.GetNodeLTGODE2(ends[0]))
    return Touching(keep, mbs, kernel, contact, tip, np.array(columns))


@pytest.mark.parametrize("spheres", [True, False])
@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("over", OVER)
def test_the_tangent_is_the_derivative_of_the_residual_of_exudyn(over, moving, spheres):
    """By all coordinates of two nodes and of the body that carries the triangles; the scene is left as it is.

    Without contact between spheres Exudyn's own Jacobian has nothing of the triangles either.
    """
    found = touching(over, moving=moving, spheres=spheres, friction=0.3)
    q = found.mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Current, copy=False)
    before, raw = q.copy(), np.array(found.kernel.residual())
    tangent = found.tangent()
    assert np.array_equal(q, before)
    assert np.array_equal(found.kernel.residual(), raw)
    assert not found.contact.computeContactForces
    assert tangent[:, found.columns] == pytest.approx(found.differences(), abs=1e-6 * SERIES)
    assert not np.any(np.delete(tangent, found.columns, axis=1))
    if moving:
        assert np.abs(tangent[found.tip[:3]][:, found.columns[-4:]]).max() > 0.01 * SERIES


# ---------------------------------------------------------------- SolveTDCR


#: A tetrahedron whose ridge is in the way of the robot: the faces, outward.
POINTS = np.array([[0.045, -0.04, 0.19], [0.042, 0.05, 0.182], [0.12, 0.0, 0.30], [0.12, 0.01, 0.08]])
FACES = np.array([POINTS[list(f)] for f in ((0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2))])
CENTRE = POINTS.mean(axis=0)
TETRAHEDRON = np.array(
    [f if np.cross(f[1] - f[0], f[2] - f[0]) @ (f[0] - CENTRE) > 0.0 else f[::-1] for f in FACES]
)


def last_markers(handle: Any) -> list[Any]:
    return [handle.marker_at(float(s)) for s in handle.arc_lengths[-4:]]


def against_mesh(mu: float) -> tuple[Any, exu.MainSystem, Any]:
    keep, mbs, handle = scene(seven(mu), assemble=False)
    contact = general_contact(mbs)
    ground = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=mbs.AddObject(eii.ObjectGround())))
    add_triangles(contact, ground, TETRAHEDRON)
    for node in last_markers(handle):
        add_sphere(contact, node)
    mbs.Assemble()
    return keep, mbs, handle


def pulled(mbs: exu.MainSystem, handle: Any, most: float) -> int:
    """Pull a tendon in ten steps; the largest number of iterations of a step."""
    iterations = []
    for tension in np.linspace(0.1 * most, most, 10):
        handle.set_tensions({"t1": float(tension)})
        iterations.append(mbs.SolveTDCR()["iterations"])
    return max(iterations)


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_a_robot_leans_on_a_ridge(mu):
    """An oblique edge where two faces meet. With Exudyn's Jacobian this ended as not converged."""
    _keep, mbs, handle = against_mesh(mu)
    assert pulled(mbs, handle, 1.0) <= 30
    free = solve(seven(mu), [LoadStep("", {"t1": 1.0})], elements_per_bay=1).tips[-1]
    assert distance(handle.tip_position, free) > DISK
