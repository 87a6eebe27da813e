"""The command: exit statuses, output and files. The solver is replaced by a mock."""

import argparse
import dataclasses
import json
import os
import shlex
import subprocess
import sys

import pytest
from arcs import arc_result
from inputs import ROBOT, SCENARIO, changed, said, write

from tdcr_fe import Interrupted, TDCRWarning, cli
from tdcr_fe.commands.common import Noted, complain_of_left_out
from tdcr_fe.io.result_files import RESULT_FILES


@pytest.fixture
def calls(monkeypatch):
    """Mock of the solver that records every call."""
    noted = []

    def simulate(robot, model, steps, settings=None, progress=None, **beside):
        noted.append(steps)
        result = arc_result(robot, list(steps))
        for step in result.steps:
            progress(step)
        return result

    monkeypatch.setattr("tdcr_fe.commands.run.simulate", simulate)
    return noted


FAILURES = [
    ("residual 3.2 after 50 iterations", 2, 1,
        'step 2 of 2 ("far") did not converge; 1 step solved before it is in'),
    ("no", 1, 1, "step 1 of 2"),
    ("interrupted", 2, 130, 'interrupted in step 2 of 2 ("far"); 1 step solved before it is in'),
]  # fmt: skip


@pytest.mark.parametrize(("message", "failed", "status", "words"), FAILURES)
def test_what_is_solved_before_a_failure_stays(tmp_path, monkeypatch, capsys, message, failed, status, words):
    def simulate(robot, model, steps, settings=None, progress=None, **beside):
        full = arc_result(robot, list(steps))
        ended = {"converged": False, "message": message, "failed_step": failed}
        result = dataclasses.replace(full, steps=full.steps[: failed - 1], **ended)
        if message == "interrupted":
            raise Interrupted(result)
        return result

    monkeypatch.setattr("tdcr_fe.commands.run.simulate", simulate)
    out, scenario = tmp_path / "out", changed(SCENARIO, {"steps.1.label": "far"})
    err = said(capsys, status, "run", write(tmp_path, scenario=scenario), "-o", out, "--no-pictures")
    assert words in err and (message in err or status == 130)
    assert {p.name for p in out.iterdir()} == set(RESULT_FILES)
    assert len((out / "steps.csv").read_text().splitlines()) == failed
    summary = json.loads((out / "summary.json").read_text())
    assert summary["failed_step"] == failed
    assert set(summary["input"]) == {str(tmp_path / name) for name in ("scenario.toml", "robot.toml")}


def test_interruption_while_drawing_leaves_the_tables(tmp_path, calls, monkeypatch, capsys):
    def save_pictures(result, folder):
        raise KeyboardInterrupt

    monkeypatch.setattr("tdcr_fe.report.plots.save_pictures", save_pictures)
    assert "interrupted while writing" in said(capsys, 130, "run", write(tmp_path), "-o", tmp_path / "out")
    assert {p.name for p in (tmp_path / "out").iterdir()} == set(RESULT_FILES)


