"""Load steps with several equilibria: the solution belongs to the branch that the robot is on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdcr_fe.solve.load_steps import stepping
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


def test_the_refinement_of_a_step_of_which_no_substep_converges_is_given_up_soon(monkeypatch):
    """With friction that falls with the rate, every smallest substep was tried with 400 iterations: ten minutes."""
    tried = []
    real = stepping.SubstepSolver.rescue

    def rescue(solver, state, start, end, failed):
        tried.append(end)
        return real(solver, state, start, end, failed)

    monkeypatch.setattr(stepping.SubstepSolver, "rescue", rescue)
    monkeypatch.setattr(stepping, "MOST_RESCUED", 1)
    case = draw(2621)
    steps = divided(case.robot, case.steps, 8)[:17]
    result = simulate(case.robot, replace(case.model, elements_per_bay=2), steps)
    assert result.converged
    assert 0 < len(tried) <= 4
