"""Derivatives of cables: of their shape and forces by the nodes and the holes, twice where needed.

Right sides are the last axis. Holes are laid out by node first, ``(n + 1, 3, m, P)``, because all tendons have hole
``k`` on node ``k``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.capstan import capstan, capstan_with_adhesion
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.friction import FrictionState
from tdcr_fe.elements.tendons import CableGeometry
from tdcr_fe.solve.equations.robot_model import LawStack, LawValues, RobotModel, RobotPoint, acting_parameters
from tdcr_fe.solve.sensitivities.differences import RELATIVE_STEP, Inherited, ParameterModels

Array = NDArray[np.float64]


class CableVariation(NamedTuple):
    """Change of the tendons as their holes move, at fixed poses and tensions."""

    lengths: Array  # (m, n, P): [m]
    angles: Array  # (m, n-1, P): [rad]
    wrenches: Array  # (n+1, 6, P): On the nodes with holes, in their own frames [N, N m]


def _cross(a: Array, b: Array) -> Array:
    """Cross product along the second axis."""
    return np.stack(
        (
            a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1],
            a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2],
            a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0],
        ),
        axis=1,
    )


def _turned(rotations: Array, vectors: Array) -> Array:
    """Vectors (n+1, 3, ...) turned by one rotation a node."""
    flat = vectors.reshape(*vectors.shape[:2], -1)
    return (rotations @ flat).reshape(vectors.shape)


def by_node(values: Array) -> Array:
    """From (m, k, 3, ...) to (k, 3, m, ...)."""
    return np.moveaxis(values, 0, 2)


def cable_variation(own: TendonForces, rotations: Array, offsets: Array) -> CableVariation:
    """Change of the tendons as their holes move in the frames of the disks.

    Parameters
    ----------
    own
        Tensions in the present configuration.
    rotations
        Of all nodes, in beam axes, shape (N, 3, 3).
    offsets
        Change of the holes' positions [m], shape (n+1, 3, m, P).
    """
    shape, geometry = own.measured.shape, own.model.geometry
    assert geometry is not None
    frames = rotations[own.model.cable_nodes]
    e = by_node(shape.lines.directions)[..., None]
    exists = geometry.mask.T
    inverse = np.where(exists, 1.0 / np.where(exists, shape.lengths.T, 1.0), 0.0)[:, None, :, None]
    moved = _turned(frames, offsets)
    apart = moved[1:] - moved[:-1]
    lengths = (e * apart).sum(axis=1)
    turned = (apart - e * lengths[:, None]) * inverse
    sine = np.sin(shape.angles.T)
    weight = (sine / (sine**2 + 1e-24))[..., None]
    angles = ((e[1:] - e[:-1]) * (turned[1:] - turned[:-1])).sum(axis=1) * weight
    pulled = own.field.tension.T[:, None, :, None] * turned
    force = np.zeros_like(moved)
    force[:-1] = pulled
    force[1:] -= pulled
    back = frames.swapaxes(1, 2)
    force = _turned(back, force)
    present = _turned(back, by_node(shape.lines.pulls(own.field.tension)))[..., None]
    arm = by_node(geometry.offsets if own.measured.offsets is None else own.measured.offsets)[..., None]
    moment = _cross(arm, force) + _cross(offsets, present)
    wrenches = np.concatenate((force.sum(axis=2), moment.sum(axis=2)), axis=1)
    return CableVariation(lengths.transpose(1, 0, 2), angles.transpose(1, 0, 2), wrenches)


class HoleDisturbance(NamedTuple):
    """What moving the holes does at fixed poses, tensions at the base and mobilisations."""

    wrenches: Array  # (6 N, P): On all nodes, in their own frames [N, N m]
    tension: Array  # (m, n, P): Tensions [N] and released lengths [m] of the segments
    released: Array  # as `tension`


def hole_disturbance(
    own: TendonForces,
    rotations: Array,
    offsets: Array,
    which: NDArray[np.int_] | slice,
    tension: Array,
    released: Array,
) -> HoleDisturbance:
    """Forces and tendons as holes move and laws change.

    Parameters
    ----------
    own
        Tensions in the present configuration.
    rotations
        Of all nodes, in beam axes, shape (N, 3, 3).
    offsets
        Change of the holes' positions in the frames of the disks [m], shape (n+1, 3, m, P').
    which
        Right sides for which the holes move.
    tension, released
        Changes at the same lengths and angles, as from a law, shape (m, n, P); changed in place.
    """
    field, shape, count = own.field, own.measured.shape, tension.shape[-1]
    wrenches = np.zeros((len(rotations), 6, count))
    if offsets.shape[-1]:
        moved = cable_variation(own, rotations, offsets)
        change = field.d_angle @ moved.angles
        if field.depends_on_length:
            change += field.d_length @ moved.lengths
        released[:, :, which] += (
            field.released_d_length[:, :, None] * moved.lengths
            + field.released_d_tension[:, :, None] * change
        )
        tension[:, :, which] += change
        on_disks = np.zeros((len(own.model.cable_nodes), 6, count))
        on_disks[:, :, which] = moved.wrenches
        wrenches[own.model.cable_nodes] = on_disks
    if tension.any():
        flat = tension.reshape(-1, count)
        pulled = shape.d_lengths.reshape(len(flat), -1).T @ flat
        wrenches[own.model.hole_nodes] -= pulled.reshape(-1, 6, count)
    return HoleDisturbance(wrenches.reshape(-1, count), tension, released)


def shift_variation(
    geometry: CableGeometry, positions: Array, rotations: Array, nodes: Array, holes: Array, clearance: Array
) -> Array:
    """Change of the tendons' places in oversized holes, see `CableGeometry.shift_in_holes`.

    Parameters
    ----------
    geometry
        Of the tendons.
    positions, rotations
        Of the nodes that tendons run through, shapes (n+1, 3) and (n+1, 3, 3).
    nodes
        Body-frame increments of these nodes, shape (n+1, 6, P).
    holes
        Change of the middles of the holes in the frames of the disks [m], shape (n+1, 3, m, P).
    clearance
        Change of the clearances [m], shape (m, P).

    Returns
    -------
    ndarray, shape (n+1, 3, m, P)
        Change of `CableGeometry.offsets` [m].
    """
    nominal = by_node(geometry.nominal)
    present = np.zeros(len(geometry.nominal)) if geometry.clearance is None else geometry.clearance
    back = rotations.swapaxes(1, 2)
    middle = positions[:, :, None] + _turned(rotations, nominal)
    d = np.diff(middle, axis=0)
    length = np.sqrt((d * d).sum(axis=1, keepdims=True))
    inverse = np.where(length > 0.0, 1.0 / np.where(length > 0.0, length, 1.0), 0.0)
    e = d * inverse
    pull = np.zeros_like(middle)
    pull[:-1] += e
    pull[1:] -= e
    pull[0] -= rotations[0, :, 0][:, None]
    local = _turned(back, pull)
    turn = nodes[:, 3:, None, :]
    moved = _turned(rotations, nodes[:, :3, None, :] + _cross(turn, nominal[..., None]) + holes)
    apart = np.diff(moved, axis=0)
    along = (e[..., None] * apart).sum(axis=1, keepdims=True)
    turned = (apart - e[..., None] * along) * inverse[..., None]
    change = np.zeros_like(moved)
    change[:-1] += turned
    change[1:] -= turned
    axis = np.zeros((1, 3, 1, 1))
    axis[0, 0] = 1.0
    change[:1] -= _turned(rotations[:1], _cross(turn[:1], axis) + np.zeros_like(change[:1]))
    change = _turned(back, change) - _cross(turn, local[..., None])
    local[:, 0], change[:, 0] = 0.0, 0.0
    size = np.sqrt((local * local).sum(axis=1, keepdims=True) + geometry.CLEARANCE_ANGLE**2)
    unit = (local / size)[..., None]
    scaled = (change - unit * (unit * change).sum(axis=1, keepdims=True)) / size[..., None]
    inner = np.ones((len(nominal), 1, nominal.shape[2], 1))
    inner[1:-1, 0, :, 0] = geometry.mask[:, 1:].T
    inner[-1] = 0.0
    shift = present[:, None] * scaled + unit * clearance
    return np.asarray(holes + inner * shift)


class CableDerivatives:
    """Explicit derivatives of the straight tendons of one robot.

    Parameters
    ----------
    models
        At the present and at neighbouring values.

    Attributes
    ----------
    law : FrictionModel
        Of the friction in the models; where the present one has none, that of the neighbours.
    depends_on_history : bool
        Whether the tensions depend on the slips at the beginning of the increment, as with rates of slip.
    """

    def __init__(self, models: ParameterModels) -> None:
        self.present, self.count = models.present, models.count
        own = models.present.forces
        self.depends_on_history = own.law.law.active and any(x is not None for x in own.law.parameters.laws)
        self._holes = models.where(_holes_differ)
        self._lengths = models.where(_lengths_differ)
        self._laws = models.where(_laws_differ)
        slips, mask = own.law.slip_operator, own.law.parameters.mask
        #: From slips to released lengths of the segments that a tendon has, shape (m, n, g).
        self._released_by_slip = np.stack([np.linalg.pinv(slips * exists) for exists in mask])
        self._law_stack = LawStack([m.forces.law for m in self._laws.models])
        self.law = self._law_stack.law.law
        geometries = [m.forces.geometry for m in self._holes.models]
        self._by_nominal = self._holes.derivative(
            np.stack([by_node(g.nominal) for g in geometries if g is not None])
        )
        self._by_clearance = self._holes.derivative(
            np.array([[t.clearance for t in m.robot.tendons] for m in self._holes.models])
        )
        self._by_unloaded = self._lengths.derivative(
            np.stack([m.forces.law.parameters.material for m in self._lengths.models])
        )
        acting = [acting_parameters(m.forces.law) for m in self._laws.models]
        #: Whether coefficients of friction are numbers in all models.
        self._constant = not any(law is not None for p in acting for law in p.laws)
        self._law_lengths = np.stack([p.material for p in acting])
        self._by_friction = self._laws.derivative(np.stack([p.friction for p in acting]))
        self._by_adhesion = self._laws.derivative(np.stack([p.adhesion for p in acting]))
        self._by_compliance = self._laws.derivative(np.stack([p.compliance for p in acting]))

    def at(
        self, own: TendonForces, point: RobotPoint, mobilisation: Array, inherited: Inherited
    ) -> HoleDisturbance:
        """Derivatives at a point; arguments as of `tdcr_fe.solve.sensitivities.explicit.ExplicitDerivatives.at`."""
        m, n = self.present.forces.law.shape
        tension, released = np.zeros((m, n, self.count)), np.zeros((m, n, self.count))
        which = self._laws.parameters
        if len(which):
            change = (
                self._by_constants(own, mobilisation)
                if self._constant
                else self._by_laws(own, point, mobilisation)
            )
            tension[:, :, which] += change.tension
            released[:, :, which] += change.released
        if self.depends_on_history:
            change_of_rates = self._by_slip_rates(own, point, mobilisation, inherited)
            tension += change_of_rates
            released += own.field.released_d_tension[:, :, None] * change_of_rates
        if len(self._lengths.parameters):
            released[:, :, self._lengths.parameters] += self._by_unloaded
        offsets = self._moved_holes(own, point)
        return hole_disturbance(own, point.rotations, offsets, self._holes.parameters, tension, released)

    def _moved_holes(self, own: TendonForces, point: RobotPoint) -> Array:
        """Derivatives of the holes' positions, tendons shifted in them, shape (n+1, 3, m, P')."""
        geometry = own.model.geometry
        assert geometry is not None
        # Without clearance, tendons shift only by the parameters that give them some.
        which = slice(None) if geometry.clearance is not None else self._by_clearance.any(axis=0)
        nodes, nominal = own.model.cable_nodes, self._by_nominal[..., which]
        if not nominal.shape[-1]:
            return self._by_nominal
        moved = self._by_nominal.copy()
        moved[..., which] = shift_variation(
            geometry,
            point.positions[nodes],
            point.rotations[nodes],
            np.zeros((len(nodes), 6, nominal.shape[-1])),
            nominal,
            self._by_clearance[:, which],
        )
        return moved

    def _by_constants(self, own: TendonForces, mobilisation: Array) -> LawValues:
        """Derivatives by constant coefficients of friction, adhesion and compliance, shapes (m, n, P')."""
        shape, field, parameters = own.measured.shape, own.field, acting_parameters(self.present.forces.law)
        angles, friction = shape.angles, parameters.friction
        s = self._law_stack.law.at_holes(mobilisation)
        if parameters.adhesion.any():
            _, slopes = capstan_with_adhesion(own.base_tension, angles, s, friction, parameters.adhesion)
        else:
            _, slopes = capstan(own.base_tension, angles, s, friction)
        at_hole = slopes()
        chain = at_hole.chain()
        # Adhesion takes its drop before the hole where the tendon is released, and behind it where it is pulled.
        drop = -s * np.where(s < 0.0, np.exp(-s * friction * angles), field.tension[:, 1:] > 0.0)
        here = at_hole.by_coefficient()[:, :, None] * self._by_friction + drop[:, :, None] * self._by_adhesion
        tension = chain[:, :, 1:] @ here
        stretch = 1.0 + parameters.compliance[:, None] * field.tension
        longer = parameters.mask * shape.lengths * field.tension / stretch**2
        released = longer[:, :, None] * self._by_compliance[:, None]
        released += field.released_d_tension[:, :, None] * tension
        return LawValues(tension, released)

    def _by_laws(self, own: TendonForces, point: RobotPoint, mobilisation: Array) -> LawValues:
        """The same where coefficients follow laws, from values at neighbouring parameters."""
        history = _repeated(point.history, len(self._laws.models)) if self.depends_on_history else None
        values = self._law_stack.at(own.measured.shape, point.base_tension, mobilisation, history, point.time)
        # Unloaded lengths are treated apart.
        return LawValues(
            self._laws.derivative(values.tension), self._laws.derivative(values.released - self._law_lengths)
        )

    def _by_slip_rates(
        self, own: TendonForces, point: RobotPoint, mobilisation: Array, inherited: Inherited
    ) -> Array:
        """Derivatives of the tensions through the rates of the slips at fixed lengths, shape (m, n, P).

        The rates are the slips since the beginning of the increment over its duration. What changes them acts like
        released lengths, and those act through the derivative by the lengths of the segments. Differences of a
        parameter would have to be small against the slip at which a law's coefficient falls, which no parameter knows.
        """
        field = own.field
        if point.time <= point.history.time:
            return self._by_kept_rates(own, point, mobilisation, inherited.slip_rate)
        change = np.zeros((*field.tension.shape, self.count))
        if not field.depends_on_length or field.slip_rate is None:
            return change
        before = inherited.slip + field.slip_rate[:, :, None] * inherited.elapsed
        pulled = -self._released_by_slip @ before
        # Where a law itself differs, its values have the lengths of its own model.
        apart = ~np.isin(self._lengths.parameters, self._laws.parameters)
        pulled[:, :, self._lengths.parameters[apart]] += self._by_unloaded[:, :, apart]
        by_length = field.released_d_length[:, :, None]
        np.divide(pulled, by_length, out=change, where=by_length != 0.0)
        return np.asarray(field.d_length @ change)

    def _by_kept_rates(
        self, own: TendonForces, point: RobotPoint, mobilisation: Array, change: Array
    ) -> Array:
        """The same where no time passes, so that the rates of the history stay, from differences."""
        history, found = point.history, np.zeros((*own.field.tension.shape, self.count))
        which = np.flatnonzero(change.any(axis=(0, 1)))
        if history.slip_rate is None or not which.size or not history.slip_rate.any():
            return found
        present, moved = np.abs(history.slip_rate).max(axis=1), np.abs(change[:, :, which]).max(axis=1)
        moves = (present[:, None] > 0.0) & (moved > 0.0)
        ratios = np.where(moves, present[:, None] / np.where(moves, moved, 1.0), np.inf).min(axis=0)
        which, ratios = which[np.isfinite(ratios)], ratios[np.isfinite(ratios)]
        steps = RELATIVE_STEP * ratios
        shift = np.moveaxis(change[:, :, which] * steps, -1, 0)
        rates = np.concatenate((history.slip_rate + shift, history.slip_rate - shift))
        repeated = replace(_repeated(history, len(rates)), slip_rate=rates.reshape(-1, rates.shape[-1]))
        stack = LawStack([self.present.forces.law] * len(rates))
        values = stack.at(own.measured.shape, point.base_tension, mobilisation, repeated, point.time).tension
        more, less = np.split(values, 2)
        found[:, :, which] = np.moveaxis(more - less, 0, -1) / (2.0 * steps)
        return found


def _repeated(history: FrictionState, count: int) -> FrictionState:
    """Histories of as many models, one after the other."""
    rate = np.zeros_like(history.slip) if history.slip_rate is None else history.slip_rate
    each = (count, 1)
    return FrictionState(
        np.tile(history.slip, each), np.tile(history.mobilisation, each), np.tile(rate, each), history.time
    )


def _holes_differ(a: RobotModel, b: RobotModel) -> bool:
    first, second = a.forces.geometry, b.forces.geometry
    assert first is not None and second is not None
    clearances = [[t.clearance for t in x.robot.tendons] for x in (a, b)]
    return clearances[0] != clearances[1] or not np.array_equal(first.nominal, second.nominal)


def _lengths_differ(a: RobotModel, b: RobotModel) -> bool:
    return not np.array_equal(a.forces.law.parameters.material, b.forces.law.parameters.material)


def _laws_differ(a: RobotModel, b: RobotModel) -> bool:
    first, second = a.forces.law, b.forces.law
    if first is second:
        return False
    if first.law.active != second.law.active:
        return True
    p, q = first.parameters, second.parameters
    return not (
        tuple(p.laws) == tuple(q.laws)
        and np.array_equal(p.friction, q.friction)
        and np.array_equal(p.adhesion, q.adhesion)
        and np.array_equal(p.compliance, q.compliance)
    )
