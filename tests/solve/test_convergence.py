"""Orders of convergence with the mesh and with the substeps, for every kind of robot."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from robots import BACKBONE, DISKS, LENGTH, distance, paper, solve, three

from tdcr_fe.model.backbone import Superelastic
from tdcr_fe.model.loading import Load, LoadStep
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting
from tdcr_fe.model.tendon import Tendon


def mesh_orders(robot, steps, meshes=(2, 4, 8, 16), **model) -> np.ndarray:
    """Order of the tip's error from successive differences: log2 |x_k - x_2k| / |x_2k - x_4k|."""
    tips = [solve(robot, steps, elements_per_bay=k, **model).tips[-1] for k in meshes]
    change = [np.linalg.norm(b - a) for a, b in pairwise(tips)]
    return np.log2(np.array(change[:-1]) / np.array(change[1:]))


CASES = [
    pytest.param(Robot(BACKBONE, DISKS, (Tendon("t1", HelicalRouting(4.5e-3, 2.0), 0.3),)), id="helical"),
    pytest.param(
        Robot(BACKBONE, DISKS, (Tendon("t1", ConvergingRouting(4.5e-3, 0.15e-3), 0.3),)), id="converging"
    ),
    pytest.param(
        paper(0.3, backbone=replace(BACKBONE, superelastic=Superelastic(0.002, 0.4))), id="superelastic"
    ),
    pytest.param(paper(0.3, backbone=replace(BACKBONE, precurvature=(1.0, 2.0))), id="precurved"),
    pytest.param(Robot(BACKBONE, replace(DISKS, thickness=4e-3), paper(0.3).tendons), id="thick"),
]


PULLED = [LoadStep("", {"t1": 1.0}, loads={"tip": Load(LENGTH, (0.01, 0.02, 0.0))})]


@pytest.mark.parametrize("robot", CASES)
def test_tip_converges_with_order_two_or_better_in_the_mesh(robot):
    """Pulled to 1 N with friction, and a force at the tip; two elements per bay are within 1e-5 of the length."""
    assert np.all(mesh_orders(robot, PULLED) > 1.95)
    coarse, fine = (solve(robot, PULLED, elements_per_bay=k).tips[-1] for k in (2, 16))
    assert distance(coarse, fine) < 1e-5


def test_classical_model_converges_with_order_two_in_the_mesh():
    """A tip force bends the backbone unevenly, out of the plane of the tendon."""
    steps = [LoadStep("", {"t1": 1.0}, loads={"tip": Load(LENGTH, (0.0, 0.05, 0.0))})]
    orders = mesh_orders(paper(), steps, (1, 2, 4, 8), friction="none", tendon_path="continuous")
    assert orders == pytest.approx([2.0, 2.0], abs=0.15)


@pytest.mark.integration
def test_path_converges_with_the_substeps():
    """Three tendons with friction: fixed substeps 4, 16, 32 approach what the default settings choose."""
    steps = [
        LoadStep("", {"t1": 1.5, "t2": 0.5}),
        LoadStep("", {"t1": 0.3, "t2": 1.2}, loads={"tip": Load(LENGTH, (0.01, 0.02, 0.0))}),
        LoadStep("", {"t1": 1.0, "t2": 0.0, "t3": 0.8}),
    ]
    chosen = solve(three(0.3), steps).tips[-1]
    away = []
    fine = solve(three(0.3), [replace(s, substeps=128) for s in steps]).tips[-1]
    for n in (4, 16, 32):
        tip = solve(three(0.3), [replace(s, substeps=n) for s in steps]).tips[-1]
        away.append(distance(tip, fine))
    assert away[2] < max(away[0], 1e-8)
    assert away[2] < 2e-4
    assert distance(chosen, fine) < 2e-4
