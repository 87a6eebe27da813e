"""A robot as items in an Exudyn scene: `CreateTDCR`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, overload

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BEAM_TO_SECTION, BackboneItems, BackboneMesh, add_backbone
from tdcr_fe.elements.native.actuation import TendonActuation
from tdcr_fe.elements.native.history import HistoryNodes
from tdcr_fe.elements.native.hooks import SceneHooks
from tdcr_fe.elements.native.items import Clamp, Connectors
from tdcr_fe.elements.native.material_damping import MaterialDamping
from tdcr_fe.model import arguments
from tdcr_fe.model.checks import course_contradictions, size_contradictions
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.scene.dynamics import add_material_damping
from tdcr_fe.scene.exudyn_names import as_dict, check_drawing, one_of, with_gravity
from tdcr_fe.scene.forces import force_model
from tdcr_fe.scene.handle import TDCR
from tdcr_fe.scene.mesh import build_mesh
from tdcr_fe.scene.parts import (
    BasePose,
    add_base_joint,
    add_disks,
    add_gravity,
    add_ground,
    add_tip_mass,
    base_pose,
    section_marker,
)
from tdcr_fe.scene.tendons import TendonItems, add_tendons

#: Colour of the backbone (RGBA).
BACKBONE_COLOR = (0.20, 0.25, 0.35, 1.0)


@overload
def CreateTDCR(
    mbs: exu.MainSystem,
    robot: Robot,
    model: Model | None = None,
    *,
    name: str | None = None,
    basePosition: Sequence[float] | None = None,
    baseRotationMatrix: Any = None,
    baseMarker: Any = None,
    loadPositions: Sequence[float] = (),
    presliding: float = 1e-6,
    show: bool = True,
    referencePosition: Sequence[float] | None = None,
    referenceRotationMatrix: Any = None,
    gravity: Sequence[float] | None = None,
    color: Sequence[float] | None = None,
    graphicsDataList: Sequence[Any] = (),
    returnDict: Literal[False] = False,
) -> TDCR: ...


@overload
def CreateTDCR(
    mbs: exu.MainSystem,
    robot: Robot,
    model: Model | None = None,
    *,
    name: str | None = None,
    basePosition: Sequence[float] | None = None,
    baseRotationMatrix: Any = None,
    baseMarker: Any = None,
    loadPositions: Sequence[float] = (),
    presliding: float = 1e-6,
    show: bool = True,
    referencePosition: Sequence[float] | None = None,
    referenceRotationMatrix: Any = None,
    gravity: Sequence[float] | None = None,
    color: Sequence[float] | None = None,
    graphicsDataList: Sequence[Any] = (),
    returnDict: Literal[True],
) -> dict[str, Any]: ...


def CreateTDCR(
    mbs: exu.MainSystem,
    robot: Robot,
    model: Model | None = None,
    *,
    name: str | None = None,
    basePosition: Sequence[float] | None = None,
    baseRotationMatrix: Any = None,
    baseMarker: Any = None,
    loadPositions: Sequence[float] = (),
    presliding: float = 1e-6,
    show: bool = True,
    referencePosition: Sequence[float] | None = None,
    referenceRotationMatrix: Any = None,
    gravity: Sequence[float] | None = None,
    color: Sequence[float] | None = None,
    graphicsDataList: Sequence[Any] = (),
    returnDict: bool = False,
) -> TDCR | dict[str, Any]:
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
    basePosition, baseRotationMatrix
        Pose of the base plate in the world [m], shapes (3,) and (3, 3); the robot points along the third axis. None
        is the origin with the axes of the world or, with ``baseMarker``, the pose of that marker.
    baseMarker
        Rigid marker that carries the base plate, at its pose in the reference configuration. None puts the robot on
        ground.
    loadPositions
        Arc lengths of further nodes, for loads or markers between disks [m].
    presliding
        Slip within which the friction at a hole goes from zero to full [m].
    show
        Whether the robot is drawn: backbone, disks, tendons, and the plate of a base on ground.
    referencePosition, referenceRotationMatrix
        Exudyn's names of ``basePosition`` and ``baseRotationMatrix``.
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
    TDCR or dict
        The handle: all items, and methods that set and read the state.

    Raises
    ------
    TypeError
        An argument is of another type; the message names the expected type and the function to call.
    ValueError
        The model needs too much memory, two robots have one name, an argument is no rotation, a load lies beyond
        the tip, one thing is given under two names, or the pose of ``baseMarker`` is another than the one given.
    """
    check_system("CreateTDCR", mbs)
    model = _checked_model(robot, model, gravity)
    positions = {"basePosition": basePosition, "referencePosition": referencePosition}
    _check_placement(name, positions, loadPositions, presliding)
    check_drawing(show, color, graphicsDataList, baseMarker is not None)
    check_arc_lengths(loadPositions, robot.backbone.length)
    pose = base_pose(
        mbs,
        one_of("basePosition", basePosition, "referencePosition", referencePosition),
        one_of("baseRotationMatrix", baseRotationMatrix, "referenceRotationMatrix", referenceRotationMatrix),
        baseMarker,
    )
    name = _new_name(mbs, name or robot.name)
    mesh, rigid = build_mesh(robot, model, loadPositions)
    backbone = add_backbone(
        mbs,
        mesh,
        pose.position,
        pose.rotation,
        name,
        robot.backbone.radius,
        BACKBONE_COLOR if color is None else tuple(color),
    )
    disks = add_disks(mbs, robot, mesh, backbone.nodes, name)
    bodies = [*disks, *add_tip_mass(mbs, robot, backbone.nodes[-1], name)]
    with_mass = [*backbone.beams, *bodies] if robot.backbone.density > 0.0 else bodies
    gravity = add_gravity(mbs, with_mass, model.gravity, name)
    base = section_marker(mbs, backbone.nodes[0], f"{name}.mBase")
    carrier = (
        add_ground(mbs, pose, robot.plate_radius, name, graphicsDataList)
        if baseMarker is None
        else baseMarker
    )
    joint = add_base_joint(mbs, carrier, base, name)
    clamp = Clamp(joint, pose.position, pose.rotation @ BEAM_TO_SECTION) if baseMarker is None else None
    tendons = add_tendons(mbs, robot, mesh, backbone.beams[0], disks, name, bool(show))
    damping = add_material_damping(SceneHooks.of(mbs).system, robot, mesh, backbone.nodes, name)
    actuation = add_actuation(
        mbs, robot, model, mesh, rigid, backbone, tendons, [*bodies, joint], clamp, name, presliding, pose, damping
    )  # fmt: skip
    handle = TDCR(
        mbs=mbs, name=name, robot=robot, model=model, mesh=mesh, nNodes=backbone.nodes, oBeams=backbone.beams,
        bDisks=disks, mHoles=tendons.holes, oTendons=tendons.segments, oBaseJoint=joint, mBase=base,
        lGravity=gravity, actuation=actuation, rigid=rigid, damping=damping,
    )  # fmt: skip
    if not show:
        hide(mbs, handle)
    return as_dict(handle) if returnDict else handle


