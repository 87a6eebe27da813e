"""A fixed sphere in the way of a robot: as connectors with a force function, and as Exudyn's contact items."""

from __future__ import annotations

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from robots import distance, scene, three

from tdcr_fe.native import register

register()

CENTRE, RADIUS, STIFFNESS = np.array([0.06, 0.0, 0.15]), 0.03, 200.0
#: Distance of backbone and centre at which the sphere of the obstacle touches that of a node [m].
TOUCH = RADIUS + three().disks.radius


def nodes_and_obstacle(mbs, handle):
    """A marker at the centre of the obstacle, and one at every node of the backbone but the base."""
    ground = mbs.AddObject(eii.ObjectGround())
    centre = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=ground, localPosition=list(CENTRE)))
    return centre, [handle.marker_at(float(s)) for s in handle.arc_lengths[1:]]


def push(mbs, t, item, gap, velocity, stiffness, damping, offset):
    """Force of a linear penalty in the direction of the centres; arguments as Exudyn passes them."""
    gap = np.asarray(gap, dtype=float)
    size = float(np.linalg.norm(gap))
    return list(min(0.0, STIFFNESS * (size - TOUCH)) / size * gap)


def with_connectors(mbs, handle):
    centre, nodes = nodes_and_obstacle(mbs, handle)
    for node in nodes:
        mbs.AddObject(
            eii.CartesianSpringDamper(
                markerNumbers=[centre, node],
                stiffness=[0.0] * 3,
                damping=[0.0] * 3,
                springForceUserFunction=push,
            )
        )


def with_contact_items(mbs, handle):
    centre, nodes = nodes_and_obstacle(mbs, handle)
    for node in nodes:
        data = mbs.AddNode(
            eii.NodeGenericData(initialCoordinates=[0.1, 0.0, 0.0, 0.0], numberOfDataCoordinates=4)
        )
        mbs.AddObject(
            eii.ObjectContactSphereSphere(
                markerNumbers=[centre, node],
                nodeNumber=data,
                spheresRadii=[RADIUS, TOUCH - RADIUS],
                contactStiffness=STIFFNESS,
                contactStiffnessExponent=1.0,
                contactDamping=0.0,
                dynamicFriction=0.0,
            )
        )


def with_obstacle(add):
    keep, mbs, handle = scene(three(0.0), assemble=False)
    add(mbs, handle)
    mbs.Assemble()
    return keep, mbs, handle


def closest(handle):
    return float(np.min(np.linalg.norm(handle.shape()[0] - CENTRE, axis=1)))


def test_connectors_with_a_force_function_agree_with_contact_items_in_the_static_solver_of_exudyn():
    """A penalty of 200 N/m. Free, the robot would come within 11 mm of the centre."""
    _keep, mbs, handle = with_obstacle(with_connectors)
    for t in np.linspace(0.1, 2.0, 20):
        handle.set_tensions({"t1": float(t)})
        mbs.SolveTDCR()
    _keep_other, other, compared = with_obstacle(with_contact_items)
    compared.set_inputs_over_time(lambda t: [2.0 * t, 0.0, 0.0])
    settings = exu.SimulationSettings()
    settings.staticSolver.numberOfLoadSteps = 40
    settings.staticSolver.verboseMode = 0
    settings.solution.file.write = False
    assert other.SolveStatic(settings)
    assert distance(handle.tip_position, compared.tip_position) < 1e-6
    assert TOUCH - 1e-3 < closest(handle) < TOUCH


def test_contact_items_act_in_the_quasi_static_solver_as_connectors_do():
    """The same sphere; e3bbe5d solved the scene as if it were not there."""
    shapes = []
    for add in (with_connectors, with_contact_items):
        _keep, mbs, handle = with_obstacle(add)
        for t in np.linspace(0.1, 2.0, 20):
            handle.set_tensions({"t1": float(t)})
            mbs.SolveTDCR()
        shapes.append(handle.shape()[0])
    assert distance(*shapes) < 1e-6
