"""One robot in Exudyn's scene: its actuation, its friction history, and the item that applies its forces.

The forces of tendons and inside the sections act through one object of Exudyn on all nodes of the backbone, with its
own Jacobian, so that every solver of Exudyn sees them; the springs between the holes are drawn and carry no force. The
quasi-static solver evaluates the same `ForceModel` directly. Both commit to the same history.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BackboneMesh
from tdcr_fe.elements.condensation import add_condensed
from tdcr_fe.elements.forces import ForceModel, Measurement, TendonForces
from tdcr_fe.elements.friction import FrictionState, TendonLaw
from tdcr_fe.elements.generalized import (
    add_neighbours,
    generalized_forces,
    generalized_tangent,
    twists_by_coordinates,
)
from tdcr_fe.elements.history import HistoryNodes, RobotHistory
from tdcr_fe.elements.poses import rotation_of_euler_parameters
from tdcr_fe.elements.section import SectionForces
from tdcr_fe.elements.system import SystemReference
from tdcr_fe.elements.tendons import CableGeometry

Array = NDArray[np.float64]

Inputs = Array | Callable[[float], Array]
#: What a linearisation assumes of holes with friction.
Holes = Literal["present", "stuck", "sliding"]


@dataclass
class Connectors:
    """Exudyn's numbers of the objects of a robot.

    Attributes
    ----------
    forces : object
        The object that applies the forces of tendons and inside the sections.
    springs : list of list
        By tendon, the spring-damper of every segment, which is only drawn.
    hole_markers : list of list
        By tendon, markers of its holes, base plate first; they are moved where tendons shift inside their holes.
    beams : list
        The beam elements, base first.
    others : list
        All other objects of the robot, none of which resists a motion of the backbone: disks, masses, base joint.
    """

    forces: Any
    springs: list[list[Any]]
    hole_markers: list[list[Any]] = field(default_factory=list)
    beams: list[Any] = field(default_factory=list)
    others: list[Any] = field(default_factory=list)

    @property
    def object_numbers(self) -> list[int]:
        """Numbers of all its objects."""
        springs = [spring for springs in self.springs for spring in springs]
        return [int(i) for i in (self.forces, *self.beams, *springs, *self.others)]


@dataclass(frozen=True)
class Clamp:
    """A base plate fixed to ground by a joint.

    Attributes
    ----------
    joint : object
        Exudyn's number of the joint, which blocks all six motions.
    position, rotation : ndarray
        Pose to which it fixes the base node, the rotation in beam axes; shapes (3,) and (3, 3).
    """

    joint: Any
    position: Array
    rotation: Array


class _Evaluation(NamedTuple):
    """Forces evaluated last in a scene, and for what.

    Attributes
    ----------
    coordinates : ndarray, shape (7 N,)
        Of the nodes, as displacements.
    time : float
        [s].
    history : RobotHistory
    inputs, by_displacement : object
        As set.
    values : ndarray, shape (m,)
        Inputs at that time.
    rotations, parameters : ndarray
        Of the nodes, shapes (N, 3, 3) and (N, 4).
    forces : TendonForces
    """

    coordinates: Array
    time: float
    history: RobotHistory
    inputs: Inputs
    by_displacement: NDArray[np.bool_]
    values: Array
    rotations: Array
    parameters: Array
    forces: TendonForces


class TendonActuation:
    """Actuation, friction history and items of one robot in a scene.

    Parameters
    ----------
    name
        Of the robot.
    system
        The system that contains the robot.
    nodes
        Exudyn's numbers of the backbone nodes, base first.
    model
        Computes its forces.
    connectors
        The items of the robot.
    history
        Where its history is kept.
    has_mass
        Whether anything of the robot has a mass.
    inextensible_stiffness
        EA used for an inextensible tendon whose displacement is prescribed in Exudyn's own solvers, where the
        tension is not an unknown [N].
    clamp
        The joint that fixes the base to ground; None where the base is free or on another body.

    Attributes
    ----------
    by_displacement : ndarray of bool, shape (m,)
        Which tendons have their displacement prescribed; the others their tension.
    inputs : ndarray, shape (m,), or callable
        Tensions [N] and displacements [m] at the base, as set or over time.
    connected : bool
        Whether Exudyn's item applies the forces; see `disconnect`.
    holes : "present", "stuck" or "sliding"
        What the Jacobian of Exudyn's item assumes of holes with friction: the derivative of the forces, or that all
        stick, or that all slide on.
    """

    def __init__(
        self,
        name: str,
        system: SystemReference,
        nodes: Sequence[Any],
        model: ForceModel,
        connectors: Connectors,
        history: HistoryNodes,
        has_mass: bool,
        inextensible_stiffness: float = 1e5,
        clamp: Clamp | None = None,
    ) -> None:
        self.name = name
        self.system = system
        self.nodes = list(nodes)
        self.model = model
        self.connectors = connectors
        self.has_mass = has_mass
        self.inextensible_stiffness = inextensible_stiffness
        self.clamp = clamp
        m = model.law.shape[0]
        self.count = m
        self.by_displacement: NDArray[np.bool_] = np.zeros(m, dtype=bool)
        self.inputs: Inputs = np.zeros(m)
        self.history_nodes = history
        self.connected = True
        self.holes: Holes = "present"
        self._coordinates: NDArray[np.int_] | None = None
        self._reference: Array | None = None
        self._evaluation: _Evaluation | None = None
        self._solved: tuple[Array, RobotHistory, TendonForces] | None = None
        self._no_jacobian = _triplets(np.zeros((7 * len(self.nodes),) * 2))
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
    def geometry(self) -> CableGeometry | None:
        """The tendons as cables; None where they follow the backbone."""
        return self.model.geometry

    @property
    def law(self) -> TendonLaw:
        """How tension passes along the tendons."""
        return self.model.law

    @property
    def section(self) -> SectionForces | None:
        """Forces inside the section; None where there are none."""
        return self.model.section

    # ------------------------------------------------------------------ configuration

    @property
    def coordinates(self) -> NDArray[np.int_]:
        """Exudyn's ODE2 coordinate numbers of all nodes, shape (N, 7); needs an assembled system."""
        if self._coordinates is None:
            first = np.array([self.mbs.GetNodeODE2Index(n) for n in self.nodes])
            self._coordinates = first[:, None] + np.arange(7)
        return self._coordinates

    def forget_coordinates(self) -> None:
        """Read the nodes' coordinate numbers from Exudyn again, after another `Assemble`."""
        self._coordinates = None
        self._reference = None
        self._evaluation = self._solved = None
        self.history_nodes.forget_coordinates()

    @property
    def reference_coordinates(self) -> Array:
        """Reference values of the nodes' coordinates, shape (N, 7).

        Exudyn's own `GetODE2CoordinatesTotal` frees memory wrongly in 1.13.6 (beyond about 100 coordinates the
        process aborts), so the sum of reference and displacement is formed here.
        """
        if self._reference is None:
            data = self.mbs.systemData
            everything = np.array(data.GetODE2Coordinates(exu.ConfigurationType.Reference))
            self._reference = everything[self.coordinates]
        return self._reference

    def scene_coordinates(self) -> Array:
        """Current coordinates of the nodes in the scene, as displacements, shape (N, 7)."""
        moved: Array = self.mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Current, copy=False)
        return moved[self.coordinates]

    def scene_poses(self) -> tuple[Array, Array, Array]:
        """Current positions (N, 3), rotations (N, 3, 3) in beam axes and Euler parameters (N, 4) in the scene."""
        return self._poses(self.scene_coordinates())

    def _poses(self, displacements: Array) -> tuple[Array, Array, Array]:
        """Positions, rotations and Euler parameters of the nodes from their coordinates, shape (N, 7)."""
        q = displacements + self.reference_coordinates
        e = q[:, 3:]
        return q[:, :3], rotation_of_euler_parameters(e), e

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

    @property
    def prescribed(self) -> Array:
        """Displacement prescribed in the last solved state [m], nan of tendons driven by tension; shape (m,)."""
        return self.history.prescribed

    def store(
        self, friction: FrictionState, prescribed: Array, forces: TendonForces, everything: Array
    ) -> None:
        """Keep the history of a state solved elsewhere, as that of the current and of the initial configuration.

        Parameters
        ----------
        friction
            Its friction history.
        prescribed
            See `prescribed`.
        forces
            Its forces.
        everything
            Its coordinates, of the whole scene.
        """
        history = RobotHistory(friction, forces.base_tension, prescribed, self._stretch(forces))
        self.history_nodes.write(history, forces.field.tension, forces.field.base_slip, initial=True)
        self._solved = everything[self.coordinates], self.history, forces

    def reset(self) -> None:
        """Reset the history to that of a robot that was never loaded."""
        self.history_nodes.reset()

    def friction_without_stretch(self) -> FrictionState:
        """Friction history for a solver in which inextensible tendons do not stretch.

        The slips of tendons that Exudyn's solvers drove by displacement are counted anew from the present
        configuration, in which nothing has slipped since the history was committed.
        """
        history = self.history
        stretched = ~np.isnan(history.prescribed) & (self.law.parameters.compliance == 0.0)
        if not np.any(stretched & np.any(history.stretch != 0.0, axis=1)):
            return history.friction
        slip = self.current_forces().field.slip
        return replace(history.friction, slip=np.where(stretched[:, None], slip, history.friction.slip))

    # ------------------------------------------------------------------ forces

    def input_values(self, t: float = 0.0) -> Array:
        """Tensions [N] and displacements [m] at the base, at time t."""
        return np.asarray(self.inputs(t) if callable(self.inputs) else self.inputs, dtype=float)

    def current_forces(self) -> TendonForces:
        """Forces in the scene's current configuration at the tensions and mobilisations of the history."""
        history, coordinates = self.history, self.scene_coordinates()
        if self._solved is not None:
            before, of, forces = self._solved
            if of is history and np.array_equal(before, coordinates):
                return forces
        positions, rotations, _ = self._poses(coordinates)
        measured, friction = self.model.measure(positions, rotations), history.friction
        forces = self.model.at_mobilisation(
            measured, history.base_tension, friction.mobilisation, friction, friction.time
        )
        self._solved = coordinates, history, forces
        return forces

    @property
    def displacements(self) -> Array:
        """Tendon pulled in at the base [m], shape (m,): zero in the unloaded shape, just taut or with its pretension.

        For a tendon driven by displacement this is the prescribed value, which a slack tendon does not follow.
        """
        prescribed = self.prescribed
        return np.where(np.isnan(prescribed), self.current_forces().field.base_slip, prescribed)

    # ------------------------------------------------------------------ Exudyn's own solvers

    def forces_on_coordinates(self, displacements: Sequence[float], t: float) -> Array:
        """Generalised forces of tendons and section on the coordinates of the nodes, shape (7 N,).

        Parameters
        ----------
        displacements
            Coordinates of the nodes, without reference values, shape (7 N,).
        t
            Time [s].
        """
        found = self._evaluate(np.array(displacements), t)
        return generalized_forces(found.forces.nodal_wrenches(), found.rotations, found.parameters)

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
            return self._no_jacobian
        found = self._matching(np.array(displacements), t)
        forces = found.forces if self.holes == "present" else self._forces_at_rest(found)
        n = len(self.nodes)
        k = np.zeros((6 * n, 6 * n))
        forces.add_coupling(k)
        if self.holes != "present":
            taut = self.by_displacement & (forces.base_tension > 0.0)
            add_condensed(k, forces, taut, self.holes == "stuck")
        if self.geometry is not None:
            add_neighbours(k, forces.geometric_stiffness(), self.model.cable_nodes)
        to_twist = twists_by_coordinates(found.rotations, found.parameters)
        tangent = generalized_tangent(k, forces.nodal_wrenches()[:, 3:], to_twist)
        return _triplets(-by_position * tangent)

    def _forces_at_rest(self, found: _Evaluation) -> TendonForces:
        """Forces at the tensions and mobilisations of the history, driven tendons being elastic."""
        history, friction = found.history, found.history.friction
        model = replace(self.model, law=self._elastic_law(history))
        return model.at_mobilisation(
            found.forces.measured, history.base_tension, friction.mobilisation, friction, friction.time
        )

    def _matching(self, coordinates: Array, t: float) -> _Evaluation:
        """The last evaluation if it was for the same state, inputs and time, else a new one."""
        last = self._evaluation
        if (
            last is not None
            and last.time == t
            and last.inputs is self.inputs
            and last.by_displacement is self.by_displacement
            and last.history is self.history
            and np.array_equal(last.coordinates, coordinates)
        ):
            return last
        return self._evaluate(coordinates, t)

    def _evaluate(self, coordinates: Array, t: float) -> _Evaluation:
        """Forces in a configuration with the inputs at time t [s], the history being that of the scene."""
        positions, rotations, parameters = self._poses(coordinates.reshape(-1, 7))
        history, values = self.history, self.input_values(t)
        measured = self.model.measure(positions, rotations)
        last = self._evaluation
        warm = last is not None and last.history is history
        near = last.forces.base_tension if last is not None and warm else history.base_tension
        forces = self._forces(measured, values, history, near, t)
        self._evaluation = _Evaluation(
            coordinates, t, history, self.inputs, self.by_displacement, values, rotations, parameters, forces
        )
        return self._evaluation

    def _forces(
        self, measured: Measurement, values: Array, history: RobotHistory, near: Array, t: float
    ) -> TendonForces:
        """Forces where the tension of tendons driven by displacement follows from their elasticity.

        Parameters
        ----------
        measured
            The configuration.
        values
            Inputs.
        history
            At the beginning of the step.
        near
            Tensions at the base from which those of driven tendons are sought [N].
        t
            Time [s].
        """
        driven, state = self.by_displacement, history.friction
        if not np.any(driven):
            return self.model.after(measured, values, state, t)
        # In Exudyn's own solvers the tension is not an unknown, so every tendon must be elastic.
        soft = self._elastic_law(history)
        tension = np.where(driven, near, values)
        for _ in range(60):
            forces = self.model.after(measured, tension, state, t, soft)
            change = (values - forces.field.base_slip) / forces.base_slip_by_base()
            new = np.where(driven, np.maximum(tension + change, 0.0), tension)
            moved = np.max(np.abs(new - tension))
            tension = new
            if moved <= 1e-12 * (1.0 + np.max(new)):
                break
        forces = self.model.after(measured, tension, state, t, soft)
        pulled = driven & (tension > 0.0)
        slope = np.where(pulled, -1.0 / forces.base_slip_by_base(), 0.0)
        return forces._replace(base_response=slope[:, None] * forces.base_slip_by_holes())

    def _elastic_law(self, history: RobotHistory) -> TendonLaw:
        """The law with an elasticity for inextensible tendons that are driven by displacement."""
        parameters = self.law.parameters
        inextensible = self.by_displacement & (parameters.compliance == 0.0)
        if not np.any(inextensible):
            return self.law
        return self.law.with_parameters(
            compliance=np.where(inextensible, 1.0 / self.inextensible_stiffness, parameters.compliance),
            lengths=parameters.lengths + np.where(inextensible[:, None], history.stretch, 0.0),
        )

    def _stretch(self, forces: TendonForces) -> Array:
        """Stretch, see `RobotHistory`, with which tendons of their own elasticity take over at these tensions."""
        relative = forces.field.tension / self.inextensible_stiffness
        stretched = -forces.measured.shape.lengths * relative / (1.0 + relative)
        stretched = np.where(self.law.parameters.mask, stretched, 0.0)
        return np.where(self.law.parameters.compliance[:, None] == 0.0, stretched, 0.0)

    def commit_scene(self, t: float) -> None:
        """Commit the scene's current state, solved at time t [s], to the friction history."""
        found = self._matching(self.scene_coordinates().reshape(-1), t)
        driven, forces, before = self.by_displacement, found.forces, found.history
        history = RobotHistory(
            self.law.commit(forces.field),
            forces.base_tension,
            np.where(driven, found.values, np.nan),
            np.where(driven[:, None], before.stretch, self._stretch(forces)),
        )
        self.history_nodes.write(history, forces.field.tension, forces.field.base_slip)
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
        """Move the markers of the drawn tendons to where these lie in their holes."""
        if forces.measured.offsets is None:
            return
        half = 0.5 * float(self.mesh.lengths[0])
        for markers, offsets in zip(self.connectors.hole_markers, forces.measured.offsets, strict=True):
            for k, (marker, offset) in enumerate(zip(markers, offsets.tolist(), strict=False)):
                # The base plate's holes sit on the first beam, whose origin is its middle.
                x = -half if k == 0 else 0.0
                self.mbs.SetMarkerParameter(marker, "localPosition", [x, offset[1], offset[2]])


def _triplets(matrix: Array) -> exu.MatrixContainer:
    """A matrix for Exudyn, in sparse triplets."""
    container = exu.MatrixContainer()
    container.SetWithDenseMatrix(matrix, useDenseMatrix=False)
    return container
