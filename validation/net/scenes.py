"""Scenes of the net: robots with obstacles, motors and moving bases in Exudyn, at rest and in motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from exudyn.rigidBodyUtilities import InertiaCuboid, RotationMatrixY

import tdcr_fe as tdcr
from tdcr_fe.elements import Array

LENGTH = 0.2
STIFFNESS, SPHERE, CENTRE, WALL = 2000.0, 0.03, (0.055, 0.002, 0.12), 0.05
GRAVITY = (1.0, 0.5, -9.81)
CORNERS = [[WALL, -0.2, 0.0], [WALL, -0.2, 0.4], [WALL, 0.2, 0.4], [WALL, 0.2, 0.0]]
#: A motion: end and step of time [s].
Motion = tuple[float, float]


@dataclass(frozen=True)
class Scene:
    """A scene: what is in it, and inputs one after the other, each followed by a solution."""

    inputs: tuple[Any, ...]  # tensions, or displacements where `driven`; a Motion solves in time from there
    tendons: int = 1
    mu: float = 0.3
    routing: str = "parallel"
    stretch: float | None = None  # EA of the tendons [N]
    driven: bool = False  # by displacement
    model: Mapping[str, Any] = field(default_factory=dict)
    backbone: Mapping[str, Any] = field(default_factory=dict)
    disks: Mapping[str, Any] = field(default_factory=dict)
    obstacle: Callable[..., Any] | None = None
    base: Callable[[exu.MainSystem], Mapping[str, Any]] | None = None
    load: str = ""  # frame of a force at the tip
    motor: bool = False
    robots: int = 1
    solver: str = "SolveTDCR"


#: Routing of a tendon at an angle [deg].
ROUTINGS: Mapping[str, Callable[[float], Any]] = {
    "parallel": lambda angle: tdcr.ParallelRouting(4.5e-3, angle),
    "helical": lambda angle: tdcr.HelicalRouting(4.5e-3, 0.4, angle),
    "converging": lambda angle: tdcr.ConvergingRouting(4.5e-3, 1.5e-3, angle),
}


def _robot(scene: Scene, name: str) -> tdcr.Robot:
    routing, count = ROUTINGS[scene.routing], scene.tendons
    routings = {f"t{i + 1}": routing(360.0 * i / count) for i in range(count)}
    tendons = [tdcr.Tendon(n, x, scene.mu, axial_stiffness=scene.stretch) for n, x in routings.items()]
    backbone = {"radius": 0.4e-3, "youngs_modulus": 85e9, "poisson_ratio": 0.3, "density": 5600.0}
    disks = tdcr.Disks.equally_spaced(8, LENGTH, **{"mass": 0.17e-3, "radius": 5e-3, **scene.disks})
    return tdcr.Robot(tdcr.Backbone(LENGTH, **{**backbone, **scene.backbone}), disks, tuple(tendons), name)


# ------------------------------------------------------------------------------------------------- obstacles, bases


def _ball(mbs: exu.MainSystem, arm: tdcr.TDCR, *others: tdcr.TDCR) -> Any:
    ground = mbs.CreateGround(referencePosition=list(CENTRE))
    return arm.add_disk_contact(ground, STIFFNESS, sphereRadius=SPHERE)


def _wall(mbs: exu.MainSystem, arm: tdcr.TDCR, *others: tdcr.TDCR) -> Any:
    return arm.add_disk_contact(mbs.CreateGround(), STIFFNESS, quadPoints=CORNERS)


def _rough_wall(mbs: exu.MainSystem, arm: tdcr.TDCR, *others: tdcr.TDCR) -> Any:
    rough: dict[str, Any] = {"contactDamping": 0.2, "dynamicFriction": 0.3}
    return arm.add_disk_contact(mbs.CreateGround(), STIFFNESS, quadPoints=CORNERS, **rough)


def _other_robot(mbs: exu.MainSystem, arm: tdcr.TDCR, *others: tdcr.TDCR) -> Any:
    return arm.add_disk_contact(others[0], STIFFNESS)


def _turned(mbs: exu.MainSystem) -> Mapping[str, Any]:
    return {"referencePosition": [0.01, 0.02, 0.3], "referenceRotationMatrix": RotationMatrixY(0.7)}


def _carriage(mbs: exu.MainSystem) -> Mapping[str, Any]:
    """A carriage on a rail, held by a spring with a damper and pushed sideways."""
    ground = mbs.CreateGround()
    sizes = InertiaCuboid(density=800.0, sideLengths=[0.05, 0.04, 0.03])
    body = mbs.CreateRigidBody(referencePosition=[0.0, 0.0, -0.015], inertia=sizes, gravity=[0.0, 0.0, -9.81])
    mbs.CreatePrismaticJoint(itemNumbers=[ground, body], position=[0, 0, -0.03], axis=[1, 0, 0], show=False)
    mbs.CreateCartesianSpringDamper(
        itemNumbers=[ground, body], localPosition0=[0.0, 0.0, -0.015],
        stiffness=[4.0, 0.0, 0.0], damping=[0.8, 0.0, 0.0], show=False,
    )  # fmt: skip
    top = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=body, localPosition=[0.0, 0.0, 0.015]))
    mbs.AddLoad(eii.Force(markerNumber=top, loadVector=[0.05, 0.0, 0.0]))
    return {"baseMarker": top}


# ---------------------------------------------------------------------------------------------------------- the table

ONE = ({"t1": 0.6}, {"t1": 1.2}, {"t1": 0.5}, {"t1": 1.0})
THREE = ({"t1": 1.0, "t2": 0.2}, {"t1": 0.4, "t2": 0.8}, {"t2": 0.3, "t3": 0.9})
PULLED = ({"t1": 2e-3, "t2": -6e-4, "t3": -6e-4}, {"t1": 1e-3, "t2": 2e-4, "t3": -6e-4})
#: From rest after a pull: release and move.
SWING = ({"t1": 1.0}, {"t1": 0.3}, (0.05, 1e-3))
SWING_THREE = ({"t1": 0.8, "t2": 0.3}, {"t1": 0.2, "t2": 0.7}, (0.05, 1e-3))
SWING_FAR = ({"t1": 0.2}, {"t1": 1.5}, (0.1, 1e-3))
SOFT = {"retardation_time": 4e-3}
DISPLACED: dict[str, Any] = {"tendons": 3, "stretch": 400.0, "driven": True}
RUBBER = {"radius": 3e-3, "youngs_modulus": 27e6}
CONTINUOUS = {"tendon_path": "continuous", "friction": "none"}

SCENES: Mapping[str, Scene] = {
    "no friction": Scene(ONE, mu=0.0, model={"friction": "none"}),
    "per hole": Scene(ONE),
    "per tendon": Scene(ONE, model={"friction": "per-tendon"}),
    "continuous": Scene(ONE, mu=0.0, routing="helical", model=CONTINUOUS),
    "three tendons, gravity": Scene(THREE, tendons=3, model={"gravity": GRAVITY}),
    "helical, automatic mesh": Scene(THREE, tendons=3, routing="helical", model={"elements_per_bay": "auto"}),
    "converging, elastic, displaced": Scene(PULLED, routing="converging", **DISPLACED),
    "inextensible, displaced": Scene(({"t1": 2e-3}, {"t1": 1e-3}, {"t1": 1.5e-3}), driven=True),
    "thick disks, precurved": Scene(ONE, backbone={"precurvature": (2.0, -1.0)}, disks={"thickness": 3e-3}),
    "world load": Scene(ONE, load="world"),
    "follower load": Scene(ONE, load="section"),
    "turned base": Scene(ONE, base=_turned, model={"gravity": GRAVITY}),
    "carriage": Scene(ONE, base=_carriage),
    "two robots": Scene(ONE, robots=2),
    "ball": Scene(ONE, obstacle=_ball, model={"elements_per_bay": 2}),
    "ball, no friction": Scene(ONE, mu=0.0, obstacle=_ball, model={"friction": "none"}),
    "wall": Scene(ONE, obstacle=_wall),
    "against another robot": Scene(
        ONE, obstacle=_other_robot, robots=2, backbone=RUBBER, model={"elements_per_bay": 4}
    ),
    "SolveStatic": Scene(({"t1": 0.5}, {"t1": 1.0}), solver="SolveStatic"),
    "SolveStatic, ball": Scene(({"t1": 0.5}, {"t1": 1.0}), solver="SolveStatic", obstacle=_ball),
    "swing": Scene(SWING),
    "swing, damped, three tendons": Scene(SWING_THREE, tendons=3, backbone=SOFT),
    "swing, elastic, displaced": Scene((*PULLED, (0.05, 1e-3)), backbone=SOFT, **DISPLACED),
    "swing, carriage": Scene(SWING, base=_carriage, backbone=SOFT),
    "swing against a rough wall": Scene(SWING_FAR, obstacle=_rough_wall, backbone=SOFT),
    "motor": Scene(((0.05, 1e-3),), stretch=400.0, motor=True, backbone=SOFT),
    "modes": Scene(ONE[:1], solver="modes"),
}


# ------------------------------------------------------------------------------------------------------- their records


def solve(key: str) -> dict[str, Array | str]:
    """Build a scene, go through its inputs, and read all robots after each solution."""
    tdcr.register()
    exu.config.printToConsole = False
    scene = SCENES[key]
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    arms = [_add(mbs, scene, k) for k in range(scene.robots)]
    contact = None if scene.obstacle is None else scene.obstacle(mbs, *arms)
    sensors = arms[0].add_sensors()
    energy = arms[0].add_energy_sensor()
    load = arms[0].add_load("push", at=LENGTH, frame=scene.load) if scene.load else None  # type: ignore[arg-type]
    if scene.motor:
        _wind(mbs, arms[0])
    mbs.Assemble()
    found: dict[str, list[Any]] = {name: [] for name in ("positions", "tensions", "displacements", "forces")}
    states = []
    for k, inputs in enumerate(scene.inputs):
        if isinstance(inputs, tuple):
            _move(mbs, arms[0], inputs)
        else:
            for number, arm in enumerate(arms):
                shares = {name: value * 0.3**number for name, value in inputs.items()}
                (arm.set_displacements if scene.driven else arm.set_tensions)(shares)
            if load is not None:
                load.set([0.005 * k, 0.01, -0.005], [0.0, 2e-4, 1e-4 * k])
            if isinstance(scene.inputs[min(k + 1, len(scene.inputs) - 1)], tuple) and k:
                continue  # the motion starts with these inputs
            if scene.solver == "SolveStatic":
                _ramp(mbs, arms[0], inputs)
            else:
                mbs.SolveTDCR()
        found["positions"].append([arm.position_at(np.array(arm.robot.disks.positions)) for arm in arms])
        found["tensions"].append([np.concatenate(list(arm.tensions().values())) for arm in arms])
        found["displacements"].append([list(arm.displacements().values()) for arm in arms])
        found["forces"].append([] if contact is None else contact.normal_forces())
        holes = [own for arm in arms for own in arm.hole_states().values()]
        states.append(" ".join("".join(state[0] for state in own) for own in holes))
    record: dict[str, Array | str] = {k: np.array(v, dtype=float) for k, v in found.items()}
    if isinstance(scene.inputs[-1], tuple):
        names = [name for name in sensors if name.startswith(("slip", "tip_position", "mobilisation"))]
        for name, sensor in [*((name, sensors[name]) for name in names), ("energy", energy)]:
            record[name] = mbs.GetSensorStoredData(sensor)[::10, 1:]
    if scene.solver == "modes":
        record["modes"] = mbs.TDCREigenvalues(numberOfEigenvalues=6).frequencies
    return {**record, "states": "/".join(states)}


def _add(mbs: exu.MainSystem, scene: Scene, number: int) -> tdcr.TDCR:
    model = tdcr.Model(**{"friction": "per-hole", "elements_per_bay": 1, **scene.model})
    base = {"referencePosition": [0.045, 0.0, 0.0]} if number else scene.base(mbs) if scene.base else {}
    return mbs.CreateTDCR(_robot(scene, f"robot{number}"), model, **base)


def _wind(mbs: exu.MainSystem, arm: tdcr.TDCR) -> None:
    """A motor with a constant torque and a damper."""
    motor = arm.add_motor("t1", 1e-6, 5e-3)
    nodes = (motor, mbs.AddNode(eii.NodePointGround()))
    marker, ground = (mbs.AddMarker(eii.MarkerNodeCoordinate(nodeNumber=n, coordinate=0)) for n in nodes)
    mbs.AddLoad(eii.LoadCoordinate(markerNumber=marker, load=3e-3))
    mbs.AddObject(eii.CoordinateSpringDamper(markerNumbers=[ground, marker], damping=1e-5))


def _ramp(mbs: exu.MainSystem, arm: tdcr.TDCR, inputs: Mapping[str, float]) -> None:
    """From the unloaded robot to these tensions, in small steps of Exudyn's static solver."""
    tensions = np.array([inputs[name] for name in arm.robot.tendon_names])
    arm.set_inputs_over_time(lambda t: (t * tensions).tolist())
    settings = exu.SimulationSettings()
    settings.staticSolver.numberOfLoadSteps = 30
    settings.staticSolver.newton.relativeTolerance = 1e-7
    settings.staticSolver.newton.absoluteTolerance = 1e-9
    settings.staticSolver.newton.maxIterations = 50
    settings.solution.file.write = False
    mbs.SolveStatic(settings)


def _move(mbs: exu.MainSystem, arm: tdcr.TDCR, motion: Motion) -> None:
    settings = arm.recommended_settings(*motion)
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = motion[1]
    mbs.SolveDynamic(settings)
