"""Derivatives of a robot's forces and slips by parameters at a fixed state, as differences between neighbouring models.

Poses, tensions at the base and mobilisations are kept. The models at neighbouring values are built once; nothing is
known of what a parameter means. All are evaluated at once, the tendons of all models as if they were so many tendons of
one robot. The forces are those of `tdcr_fe.solve.equations.system.SceneSystem.residual`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from tdcr_fe.effects import Experiment
from tdcr_fe.elements import Array, Flags, Index
from tdcr_fe.elements.backbone import BEAM_TO_SECTION, strain_matrices
from tdcr_fe.elements.forces import ForceModel, StrainState, TendonForces
from tdcr_fe.elements.friction import TendonLaw, TendonParameters
from tdcr_fe.elements.hysteresis import FrictionState
from tdcr_fe.elements.section_forces import SectionForces
from tdcr_fe.elements.tendons import CableGeometry, CableShape
from tdcr_fe.scene.base import BasePose
from tdcr_fe.scene.energy import Masses
from tdcr_fe.scene.forces import force_model
from tdcr_fe.scene.handle import TDCR
from tdcr_fe.scene.mesh import build_mesh, elements_of_bays, softened
from tdcr_fe.solve.sensitivities.differences import Stencil, StructureChanged, stencil
from tdcr_fe.solve.sensitivities.parameters import ModelParameter, Parameter


@dataclass(frozen=True, eq=False)
class RobotModel:
    """A robot as arrays."""

    experiment: Experiment  # What it was made from, with a number of elements for every bay
    base: BasePose | None  # Pose of the base plate in the world; None: at the origin
    forces: ForceModel  # Mesh, tendons, laws and section forces
    rigid: Flags  # (E,): Which elements are rigid inserts
    weight: Array  # (N, 3): Weight on every node, world axes [N]

    @classmethod
    def of(cls, handle: TDCR, experiment: Experiment) -> RobotModel:
        """The robot of a scene, whose backbone has not crept yet, as this experiment describes it."""
        counts, clamp = elements_of_bays(handle.robot, handle.model), handle.actuation.clamp
        base = None if clamp is None else BasePose(clamp.position, clamp.rotation @ BEAM_TO_SECTION.T)
        experiment = replace(experiment, model=replace(experiment.model, elements_per_bay=counts))
        weight = Masses.of(handle.robot, handle.mesh, handle.model.gravity).weights()
        return cls(experiment, base, handle.actuation.model, handle.rigid, weight)

    def beside(self, experiment: Experiment) -> RobotModel:
        """Model of a neighbouring description, with as many elements in every bay; this one where it is the same."""
        own, robot = self.experiment, experiment.robot
        model = replace(experiment.model, elements_per_bay=own.model.elements_per_bay)
        experiment = replace(experiment, model=model)
        mesh, rigid, same = self.forces.mesh, self.rigid, _same_mesh(own, experiment)
        if robot is own.robot and model == own.model and same:
            return self
        if not same:
            mesh, rigid = build_mesh(robot, model, load_positions(experiment))
        forces = force_model(robot, model, mesh, rigid, self.forces.law.hysteresis, self.base)
        if same and robot.tendons == own.robot.tendons:
            forces = replace(forces, section=self.forces.section)
        weight = Masses.of(robot, mesh, model.gravity).weights()
        return RobotModel(experiment, self.base, forces, rigid, weight)

    def forces_at(self, time: float) -> ForceModel:
        """Mesh, tendons and laws at a time [s]."""
        forces, backbone = self.forces, self.experiment.robot.backbone
        if backbone.creep_rate != 0.0:
            forces = softened(forces, forces.mesh, self.rigid, backbone.compliance_factor(time))
        return forces


def load_positions(experiment: Experiment) -> list[float]:
    """Arc lengths of all loads [m], ascending."""
    return sorted({float(load.at) for step in experiment.steps for load in step.loads.values()})


def _same_mesh(a: Experiment, b: Experiment) -> bool:
    """Whether two descriptions have the same mesh."""

    def source(e: Experiment) -> tuple[Any, ...]:
        springs = [x.at for x in e.robot.springs]
        return e.robot.backbone, e.robot.disks, springs, e.robot.base_stiffness, e.model.elements_per_bay

    return source(a) == source(b) and (a.steps is b.steps or load_positions(a) == load_positions(b))


class Values(NamedTuple):
    """Forces of a robot in one state: of every model of a stack, or, parameters being the last axis, derivatives."""

    # (S, N, 6): On the nodes, in their own frames [N, N m]; (S, n+1, 6) where only tendons act
    wrenches: Array
    tension: Array  # (S, m, n): Tensions of the segments [N]
    released: Array  # (S, m, n): Released lengths of the segments [m]


@dataclass(frozen=True, eq=False)
class TendonStack:
    """Tendons of several models of one robot, evaluated as if they were so many tendons."""

    size: int  # Number S of models
    law: TendonLaw  # Law of all tendons, with friction where one of the models has it
    geometry: CableGeometry | None  # None where they follow the backbone
    sections: tuple[SectionForces | None, ...]

    @classmethod
    def of(cls, models: Sequence[ForceModel]) -> TendonStack:
        """The tendons of models with the same numbers of tendons and holes."""
        laws, geometry = [m.law for m in models], None
        if geometries := [m.geometry for m in models if m.geometry is not None]:
            tables = ("nominal", "mask", "clearance")
            geometry = CableGeometry(*(np.concatenate([getattr(g, x) for g in geometries]) for x in tables))
        return cls(len(models), _joined_law(laws), geometry, tuple(m.section for m in models))

    @classmethod
    def with_offsets(cls, model: ForceModel, offsets: Array) -> TendonStack:
        """One model with other places of the tendons in the frames of the disks [m], shape (S, m, n+1, 3)."""
        size, own = len(offsets), model.geometry
        assert own is not None
        geometry = CableGeometry(offsets.reshape(-1, *offsets.shape[2:]), np.tile(own.mask, (size, 1)))
        return cls(size, _joined_law([model.law] * size), geometry, ())

    def at(self, own: TendonForces, mobilisation: Array, rates: Array) -> Values:
        """Forces in a state.

        Parameters
        ----------
        own
            Forces of the present model there.
        mobilisation
            Shape (m, g).
        rates
            Rates of the slips [m/s], shape (S, m, g).
        """
        size, m, shape = self.size, len(own.base_tension), self._shape(own)
        mobilisation, base = np.tile(mobilisation, (size, 1)), np.tile(own.base_tension, size)
        rates = rates.reshape(size * m, rates.shape[2])
        tension, released = np.zeros((2, *self.law.shape))
        for which, law in self._by_laws:
            # No time passes, so that the rates are those given.
            history = FrictionState(np.zeros_like(rates[which]), mobilisation[which], rates[which])
            cables = CableShape(shape.lengths[which], shape.angles[which])
            field = law.field(base[which], cables, history.mobilisation, history, history.time)
            tension[which], released[which] = field.tension, field.released_length
        wrenches = np.zeros((size, 0, 6))
        if self.geometry is not None:
            each = shape.lines.wrenches_of_each(tension)
            wrenches = each.reshape(len(each), size, m, 6).sum(axis=2).swapaxes(0, 1)
        tension, released = (x.reshape(size, m, x.shape[1]) for x in (tension, released))
        return Values(wrenches, tension, released)

    @cached_property
    def _by_laws(self) -> list[tuple[Index | slice, TendonLaw]]:
        """Tendons with laws of their coefficients, which take an iteration, and those without, each with their law."""
        law = self.law
        if not law.varies:
            return [(slice(None), law)]
        parts: list[tuple[Index | slice, TendonLaw]] = []
        follow = law.parameters.follows.any(axis=1)
        for which in (np.flatnonzero(follow), np.flatnonzero(~follow)):
            own = {name: getattr(law.parameters, name)[which] for name in _TABLES}
            parameters = TendonParameters(**own, laws=tuple(law.parameters.laws[i] for i in which))
            parts.append((which, TendonLaw(parameters, law.model, law.hysteresis)))
        return parts

    def _shape(self, own: TendonForces) -> CableShape:
        if self.geometry is not None:
            return self.geometry.evaluate(*(x[own.model.cable_nodes] for x in own.measured.poses))
        found = [
            s.tendons.evaluate(own.measured.twists, s.lengths)[0]
            for s in self.sections
            if s is not None and s.tendons is not None
        ]
        lengths = np.concatenate(found)[:, None]
        return CableShape(lengths, np.zeros((len(lengths), 0)))


#: Fields of `TendonParameters` that are tables by tendon.
_TABLES = tuple(f.name for f in fields(TendonParameters) if f.name != "laws")


def _joined_law(laws: Sequence[TendonLaw]) -> TendonLaw:
    """The laws of several models as that of all their tendons; tendons of models without friction have none."""
    mobilised = next((law.model for law in laws if law.model.active), laws[0].model)
    parameters = [x.parameters if x.model.active else _without_friction(x.parameters) for x in laws]
    joined = {name: np.concatenate([getattr(p, name) for p in parameters]) for name in _TABLES}
    of_coefficients = tuple(x for p in parameters for x in p.laws)
    return TendonLaw(TendonParameters(**joined, laws=of_coefficients), mobilised, laws[0].hysteresis)


def _without_friction(parameters: TendonParameters) -> TendonParameters:
    none = np.zeros_like(parameters.friction)
    return replace(parameters, friction=none, adhesion=none, follows=none.astype(bool))


#: Models at neighbouring values, by number of the parameter.
Neighbours = Mapping[int, Stencil[RobotModel]]


def neighbours(present: RobotModel, chosen: Sequence[Parameter]) -> Neighbours:
    """Models at neighbouring values of all parameters of the description.

    Parameters
    ----------
    present
        Model at the present values.
    chosen
        Parameters; inputs of the current step have no neighbours.

    Raises
    ------
    ValueError
        A parameter changes the mesh or the tendons' holes, so that there is no derivative.
    """

    def build(experiment: Experiment) -> RobotModel:
        model = present.beside(experiment)
        _check_structure(present, model)
        return model

    return {
        number: stencil(present.experiment, parameter, build)
        for number, parameter in enumerate(chosen)
        if isinstance(parameter, ModelParameter)
    }


def _check_structure(present: RobotModel, other: RobotModel) -> None:
    """Refuse a model of another mesh, or with other holes."""
    a, b = present.forces, other.forces
    if a.mesh.arc_lengths.size != b.mesh.arc_lengths.size or not np.array_equal(present.rigid, other.rigid):
        raise StructureChanged("the mesh has other nodes there")
    if a.law.shape != b.law.shape or not np.array_equal(a.law.parameters.mask, b.law.parameters.mask):
        raise StructureChanged("the tendons have other holes there")


class Inherited(NamedTuple):
    """Derivatives of what an increment inherits, and of its times."""

    slip: Array  # (m, g, P): Derivatives of the slips in the history [m]
    slip_rate: Array  # (m, g, P): Derivatives of the slip rates in the history [m/s]
    time: Array  # (P,): Derivatives of the time at its end [s]
    elapsed: Array  # (P,): Derivatives of its duration [s]


def with_rates(change: Values, own: TendonForces, rate: Array, inherited: Inherited | None) -> Values:
    """The change of forces where the rates of slip follow, of one where they are kept.

    Rates are slips since the beginning of an increment over its duration. What changes them acts like released
    lengths, whose effect the forces know. Differences would have to be small against the slip at which a law's
    coefficient falls, which no parameter knows.

    Parameters
    ----------
    change
        Change of a robot whose nodes, tensions at the base and mobilisations are kept; parameters are the last axis.
    own
        Forces in the present state.
    rate
        Rate of the slips [m/s], shape (m, g).
    inherited
        Changes of the slips from which the rates are counted, and of the duration; None where there are none.
    """
    field, law = own.field, own.model.law
    if not field.depends_on_length:
        return change
    released = change.released
    if inherited is not None:
        by_slip = np.stack([np.linalg.pinv(law.slip_operator * exists) for exists in law.parameters.mask])
        released = released - by_slip @ (inherited.slip + rate[:, :, None] * inherited.elapsed)
    by_length = field.released_d_length[:, :, None]
    longer = np.zeros_like(change.tension)
    np.divide(released, by_length, out=longer, where=by_length != 0.0)
    moved = field.d_length @ longer
    wrenches = change.wrenches.copy()
    wrenches[own.model.cable_nodes] += own.measured.shape.lines.softening(moved)
    by_tension = field.released_d_tension[:, :, None]
    return Values(wrenches, change.tension + moved, change.released + by_tension * moved)


class ExplicitDerivatives:
    """Derivatives of one robot's forces by its parameters.

    Parameters
    ----------
    present
        Model at the present values.
    neighbours
        Models at neighbouring values, by parameter of the description; inputs of the load steps have none.
    count
        Number of parameters P, inputs included.

    Attributes
    ----------
    law : FrictionModel
        Law of the friction in the models; where the present one has none, that of the neighbours.
    arc_lengths : ndarray, shape (N, P)
        Derivatives of the arc lengths of the nodes [m].
    """

    def __init__(self, present: RobotModel, neighbours: Neighbours, count: int) -> None:
        self.present = present
        models, owner, offsets, weights = [present], [-1], [0.0], np.zeros(0)
        for number, each in neighbours.items():
            models += each.models
            owner += [number] * len(each.models)
            offsets += each.offsets.tolist()
            weights = np.append(weights, each.weights)
        self._owner, self._offsets = np.array(owner), np.array(offsets)
        place = self._owner[1:], np.arange(1, len(models))
        self._weights = sparse.csr_array((weights, place), (count, len(models)))
        self._models = models
        self._springs = [(k, m.forces.springs) for k, m in enumerate(models) if m.forces.springs is not None]
        kinds = np.array([(id(m.forces.mesh), id(m.forces.section)) for m in models])
        self._kinds = np.unique(kinds, axis=0, return_inverse=True)[1].ravel()
        self._creeps = any(m.experiment.robot.backbone.creep_rate != 0.0 for m in models)
        self._weight = np.stack([m.weight for m in models], axis=1)
        self._tendons = TendonStack.of([m.forces for m in models])
        self.law = self._tendons.law.model
        self.arc_lengths = self._derivative(np.stack([m.forces.mesh.arc_lengths for m in models]))

    def _derivative(self, values: Array) -> Array:
        """Derivatives from values of all models, (S, ...) to (..., P)."""
        shape, count = values.shape[1:], self._weights.shape[0]
        change = (values - values[0]).reshape(len(values), math.prod(shape))
        return np.ascontiguousarray((self._weights @ change).T).reshape(*shape, count)

    def curvature_rates(
        self, twists: Array, base_tension: Array, by_twists: Array, by_tension: Array, time: float
    ) -> Array:
        """Derivatives of `StrainState.curvature_rates`, whose twists and tensions at the base change, too.

        Parameters
        ----------
        twists, base_tension
            In the state, shapes (E, 6) and (m,).
        by_twists, by_tension
            Their derivatives, shapes (E, 6, P) and (m, P).
        time
            [s].
        """
        backbones, which = self._backbones(np.full(len(self._models), time))
        states = [forces.strain_state(twists, base_tension) for forces in backbones]
        rates = StrainState(*map(np.stack, zip(*states, strict=True))).curvature_rates()
        change = backbones[which[0]].curvature_rates_change(twists, base_tension, by_twists, by_tension)
        return self._derivative(rates[which]) + change

    def _backbones(self, times: Array) -> tuple[list[ForceModel], Index]:
        """Forces that differ inside the backbone, and which of them each model has; its own time each [s]."""
        # Most parameters leave the backbone as it is.
        which = self._kinds
        if self._creeps:
            which = np.unique(np.stack((which, times)), axis=1, return_inverse=True)[1].ravel()
        first = np.unique(which, return_index=True)[1]
        return [self._models[i].forces_at(float(times[i])) for i in first], which

    def released_unloaded(self) -> Array:
        """Derivatives of the released lengths in the unloaded shape without tension, shape (m, n, P)."""
        released = self._tendons.law.released_unloaded()
        return self._derivative(released.reshape(len(self._models), *self.present.forces.law.shape))

    def at(
        self,
        own: TendonForces,
        mobilisation: Array,
        rate: Array,
        times: tuple[float, float],
        inherited: Inherited,
    ) -> Values:
        """Derivatives in a state by all parameters, which are the last axis.

        Parameters
        ----------
        own
            Forces there.
        mobilisation
            Also of holes without friction at the present values, shape (m, g).
        rate
            Rate of the slips [m/s], shape (m, g).
        times
            At the beginning and at the end of the increment [s].
        inherited
            Derivatives of history and times.
        """
        begin, end = times
        by_parameter = np.append(inherited.time, 0.0)
        rates = np.broadcast_to(rate, (len(self._owner), *rate.shape))
        if end <= begin and rate.shape == inherited.slip_rate.shape[:2]:
            # No time passes: the rates are those of the history.
            by_rate = np.append(inherited.slip_rate, np.zeros((*rate.shape, 1)), axis=2)
            rates = rates + np.moveaxis(by_rate[..., self._owner] * self._offsets, -1, 0)
        values = self._forces(own, mobilisation, rates, end + by_parameter[self._owner] * self._offsets)
        return with_rates(Values(*map(self._derivative, values)), own, rate, inherited)

    def _forces(self, own: TendonForces, mobilisation: Array, rates: Array, times: Array) -> Values:
        """Forces of all models in a state.

        ``rates``: of the slips [m/s], shape (S, m, g); ``times``: up to which the backbones creep [s], shape (S,).
        """
        twists, (positions, rotations) = own.measured.twists, own.measured.poses
        backbones, which = self._backbones(times)
        gradients = [forces.gradient(twists, own.base_tension) for forces in backbones]
        ends = np.stack(gradients, axis=1) @ strain_matrices(twists)
        # By node first: the same matrices apply to all models.
        inside = np.zeros((len(positions), len(backbones), 6))
        inside[:-1] -= ends[..., :6]
        inside[1:] -= ends[..., 6:]
        wrenches = inside[:, which]
        wrenches[..., :3] += self._weight @ rotations
        for k, springs in self._springs:
            np.add.at(wrenches[:, k, :3], springs.nodes, springs.forces(positions, rotations))
        found = self._tendons.at(own, mobilisation, rates)
        wrenches[own.model.cable_nodes] += found.wrenches.swapaxes(0, 1)
        return found._replace(wrenches=wrenches.swapaxes(0, 1))
