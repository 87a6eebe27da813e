"""Forces in one configuration of a robot: tensions with friction, section forces, and all their derivatives.

`ForceModel` has the constant data, `TendonForces` the values in one configuration.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array, Index
from tdcr_fe.elements.backbone import BackboneMesh, relative_twists, strain_matrices
from tdcr_fe.elements.capstan import TensionField
from tdcr_fe.elements.friction import TendonLaw
from tdcr_fe.elements.hysteresis import FrictionState
from tdcr_fe.elements.poses import skew
from tdcr_fe.elements.section_forces import DIFFERENCE, SectionForces, add_element_tangent, nodal_sum
from tdcr_fe.elements.tendons import CableGeometry, CableShape


@dataclass(frozen=True)
class SideSprings:
    """Linear springs from nodes to ground."""

    nodes: Index  # (q,): Of the backbone; a node may occur several times
    stiffness: Array  # (q, 3, 3): In world axes [N/m]
    rest: Array  # (q, 3): Positions without force [m]

    def forces(self, positions: Array, rotations: Array) -> Array:
        """Forces on the nodes in their own frames [N], shape (q, 3), from the poses of all nodes."""
        pull = self.stiffness @ (self.rest - positions[self.nodes])[:, :, None]
        return np.asarray((rotations[self.nodes].swapaxes(1, 2) @ pull)[:, :, 0])

    def blocks(self, rotations: Array) -> Array:
        """Stiffness by increments of the positions in the nodes' own frames [N/m], shape (q, 3, 3)."""
        turn = rotations[self.nodes]
        return np.asarray(turn.swapaxes(1, 2) @ self.stiffness @ turn)


class Measurement(NamedTuple):
    """Geometry of the tendons and elements of a robot in one configuration."""

    twists: Array  # (E, 6): Relative twists of the elements; empty where they were not given, and no section force acts
    shape: CableShape  # Lengths and angles of the tendons
    poses: tuple[Array, Array]  # Positions and rotations of all nodes


class StrainState(NamedTuple):
    """Strains and wrenches in the elements, each constant along an element."""

    strain: Array  # (..., E, 6): Twists by the lengths of the elements, in beam axes
    wrench: Array  # (..., E, 6): Gradient of the energy by the twists [N, N m]
    stiffness: Array  # (..., E, 3, 3): Of torsion and bending [N m^2]
    loaded: Array  # (..., E, 3): Curvature less that in the unloaded state [1/m]
    taper: Array  # (..., E): See `BackboneMesh.taper`

    def curvature_rates(self) -> Array:
        """First and second derivative of the curvature by arc length in the middle of every element, in beam axes.

        An element has the mean of the strains along it. In the section's frame the wrench obeys ``n' = -K x n`` and
        ``m' = -K x m - G x n``, and its mean is the gradient of the energy by the twist. The weight of the element
        itself is left out. The compliance of a linear round section grows as the fourth power of its radius falls.

        Returns
        -------
        ndarray, shape (..., E, 2, 3)
            [1/m^2], [1/m^3].
        """
        stretch, bend = skew(self.strain[..., :3]), skew(self.strain[..., 3:])
        turning, moment = bend @ self.wrench[..., :3, None], bend @ self.wrench[..., 3:, None]
        first = -moment - stretch @ self.wrench[..., :3, None]
        second = stretch @ turning - bend @ first
        rates = np.linalg.solve(self.stiffness, np.concatenate((first, second), axis=-1))
        softening = -4.0 * self.taper[..., None]
        second = rates[..., 1] + softening * (2.0 * rates[..., 0] + 1.25 * softening * self.loaded)
        return np.stack((rates[..., 0] + softening * self.loaded, second), axis=-2)


