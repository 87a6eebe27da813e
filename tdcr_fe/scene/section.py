"""Forces inside the section of a robot's backbone: tendons that follow it, superelastic bending."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BackboneMesh
from tdcr_fe.elements.section import (
    ContinuousTendons,
    NonlinearSection,
    SectionForces,
    SuperelasticSection,
    gauss_arc_lengths,
)
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot


def section_forces(
    robot: Robot, model: Model, mesh: BackboneMesh, rigid: NDArray[np.bool_]
) -> SectionForces | None:
    """Forces inside the section; None where the model has none."""
    continuous = model.tendon_path == "continuous" and robot.tendons
    tendons = continuous_tendons(robot, mesh) if continuous else None
    superelastic = superelastic_section(robot, mesh, rigid)
    nonlinear = nonlinear_section(robot, mesh, rigid)
    if tendons is None and superelastic is None and nonlinear is None:
        return None
    return SectionForces(mesh.lengths, tendons, superelastic, nonlinear)


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


def superelastic_section(
    robot: Robot, mesh: BackboneMesh, rigid: NDArray[np.bool_]
) -> SuperelasticSection | None:
    """Superelastic bending of every element, none in rigid inserts; None where the backbone has no such law."""
    law = robot.backbone.superelastic
    if law is None:
        return None
    return SuperelasticSection(
        np.where(rigid, 0.0, mesh.stiffness[:, 5]),
        law.threshold_strain / robot.backbone.radius_at(0.5 * (mesh.arc_lengths[1:] + mesh.arc_lengths[:-1])),
        law.plateau_ratio,
        mesh.precurvature,
    )


def nonlinear_section(robot: Robot, mesh: BackboneMesh, rigid: NDArray[np.bool_]) -> NonlinearSection | None:
    """Fibres of every element that harden or soften, none in rigid inserts; None where the material is linear."""
    law = robot.backbone.nonlinear
    if law is None:
        return None
    axial, bending = mesh.stiffness[:, 0], mesh.stiffness[:, 5]
    one = np.ones_like(axial)
    return NonlinearSection(
        np.where(rigid, 0.0, axial),
        np.where(rigid, 0.0, bending),
        2.0 * np.sqrt(bending / axial),
        law.quadratic * one,
        law.cubic * one,
        mesh.precurvature,
    )
