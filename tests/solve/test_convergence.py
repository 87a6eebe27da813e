"""Convergence with the mesh and the substeps, and the balance of energy."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from robots import BACKBONE, DISKS, LENGTH, distance, paper, pull, single, solve

from tdcr_fe import ConvergingRouting, HelicalRouting, Load, LoadStep, Robot, Superelastic, Tendon
from tdcr_fe.validation.fuzz.energy import divided, ledger

CASES = [
    pytest.param(Robot(BACKBONE, DISKS, (Tendon("t1", HelicalRouting(4.5e-3, 2.0), 0.3),)), id="helical"),
    pytest.param(Robot(BACKBONE, DISKS, (Tendon("t1", ConvergingRouting(4.5e-3, 0.15e-3), 0.3),)), id="converging"),
    pytest.param(paper(0.3, backbone=replace(BACKBONE, superelastic=Superelastic(0.002, 0.4))), id="superelastic"),
    pytest.param(paper(0.3, backbone=replace(BACKBONE, taper=((0.0, 0.4e-3), (LENGTH, 0.25e-3)))), id="tapered"),
    pytest.param(paper(0.3, backbone=replace(BACKBONE, precurvature=(1.0, 2.0))), id="precurved"),
    pytest.param(Robot(BACKBONE, replace(DISKS, thickness=4e-3), paper(0.3).tendons), id="thick"),
]  # fmt: skip


@pytest.mark.parametrize("robot", CASES)
def test_tip_converges_with_order_two_or_better_in_the_mesh(robot):
    """Pulled to 1 N with friction, and a force at the tip; two elements per bay are within 1e-5 of the length.

    The order is ``log2 |x_2 - x_4| / |x_4 - x_8|``.
    """
    pulled = [LoadStep("", {"t1": 1.0}, loads={"tip": Load(LENGTH, (0.01, 0.02, 0.0))})]
    tips = [solve(robot, pulled, elements_per_bay=k).tips[-1] for k in (2, 4, 8)]
    first, second = (np.linalg.norm(b - a) for a, b in pairwise(tips))
    assert np.log2(first / second) > 1.95
    assert distance(tips[0], tips[-1]) < (5e-4 if robot.backbone.taper else 1e-5)


@pytest.mark.integration
@pytest.mark.parametrize("friction", ["none", "per-tendon", "per-hole"])
def test_the_energy_balance_closes_with_order_two_in_the_substeps(friction):
    """Pull to 2 N and release with a tip force: the balance by the trapezoidal rule closes with order two."""
    robot = single(0.3)
    pushed, free = {"tip": Load(LENGTH, (0.0, 0.03, 0.01))}, {"tip": Load(LENGTH)}
    cycle = [*pull(2.0, loads=pushed), *pull(0.3), *pull(1.5, loads=free), *pull(0.0)]
    gaps = []
    for parts in (8, 16, 32):
        found = ledger(solve(robot, divided(robot, cycle, parts), friction=friction))
        assert found.gain < 1e-9
        gaps.append(found.gap)
    assert gaps[-1] < 1e-4
    if friction == "none":
        assert abs(found.work) < 1e-6
    else:
        assert found.work > 5e-4
        assert gaps[-1] < 0.1 * gaps[0]