@dataclass(frozen=True)
class ForceModel:
    """Mesh, tendons and laws from which the forces of a robot are computed."""

    mesh: BackboneMesh  # The backbone
    hole_nodes: Index  # Which backbone nodes carry holes, ascending
    geometry: CableGeometry | None  # The tendons as cables; None where they follow the backbone
    law: TendonLaw  # How tension passes along them
    section: SectionForces | None  # Forces inside the section; None where there are none
    springs: SideSprings | None = None  # From single nodes to ground

    @cached_property
    def columns(self) -> Index:
        """Body-frame unknowns of the nodes with holes; of all where tendons follow the backbone."""
        nodes = np.arange(self.mesh.arc_lengths.size) if self.geometry is None else self.hole_nodes
        return (6 * nodes[:, None] + np.arange(6)).ravel()

    @cached_property
    def cable_nodes(self) -> Index:
        """Backbone nodes through whose disks tendons run as cables, base plate first."""
        if self.geometry is None:
            return self.hole_nodes[:0]
        return self.hole_nodes[: self.geometry.mask.shape[1] + 1]

    def gradient(self, twists: Array, base_tension: Array) -> Array:
        """Gradient of the energy of elements and section forces by the twists, shape (..., E, 6).

        Parameters
        ----------
        twists
            Twists of the elements, shape (..., E, 6).
        base_tension
            Tensions at the base of tendons that follow the backbone [N], shape (..., m).
        """
        found = self.mesh.gradient(twists)
        return found if self.section is None else found + self.section.gradient(twists, base_tension)

    def strain_state(self, twists: Array, base_tension: Array) -> StrainState:
        """Strains, wrenches and stiffness in a configuration; arguments as of `gradient`."""
        lengths, section = self.mesh.lengths, self.section
        stiffness = self.mesh.stiffness[:, 3:, None] * np.eye(3)
        if section is not None and section.material is not None:
            stiffness = np.broadcast_to(stiffness, (*twists.shape[:-1], 3, 3)).copy()
            slopes = section.material.stiffness(*section.material.strain(twists, lengths))
            stiffness[..., 1:, 1:] += slopes[..., 1:, 1:]
        strain, gradient = twists / lengths[:, None], self.gradient(twists, base_tension)
        loaded = strain[..., 3:] - self.mesh.precurvature
        return StrainState(strain, gradient, stiffness, loaded, self.mesh.taper)

    def curvature_rates_change(
        self, twists: Array, base_tension: Array, by_twists: Array, by_tension: Array
    ) -> Array:
        """Derivatives of `StrainState.curvature_rates`, shape (E, 2, 3, P).

        From those of the arguments of `strain_state`, shapes (E, 6, P) and (m, P). The rates in an element follow from
        its own twist and the tensions, so that few differences suffice for any number of parameters.
        """
        count = 6 + len(base_tension)
        h = np.ones((count, len(twists)))
        h[:3], h[3:6] = DIFFERENCE * self.mesh.lengths, DIFFERENCE
        steps = h[:, :, None] * np.eye(count)[:, None]
        beside = [self.strain_state(twists + x[..., :6], base_tension + x[:, 0, 6:]) for x in (steps, -steps)]
        above, below = (state.curvature_rates() for state in beside)
        slopes = (above - below) / (2.0 * h[:, :, None, None])
        by_element = slopes[:6].reshape(6, len(twists), 6).transpose(1, 2, 0) @ by_twists
        change = np.tensordot(slopes[6:], by_tension, (0, 0))
        return np.asarray(by_element.reshape(change.shape) + change)

    def measure(self, positions: Array, rotations: Array, twists: Array | None = None) -> Measurement:
        """Lengths and angles of the tendons in a configuration.

        Parameters
        ----------
        positions, rotations
            Positions and rotations of the nodes, the latter in beam axes; shapes (N, 3) and (N, 3, 3).
        twists
            Twists of the elements, shape (E, 6); None computes them from the poses where they are needed.
        """
        poses = positions, rotations
        if twists is None:
            twists = np.zeros((0, 6)) if self.section is None else relative_twists(*poses)
        if self.geometry is None:
            return Measurement(twists, self._along_the_backbone(twists), poses)
        at_holes = (own[self.hole_nodes] for own in poses)
        return Measurement(twists, self.geometry.evaluate(*at_holes), poses)

    def _along_the_backbone(self, twists: Array) -> CableShape:
        """Lengths of tendons that follow the backbone."""
        assert self.section is not None and self.section.tendons is not None
        length, gradient = self.section.tendons.evaluate(twists, self.section.lengths)
        by_nodes = nodal_sum((gradient[:, :, None, :] @ strain_matrices(twists))[:, :, 0])
        m = length.size
        return CableShape(length[:, None], np.zeros((m, 0)), along=by_nodes.reshape(m, 1, -1))

    def after(
        self, measured: Measurement, base_tension: Array, state: FrictionState, time: float
    ) -> TendonForces:
        """Forces where the mobilisations follow from the configuration and the history.

        Parameters
        ----------
        measured
            The configuration.
        base_tension
            Tension at the base [N], shape (m,).
        state
            History at the beginning of the step.
        time
            At the end of the step [s].
        """
        field = self.law.evaluate(base_tension, measured.shape, state, time)
        return TendonForces(self, measured, base_tension, field)


