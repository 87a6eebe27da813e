"""Campaigns: broken files and faulty data, the paper and its claims, effects that are given by name, the safety net."""

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identify_data import GRAVITY, measured

from tdcr_fe import Experiment, read_scenario
from tdcr_fe.cli import main as command
from tdcr_fe.io.files import LONGEST, Problem
from tdcr_fe.validation.campaigns.broken_files import Ran, draw, judge, run_case
from tdcr_fe.validation.campaigns.faulty_data import judge as judge_data
from tdcr_fe.validation.campaigns.given_effects import chosen_form
from tdcr_fe.validation.campaigns.net import CAMPAIGN, Case
from tdcr_fe.validation.faulty_data import FAULTS
from tdcr_fe.validation.measured_folder import write_measured
from tdcr_fe.validation.net.comparison import differences, report
from tdcr_fe.validation.net.storage import read_part, write_part
from tdcr_fe.validation.paper.cases import MARKED, MODELS, figure, write_cases
from tdcr_fe.validation.runner import main


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


JUDGED = [
    ("cannot tell", [], "The readings of a marker at s = 0.1 m jump.", "named"),
    ("cannot tell", [], "nothing", "cannot tell"),
    ("explained", ["gravity"], "nothing", "explained otherwise"),
    ("unexplained", [], "nothing", "not explained"),
    ("nothing missing", [], "a marker at s = 0.1 m", "nothing missing"),
]


@pytest.mark.parametrize(("verdict", "effects", "said", "outcome"), JUDGED)
def test_a_fault_must_be_named_or_left_open(tmp_path, verdict, effects, said, outcome):
    fault = next(f for f in FAULTS if f.name == "marker slips in the middle")
    result = {"verdict": verdict, "effects": [{"effect": e} for e in effects]}
    (tmp_path / "result.json").write_text(json.dumps(result))
    found = judge_data(fault, 0, "", said, tmp_path)
    assert found.outcome == outcome
    assert found.passed == (outcome in ("named", "cannot tell"))


# ------------------------------------------------------------ the paper


@pytest.mark.parametrize("name", MARKED)
def test_a_case_has_the_numbers_of_section_3_1(name):
    case = figure(name)
    backbone = case.robot.backbone
    assert (backbone.radius, backbone.youngs_modulus) == (0.4e-3, 85e9)
    assert backbone.length == (0.4 if name == "fig4" else 0.25)
    assert all(t.friction_coefficient == 0.3 for t in case.robot.tendons)
    assert set(MARKED[name]) <= {s.label for s in case.steps}


@pytest.mark.integration
def test_cases_are_written_for_tdcr_fe_run(tmp_path):
    written = write_cases(tmp_path)
    assert len(written) == len(MARKED) * len(MODELS)
    for path in written:
        scenario = read_scenario(path)
        assert scenario.model == MODELS[path.stem]
        assert scenario.steps == figure(path.parent.name).steps
    scenario = str(tmp_path / "fig5" / "per-tendon.toml")
    assert command(["run", scenario, "-o", str(tmp_path / "out"), "--no-pictures", "-q"]) == 0


@pytest.mark.integration
def test_the_campaign_judges_claims_and_writes_cases(tmp_path, capsys):
    assert main(["paper", "-o", str(tmp_path), "--only", "consistency", "stiffness"]) == 0
    text = (tmp_path / "paper.md").read_text(encoding="utf-8")
    assert "| Tables 1-4 are measurements of one elastic robot each | does not hold |" in text
    assert (tmp_path / "cases" / "fig3" / "per-hole.toml").exists()


# ------------------------------------------------------------ given effects


