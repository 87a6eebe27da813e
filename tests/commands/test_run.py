"""The command run as users call it: complete tables, warnings, and the results of the Python API for random robots."""

import json
import re
import time
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from arcs import arc_result, paper_robot
from inputs import REMOVED, ROBOT, SCENARIO, changed, said, write

import tdcr_fe as tdcr
from tdcr_fe import cli, read_scenario, robot_to_toml, scenario_to_toml, simulate
from tdcr_fe.commands import common
from tdcr_fe.commands import run as command
from tdcr_fe.commands.run import step_table
from tdcr_fe.validation.fuzz.drawing import draw

NO_MASS = "model.gravity = 9.81 m/s^2: nothing has mass, so it does nothing; give backbone.density, "
NO_MASS += "disks.mass or tip_mass"


def test_odd_values_are_warned_of_once_and_in_the_summary(tmp_path, capsys):
    """In 0.1 gravity without mass ended with exit status 0 and no warning."""
    massless = changed(ROBOT, {"backbone.density": REMOVED, "disks.mass": REMOVED})
    path = write(tmp_path, massless, SCENARIO + "[solver]\ntolerance = 1e-10\nmax_iterations = 33\n")
    err = said(capsys, 0, "run", path, "-o", tmp_path / "out", "--no-pictures")
    assert err.startswith(f"tdcr-fe: warning: {NO_MASS}\n") and err.count("nothing has mass") == 1
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    settings = [summary["settings"][n] for n in ("tolerance", "max_iterations")]
    assert summary["warnings"][0] == NO_MASS and settings == [1e-10, 33]


def test_long_run_is_announced_by_what_it_has_solved(tmp_path, capsys, monkeypatch):
    """310 s of processor time passed without a word, where the estimate was made from the number of elements."""
    path = write(tmp_path, scenario=SCENARIO + "[[steps]]\ntensions = { t1 = 1.0 }\n" * 4000)
    # The look after the announcement finds the limit passed once a step is solved.
    solved, times = [], iter([0.0, 0.05])

    def counted(robot, model, steps, settings, progress, **beside):
        return simulate(robot, model, steps, settings, lambda s: (solved.append(s), progress(s)), **beside)

    clock = SimpleNamespace(perf_counter=lambda: next(times, 2.0 if solved else 0.05))
    monkeypatch.setattr(common, "time", clock)
    monkeypatch.setattr(command, "simulate", counted)
    monkeypatch.setattr(common, "LOOK", 60.0)  # so long may the results of what was solved take
    monkeypatch.setattr(common, "LONG_RUN", 0.3)
    err = said(capsys, 1, "run", path, "-o", tmp_path / "out", "--no-pictures", "--minutes", "0.001")
    assert re.search(r"of 4002 load steps solved in \d s: .*--minutes keeps what is solved", err)
    assert "stopped at the time limit of 0.001 minutes in step" in err
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert not summary["converged"] and len(summary["steps"]) >= 1
    assert len(pd.read_csv(tmp_path / "out" / "steps.csv")) == len(summary["steps"])


@pytest.mark.parametrize("count", [1, 4, 9])
def test_tables_of_many_tendons_fit_a_terminal(count):
    """Nine tendons took 240 columns in one table."""
    robot = paper_robot(count)
    step = tdcr.LoadStep("a label of about twenty", dict.fromkeys(robot.tendon_names, 1.0))
    text = step_table(arc_result(robot, [step]))
    assert max(map(len, text.splitlines())) <= 130
    assert all(text.split().count(t) == 2 for t in robot.tendon_names)


def test_a_file_of_another_kind_is_named(tmp_path, capsys):
    """It gave six mistakes: robot and steps missing, and every table of the robot unknown."""
    write(tmp_path)
    robot = tmp_path / "robot.toml"
    out = "-o", tmp_path / "out"
    lines = said(capsys, 2, "run", robot, *out).splitlines()
    assert lines[1:] == [f"  {robot}: is the file of a robot; give the scenario.toml that names it"]
    err = said(capsys, 2, "follow", tmp_path / "scenario.toml", "path.csv", "--largest", "1", *out)
    assert "scenario.toml: is the file of a scenario; give its robot, robot.toml" in err
    err = said(capsys, 2, "run", tmp_path / "nothere.toml", *out)
    assert err.endswith("nothere.toml: no such file\n")  # robot.toml was proposed


