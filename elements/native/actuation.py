"""One robot in Exudyn's scene: its actuation, its friction history, and the item that applies its forces.

The forces of tendons and inside the sections act through one object of Exudyn on all nodes of the backbone, with its
own Jacobian, so that every solver of Exudyn sees them; the springs between the holes are drawn and carry no force. The
quasi-static solver evaluates the same `ForceModel` directly. Both commit to the same history.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import exudyn as exu
import numpy as np

from tdcr_fe.elements import Array, Index
from tdcr_fe.elements.backbone import BackboneMesh
from tdcr_fe.elements.drives import DISPLACEMENT, TENSION, TendonDrives
from tdcr_fe.elements.forces import ForceModel, TendonForces
from tdcr_fe.elements.friction import TendonLaw
from tdcr_fe.elements.hysteresis import FrictionState
from tdcr_fe.elements.native.condensation import ElasticTendons, at_rest, forces_by_inputs, stretch
from tdcr_fe.elements.native.coordinates import NodeCoordinates, generalized_forces
from tdcr_fe.elements.native.history import HistoryNodes, RobotHistory
from tdcr_fe.elements.native.items import Clamp, Connectors, SystemReference, item_names
from tdcr_fe.elements.native.iterated import excess_tangent
from tdcr_fe.elements.native.scene_forces import Holes, Motor, SceneForces, wound

#: Tensions [N] and displacements [m] at the base, shape (m,), as set or over time [s].
Inputs = Array | Callable[[float], Array]
#: Largest gap in a base joint with which a run may begin: the tip is thrown about as far as the gap [m, 1].
LARGEST_GAP = 1e-4


@dataclass(eq=False, repr=False)
class TendonActuation:
    """Actuation, friction history and items of one robot in a scene.

    Attributes
    ----------
    drives : TendonDrives
        How every tendon is driven.
    inputs : ndarray, shape (m,), or callable
        Tensions [N] and lengths wound [m] at the base, as set or over time.
    attempt : tuple or None
        Inputs, and the tendons with them, in the step that is under way.
    """

    name: str  # Name of the robot
    system: SystemReference  # That contains the robot
    nodes: list[Any]  # Exudyn's numbers of the backbone nodes, base first
    model: ForceModel  # Computes its forces
    connectors: Connectors  # The items of the robot
    history_nodes: HistoryNodes  # Where its history is kept
    has_mass: bool  # Whether anything of the robot has a mass
    clamp: Clamp | None  # The joint that fixes the base to ground; None where it is free or on another body
    connected: bool = True  # Whether Exudyn's item applies the forces; see `disconnect`
    # How the Jacobian of Exudyn's item takes holes with friction: "present", as they are, so that it is the derivative
    # of the forces (in linearised systems all holes stick); "stuck" or "sliding", as if all of them did
    holes: Holes = "present"
    # Wind tendons, see `add_motor`; their angles follow the coordinates of the nodes in those of Exudyn's item
    motors: tuple[Motor, ...] = ()
    # Names of items that must keep their numbers, see `item_names`
    items: dict[tuple[str, int], str] = field(default_factory=dict)
    # The concentrated loads on it, of `tdcr_fe.scene.loads`
    point_loads: list[Any] = field(default_factory=list)
    # What sees every step of Exudyn's own solvers before the history is committed
    observers: list[Callable[[float], None]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.drives = TendonDrives((TENSION,) * self.law.shape[0], np.ones(self.law.shape[0]))
        self.inputs: Inputs = np.zeros(self.law.shape[0])
        self.node_coordinates = NodeCoordinates(self.system, self.nodes)
        self._scene_forces = SceneForces(self.node_coordinates)
        self.attempt: tuple[Inputs, ElasticTendons] | None = None
        self._force_function: Any = 0

    @property
    def mbs(self) -> exu.MainSystem:
        """The system that contains the robot."""
        return self.system.mbs

    @property
    def mesh(self) -> BackboneMesh:
        """The backbone."""
        return self.model.mesh

    @property
    def law(self) -> TendonLaw:
        """How tension passes along the tendons."""
        return self.model.law

    def add_load(self, load: Any) -> None:
        """Add a concentrated load."""
        self.point_loads.append(load)
        self.items |= item_names(self.mbs, Node=[load.nApplied], Load=load.numbers)

    def add_observer(self, observe: Callable[[float], None], node: Any) -> None:
        """Let a function see the end of every step [s]; in a data node it keeps what it has seen."""
        self.observers.append(observe)
        self.items |= item_names(self.mbs, Node=[node])

    def refuse_apart(self, mbs: exu.MainSystem, t: float) -> None:
        """Refuse a dynamic run that begins at a time [s] with the base elsewhere than what carries it."""
        solver, name = mbs.sys.get("dynamicSolver"), self.name
        start = mbs.systemData.GetTime(exu.ConfigurationType.StartOfStep)
        if start != t or solver is None or solver.it.currentTime != t:
            return
        joint = mbs.GetObjectNumber(f"{name}.baseJoint")
        gap = np.abs(mbs.ComputeItem(joint, exu.ComputeItemType.AlgebraicEquations)).max()
        if gap > LARGEST_GAP and mbs.GetObjectParameter(joint, "activeConnector"):
            raise ValueError(
                f"robot {name!r} does not begin at the marker that carries its base (gap {gap:.3g}): give that body "
                "its pose as reference, not as initial displacement, or call mbs.SolveTDCR first"
            )

    # ------------------------------------------------------------------ configuration

    @property
    def coordinates(self) -> Index:
        """Exudyn's ODE2 coordinate numbers of all nodes, shape (N, 7); needs an assembled system."""
        return self.node_coordinates.numbers

    def forget_coordinates(self) -> None:
        """Read the nodes' coordinate numbers from Exudyn again, after another `Assemble`."""
        self.node_coordinates.forget()
        self._scene_forces.forget()

    def scene_poses(self) -> tuple[Array, Array, Array]:
        """Current positions (N, 3), rotations (N, 3, 3) in beam axes and Euler parameters (N, 4) in the scene."""
        return self.node_coordinates.poses(self.node_coordinates.displacements())

    # ------------------------------------------------------------------ history

    @property
    def history(self) -> RobotHistory:
        """Committed history, as it is in the scene's current configuration."""
        return self.history_nodes.read()

    @property
    def state(self) -> FrictionState:
        """Committed friction history."""
        return self.history.friction

    @property
    def base_tension(self) -> Array:
        """Tension at the base in the last solved state [N], shape (m,)."""
        return self.history.base_tension

    def store(self, friction: FrictionState, prescribed: Array, forces: TendonForces) -> None:
        """Keep the history of a state solved elsewhere, as that of the current and of the initial configuration.

        Parameters
        ----------
        friction
            Its friction history.
        prescribed
            See `RobotHistory.prescribed`.
        forces
            Its forces.
        """
        tension = forces.field.tension
        stretched = stretch(self.model, tension, forces.measured.shape.lengths)
        history = RobotHistory(friction, forces.base_tension, prescribed, stretched)
        self.history_nodes.write(history, tension, forces.field.base_slip, initial=True)

    def friction_without_stretch(self) -> FrictionState:
        """Friction history for a solver in which inextensible tendons do not stretch.

        The slips of tendons that Exudyn's solvers drove by displacement are counted anew from the present
        configuration, in which nothing has slipped since the history was committed.
        """
        history = self.history
        stretched = ~np.isnan(history.prescribed) & self.law.parameters.rigid
        if not np.any(stretched & np.any(history.stretch != 0.0, axis=1)):
            return history.friction
        slip = self.current_forces().field.slip
        return replace(history.friction, slip=np.where(stretched[:, None], slip, history.friction.slip))

    # ------------------------------------------------------------------ forces

    def input_values(self, t: float = 0.0, configuration: Any = exu.ConfigurationType.Current) -> Array:
        """Tensions [N] and displacements [m] at the base, at time t, with what the motors have wound in the scene."""
        return wound(self.motors, self.values_as_set(t), self._angles(configuration))

    def _angles(self, configuration: Any = exu.ConfigurationType.Current) -> Array:
        """Angles of the motors in a configuration of the scene [rad], shape (k,)."""
        data = self.mbs.systemData.GetODE2Coordinates(configuration, copy=False)
        return np.array([data[self.mbs.GetNodeODE2Index(motor.node)] for motor in self.motors])

    def values_as_set(self, t: float) -> Array:
        """Tensions and displacements at the base as they were set."""
        return np.asarray(self.inputs(t) if callable(self.inputs) else self.inputs, dtype=float)

    def add_motor(self, motor: Motor) -> None:
        """Let a motor wind a tendon, before ``mbs.Assemble()``; the tendon is then driven by displacement."""
        self.motors = (*self.motors, motor)
        if not self.drives.winds[motor.tendon]:
            self.drives = self.drives.replaced(motor.tendon, DISPLACEMENT, 1.0)
            if not callable(self.inputs):  # a tension that was set
                self.inputs = np.where(np.arange(self.law.shape[0]) == motor.tendon, 0.0, self.inputs)
        nodes = [int(node) for node in (*self.nodes, *(motor.node for motor in self.motors))]
        self.mbs.SetObjectParameter(self.connectors.forces, "nodeNumbers", nodes)

    def current_forces(self) -> TendonForces:
        """Forces in the scene's current configuration at the tensions and mobilisations of the history."""
        positions, rotations, _ = self.scene_poses()
        return at_rest(self.model, self.model.measure(positions, rotations), self.history)

    @property
    def displacements(self) -> Array:
        """Tendon pulled in at the base [m], shape (m,): zero in the unloaded shape, just taut or with its pretension.

        For a tendon driven by displacement this is the prescribed value, which a slack tendon does not follow.
        """
        prescribed = self.history.prescribed
        return np.where(np.isnan(prescribed), self.current_forces().field.base_slip, prescribed)

    # ------------------------------------------------------------------ Exudyn's own solvers

    def forces_on_coordinates(self, displacements: Sequence[float], t: float) -> Array:
        """Generalised forces of tendons and section on the coordinates of nodes and motors, shape (7 N + k,).

        Parameters
        ----------
        displacements
            Coordinates of the nodes, without reference values, then angles of the motors [rad], shape (7 N + k,).
        t
            Time [s].
        """
        nodes, tendons = self._in_step(displacements, t)
        return self._scene_forces.generalized(nodes, tendons, self.motors)

    def jacobian_on_coordinates(
        self, displacements: Sequence[float], t: float, by_position: float, by_velocity: float
    ) -> exu.MatrixContainer:
        """Jacobian of the left-hand side, minus the forces, by the coordinates of the nodes.

        Parameters
        ----------
        displacements, t
            As in `forces_on_coordinates`.
        by_position, by_velocity
            Factors that Exudyn gives to derivatives by positions and velocities.

        Raises
        ------
        ValueError
            In a dynamic solver, where nothing of the robot has a mass.
        """
        if by_velocity != 0.0 and not self.has_mass:
            raise ValueError(
                f"robot {self.name!r} has no mass, so that its motion is not defined: give its backbone a density, its "
                "disks a mass, or a tip mass; at rest, mbs.SolveTDCR solves it without"
            )
        if not self.connected:
            return _container(np.zeros((7 * len(self.nodes),) * 2))
        nodes, tendons = self._in_step(displacements, t)
        holes: Holes = "present" if self.motors else self.holes
        # Solvers ask with a negative factor, ``mbs.ComputeLinearizedSystem`` and ``mbs.ComputeODE2Eigenvalues`` with a
        # positive one: they want small vibrations, in which no hole slips beyond its presliding.
        if holes == "present" and not self.motors and by_position > 0.0 and by_velocity == 0.0:
            holes = "stuck"
        tangent = self._scene_forces.tangent(nodes, tendons, holes, self.motors)
        # Both factors together are those of an iteration in time; derivatives for linearised systems are exact.
        if by_velocity != 0.0 and by_position != 0.0:
            excess = excess_tangent(self.node_coordinates, self.mesh, nodes)
            if excess is not None:
                tangent[: nodes.size, : nodes.size] -= excess
        tangent *= -by_position
        return _container(tangent)

    def forces_by_inputs(self, stuck: bool) -> Array:
        """Change of the generalised forces on the coordinates of the nodes with the inputs, shape (7 N, m).

        In the scene's current configuration, at the tensions and mobilisations of the history: by tension [N] or by
        displacement [m], as every tendon is driven.

        Parameters
        ----------
        stuck
            Whether every hole with friction sticks; else every one slides on.
        """
        positions, rotations, parameters = self.scene_poses()
        tendons = self.elastic_tendons(self.base_tension, self.state.time)
        forces = at_rest(tendons.elastic, self.model.measure(positions, rotations), tendons.history)
        columns = forces_by_inputs(forces, tendons.driven, stuck)
        found = [generalized_forces(each.reshape(-1, 6), rotations, parameters) for each in columns.T]
        return np.reshape(found, (self.law.shape[0], parameters.size + positions.size)).T

    def _in_step(self, displacements: Sequence[float] | Array, t: float) -> tuple[Array, ElasticTendons]:
        """Coordinates of the nodes, and the tendons with what the motors have wound."""
        moved, tendons, count = np.array(displacements), self._as_set(t), len(self.motors)
        if count:
            values = wound(self.motors, tendons.values, moved[-count:])
            moved, tendons = moved[:-count], replace(tendons, values=values)
        return moved, tendons

    def _as_set(self, t: float) -> ElasticTendons:
        """The tendons with inputs as they were set, the same in all iterates of a step up to a time [s]."""
        inputs, history, last = self.inputs, self.history, self.attempt
        if last is None or last[0] is not inputs or last[1].history is not history or last[1].time != t:
            last = self.attempt = inputs, self.elastic_tendons(self.values_as_set(t), t)
        return last[1]

    def elastic_tendons(self, values: Array, t: float) -> ElasticTendons:
        """The tendons as Exudyn's own solvers take them, with the history of the scene.

        ``values``: inputs of a step [N, m], shape (m,), at its end ``t`` [s].
        """
        return ElasticTendons(self.model, self.drives.winds, self.history, values, t)

    def commit_scene(self, t: float) -> None:
        """Commit the scene's current state, solved at time t [s], to the friction history."""
        moved = np.append(self.node_coordinates.displacements(), self._angles())
        coordinates, tendons = self._in_step(moved, t)
        friction, forces = self._scene_forces.step_end(coordinates, tendons)
        driven, tension = tendons.driven, forces.field.tension
        prescribed = np.where(driven, tendons.values, np.nan)
        stretched = stretch(self.model, tension, forces.measured.shape.lengths)
        stretched = np.where(driven[:, None], tendons.history.stretch, stretched)
        history = RobotHistory(friction, forces.base_tension, prescribed, stretched)
        self.history_nodes.write(history, tension, forces.field.base_slip)
        self._show_shifts(forces)

    def attach(self, force_function: Callable[..., Any], jacobian_function: Callable[..., Any]) -> None:
        """Give Exudyn's item its user functions."""
        self._force_function = force_function
        self.mbs.SetObjectParameter(self.connectors.forces, "forceUserFunction", force_function)
        self.mbs.SetObjectParameter(self.connectors.forces, "jacobianUserFunction", jacobian_function)

    def disconnect(self) -> None:
        """Take the forces off Exudyn's item, for a solver that computes them itself."""
        if self.connected:
            self.connected = False
            self.mbs.SetObjectParameter(self.connectors.forces, "forceUserFunction", 0)

    def connect(self) -> None:
        """Let Exudyn's item apply the forces again."""
        if not self.connected:
            self.connected = True
            self.mbs.SetObjectParameter(self.connectors.forces, "forceUserFunction", self._force_function)
            self._show_shifts(self.current_forces())

    def _show_shifts(self, forces: TendonForces) -> None:
        """Draw the tendons where they lie in their holes, if they can shift there."""
        if self.model.geometry is None or not self.model.geometry.shifts:
            return
        offsets = forces.measured.shape.lines.offsets.swapaxes(0, 1)
        half = 0.5 * float(self.mesh.lengths[0])
        for markers, of_tendon in zip(self.connectors.hole_markers, offsets, strict=True):
            for k, (marker, offset) in enumerate(zip(markers, of_tendon.tolist(), strict=False)):
                # The base plate's holes sit on the first beam, whose origin is its middle.
                x = -half if k == 0 else 0.0
                self.mbs.SetMarkerParameter(marker, "localPosition", [x, offset[1], offset[2]])


def _container(matrix: Array) -> exu.MatrixContainer:
    """A matrix for Exudyn: dense, because friction couples nearly all coordinates of a robot."""
    container = exu.MatrixContainer()
    container.SetWithDenseMatrix(matrix, useDenseMatrix=True)
    return container
