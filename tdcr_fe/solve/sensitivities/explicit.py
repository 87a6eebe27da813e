"""Explicit derivatives of a robot's equations by parameters: poses, base tensions and mobilisations are kept.

The models at neighbouring values of every parameter are built once. Their differences are the derivatives of
stiffness, weight, holes and unloaded lengths, by which the forces at a state are differentiated in closed form; laws of
the tendons and of the section are evaluated at the neighbouring values.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.solve.equations.robot_model import RobotModel, RobotPoint, SectionStack, elastic_gradient
from tdcr_fe.solve.sensitivities.cables import CableDerivatives, HoleDisturbance
from tdcr_fe.solve.sensitivities.differences import RELATIVE_STEP, Inherited, ParameterModels

Array = NDArray[np.float64]


class ExplicitDerivatives:
    """Explicit derivatives of one robot's equations.

    Parameters
    ----------
    models
        At the present and at neighbouring values.

    Attributes
    ----------
    law : FrictionModel
        Of the friction in the models; where the present one has none, that of the neighbours.
    arc_lengths : ndarray, shape (n, P)
        Derivatives of the arc lengths of the nodes [m].
    """

    def __init__(self, models: ParameterModels) -> None:
        present, count = models.present, models.count
        self.present, self.count = present, count
        own = present.forces
        self._elastic = models.where(_elasticity_differs)
        self._weight = models.where(lambda a, b: not np.array_equal(a.weight, b.weight))
        self._springs = models.where(_springs_differ)
        self._section = models.where(_section_differs)
        self._section_stack = SectionStack(self._section.models) if len(self._section.parameters) else None
        straight = own.geometry is not None and own.law.shape[0] > 0
        self._cables = CableDerivatives(models) if straight else None
        self.law = own.law.law if self._cables is None else self._cables.law
        self._creeps = any(m.robot.backbone.creep_rate != 0.0 for m in self._elastic.models)
        self._by_weight = self._weight.derivative(np.stack([m.weight for m in self._weight.models]))
        self._coefficients = self._elastic_coefficients(0.0)
        self.arc_lengths = np.zeros((own.mesh.arc_lengths.size, count))
        for each in models.neighbours:
            arcs = [m.forces.mesh.arc_lengths for m in (present, *each.models)]
            weights = (each.stencil.base_weight, *each.stencil.weights)
            self.arc_lengths[:, each.number] = sum(w * x for w, x in zip(weights, arcs, strict=True))
        self._unloaded = models.where(_released_unloaded_differ)

    def _elastic_coefficients(self, time: float) -> tuple[Array, Array]:
        """Derivatives of stiffness over length, and of its product with the unloaded twists, (E, 6, P')."""
        slopes, loads = [], []
        for model in self._elastic.models:
            mesh = model.forces.mesh
            slope = model.stiffness(time) / mesh.lengths[:, None]
            slopes.append(slope)
            loads.append(slope * mesh.reference_twists)
        return self._elastic.derivative(np.stack(slopes)), self._elastic.derivative(np.stack(loads))

    def released_unloaded(self) -> Array:
        """Derivatives of the released lengths in the unloaded shape without tension, shape (m, n, P)."""
        found = np.zeros((*self.present.forces.law.shape, self.count))
        values = np.stack([m.forces.law.released_unloaded() for m in self._unloaded.models])
        found[:, :, self._unloaded.parameters] = self._unloaded.derivative(values)
        return found

    def at(
        self, own: TendonForces, point: RobotPoint, mobilisation: Array, inherited: Inherited
    ) -> HoleDisturbance:
        """Derivatives at a point by all parameters, which are the last axis.

        Parameters
        ----------
        own
            Forces there.
        point
            Poses, tensions at the base and history.
        mobilisation
            Of the holes, also of those whose friction only acts at neighbouring values, shape (m, g).
        inherited
            Derivatives of history and time; used where the equations depend on them.
        """
        nodes, (m, n) = len(point.positions), self.present.forces.law.shape
        wrenches = np.zeros((nodes, 6, self.count))
        released = np.zeros((m, n, self.count))
        by_twist = self._section_gradient(point, released, inherited.time)
        if by_twist is not None:
            ends = point.strain_matrices.swapaxes(1, 2) @ by_twist
            wrenches[:-1] -= ends[:, :6]
            wrenches[1:] -= ends[:, 6:]
        if len(self._springs.parameters):
            forces = np.stack([_spring_forces(m, point) for m in self._springs.models])
            wrenches[:, :3, self._springs.parameters] += self._springs.derivative(forces)
        if len(self._weight.parameters):
            wrenches[:, :3, self._weight.parameters] += point.rotations.swapaxes(1, 2) @ self._by_weight
        flat = wrenches.reshape(6 * nodes, -1)
        if self._cables is None:
            return HoleDisturbance(flat, np.zeros((m, n, self.count)), released)
        found = self._cables.at(own, point, mobilisation, inherited)
        return found._replace(wrenches=found.wrenches + flat)

    def _section_gradient(self, point: RobotPoint, released: Array, time: Array) -> Array | None:
        """Derivatives of the energy's gradient by the twists, shape (E, 6, P); None where there are none."""
        creeps = self.present.robot.backbone.creep_rate != 0.0 and bool(time.any())
        if not (len(self._elastic.parameters) or self._section_stack is not None or creeps):
            return None
        by_twist = np.zeros((len(point.twists), 6, self.count))
        if len(self._elastic.parameters):
            slope, load = self._elastic_coefficients(point.time) if self._creeps else self._coefficients
            by_twist[:, :, self._elastic.parameters] += slope * point.twists[:, :, None] - load
        if self._section_stack is not None:
            gradient, lengths = self._section_stack.at(point)
            by_twist[:, :, self._section.parameters] += self._section.derivative(gradient)
            if self._section_stack.has_tendons:
                laws = [x.forces.law.parameters for x in self._section.models]
                unloaded = np.stack([p.material[:, 0] for p in laws])
                stretch = 1.0 + np.stack([p.compliance for p in laws]) * point.base_tension
                released[:, 0, self._section.parameters] = self._section.derivative(
                    unloaded - lengths / stretch
                )
        if creeps:
            by_twist += self._softening(point)[:, :, None] * time
        return by_twist

    def _softening(self, point: RobotPoint) -> Array:
        """Derivative of the energy's gradient by the time, as the backbone creeps, shape (E, 6)."""
        step = RELATIVE_STEP / self.present.robot.backbone.creep_rate
        found = []
        for time in (point.time + step, point.time - step):
            gradient = elastic_gradient(self.present, point.twists, time)
            section = self.present.section(time)
            if section is not None and section.material:
                gradient = gradient + section.material_gradient(point.twists)
            found.append(gradient)
        return np.asarray((found[0] - found[1]) / (2.0 * step))


def _released_unloaded_differ(a: RobotModel, b: RobotModel) -> bool:
    first, second = a.forces.law, b.forces.law
    return first is not second and not np.array_equal(first.released_unloaded(), second.released_unloaded())


def _spring_forces(model: RobotModel, point: RobotPoint) -> Array:
    """Forces of the springs to ground on all nodes, in their own frames [N], shape (N, 3)."""
    found = np.zeros((len(point.positions), 3))
    springs = model.forces.springs
    if springs is not None:
        np.add.at(found, springs.nodes, springs.forces(point.positions, point.rotations))
    return found


def _springs_differ(a: RobotModel, b: RobotModel) -> bool:
    first, second = a.forces.springs, b.forces.springs
    if first is None or second is None:
        return first is not second
    return not (
        np.array_equal(first.nodes, second.nodes)
        and np.array_equal(first.stiffness, second.stiffness)
        and np.array_equal(first.rest, second.rest)
    )


def _elasticity_differs(a: RobotModel, b: RobotModel) -> bool:
    if a.robot.backbone.creep_rate != b.robot.backbone.creep_rate:
        return True
    first, second = a.forces.mesh, b.forces.mesh
    return first is not second and not (
        np.array_equal(first.stiffness, second.stiffness)
        and np.array_equal(first.lengths, second.lengths)
        and np.array_equal(first.precurvature, second.precurvature)
    )


def _section_differs(a: RobotModel, b: RobotModel) -> bool:
    first, second = a.forces.section, b.forces.section
    if first is None and second is None:
        return False
    if first is None or second is None:
        return True
    if (first.material or second.material) and (
        _elasticity_differs(a, b)
        or a.robot.backbone.superelastic != b.robot.backbone.superelastic
        or a.robot.backbone.nonlinear != b.robot.backbone.nonlinear
        or a.robot.backbone.radius != b.robot.backbone.radius
        or a.robot.backbone.taper != b.robot.backbone.taper
    ):
        return True
    s, t = first.tendons, second.tendons
    return (
        s is not None
        and t is not None
        and a.forces is not b.forces
        and not (
            np.array_equal(s.offset, t.offset)
            and np.array_equal(s.slope, t.slope)
            and np.array_equal(first.lengths, second.lengths)
            and np.array_equal(a.forces.law.parameters.material, b.forces.law.parameters.material)
            and np.array_equal(a.forces.law.parameters.compliance, b.forces.law.parameters.compliance)
        )
    )