def test_the_command_prints_and_writes_what_each_takes_away(tmp_path, capsys):
    branches = ("one",) * 5 + ("other",) * 3 + ("both",) * 3
    data = replace(measured(GRAVITY), branches=branches)
    write_measured(data, tmp_path / "set")
    folders = [str(tmp_path / "set"), "-o", str(tmp_path / "out")]
    arguments = ["given_effects", *folders, "--hold-out", "both", "--effects"]
    assert main([*arguments, "gravity"]) == 0
    assert "gravity: g_x = " in capsys.readouterr().out
    (line,) = (tmp_path / "out" / "given_effects.jsonl").read_text().splitlines()[1:]
    declared, found = json.loads(line)["stages"]
    assert found["held_out"] < declared["held_out"]
    assert set(found["by_branch"]) == set(branches)
    by_branch = np.array([found["by_branch"][name] for name in ("one", "other")])
    assert by_branch.min() <= found["fitted"] <= by_branch.max()
    assert main([*arguments, "tendon_stretch (by segment)"]) == 2
    assert "options differ" in capsys.readouterr().err
    with pytest.raises(ValueError, match="no effect 'wind'"):
        chosen_form("wind", Experiment(data.robot, data.model))


# ------------------------------------------------------------ the safety net


STORED = Path(__file__).parents[1] / "net"


PARTS = [
    ("robots", "18"),
    ("robots", "40"),
    ("cases", "converging_straight_per-hole_gravity_10"),
    ("scenes", "ball"),
    ("scenes", "swing"),
    ("derivatives", "tension, per hole: friction_coefficient.mu"),
    ("files", "120"),
]


@pytest.mark.parametrize(("part", "key"), PARTS)
def test_a_case_is_the_stored_one(part: str, key: str, tmp_path: Path) -> None:
    """The whole net is compared by ``python -m tdcr_fe.validation net``."""
    found = CAMPAIGN.run(Case(part, key, STORED), tmp_path)
    assert found.passed, found.moved


def test_a_movement_is_named_with_its_place_and_size() -> None:
    """Numbers within and beyond the tolerance, a state, a shape, and an error in place of a result."""
    points = np.linspace(0.0, 0.2, 30).reshape(5, 2, 3)
    stored = {"positions": points, "tensions": np.ones((5, 4)), "states": "pp/pr"}
    assert not differences("robots", "7", stored, dict(stored), 1e-9)
    positions, tensions = stored["positions"].copy(), stored["tensions"].copy()
    positions[3, 1, 2] += 2e-6
    tensions[0, 0] += 1e-12
    found = {"positions": positions, "tensions": tensions, "states": "pp/ps"}
    moved = {d.quantity: d for d in differences("robots", "7", stored, found, 1e-9)}
    assert moved["positions"].step == 4 and moved["positions"].place == "[1, 2]"
    assert moved["positions"].size == pytest.approx(1e-5) and moved["positions"].beyond
    assert not moved["tensions"].beyond
    assert moved["states"].step == 2 and "'pr' is now 'ps'" in moved["states"].text
    lines = report({"robots": 3}, list(moved.values()))
    assert lines[1].split() == ["robots", "3", "2", "0", "1"]
    assert any("robots | 7, step 4 | positions [1, 2]" in line for line in lines)
    shorter = differences("robots", "7", stored, {**stored, "positions": positions[:4]}, 1e-9)
    assert shorter[0].beyond and "shape (5, 2, 3) is now (4, 2, 3)" in shorter[0].text
    assert all(d.beyond for d in differences("robots", "7", stored, {"failure": "StepFailed"}, 1e-9))


def test_the_command_ends_with_status_1_where_a_stored_number_is_another(tmp_path: Path, capsys) -> None:
    record = read_part("robots", STORED)["0"]
    tips = record["positions"].copy()
    tips[2, -1, 0] += 1e-7
    for name, status, stored in (("same", 0, record), ("other", 1, {**record, "positions": tips})):
        write_part("robots", {"0": stored}, tmp_path / name)
        arguments = ["--stored", str(tmp_path / name), "-o", str(tmp_path / name)]
        assert main(["net", "--parts", "robots", *arguments]) == status
    assert "robots | 0, step 3 | positions" in capsys.readouterr().out


def test_outside_a_checkout_it_says_where_the_net_is_looked_for(tmp_path: Path, capsys) -> None:
    assert main(["net", "--quick", "--stored", str(tmp_path / "nowhere"), "-o", str(tmp_path / "out")]) == 2
    assert "nowhere: the net is not there" in capsys.readouterr().err
