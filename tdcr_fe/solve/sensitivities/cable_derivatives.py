"""Explicit derivatives of straight tendons by parameters: holes, unloaded lengths, friction, adhesion, compliance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.capstan import capstan, capstan_with_adhesion
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.friction import FrictionState
from tdcr_fe.solve.equations.robot_model import LawStack, LawValues, RobotModel, RobotPoint, acting_parameters
from tdcr_fe.solve.sensitivities.cable_variation import (
    HoleDisturbance,
    by_node,
    hole_disturbance,
    shift_variation,
)
from tdcr_fe.solve.sensitivities.neighbours import Inherited, ParameterModels
from tdcr_fe.solve.sensitivities.stencils import RELATIVE_STEP

Array = NDArray[np.float64]


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
        always = self.depends_on_history
        self._laws = models.where(lambda a, b: always or _laws_differ(a, b))
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
                else self._by_laws(own, point, mobilisation, inherited)
            )
            tension[:, :, which] += change.tension
            released[:, :, which] += change.released
        if self.depends_on_history and inherited.elapsed.any() and point.time > point.history.time:
            change = self._by_duration(own, point, mobilisation)
            tension += change.tension * inherited.elapsed
            released += change.released * inherited.elapsed
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

    def _by_laws(
        self, own: TendonForces, point: RobotPoint, mobilisation: Array, inherited: Inherited
    ) -> LawValues:
        """The same where coefficients follow laws, from values at neighbouring parameters and histories."""
        values = self._law_stack.at(
            own.measured.shape,
            point.base_tension,
            mobilisation,
            self._histories(point, inherited),
            point.time,
        )
        # Unloaded lengths are treated apart.
        return LawValues(
            self._laws.derivative(values.tension),
            self._laws.derivative(values.released - self._law_lengths),
        )

    def _by_duration(self, own: TendonForces, point: RobotPoint, mobilisation: Array) -> LawValues:
        """Derivatives by the duration of the increment, shapes (m, n, 1)."""
        step = RELATIVE_STEP * (point.time - point.history.time)
        law = LawStack([self.present.forces.law])
        late, early = (
            law.at(own.measured.shape, point.base_tension, mobilisation, point.history, point.time + x)
            for x in (step, -step)
        )
        return LawValues(*((a - b)[0][:, :, None] / (2.0 * step) for a, b in zip(late, early, strict=True)))

    def _histories(self, point: RobotPoint, inherited: Inherited) -> FrictionState | None:
        """Histories of all models one after the other; None where they do not matter."""
        stack = self._laws
        if not self.depends_on_history:
            return None
        history = point.history

        def shifted(values: Array, by_parameter: Array) -> Array:
            moved = values + stack.offsets[:, None, None] * np.moveaxis(by_parameter, -1, 0)[stack.owner]
            return np.asarray(moved.reshape(-1, values.shape[1]))

        rate = np.zeros_like(history.slip) if history.slip_rate is None else history.slip_rate
        return FrictionState(
            shifted(history.slip, inherited.slip),
            np.tile(history.mobilisation, (len(stack.models), 1)),
            shifted(rate, inherited.slip_rate),
            history.time,
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
