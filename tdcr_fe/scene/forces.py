"""The force model of a robot from its description: tendons, friction and section forces on a mesh, without a scene."""

from __future__ import annotations

import numpy as np

from tdcr_fe.elements import Array, Flags
from tdcr_fe.elements.backbone import BEAM_TO_SECTION, BackboneMesh, gauss_arc_lengths, reference_poses
from tdcr_fe.elements.forces import ForceModel, SideSprings
from tdcr_fe.elements.friction import FRICTION_MODELS, TendonLaw, TendonParameters
from tdcr_fe.elements.hysteresis import Hysteresis
from tdcr_fe.elements.material import NonlinearSection, SuperelasticSection
from tdcr_fe.elements.section_forces import ContinuousTendons, SectionForces
from tdcr_fe.elements.tendons import CableGeometry
from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.friction import ConstantFriction
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.scene.base import BasePose


def force_model(
    robot: Robot,
    model: Model,
    mesh: BackboneMesh,
    rigid: Flags,
    hysteresis: Hysteresis,
    base: BasePose | None,
) -> ForceModel:
    """Tendons, friction and section forces of a robot.

    Parameters
    ----------
    robot, model
        Description.
    mesh, rigid
        As `tdcr_fe.scene.mesh.build_mesh` returns them.
    hysteresis
        How the friction at a hole follows the slip.
    base
        Pose of the base plate in the world; None is that of the world.
    """
    # Nodes of base plate and disks; without disks the tip in place of them.
    hole_nodes = np.array([0, *(mesh.node_at(s) for s in robot.disks.positions or (robot.backbone.length,))])
    # Without tendons the two tendon paths are the same.
    continuous = model.tendon_path == "continuous" and bool(robot.tendons)
    section = section_forces(robot, mesh, rigid, continuous)
    geometry = None
    if not continuous:
        geometry, poses = cable_geometry(robot), reference_poses(mesh, np.zeros(3), BEAM_TO_SECTION)
        # Of the unloaded robot, with tendons shifted in their holes.
        lengths = geometry.evaluate(*(own[hole_nodes] for own in poses)).lengths
        mask = geometry.mask
    else:
        assert section is not None and section.tendons is not None
        lengths = section.tendons.evaluate(mesh.reference_twists, mesh.lengths)[0][:, None]
        mask = np.ones_like(lengths, dtype=bool)
    law = tendon_law(robot, model.friction, lengths, mask, hysteresis)
    return ForceModel(mesh, hole_nodes, geometry, law, section, side_springs(robot, mesh, base))


# ---------------------------------------------------------------- tendons


def cable_geometry(robot: Robot) -> CableGeometry:
    """Straight segments between the holes of all tendons; shorter tendons are padded at the end.

    The nodes with holes are the base plate and the disks, in this order.
    """
    counts = [len(robot.hole_arc_lengths(t)) - 1 for t in robot.tendons]
    m, n = len(counts), max(counts, default=1)
    offsets = np.zeros((m, n + 1, 3))
    mask = np.zeros((m, n), dtype=bool)
    for i, (tendon, count) in enumerate(zip(robot.tendons, counts, strict=True)):
        offsets[i, : count + 1] = robot.hole_points(tendon) @ BEAM_TO_SECTION
        offsets[i, count + 1 :] = offsets[i, count]
        mask[i, :count] = True
    clearance = np.array([t.clearance for t in robot.tendons])
    return CableGeometry(offsets, mask, clearance)


def tendon_law(robot: Robot, friction: str, lengths: Array, mask: Flags, hysteresis: Hysteresis) -> TendonLaw:
    """How tension passes along the tendons of a robot.

    Parameters
    ----------
    robot
        Description.
    friction
        Name of the friction model, a key of `FRICTION_MODELS`.
    lengths, mask
        Unloaded length of every segment [m], and which segments exist; shapes (m, n).
    hysteresis
        How the friction at a hole follows the slip.
    """
    tendons = robot.tendons
    m, inner = len(tendons), mask[:, 1:]
    # A constant law is a coefficient, with which the path of the friction can be followed.
    constant = [t.friction if type(t.friction) is ConstantFriction else None for t in tendons]
    laws = tuple(t.friction if c is None else None for t, c in zip(tendons, constant, strict=True))
    coefficients = [c.mu if c else t.friction_coefficient for t, c in zip(tendons, constant, strict=True)]
    coefficient = np.array(coefficients).reshape(m, 1) * inner
    follows = np.array([law is not None for law in laws], dtype=bool).reshape(m, 1) & inner
    adhesion = np.array([t.adhesion for t in tendons]).reshape(m, 1) * inner
    for i, tendon in enumerate(tendons):
        # Without the base plate's hole, in which there is no friction, and the anchor.
        holes = robot.hole_arc_lengths(tendon)[1:-1]
        for hole in tendon.tight_holes:
            at = i, int(np.argmin(np.abs(holes - hole.at)))
            if hole.drop is not None:
                adhesion[at] = hole.drop
            if hole.friction_coefficient is not None:
                coefficient[at], follows[at] = hole.friction_coefficient, False
    compliance = np.array([0.0 if t.axial_stiffness is None else 1.0 / t.axial_stiffness for t in tendons])
    pretension = np.array([t.pretension for t in tendons])
    spools = [t.spool for t in tendons]
    spring = np.array([0.0 if s is None or s.stiffness is None else 1.0 / s.stiffness for s in spools])
    of_tendons = compliance, pretension, spring
    parameters = TendonParameters(lengths, mask, coefficient, adhesion, *of_tendons, follows, laws)
    return TendonLaw(parameters, FRICTION_MODELS[friction], hysteresis)


