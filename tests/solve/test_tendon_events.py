"""Tendons driven by displacement that become taut or slack within a load step, and what that reverses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from linear_slips import LinearSlips
from robots import LENGTH, distance, solve, three

from tdcr_fe.model.loading import LoadStep
from tdcr_fe.solve.friction_path.follow import follow_friction

DELTA = 1e-6


def tendon_over_one_hole(by_load, tension, slack):
    """Rates of a hole whose slip the tension moves by 0.5 mm/N, and of a tendon with 1 mm of slack per newton.

    `by_load`: of the slip and of minus the slack [m]; `tension`: at the start [N].
    """
    matrix = np.array([[DELTA, -5e-4], [0.0, 1e-3]])
    start = np.array([-1.0, tension])
    slips = LinearSlips([by_load, by_load], [matrix, matrix], start, DELTA, 1, [slack])
    return follow_friction(slips, start[:1], start[1:], np.ones(1)), slips


def test_a_tendon_becomes_taut_where_its_slack_is_used_up():
    """1 mm of slack at 2 mm per step: taut at 1/2, 1 N at the end; the slip rate turns from -0.3 to 0.7 mm."""
    path, slips = tendon_over_one_hole([-3e-4, 2e-3], 0.0, 1e-3)
    assert path.complete and path.reversed.all()
    assert path.unknowns == pytest.approx([1.0, 1.0], rel=1e-6)
    assert path.reversal_factor == pytest.approx([0.5], abs=1e-6)
    assert path.reversal_slip == pytest.approx([-1.5e-4], rel=1e-6)
    assert slips.slip(1.0, path.unknowns) == pytest.approx([-1.5e-4 + 3.5e-4, 0.0], rel=1e-2, abs=1e-9)


def test_a_tendon_becomes_slack_where_its_tension_ends():
    """1 N that falls by 2 N per step: slack at 1/2, by 1 mm at the end."""
    path, slips = tendon_over_one_hole([-3e-4, -2e-3], 1.0, 0.0)
    assert path.complete and not path.reversed.any()
    assert path.unknowns == pytest.approx([-1.0, 0.0], abs=1e-9)
    assert slips.slip(1.0, path.unknowns) == pytest.approx([-3e-4 - 5e-4, -1e-3], rel=1e-6)


def test_a_tendon_may_become_slack_and_taut_again():
    """The load turns: 0.5 N - 4 N x (1 - x) is zero from x = 0.15 to 0.85, and 0.5 N again at the end."""
    matrix = np.array([[DELTA, 0.0], [0.0, 1e-3]])
    slips = LinearSlips([[0.0, -4e-3], [0.0, 4e-3]], [matrix, matrix], [0.0, 0.5], DELTA, 1, [0.0])
    path = follow_friction(slips, np.zeros(1), np.array([0.5]), np.ones(1))
    assert path.complete
    assert path.unknowns[1] == pytest.approx(0.5, rel=1e-6)


def slack_until_late() -> list[LoadStep]:
    """The third tendon of `three` is slack until shortly before the end of the second step."""
    return [
        LoadStep("", displacements={"t1": 1e-3, "t2": -2.5531158e-3, "t3": -2.1764913e-3}),
        LoadStep("", displacements={"t1": 2e-3, "t2": -5.0532918e-3, "t3": -0.9379651e-3}),
    ]


@pytest.mark.integration
def test_slips_that_reverse_where_a_tendon_becomes_taut_are_found():
    """Version 0.1 was 9.6e-4 of the length off, unsaid: holes let out until the tendon was taut, then pulled."""
    steps = slack_until_late()
    found = solve(three(0.3), steps)
    fine = solve(three(0.3), [replace(s, substeps=512) for s in steps])
    assert found.steps[1].hole_states[2][:-1] == ("pull",) * 12
    assert distance(found.tips, fine.tips) < 1e-6 * LENGTH
    assert found.steps[1].substeps <= 2
