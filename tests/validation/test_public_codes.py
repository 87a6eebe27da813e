"""Robots of two public codes: the equations against published tips, and `tdcr-fe run` against the equations."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_fe.validation.campaigns.public_codes import compare, draw
from tdcr_fe.validation.crosscheck.studies import LITERATURE
from tdcr_fe.validation.public_codes import solve


@pytest.mark.parametrize(
    "number", [0, 2, *(pytest.param(n, marks=pytest.mark.integration) for n in (1, 3, 4))]
)
def test_the_equations_give_the_published_tips(number: int) -> None:
    """The digits agree to 1e-8 of the length, which is what the source claims for itself."""
    _, robot, path, step, tip, tangent = LITERATURE[number]
    force = np.array(step.loads["tip"].force if step.loads else (0.0, 0.0, 0.0))
    found = solve(robot, dict(step.tensions), force, path)
    np.testing.assert_allclose(found.tip, tip, atol=1.2e-8 * robot.backbone.length + 5e-10)
    np.testing.assert_allclose(found.tangent, tangent, atol=1.5e-7)


@pytest.mark.integration
@pytest.mark.parametrize("number", range(4))
def test_run_meets_the_equations_with_default_settings(number: int, tmp_path) -> None:
    """Two segments, six tendons: tip within 0.05 % of the length, or the summary's estimate says more."""
    found = compare(draw(number), tmp_path)
    assert found.passed, (number, found)
