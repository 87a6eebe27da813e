"""``--json`` of ``run`` and ``identify`` prints one object on stdout, whatever happens, and nothing else there."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from identify_data import measured
from inputs import ROBOT, SCENARIO, changed, write

from tdcr_fe import cli
from tdcr_fe.validation.measured_folder import write_measured

KEYS = ["command", "status", "exit_status", "files", "figures", "warnings", "remarks", "errors", "message"]
STEPS = [{"tensions": {"t1": 0.5}}, {"label": "more", "tensions": {"t1": 1.0}}]
SMALL = {"model.elements_per_bay": 1, "steps": STEPS}


def call(capsys, *arguments) -> dict:
    """The object that a command prints; its exit status is in it."""
    try:
        status = cli.main([*map(str, arguments), "--json"])
    except SystemExit as stop:
        status = stop.code
    found = json.loads(capsys.readouterr().out)
    assert list(found) == KEYS
    assert found["exit_status"] == status
    assert all(Path(f).exists() for f in found["files"])
    return found


def test_run_gives_its_main_figures(tmp_path, capsys):
    path = write(tmp_path, scenario=changed(SCENARIO, SMALL))
    found = call(capsys, "run", path, "-o", tmp_path / "out", "--no-pictures")
    assert (found["command"], found["status"], found["errors"]) == ("run", "done", [])
    written = {"steps.csv", "shape.csv", "tensions.csv", "summary.json"}
    assert {Path(f).name for f in found["files"]} == written
    figures = found["figures"]
    assert (figures["steps_asked"], figures["steps_solved"], figures["failed_step"]) == (2, 2, None)
    assert figures["tensions"] == {"t1": 1.0, "t2": 0.0, "t3": 0.0, "t4": 0.0}
    header, *_, last = (line.split(",") for line in (tmp_path / "out" / "steps.csv").read_text().splitlines())
    row = dict(zip(header, last, strict=True))
    assert figures["tip"] == [float(row[f"tip_{x}"]) for x in "xyz"]
    assert figures["bending_angle_deg"] == pytest.approx(float(row["bending_angle_deg"]), abs=1e-12)


def test_wrong_input_gives_all_mistakes_as_objects(tmp_path, capsys):
    steps = [{"tensions": {"nobody": 1.0}}] * 60
    path = write(tmp_path, changed(ROBOT, {"backbone.length": -1}), changed(SCENARIO, {"steps": steps}))
    found = call(capsys, "run", path, "-o", tmp_path / "out")
    assert (found["status"], found["files"], found["figures"]) == ("wrong input", [], {})
    first = found["errors"][0]
    assert first["file"] == str(tmp_path / "robot.toml") and first["key"] == "backbone.length"
    assert first["value"] == "-1" and "positive" in first["allowed"]
    assert len(found["errors"]) == 61 > cli.MOST_PROBLEMS


@pytest.mark.parametrize("arguments", ["run", "rum", "", "identify x -o y --processes 0"])
def test_wrong_arguments_are_an_error_too(capsys, arguments):
    found = call(capsys, *arguments.split())
    assert found["status"] == "wrong input"
    assert [e["file"] for e in found["errors"]] == ["arguments"]
    assert found["errors"][0]["allowed"] == found["message"] != ""


def test_a_step_that_does_not_converge_is_a_failure_with_its_reason(tmp_path, capsys):
    solver = {"max_iterations": 1, "min_substep": 1.0, "max_substeps": 1}
    steps = {**SMALL, "solver": solver, "steps": [{"tensions": {"t1": 300.0}}]}
    path = write(tmp_path, scenario=changed(SCENARIO, steps))
    found = call(capsys, "run", path, "-o", tmp_path / "out", "--no-pictures")
    assert (found["status"], found["exit_status"]) == ("failed", 1)
    assert found["figures"]["failed_step"] == 1 and "step 1" in found["message"]


@pytest.mark.integration
def test_identify_gives_verdict_and_effects(tmp_path, capsys):
    write_measured(measured(), tmp_path / "set")
    found = call(capsys, "identify", tmp_path / "set", "-o", tmp_path / "out", "--processes", "1")
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert found["exit_status"] == 0
    assert found["figures"]["verdict"] == result["verdict"]
    assert {"verdict", "before", "effects", "after"} <= set(found["figures"])
    assert {"result.json", "report.html"} <= {Path(f).name for f in found["files"]}


@pytest.mark.integration
def test_nothing_else_is_on_stdout_of_the_process(tmp_path):
    """Neither what solvers print nor a progress bar."""
    path = write(tmp_path, scenario=changed(SCENARIO, SMALL))
    command = [sys.executable, "-m", "tdcr_fe", "run", str(path), "-o", str(tmp_path / "out"), "--json"]
    done = subprocess.run([*command, "--no-pictures"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("{") and json.loads(done.stdout)["status"] == "done"


@pytest.mark.skipif(os.name == "nt", reason="needs signals of POSIX")
@pytest.mark.parametrize(("name", "status"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_a_command_that_is_interrupted_says_so(tmp_path, monkeypatch, capsys, name, status):
    def interrupted(*args, **beside):
        os.kill(os.getpid(), getattr(signal, name))
        raise AssertionError("the signal raises before")

    monkeypatch.setattr("tdcr_fe.commands.run.simulate", interrupted)
    path = write(tmp_path, scenario=changed(SCENARIO, SMALL))
    # A shell that runs the tests in the background has SIGINT ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    of_termination = signal.getsignal(signal.SIGTERM)
    try:
        found = call(capsys, "run", path, "-o", tmp_path / "out", "--no-pictures")
    finally:
        signal.signal(signal.SIGINT, before)
    assert found["exit_status"] == status and signal.getsignal(signal.SIGTERM) is of_termination
    assert found["status"] == ("interrupted" if name == "SIGINT" else "terminated")
    assert found["message"] == "interrupted; no results were written" and found["files"] == []
