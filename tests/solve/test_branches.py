"""Load steps with several equilibria: the solution belongs to the branch that the robot is on."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.fuzz.drawing import draw
from tdcr_fe.validation.fuzz.energy import divided

PARTS = 8


@pytest.mark.parametrize("number", [2597, 2532])
def test_driven_by_displacement_bays_do_not_jump_beyond_their_buckling_load(number):
    """Tendons of a straight robot that are pulled in could hold it straight, compressed by 100 N in place of 0.2 N.

    One robot did not converge, as its first half ended there; the other one was 0.13 of its length off.
    """
    case = draw(number)
    whole = simulate(case.robot, case.model, case.steps)
    parts = simulate(case.robot, case.model, divided(case.robot, case.steps, PARTS))
    assert whole.converged and parts.converged
    for one, other in zip(whole.steps, parts.steps[PARTS - 1 :: PARTS], strict=True):
        np.testing.assert_allclose(
            one.positions, other.positions, rtol=0, atol=1e-5 * case.robot.backbone.length
        )
        np.testing.assert_allclose(one.base_tensions, other.base_tensions, rtol=0, atol=1e-3)