def hide(mbs: exu.MainSystem, handle: TDCR) -> None:
    """Draw nothing of a robot."""
    objects = list(handle.actuation.connectors.object_numbers)
    if handle.actuation.clamp is not None:
        objects.append(int(mbs.GetObjectNumber(f"{handle.name}.ground")))
    for item in objects:
        mbs.SetObjectParameter(item, "Vshow", False)
    for node in handle.nNodes:
        mbs.SetNodeParameter(node, "Vshow", False)


def check_system(function: str, mbs: Any) -> None:
    """Refuse anything but a system of Exudyn; the error names what makes one."""
    hint = "SC = exudyn.SystemContainer(); mbs = SC.AddSystem() makes one."
    arguments.check_instance(function, "mbs", mbs, exu.MainSystem, "an exudyn.MainSystem", hint)


def _checked_model(robot: Any, model: Any, gravity: Sequence[float] | None) -> Model:
    """The model of a robot, with the gravity given beside it; refuses what is none, or needs too much memory."""
    arguments.check_robot("CreateTDCR", robot)
    model = Model.default_for(robot) if model is None else model
    arguments.check_model("CreateTDCR", model)
    model = with_gravity(model, gravity)
    check_size(robot, model)
    return model


def _new_name(mbs: exu.MainSystem, name: str) -> str:
    """The name of a new robot; refuses that of another one in the system."""
    if name in robot_names(mbs):
        raise ValueError(f"the system has a robot {name!r} already; give another name")
    return name


