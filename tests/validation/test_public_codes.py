"""Robots of two public codes: the equations against published tips, and `tdcr-fe run` against the equations."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting, Routing
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.validation.campaigns.public_codes import compare, draw
from tdcr_fe.validation.public_codes import solve

SOURCE = "equations of SvenLilge/tdcr-modeling and TIMClab-CAMI at tight tolerance; both agree to 1e-8 of the length"


def single(routing: Routing) -> Robot:
    backbone = Backbone(0.25, 0.4e-3, 85e9, 0.3)
    return Robot(backbone, Disks.equally_spaced(12, 0.25), (Tendon("t", routing),))


def two_segments() -> Robot:
    positions = (*(0.15 * np.arange(1, 7) / 6).tolist(), *(0.15 + 0.25 * np.arange(1, 11) / 10).tolist())
    first = [
        Tendon(f"a{k}", ParallelRouting(4.5e-3, a), end=0.15) for k, a in enumerate((90.0, -30.0, 210.0))
    ]
    second = [Tendon(f"b{k}", ParallelRouting(3e-3, a)) for k, a in enumerate((30.0, 150.0, 270.0))]
    return Robot(Backbone(0.4, 0.4e-3, 85e9, 0.3), Disks(positions), (*first, *second))


#: Robot, tensions, tip force, tendon path, tip and tip tangent.
PUBLISHED = {
    "straight": (
        single(ParallelRouting(4.5e-3, 90.0)),
        {"t": 1.5},
        (0.0, 0.0, 0.0),
        "straight",
        (0.0, 0.116729591, 0.208913102),
        (0.0, 0.8516199, 0.5241598),
    ),
    "continuous, tip force": (
        single(ParallelRouting(4.5e-3, 90.0)),
        {"t": 1.5},
        (0.05, 0.0, 0.0),
        "continuous",
        (0.114854092, 0.091730689, 0.183677266),
        (0.6498777, 0.6678782, 0.3627639),
    ),
    "two segments": (
        two_segments(),
        {"a0": 1.5, "b0": 1.2},
        (0.0, 0.0, 0.0),
        "continuous",
        (0.128612154, 0.232111762, 0.265667176),
        (0.6075647, 0.7237992, 0.3270778),
    ),
    "helical": (
        single(HelicalRouting(4.5e-3, 2.0)),
        {"t": 1.2},
        (0.0, 0.0, 0.0),
        "continuous",
        (2.5530e-5, 0.015802078, 0.249006139),
        (-0.0124805, 0.0012600, 0.9999213),
    ),
    "converging, tip force": (
        single(ConvergingRouting(4.5e-3, 0.15e-3)),
        {"t": 1.5},
        (0.05, 0.0, 0.0),
        "continuous",
        (0.157687722, 0.0, 0.178131348),
        (0.8763387, 0.0, 0.4816954),
    ),
}


@pytest.mark.parametrize(
    "name",
    ["straight", pytest.param("two segments")]
    + [
        pytest.param(n, marks=pytest.mark.campaign)
        for n in ("continuous, tip force", "helical", "converging, tip force")
    ],
)
def test_the_equations_give_the_published_tips(name: str) -> None:
    """Source: see SOURCE. The digits agree to 1e-8 of the length, which is what the source claims for itself."""
    robot, tensions, force, path, tip, tangent = PUBLISHED[name]
    found = solve(robot, tensions, np.array(force), path)
    np.testing.assert_allclose(found.tip, tip, atol=1.2e-8 * robot.backbone.length + 5e-10)
    np.testing.assert_allclose(found.tangent, tangent, atol=1.5e-7)


@pytest.mark.integration
@pytest.mark.parametrize("number", range(4))
def test_run_meets_the_equations_with_default_settings(number: int, tmp_path) -> None:
    """Two segments, six tendons: tip within 0.05 % of the length, or the summary's estimate says more."""
    found = compare(draw(number), tmp_path)
    assert found.passed, (number, found)
