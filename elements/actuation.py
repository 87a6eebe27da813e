"""One robot in Exudyn's scene: its actuation, its committed friction history, and the items that apply its forces.

Exudyn's own solvers reach a `TendonActuation` through the hooks, the quasi-static solver directly; both evaluate the
same `ForceModel` and commit to the same history.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BackboneMesh
from tdcr_fe.elements.forces import ForceModel, TendonForces
from tdcr_fe.elements.friction import FrictionState, TendonLaw
from tdcr_fe.elements.poses import euler_rate_matrix, rotation_of_euler_parameters
from tdcr_fe.elements.section import SectionForces
from tdcr_fe.elements.tendons import CableGeometry

Array = NDArray[np.float64]

Inputs = Array | Callable[[float], Array]


@dataclass
class Connectors:
    """Exudyn's numbers of the objects of a robot, and of the items that apply the tendon and section forces.

    Attributes
    ----------
    springs : list of list
        By tendon, the spring-damper of every segment; empty for tendons that follow the backbone.
    node_forces, node_torques : list
        Body-fixed loads on every node; empty where no section force acts.
    hole_markers : list of list
        By tendon, markers of its holes, base plate first; needed where tendons shift inside their holes.
    beams : list
        The beam elements, base first.
    others : list
        All other objects of the robot, none of which resists a motion of the backbone: disks, masses, base joint.
    """

    springs: list[list[Any]]
    node_forces: list[Any]
    node_torques: list[Any]
    hole_markers: list[list[Any]] = field(default_factory=list)
    beams: list[Any] = field(default_factory=list)
    others: list[Any] = field(default_factory=list)

    @property
    def object_numbers(self) -> list[int]:
        """Numbers of all its objects."""
        springs = [spring for springs in self.springs for spring in springs]
        return [int(i) for i in (*self.beams, *springs, *self.others)]

    @property
    def load_numbers(self) -> list[int]:
        """Numbers of the loads among all loads."""
        return [int(load) for load in (*self.node_forces, *self.node_torques)]


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


class TendonActuation:
    """Actuation, friction history and items of one robot in a scene.

    Parameters
    ----------
    mbs
        The system that contains the robot.
    nodes
        Exudyn's numbers of the backbone nodes, base first.
    model
        Computes its forces.
    connectors
        The items that apply the forces.
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
    state : FrictionState
        Committed friction history.
    base_tension : ndarray, shape (m,)
        Tension at the base in the last solved state [N].
    prescribed : ndarray, shape (m,)
        Displacement prescribed in the last solved state [m], nan of tendons driven by tension.
    forces : TendonForces or None
        Those evaluated last; None before any solver has run.
    connected : bool
        Whether Exudyn's items apply the forces; see `disconnect`.
    """

    def __init__(
        self,
        mbs: exu.MainSystem,
        nodes: Sequence[Any],
        model: ForceModel,
        connectors: Connectors,
        inextensible_stiffness: float = 1e5,
        clamp: Clamp | None = None,
    ) -> None:
        self.mbs = mbs
        self.nodes = list(nodes)
        self.model = model
        self.connectors = connectors
        self.inextensible_stiffness = inextensible_stiffness
        self.clamp = clamp
        m = model.law.shape[0]
        self.count = m
        self.by_displacement: NDArray[np.bool_] = np.zeros(m, dtype=bool)
        self.inputs: Inputs = np.zeros(m)
        self.state: FrictionState = model.law.initial_state()
        self.base_tension: Array = np.zeros(m)
        self.prescribed: Array = np.full(m, np.nan)
        self.forces: TendonForces | None = None
        self.connected = True
        self._coordinates: NDArray[np.int_] | None = None
        self._reference: Array | None = None

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

    def scene_poses(self) -> tuple[Array, Array, Array]:
        """Current positions (N, 3), rotations (N, 3, 3) in beam axes and Euler parameters (N, 4) in the scene."""
        moved = np.asarray(self.mbs.systemData.GetODE2Coordinates())
        q = moved[self.coordinates] + self.reference_coordinates
        e = q[:, 3:]
        return q[:, :3], rotation_of_euler_parameters(e), e

    # ------------------------------------------------------------------ forces

    def input_values(self, t: float = 0.0) -> Array:
        """Tensions [N] and displacements [m] at the base, at time t."""
        return np.asarray(self.inputs(t) if callable(self.inputs) else self.inputs, dtype=float)

    def scene_forces(self, t: float) -> TendonForces:
        """Forces in the scene's current configuration, with the inputs at time t [s]."""
        positions, rotations, _ = self.scene_poses()
        measured = self.model.measure(positions, rotations)
        values, driven = self.input_values(t), self.by_displacement
        if not np.any(driven):
            return self.model.after(measured, values, self.state, t)
        # In Exudyn's own solvers the tension is not an unknown, so every tendon must be elastic.
        soft = _stretching(self.law, 1.0 / self.inextensible_stiffness)
        last = self.base_tension if self.forces is None else self.forces.base_tension
        tension = np.where(driven, last, values)
        for _ in range(60):
            forces = self.model.after(measured, tension, self.state, t, soft)
            change = (values - forces.field.base_slip) / forces.base_slip_by_base()
            new = np.where(driven, np.maximum(tension + change, 0.0), tension)
            moved = np.max(np.abs(new - tension))
            tension = new
            if moved <= 1e-12 * (1.0 + np.max(new)):
                break
        forces = self.model.after(measured, tension, self.state, t, soft)
        pulled = driven & (tension > 0.0)
        slope = np.where(pulled, -1.0 / forces.base_slip_by_base(), 0.0)
        return forces._replace(base_response=slope[:, None] * forces.base_slip_by_holes())

    def current_forces(self) -> TendonForces:
        """Forces evaluated last; before any solver has run, those of the scene at zero tension."""
        if self.forces is not None:
            return self.forces
        positions, rotations, _ = self.scene_poses()
        measured = self.model.measure(positions, rotations)
        return self.model.after(measured, np.zeros(self.count), self.state, self.state.time)

    @property
    def displacements(self) -> Array:
        """Tendon pulled in at the base [m], shape (m,): zero in the unloaded shape, just taut or with its pretension.

        For a tendon driven by displacement this is the prescribed value, which a slack tendon does not follow.
        """
        if self.forces is None:
            return self.law.released_unloaded().sum(axis=1)
        return np.where(np.isnan(self.prescribed), self.forces.field.base_slip, self.prescribed)

    def disconnect(self) -> None:
        """Take tendon and section forces off Exudyn's items, for a solver that computes them itself.

        `apply` connects them again.
        """
        if not self.connected:
            return
        self._switch_springs(False)
        for load in (*self.connectors.node_forces, *self.connectors.node_torques):
            self.mbs.SetLoadParameter(load, "loadVector", [0.0, 0.0, 0.0])

    def _switch_springs(self, on: bool) -> None:
        """Switch the springs of all segments on or off."""
        self.connected = on
        for springs in self.connectors.springs:
            for spring in springs:
                self.mbs.SetObjectParameter(spring, "activeConnector", on)

    def apply(self, forces: TendonForces) -> None:
        """Set the forces on Exudyn's items."""
        mbs = self.mbs
        if not self.connected:
            self._switch_springs(True)
        if forces.measured.offsets is not None:
            half = 0.5 * float(self.mesh.lengths[0])
            for markers, offsets in zip(self.connectors.hole_markers, forces.measured.offsets, strict=True):
                for k, (marker, offset) in enumerate(zip(markers, offsets.tolist(), strict=False)):
                    # The base plate's holes sit on the first beam, whose origin is its middle.
                    x = -half if k == 0 else 0.0
                    mbs.SetMarkerParameter(marker, "localPosition", [x, offset[1], offset[2]])
        for springs, tensions in zip(self.connectors.springs, forces.field.tension, strict=False):
            for spring, tension in zip(springs, tensions.tolist(), strict=False):
                mbs.SetObjectParameter(spring, "force", tension)
        if self.section is not None:
            for force, torque, wrench in zip(
                self.connectors.node_forces,
                self.connectors.node_torques,
                forces.section_wrenches(),
                strict=True,
            ):
                mbs.SetLoadParameter(force, "loadVector", wrench[:3])
                mbs.SetLoadParameter(torque, "loadVector", wrench[3:])

    def scene_tangent(self) -> tuple[NDArray[np.int_], Array]:
        """Tangent terms missing from Exudyn's Jacobian, in Exudyn's coordinates, for the forces evaluated last.

        Returns
        -------
        numbers : ndarray of int, shape (7 N,)
            Of the coordinates.
        matrix : ndarray, shape (7 N, 7 N)
        """
        n = self.mesh.arc_lengths.size
        _, rotations, parameters = self.scene_poses()
        to_twist = np.zeros((n, 6, 7))
        to_twist[:, :3, :3] = np.swapaxes(rotations, 1, 2)
        to_twist[:, 3:, 3:] = 4.0 * np.swapaxes(euler_rate_matrix(parameters), 1, 2)
        missing = np.zeros((6 * n, 6 * n))
        self.current_forces().add_coupling(missing)
        k = missing.reshape(n, 6, n, 6)
        right = np.einsum("aibj,bjc->aibc", k, to_twist)
        both = np.einsum("aic,aibd->acbd", to_twist, right)
        return self.coordinates.ravel(), both.reshape(7 * n, 7 * n)

    # ------------------------------------------------------------------ history

    def commit_scene(self, t: float) -> None:
        """Commit the scene's current state, solved at time t [s], to the friction history."""
        self.forces = self.scene_forces(t)
        self.state = self.law.commit(self.forces.field)
        self.base_tension = self.forces.base_tension
        self.prescribed = np.where(self.by_displacement, self.input_values(t), np.nan)

    def reset(self) -> None:
        """Reset the friction history to that of a robot that was never loaded."""
        self.state = self.law.initial_state()
        self.base_tension = np.zeros(self.count)
        self.prescribed = np.full(self.count, np.nan)
        self.forces = None


def _stretching(law: TendonLaw, compliance: float) -> TendonLaw:
    """A copy of the law in which inextensible tendons have this compliance [1/N]."""
    given = law.parameters.compliance
    if np.all(given > 0.0):
        return law
    return law.with_parameters(compliance=np.where(given > 0.0, given, compliance))
