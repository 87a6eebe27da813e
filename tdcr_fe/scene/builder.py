"""A robot as items in anybody's Exudyn scene: `CreateTDCR`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np

from tdcr_fe.elements.actuation import Clamp, Connectors, TendonActuation
from tdcr_fe.elements.backbone import BEAM_TO_SECTION, add_backbone, reference_poses
from tdcr_fe.elements.disks import add_disk, base_plate
from tdcr_fe.elements.friction import FRICTION_MODELS, TendonLaw, TendonParameters
from tdcr_fe.elements.hooks import SceneHooks
from tdcr_fe.elements.section import SectionForces
from tdcr_fe.elements.tendons import CableGeometry
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.scene.binding import bind
from tdcr_fe.scene.handle import TDCR
from tdcr_fe.scene.mesh import build_mesh
from tdcr_fe.scene.section import continuous_tendons, superelastic_section

#: Colours of the parts (RGBA).
BACKBONE_COLOR = (0.20, 0.25, 0.35, 1.0)
DISK_COLOR = (0.55, 0.65, 0.80, 0.6)
TENDON_COLORS = (
    (0.85, 0.33, 0.10, 1.0),
    (0.00, 0.45, 0.70, 1.0),
    (0.00, 0.60, 0.45, 1.0),
    (0.80, 0.47, 0.65, 1.0),
)


def CreateTDCR(
    mbs: exu.MainSystem,
    robot: Robot,
    model: Model | None = None,
    *,
    name: str | None = None,
    basePosition: Sequence[float] = (0.0, 0.0, 0.0),
    baseRotationMatrix: Any = None,
    baseMarker: Any = None,
    loadPositions: Sequence[float] = (),
    presliding: float = 1e-6,
    show: bool = True,
) -> TDCR:
    """Add a tendon-driven continuum robot to a system.

    Call before ``mbs.Assemble()``. The system, its assembly, the settings and the solver call stay yours; the
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
        Pose of the base plate in the world [m], shapes (3,) and (3, 3); the robot points along the third axis.
    baseMarker
        A rigid marker of yours that carries the base plate; its pose in the reference configuration must be
        the one above. None sits the robot on ground.
    loadPositions
        Arc lengths where you will add loads or markers between nodes [m].
    presliding
        Distance that a tendon creeps through a hole from rest to full friction [m].
    show
        Draw it.

    Returns
    -------
    TDCR
        Everything that was made, and a handle to set and read.

    Raises
    ------
    ValueError
        The classical model was asked for with friction, two robots have one name, an argument is no rotation, or
        a load lies beyond the tip.
    """
    model = model or Model()
    name = name or robot.name
    if model.tendon_path == "continuous" and model.friction != "none":
        raise ValueError(
            "the classical model (tendon_path 'continuous') has no friction; set friction to 'none'"
        )
    if model.tendon_path not in ("straight", "continuous"):
        raise ValueError(f"tendon_path {model.tendon_path!r}; must be 'straight' or 'continuous'")
    if model.friction not in FRICTION_MODELS:
        raise ValueError(f"friction {model.friction!r}; must be one of {', '.join(FRICTION_MODELS)}")
    if model.starting_elements_per_bay < 1:
        raise ValueError(f"elements_per_bay {model.elements_per_bay}; must be 1 or more")
    position = np.asarray(basePosition, dtype=float)
    rotation = np.eye(3) if baseRotationMatrix is None else np.asarray(baseRotationMatrix, dtype=float)
    if rotation.shape != (3, 3) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-9):
        raise ValueError("baseRotationMatrix must be a rotation matrix of shape (3, 3)")
    if np.linalg.det(rotation) < 0.0:
        raise ValueError("baseRotationMatrix is a reflection; must be a rotation matrix")
    length = robot.backbone.length
    outside = [s for s in loadPositions if not -1e-9 <= s <= length + 1e-9]
    if outside:
        raise ValueError(f"loadPositions: {outside[0]:g} m; the backbone spans 0 to {length:g} m")
    hooks = SceneHooks.of(mbs)
    if not hooks.actuations:
        mbs.variables["tdcr_fe.names"], mbs.variables["tdcr_fe.robots"] = [], {}
    names = mbs.variables["tdcr_fe.names"]
    if name in names:
        raise ValueError(f"the system has a robot {name!r} already; give another name")

    mesh, rigid = build_mesh(robot, model, loadPositions)
    disks = robot.disks
    items = add_backbone(mbs, mesh, position, rotation, name, robot.backbone.radius, BACKBONE_COLOR)
    disk_nodes = [mesh.node_at(s) for s in disks.positions]
    bodies = [
        add_disk(
            mbs,
            items.nodes[k],
            disks.mass,
            disks.radius,
            disks.thickness,
            f"{name}.disk{i + 1}",
            DISK_COLOR,
            0.1 * disks.radius,
        )
        for i, k in enumerate(disk_nodes)
    ]
    masses = [*items.beams, *bodies] if robot.backbone.density > 0.0 else list(bodies)
    if robot.tip_mass > 0.0:
        masses.append(
            mbs.AddObject(
                eii.ObjectRigidBody(
                    name=f"{name}.payload", nodeNumber=items.nodes[-1], mass=robot.tip_mass, inertia=[0.0] * 6
                )
            )
        )
    gravity = []
    if any(model.gravity):
        for k, body in enumerate(masses):
            marker = mbs.AddMarker(eii.MarkerBodyMass(name=f"{name}.mMass{k}", bodyNumber=body))
            gravity.append(mbs.AddLoad(eii.Gravity(markerNumber=marker, loadVector=list(model.gravity))))

    base = mbs.AddMarker(
        eii.MarkerNodeRigid(
            name=f"{name}.mBase",
            nodeNumber=items.nodes[0],
            localHT=exu.HT(rotation=BEAM_TO_SECTION.T, translation=[0.0, 0.0, 0.0]),
        )
    )
    on_ground = baseMarker is None
    if on_ground:
        plate = base_plate(position, rotation, 1.2 * robot.disks.radius, 0.2 * robot.disks.radius, DISK_COLOR)
        ground = mbs.AddObject(
            eii.ObjectGround(name=f"{name}.ground", visualization=eii.VObjectGround(graphicsData=[plate]))
        )
        baseMarker = mbs.AddMarker(
            eii.MarkerBodyRigid(
                name=f"{name}.mGround",
                bodyNumber=ground,
                localHT=exu.HT(rotation=rotation, translation=position),
            )
        )
    joint = mbs.AddObject(
        eii.GenericJoint(
            name=f"{name}.baseJoint",
            markerNumbers=[baseMarker, base],
            constrainedAxes=[1, 1, 1, 1, 1, 1],
            visualization=eii.VObjectJointGeneric(show=False),
        )
    )

    hole_nodes = np.array([0, *disk_nodes])
    counts = [len(robot.hole_arc_lengths(t)) - 1 for t in robot.tendons]
    m, n = len(counts), max(counts, default=1)
    offsets = np.zeros((m, n + 1, 3))
    where = np.zeros((m, n + 1), dtype=int)
    mask = np.zeros((m, n), dtype=bool)
    holes_of = []
    tendons_of = []
    for i, (tendon, count) in enumerate(zip(robot.tendons, counts, strict=True)):
        holes = robot.holes(tendon)
        offsets[i, : count + 1, 1:] = holes
        offsets[i, count + 1 :] = offsets[i, count]
        where[i] = np.minimum(np.arange(n + 1), count)
        mask[i, :count] = True
        carriers = [items.beams[0], *bodies[:count]]
        # The base plate's holes sit on the first beam, which begins at the base.
        at = [[-0.5 * mesh.lengths[0], *holes[0]]] + [[0.0, *h] for h in holes[1:]]
        markers = [
            mbs.AddMarker(
                eii.MarkerBodyRigid(
                    name=f"{name}.{tendon.name}.mHole{k}",
                    bodyNumber=body,
                    localPosition=[float(x) for x in place],
                    visualization={"show": False},
                )
            )
            for k, (body, place) in enumerate(zip(carriers, at, strict=True))
        ]
        holes_of.append(markers)
        tendons_of.append(
            [
                mbs.AddObject(
                    eii.SpringDamper(
                        name=f"{name}.{tendon.name}.segment{k + 1}",
                        markerNumbers=[markers[k], markers[k + 1]],
                        referenceLength=1.0,
                        stiffness=0.0,
                        force=0.0,
                        visualization=eii.VObjectConnectorSpringDamper(
                            show=show, drawSize=0.0, color=list(TENDON_COLORS[i % len(TENDON_COLORS)])
                        ),
                    )
                )
                for k in range(count)
            ]
        )

    positions, rotations = reference_poses(mesh, np.zeros(3), BEAM_TO_SECTION)
    continuous = model.tendon_path == "continuous"
    tendon_section = continuous_tendons(robot, mesh) if continuous and m else None
    softening = superelastic_section(robot, mesh, rigid)
    section = None
    if tendon_section is not None or softening is not None:
        section = SectionForces(mesh.lengths, tendon_section, softening)
    clearance = np.array([t.clearance for t in robot.tendons])
    geometry = None if continuous else CableGeometry(where, offsets, mask, len(hole_nodes), clearance)
    if geometry is not None:
        geometry.shift_in_holes(positions[hole_nodes], rotations[hole_nodes])
        lengths = geometry.lengths(positions[hole_nodes], rotations[hole_nodes])
    elif tendon_section is not None:
        lengths = tendon_section.evaluate(mesh.reference_twists, mesh.lengths)[0][:, None]
        mask = np.ones((m, 1), dtype=bool)
    else:
        lengths, mask = np.zeros((0, 1)), np.zeros((0, 1), dtype=bool)
    inner = mask[:, 1:]
    friction = np.array([t.friction_coefficient for t in robot.tendons]).reshape(m, 1)
    adhesion = np.array([t.adhesion for t in robot.tendons]).reshape(m, 1)
    parameters = TendonParameters(
        lengths,
        mask,
        friction * inner,
        adhesion * inner,
        np.array([0.0 if t.axial_stiffness is None else 1.0 / t.axial_stiffness for t in robot.tendons]),
    )
    law = TendonLaw(parameters, FRICTION_MODELS[model.friction], presliding)
    forces: list[Any] = []
    torques: list[Any] = []
    if section is not None:
        for k, node in enumerate(items.nodes):
            marker = mbs.AddMarker(eii.MarkerNodeRigid(name=f"{name}.mWrench{k}", nodeNumber=node))
            zero = [0.0, 0.0, 0.0]
            forces.append(mbs.AddLoad(eii.Force(markerNumber=marker, loadVector=zero, bodyFixed=True)))
            torques.append(mbs.AddLoad(eii.Torque(markerNumber=marker, loadVector=zero, bodyFixed=True)))
    connectors = Connectors([] if continuous else tendons_of, forces, torques, holes_of)
    clamp = Clamp(joint, position, rotation @ BEAM_TO_SECTION) if on_ground else None
    actuation = TendonActuation(
        mbs, items.nodes, mesh, hole_nodes, geometry, law, section, connectors, clamp=clamp
    )
    hooks.actuations.append(actuation)
    names.append(name)
    handle = TDCR(
        mbs, name, robot, model, mesh, items.nodes, items.beams, bodies, holes_of, tendons_of, joint, base,
        gravity, actuation, rigid=rigid,
    )  # fmt: skip
    mbs.variables.setdefault("tdcr_fe.robots", {})[name] = handle
    return handle


bind("CreateTDCR", CreateTDCR)
