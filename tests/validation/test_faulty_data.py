"""Data with one fault each: what is put in, and what is judged right."""

import json

import pandas as pd
import pytest

from tdcr_fe.validation.campaigns.faulty_data import judge
from tdcr_fe.validation.faulty_data import FAULTS, Tables
from tdcr_fe.validation.runner import main


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


def test_tables_are_changed_and_written(tmp_path):
    robot = "length = 0.2\n"
    readings = pd.DataFrame(
        [(k, f"position_{a}", x, 0.1, 1e-4) for k in range(1, 5) for a in "xyz" for x in ("0.1", "0.2")],
        columns=["step", "quantity", "location", "value", "sigma"],
    )
    loading = pd.DataFrame({"step": range(1, 5), "tension_t1": 1.0})
    tables = Tables(loading, readings, robot, "")
    for name, check in {
        "positions in mm": lambda t: t.observations["value"].eq(100.0).all(),
        "first and last marker exchanged": lambda t: t.observations["location"].iloc[0] == "0.2",
        "length a tenth too short": lambda t: t.robot == "length = 0.18000000000000002\n",
        "two steps": lambda t: len(t.steps) == 0,
    }.items():
        next(f for f in FAULTS if f.name == name).change(tables, None)
        assert check(tables), name
    tables.write(tmp_path)
    assert (tmp_path / "robot.toml").read_text() == tables.robot


@pytest.mark.campaign
def test_refused_and_insufficient_data_are_right_outcomes(tmp_path):
    """Millimetres, angles in degrees, one reading."""
    assert main(["faulty_data", "-o", str(tmp_path), "--only", "1", "4", "5"]) == 0
    table = pd.read_csv(tmp_path / "faulty_data.csv").set_index("fault")
    assert table["outcome"].tolist() == ["refused", "refused", "named"]
