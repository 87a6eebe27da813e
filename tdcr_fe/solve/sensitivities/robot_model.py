"""The forces of a robot and of its neighbours, with other values of its parameters, in one state.

All are evaluated at once, the tendons of all models as if they were so many tendons of one robot. The forces are those
of `tdcr_fe.solve.equations.system.SceneSystem.residual`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Experiment
from tdcr_fe.elements.backbone import strain_matrices
from tdcr_fe.elements.forces import ForceModel
from tdcr_fe.elements.friction import TendonLaw, TendonParameters
from tdcr_fe.elements.hysteresis import FrictionState, Hysteresis
from tdcr_fe.elements.section import SectionForces
from tdcr_fe.elements.tendons import CableGeometry, CableShape
from tdcr_fe.scene.forces import force_model
from tdcr_fe.scene.mesh import build_mesh, softened
from tdcr_fe.scene.parts import BasePose

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RobotModel:
    """A robot as arrays."""

    experiment: Experiment  # From which it was made, with a number of elements for every bay
    hysteresis: Hysteresis  # At the holes
    base: BasePose | None  # Of the base plate in the world; None is that of the world
    forces: ForceModel  # Mesh, tendons, laws and section forces
    rigid: NDArray[np.bool_]  # (E,): Which elements are rigid inserts
    weight: Array  # (N, 3): Weight on every node, world axes [N]

    @classmethod
    def of(
        cls,
        experiment: Experiment,
        hysteresis: Hysteresis,
        base: BasePose | None,
        similar: RobotModel | None = None,
    ) -> RobotModel:
        """Model from its description; arguments as the attributes.

        Parameters
        ----------
        experiment, hysteresis, base
            See above.
        similar
            Another model of the same hysteresis and base. What is equal in both is taken from it.
        """
        robot, model = experiment.robot, experiment.model
        if similar is not None and _same_mesh(similar.experiment, experiment):
            mesh, rigid = similar.forces.mesh, similar.rigid
        else:
            mesh, rigid = build_mesh(robot, model, load_positions(experiment))
        forces = force_model(robot, model, mesh, rigid, hysteresis, base)
        if similar is not None:
            old = similar.forces
            if _same(_tendon_arrays(forces), _tendon_arrays(old)):
                forces = replace(forces, geometry=old.geometry, law=old.law)
            if _same(forces.section, old.section):
                forces = replace(forces, section=old.section)
        mass = np.zeros(len(mesh.arc_lengths))
        lumped = 0.5 * mesh.mass_per_length * mesh.lengths
        mass[:-1] += lumped
        mass[1:] += lumped
        mass[forces.hole_nodes[1:]] += robot.disks.mass
        mass[-1] += robot.tip_mass
        weight = mass[:, None] * np.array(model.gravity)
        return cls(experiment, hysteresis, base, forces, rigid, weight)

    def beside(self, experiment: Experiment) -> RobotModel:
        """The model of a neighbouring description, with as many elements in every bay."""
        counts = self.experiment.model.elements_per_bay
        experiment = replace(experiment, model=replace(experiment.model, elements_per_bay=counts))
        return RobotModel.of(experiment, self.hysteresis, self.base, self)

    def gradient(self, twists: Array, base_tension: Array, time: float) -> Array:
        """Gradient of the energy of elements and section forces by the twists at a time [s], shape (E, 6)."""
        forces, backbone = self.forces, self.experiment.robot.backbone
        if backbone.creep_rate != 0.0:
            forces = softened(forces, forces.mesh, self.rigid, backbone.compliance_factor(time))
        found = forces.mesh.twist_stiffness * (twists - forces.mesh.reference_twists)
        return found if forces.section is None else found + forces.section.gradient(twists, base_tension)


def load_positions(experiment: Experiment) -> list[float]:
    """Arc lengths of all loads [m], ascending."""
    return sorted({float(load.at) for step in experiment.steps for load in step.loads.values()})


def _same_mesh(a: Experiment, b: Experiment) -> bool:
    """Whether two descriptions have the same mesh."""

    def source(e: Experiment) -> tuple[Any, ...]:
        springs = [x.at for x in e.robot.springs]
        return e.robot.backbone, e.robot.disks, springs, e.robot.base_stiffness, e.model.elements_per_bay

    return source(a) == source(b) and (a.steps is b.steps or load_positions(a) == load_positions(b))


def _tendon_arrays(forces: ForceModel) -> tuple[Any, ...]:
    """What the tensions of cables in a state follow from."""
    g, law = forces.geometry, forces.law
    return None if g is None else (g.nominal, g.clearance), law.parameters, law.law


def _same(a: Any, b: Any) -> bool:
    """Whether two values are equal, arrays in all their elements."""
    if a is b:
        return True
    if is_dataclass(a):
        return type(a) is type(b) and all(_same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    return bool(np.array_equal(a, b))


class RobotPoint(NamedTuple):
    """Where the forces of a robot are evaluated."""

    positions: Array  # Of the nodes, the latter in beam axes, shapes (N, 3) and (N, 3, 3)
    rotations: Array  # as `positions`
    twists: Array  # (E, 6): Of the elements
    base_tension: Array  # (m,): [N]
    mobilisation: Array  # (m, g)


class Values(NamedTuple):
    """Forces of a robot in one state: of every model of a stack, or, parameters being the last axis, derivatives."""

    wrenches: Array  # (S, N, 6): On the nodes, in their own frames [N, N m]; (S, n+1, 6) of tendons alone
    tension: Array  # (S, m, n): Tensions [N] and released lengths [m] of the segments
    released: Array  # as `tension`


@dataclass(frozen=True, eq=False)
class TendonStack:
    """Tendons of several models of one robot, evaluated as if they were so many tendons."""

    index: NDArray[np.int_]  # (S,): By model, which of the different ones it is
    law: TendonLaw  # Of the different ones; where one has friction, the mobilisations are those of its law
    geometry: CableGeometry | None  # Of the different ones; None where the tendons follow the backbone
    sections: tuple[SectionForces | None, ...]  # Of the different ones

    @classmethod
    def of(cls, models: Sequence[ForceModel]) -> TendonStack:
        """The tendons of models with the same numbers of tendons and holes."""
        # Rates of slip may be those of one model alone.
        keys: list[Any] = [
            k
            if m.geometry is None or any(x is not None for x in m.law.parameters.laws)
            else (id(m.geometry), id(m.law))
            for k, m in enumerate(models)
        ]
        places = {key: place for place, key in enumerate(dict.fromkeys(keys))}
        different = [models[keys.index(key)] for key in places]
        geometries = [m.geometry for m in different if m.geometry is not None]
        return cls(
            np.array([places[key] for key in keys]),
            _joined_law([m.law for m in different]),
            _joined_geometry(geometries) if geometries else None,
            tuple(m.section for m in different),
        )

    @classmethod
    def with_offsets(cls, model: ForceModel, offsets: Array) -> TendonStack:
        """One model with other places of the tendons in the frames of the disks [m], shape (S, m, n+1, 3)."""
        size, own = len(offsets), model.geometry
        assert own is not None
        geometry = CableGeometry(
            np.tile(own.nodes, (size, 1)),
            offsets.reshape(-1, *offsets.shape[2:]),
            np.tile(own.mask, (size, 1)),
            own.node_count,
        )
        return cls(np.arange(size), _joined_law([model.law] * size), geometry, ())

    def at(self, point: RobotPoint, rates: Array, nodes: NDArray[np.int_]) -> Values:
        """Forces in a state.

        Parameters
        ----------
        point
            The state.
        rates
            Of the slips [m/s], shape (S, m, g).
        nodes
            With holes, see `tdcr_fe.elements.forces.ForceModel.cable_nodes`; empty where tendons follow the backbone.
        """
        m, n = len(point.base_tension), self.law.shape[1]
        size = self.law.shape[0] // m
        shape = self._shape(point, nodes)
        mobilisation = np.tile(point.mobilisation, (size, 1))
        rates = rates[np.unique(self.index, return_index=True)[1]].reshape(mobilisation.shape)
        # No time passes, so that the rates are those given.
        state = FrictionState(np.zeros_like(mobilisation), mobilisation, rates)
        base = np.tile(point.base_tension, size)
        field = self.law.field(base, shape.lengths, shape.angles, mobilisation, state)
        wrenches = np.zeros((size, 0, 6))
        if self.geometry is not None:
            pulled = shape.lines.maps @ shape.lines.pulls(field.tension)[..., None]
            wrenches = pulled.reshape(size, m, -1, 6).sum(axis=1)
        found = wrenches, field.tension.reshape(size, m, n), field.released_length.reshape(size, m, n)
        return Values(*(x[self.index] for x in found))

    def _shape(self, point: RobotPoint, nodes: NDArray[np.int_]) -> CableShape:
        if self.geometry is not None:
            positions, rotations = point.positions[nodes], point.rotations[nodes]
            self.geometry.shift_in_holes(positions, rotations)
            return self.geometry.evaluate(positions, rotations)
        found = [
            s.tendons.evaluate(point.twists, s.lengths)[0]
            for s in self.sections
            if s is not None and s.tendons is not None
        ]
        lengths = np.concatenate(found)[:, None]
        return CableShape(lengths, np.zeros((len(lengths), 0)))


def _joined_geometry(models: Sequence[CableGeometry]) -> CableGeometry:
    """The cables of all models as those of one."""
    none = np.zeros(len(models[0].nodes))
    return CableGeometry(
        np.concatenate([g.nodes for g in models]),
        np.concatenate([g.nominal for g in models]),
        np.concatenate([g.mask for g in models]),
        models[0].node_count,
        np.concatenate([none if g.clearance is None else g.clearance for g in models]),
    )


def _joined_law(laws: Sequence[TendonLaw]) -> TendonLaw:
    """The laws of all models as that of one, without friction for models that have none."""
    first = laws[0]
    mobilised = next((x.law for x in laws if x.law.active), first.law)
    parameters = [x.parameters if x.law.active else _without_friction(x.parameters) for x in laws]
    joined = {
        f.name: np.concatenate([getattr(p, f.name) for p in parameters])
        for f in fields(TendonParameters)
        if f.name != "laws"
    }
    of_coefficients = tuple(x for p in parameters for x in (p.laws or (None,) * first.shape[0]))
    return TendonLaw(TendonParameters(**joined, laws=of_coefficients), mobilised, first.hysteresis)


def _without_friction(parameters: TendonParameters) -> TendonParameters:
    none = np.zeros_like(parameters.friction)
    return replace(parameters, friction=none, adhesion=none, laws=())


class ModelStack:
    """Several models of one robot, evaluated at once.

    Parameters
    ----------
    models
        With the same nodes, tendons and holes.

    Attributes
    ----------
    tendons : TendonStack
    """

    def __init__(self, models: Sequence[RobotModel]) -> None:
        self.models = models
        self.tendons = TendonStack.of([m.forces for m in models])
        self._weight = np.stack([m.weight for m in models], axis=1)

    def at(self, point: RobotPoint, rates: Array, times: Array) -> Values:
        """Forces in a state.

        Parameters
        ----------
        point
            The state.
        rates
            Of the slips [m/s], shape (S, m, g).
        times
            Up to which the backbones creep [s], shape (S,).
        """
        twists, positions, rotations = point.twists, point.positions, point.rotations
        gradient = np.empty((len(twists), len(self.models), 6))
        # Most parameters leave the backbone as it is.
        different: dict[Any, Array] = {}
        for k, (model, time) in enumerate(zip(self.models, times.tolist(), strict=True)):
            key = id(model.forces.mesh), id(model.forces.section), time
            if key not in different:
                different[key] = model.gradient(twists, point.base_tension, time)
            gradient[:, k] = different[key]
        ends = gradient @ strain_matrices(twists)
        # By node first: the same matrices apply to all models.
        wrenches = np.zeros((len(positions), len(self.models), 6))
        wrenches[:-1] -= ends[..., :6]
        wrenches[1:] -= ends[..., 6:]
        wrenches[..., :3] += self._weight @ rotations
        for k, model in enumerate(self.models):
            springs = model.forces.springs
            if springs is not None:
                np.add.at(wrenches[:, k, :3], springs.nodes, springs.forces(positions, rotations))
        nodes = self.models[0].forces.cable_nodes
        found = self.tendons.at(point, rates, nodes)
        wrenches[nodes] += found.wrenches.swapaxes(0, 1)
        return found._replace(wrenches=wrenches.swapaxes(0, 1))
