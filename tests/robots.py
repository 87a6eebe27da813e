"""Robots that the tests of the finite-element model share."""

from collections.abc import Callable, Sequence
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from exudyn.utilities import InertiaCuboid

from tdcr_fe import TDCR, Backbone, CreateTDCR, Disks, Robot, SequenceResult, Tendon, register
from tdcr_fe.model.loading import LoadStep, Model, resolve
from tdcr_fe.model.routing import ParallelRouting, Routing
from tdcr_fe.solve.simulate import Simulation, simulate

register()  # `mbs.SolveTDCR` and the like, for all tests with these robots
LENGTH = 0.25
BACKBONE = Backbone(LENGTH, 0.4e-3, 85e9, 0.3, 5600.0)
DISKS = Disks.equally_spaced(13, LENGTH, mass=0.17e-3, radius=5e-3)
SEVEN = Disks.equally_spaced(7, LENGTH, mass=0.3e-3, radius=5e-3)


def tendon(name: str = "t1", angle_deg: float = 0.0, mu: float = 0.3, **rest: Any) -> Tendon:
    """A parallel tendon 4.5 mm off the backbone."""
    return Tendon(name, ParallelRouting(4.5e-3, angle_deg), friction_coefficient=mu, **rest)


def paper(
    mu: float = 0.0, angle_deg: float = 0.0, backbone: Backbone = BACKBONE, disks: Disks = DISKS, **rest: Any
) -> Robot:
    """The paper's single-segment robot with one tendon."""
    return Robot(backbone, disks, (tendon("t1", angle_deg, mu, **rest),), name="paper")


def three(mu: float = 0.3, backbone: Backbone = BACKBONE, disks: Disks = DISKS, **rest: Any) -> Robot:
    """The same with three tendons, 120 degrees apart."""
    tendons = (tendon(f"t{i + 1}", 120.0 * i, mu, **rest) for i in range(3))
    return Robot(backbone, disks, tuple(tendons), name="three")


def seven(mu: float = 0.3, backbone: Backbone = BACKBONE, disks: Disks = SEVEN, **rest: Any) -> Robot:
    """The same with seven disks, which costs half as much."""
    return three(mu, backbone, disks, **rest)


def single(mu: float = 0.0, **rest: Any) -> Robot:
    """Seven disks and one tendon."""
    return paper(mu, disks=SEVEN, **rest)


def routed(*routings: Routing, disks: int = 13, mu: float = 0.0, **rest: Any) -> Robot:
    """Tendons t1, t2, ... of these routings through so many disks, or one parallel tendon."""
    named = enumerate(routings or (ParallelRouting(4.5e-3),), start=1)
    tendons = (Tendon(f"t{k}", routing, friction_coefficient=mu, **rest) for k, routing in named)
    return Robot(BACKBONE, Disks.equally_spaced(disks, LENGTH, mass=0.17e-3), tuple(tendons))


def wire(
    angles: Sequence[float] = (0.0, 120.0, 240.0),
    routing: Callable[[float], Routing] = lambda angle: ParallelRouting(6.5e-3, angle),
    **rest: Any,
) -> Robot:
    """1 mm of steel wire, 200 mm long, with ten thick disks and three tendons."""
    given = {"friction_coefficient": 0.15, "axial_stiffness": 5e3} | rest
    tendons = tuple(Tendon(f"t{k}", routing(a), **given) for k, a in enumerate(angles, start=1))
    disks = Disks.equally_spaced(10, 0.2, mass=0.9e-3, thickness=3e-3, radius=8e-3)
    return Robot(Backbone(0.2, 0.5e-3, 200e9, 0.3, 7850.0), disks, tendons)


def pull(*tensions: float, name: str = "t1", **rest: Any) -> list[LoadStep]:
    """One load step per tension of one tendon [N]."""
    return [LoadStep(f"{x:g} N", {name: x}, **rest) for x in tensions]


def solve(robot: Robot, steps: list[LoadStep], settings: Any = None, **model: Any) -> SequenceResult:
    """Solve a sequence with one element per bay and per-hole friction unless given otherwise; it must converge."""
    result = simulate(robot, Model(**{"elements_per_bay": 1, **model}), steps, settings)
    assert result.converged, result.message
    assert len(result.steps) == len(steps)
    return result


def degrees(result: SequenceResult) -> np.ndarray:
    """Tip bending angles [deg]."""
    return np.degrees(result.bending_angles)


def simulation(robot: Robot, model: Model, steps: Sequence[LoadStep], settings: Any = None) -> Simulation:
    """A robot that has gone through load steps."""
    targets = resolve(robot, steps)
    found = Simulation(robot, model, targets, settings)
    for step, target in zip(steps, targets, strict=True):
        found.advance(target, step.substeps)
    return found


def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Largest distance of points, over the length of the paper's robot [1]."""
    return float(np.max(np.linalg.norm(np.atleast_2d(a - b), axis=-1))) / LENGTH


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


def solve_scene(mbs: exu.MainSystem, handle: TDCR, *tensions: Any) -> np.ndarray:
    """Positions of the nodes after tensions, by tendon or in order, each set has been solved."""
    for each in tensions:
        handle.set_tensions(each)
        mbs.SolveTDCR()
    return handle.shape()[0]


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