def test_wrong_input_returns_2_names_every_mistake_and_writes_nothing(tmp_path, calls, capsys):
    path = write(tmp_path, changed(ROBOT, {"backbone.length": -1}), changed(SCENARIO, {"model.fricton": 1}))
    (tmp_path / "file").write_text("")
    assert cli.main(["run", str(path), "-o", str(tmp_path / "file")]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.splitlines()[0] == "tdcr-fe: 3 mistakes in the input; nothing was written"
    mistakes = ("robot.toml: backbone.length = -1: must be a positive", "model.fricton = 1: unknown", "-o = ")
    assert all(words in printed.err for words in mistakes)
    assert calls == []
    assert not (tmp_path / "out").exists()


def test_contradiction_that_only_the_solver_knows_returns_2(tmp_path, monkeypatch, capsys):
    def simulate(*args, **kwargs):
        raise ValueError("tendon t2: a displacement needs axial_stiffness")

    monkeypatch.setattr("tdcr_fe.commands.run.simulate", simulate)
    err = said(capsys, 2, "run", write(tmp_path), "-o", tmp_path / "out")
    assert "scenario.toml: tendon t2: a displacement needs axial_stiffness" in err
    assert not (tmp_path / "out").exists()


def test_file_that_cannot_be_written_is_no_traceback(tmp_path, calls, capsys):
    (tmp_path / "out" / "steps.csv").mkdir(parents=True)
    assert "steps.csv" in said(capsys, 1, "run", write(tmp_path), "-o", tmp_path / "out", "--no-pictures")


def test_demo_is_the_papers_robot_pulled_loaded_and_released(tmp_path, calls, capsys):
    out = tmp_path / "my out"
    assert cli.main(["demo", "-o", str(out)]) == 0
    (steps,) = calls
    tensions = [s.tensions["t1"] for s in steps if s.tensions]
    assert tensions == [0.5, 1.0, 1.5, 2.0, 2.5, 2.0, 1.5, 1.0, 0.5, 0.0]
    assert [s.loads["tip"].force for s in steps if s.loads] == [(0.0, 0.05, 0.0), (0.0, 0.0, 0.0)]
    written = {"robot.toml", "scenario.toml", "shapes.png", "tensions.png", "hysteresis.png"}
    assert written <= {p.name for p in out.iterdir()}
    printed = capsys.readouterr()
    assert printed.err == ""
    assert all(text in printed.out for text in ("release to 0.0 N", "bending [deg]", f"-o '{out}'\n"))
    # As the demo advises.
    assert cli.main(["run", str(out / "scenario.toml"), "-o", str(out), "--no-pictures"]) == 0


NO_OPTION = "; there is no option --precesses; did you mean --processes?\n"
WRONG = {"": "COMMAND", "rum": "mean run?\n", "follow x y --tolerance 1mm": "'1mm'; must be a number"}
WRONG |= {"sweep x.toml --precesses 2": NO_OPTION, "sweep --precesses=2 -o out": NO_OPTION}


@pytest.mark.parametrize("arguments", WRONG)
def test_command_or_option_that_is_none_returns_2_and_the_nearest_is_named(capsys, arguments):
    with pytest.raises(SystemExit, match="2"):
        cli.main(arguments.split())
    assert WRONG[arguments] in capsys.readouterr().err


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_the_examples_of_a_command_are_taken_by_its_parser(name, monkeypatch):
    monkeypatch.setattr(cli, "_run", lambda args: 0)
    first, second = cli.COMMANDS[name].examples
    for example in (first, second):
        words = shlex.split(example.partition(" > ")[0])
        assert words[0] == name and cli.main(words) == 0


def test_python_m_is_the_same_command(tmp_path):
    environment = {**os.environ, "PYTHONWARNINGS": "error"}
    missing = tmp_path / "no.toml"
    command = [sys.executable, "-m", "tdcr_fe", "run", str(missing), "-o", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"tdcr-fe: 1 mistake in the input; nothing was written\n  {missing}: no such file\n"


def test_of_many_rows_that_were_left_out_the_first_are_printed(capsys):
    """All 225 rows of a table that holds everything twice were."""
    args = argparse.Namespace(noted=Noted())
    complain_of_left_out(args, list(range(225)))
    printed = capsys.readouterr().err.splitlines()
    assert len(printed) == 11 and printed[-1] == "tdcr-fe: left out: 215 more rows"
    assert len(args.noted.warnings) == 225


def test_a_warning_that_is_issued_again_is_printed_once(capsys):
    """Reading a folder and the estimation of its frames both warned of its robot."""
    noted = Noted()
    for text in ("wide", "wide", "thin"):
        noted.warn(text, TDCRWarning)
    assert noted.warnings == ["wide", "thin"]
    assert capsys.readouterr().err.count("warning: wide") == 1