def _check_placement(name: Any, positions: dict[str, Any], load_positions: Any, presliding: Any) -> None:
    """Refuse arguments of `CreateTDCR` of another type or size; positions by the name they were given under."""
    hint = "It is the prefix of all item names; None takes the robot's name."
    arguments.check_instance("CreateTDCR", "name", name, (str, type(None)), "a text", hint)
    for argument, position in positions.items():
        if position is not None:
            arguments.check_numbers("CreateTDCR", argument, position, "[0, 0, 0] is the origin [m].", count=3)
    hint = "loadPositions=[0.1] adds a node at 0.1 m."
    arguments.check_numbers("CreateTDCR", "loadPositions", load_positions, hint)
    hint = "1e-6 is the default [m]."
    arguments.check_number("CreateTDCR", "presliding", presliding, hint, positive=True)


def check_size(robot: Robot, model: Model) -> None:
    """Refuse a model that needs too much memory.

    Raises
    ------
    ValueError
        Names the field, its value and what is allowed.
    """
    for c in course_contradictions(robot, model) + size_contradictions(robot, model):
        raise ValueError(f"{c.key} = {c.value}: {c.allowed}")


def check_arc_lengths(arc_lengths: Sequence[float], length: float) -> None:
    """Refuse arc lengths [m] that are not on the backbone."""
    outside = [s for s in arc_lengths if not -1e-9 <= s <= length + 1e-9]
    if outside:
        raise ValueError(f"loadPositions: {outside[0]:g} m; the backbone spans 0 to {length:g} m")


def robot_names(mbs: exu.MainSystem) -> list[str]:
    """Names of the robots of a system; none again after ``mbs.Reset()``."""
    return [actuation.name for actuation in SceneHooks.of(mbs).actuations]


def add_actuation(
    mbs: exu.MainSystem,
    robot: Robot,
    model: Model,
    mesh: BackboneMesh,
    rigid: NDArray[np.bool_],
    backbone: BackboneItems,
    tendons: TendonItems,
    others: list[Any],
    clamp: Clamp | None,
    name: str,
    presliding: float,
    base: BasePose,
    damping: MaterialDamping | None,
) -> TendonActuation:
    """Create the forces of tendons and section, the item that applies them, and the nodes of their history."""
    if damping is not None:
        others = [*others, damping.item]
    hooks = SceneHooks.of(mbs)
    model_of_forces = force_model(robot, model, mesh, rigid, presliding, base)
    item = mbs.AddObject(
        eii.ObjectGenericODE2(
            name=f"{name}.forces",
            nodeNumbers=list(backbone.nodes),
            visualization=eii.VObjectGenericODE2(show=False),
        )
    )
    history = HistoryNodes(
        hooks.system, model_of_forces.law, [f"{name}.{tendon.name}.history" for tendon in robot.tendons]
    )
    actuation = TendonActuation(
        name,
        hooks.system,
        backbone.nodes,
        model_of_forces,
        Connectors(item, tendons.segments, tendons.holes, backbone.beams, others),
        history,
        has_mass(robot),
        clamp=clamp,
    )
    hooks.add(actuation, damping)
    return actuation


def has_mass(robot: Robot) -> bool:
    """Whether anything of a robot has a mass."""
    disks = robot.disks
    return (
        robot.backbone.density > 0.0
        or robot.tip_mass > 0.0
        or (disks.mass > 0.0 and len(disks.positions) > 0)
    )
