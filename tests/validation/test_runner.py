"""The runner of campaigns: the list, options, resuming, tables; and the mutations of the product."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from tdcr_fe.validation import runner
from tdcr_fe.validation.campaigns.mutations import MUTATIONS, place, run_tests
from tdcr_fe.validation.runner import Campaign, main


@dataclass(frozen=True)
class Square:
    number: int
    size: int
    passed: bool


class Squares(Campaign):
    """Squares of seeds; those from ``limit`` on do not pass."""

    unit, count, outcome = "number", 4, Square

    def __init__(self):
        self.solved, self.limit, self.interrupted_at = [], 100, None

    def run(self, case, out):
        if case == self.interrupted_at:
            raise KeyboardInterrupt
        self.solved.append(case)
        return Square(case, case**2, case < self.limit)


@pytest.fixture
def squares(monkeypatch):
    campaign = Squares()
    monkeypatch.setattr(runner, "load", lambda name: campaign)
    monkeypatch.setattr(runner, "names", lambda: ["squares"])
    monkeypatch.setattr(runner, "_text", lambda name: "Squares of numbers.")
    return campaign


def test_every_campaign_is_listed_with_a_description_and_loads(capsys):
    assert main([]) == 0
    lines = capsys.readouterr().out.split("campaigns:")[1].splitlines()
    listed = dict(line.split(maxsplit=1) for line in lines if line)
    assert list(listed) == runner.names()
    for name, text in listed.items():
        assert text.endswith(".") and len(text) > 20
        assert isinstance(runner.load(name), Campaign)


def test_results_are_kept_and_nothing_is_run_twice(squares, tmp_path, capsys):
    assert main(["squares", "-n", "2", "-o", str(tmp_path)]) == 0
    assert main(["squares", "-n", "3", "--first", "1", "-o", str(tmp_path)]) == 0
    assert squares.solved == [0, 1, 2, 3]
    assert "3 of 3 numbers passed" in capsys.readouterr().out
    assert (tmp_path / "squares.csv").read_text() == "number,size,passed\n1,1,True\n2,4,True\n3,9,True\n"
    assert "| 3 | 9 | True |" in (tmp_path / "squares.md").read_text()


def test_a_case_that_was_interrupted_is_run_when_it_is_started_again(squares, tmp_path, capsys):
    squares.interrupted_at = 2
    assert main(["squares", "-o", str(tmp_path)]) == 130
    assert "start it again to resume" in capsys.readouterr().err
    squares.interrupted_at = None
    assert main(["squares", "-o", str(tmp_path)]) == 0
    assert squares.solved == [0, 1, 2, 3]


def test_only_those_that_did_not_pass_are_run_again(squares, tmp_path):
    squares.limit = 2
    assert main(["squares", "-o", str(tmp_path)]) == 1
    squares.limit = 100
    assert main(["squares", "--again", "-o", str(tmp_path)]) == 0
    assert squares.solved == [0, 1, 2, 3, 2, 3]


def test_results_of_other_code_are_refused(squares, tmp_path, capsys, monkeypatch):
    main(["squares", "-o", str(tmp_path)])
    monkeypatch.setattr(runner, "source_digest", lambda: "other")
    assert main(["squares", "-o", str(tmp_path)]) == 2
    assert len(squares.solved) == 4
    assert "source differ" in capsys.readouterr().err


def test_an_unknown_campaign_gets_the_nearest_name(squares, capsys):
    assert main(["sqares"]) == 2
    assert "did you mean squares?" in capsys.readouterr().err


# ------------------------------------------------------------ mutations


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
