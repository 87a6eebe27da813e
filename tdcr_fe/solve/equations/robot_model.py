"""The model of one robot without a scene, and forces of many similar models at once.

The forces are those of `tdcr_fe.solve.equations.system.SceneSystem.residual`; `tdcr_fe.solve.sensitivities.explicit`
takes their derivatives by parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BEAM_TO_SECTION, strain_matrices
from tdcr_fe.elements.forces import ForceModel
from tdcr_fe.elements.friction import FrictionState, TendonLaw, TendonParameters
from tdcr_fe.elements.section import ContinuousTendons, SectionForces
from tdcr_fe.elements.tendons import CableShape
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.scene.forces import force_model, ground_springs, tendon_law
from tdcr_fe.scene.mesh import build_mesh, softened_stiffness

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

    def stiffness(self, time: float) -> Array:
        """Stiffness of the elements after the creep up to a time [s], as in `BackboneMesh`, shape (E, 6)."""
        backbone, mesh = self.robot.backbone, self.forces.mesh
        if backbone.creep_rate == 0.0:
            return mesh.stiffness
        return softened_stiffness(mesh, self.rigid, backbone.compliance_factor(time))

    def section(self, time: float) -> SectionForces | None:
        """Section forces after the creep up to a time [s]; None where there are none."""
        section, backbone = self.forces.section, self.robot.backbone
        if section is None or section.superelastic is None or backbone.creep_rate == 0.0:
            return section
        softer = section.superelastic.bending_stiffness / backbone.compliance_factor(time)
        return replace(section, superelastic=replace(section.superelastic, bending_stiffness=softer))


def _same_holes(similar: RobotModel, robot: Robot, model: Model) -> bool:
    """Whether tendons run through the same holes as in a model of the same backbone."""
    return similar.model.tendon_path == model.tendon_path and [
        (t.routing, t.end, t.clearance) for t in similar.robot.tendons
    ] == [(t.routing, t.end, t.clearance) for t in robot.tendons]


class RobotPoint(NamedTuple):
    """Where the equations of a robot are evaluated."""

    positions: Array  # Of the nodes, the latter in beam axes, shapes (N, 3) and (N, 3, 3)
    rotations: Array  # as `positions`
    twists: Array  # (E, 6): Of the elements
    strain_matrices: Array  # (E, 6, 12): See `tdcr_fe.elements.backbone.strain_matrices`
    base_tension: Array  # (m,): [N]
    mobilisation: Array  # (m, g)
    history: FrictionState  # At the beginning of the increment
    time: float  # [s]

    @classmethod
    def of(
        cls,
        poses: tuple[Array, Array],
        twists: Array,
        base_tension: Array,
        mobilisation: Array,
        history: FrictionState,
        time: float,
    ) -> RobotPoint:
        """A point from poses, twists and the unknowns of the tendons."""
        return cls(*poses, twists, strain_matrices(twists), base_tension, mobilisation, history, time)

    def nodal(self, by_twist: Array) -> Array:
        """Wrenches on the nodes from gradients by the elements' twists, (..., E, 6) to (..., E + 1, 6)."""
        ends = -(by_twist[..., None, :] @ self.strain_matrices)[..., 0, :]
        total = np.zeros((*by_twist.shape[:-2], by_twist.shape[-2] + 1, 6))
        total[..., :-1, :] += ends[..., :6]
        total[..., 1:, :] += ends[..., 6:]
        return total


class LawValues(NamedTuple):
    """Tensions [N] and released lengths [m] of the segments of every model of a stack, shape (S, m, n)."""

    tension: Array
    released: Array


