"""A robot as items in anybody's Exudyn scene: `CreateTDCR`, and the handle it returns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.actuation import Clamp, Connectors, TendonActuation
from tdcr_fe.elements.backbone import (
    BEAM_TO_SECTION,
    INSERT_FACTORS,
    BackboneMesh,
    add_backbone,
    add_residual_flexibility,
    reference_poses,
    subdivide,
)
from tdcr_fe.elements.disks import add_disk, base_plate
from tdcr_fe.elements.friction import FRICTION_LAWS, TendonLaw, TendonParameters, TensionField, hole_states
from tdcr_fe.elements.hooks import SceneHooks
from tdcr_fe.elements.section import (
    ContinuousTendons,
    SectionForces,
    SuperelasticSection,
    gauss_arc_lengths,
)
from tdcr_fe.elements.tendons import CableGeometry
from tdcr_fe.model.interpolation import interpolate_positions
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot

Array = NDArray[np.float64]
Frame = Literal["world", "section"]

#: Colours of the parts (RGBA).
BACKBONE_COLOR = (0.20, 0.25, 0.35, 1.0)
DISK_COLOR = (0.55, 0.65, 0.80, 0.6)
TENDON_COLORS = (
    (0.85, 0.33, 0.10, 1.0),
    (0.00, 0.45, 0.70, 1.0),
    (0.00, 0.60, 0.45, 1.0),
    (0.80, 0.47, 0.65, 1.0),
)


@dataclass
class PointLoad:
    """Exudyn's items of one concentrated load.

    Attributes
    ----------
    mbs : exudyn.MainSystem
    lForce, lTorque
        Load numbers.
    frame : "world" or "section"
    """

    mbs: exu.MainSystem
    lForce: Any
    lTorque: Any
    frame: Frame

    def set(self, force: Sequence[float] | Array, moment: Sequence[float] | Array = (0.0, 0.0, 0.0)) -> None:
        """Set force [N] and moment [N m], each of shape (3,), in the load's frame."""
        turn = BEAM_TO_SECTION.T if self.frame == "section" else np.eye(3)
        self.mbs.SetLoadParameter(self.lForce, "loadVector", turn @ np.asarray(force, dtype=float))
        self.mbs.SetLoadParameter(self.lTorque, "loadVector", turn @ np.asarray(moment, dtype=float))


