"""The handle of a robot in a scene: its items, and methods that set and read its state."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.actuation import TendonActuation
from tdcr_fe.elements.backbone import BEAM_TO_SECTION, BackboneMesh
from tdcr_fe.elements.friction import hole_states
from tdcr_fe.elements.hooks import SceneHooks
from tdcr_fe.elements.material_damping import MaterialDamping
from tdcr_fe.elements.motors import Motor
from tdcr_fe.elements.tension_field import TensionField
from tdcr_fe.model.interpolation import interpolate_positions
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.scene.disk_contact import (
    ContactLaw,
    DiskContact,
    Sphere,
    add_contact,
    add_robot_contact,
    spheres_of,
)
from tdcr_fe.scene.dynamics import recommended_settings
from tdcr_fe.scene.energy import EnergyBalance, energy_sensor
from tdcr_fe.scene.inputs import InputsOverTime, named_inputs
from tdcr_fe.scene.loads import Frame, PointLoad, add_point_load
from tdcr_fe.scene.mesh import softened_stiffness
from tdcr_fe.scene.parts import section_marker
from tdcr_fe.scene.sensors import add_disk_sensors, add_tendon_sensors, add_tip_sensors, sensor_output

Array = NDArray[np.float64]


@dataclass
class TDCR:
    """A robot in a scene: its Exudyn items, and methods that set and read its state.

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
        Rigid markers on backbone nodes by node, added when first used.
    mHoles : list of list
        By tendon, markers of its holes, base plate first.
    oTendons : list of list
        By tendon, the connector of every segment, which is drawn and carries no force: `oForces` does.
    oBaseJoint
        The joint of the base plate to its support.
    mBase
        Rigid marker on the base node.
    lGravity : list
        Gravity loads, one for each body with mass.
    loads : dict of str to PointLoad
        Concentrated loads by name.
    sensors : dict of str
        Sensors added by `add_sensors`.
    contacts : list of DiskContact
        Contact added by `add_disk_contact`.
    rigid : ndarray of bool, shape (N-1,)
        Which elements are rigid inserts.
    actuation : TendonActuation
        Tendons, friction and section forces.
    damping : MaterialDamping or None
        By the material of the backbone; its ``item`` is the object that applies it.
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
    contacts: list[DiskContact] = field(default_factory=list)
    rigid: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    damping: MaterialDamping | None = None
    _compliance: float = 1.0
    _spheres: dict[bool, list[Sphere]] = field(default_factory=dict)

    @property
    def oForces(self) -> Any:
        """The object that applies the forces of tendons and inside the sections."""
        return self.actuation.connectors.forces

    @property
    def nHistory(self) -> list[Any]:
        """By tendon, the data node of its history."""
        return self.actuation.history_nodes.nodes

    # ------------------------------------------------------------------ before Assemble

    def marker_at(self, s: float) -> Any:
        """Rigid marker on the backbone node at an arc length [m], its axes those of the section.

        Raises
        ------
        KeyError
            There is no node; give the arc length in ``loadPositions`` of `CreateTDCR`.
        """
        k = self.mesh.node_at(s, 1e-6)
        if k not in self.mNodes:
            self.mNodes[k] = section_marker(self.mbs, self.nNodes[k], f"{self.name}.mSection{k}")
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
            Name of the load.
        at
            Arc length [m]; a node must be there (see ``loadPositions`` of `CreateTDCR`).
        frame
            "world", or "section" for a load that follows the section.
        """
        if name in self.loads:
            raise ValueError(f"robot {self.name!r} has a load {name!r} already")
        node = self.nNodes[self.mesh.node_at(at, 1e-6)]
        self.loads[name] = add_point_load(self.actuation.system, node, self.name, name, frame)
        SceneHooks.of(self.mbs).robot(self.actuation).add_load(self.loads[name])
        return self.loads[name]

    def add_motor(self, tendon: str, inertia: float, radius: float) -> Any:
        """Let a motor with inertia wind a tendon, before ``mbs.Assemble()``; for ``mbs.SolveDynamic``.

        The motor is a node with one coordinate, its angle, and a mass of Exudyn's: loads, springs and dampers at a
        coordinate marker of the node drive it. Its angle times the radius is added to the displacement of the tendon as
        set, and the tension times the radius is the torque of the tendon. An inextensible tendon has a stiffness EA of
        1e5 N, as all that are driven by displacement in Exudyn's solvers. ``mbs.SolveTDCR`` refuses scenes with motors.

        Parameters
        ----------
        tendon
            Name of the tendon.
        inertia
            Of motor and drum [kg m^2].
        radius
            Of the drum [m]; a positive angle pulls the tendon in.

        Returns
        -------
        NodeIndex
            Node of the angle [rad].

        Raises
        ------
        ValueError
            There is no such tendon, it has a motor already, the scene is assembled, or a value is not positive.
        """
        names = self.robot.tendon_names
        if tendon not in names:
            raise ValueError(f"robot {self.name!r} has no tendon {tendon!r}; it has {', '.join(names)}")
        number = names.index(tendon)
        if any(motor.tendon == number for motor in self.actuation.motors):
            raise ValueError(f"robot {self.name!r}: tendon {tendon!r} has a motor already")
        for key, value in {"inertia": inertia, "radius": radius}.items():
            if not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"add_motor: {key} = {value}; must be positive and finite")
        if self.mbs.systemIsConsistent:
            raise ValueError(f"robot {self.name!r}: add_motor must be called before mbs.Assemble()")
        node = self.mbs.AddNode(eii.Node1D(name=f"{self.name}.{tendon}.motor", referenceCoordinates=[0.0]))
        show = eii.VObjectMass1D(show=False)
        self.mbs.AddObject(eii.Mass1D(nodeNumber=node, mass=inertia, visualization=show))
        self.actuation.add_motor(Motor(number, node, radius))
        return node

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
            ``tip_position``, ``tip_rotation`` (rotation matrix of the node, beam axes), ``disk_position_1`` and so on
            from the base to the tip [m], and of every tendon in the last solved step ``tension_NAME`` (first segment)
            and ``anchor_tension_NAME`` (last segment) [N], ``tensions_NAME`` (all segments) [N],
            ``displacement_NAME`` (length pulled in at the base) [m], and with friction ``mobilisation_NAME`` (part of
            the friction that acts at every hole but the anchor, in [-1, 1]) and ``slip_NAME`` (tendon that has passed
            each of these holes towards the base since the unloaded state) [m].
        """
        made = add_tip_sensors(self.mbs, self.nNodes[-1], self.name, fileName, storeInternal)
        disks = [self.nNodes[self.mesh.node_at(s)] for s in self.robot.disks.positions]
        made |= add_disk_sensors(self.mbs, disks, self.name, fileName, storeInternal)
        history = self.actuation.history_nodes
        for i, (tendon, node) in enumerate(zip(self.robot.tendons, history.nodes, strict=True)):
            segments = 1 if self.actuation.geometry is None else self._count(i)
            quantities = history.sensed(segments)
            made |= add_tendon_sensors(
                self.mbs, node, quantities, self.name, tendon.name, fileName, storeInternal
            )
        self.sensors.update(made)
        return made

    def add_disk_contact(
        self,
        other: TDCR | exu.ObjectIndex | exu.MarkerIndex,
        contactStiffness: float,
        *,
        sphereRadius: float | None = None,
        quadPoints: Sequence[Sequence[float]] | None = None,
        localPosition: Sequence[float] = (0.0, 0.0, 0.0),
        backbone: bool = True,
        contactDamping: float = 0.0,
        dynamicFriction: float = 0.0,
        frictionProportionalZone: float = 1e-3,
        show: bool = False,
    ) -> DiskContact:
        """Add contact with an obstacle, another robot, or this robot itself, before ``mbs.Assemble()``.

        In contact a disk is a sphere of its radius about its centre, and the backbone is one of its own radius at every
        node between disks. The base plate, and what lies between two nodes, is not in contact.

        Parameters
        ----------
        other
            A body or a rigid marker with a sphere, a body with a quadrangle, another robot, or this robot: then those
            pairs of spheres that are far enough apart along the backbone.
        contactStiffness
            Force over penetration [N/m].
        sphereRadius, localPosition
            Of an obstacle that is a sphere: radius, and centre on its body [m].
        quadPoints
            Of an obstacle that is a flat quadrangle: its corners in order, on the body [m], shape (4, 3).
        backbone
            Whether the backbone between disks is in contact, too; that of a robot without disks always is.
        contactDamping
            [N s/m].
        dynamicFriction, frictionProportionalZone
            Coefficient of friction [1], and velocity up to which friction is proportional to it [m/s]. Friction acts on
            velocities: in dynamics, not in ``mbs.SolveTDCR`` and ``mbs.SolveStatic``.
        show
            Whether contact is drawn.

        Returns
        -------
        DiskContact
            Exudyn's items, and methods that read gaps and forces.

        Raises
        ------
        TypeError
            An argument is of another type.
        ValueError
            Robot and obstacle overlap at first, the obstacle passes between spheres of the robot without touching them,
            or an argument is not allowed.
        """
        if self.mbs.systemIsConsistent:
            raise ValueError(f"robot {self.name!r}: add_disk_contact must be called before mbs.Assemble()")
        law = ContactLaw(contactStiffness, contactDamping, dynamicFriction, frictionProportionalZone)
        own = self._contact_spheres(backbone)
        if isinstance(other, TDCR):
            if other.mbs is not self.mbs or sphereRadius is not None or quadPoints is not None:
                raise ValueError(
                    "add_disk_contact: another robot is one of the same system, without sphereRadius and quadPoints"
                )
            made = add_robot_contact(self.mbs, own, other._contact_spheres(backbone), law, show)
        else:
            made = add_contact(
                self.mbs, own, other, law,
                radius=sphereRadius, quad=quadPoints, position=localPosition, show=show,
            )  # fmt: skip
        self.contacts.append(made)
        return made

    def _contact_spheres(self, backbone: bool) -> list[Sphere]:
        """Spheres in contact, added when first used."""
        if backbone not in self._spheres:
            self._spheres[backbone] = spheres_of(
                self.mbs, self.robot, self.mesh, self.nNodes, backbone, self.name
            )
        return self._spheres[backbone]

    def add_energy_sensor(self, fileName: str = "", storeInternal: bool = True) -> Any:
        """Add a sensor of the robot's energy in Exudyn's own solvers, before ``mbs.Assemble()``; return its number.

        Its columns, all in J and listed in `tdcr_fe.scene.energy.ENERGY_COLUMNS`, are the kinetic, elastic and
        gravitational energy; then sums over the steps: work of the tendons at the base plate, work of the loads of
        `add_load`, dissipation by friction, by the material and by the integration in time; and the balance: works less
        dissipation less what the stored energy has grown. The balance goes to other items of the scene, or is what
        Newton's method has left. The numerical dissipation is damping by ``spectralRadius`` and the error of the time
        step, which may be negative: where it is not small beside the works, take smaller steps. Elastic energy includes
        elastic tendons and springs to ground. ``mbs.SolveStatic`` ramps loads and weight, and the work of loads is that
        of the ramp.

        Parameters
        ----------
        fileName
            Prefix of the sensor file; empty writes none.
        storeInternal
            Keep the values in memory.
        """
        hooks = SceneHooks.of(self.mbs)
        balance = EnergyBalance(
            hooks.system, self.robot, self.name, self.actuation, self.damping, self.model.gravity, self.loads
        )
        hooks.robot(self.actuation).add_observer(balance)
        sensor = energy_sensor(balance, self.name, sensor_output(fileName, "energy", storeInternal))
        self.sensors["energy"] = sensor
        return sensor

    # ------------------------------------------------------------------ actuation

    def set_tensions(self, tensions: Mapping[str, float] | Sequence[float]) -> None:
        """Prescribe tensions at the base [N]; tendons that are not named keep their inputs."""
        self._set_inputs(tensions, False)

    def set_displacements(self, displacements: Mapping[str, float] | Sequence[float]) -> None:
        """Prescribe displacements: length pulled in at the base since the unloaded, just taut state [m]."""
        self._set_inputs(displacements, True)

    def set_inputs_over_time(self, inputs: Callable[[float], Sequence[float]]) -> None:
        """Prescribe the inputs as a function of time, for ``mbs.SolveStatic`` and ``mbs.SolveDynamic``.

        Parameters
        ----------
        inputs
            Function of the solver's time [s] (0 to 1 over the load steps of ``SolveStatic``) that returns tension [N]
            or displacement [m] of every tendon in order, shape (n_tendons,). Whether a value is a tension or a
            displacement was determined by the last `set_tensions` or `set_displacements`. Every value is checked:
            one finite number per tendon, no negative tension. A later `set_tensions` or `set_displacements` ends
            the function; tendons that it does not name keep what they had at the last solved time.
        """
        if not callable(inputs):
            hint = "set_tensions and set_displacements take values."
            raise TypeError(f"set_inputs_over_time needs a function of the time [s], not {inputs!r}. {hint}")
        self.actuation.inputs = InputsOverTime(self.name, self.robot.tendon_names, self.actuation, inputs)

    def _set_inputs(self, given: Mapping[str, float] | Sequence[float], by_displacement: bool) -> None:
        self._need_robot()
        names, actuation = self.robot.tendon_names, self.actuation
        inputs = named_inputs(names, given, by_displacement)
        # Inputs over time end here: the other tendons keep what they had in the last solved state.
        values = actuation.input_values(actuation.state.time).copy()
        mode = actuation.by_displacement.copy()
        for name, value in inputs.items():
            values[names.index(name)] = value
            mode[names.index(name)] = by_displacement
        actuation.inputs, actuation.by_displacement = values, mode

    @property
    def compliance_factor(self) -> float:
        """Factor on the backbone's compliance in bending and torsion [1]."""
        return self._compliance

    def set_compliance_factor(self, factor: float) -> None:
        """Make the backbone softer in bending and torsion by a factor on its compliance [1].

        Rigid inserts stay as they are.
        """
        if not factor > 0.0:
            raise ValueError(f"compliance factor {factor}; must be positive")
        if factor == self._compliance:
            return
        self._compliance = factor
        softer = softened_stiffness(self.mesh, self.rigid, factor)
        for beam, stiffness, rigid in zip(self.oBeams, softer, self.rigid, strict=True):
            if not rigid:
                section = self.mbs.GetObjectParameter(beam, "sectionData")
                section.stiffnessMatrix = np.diag(stiffness)
                self.mbs.SetObjectParameter(beam, "sectionData", section)
        model, section = self.actuation.model, self.actuation.section
        if section is not None and section.superelastic is not None:
            bending = np.where(self.rigid, 0.0, self.mesh.stiffness[:, 5] / factor)
            section = replace(section, superelastic=replace(section.superelastic, bending_stiffness=bending))
        self.actuation.model = replace(model, mesh=replace(self.mesh, stiffness=softer), section=section)

    def recommended_settings(self, end_time: float, step_size: float) -> exu.SimulationSettings:
        """Settings for ``mbs.SolveDynamic`` with tolerances that suit this robot; both times in [s].

        Everything else in them is yours to change: output, damping (``spectralRadius``), modified Newton.
        """
        system = self.mbs
        count = system.systemData.ODE2Size() if system.systemIsConsistent else 7 * len(self.nNodes)
        return recommended_settings(self.mesh, end_time, step_size, count)

    def reset(self) -> None:
        """Reset the friction history of all holes to that of a robot that was never loaded."""
        self.actuation.reset()

    # ------------------------------------------------------------------ reading

    @property
    def arc_lengths(self) -> Array:
        """Arc lengths of the backbone nodes [m], shape (N,)."""
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
        """By tendon, length pulled in at the base since the unloaded, just taut state [m].

        For a tendon driven by displacement the prescribed value, whether it is taut or slack.
        """
        self._field()
        return dict(zip(self.robot.tendon_names, self.actuation.displacements.tolist(), strict=True))

    def hole_states(self) -> dict[str, tuple[str, ...]]:
        """By tendon, state of the hole at the distal end of every segment: stick, pull, release, anchor."""
        if self.actuation.geometry is None:  # the continuous path has one tension and no friction
            holes = np.zeros((len(self.robot.tendons), max(1, len(self.robot.disks.positions))))
        else:
            holes = self.actuation.law.at_holes(self._field().mobilisation)
        return {t.name: hole_states(holes[i], self._count(i)) for i, t in enumerate(self.robot.tendons)}

    def _need_robot(self) -> None:
        """Refuse what is asked of a robot that is not in the system any more."""
        if not SceneHooks.has(self.mbs, self.actuation):
            raise ValueError(
                f"robot {self.name!r} is not in the system any more (removed by mbs.Reset, or deleted); create it again"
            )

    def _need_assembly(self) -> None:
        self._need_robot()
        if not self.mbs.systemIsConsistent:
            raise ValueError(f"robot {self.name!r} cannot be read yet; call mbs.Assemble() first")

    def _field(self) -> TensionField:
        """Tensions in the present state of the scene."""
        self._need_assembly()
        return self.actuation.current_forces().field

    def _count(self, i: int) -> int:
        return len(self.robot.hole_arc_lengths(self.robot.tendons[i])) - 1

    def _segments(self, i: int, values: Array) -> Array:
        if self.actuation.geometry is None:
            return np.full(self._count(i), values[0])
        return values[: self._count(i)].copy()
