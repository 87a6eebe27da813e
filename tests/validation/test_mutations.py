"""The campaign that breaks the product by hand: it finds its lines, and says which test notices."""

from __future__ import annotations

from pathlib import Path

import pytest

from tdcr_fe.validation.campaigns.mutations import CAMPAIGN, MUTATIONS, Outcome, place, run_tests


def test_a_line_is_found_where_it_occurs_once(tmp_path: Path) -> None:
    (tmp_path / "elements").mkdir()
    (tmp_path / "elements" / "a.py").write_text("x = 1\ny = 2\ny = 2\n")
    assert place("x = 1", tmp_path) == Path("elements/a.py")
    for line, times in (("y = 2", 2), ("z = 3", 0)):
        with pytest.raises(ValueError, match=f"occurs {times} times: '{line}'"):
            place(line, tmp_path)


def test_the_lines_of_all_mutations_are_in_the_product() -> None:
    tests = Path(__file__).parents[1]
    for mutation in MUTATIONS.values():
        place(mutation.line, tests.parent)
        assert all((tests / file).exists() for file in mutation.near)


def test_the_first_test_that_fails_is_named_and_what_cannot_run_is_no_catch(tmp_path: Path) -> None:
    file = tmp_path / "test_numbers.py"
    file.write_text("def test_sum():\n    assert 1 + 1 == 2\n\ndef test_product():\n    assert 2 * 3 == 7\n")
    assert run_tests(tmp_path, [file.name], "default", 0) == "test_numbers.py::test_product"
    assert run_tests(tmp_path, [f"{file.name}::test_sum"], "default", 0) == ""
    with pytest.raises(RuntimeError):
        run_tests(tmp_path, ["not_there.py"], "default", 0)


def test_two_may_be_left_to_the_integration_tests() -> None:
    outcomes = [
        Outcome(str(k), "elements/a.py", "default" if k > 1 else "integration", "t", "") for k in range(4)
    ]
    assert CAMPAIGN.passed(outcomes)
    assert not CAMPAIGN.passed([*outcomes, Outcome("4", "elements/a.py", "integration", "t", "")])
    assert not CAMPAIGN.passed([*outcomes, Outcome("4", "elements/a.py", "", "", "")])
    assert CAMPAIGN.report(outcomes)[-1] == "4 mutations: 2 caught by the default tests, 4 by all tests"
