"""A robot as items in an Exudyn scene: `CreateTDCR`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.elements.backbone import BEAM_TO_SECTION
from tdcr_fe.elements.hysteresis import HYSTERESES
from tdcr_fe.elements.native.actuation import TendonActuation
from tdcr_fe.elements.native.history import HistoryNodes
from tdcr_fe.elements.native.hooks import SceneHooks
from tdcr_fe.elements.native.items import Clamp, Connectors
from tdcr_fe.model.checks import course_contradictions, size_contradictions
from tdcr_fe.model.loading import Model, Vector
from tdcr_fe.model.plausibility import plausibility
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.schema import Keys, Quantity, check_arguments, check_instance
from tdcr_fe.scene import parts
from tdcr_fe.scene.base import add_base_joint, add_ground, base_pose, set_moving
from tdcr_fe.scene.forces import force_model
from tdcr_fe.scene.handle import TDCR
from tdcr_fe.scene.mesh import build_mesh

_COLOR = Quantity(ge=0.0, le=1.0, allowed="four numbers from 0 to 1, such as [1, 0, 0, 1] for red")
_GRAPHICS = Quantity(allowed="a list of graphics, such as [exudyn.graphics.Sphere(radius=0.01)]")
#: Arguments of `CreateTDCR` that are checked as they stand.
ARGUMENTS = Keys(
    {
        "name": Annotated[str | None, Quantity()],
        "referencePosition": Annotated[Vector | None, Quantity(note="in m")],
        "initialVelocity": Annotated[Vector, Quantity(note="in m/s")],
        "initialAngularVelocity": Annotated[Vector, Quantity(note="in rad/s")],
        "loadPositions": Annotated[tuple[float, ...], Quantity(note="in m")],
        "presliding": Annotated[float, Quantity(note="in m", gt=0.0)],
        "show": Annotated[bool, Quantity(allowed="True, or False, which draws nothing")],
        "gravity": Annotated[Vector | None, Quantity(note="in m/s^2")],
        "color": Annotated[tuple[float, float, float, float] | None, _COLOR],
        "graphicsDataList": Annotated[list[dict[str, Any]], _GRAPHICS],
    }
)


def CreateTDCR(
    mbs: exu.MainSystem,
    robot: Robot,
    model: Model | None = None,
    *,
    name: str | None = None,
    referencePosition: Sequence[float] | None = None,
    referenceRotationMatrix: Any = None,
    baseMarker: Any = None,
    initialVelocity: Sequence[float] = (0.0, 0.0, 0.0),
    initialAngularVelocity: Sequence[float] = (0.0, 0.0, 0.0),
    loadPositions: Sequence[float] = (),
    presliding: float = 1e-6,
    show: bool = True,
    gravity: Sequence[float] | None = None,
    color: Sequence[float] | None = None,
    graphicsDataList: Sequence[Any] = (),
    returnDict: bool = False,
) -> TDCR | Any:
    """Add a tendon-driven continuum robot to a system.

    Call before ``mbs.Assemble()``. The system, its assembly, the settings and the solver call remain the user's; the
    renderer never starts by itself.

    Parameters
    ----------
    mbs
        The system.
    robot
        Description; read one with `tdcr_fe.io.toml.read_robot` or make it in Python.
    model
        Tendon path, friction, elements per bay, gravity.
    name
        Prefix of all item names; must differ between robots of one system. Default: the robot's name.
    referencePosition, referenceRotationMatrix
        Pose of the base plate in the world [m], shapes (3,) and (3, 3); the robot points along the third axis. None
        is the origin with the axes of the world or, with ``baseMarker``, the pose of that marker.
    baseMarker
        Rigid marker that carries the base plate, at its pose in the reference configuration. None puts the robot on
        ground.
    initialVelocity, initialAngularVelocity
        Velocity and angular velocity of the base plate, which the robot follows as a rigid body, in world axes [m/s,
        rad/s]: where the body of ``baseMarker`` begins with them in ``mbs.SolveDynamic``. ``mbs.SolveTDCR`` leaves
        everything at rest.
    loadPositions
        Arc lengths of further nodes, for loads or markers between disks [m].
    presliding
        Slip within which the friction at a hole goes from zero to full [m].
    show
        Whether the robot is drawn: backbone, disks, tendons, and the plate of a base on ground.
    gravity
        As ``gravity`` of the model [m/s^2], shape (3,).
    color
        Colour of the backbone, RGBA.
    graphicsDataList
        Drawn with the base plate of a robot on ground, in world coordinates.
    returnDict
        Return the numbers of all items by name, with the handle as ``"tdcr"``, as other functions of Exudyn do.

    Returns
    -------
    TDCR
        The handle: all items, and methods that set and read the state. A dict with ``returnDict``.

    Raises
    ------
    TypeError
        An argument is of another type; the message names the expected type and the function to call.
    ValueError
        The model needs too much memory, two robots have one name, an argument is no rotation, a load lies beyond
        the tip, a base on ground has a velocity, or the pose of ``baseMarker`` is another than the one given.
    """
    check_system("CreateTDCR", mbs)
    check_arguments("CreateTDCR", ARGUMENTS, locals())
    model = _checked_model(robot, model, gravity)
    plausibility(robot, model, ()).issued()
    motion = np.array([initialVelocity, initialAngularVelocity], dtype=float)
    on_ground = baseMarker is None
    _check_base(motion, graphicsDataList, on_ground)
    length = robot.backbone.length
    if outside := [s for s in loadPositions if not -1e-9 <= s <= length + 1e-9]:
        raise ValueError(f"loadPositions: {outside[0]:g} m; the backbone spans 0 to {length:g} m")
    pose = base_pose(mbs, referencePosition, referenceRotationMatrix, baseMarker)
    name, hooks = name or robot.name, SceneHooks.of(mbs)
    if name in (actuation.name for actuation in hooks.robots):
        raise ValueError(f"the system has a robot {name!r} already; give another name")
    mesh, rigid = build_mesh(robot, model, loadPositions)
    drawn = parts.BACKBONE_COLOR if color is None else color
    nodes, beams = parts.add_backbone(mbs, robot, mesh, pose, name, drawn)
    if motion.any():
        set_moving(mbs, nodes, pose.position, motion)
    disks = parts.add_disks(mbs, robot, mesh, nodes, name)
    bodies = [*disks, *parts.add_tip_mass(mbs, robot, nodes[-1], name)]
    with_mass = [*beams, *bodies] if robot.backbone.density > 0.0 else bodies
    weight = parts.add_gravity(mbs, with_mass, model.gravity, name)
    base = parts.section_marker(mbs, nodes[0], f"{name}.mBase")
    carrier = baseMarker
    if on_ground:
        carrier = add_ground(mbs, pose, [parts.base_plate(pose, robot.plate_radius), *graphicsDataList], name)
    joint = add_base_joint(mbs, carrier, base, name)
    holes, segments = parts.add_tendons(mbs, robot, mesh, [beams[0], *disks], name)
    damping = parts.add_material_damping(mbs, robot, mesh, nodes, name)
    forces = force_model(robot, model, mesh, rigid, HYSTERESES[model.hysteresis](presliding), pose)
    # The item that applies the forces of tendons and section to the nodes; its functions follow.
    hidden = eii.VObjectGenericODE2(show=False)
    applying = eii.ObjectGenericODE2(name=f"{name}.forces", nodeNumbers=nodes, visualization=hidden)
    others = [*bodies, joint] if damping is None else [*bodies, joint, *damping.bodies, *damping.dampers]
    connectors = Connectors(mbs.AddObject(applying), segments, holes, beams, others)
    history = HistoryNodes(hooks.system, forces.law, [f"{name}.{t}.history" for t in robot.tendon_names])
    has_mass = max(robot.backbone.density, robot.tip_mass, robot.disks.mass if disks else 0.0) > 0.0
    clamp = Clamp(joint, pose.position, pose.rotation @ BEAM_TO_SECTION) if on_ground else None
    actuation = TendonActuation(name, hooks.system, nodes, forces, connectors, history, has_mass, clamp)
    hooks.add(actuation)
    handle = TDCR(
        mbs=mbs, name=name, robot=robot, model=model, mesh=mesh, nNodes=nodes, oBeams=beams,
        bDisks=disks, mHoles=holes, oTendons=segments, oBaseJoint=joint, mBase=base,
        lGravity=weight, actuation=actuation, rigid=rigid, damping=damping,
    )  # fmt: skip
    if not show:
        _hide(mbs, handle)
    return _as_dict(handle) if returnDict else handle


def check_system(function: str, mbs: Any) -> None:
    """Refuse anything but a system of Exudyn; the error names what makes one."""
    hint = "an exudyn.MainSystem. SC = exudyn.SystemContainer(); mbs = SC.AddSystem() makes one."
    check_instance(function, "mbs", mbs, exu.MainSystem, hint)


def _checked_model(robot: Any, model: Any, gravity: Sequence[float] | None) -> Model:
    """The model of a robot, with the gravity given beside it; refuses one that needs too much memory."""
    hint = "a Robot. read_robot(path) reads one from robot.toml"
    check_instance("CreateTDCR", "robot", robot, Robot, hint)
    model = Model.default_for(robot) if model is None else model
    hint = "a Model, such as Model(friction='per-hole')"
    check_instance("CreateTDCR", "model", model, Model, hint)
    if gravity is not None:
        if any(model.gravity):
            text = "is given by the argument and by the model; give one of them"
            raise ValueError(f"CreateTDCR: gravity {text}")
        model = replace(model, gravity=tuple(float(g) for g in gravity))
    for c in course_contradictions(robot, model) + size_contradictions(robot, model):
        raise ValueError(f"{c.key} = {c.value}: {c.allowed}")
    return model


def _check_base(motion: Array, graphics: Sequence[Any], on_ground: bool) -> None:
    """Refuse a velocity of a base on ground, and graphics where no base of its own draws them."""
    if on_ground and motion.any():
        raise ValueError(
            "CreateTDCR: a base on ground has no velocity; initialVelocity and initialAngularVelocity are for a "
            "baseMarker on a body that moves"
        )
    if len(graphics) and not on_ground:
        raise ValueError(
            "CreateTDCR: graphicsDataList is drawn on the base of a robot on ground; with baseMarker, give it to your "
            "own body"
        )


def _hide(mbs: exu.MainSystem, handle: TDCR) -> None:
    """Draw nothing of a robot."""
    objects = list(handle.actuation.connectors.object_numbers)
    if handle.actuation.clamp is not None:
        objects.append(int(mbs.GetObjectNumber(f"{handle.name}.ground")))
    for item in objects:
        mbs.SetObjectParameter(item, "Vshow", False)
    for node in handle.nNodes:
        mbs.SetNodeParameter(node, "Vshow", False)


def _as_dict(handle: TDCR) -> dict[str, Any]:
    """Numbers of the items of a robot by name, and the handle itself as ``"tdcr"``."""
    return {
        "tdcr": handle,
        "nodeNumbers": handle.nNodes,
        "beamNumbers": handle.oBeams,
        "diskNumbers": handle.bDisks,
        "holeMarkers": handle.mHoles,
        "tendonNumbers": handle.oTendons,
        "forcesNumber": handle.oForces,
        "historyNodes": handle.nHistory,
        "baseJoint": handle.oBaseJoint,
        "baseMarker": handle.mBase,
        "gravityLoads": handle.lGravity,
    }
