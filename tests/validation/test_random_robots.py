"""Random robots: both solvers with default settings agree, and the records of a run are kept."""

import numpy as np
import pytest

from tdcr_fe.validation.random_robots import compare, draw
from tdcr_fe.validation.random_robots.__main__ import main
from tdcr_fe.validation.random_robots.comparison import StepComparison


@pytest.mark.parametrize("number", [0, 6, 10])
def test_finite_elements_and_reference_agree_with_default_settings(number):
    """To the error that the finite elements announce; 500 robots: the command of docs/validation.md."""
    found = compare(draw(number))
    assert found.passed and not found.failures
    assert found.gap < 2.0 * max(step.estimate for step in found.steps) + 1e-6


def test_drawing_covers_all_numbers_of_tendons_and_drives():
    """One to six tendons; tension, displacement, elastic tendons."""
    cases = [draw(number) for number in range(60)]
    assert {len(case.robot.tendons) for case in cases} == set(range(1, 7))
    elastic = {(case.by_displacement, case.robot.tendons[0].axial_stiffness is not None) for case in cases}
    assert elastic == {(False, False), (True, False), (True, True)}
    assert draw(7) == draw(7)


@pytest.mark.parametrize(
    ("gap", "estimate", "announced", "passed"),
    [
        (9e-4, 0.0, False, True),
        (2e-3, 0.0, False, False),
        (2e-3, 1.1e-3, False, True),
        (0.1, 0.0, True, True),
    ],
)
def test_difference_must_be_small_or_announced(gap, estimate, announced, passed):
    """0.1 % of the length, twice the announced error of the mesh, or a warning that names the step."""
    assert StepComparison(gap, estimate, announced, 1.0).passed is passed


def test_second_run_takes_the_records_of_the_first(tmp_path, capsys, monkeypatch):
    """A run that is started again solves nothing that is finished."""
    out = tmp_path / "out"
    arguments = ["-n", "2", "--first", "6", "-o", str(out)]
    assert main(arguments) == 0
    first = capsys.readouterr().out
    monkeypatch.setattr("tdcr_fe.validation.random_robots.campaign.worker_pool", None)
    assert main(arguments) == 0
    assert capsys.readouterr().out == first
    table = np.genfromtxt(out / "random_robots.csv", delimiter=",", names=True, usecols=(0, 1, 2))
    assert table["number"].tolist() == [6, 7]
