"""A robot as items in an Exudyn scene: `CreateTDCR`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BEAM_TO_SECTION, add_backbone
from tdcr_fe.elements.hysteresis import HYSTERESES
from tdcr_fe.elements.native.actuation import TendonActuation
from tdcr_fe.elements.native.history import HistoryNodes
from tdcr_fe.elements.native.hooks import SceneHooks
from tdcr_fe.elements.native.items import Clamp, Connectors
from tdcr_fe.model import arguments
from tdcr_fe.model.checks import course_contradictions, size_contradictions
from tdcr_fe.model.loading import Model
from tdcr_fe.model.plausibility import warn_of_implausible
from tdcr_fe.model.robot import Robot
from tdcr_fe.scene import parts
from tdcr_fe.scene.forces import force_model
from tdcr_fe.scene.handle import TDCR
from tdcr_fe.scene.mesh import build_mesh

#: Colour of the backbone (RGBA).
BACKBONE_COLOR = (0.20, 0.25, 0.35, 1.0)


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
        Of the base plate, which the robot follows as a rigid body, in world axes [m/s, rad/s]: where the body of
        ``baseMarker`` begins with them in ``mbs.SolveDynamic``. ``mbs.SolveTDCR`` leaves everything at rest.
    loadPositions
        Arc lengths of further nodes, for loads or markers between disks [m].
    presliding
        Slip within which the friction at a hole goes from zero to full [m].
    show
        Whether the robot is drawn: backbone, disks, tendons, and the plate of a base on ground.
    gravity
        As ``gravity`` of the model [m/s^2], shape (3,).
    color
        Of the backbone, RGBA.
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
    model = _checked_model(robot, model, gravity)
    warn_of_implausible(robot, model, ())
    _check_placement(name, referencePosition, loadPositions, presliding)
    motion = _checked_motion(initialVelocity, initialAngularVelocity, baseMarker is None)
    _check_drawing(show, color, graphicsDataList, baseMarker is not None)
    outside = [s for s in loadPositions if not -1e-9 <= s <= robot.backbone.length + 1e-9]
    if outside:
        raise ValueError(
            f"loadPositions: {outside[0]:g} m; the backbone spans 0 to {robot.backbone.length:g} m"
        )
    pose = parts.base_pose(mbs, referencePosition, referenceRotationMatrix, baseMarker)
    name, hooks = name or robot.name, SceneHooks.of(mbs)
    if name in (actuation.name for actuation in hooks.actuations):
        raise ValueError(f"the system has a robot {name!r} already; give another name")
    mesh, rigid = build_mesh(robot, model, loadPositions)
    drawn = BACKBONE_COLOR if color is None else tuple(color)
    backbone = add_backbone(mbs, mesh, pose.position, pose.rotation, name, robot.backbone.radius, drawn)
    if motion.any():
        parts.set_moving(mbs, backbone.nodes, pose.position, motion)
    disks = parts.add_disks(mbs, robot, mesh, backbone.nodes, name)
    bodies = [*disks, *parts.add_tip_mass(mbs, robot, backbone.nodes[-1], name)]
    with_mass = [*backbone.beams, *bodies] if robot.backbone.density > 0.0 else bodies
    weight = parts.add_gravity(mbs, with_mass, model.gravity, name)
    base = parts.section_marker(mbs, backbone.nodes[0], f"{name}.mBase")
    on_ground = baseMarker is None
    carrier = (
        parts.add_ground(mbs, pose, robot.plate_radius, name, graphicsDataList) if on_ground else baseMarker
    )
    joint = parts.add_base_joint(mbs, carrier, base, name)
    tendons = parts.add_tendons(mbs, robot, mesh, [backbone.beams[0], *disks], name)
    damping = parts.add_material_damping(mbs, robot, mesh, backbone.nodes, name)
    forces = force_model(robot, model, mesh, rigid, HYSTERESES[model.hysteresis](presliding), pose)
    item = _force_item(mbs, backbone.nodes, name)
    others = [*bodies, joint] if damping is None else [*bodies, joint, *damping.bodies, *damping.dampers]
    connectors = Connectors(item, tendons.segments, tendons.holes, backbone.beams, others)
    history = HistoryNodes(
        hooks.system, forces.law, [f"{name}.{tendon.name}.history" for tendon in robot.tendons]
    )
    has_mass = max(robot.backbone.density, robot.tip_mass, robot.disks.mass if disks else 0.0) > 0.0
    clamp = Clamp(joint, pose.position, pose.rotation @ BEAM_TO_SECTION) if on_ground else None
    actuation = TendonActuation(
        name, hooks.system, backbone.nodes, forces, connectors, history, has_mass, clamp=clamp
    )
    hooks.add(actuation)
    handle = TDCR(
        mbs=mbs, name=name, robot=robot, model=model, mesh=mesh, nNodes=backbone.nodes, oBeams=backbone.beams,
        bDisks=disks, mHoles=tendons.holes, oTendons=tendons.segments, oBaseJoint=joint, mBase=base,
        lGravity=weight, actuation=actuation, rigid=rigid, damping=damping,
    )  # fmt: skip
    if not show:
        _hide(mbs, handle)
    return _as_dict(handle) if returnDict else handle


def check_system(function: str, mbs: Any) -> None:
    """Refuse anything but a system of Exudyn; the error names what makes one."""
    hint = "an exudyn.MainSystem. SC = exudyn.SystemContainer(); mbs = SC.AddSystem() makes one."
    arguments.check_instance(function, "mbs", mbs, exu.MainSystem, hint)


def _checked_model(robot: Any, model: Any, gravity: Sequence[float] | None) -> Model:
    """The model of a robot, with the gravity given beside it; refuses one that needs too much memory."""
    hint = "a Robot. read_robot(path) reads one from robot.toml"
    arguments.check_instance("CreateTDCR", "robot", robot, Robot, hint)
    model = Model.default_for(robot) if model is None else model
    hint = "a Model, such as Model(friction='per-hole')"
    arguments.check_instance("CreateTDCR", "model", model, Model, hint)
    if gravity is not None:
        hint = "[0, 0, -9.81] is that on earth."
        arguments.check_numbers("CreateTDCR", "gravity", gravity, hint, count=3)
        if any(model.gravity):
            raise ValueError(
                "CreateTDCR: gravity is given by the argument and by the model; give one of them"
            )
        model = replace(model, gravity=tuple(float(g) for g in gravity))
    for c in course_contradictions(robot, model) + size_contradictions(robot, model):
        raise ValueError(f"{c.key} = {c.value}: {c.allowed}")
    return model


def _check_placement(name: Any, position: Any, load_positions: Any, presliding: Any) -> None:
    """Refuse arguments of `CreateTDCR` of another type or size."""
    hint = "a text. It is the prefix of all item names; None takes the robot's name."
    arguments.check_instance("CreateTDCR", "name", name, (str, type(None)), hint)
    if position is not None:
        hint = "[0, 0, 0] is the origin [m]."
        arguments.check_numbers("CreateTDCR", "referencePosition", position, hint, count=3)
    hint = "loadPositions=[0.1] adds a node at 0.1 m."
    arguments.check_numbers("CreateTDCR", "loadPositions", load_positions, hint)
    hint = "1e-6 is the default [m]."
    arguments.check_number("CreateTDCR", "presliding", presliding, hint, positive=True)


def _checked_motion(velocity: Any, angular_velocity: Any, on_ground: bool) -> NDArray[np.float64]:
    """Velocity and angular velocity of the base plate [m/s, rad/s], shape (2, 3); refused for one on ground."""
    given = {"initialVelocity": velocity, "initialAngularVelocity": angular_velocity}
    for argument, value in given.items():
        arguments.check_numbers("CreateTDCR", argument, value, "[0, 0, 0] is at rest.", count=3)
    motion = np.array([velocity, angular_velocity], dtype=float)
    if on_ground and motion.any():
        raise ValueError(
            "CreateTDCR: a base on ground has no velocity; initialVelocity and initialAngularVelocity are for a "
            "baseMarker on a body that moves"
        )
    return motion


def _check_drawing(show: Any, color: Any, graphics: Any, on_marker: bool) -> None:
    """Refuse a colour other than four numbers in [0, 1], and graphics where no base of its own draws them."""
    check = arguments.check_instance
    check("CreateTDCR", "show", show, (bool, np.bool_), "True or False. False draws nothing.")
    hint = "a list of graphics. [exudyn.graphics.Sphere(radius=0.01)] is one."
    check("CreateTDCR", "graphicsDataList", graphics, (list, tuple), hint)
    for each in graphics:
        check("CreateTDCR", "graphicsDataList", each, dict, hint)
    if color is not None:
        hint = "[1, 0, 0, 1] is red; exudyn.graphics.color has others."
        arguments.check_numbers("CreateTDCR", "color", color, hint, count=4)
        if np.any((np.asarray(color) < 0.0) | (np.asarray(color) > 1.0)):
            raise ValueError(f"CreateTDCR: color = {list(color)}; must be four numbers from 0 to 1. {hint}")
    if len(graphics) and on_marker:
        raise ValueError(
            "CreateTDCR: graphicsDataList is drawn on the base of a robot on ground; with baseMarker, give it to your "
            "own body"
        )


def _force_item(mbs: exu.MainSystem, nodes: Sequence[Any], name: str) -> Any:
    """Add the item that applies the forces of tendons and section to the nodes; its functions follow."""
    drawn = eii.VObjectGenericODE2(show=False)
    item = eii.ObjectGenericODE2(name=f"{name}.forces", nodeNumbers=list(nodes), visualization=drawn)
    return mbs.AddObject(item)


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