@dataclass
class TDCR:
    """A robot in a scene: the items that were made, and what one can set and read.

    Attributes
    ----------
    mbs : exudyn.MainSystem
    name : str
    robot : Robot
        The description it was made from.
    model : Model
    mesh : BackboneMesh
    nNodes : list
        Backbone nodes, base first, tip last.
    oBeams : list
        Beam elements.
    bDisks : list
        Bodies of the disks.
    mNodes : dict
        Rigid markers on backbone nodes, by node, made when first asked for.
    mHoles : list of list
        By tendon, markers of its holes, base plate first.
    oTendons : list of list
        By tendon, the connector of every segment. Classical tendons carry no force here; they are drawn.
    oBaseJoint
        The joint that holds the base.
    lGravity : list
        Loads of gravity.
    loads : dict of str to PointLoad
        Concentrated loads by name.
    sensors : dict of str
        Sensors made by `add_sensors`.
    rigid : ndarray of bool, shape (N-1,)
        Which elements are rigid inserts.
    actuation : TendonActuation
        The numerics behind it.
    """

    mbs: exu.MainSystem
    name: str
    robot: Robot
    model: Model
    mesh: BackboneMesh
    nNodes: list[Any]
    oBeams: list[Any]
    bDisks: list[Any]
    mHoles: list[list[Any]]
    oTendons: list[list[Any]]
    oBaseJoint: Any
    mBase: Any
    lGravity: list[Any]
    actuation: TendonActuation
    mNodes: dict[int, Any] = field(default_factory=dict)
    loads: dict[str, PointLoad] = field(default_factory=dict)
    sensors: dict[str, Any] = field(default_factory=dict)
    rigid: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    _compliance: float = 1.0

    # ------------------------------------------------------------------ before Assemble

    def marker_at(self, s: float) -> Any:
        """Rigid marker on the backbone node at an arc length [m], its axes those of the section.

        Raises
        ------
        KeyError
            There is no node; name the place in ``loadPositions`` of `CreateTDCR`.
        """
        k = self.mesh.node_at(s, 1e-6)
        if k not in self.mNodes:
            self.mNodes[k] = self.mbs.AddMarker(
                eii.MarkerNodeRigid(
                    name=f"{self.name}.mSection{k}",
                    nodeNumber=self.nNodes[k],
                    localHT=exu.HT(rotation=BEAM_TO_SECTION.T, translation=[0.0, 0.0, 0.0]),
                )
            )
        return self.mNodes[k]

    @property
    def mTip(self) -> Any:
        """Rigid marker at the tip, its axes those of the section."""
        return self.marker_at(float(self.mesh.arc_lengths[-1]))

    def add_load(self, name: str, at: float, frame: Frame = "world") -> PointLoad:
        """Add a concentrated load, zero at first, before ``mbs.Assemble()``.

        Parameters
        ----------
        name
            Of the load.
        at
            Arc length [m]; a node must be there (see ``loadPositions`` of `CreateTDCR`).
        frame
            "world", or "section" for a load that follows the section.
        """
        if name in self.loads:
            raise ValueError(f"robot {self.name!r} has a load {name!r} already")
        node = self.nNodes[self.mesh.node_at(at, 1e-6)]
        marker = self.mbs.AddMarker(eii.MarkerNodeRigid(name=f"{self.name}.mLoad.{name}", nodeNumber=node))
        fixed = frame == "section"
        force = self.mbs.AddLoad(
            eii.Force(
                name=f"{self.name}.force.{name}",
                markerNumber=marker,
                loadVector=[0.0, 0.0, 0.0],
                bodyFixed=fixed,
            )
        )
        torque = self.mbs.AddLoad(
            eii.Torque(
                name=f"{self.name}.torque.{name}",
                markerNumber=marker,
                loadVector=[0.0, 0.0, 0.0],
                bodyFixed=fixed,
            )
        )
        self.loads[name] = PointLoad(self.mbs, force, torque, frame)
        return self.loads[name]

    def add_sensors(self, fileName: str = "", storeInternal: bool = True) -> dict[str, Any]:
        """Add sensors for ``mbs.PlotSensor`` and ``mbs.SolutionViewer``, before ``mbs.Assemble()``.

        Parameters
        ----------
        fileName
            Prefix of sensor files; empty writes none.
        storeInternal
            Keep the values in memory.

        Returns
        -------
        dict
            ``tip_position``, ``tip_rotation`` (rotation matrix of the node, beam axes), and for every tendon
            ``tension_NAME`` (first segment) and ``anchor_tension_NAME`` (last segment).
        """

        def file(key: str) -> str:
            return f"{fileName}_{key}.txt" if fileName else ""

        out = exu.OutputVariableType
        made = {}
        for key, variable in (("tip_position", out.Position), ("tip_rotation", out.RotationMatrix)):
            made[key] = self.mbs.AddSensor(
                eii.SensorNode(
                    name=f"{self.name}.{key}",
                    nodeNumber=self.nNodes[-1],
                    outputVariableType=variable,
                    storeInternal=storeInternal,
                    fileName=file(key),
                    writeToFile=bool(fileName),
                )
            )
        for tendon, connectors in zip(self.robot.tendons, self.oTendons, strict=True):
            for key, connector in (
                (f"tension_{tendon.name}", connectors[0]),
                (f"anchor_tension_{tendon.name}", connectors[-1]),
            ):
                made[key] = self.mbs.AddSensor(
                    eii.SensorObject(
                        name=f"{self.name}.{key}",
                        objectNumber=connector,
                        outputVariableType=out.ForceLocal,
                        storeInternal=storeInternal,
                        fileName=file(key),
                        writeToFile=bool(fileName),
                    )
                )
        self.sensors.update(made)
        return made

    # ------------------------------------------------------------------ actuation

    def set_tensions(self, tensions: Mapping[str, float] | Sequence[float]) -> None:
        """Drive tendons by tension at the base [N]; tendons that are not named keep what drives them."""
        self._set_inputs(tensions, False)

    def set_displacements(self, displacements: Mapping[str, float] | Sequence[float]) -> None:
        """Drive tendons by displacement: pulled in at the base since the unloaded, just taut state [m]."""
        self._set_inputs(displacements, True)

    def set_inputs_over_time(self, inputs: Callable[[float], Sequence[float]]) -> None:
        """Let the inputs follow time, for ``mbs.SolveStatic`` and ``mbs.SolveDynamic``.

        Parameters
        ----------
        inputs
            Takes the time of the solver [s] (0 to 1 over the load steps of ``SolveStatic``), gives tension [N]
            or displacement [m] of every tendon in order, shape (n_tendons,). What drives each tendon is what
            `set_tensions` and `set_displacements` said last.
        """
        self.actuation.inputs = lambda t: np.asarray(inputs(t), dtype=float)

    def _set_inputs(self, given: Mapping[str, float] | Sequence[float], by_displacement: bool) -> None:
        names = self.robot.tendon_names
        if not isinstance(given, Mapping):
            if len(given) != len(names):
                raise ValueError(f"{len(given)} values for {len(names)} tendons ({', '.join(names)})")
            given = dict(zip(names, (float(x) for x in given), strict=True))
        unknown = sorted(set(given) - set(names))
        if unknown:
            raise ValueError(f"no tendon {unknown[0]!r}; the robot has {', '.join(names) or 'none'}")
        values = np.zeros(len(names)) if callable(self.actuation.inputs) else self.actuation.inputs.copy()
        mode = self.actuation.by_displacement.copy()
        for name, value in given.items():
            if not np.isfinite(value) or (value < 0.0 and not by_displacement):
                raise ValueError(f"tendon {name!r}: {value} is not allowed; must be finite, a tension >= 0")
            values[names.index(name)] = value
            mode[names.index(name)] = by_displacement
        self.actuation.inputs, self.actuation.by_displacement = values, mode

    def set_compliance_factor(self, factor: float) -> None:
        """Make the backbone softer in bending and torsion by a factor on its compliance [1].

        Rigid inserts stay as they are.
        """
        if not factor > 0.0:
            raise ValueError(f"compliance factor {factor}; must be positive")
        if factor == self._compliance:
            return
        self._compliance = factor
        softer = self.mesh.stiffness.copy()
        # What the shear holds of the bending grows along.
        add_residual_flexibility(softer, self.mesh.lengths, factor - 1.0)
        softer[:, 3:] /= factor
        for beam, stiffness, rigid in zip(self.oBeams, softer, self.rigid, strict=True):
            if not rigid:
                section = self.mbs.GetObjectParameter(beam, "sectionData")
                section.stiffnessMatrix = np.diag(stiffness)
                self.mbs.SetObjectParameter(beam, "sectionData", section)
        section_forces = self.actuation.section
        if section_forces is not None and section_forces.superelastic is not None:
            soft = replace(
                section_forces.superelastic,
                bending_stiffness=np.where(self.rigid, 0.0, self.mesh.stiffness[:, 5] / factor),
            )
            self.actuation.section = replace(section_forces, superelastic=soft)

    def reset(self) -> None:
        """Forget the history of all holes, as for a robot that was never loaded."""
        self.actuation.reset()

    # ------------------------------------------------------------------ reading

    @property
    def arc_lengths(self) -> Array:
        """Of the backbone nodes [m], shape (N,)."""
        return self.mesh.arc_lengths

    def shape(self) -> tuple[Array, Array]:
        """World positions [m] (N, 3) and section rotations (N, 3, 3) of all nodes; the third column is the tangent."""
        self._need_assembly()
        p, r, _ = self.actuation.scene_poses()
        return p, r @ BEAM_TO_SECTION.T

    def position_at(self, s: float | Array) -> Array:
        """World position at any arc length [m], shape (..., 3)."""
        p, r = self.shape()
        return interpolate_positions(self.arc_lengths, p, r, np.asarray(s, dtype=float))

    @property
    def tip_position(self) -> Array:
        """World position of the tip [m], shape (3,)."""
        return self.shape()[0][-1]

    @property
    def tip_rotation(self) -> Array:
        """Rotation of the tip section, shape (3, 3); the third column is the tangent."""
        return self.shape()[1][-1]

    def tensions(self) -> dict[str, Array]:
        """By tendon, tension of every segment from base plate to anchor [N]."""
        field_ = self._field()
        return {t.name: self._segments(i, field_.tension[i]) for i, t in enumerate(self.robot.tendons)}

    def displacements(self) -> dict[str, float]:
        """By tendon, what is pulled in at the base since the unloaded, just taut state [m].

        Of a tendon driven by displacement what was imposed, whether it is taut or slack.
        """
        self._field()
        return dict(zip(self.robot.tendon_names, self.actuation.displacements.tolist(), strict=True))

    def hole_states(self) -> dict[str, tuple[str, ...]]:
        """By tendon, state of the hole at the distal end of every segment: stick, pull, release, anchor."""
        if self.actuation.geometry is None:  # the classical model has one segment; no hole holds back
            holes = np.zeros((len(self.robot.tendons), len(self.robot.disks.positions)))
        else:
            holes = self.actuation.law.at_holes(self._field().mobilisation)
        return {t.name: hole_states(holes[i], self._count(i)) for i, t in enumerate(self.robot.tendons)}

    def _need_assembly(self) -> None:
        if not self.mbs.systemIsConsistent:
            raise ValueError(f"robot {self.name!r} cannot be read yet; call mbs.Assemble() first")

    def _field(self) -> TensionField:
        """Tensions as last solved; before any solver has run, those of an unloaded robot."""
        if not hasattr(self.actuation, "field"):
            self._need_assembly()
            positions, rotations, _ = self.actuation.scene_poses()
            self.actuation.update(positions, rotations, np.zeros(self.actuation.count))
        return self.actuation.field

    def _count(self, i: int) -> int:
        return len(self.robot.hole_arc_lengths(self.robot.tendons[i])) - 1

    def _segments(self, i: int, values: Array) -> Array:
        if self.actuation.geometry is None:
            return np.full(self._count(i), values[0])
        return values[: self._count(i)].copy()


