"""``tdcr-fe follow``: the loading sequence it writes, solved again by ``tdcr-fe run``, leads through the targets."""

import json
import signal

import numpy as np
import pandas as pd
import pytest
from inputs import said
from robots import LENGTH, three

from tdcr_fe import LoadStep, Model, cli, model_to_toml, robot_to_toml, simulate
from tdcr_fe.commands import common

ROBOT, MODEL = three(0.2), Model(elements_per_bay=1)
ONE = ["--largest", "1"]


@pytest.fixture
def robot(tmp_path):
    (tmp_path / "robot.toml").write_text(robot_to_toml(ROBOT))
    (tmp_path / "model.toml").write_text(model_to_toml(MODEL))
    return tmp_path / "robot.toml"


def command(robot, path, *options):
    """The command with this text as path.csv."""
    folder = robot.parent
    (folder / "path.csv").write_text(path)
    files = [robot, folder / "path.csv", "-o", folder / "out", "--model", folder / "model.toml"]
    return ["follow", *map(str, files), "--no-pictures", *options]


@pytest.mark.parametrize("kind", ["tension", "displacement"])
def test_run_reproduces_the_path(tmp_path, robot, capsys, kind):
    steps = [LoadStep(tensions={"t1": 0.5, "t2": 0.3, "t3": 0.2}), LoadStep(tensions={"t1": 0.3, "t2": 0.6})]
    tips = simulate(ROBOT, MODEL, steps).tips
    rows = [f"{k},{x!r},{y!r},{z!r}" for k, (x, y, z) in enumerate(tips.tolist(), start=1)]
    options = ["--tolerance", "2.5e-7", *(["--displacements"] if kind == "displacement" else [])]
    path = "\n".join(["step,x,y,z", *rows])
    assert cli.main(command(robot, path, "--largest", "2", "--pretension", "0.1", *options)) == 0
    assert "2 reached" in capsys.readouterr().out
    out = tmp_path / "out"
    table = pd.read_csv(out / "targets.csv")
    assert list(table["status"]) == ["reached"] * 2 and (table["error"] <= 1e-6 * LENGTH).all()
    again = tmp_path / "again"
    scenario = out / "scenario" / "scenario.toml"
    assert cli.main(["run", str(scenario), "-o", str(again), "--no-pictures", "-q"]) == 0
    found = pd.read_csv(again / "steps.csv")
    columns = ["tip_x", "tip_y", "tip_z"]
    assert np.array_equal(pd.read_csv(out / "steps.csv")[columns], table[columns])
    # Linearisations that are kept between load steps make the last digits depend on the steps before.
    assert np.abs(found[columns] - table[columns]).to_numpy().max() <= 1e-7 * LENGTH
    assert np.linalg.norm(found[columns] - tips, axis=1).max() <= 1e-6 * LENGTH
    summary = json.loads((out / "summary.json").read_text())
    assert summary["targets"]["reached"] == 2 and summary["targets"]["drive_by"] == kind
    assert set(summary["input"]) == {"robot.toml", "path.csv", "model.toml"}


def test_a_target_out_of_reach_is_named_and_the_exit_status_is_0(tmp_path, robot, capsys):
    path = "step;x;y;z;dx;dy;dz;label\n1;0,0;0,0;0,3;;;;above\n"
    assert cli.main(command(robot, path, "--largest", "t1=2", "t2=2", "t3=1.5")) == 0
    out, err = capsys.readouterr()
    assert "targets       1: 0 reached within 0.25 mm, 1 out of reach" in out
    assert "out of reach: 1 target (1), at most 50 mm away; see" in err and "targets.csv" in err
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["targets"]["out_of_reach"] == [1]
    assert summary["targets"]["largest"] == {"t1": 2.0, "t2": 2.0, "t3": 1.5}


