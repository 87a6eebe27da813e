"""Robots in scenes of Exudyn, what else is in these, and settings of Exudyn's own solvers."""

from collections.abc import Callable
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from exudyn.utilities import InertiaCuboid
from robots import LENGTH

from tdcr_fe import TDCR, CreateTDCR, Model, Robot, register

#: A quarter turn about y, and weight.
TURN, HEAVY = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]), [0.0, 0.0, -9.81]

register()  # `mbs.SolveTDCR` and the like, for all tests with these scenes


def system() -> tuple[exu.SystemContainer, exu.MainSystem]:
    """An empty system; the container must be kept while it is used."""
    container = exu.SystemContainer()
    return container, container.AddSystem()


#: A container that must be kept while its system is used, the system, and a robot in it.
Scene = tuple[exu.SystemContainer, exu.MainSystem, TDCR]


def scene(robot: Robot, *, assemble: bool = True, **rest: Any) -> Scene:
    """A system with one robot; ``rest``: of its model, or of `CreateTDCR`."""
    names = ("friction", "elements_per_bay", "tendon_path", "gravity", "hysteresis")
    model = {k: rest.pop(k) for k in names if k in rest}
    container, mbs = system()
    handle = CreateTDCR(mbs, robot, Model(**{"elements_per_bay": 1, **model}), **rest)
    if assemble:
        mbs.Assemble()
    return container, mbs, handle


def scene_with(add: Callable[[exu.MainSystem, TDCR], Any], robot: Robot, **rest: Any) -> tuple[*Scene, Any]:
    """A system with one robot and what is added to it before it is assembled."""
    container, mbs, handle = scene(robot, assemble=False, **rest)
    added = add(mbs, handle)
    mbs.Assemble()
    return container, mbs, handle, added


def tip_load(mbs: exu.MainSystem, handle: TDCR) -> Any:
    """A load at the tip."""
    return handle.add_load("tip", LENGTH)


def tip_sensor(mbs: exu.MainSystem, handle: TDCR) -> Any:
    """A sensor of the position of the tip."""
    return handle.add_sensors()["tip_position"]


def solve_scene(mbs: exu.MainSystem, arm: TDCR, *inputs: Any, by: str = "tensions", **keys: Any) -> Any:
    """Positions of the nodes after inputs, by tendon or in order, each set has been solved."""
    for each in inputs:
        getattr(arm, f"set_{by}")(each)
        mbs.SolveTDCR(**keys)
    return arm.shape()[0]


def pulled_in_steps(mbs: exu.MainSystem, handle: TDCR, tensions: Any) -> list[dict[str, Any]]:
    """What `mbs.SolveTDCR` reports of a pull of the first tendon in steps."""
    reports = []
    for tension in tensions:
        handle.set_tensions({"t1": float(tension)})
        reports.append(mbs.SolveTDCR())
    return reports


def push(mbs: exu.MainSystem, load: Any, *force_and_moment: Any) -> dict[str, Any]:
    """What `mbs.SolveTDCR` reports where a load is another one."""
    load.set(*force_and_moment)
    return mbs.SolveTDCR()


def hinged_platform(stiffness: float) -> tuple[exu.SystemContainer, exu.MainSystem, Any]:
    """A system with a body at the origin on a torsional spring about y [N m/rad], and a marker to put a robot on."""
    container, mbs = system()
    ground = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=mbs.AddObject(eii.ObjectGround())))
    node = mbs.AddNode(eii.NodeRigidBodyEP(referenceCoordinates=[0, 0, 0, 1, 0, 0, 0]))
    inertia = [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    body = mbs.AddObject(eii.ObjectRigidBody(nodeNumber=node, mass=1.0, inertia=inertia))
    platform = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=body))
    mbs.AddObject(eii.GenericJoint(markerNumbers=[ground, platform], constrainedAxes=[1, 1, 1, 1, 0, 1]))
    k = np.diag([0.0, 0.0, 0.0, 0.0, stiffness, 0.0])
    mbs.AddObject(eii.RigidBodySpringDamper(markerNumbers=[ground, platform], stiffness=k, damping=0.0 * k))
    return container, mbs, platform


def pendulum(robot: Robot) -> tuple[*Scene, Any]:
    """A bar of 0.16 kg and 0.2 m hung up on a hinge about y at the origin, with a robot at its lower end; the bar."""
    container, mbs = system()
    weight, down = {"gravity": [0.0, 0.0, -9.81]}, np.diag([1.0, -1.0, -1.0])
    inertia = InertiaCuboid(2e3, [0.02, 0.02, 0.2])
    bar = mbs.CreateRigidBody(referencePosition=[0.0, 0.0, -0.1], inertia=inertia, **weight)
    mbs.CreateRevoluteJoint(itemNumbers=[mbs.CreateGround(), bar], position=[0, 0, 0], axis=[0, 1, 0])
    end = exu.HT(rotation=down, translation=[0.0, 0.0, -0.1])
    marker = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=bar, localHT=end))
    handle = CreateTDCR(mbs, robot, Model(elements_per_bay=1), baseMarker=marker, **weight)
    mbs.Assemble()
    return container, mbs, handle, bar


def damped(robot: Robot, damping: float = 0.03) -> tuple[exu.SystemContainer, exu.MainSystem, TDCR]:
    """A robot whose tip is damped against ground [N s/m]; by default near critical damping."""

    def damper(mbs: exu.MainSystem, handle: TDCR) -> None:
        both = [mbs.AddMarker(eii.MarkerBodyPosition(bodyNumber=mbs.CreateGround())), handle.mTip]
        values = {"stiffness": [0.0] * 3, "damping": [damping] * 3}
        mbs.AddObject(eii.CartesianSpringDamper(markerNumbers=both, **values))

    return scene_with(damper, robot)[:3]


def recommended(handle: TDCR, end: float, step: float) -> exu.SimulationSettings:
    """The robot's recommended settings up to an end [s], without output."""
    s = handle.recommended_settings(end, step)
    s.timeIntegration.verboseMode = s.staticSolver.verboseMode = 0
    s.solution.file.write = False
    return s


def solve_by_exudyn(
    mbs: exu.MainSystem, handle: TDCR, inputs: Callable[[float], list[float]], step: float
) -> None:
    """Take a robot through inputs over one second with Exudyn's static solver, in steps of so long [s]."""
    handle.set_inputs_over_time(inputs)
    assert mbs.SolveStatic(recommended(handle, 1.0, step))
