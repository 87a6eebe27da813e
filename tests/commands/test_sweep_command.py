"""``tdcr-fe sweep``: files, exit statuses, and what is kept where it is interrupted or killed."""

import json
import os
import signal
import time

import pandas as pd
import pytest
from interrupts import start_python
from sweep_files import HASTY, InProcess, varying, write_files

import tdcr_fe as tdcr
from tdcr_fe import cli
from tdcr_fe.sweeps import execution

#: Enough cases that a signal meets the run under way.
MANY = """
scenario = "scenario.toml"
sampling = { method = "latin-hypercube", samples = 30, seed = 2 }
vary = [
  { key = "steps[0].tensions.t1", uniform = { lower = 0.2, upper = 1.0 } },
  { key = "tendons.friction_coefficient", uniform = { lower = 0.0, upper = 0.3 } },
]
"""


@pytest.fixture
def here(monkeypatch):
    """Cases are solved in this process, one at a time."""

    def in_process(job, cases, count):
        return execution.outcomes(job, cases, InProcess(), 1)

    monkeypatch.setattr(execution, "local_outcomes", in_process)


def test_table_summary_report_and_pictures(tmp_path, capsys, here):
    path = write_files(tmp_path, MANY.replace("30", "12"))
    out = tmp_path / "out"
    assert cli.main(["sweep", str(path), "-o", str(out)]) == 0
    names = {p.name for p in out.iterdir()}
    pictures = {"distributions.png", "main_effects.png", "workspace.png"}
    assert names == {".cases.lock", "cases.csv", "cases.jsonl", "summary.json", "report.html", *pictures}
    printed = capsys.readouterr().out
    assert printed.startswith("small: bending stiffness 0.00171 N m^2")
    assert "12 converged" in printed and "bending angle [deg]: mean" in printed
    page = (out / "report.html").read_text()
    assert "All 12 cases converged." in page
    for text in ("Main effects", "Tip positions", "What was varied", "95 % of the cases"):
        assert text in page
    assert "http://www.w3.org" not in page.replace("data:image", "") and "<script src" not in page
    frame = pd.read_csv(out / "cases.csv")
    summary = json.loads((out / "summary.json").read_text())
    assert summary["sampling"] == {"method": "latin-hypercube", "samples": 12, "seed": 2}
    assert summary["statistics"]["tip_x"]["mean"] == pytest.approx(frame["tip_x"].mean(), rel=1e-12)
    assert summary["statistics"]["tip_x"]["std"] == pytest.approx(frame["tip_x"].std(), rel=1e-12)


def test_a_case_that_does_not_converge_gives_status_1_and_a_row_of_the_report(tmp_path, capsys, here):
    path = write_files(tmp_path, varying({"steps[0].tensions.t1": [1.0, 7e4]}), scenario=HASTY)
    assert cli.main(["sweep", str(path), "-o", str(tmp_path / "out"), "-q"]) == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "1 case not converged, case 2 the first: step 1 did not converge" in printed.err
    page = (tmp_path / "out" / "report.html").read_text()
    assert "1 of 2 cases converged." in page and "Cases that did not converge" in page


def test_what_the_cases_warn_of_is_printed_once(tmp_path, capsys, here):
    """A weight that varies, of a robot without mass, gave statistics and not a word."""
    path = write_files(tmp_path, varying({"effects.gravity.g_x": [5.0, 9.0]}))
    assert cli.main(["sweep", str(path), "-o", str(tmp_path / "out"), "-q", "--no-pictures"]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    words = "warning: 2 times, in case 1 first: model.gravity = 5 m/s^2: nothing has mass"
    assert line.startswith(f"tdcr-fe: {words}")


def test_check_prints_the_cases_and_solves_nothing(tmp_path, capsys):
    assert cli.main(["sweep", str(write_files(tmp_path)), "--check"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("small: bending stiffness")
    assert "\n6 cases, method" in printed and "steps[0].tensions.t1" in printed
    assert {p.name for p in tmp_path.iterdir()} == {"robot.toml", "scenario.toml", "sweep.toml"}


def wait_for_lines(process, journal, count):
    """Wait until a journal has as many outcomes."""
    end = time.monotonic() + 120.0
    while time.monotonic() < end and process.poll() is None:
        if journal.exists() and journal.read_bytes().count(b"\n") > count:
            return
        time.sleep(0.02)
    raise AssertionError("the sweep ended, or nothing was solved")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The same sweep, not stopped."""
    folder = tmp_path_factory.mktemp("whole")
    tdcr.sweep(write_files(folder, MANY), folder / "out", executor=InProcess(), report=False)
    return folder / "out"


@pytest.mark.integration
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL], ids=lambda x: x.name)
def test_a_sweep_that_was_stopped_continues(tmp_path, whole, number):
    path, out = write_files(tmp_path, MANY), tmp_path / "out"
    command = ["-m", "tdcr_fe", "sweep", str(path), "-o", str(out), "--processes", "1", "-q", "--no-pictures"]
    process = start_python(*command)
    wait_for_lines(process, out / "cases.jsonl", 3)
    process.send_signal(number)
    status = process.wait(60)
    process.stdout.close()
    assert status == {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -signal.SIGKILL}[number]
    if number != signal.SIGKILL:
        states = pd.read_csv(out / "cases.csv")["status"].value_counts()
        assert states["not run"] > 0 and states["converged"] >= 3
    kept = (out / "cases.jsonl").read_bytes().count(b"\n") - 1
    assert 3 <= kept < 30
    result = tdcr.sweep(path, out, executor=InProcess(), report=False)
    assert result.solved_now <= 30 - kept + 1 and result.converged
    assert (out / "cases.csv").read_bytes() == (whole / "cases.csv").read_bytes()