def build_mesh(
    robot: Robot, model: Model, extra: Iterable[float] = ()
) -> tuple[BackboneMesh, NDArray[np.bool_]]:
    """Mesh of a robot's backbone, and which elements are rigid inserts.

    Parameters
    ----------
    robot, model
        Description and number of elements per bay.
    extra
        Further arc lengths where a node is wanted [m].
    """
    b, d = robot.backbone, robot.disks
    edges = [x for p in b.patches for x in (p.start, p.end) if 0.0 < x < b.length]
    arc, rigid = subdivide(b.length, d.positions, model.elements_per_bay, d.thickness, [*extra, *edges])
    middle = 0.5 * (arc[1:] + arc[:-1])
    bending, torsion = b.stiffness_factors(middle)
    one = np.ones_like(middle)
    stiffness = np.stack(
        (b.EA * one, b.GA * one, b.GA * one, b.GJ * torsion, b.EI * bending, b.EI * bending), axis=1
    )
    stiffness[rigid] *= INSERT_FACTORS
    add_residual_flexibility(stiffness, np.diff(arc))
    second_moment = np.pi * b.radius**4 / 4.0
    rotary = b.density * second_moment * np.array([2.0, 1.0, 1.0])
    precurvature = BEAM_TO_SECTION.T @ np.array([*b.precurvature, 0.0])
    return BackboneMesh(arc, stiffness, b.mass_per_length, rotary, precurvature), rigid


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
    if model.friction not in FRICTION_LAWS:
        raise ValueError(f"friction {model.friction!r}; must be one of {', '.join(FRICTION_LAWS)}")
    if model.elements_per_bay < 1:
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
    tendon_section = _continuous(robot, mesh) if continuous and m else None
    softening = _superelastic(robot, mesh, rigid)
    section = None
    if tendon_section is not None or softening is not None:
        section = SectionForces(mesh.lengths, tendon_section, softening)
    clearance = np.array([t.clearance for t in robot.tendons])
    geometry = None if continuous else CableGeometry(where, offsets, mask, len(hole_nodes), clearance)
    if geometry is not None:
        geometry.settle(positions[hole_nodes], rotations[hole_nodes])
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
    law = TendonLaw(parameters, FRICTION_LAWS[model.friction], presliding)
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


