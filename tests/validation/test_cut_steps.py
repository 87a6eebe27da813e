"""Load steps of random robots as a whole against the same steps cut in parts."""

from __future__ import annotations

import pytest

from tdcr_fe.validation.cut_steps import cut
from tdcr_fe.validation.cut_steps.__main__ import main
from tdcr_fe.validation.random_robots.drawing import draw


def test_parts_of_a_step_end_where_the_step_ends():
    case = draw(20)
    parts = cut(case, 4)
    assert len(parts) == 4 * len(case.steps)
    for step, last in zip(case.steps, parts[3::4], strict=True):
        assert last.tensions == pytest.approx(step.tensions)
        assert last.displacements == pytest.approx(step.displacements)
        if step.loads:
            assert last.loads["tip"].force == pytest.approx(step.loads["tip"].force)


def test_a_robot_of_three_tendons_does_not_depend_on_how_its_steps_are_cut(capsys):
    assert main(["-n", "1", "--first", "20", "--parts", "8"]) == 0
    assert "unsaid: 0" in capsys.readouterr().out


def test_states_far_from_the_path_do_not_spoil_it(capsys):
    """Near a buckling load: with states that lay far from the path, the last step moved by 1.2e-5 unsaid."""
    assert main(["-n", "1", "--first", "16", "--tendons", "5", "--parts", "16"]) == 0
    assert "unsaid: 0" in capsys.readouterr().out
