"""Broken input files and data with one fault each: a named error and nothing written, or a valid run."""

from __future__ import annotations

import hashlib
import itertools
import json
import signal
import time

import pytest

from tdcr_fe.io.problems import LONGEST, Problem
from tdcr_fe.validation.broken_files.mutations import MUTATIONS
from tdcr_fe.validation.broken_files.toml_mutations import paths, to_toml
from tdcr_fe.validation.campaigns import broken_files
from tdcr_fe.validation.campaigns.broken_files import Ran, draw, judge, run_case
from tdcr_fe.validation.campaigns.faulty_data import judge as judge_data
from tdcr_fe.validation.faulty_data import FAULTS


@pytest.mark.integration
@pytest.mark.parametrize("first", [5000, 5020, 5040])
def test_broken_files_are_refused_by_name_or_are_valid(first):
    """The first 2000 inputs showed a traceback, warnings of numpy and tables that took a minute to be refused."""
    cases = [draw(number) for number in range(first, first + 20)]
    # The search of `identify` takes seconds: of its inputs only those that are certainly wrong are run here.
    quick = [c for c in cases if c.inputs.name != "identify" or c.change.must_be_refused]
    assert [o for o in map(run_case, quick) if not o.passed] == []


def test_seeds_break_the_same_files_as_ever():
    """All but the summaries, in which there is the time of a run."""
    cases = [case for case in map(draw, range(150)) if case.change.file != "summary.json"]
    digest = hashlib.sha256(repr([c.change for c in cases if c.inputs.name != "view"]).encode())
    assert digest.hexdigest()[:16] == "8509e28eb1161b46"
    assert len({c.change.mutation for c in cases}) > 0.7 * len(MUTATIONS)


def test_the_text_of_mutated_data_is_toml():
    import tomllib

    data = {"a": 1, "b c": [0.5, 'x"\\\n\x00ü'], "t": [{"k": True}, {}]}
    assert tomllib.loads(to_toml(data)) == data
    assert (("t", 0, "k") in set(paths(data))) and len(list(paths(data))) == 8


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


def _compute(seconds: float) -> None:
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs timers of the system")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_the_limit_counts_processor_time_and_is_not_swallowed(monkeypatch):
    """On a busy machine 54 of 2000 were judged to hang or to have failed, as the limit was one of the clock."""

    class Slow:
        def __del__(self):
            _compute(0.2)

    monkeypatch.setattr(broken_files, "TIME_LIMIT", 0.05)
    monkeypatch.setattr(broken_files, "GRACE", 0.3)
    where: list[str] = []
    with broken_files._limited(where):
        time.sleep(0.2)
    assert where == []
    with pytest.raises(KeyboardInterrupt), broken_files._limited(where):
        slow = Slow()
        del slow  # an exception within a destructor is swallowed
        _compute(0.6)
    assert "reading" in where


def test_a_long_value_is_shortened_in_its_message():
    """A name of 100,000 characters was printed twice."""
    text = str(Problem("robot.toml", "name", 100_000 * "x", "must be shorter"))
    assert len(text) < 2 * LONGEST and text.startswith("robot.toml: name = xxx")
    assert text.endswith("xxx: must be shorter")


# ------------------------------------------------------------ faulty data


def test_there_are_forty_different_faults():
    assert len(FAULTS) == 40 == len({f.name for f in FAULTS})


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


def test_an_error_must_name_the_fault():
    fault = FAULTS[0]
    assert judge_data(fault, 2, "values in mm?", "", None).passed
    assert judge_data(fault, 2, "wrong", "", None).outcome == "refused without naming it"


def test_an_effect_counts_as_named_by_the_effect_only(tmp_path):
    """The advice of a report may name effects that are not concluded."""
    fault = next(f for f in FAULTS if f.name == "camera turned by 14 degrees")
    (tmp_path / "result.json").write_text(json.dumps({"verdict": "unexplained", "effects": []}))
    assert judge_data(fault, 0, "", "perhaps frame_misalignment", tmp_path).outcome == "not explained"
