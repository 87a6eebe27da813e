"""Random robots: both solvers with default settings agree, and the records of a run are kept."""

import numpy as np
import pytest

from tdcr_fe.validation.random_robots import FINITE_ELEMENTS, REFERENCE, answers, compare, draw, solve
from tdcr_fe.validation.random_robots.__main__ import main
from tdcr_fe.validation.random_robots.campaign import solve_all
from tdcr_fe.validation.random_robots.comparison import StepComparison


@pytest.mark.parametrize("number", [0, 6, 10])
def test_finite_elements_and_reference_agree_with_default_settings(number):
    """To the error that the finite elements announce; 500 robots: the command of docs/validation.md."""
    found = compare(solve(number, FINITE_ELEMENTS), solve(number, REFERENCE))
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


def test_reference_is_kept_on_request_when_code_changes_and_broken_files_are_solved_anew(
    tmp_path, monkeypatch
):
    """An answer of other code counts for the reference alone, and only by option; a broken file counts as none."""
    number = 6
    for solver in (FINITE_ELEMENTS, REFERENCE):
        answers.write(solve(number, solver), tmp_path)
    known = answers.read(number, REFERENCE, tmp_path)
    assert known is not None
    monkeypatch.setattr(answers, "digest", lambda solver: "other code")
    assert answers.read(number, REFERENCE, tmp_path) is None
    assert answers.read(number, REFERENCE, tmp_path, any_version=True) == known
    (again,) = solve_all([number], tmp_path, 1, keep_reference=True)
    assert (
        again.seconds_reference == known.seconds
        and answers.read(number, FINITE_ELEMENTS, tmp_path) is not None
    )
    for text in ("[1, 2]", "{", '{"digest": "other code", "answer": {"number": 6}}'):
        (tmp_path / f"case_{number}_{REFERENCE}.json").write_text(text)
        assert answers.read(number, REFERENCE, tmp_path, any_version=True) is None


def test_error_of_the_program_is_a_failure_of_its_case(monkeypatch):
    """The case is reported, the others go on."""

    def broken(*_):
        raise FloatingPointError("on purpose")

    monkeypatch.setitem(answers.SOLVERS, FINITE_ELEMENTS, broken)
    found = compare(solve(6, FINITE_ELEMENTS), solve(6, REFERENCE))
    assert found.failures == ("fe: FloatingPointError: on purpose",) and not found.passed
