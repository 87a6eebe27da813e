"""The handle of a robot in a scene: its items, and methods that add loads, motors, sensors and contact."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import exudyn as exu
import exudyn.itemInterface as eii

from tdcr_fe.elements.native.hooks import round_off
from tdcr_fe.elements.native.scene_forces import Motor
from tdcr_fe.model.loading import Model
from tdcr_fe.model.schema import Keys, Quantity, check_arguments
from tdcr_fe.scene import contact
from tdcr_fe.scene.assembled_robot import AssembledRobot
from tdcr_fe.scene.contact import DiskContact, Sphere
from tdcr_fe.scene.energy import EnergySums, Masses
from tdcr_fe.scene.loads import Frame, PointLoad, add_point_load
from tdcr_fe.scene.parts import section_marker
from tdcr_fe.scene.sensors import SensorMaker

#: Up to this number of coordinates of a scene the linear equations are solved densely.
DENSE = 200
_POSITIVE = Annotated[float, Quantity(gt=0.0)]
_MOTOR, _TIMES = (Keys(dict.fromkeys(x.split(), _POSITIVE)) for x in ("inertia radius", "end_time step_size"))


@dataclass(kw_only=True, eq=False, repr=False)
class TDCR(AssembledRobot):
    """A robot in a scene: its Exudyn items, methods that add to them, and those that set and read its state.

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
        By the material of the backbone.
    """

    model: Model
    nNodes: list[Any]
    bDisks: list[Any]
    mHoles: list[list[Any]]
    oTendons: list[list[Any]]
    oBaseJoint: Any
    mBase: Any
    lGravity: list[Any]
    mNodes: dict[int, Any] = field(default_factory=dict)
    loads: dict[str, PointLoad] = field(default_factory=dict)
    sensors: dict[str, Any] = field(default_factory=dict)
    contacts: list[DiskContact] = field(default_factory=list)
    _spheres: dict[bool, list[Sphere]] = field(default_factory=dict)

    def __repr__(self) -> str:
        """What it is, and where its items are."""
        nodes = f"nodes {self.nNodes[0]} to {self.nNodes[-1]}"
        return f"<TDCR {self.name!r}: {len(self.bDisks)} disks, tendons {', '.join(self.robot.tendon_names)}; {nodes}>"

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
        self._need_robot()
        node = self.nNodes[self.mesh.node_at(at, 1e-6)]
        self.loads[name] = add_point_load(self.actuation.system, node, self.name, name, frame)
        self.actuation.add_load(self.loads[name])
        return self.loads[name]

    def add_motor(self, tendon: str, inertia: float, radius: float) -> Any:
        """Let a motor with inertia wind a tendon, before ``mbs.Assemble()``; for ``mbs.SolveDynamic``.

        The motor is a node with one coordinate, its angle, and a mass of Exudyn's: loads, springs and dampers at a
        coordinate marker of the node drive it. Its angle times the radius is added to the displacement of the tendon as
        set, and the tension times the radius is the torque of the tendon. An inextensible tendon has a stiffness EA of
        2e6 EI / L^2, as all that are driven by displacement in Exudyn's solvers. ``mbs.SolveTDCR`` refuses scenes with
        motors.

        Parameters
        ----------
        tendon
            Name of the tendon.
        inertia
            Inertia of motor and drum [kg m^2].
        radius
            Radius of the drum [m]; a positive angle pulls the tendon in.

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
        check_arguments("add_motor", _MOTOR, locals())
        if self.mbs.systemIsConsistent:
            raise ValueError(f"robot {self.name!r}: add_motor must be called before mbs.Assemble()")
        node = self.mbs.AddNode(eii.Node1D(name=f"{self.name}.{tendon}.motor", referenceCoordinates=[0.0]))
        self.mbs.AddObject(eii.Mass1D(nodeNumber=node, mass=inertia, visualization=eii.VMass1D(show=False)))
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
        maker, variable = SensorMaker(self.mbs, self.name, fileName, storeInternal), exu.OutputVariableType
        made = maker.of_node("tip_position", self.nNodes[-1], variable.Position)
        made |= maker.of_node("tip_rotation", self.nNodes[-1], variable.RotationMatrix)
        for k, s in enumerate(self.robot.disks.positions, 1):
            made |= maker.of_node(f"disk_position_{k}", self.nNodes[self.mesh.node_at(s)], variable.Position)
        history = self.actuation.history_nodes
        for i, (tendon, node) in enumerate(zip(self.robot.tendons, history.nodes, strict=True)):
            segments = 1 if self.actuation.model.geometry is None else self._count(i)
            made |= maker.of_tendon(tendon.name, node, history.sensed(segments))
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
            For an obstacle that is a sphere: its radius, and its centre on its body [m].
        quadPoints
            For an obstacle that is a flat quadrangle: its corners in order, on the body [m], shape (4, 3).
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
        check_arguments("add_disk_contact", contact.OBSTACLE, locals())
        law = contact.ContactLaw(contactStiffness, contactDamping, dynamicFriction, frictionProportionalZone)
        made, own = DiskContact(self.mbs, [], [], [], law), self._contact_spheres(backbone)
        if isinstance(other, TDCR):
            if other.mbs is not self.mbs or sphereRadius is not None or quadPoints is not None:
                raise ValueError(
                    "add_disk_contact: another robot is one of the same system, without sphereRadius and quadPoints"
                )
            theirs = other._contact_spheres(backbone)
            for these, those in ((own, theirs), (theirs, own)):
                largest = max(those, key=lambda sphere: sphere.radius)
                contact.check_spacing(these, largest.radius, largest.name)
            pairs = contact.pairs_within(own) if other is self else itertools.product(own, theirs)
            made.add_spheres(list(pairs), show)
        else:
            contact.check_obstacle(other, sphereRadius, quadPoints, localPosition)
            if sphereRadius is None:
                made.add_quad(own, other, contact.check_quad(quadPoints), show)
            else:
                obstacle = contact.obstacle_sphere(self.mbs, other, localPosition, sphereRadius)
                contact.check_spacing(own, sphereRadius, obstacle.name)
                made.add_spheres([(sphere, obstacle) for sphere in own], show)
        self.contacts.append(made)
        return made

    def _contact_spheres(self, backbone: bool) -> list[Sphere]:
        """Spheres in contact, added when first used."""
        if backbone not in self._spheres:
            self._spheres[backbone] = contact.spheres_of(self, self.nNodes, backbone)
        return self._spheres[backbone]

    def add_energy_sensor(self, fileName: str = "", storeInternal: bool = True) -> Any:
        """Add a sensor of the robot's energy in Exudyn's own solvers, before ``mbs.Assemble()``; return its number.

        Its columns, all in J and listed in `tdcr_fe.scene.energy.ENERGY_COLUMNS`, are the kinetic, elastic and
        gravitational energy; then sums over the steps: work of the tendons at the base plate, work of the loads of
        `add_load`, dissipation by friction and by the material. Elastic energy includes elastic tendons and springs to
        ground. Works less dissipations less what the stored energy has grown went to other items of the scene, or is
        the error of the integration in time (``spectralRadius`` below 1 damps): where no other item takes energy and
        this is not small beside the works, take smaller steps. ``mbs.SolveStatic`` ramps loads and weight, and the work
        of loads is that of the ramp.

        Parameters
        ----------
        fileName
            Prefix of the sensor file; empty writes none.
        storeInternal
            Keep the values in memory.
        """
        self._need_robot()
        masses = Masses.of(self.robot, self.mesh, self.model.gravity)
        sums = EnergySums(self.actuation, masses, self.damping, self.loads)
        self.actuation.add_observer(sums.observe, sums.node)
        maker = SensorMaker(self.mbs, self.name, fileName, storeInternal)
        self.sensors |= maker.of_function("energy", sums.measure)
        return self.sensors["energy"]

    # ------------------------------------------------------------------ after Assemble

    def recommended_settings(self, end_time: float, step_size: float) -> exu.SimulationSettings:
        """Settings for ``mbs.SolveDynamic`` and ``mbs.SolveStatic``, tolerances above the stiffest element's round-off.

        Exudyn's defaults ask for a residual below round-off: the axial stiffness of a thin backbone turns the last
        digit of a node's position into a force, all the more so inside thick disks. Everything else in the settings is
        yours to change: output, damping (``spectralRadius``), modified Newton. ``mbs.SolveStatic`` ramps loads over as
        many load steps as ``mbs.SolveDynamic`` takes, in the same time; 50 are enough for most robots.

        Parameters
        ----------
        end_time, step_size
            [s].

        Raises
        ------
        ValueError
            A time that is not positive and finite, or a step longer than the whole.
        """
        check_arguments("recommended_settings", _TIMES, locals())
        if step_size > end_time:
            raise ValueError(
                f"recommended_settings: step_size = {step_size} s; longer than {end_time} s, the whole"
            )
        settings = exu.SimulationSettings()
        integration = settings.timeIntegration
        integration.endTime = end_time
        integration.numberOfSteps = round(end_time / step_size)
        # After a sudden change the bending between the disks rings with a period shorter than the steps; without
        # numerical damping it goes on for long, and Newton's method then converges in very short steps only. Slow
        # motion is not damped: a vibration of a hundred steps a period loses 3e-5 of its amplitude in each.
        integration.generalizedAlpha.spectralRadius = 0.5
        integration.newton.relativeTolerance = 1e-6
        # Otherwise a first iteration that diverges sets the scale, and what follows counts as converged.
        integration.newton.adaptInitialResidual = False
        # A Jacobian left over from another step size, or from an iteration that diverged, costs more than a new one.
        integration.newton.modifiedNewtonJacUpdatePerStep = True
        # After a sudden change the step grows again as soon as two in a row have converged.
        integration.adaptiveStepRecoverySteps, integration.adaptiveStepRecoveryIterations = 2, 12
        integration.newton.absoluteTolerance = max(1e-8, round_off(self.mesh))
        statics = settings.staticSolver
        statics.numberOfLoadSteps, statics.loadStepDuration = round(end_time / step_size), end_time
        statics.newton.relativeTolerance = integration.newton.relativeTolerance
        statics.newton.absoluteTolerance = integration.newton.absoluteTolerance
        # Holes that change between stick and slip take more iterations than Exudyn's default permits.
        statics.newton.maxIterations = 50
        # Friction couples nearly all coordinates of a robot; for one robot a dense factorisation is the fastest.
        data, solvers = self.mbs.systemData, exu.LinearSolverType
        count = data.ODE2Size() if self.mbs.systemIsConsistent else 7 * len(self.nNodes)
        settings.linearSolver.solverType = solvers.EigenDense if count <= DENSE else solvers.EigenSparse
        return settings

    def reset(self) -> None:
        """Reset the friction history of all holes to that of a robot that was never loaded."""
        self.actuation.history_nodes.reset()