def _continuous(robot: Robot, mesh: BackboneMesh) -> ContinuousTendons:
    """Tendons that follow the backbone, at the integration points of every element."""
    s = gauss_arc_lengths(mesh.arc_lengths)
    offset = np.zeros((len(robot.tendons), *s.shape, 3))
    slope = np.zeros_like(offset)
    weight = np.zeros((len(robot.tendons), len(s)))
    middle = 0.5 * (mesh.arc_lengths[1:] + mesh.arc_lengths[:-1])
    for i, tendon in enumerate(robot.tendons):
        end = robot.end(tendon)
        along = np.minimum(s, end)
        offset[i, ..., 1:] = tendon.routing.position(along.ravel(), end).reshape(*s.shape, 2)
        slope[i, ..., 1:] = tendon.routing.position(along.ravel(), end, 1).reshape(*s.shape, 2)
        weight[i] = middle < end
    return ContinuousTendons(offset, slope, weight)


def _superelastic(robot: Robot, mesh: BackboneMesh, rigid: NDArray[np.bool_]) -> SuperelasticSection | None:
    law = robot.backbone.superelastic
    if law is None:
        return None
    return SuperelasticSection(
        np.where(rigid, 0.0, mesh.stiffness[:, 5]),
        law.threshold_strain / robot.backbone.radius,
        law.plateau_ratio,
        mesh.precurvature,
    )


def bind(method: str, function: Callable[..., Any]) -> None:
    """Make a function that takes ``mbs`` first a method of ``exudyn.MainSystem``."""
    try:
        from exudyn.misc import extensionRegistry
    except ImportError:
        # The registry is not public; without it the plain function is bound just the same.
        setattr(exu.MainSystem, method, function)
        return
    if getattr(exu.MainSystem, method, None) is not function:
        extensionRegistry.extends(exu.MainSystem, method)(function)
        extensionRegistry.install()


bind("CreateTDCR", CreateTDCR)