@pytest.mark.parametrize(("tendon_path", "friction"), [("straight", "per-hole"), ("continuous", "none")])
def test_derivatives_and_responses_are_written(tmp_path, capsys, tendon_path, friction):
    """One row a step and parameter; the response of the tip in every step of the summary."""
    changes = {"model.tendon_path": tendon_path, "model.friction": friction}
    changes["steps"] = [{"tensions": {"t1": 1.0, "t4": 0.5}}, {"tensions": {"t2": 0.6, "t3": 0.4}}]
    scenario, out = write(tmp_path, scenario=changed(SCENARIO, changes)), tmp_path / "out"
    names = ["backbone.youngs_modulus", "tendons.t4.turns", "inputs.t3"]
    options = ["--no-pictures", "--sensitivities", *names, "--compliance"]
    assert cli.main(["run", str(scenario), "-o", str(out), *options]) == 0
    assert "last step, derivative by" in capsys.readouterr().out
    table = pd.read_csv(out / "sensitivities.csv")
    assert list(table["parameter"]) == names * 2 and list(table["step"]) == [1, 1, 1, 2, 2, 2]
    assert table["value"][0] == 85e9 and np.isnan(table["value"][2])
    derivatives = table.drop(columns=["step", "label", "parameter", "value"])
    assert np.isfinite(derivatives.to_numpy()).all() and (derivatives["tip_x"] != 0.0).all()
    # A stiffer backbone bends less: the tip comes closer to the straight robot.
    tip = pd.read_csv(out / "steps.csv")["tip_x"]
    assert (np.sign(table["tip_x"][::3].to_numpy()) == -np.sign(tip.to_numpy())).all()
    for step in json.loads((out / "summary.json").read_text())["steps"]:
        first, second = step["tip_response"]
        assert (first["holes"], second["holes"]) == ("as they are", "reversal")
        assert np.shape(first["compliance"]) == (6, 6) and np.shape(first["motor_stiffness"]) == (4, 4)
    # Without the options, neither is written.
    assert cli.main(["run", str(scenario), "-o", str(out), "--no-pictures", "-q"]) == 0
    assert not (out / "sensitivities.csv").exists()
    assert "tip_response" not in json.loads((out / "summary.json").read_text())["steps"][0]


def test_an_interruption_that_is_lost_is_sent_again(monkeypatch):
    """As where a callback of Exudyn swallows it, in a load step that would take for ever."""
    sent = []
    monkeypatch.setattr(common, "LOOK", 0.02)
    monkeypatch.setattr("tdcr_fe.commands.common._thread.interrupt_main", sent.append)
    with common.Clock(1, "load step", minutes=1e-4).running():
        time.sleep(0.5)
    assert len(sent) > 2 and common.count(1.0, "minute") == "1 minute"  # it was "1 minutes"


# ------------------------------------------------------------ properties


def check_tables(scenario, result, out):
    """Every table has every step, tendon and segment, and the numbers of the Python API bit for bit."""
    names = ("steps", "tensions", "shape")
    steps, tensions, shape = (pd.read_csv(out / f"{name}.csv", dtype=str) for name in names)
    robot, count = scenario.robot, len(result.steps)
    assert list(steps["step"].astype(int)) == list(range(1, count + 1))
    segments = {t.name: len(robot.hole_arc_lengths(t)) - 1 for t in robot.tendons}
    rows = [(str(k + 1), n, str(i + 1)) for k in range(count) for n, m in segments.items() for i in range(m)]
    assert list(tensions[["step", "tendon", "segment"]].itertuples(index=False, name=None)) == rows
    if count:
        np.testing.assert_array_equal(steps[["tip_x", "tip_y", "tip_z"]].astype(float), result.tips)
        positions = np.concatenate([s.positions for s in result.steps])
        np.testing.assert_array_equal(shape[["x", "y", "z"]].astype(float), positions)
    if rows:
        found = np.concatenate([t for s in result.steps for t in s.tensions])
        np.testing.assert_array_equal(tensions["tension"].astype(float), found)


#: More of them before a release.
TIERS = [
    *range(8),
    *(pytest.param(k, marks=pytest.mark.integration) for k in range(8, 20)),
    *(pytest.param(k, marks=pytest.mark.campaign) for k in range(20, 500)),
]


@pytest.mark.parametrize("seed", TIERS)
def test_random_scenarios_through_the_command(seed, tmp_path):
    case = draw(seed)
    if any(t.routing.kind == "twisted" for t in case.robot.tendons):
        pytest.skip("robot.toml has no such routing")
    path = write(tmp_path, robot_to_toml(case.robot), scenario_to_toml(case.model, case.steps))
    out = tmp_path / "out"
    status = cli.main(["run", str(path), "-o", str(out), "--no-pictures", "-q"])
    scenario = read_scenario(path)
    result = simulate(scenario.robot, scenario.model, scenario.steps, scenario.settings)
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert status == (0 if result.converged else 1)
    assert (summary["converged"], summary["steps_asked"]) == (result.converged, len(scenario.steps))
    assert summary["warnings"][-len(result.warnings) :] == list(result.warnings) or not result.warnings
    errors = [s["discretisation_error"] for s in summary["steps"]]
    assert errors == [s.discretisation_error for s in result.steps]
    check_tables(scenario, result, out)
    if not result.converged:
        assert result.failed_step == len(result.steps) + 1
        assert f"step {result.failed_step}" in summary["message"]
