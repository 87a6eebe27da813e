"""The forces of a robot and of its neighbours, with other values of its parameters, in one state.

All are evaluated at once, the tendons of all models as if they were so many tendons of one robot. The forces are those
of `tdcr_fe.solve.equations.system.SceneSystem.residual`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import strain_matrices
from tdcr_fe.elements.forces import ForceModel
from tdcr_fe.elements.friction import FrictionState, TendonLaw, TendonParameters
from tdcr_fe.elements.section import SectionForces
from tdcr_fe.elements.tendons import CableGeometry, CableShape
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.scene.forces import force_model, ground_springs, tendon_law
from tdcr_fe.scene.mesh import build_mesh, softened

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RobotModel:
    """A robot as arrays."""

    robot: Robot
    model: Model  # Descriptions it was made from
    forces: ForceModel  # Mesh, tendons, laws and section forces
    rigid: NDArray[np.bool_]  # (E,): Which elements are rigid inserts
    weight: Array  # (N, 3): Weight on every node, world axes [N]

    @classmethod
    def of(
        cls,
        robot: Robot,
        model: Model,
        load_positions: Sequence[float] = (),
        presliding: float = 1e-6,
        similar: RobotModel | None = None,
    ) -> RobotModel:
        """Model from its description.

        Parameters
        ----------
        robot, model
            With a number of elements for every bay.
        load_positions
            Arc lengths of further nodes [m].
        presliding
            Presliding distance [m].
        similar
            Another model, of the same load positions. What follows from descriptions that both share (the same
            objects) is taken from it.
        """
        same_backbone = (
            similar is not None
            and similar.robot.backbone is robot.backbone
            and similar.robot.disks is robot.disks
            and [x.at for x in similar.robot.springs] == [x.at for x in robot.springs]
            and similar.robot.base_stiffness == robot.base_stiffness
            and similar.model.elements_per_bay == model.elements_per_bay
        )
        if similar is not None and same_backbone:
            mesh, rigid = similar.forces.mesh, similar.rigid
        else:
            mesh, rigid = build_mesh(robot, model, load_positions)
        if (
            similar is not None
            and same_backbone
            and similar.robot.tendons is robot.tendons
            and (similar.model.friction, similar.model.tendon_path) == (model.friction, model.tendon_path)
        ):
            forces = similar.forces
        elif similar is not None and same_backbone and _same_holes(similar, robot, model):
            before = similar.forces.law.parameters
            law = tendon_law(robot, model.friction, before.lengths, before.mask, presliding)
            forces = replace(similar.forces, law=law)
        else:
            forces = force_model(robot, model, mesh, rigid, presliding)
        if similar is not None and similar.robot.springs != robot.springs:
            forces = replace(forces, springs=ground_springs(robot, mesh))
        mass = np.zeros(len(mesh.arc_lengths))
        lumped = 0.5 * mesh.mass_per_length * mesh.lengths
        mass[:-1] += lumped
        mass[1:] += lumped
        mass[forces.hole_nodes[1:]] += robot.disks.mass
        mass[-1] += robot.tip_mass
        return cls(robot, model, forces, rigid, mass[:, None] * np.array(model.gravity))

    def gradient(self, twists: Array, base_tension: Array, time: float) -> Array:
        """Gradient of the energy of elements and section forces by the twists at a time [s], shape (E, 6)."""
        forces, backbone = self.forces, self.robot.backbone
        if backbone.creep_rate != 0.0:
            forces = softened(forces, forces.mesh, self.rigid, backbone.compliance_factor(time))
        found = forces.mesh.twist_stiffness * (twists - forces.mesh.reference_twists)
        return found if forces.section is None else found + forces.section.gradient(twists, base_tension)


def _same_holes(similar: RobotModel, robot: Robot, model: Model) -> bool:
    """Whether tendons run through the same holes as in a model of the same backbone."""
    return similar.model.tendon_path == model.tendon_path and [
        (t.routing, t.end, t.clearance) for t in similar.robot.tendons
    ] == [(t.routing, t.end, t.clearance) for t in robot.tendons]


class RobotPoint(NamedTuple):
    """Where the forces of a robot are evaluated."""

    positions: Array  # Of the nodes, the latter in beam axes, shapes (N, 3) and (N, 3, 3)
    rotations: Array  # as `positions`
    twists: Array  # (E, 6): Of the elements
    base_tension: Array  # (m,): [N]
    mobilisation: Array  # (m, g)


class Values(NamedTuple):
    """What every model of a stack has in one state."""

    wrenches: Array  # (S, N, 6): On the nodes, in their own frames [N, N m]; (S, n+1, 6) of tendons alone
    tension: Array  # (S, m, n): Tensions [N] and released lengths [m] of the segments
    released: Array  # as `tension`


@dataclass(frozen=True, eq=False)
class TendonStack:
    """Tendons of several models of one robot, evaluated as if they were so many tendons."""

    size: int  # Number of models S
    law: TendonLaw  # Of all; where one of the models has friction, the mobilisations are those of its law
    geometry: CableGeometry | None  # Of all; None where the tendons follow the backbone
    sections: tuple[SectionForces | None, ...]  # By model

    @classmethod
    def of(cls, models: Sequence[ForceModel]) -> TendonStack:
        """The tendons of models with the same numbers of tendons and holes."""
        geometries = [m.geometry for m in models if m.geometry is not None]
        return cls(
            len(models),
            _joined_law([m.law for m in models]),
            _joined_geometry(geometries) if geometries else None,
            tuple(m.section for m in models),
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
        return cls(size, _joined_law([model.law] * size), geometry, ())

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
        each, (m, n) = (self.size, 1), (len(point.base_tension), self.law.shape[1])
        shape = self._shape(point, nodes)
        mobilisation = np.tile(point.mobilisation, each)
        # No time passes, so that the rates are those given.
        state = FrictionState(np.zeros_like(mobilisation), mobilisation, rates.reshape(mobilisation.shape))
        base = np.tile(point.base_tension, self.size)
        field = self.law.field(base, shape.lengths, shape.angles, mobilisation, state)
        wrenches = np.zeros((self.size, 0, 6))
        if self.geometry is not None:
            pulled = shape.lines.maps @ shape.lines.pulls(field.tension)[..., None]
            wrenches = pulled.reshape(self.size, m, -1, 6).sum(axis=1)
        return Values(
            wrenches,
            field.tension.reshape(self.size, m, n),
            field.released_length.reshape(self.size, m, n),
        )

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
        return CableShape(lengths, np.zeros((len(lengths), 0)), lambda _: (lengths, lengths))


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
    return TendonLaw(
        TendonParameters(
            np.concatenate([p.lengths for p in parameters]),
            np.concatenate([p.mask for p in parameters]),
            np.concatenate([p.friction for p in parameters]),
            np.concatenate([p.adhesion for p in parameters]),
            np.concatenate([p.compliance for p in parameters]),
            np.concatenate([p.pretension for p in parameters]),
            tuple(law for p in parameters for law in (p.laws or (None,) * first.shape[0])),
        ),
        mobilised,
        first.presliding,
    )


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
        for k, (model, time) in enumerate(zip(self.models, times.tolist(), strict=True)):
            gradient[:, k] = model.gradient(twists, point.base_tension, time)
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
