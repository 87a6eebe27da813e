"""Spheres of a robot against triangles of a ``GeneralContact``: `SolveTDCR` where Exudyn's Jacobian would not do."""

from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
import pytest
from contacts import DISK, add_sphere, add_triangles, general_contact
from robots import distance, scene_with, seven, solve

from tdcr_fe.model.loading import LoadStep

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
    def tetrahedron(mbs: exu.MainSystem, handle: Any) -> None:
        contact = general_contact(mbs)
        ground = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=mbs.AddObject(eii.ObjectGround())))
        add_triangles(contact, ground, TETRAHEDRON)
        for node in last_markers(handle):
            add_sphere(contact, node)

    return scene_with(tetrahedron, seven(mu))[:3]


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