class LawStack:
    """Laws of the tendons of several models of one robot, evaluated at once as if they were so many tendons.

    Parameters
    ----------
    laws
        Of the same numbers of tendons and holes.

    Attributes
    ----------
    law : TendonLaw
        Of all of them.
    """

    def __init__(self, laws: Sequence[TendonLaw]) -> None:
        self.size, first = len(laws), laws[0]
        self.shape = first.shape
        mobilised = next((x.law for x in laws if x.law.active), first.law)
        parameters = [acting_parameters(x) for x in laws]
        self.law = TendonLaw(
            TendonParameters(
                np.concatenate([p.lengths for p in parameters]),
                np.tile(first.parameters.mask, (self.size, 1)),
                np.concatenate([p.friction for p in parameters]),
                np.concatenate([p.adhesion for p in parameters]),
                np.concatenate([p.compliance for p in parameters]),
                np.concatenate([p.pretension for p in parameters]),
                tuple(law for p in parameters for law in (p.laws or (None,) * self.shape[0])),
            ),
            mobilised,
            first.presliding,
        )

    def at(
        self,
        shape: CableShape,
        base_tension: Array,
        mobilisation: Array,
        history: FrictionState | None,
        time: float,
    ) -> LawValues:
        """Tensions and released lengths at the same lengths and angles.

        Parameters
        ----------
        shape
            Lengths and angles of the tendons.
        base_tension
            [N], shape (m,).
        mobilisation
            Shape (m, g).
        history
            Of all models one after the other, shapes (S m, g).
        time
            [s].
        """
        each = (self.size, 1)
        field = self.law.field(
            np.tile(base_tension, self.size),
            np.tile(shape.lengths, each),
            np.tile(shape.angles, each),
            np.tile(mobilisation, each),
            history,
            time,
        )
        return LawValues(
            field.tension.reshape(self.size, *self.shape),
            field.released_length.reshape(self.size, *self.shape),
        )


def acting_parameters(law: TendonLaw) -> TendonParameters:
    """Parameters of a law with the friction that acts in it."""
    if law.law.active:
        return law.parameters
    none = np.zeros_like(law.parameters.friction)
    return replace(law.parameters, friction=none, adhesion=none, laws=())


class SectionStack:
    """Section forces of several models of one robot: tendons that follow the backbone and superelastic bending.

    Parameters
    ----------
    models
        With the same nodes and tendons.
    """

    def __init__(self, models: Sequence[RobotModel]) -> None:
        self.models = models
        sections = [m.forces.section for m in models]
        first = sections[0]
        tendons = [s.tendons for s in sections if s is not None and s.tendons is not None]
        lengths = [m.forces.mesh.lengths for m in models]
        #: All tendons as those of one model, where the elements have the same lengths.
        self._joined: ContinuousTendons | None = None
        if len(tendons) == len(models) and all(
            x is lengths[0] or np.array_equal(x, lengths[0]) for x in lengths
        ):
            self._joined = ContinuousTendons(
                np.concatenate([t.offset for t in tendons]),
                np.concatenate([t.slope for t in tendons]),
                np.concatenate([t.weight for t in tendons]),
            )
        self.has_tendons = first is not None and first.tendons is not None

    def at(self, point: RobotPoint) -> tuple[Array, Array]:
        """Gradients of the energy by the twists, and lengths of the tendons.

        Returns
        -------
        gradient : ndarray, shape (S, E, 6)
        lengths : ndarray, shape (S, m)
            Zero where tendons run straight.
        """
        twists, size, m = point.twists, len(self.models), len(point.base_tension)
        gradient, found = np.zeros((size, *twists.shape)), np.zeros((size, m))
        if self._joined is not None:
            lengths, by_twist = self._joined.evaluate(twists, self.models[0].forces.mesh.lengths)
            found = lengths.reshape(size, m)
            gradient = np.einsum("m,smei->sei", point.base_tension, by_twist.reshape(size, m, *twists.shape))
        for k, model in enumerate(self.models):
            section, element = model.section(point.time), model.forces.mesh.lengths
            if section is None:
                continue
            if section.tendons is not None and self._joined is None:
                found[k], by_twist = section.tendons.evaluate(twists, element)
                gradient[k] += np.einsum("m,mei->ei", point.base_tension, by_twist)
            if section.material:
                gradient[k] += section.material_gradient(twists)
        return gradient, found


def elastic_gradient(model: RobotModel, twists: Array, time: float) -> Array:
    """Gradient of the beams' elastic energy by the elements' twists, shape (E, 6)."""
    mesh = model.forces.mesh
    return np.asarray(model.stiffness(time) * (twists - mesh.reference_twists) / mesh.lengths[:, None])


def load_wrench(load: Array, frame: str, rotation: Array) -> Array:
    """A concentrated load in the frame of its node.

    Parameters
    ----------
    load
        Force [N] and moment [N m] in its own frame, shape (..., 6).
    frame
        "world" or "section".
    rotation
        Of the node, in beam axes, shape (3, 3).
    """
    turn = BEAM_TO_SECTION if frame == "section" else rotation
    parts = load.reshape(*load.shape[:-1], 2, 3) @ turn
    return np.asarray(parts.reshape(load.shape))