def test_an_empty_cell_leaves_a_coordinate_open(tmp_path, robot, capsys):
    assert cli.main(command(robot, "step,x,y,z\n1,0.05,0.0,\n", "--largest", "2", "--pretension", "0.1")) == 0
    table = pd.read_csv(tmp_path / "out" / "targets.csv")
    assert table["status"][0] == "reached" and np.isnan(table["z"][0])
    assert table["tip_x"][0] == pytest.approx(0.05, abs=1e-5) and table["tip_z"][0] < 0.25
    assert table["error"][0] == pytest.approx(np.hypot(table["tip_x"][0] - 0.05, table["tip_y"][0]))
    text = said(capsys, 2, *command(robot, "step,x,y,z\n1,,,\n", "--largest", "2"))
    assert "line 2, x = empty: must be a finite number where y and z are open" in text


def test_mistakes_of_all_inputs_are_reported_together(tmp_path, robot, capsys):
    rows = ["1,0,0,0.2,,,,", "1,0,0,x,,,,", "2,0,0,0.2,0,0,0,", "3,0,0,0.2,1,,0,5", "4,0,0,0.2,,,,1"]
    path = "\n".join(["step,x,y,z,dx,dy,dz,time", *rows])
    text = said(capsys, 2, *command(robot, path, *ONE, "--pretension", "t9=0.1", "T2=0.1"))
    for expected in (
        "line 3, z = x: must be a finite number",
        "line 3, step = 1: the step appears more than once",
        "line 4, dx = 0: the direction is zero",
        "line 5, dy = empty: must be a finite number",
        "unknown tendon t9",
        "unknown tendon T2; did you mean t2?",
    ):
        assert expected in text
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("unit", "size"), [("mm", 1e3), ("cm", 1e2)])
def test_targets_in_another_unit_are_refused_with_it(tmp_path, robot, capsys, unit, size):
    """Centimetres were taken for millimetres, once for every number of the file."""
    rows = "".join(f"{k},{size * x},0,{size * 0.24}\n" for k, x in enumerate((0.03, 0.05), 1))
    text = said(capsys, 2, *command(robot, "step,x,y,z\n" + rows, *ONE))
    distance = size * np.hypot(0.05, 0.24)
    for words in ("1 mistake", f"targets[1].position = {distance:g} m", f"was it meant in {unit}?"):
        assert words in text
    assert not (tmp_path / "out").exists()


WRONG_PATHS = [
    ("x,y,z\n0,0,0.2\n", ONE, "step: missing column"),
    ("step,x,y,z,dx\n1,0,0,0.2,1\n", ONE, "all three or none"),
    ("step,x,y,zz\n1,0,0,0.2\n", ONE, "did you mean z?"),
    ("step,x,y,z\n", ONE, "has no rows"),
    ("step,x,y,z\n1,0,0,0.2\n", ["--largest", "much"], "'much': must be one number"),
    ("step,x,y,z\n1,0,0,0.2\n", [*ONE, "--displacements"], "needs a pretension above zero"),
]


@pytest.mark.parametrize(("text", "options", "expected"), WRONG_PATHS)
def test_columns_and_options_are_checked(tmp_path, robot, capsys, text, options, expected):
    assert expected in said(capsys, 2, *command(robot, text, *options))
    assert not (tmp_path / "out").exists()


def test_a_long_search_is_announced_and_keeps_what_it_found_at_its_time_limit(robot, capsys, monkeypatch):
    """Targets out of reach were sought for more than ten minutes, without a word and without a limit."""
    monkeypatch.setattr(common, "LOOK", 0.2)
    monkeypatch.setattr(common, "LONG_RUN", 0.1)
    path = "step,x,y,z\n" + "".join(f"{k},0.1,0.{k % 9},0.3\n" for k in range(1, 900))
    # as for a job in the background; the limit had no effect
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    err = said(capsys, 1, *command(robot, path, "--largest", "2", "--minutes", "0.02"))
    signal.signal(signal.SIGINT, before)
    found = len(pd.read_csv(robot.parent / "out" / "targets.csv"))
    assert " of 899 targets solved in 0 s: " in err and "--minutes keeps what is solved" in err and found > 0
    assert f"stopped at the time limit of 0.02 minutes; {found} of 899 targets" in err
