"""Data with one fault each: what is put in, and what is judged right."""

import json

import pytest

from tdcr_fe.validation.campaigns.faulty_data import judge
from tdcr_fe.validation.faulty_data import FAULTS


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
    found = judge(fault, 0, "", said, tmp_path)
    assert found.outcome == outcome
    assert found.passed == (outcome in ("named", "cannot tell"))


def test_an_error_must_name_the_fault():
    fault = FAULTS[0]
    assert judge(fault, 2, "values in mm?", "", None).passed
    assert judge(fault, 2, "wrong", "", None).outcome == "refused without naming it"


def test_an_effect_counts_as_named_by_the_effect_only(tmp_path):
    """The advice of a report may name effects that are not concluded."""
    fault = next(f for f in FAULTS if f.name == "camera turned by 14 degrees")
    (tmp_path / "result.json").write_text(json.dumps({"verdict": "unexplained", "effects": []}))
    assert judge(fault, 0, "", "perhaps frame_misalignment", tmp_path).outcome == "not explained"
