"""Broken input files and data with one fault each: a named error and nothing written, or a valid run."""

import itertools
import json

import pytest

from tdcr_fe.io.problems import LONGEST, Problem
from tdcr_fe.validation.campaigns.broken_files import Ran, draw, judge, run_case
from tdcr_fe.validation.campaigns.faulty_data import judge as judge_data
from tdcr_fe.validation.faulty_data import FAULTS


@pytest.mark.integration
@pytest.mark.parametrize("first", [5000, 5020])
def test_broken_files_are_refused_by_name_or_are_valid(first):
    """The first 2000 inputs showed a traceback, warnings of numpy and tables that took a minute to be refused."""
    cases = [draw(number) for number in range(first, first + 20)]
    # The search of `identify` takes seconds: of its inputs only those that are certainly wrong are run here.
    quick = [c for c in cases if c.inputs.name != "identify" or c.change.must_be_refused]
    assert [o for o in map(run_case, quick) if not o.passed] == []


def test_the_judge_sees_what_is_wrong():
    case = next(c for c in map(draw, itertools.count()) if c.change.must_be_refused and c.change.key == "")
    file = case.change.file
    good = f"tdcr-fe: 1 mistake in the input; nothing was written\n  {file}: no such file\n"
    assert judge(case, Ran(2, good), 0.1, []) == "refused"
    assert judge(case, Ran(2, good), 0.1, [file]) == "refused, but files were written"
    assert judge(case, Ran(2, "tdcr-fe: stopped\n"), 0.1, []) == "refused without a name"
    assert judge(case, Ran(0, ""), 0.1, []) == "not refused"
    assert judge(case, Ran(-1, "Traceback (most recent call last):\n"), 0.1, []) == "traceback"
    assert judge(case, Ran(2, good), 100.0, []) == "hang"
    assert judge(case, Ran(130, "", "reading"), 10.0, []) == "hang"
    assert judge(case, Ran(130, "", "solving"), 10.0, []) == "hang"
    may = next(c for c in map(draw, itertools.count()) if not c.change.must_be_refused)
    assert judge(may, Ran(130, "", "solving"), 10.0, []) == "valid, long"
    assert judge(case, Ran(2, 3000 * good), 0.1, []) == "endless message"


def test_a_long_value_is_shortened_in_its_message():
    """A name of 100,000 characters was printed twice."""
    text = str(Problem("robot.toml", "name", 100_000 * "x", "must be shorter"))
    assert len(text) < 2 * LONGEST and text.startswith("robot.toml: name = xxx")
    assert text.endswith("xxx: must be shorter")


# ------------------------------------------------------------ faulty data


@pytest.mark.parametrize(
    ("verdict", "effects", "said", "outcome"),
    [
        ("cannot tell", [], "The readings of a marker at s = 0.1 m jump.", "named"),
        ("cannot tell", [], "nothing", "cannot tell"),
        ("explained", ["gravity"], "nothing", "explained otherwise"),
        ("unexplained", [], "nothing", "not explained"),
        ("nothing missing", [], "a marker at s = 0.1 m", "nothing missing"),
    ],
)
def test_a_fault_must_be_named_or_left_open(tmp_path, verdict, effects, said, outcome):
    fault = next(f for f in FAULTS if f.name == "marker slips in the middle")
    result = {"verdict": verdict, "effects": [{"effect": e} for e in effects]}
    (tmp_path / "result.json").write_text(json.dumps(result))
    found = judge_data(fault, 0, "", said, tmp_path)
    assert found.outcome == outcome
    assert found.passed == (outcome in ("named", "cannot tell"))
