"""Substeps that are accepted because every hole keeps slipping: against the same load steps cut into 64."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_robots import random_robot
from robots import paper, pull, solve, three

from tdcr_fe.model.loading import LoadStep
from tdcr_fe.solve.load_steps import substep_reversals


@pytest.fixture
def verdicts(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """What the check says of every substep it is asked about."""
    found: list[bool] = []
    check = substep_reversals.slips_steadily

    def recorded(*given: object) -> bool:
        found.append(check(*given))
        return found[-1]

    monkeypatch.setattr(substep_reversals, "slips_steadily", recorded)
    return found


def gap(robot, steps):
    """Largest distance between the last shapes of the steps as they are and cut into 64, over the length."""
    whole = solve(robot, steps)
    cut = solve(robot, [replace(s, substeps=64) for s in steps])
    length = robot.backbone.length
    return np.max(np.abs(whole.steps[-1].positions - cut.steps[-1].positions)) / length


def test_pulling_is_steady_and_exact(verdicts):
    """From rest, with every hole from stick to slip, and on from there: one solve a step."""
    assert gap(paper(0.3), pull(0.6, 1.0)) < 1e-8
    assert verdicts == [True, True]


def test_where_holes_stick_in_the_end_the_step_is_looked_at_more_closely(verdicts):
    solve(paper(0.3), pull(0.8, 0.7))
    assert verdicts == [True, False]


def test_a_tendon_released_while_others_are_pulled(verdicts):
    """Its holes reverse at the start of the step; they all slip the other way in the end."""
    steps = [
        LoadStep("pull", {"t1": 1.0, "t2": 0.2, "t3": 0.2}),
        LoadStep("bend over", {"t1": 0.3, "t2": 0.9, "t3": 0.2}),
    ]
    assert gap(three(0.1), steps) < 1e-5


@pytest.mark.integration
@pytest.mark.parametrize("seed", range(6))
def test_steps_accepted_by_the_check_are_exact(verdicts, seed):
    """Random tensions of two tendons, up and down."""
    robot, draw = random_robot(2, seed), np.random.default_rng(seed)
    tensions = draw.uniform(0.0, 0.6, (4, 2))
    steps = [LoadStep(f"{k}", {"t0": float(x[0]), "t1": float(x[1])}) for k, x in enumerate(tensions)]
    for count in range(1, 5):
        verdicts.clear()
        found = gap(robot, steps[:count])
        if all(verdicts):
            assert found < 1e-6