class SlipEquations(NamedTuple):
    """Derivatives of slips [m] by the nodes, and by what causes them: tensions at the base, then mobilisations."""

    rows: Array  # (m + k, 6 N): By body-frame increments of the nodes
    matrix: Array  # (m + k, m + k): By the tensions at the base, then by the mobilisations of all frictional holes
    columns: Array  # (6 N, m + k): Of the forces on the nodes by the same


@dataclass(eq=False)
class TendonForces:
    """Tensions and section forces in one configuration, with their derivatives.

    Derivatives are by body-frame increments ``[v, w]`` of the nodes.
    """

    model: ForceModel
    measured: Measurement  # The configuration
    base_tension: Array  # (m,): Tension at the base [N]
    field: TensionField  # Tensions along the tendons

    # ------------------------------------------------------------------ tendons

    @cached_property
    def tension_by_holes(self) -> Array:
        """Derivatives of the tensions of the segments by the nodes that carry holes, shape (m, n, W)."""
        return np.asarray(self.field.derivatives.by_shape @ self.measured.shape.by_nodes)

    @cached_property
    def released_by_holes(self) -> Array:
        """Derivatives of the released lengths of the segments by the nodes that carry holes, shape (m, n, W)."""
        f = self.field
        found: Array = f.released_d_length[:, :, None] * self.measured.shape.d_lengths
        if self.model.law.elastic:
            found += f.released_d_tension[:, :, None] * self.tension_by_holes
        return found

    def tendon_change(
        self, nodes: Array, base_tension: Array, mobilisation: Array | None = None
    ) -> tuple[Array, Array]:
        """Linear change of tensions [N] and released lengths [m] of the segments, shape (m, n, P) each.

        Parameters
        ----------
        nodes
            Body-frame increments of all nodes, shape (6 N, P).
        base_tension
            Change of the tensions at the base [N], shape (m, P).
        mobilisation
            Shape (m, g, P); None where they stay.
        """
        field, shape, (m, n) = self.field, self.measured.shape, self.model.law.shape
        moved = nodes[self.model.columns]
        width, count = moved.shape
        changed = (shape.by_nodes.reshape(-1, width) @ moved).reshape(m, 2 * n - 1, count)
        tension = field.d_base[:, :, None] * base_tension[:, None, :] + field.derivatives.by_shape @ changed
        if mobilisation is not None:
            tension = tension + field.by_mobilisation @ mobilisation
        by_length, by_tension = field.released_d_length[:, :, None], field.released_d_tension[:, :, None]
        return tension, by_length * changed[:, :n] + by_tension * tension

    # ------------------------------------------------------------------ slips

    def slip_change(self, nodes: Array, base_tension: Array) -> Array:
        """Change of the slips that drive the mobilisations in a step at fixed mobilisations [m], shape (m, g).

        Parameters
        ----------
        nodes
            Body-frame increments of all nodes, shape (6 N,).
        base_tension
            Change of the tensions at the base [N], shape (m,).
        """
        law = self.model.law
        if law.elastic:
            return law.slips(self.tendon_change(nodes[:, None], base_tension[:, None])[1][..., 0])
        moved = self.measured.shape.length_change(nodes[self.model.columns])
        return law.slips(self.field.released_d_length * moved)

    @property
    def resting_flexibility(self) -> Array:
        """Slope of the slips by the mobilisations of holes that begin to slip either way [m], shape (m, g)."""
        at = self.field.mobilisation
        return self.model.law.hysteresis.flexibility(at, np.zeros_like(at))

    def slip_equations(self, holes: bool = True) -> SlipEquations:
        """Slips of all tendons at the base plate, and with ``holes`` at all frictional holes, linearised."""
        field, law, shape = self.field, self.model.law, self.measured.shape
        m, n = law.shape
        operator, by_unknown = np.ones((1, n)), field.d_base[:, :, None]
        tendon, entry = np.arange(m), np.zeros(m, dtype=int)
        if holes:
            operator = np.concatenate((operator, law.slip_operator))
            by_unknown = np.concatenate((by_unknown, field.by_mobilisation), axis=2)
            at_holes, group = np.nonzero(law.frictional)
            tendon, entry = np.concatenate((tendon, at_holes)), np.concatenate((entry, 1 + group))
        rows = (operator @ self.released_by_holes)[tendon, entry]
        columns = (-by_unknown.swapaxes(1, 2) @ shape.d_lengths)[tendon, entry]
        own = (operator * field.released_d_tension[:, None]) @ by_unknown
        matrix = np.where(tendon[:, None] == tendon, own[tendon[:, None], entry[:, None], entry], 0.0)
        return SlipEquations(self.to_all_nodes(rows), matrix, self.to_all_nodes(columns).T)

    def base_slip_by_base(self) -> Array:
        """Derivative of the slip at the base plate by the tension there [m/N], shape (m,)."""
        return np.einsum("mn,mn->m", self.field.released_d_tension, self.field.d_base)

    # ------------------------------------------------------------------ forces on the nodes

    @cached_property
    def pulls(self) -> Array:
        """See `CableLines.pulls`."""
        return self.measured.shape.lines.pulls(self.field.tension)

    @cached_property
    def section_wrenches(self) -> Array:
        """Wrench ``[f, m]`` of the section forces on every node, in its own frame, shape (N, 6)."""
        assert self.model.section is not None
        return nodal_sum(self.model.section.wrenches(self.measured.twists, self.field.tension[:, 0]))

    @cached_property
    def nodal_wrenches(self) -> Array:
        """Wrench ``[f, m]`` of tendons, section forces and springs on every node, in its own frame, shape (N, 6)."""
        total = np.zeros((self.model.mesh.arc_lengths.size, 6))
        if self.model.geometry is not None:
            total[self.model.cable_nodes] = self.measured.shape.lines.wrenches(self.pulls)
        if self.model.section is not None:
            total += self.section_wrenches
        if self.model.springs is not None:
            np.add.at(total[:, :3], self.model.springs.nodes, self.model.springs.forces(*self.measured.poses))
        return total

    def base_tension_columns(self) -> Array:
        """Derivative of the force on the nodes by the tensions at the base, shape (6 N, m)."""
        return self.to_all_nodes(self.measured.shape.pull_of_each(self.field.d_base)).T

    def add_tangent(self, k: Array, first: int = 0) -> None:
        """Add the derivative of `nodal_wrenches` by the nodes, written in frames that stay, in Exudyn's sign.

        Parameters
        ----------
        k
            By the nodes of all robots, and what follows them; changed in place.
        first
            Number of the first node of this robot among them.
        """
        if self.model.geometry is not None:
            geometric = self.measured.shape.lines.stiffness(self.field.tension, self.pulls)
            geometric.add_to(k, first + self.model.cable_nodes)
        inside = slice(6 * first, 6 * (first + self.model.mesh.arc_lengths.size))
        own, springs = k[inside, inside], self.model.springs
        if len(self.base_tension) or self.model.section is not None:
            self.add_coupling(own)
        if springs is not None:
            for node, block in zip(springs.nodes, springs.blocks(self.measured.poses[1]), strict=True):
                own[6 * node : 6 * node + 3, 6 * node : 6 * node + 3] -= block

    def add_coupling(self, k: Array) -> None:
        """Add the change of the tensions with the configuration, and the tangent of section forces.

        Parameters
        ----------
        k
            Changed in place, shape (6 N, 6 N).
        """
        change = self.tension_by_holes
        if self.model.geometry is None:
            k -= self.measured.shape.d_lengths[:, 0].T @ change[:, 0]
        else:
            pull = self.measured.shape.lines.softening(change)
            pull = pull.reshape(-1, pull.shape[-1])
            k[np.ix_(self.model.columns[: len(pull)], self.model.columns)] += pull
        if self.model.section is not None:
            # Derivatives of the section forces by the twists, and by the frames in which they are expressed.
            blocks = self.model.section.wrench_tangent(self.measured.twists, self.field.tension[:, 0])
            add_element_tangent(k, blocks, self.section_wrenches)

    def to_all_nodes(self, rows: Array) -> Array:
        """Rows by the nodes with holes as rows by all nodes, shape (k, W) to (k, 6 N)."""
        full = np.zeros((len(rows), 6 * self.model.mesh.arc_lengths.size))
        full[:, self.model.columns] = rows
        return full
