"""What follows a robot's configuration: tensions with friction, section forces, and their tangent.

One `TendonActuation` per robot. Exudyn's own solvers reach it through the hooks, the strain-space solver
directly; both get the same forces, the same tangent and the same history.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BackboneMesh, relative_twists, strain_matrices
from tdcr_fe.elements.friction import FrictionState, TendonLaw, TensionField
from tdcr_fe.elements.poses import euler_rate_matrix, rotation_of_euler_parameters, skew
from tdcr_fe.elements.section import SectionForces, nodal_sum
from tdcr_fe.elements.tendons import CableGeometry, CableShape

Array = NDArray[np.float64]
#: From this many unknowns on it pays that a segment touches two nodes only.
SPARSE_WIDTH = 200

Inputs = Array | Callable[[float], Array]


@dataclass
class Connectors:
    """Exudyn's numbers of the items that carry the forces.

    Attributes
    ----------
    springs : list of list
        By tendon, the spring-damper of every segment; empty for tendons that follow the backbone.
    node_forces, node_torques : list
        Body-fixed loads on every node; empty where no section force acts.
    hole_markers : list of list
        By tendon, markers of its holes, base plate first; needed where tendons shift inside their holes.
    """

    springs: list[list[Any]]
    node_forces: list[Any]
    node_torques: list[Any]
    hole_markers: list[list[Any]] = field(default_factory=list)


@dataclass(frozen=True)
class Clamp:
    """A base plate that a joint holds on ground.

    Attributes
    ----------
    joint : object
        Exudyn's number of the joint, which blocks all six motions.
    position, rotation : ndarray
        Where it holds the base node, the rotation in beam axes; shapes (3,) and (3, 3).
    """

    joint: Any
    position: Array
    rotation: Array


class TendonActuation:
    """Tendons, friction and section forces of one robot.

    Parameters
    ----------
    mbs
        The system that holds the robot.
    nodes
        Exudyn's numbers of the backbone nodes, base first.
    mesh
        The backbone.
    hole_nodes
        Which backbone nodes carry holes, ascending.
    geometry
        The tendons as cables; None where they follow the backbone.
    law
        How tension passes along them.
    section
        Forces inside the section; None where there are none.
    connectors
        The items that carry the forces.
    inextensible_stiffness
        EA that an inextensible tendon is given when it is driven by displacement in Exudyn's own solvers,
        which know no tension as an unknown [N].
    clamp
        What holds the base, where that is ground.
    """

    def __init__(
        self,
        mbs: exu.MainSystem,
        nodes: Sequence[Any],
        mesh: BackboneMesh,
        hole_nodes: NDArray[np.int_],
        geometry: CableGeometry | None,
        law: TendonLaw,
        section: SectionForces | None,
        connectors: Connectors,
        inextensible_stiffness: float = 1e5,
        clamp: Clamp | None = None,
    ) -> None:
        self.mbs = mbs
        self.nodes = list(nodes)
        self.mesh = mesh
        self.hole_nodes = hole_nodes
        self.geometry = geometry
        self.law = law
        self.section = section
        self.connectors = connectors
        self.inextensible_stiffness = inextensible_stiffness
        self.clamp = clamp
        m = law.shape[0]
        self.count = m
        self.by_displacement: NDArray[np.bool_] = np.zeros(m, dtype=bool)
        self.inputs: Inputs = np.zeros(m)
        self.state: FrictionState = law.initial_state()
        self.base_tension = np.zeros(m)
        #: Displacement prescribed where last solved [m], nan of tendons driven by tension, shape (m,).
        self.prescribed: Array = np.full(m, np.nan)
        self.presliding: float | None = None
        self._columns = (6 * hole_nodes[:, None] + np.arange(6)).ravel()
        self._all_nodes = hole_nodes.size == mesh.arc_lengths.size
        self._coordinates: NDArray[np.int_] | None = None
        self._reference: Array | None = None
        self._soft = TendonLaw(
            law.parameters
            if np.all(law.parameters.compliance > 0.0)
            else _with_compliance(law, 1.0 / inextensible_stiffness),
            law.law,
            law.presliding,
        )
        self._d_base: Array | None = None
        #: Positions of the configuration that was measured last.
        self._measured: Array | None = None

    # ------------------------------------------------------------------ configuration

    @property
    def coordinates(self) -> NDArray[np.int_]:
        """Exudyn's ODE2 coordinate numbers of all nodes, shape (N, 7); needs an assembled system."""
        if self._coordinates is None:
            first = np.array([self.mbs.GetNodeODE2Index(n) for n in self.nodes])
            self._coordinates = first[:, None] + np.arange(7)
        return self._coordinates

    def forget_coordinates(self) -> None:
        """Ask Exudyn again where the nodes' coordinates are, after another `Assemble`."""
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
        """Positions (N, 3), rotations (N, 3, 3) in beam axes and Euler parameters (N, 4) now in the scene."""
        moved = np.asarray(self.mbs.systemData.GetODE2Coordinates())
        q = moved[self.coordinates] + self.reference_coordinates
        e = q[:, 3:]
        return q[:, :3], rotation_of_euler_parameters(e), e

    def input_values(self, t: float = 0.0) -> Array:
        """Tensions [N] and displacements [m] at the base, at time t."""
        return np.asarray(self.inputs(t) if callable(self.inputs) else self.inputs, dtype=float)

    @property
    def displacements(self) -> Array:
        """What is pulled in at the base since the unloaded, just taut state [m], shape (m,).

        Of a tendon driven by displacement what was prescribed: where it is slack, its shape would take up less.
        """
        if not hasattr(self, "field"):
            return np.zeros(self.count)
        return np.where(np.isnan(self.prescribed), self.field.base_slip, self.prescribed)

    # ------------------------------------------------------------------ forces and tangent

    def measure(self, positions: Array, rotations: Array, twists: Array | None = None) -> None:
        """Lengths and angles of the tendons in a configuration; the first part of `update`."""
        if positions is self._measured and twists is not None:
            return
        self._measured = positions
        self.positions, self.rotations = positions, rotations
        if self.section is not None:
            self.twists = relative_twists(positions, rotations) if twists is None else twists
        if self.geometry is not None:
            if self.geometry.clearance is not None:
                self.geometry.shift_in_holes(positions[self.hole_nodes], rotations[self.hole_nodes])
            if self._all_nodes:
                self.shape = self.geometry.evaluate(positions, rotations)
            else:
                self.shape = self.geometry.evaluate(positions[self.hole_nodes], rotations[self.hole_nodes])
            return
        assert self.section is not None and self.section.tendons is not None
        length, gradient = self.section.tendons.evaluate(self.twists, self.section.lengths)
        by_nodes = gradient[:, :, None, :] @ strain_matrices(self.twists)
        m, n_nodes = length.size, self.mesh.arc_lengths.size
        d = np.zeros((m, n_nodes, 6))
        d[:, :-1] += by_nodes[:, :, 0, :6]
        d[:, 1:] += by_nodes[:, :, 0, 6:]
        derivatives = d.reshape(m, 1, -1), np.zeros((m, 0, d[0].size))
        self.shape = CableShape(length[:, None], np.zeros((m, 0)), lambda: derivatives)

    def update(
        self,
        positions: Array,
        rotations: Array,
        base_tension: Array,
        twists: Array | None = None,
        time: float = 0.0,
    ) -> TensionField:
        """Tensions in a configuration for given tensions at the base [N], shape (m,), and time [s]."""
        self.measure(positions, rotations, twists)
        self.base_tension = base_tension
        self.field = self.law.evaluate(
            base_tension, self.shape.lengths, self.shape.angles, self.state, self.presliding, time
        )
        self._d_base = None
        return self.field

    def update_mixed(
        self,
        positions: Array,
        rotations: Array,
        base_tension: Array,
        mobilisation: Array,
        twists: Array | None = None,
        time: float = 0.0,
    ) -> TensionField:
        """Tensions where the mobilisations are unknowns of their own, shape (m, g); time in [s]."""
        self.measure(positions, rotations, twists)
        self.base_tension = base_tension
        self.field = self.law.field(
            base_tension, self.shape.lengths, self.shape.angles, mobilisation, self.state, time
        )
        self._d_base = None
        return self.field

    def mobilisation_columns(self) -> Array:
        """Derivative of the force on the nodes by the frictional mobilisations, shape (6 N, k)."""
        d = -np.swapaxes(self.field.by_mobilisation, 1, 2) @ self.shape.d_lengths
        return self._to_all_nodes(d[self.law.frictional]).T

    def slip_change(self, nodes: Array, base_tension: Array | None) -> Array:
        """Change of the slips behind the mobilisations in a step, the mobilisations kept [m], shape (m, g).

        Parameters
        ----------
        nodes
            Body-frame increments of all nodes, shape (6 N,).
        base_tension
            Change of the tensions at the base [N], shape (m,); None where they are kept.
        """
        f, s = self.field, self.shape
        moved = nodes if self._all_nodes or self.geometry is None else nodes[self._columns]
        released = f.released_d_length * (s.d_lengths @ moved)
        if self.law.elastic:
            change = (f.d_angle @ (s.d_angles @ moved)[:, :, None])[:, :, 0]
            if base_tension is not None:
                change = change + f.d_base * base_tension[:, None]
            if f.depends_on_length:
                change = change + (f.d_length @ (s.d_lengths @ moved)[:, :, None])[:, :, 0]
            released = released + f.released_d_tension * change
        return self.law.slips(released)

    def slip_rows(self) -> tuple[Array, Array, Array]:
        """Derivatives of the slips behind the frictional mobilisations.

        Returns
        -------
        by_nodes : ndarray, shape (k, 6 N)
        by_base_tension : ndarray, shape (k, m)
        by_mobilisation : ndarray, shape (k, k)
        """
        f, s, law = self.field, self.shape, self.law
        keep = law.frictional
        tendon, group = np.nonzero(keep)
        of_tendon = tendon[:, None] == np.arange(self.count)
        released = f.released_d_length[:, :, None] * s.d_lengths
        if not law.elastic:
            by_nodes = self._to_all_nodes((law.slip_operator @ released)[keep])
            return by_nodes, np.zeros(of_tendon.shape), np.zeros((len(tendon),) * 2)
        stretched = law.slip_operator * f.released_d_tension[:, None, :]
        by_nodes = law.slip_operator @ released + (stretched @ f.d_angle) @ s.d_angles
        if f.depends_on_length:
            by_nodes = by_nodes + (stretched @ f.d_length) @ s.d_lengths
        by_base = (stretched @ f.d_base[:, :, None])[keep]
        by_mobilisation = (stretched @ f.by_mobilisation)[tendon[:, None], group[:, None], group]
        return (
            self._to_all_nodes(by_nodes[keep]),
            by_base * of_tendon,
            by_mobilisation * (tendon[:, None] == tendon),
        )

    def update_from_scene(self, t: float) -> TensionField:
        """Tensions in the configuration the scene is in now, tendons driven by displacement included."""
        positions, rotations, self._parameters = self.scene_poses()
        values = self.input_values(t)
        driven = self.by_displacement
        self.set_prescribed(values)
        if not np.any(driven):
            return self.update(positions, rotations, values, time=t)
        self.measure(positions, rotations)
        tension = np.where(driven, self.base_tension, values)
        lengths, angles = self.shape.lengths, self.shape.angles
        for _ in range(60):
            field = self._soft.evaluate(tension, lengths, angles, self.state, self.presliding, t)
            error = np.where(driven, values - field.base_slip, 0.0)
            stiffness = 1.0 / np.einsum("mn,mn->m", field.released_d_tension, field.d_base)
            change = np.where(driven, error * stiffness, 0.0)
            new = np.where(driven, np.maximum(tension + change, 0.0), tension)
            if np.max(np.abs(new - tension)) <= 1e-12 * (1.0 + np.max(new)):
                tension = new
                break
            tension = new
        self.base_tension = tension
        self.field = self._soft.evaluate(tension, lengths, angles, self.state, self.presliding, t)
        pulled = driven & (tension > 0.0)
        slope = np.where(pulled, -1.0 / self.base_slip_by_base(), 0.0)
        self._d_base = None
        rows = self.base_slip_rows()
        self._d_base = slope[:, None] * (rows if self.geometry is None else rows[:, self._columns])
        return self.field

    def apply(self) -> None:
        """Give the forces to Exudyn's items."""
        mbs = self.mbs
        if self.geometry is not None and self.geometry.clearance is not None:
            half = 0.5 * float(self.mesh.lengths[0])
            for markers, offsets in zip(self.connectors.hole_markers, self.geometry.offsets, strict=True):
                for k, (marker, offset) in enumerate(zip(markers, offsets.tolist(), strict=False)):
                    # The base plate's holes sit on the first beam, whose origin is its middle.
                    x = -half if k == 0 else 0.0
                    mbs.SetMarkerParameter(marker, "localPosition", [x, offset[1], offset[2]])
        for springs, tensions in zip(self.connectors.springs, self.field.tension, strict=False):
            for spring, tension in zip(springs, tensions.tolist(), strict=False):
                mbs.SetObjectParameter(spring, "force", tension)
        if self.section is not None:
            wrench = nodal_sum(self.section.wrenches(self.twists, self.field.tension[:, 0]))
            for k, (force, torque) in enumerate(
                zip(self.connectors.node_forces, self.connectors.node_torques, strict=True)
            ):
                mbs.SetLoadParameter(force, "loadVector", wrench[k, :3])
                mbs.SetLoadParameter(torque, "loadVector", wrench[k, 3:])

    def length_rows(self) -> Array:
        """Derivative of all segment lengths by the node twists, shape (m n, 6 N)."""
        return self._to_all_nodes(self.shape.d_lengths.reshape(-1, self.shape.d_lengths.shape[-1]))

    def base_slip_rows(self) -> Array:
        """Derivative of the slip at the base plate by the node twists, shape (m, 6 N)."""
        f, s = self.field, self.shape
        by_length = f.released_d_length + (f.released_d_tension[:, None, :] @ f.d_length)[:, 0]
        d = (by_length[:, None, :] @ s.d_lengths)[:, 0]
        if s.d_angles.shape[1]:
            d = d + ((f.released_d_tension[:, None, :] @ f.d_angle) @ s.d_angles)[:, 0]
        return self._to_all_nodes(d)

    def base_slip_by_base(self) -> Array:
        """Derivative of the slip at the base plate by the tension there [m/N], shape (m,)."""
        return np.einsum("mn,mn->m", self.field.released_d_tension, self.field.d_base)

    def base_slip_by_mobilisation(self) -> Array:
        """Derivative of the slip at the base plate by the frictional mobilisations [m], shape (m, k)."""
        keep = self.law.frictional
        d = np.einsum("mn,mng->mg", self.field.released_d_tension, self.field.by_mobilisation)[keep]
        return d * (np.nonzero(keep)[0] == np.arange(self.count)[:, None])

    def base_tension_columns(self) -> Array:
        """Derivative of the force on the nodes by the tensions at the base, shape (6 N, m)."""
        d = -(self.field.d_base[:, None, :] @ self.shape.d_lengths)[:, 0]
        return self._to_all_nodes(d).T

    def tangent(self) -> Array:
        """What Exudyn's Jacobian lacks, by itself; see `add_tangent`."""
        k = np.zeros((6 * self.mesh.arc_lengths.size,) * 2)
        self.add_tangent(k)
        return k

    def add_tangent(self, k: Array, loads_jacobian: bool = False) -> None:
        """Add what Exudyn's Jacobian lacks: derivative of the forces by the node twists.

        The change of the tensions with the configuration, and the section forces; the geometric stiffness of the
        straight segments is Exudyn's own.

        Parameters
        ----------
        k
            Changed in place, shape (6 N, 6 N).
        loads_jacobian
            Whether Exudyn's Jacobian was asked to contain the derivatives of loads; the turning of the
            body-fixed loads that carry the section forces is then in it already.
        """
        f = self.field
        d_lengths, d_angles = self.shape.derivatives
        change = f.d_angle @ d_angles
        if f.depends_on_length:
            change += f.d_length @ d_lengths
        if self._d_base is not None:
            change = change + f.d_base[:, :, None] * self._d_base[:, None, :]
        width = d_lengths.shape[-1]
        if width > SPARSE_WIDTH and self.geometry is not None:
            softer = self._softening(change)
        else:
            softer = d_lengths.reshape(-1, width).T @ change.reshape(-1, width)
        if self._all_nodes or self.geometry is None:
            k -= softer
        else:
            k[np.ix_(self._columns, self._columns)] -= softer
        if self.section is not None:
            self._add_section_tangent(k, loads_jacobian)

    def _softening(self, change: Array) -> Array:
        """Change of the tensions (m, n, W) times the pull on the nodes, segment by segment, shape (W, W)."""
        assert self.geometry is not None
        m, n, width = change.shape
        k = np.zeros((width // 6, 6, width))
        pulls = self.shape.d_lengths.reshape(m, n, -1, 6)
        for i, nodes in enumerate(self.geometry.nodes):
            segments = np.flatnonzero(self.geometry.mask[i])
            for end in (nodes[segments], nodes[segments + 1]):
                k[end] += pulls[i, segments, end][:, :, None] * change[i, segments][:, None, :]
        return k.reshape(width, width)

    def _add_section_tangent(self, k: Array, loads_jacobian: bool) -> None:
        """Section forces: change with the twists, and with the frames in which they are given."""
        assert self.section is not None
        tension = self.field.tension[:, 0]
        element = self.section.wrench_tangent(self.twists, tension)
        for e, block in enumerate(element):
            k[6 * e : 6 * e + 12, 6 * e : 6 * e + 12] += block
        if loads_jacobian:
            return
        wrench = nodal_sum(self.section.wrenches(self.twists, tension))
        turned = skew(wrench[:, :3]), skew(wrench[:, 3:])
        # The residual is taken in frames that move along; Exudyn's Jacobian of it has these terms too.
        for n in range(len(wrench)):
            i = 6 * n
            k[i : i + 3, i + 3 : i + 6] -= turned[0][n]
            k[i + 3 : i + 6, i + 3 : i + 6] -= 0.5 * turned[1][n]

    def scene_tangent(self) -> tuple[NDArray[np.int_], Array]:
        """`tangent` in Exudyn's coordinates: numbers of the coordinates (7 N,), and the matrix (7 N, 7 N)."""
        n = self.mesh.arc_lengths.size
        to_twist = np.zeros((n, 6, 7))
        to_twist[:, :3, :3] = np.swapaxes(self.rotations, 1, 2)
        to_twist[:, 3:, 3:] = 4.0 * np.swapaxes(euler_rate_matrix(self._parameters), 1, 2)
        k = self.tangent().reshape(n, 6, n, 6)
        right = np.einsum("aibj,bjc->aibc", k, to_twist)
        both = np.einsum("aic,aibd->acbd", to_twist, right)
        return self.coordinates.ravel(), both.reshape(7 * n, 7 * n)

    def _to_all_nodes(self, rows: Array) -> Array:
        if self._all_nodes or self.geometry is None:
            return rows
        full = np.zeros((rows.shape[0], 6 * self.mesh.arc_lengths.size))
        full[:, self._columns] = rows
        return full

    # ------------------------------------------------------------------ history

    def set_prescribed(self, inputs: Array) -> None:
        """Take down what drives the tendons by displacement in the state that is being solved, shape (m,)."""
        self.prescribed = np.where(self.by_displacement, inputs, np.nan)

    def restart_time(self, time: float) -> None:
        """Count time from now on from another value [s]; slip rates stay as they are."""
        self.state = replace(self.state, time=time)

    def commit(self) -> None:
        """Take the present holes' states as history."""
        self.state = self.law.commit(self.field)

    def reset(self) -> None:
        """Forget all history, as for a robot that was never loaded."""
        self.state = self.law.initial_state()
        self.base_tension = np.zeros(self.count)
        self.prescribed = np.full(self.count, np.nan)


def _with_compliance(law: TendonLaw, compliance: float) -> Any:
    """Parameters in which no tendon is inextensible."""
    given = law.parameters.compliance
    return law.with_parameters(compliance=np.where(given > 0.0, given, compliance)).parameters
