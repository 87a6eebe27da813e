"""The force model of a robot from its description: tendons, friction and section forces on a mesh, without a scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BackboneMesh
from tdcr_fe.elements.forces import ForceModel
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.scene.parts import BasePose, ground_springs
from tdcr_fe.scene.section import section_forces
from tdcr_fe.scene.tendons import cable_geometry, cable_lengths, continuous_lengths, tendon_law


def force_model(
    robot: Robot,
    model: Model,
    mesh: BackboneMesh,
    rigid: NDArray[np.bool_],
    presliding: float,
    base: BasePose | None = None,
) -> ForceModel:
    """Tendons, friction and section forces of a robot.

    Parameters
    ----------
    robot, model
        Description.
    mesh, rigid
        As `tdcr_fe.scene.mesh.build_mesh` returns them.
    presliding
        Slip within which the friction at a hole goes from zero to full [m].
    base
        Pose of the base plate in the world; None is that of the world.
    """
    # Nodes of base plate and disks; without disks the tip in place of them.
    hole_nodes = np.array([0, *(mesh.node_at(s) for s in robot.disks.positions or (robot.backbone.length,))])
    section = section_forces(robot, model, mesh, rigid)
    # Without tendons the two tendon paths are the same.
    continuous = model.tendon_path == "continuous" and bool(robot.tendons)
    geometry = None if continuous else cable_geometry(robot)
    if geometry is not None:
        lengths, mask = cable_lengths(geometry, mesh, hole_nodes), geometry.mask
    elif section is not None and section.tendons is not None:
        lengths = continuous_lengths(section.tendons, mesh)
        mask = np.ones_like(lengths, dtype=bool)
    else:
        lengths, mask = np.zeros((0, 1)), np.zeros((0, 1), dtype=bool)
    law = tendon_law(
        robot.tendons,
        [robot.hole_arc_lengths(t) for t in robot.tendons],
        lengths,
        mask,
        model.friction,
        presliding,
    )
    return ForceModel(mesh, hole_nodes, geometry, law, section, ground_springs(robot, mesh, base))