def side_springs(robot: Robot, mesh: BackboneMesh, base: BasePose | None) -> SideSprings | None:
    """Springs from the backbone to ground, at rest where the unloaded robot is; None where there are none.

    Parameters
    ----------
    robot, mesh
        Description and mesh, with a node at every spring.
    base
        Pose of the base plate in the world; None is that of the world.
    """
    if not robot.springs:
        return None
    base = BasePose(np.zeros(3), np.eye(3)) if base is None else base
    positions, _ = reference_poses(mesh, base.position, base.rotation @ BEAM_TO_SECTION)
    nodes = np.array([mesh.node_at(spring.at, ARC_TOLERANCE) for spring in robot.springs])
    sideways = base.rotation @ np.diag([1.0, 1.0, 0.0]) @ base.rotation.T
    stiffness = np.array([spring.stiffness for spring in robot.springs])[:, None, None] * sideways
    return SideSprings(nodes, stiffness, positions[nodes])


# ---------------------------------------------------------------- section


def section_forces(robot: Robot, mesh: BackboneMesh, rigid: Flags, continuous: bool) -> SectionForces | None:
    """Forces inside the section, those of continuous tendons too; None where there are none."""
    tendons = continuous_tendons(robot, mesh) if continuous else None
    material = superelastic_section(robot, mesh, rigid) or nonlinear_section(robot, mesh, rigid)
    return None if tendons is None and material is None else SectionForces(mesh.lengths, tendons, material)


def continuous_tendons(robot: Robot, mesh: BackboneMesh) -> ContinuousTendons:
    """Tendons that follow the backbone, at the integration points of every element."""
    s = gauss_arc_lengths(mesh.arc_lengths)
    offset = np.zeros((len(robot.tendons), *s.shape, 3))
    slope = np.zeros_like(offset)
    weight = np.zeros((len(robot.tendons), len(s)))
    middle = 0.5 * (mesh.arc_lengths[1:] + mesh.arc_lengths[:-1])
    for i, tendon in enumerate(robot.tendons):
        end = robot.end(tendon)
        along = np.minimum(s, end)
        offset[i, ..., 1:] = tendon.routing.position(along.ravel(), end).reshape(*s.shape, 2)
        slope[i, ..., 1:] = tendon.routing.position(along.ravel(), end, 1).reshape(*s.shape, 2)
        weight[i] = middle < end
    return ContinuousTendons(offset, slope, weight)


def superelastic_section(robot: Robot, mesh: BackboneMesh, rigid: Flags) -> SuperelasticSection | None:
    """Superelastic bending of every element, none in rigid inserts; None where the backbone has no such law."""
    law = robot.backbone.superelastic
    if law is None:
        return None
    radius = robot.backbone.radius_at(0.5 * (mesh.arc_lengths[1:] + mesh.arc_lengths[:-1]))
    bending = np.where(rigid, 0.0, mesh.stiffness[:, 5])
    return SuperelasticSection(bending, law.threshold_strain / radius, law.plateau_ratio, mesh.precurvature)


def nonlinear_section(robot: Robot, mesh: BackboneMesh, rigid: Flags) -> NonlinearSection | None:
    """Fibres of every element that harden or soften, none in rigid inserts; None where the material is linear."""
    law = robot.backbone.nonlinear
    if law is None:
        return None
    axial, bending = mesh.stiffness[:, 0], mesh.stiffness[:, 5]
    radius, one = 2.0 * np.sqrt(bending / axial), np.ones_like(axial)
    axial, bending = np.where(rigid, 0.0, axial), np.where(rigid, 0.0, bending)
    return NonlinearSection(axial, bending, radius, law.quadratic * one, law.cubic * one, mesh.precurvature)
