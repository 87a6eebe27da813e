"""The backbone mesh of a robot: nodes at disks, loads and patches, stiffness of every element."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import (
    BEAM_TO_SECTION,
    INSERT_FACTORS,
    BackboneMesh,
    add_residual_flexibility,
    subdivide,
)
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot


def build_mesh(
    robot: Robot, model: Model, extra: Iterable[float] = ()
) -> tuple[BackboneMesh, NDArray[np.bool_]]:
    """Mesh of a robot's backbone, and which elements are rigid inserts.

    Parameters
    ----------
    robot, model
        Description and number of elements per bay.
    extra
        Further arc lengths where a node is wanted [m].
    """
    b, d = robot.backbone, robot.disks
    edges = [x for p in b.patches for x in (p.start, p.end) if 0.0 < x < b.length]
    arc, rigid = subdivide(
        b.length, d.positions, model.starting_elements_per_bay, d.thickness, [*extra, *edges]
    )
    middle = 0.5 * (arc[1:] + arc[:-1])
    bending, torsion = b.stiffness_factors(middle)
    one = np.ones_like(middle)
    stiffness = np.stack(
        (b.EA * one, b.GA * one, b.GA * one, b.GJ * torsion, b.EI * bending, b.EI * bending), axis=1
    )
    stiffness[rigid] *= INSERT_FACTORS
    add_residual_flexibility(stiffness, np.diff(arc))
    second_moment = np.pi * b.radius**4 / 4.0
    rotary = b.density * second_moment * np.array([2.0, 1.0, 1.0])
    precurvature = BEAM_TO_SECTION.T @ np.array([*b.precurvature, 0.0])
    return BackboneMesh(arc, stiffness, b.mass_per_length, rotary, precurvature), rigid
