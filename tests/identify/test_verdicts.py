"""Verdicts of the command on insufficient or faulty data, interruptions, and the end of its workers."""

import json
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identify_data import measured
from interrupts import start_python

from tdcr_fe.cli import main
from tdcr_fe.effects import EFFECTS, Experiment, effect
from tdcr_fe.identify import identify
from tdcr_fe.identify.added_effects import separating_experiments
from tdcr_fe.identify.candidates import identifiable
from tdcr_fe.identify.forward import ForwardModel
from tdcr_fe.identify.information import mostly_estimated_noise, unknown_noise
from tdcr_fe.identify.problem import FitProblem, evaluate
from tdcr_fe.identify.screening import screen
from tdcr_fe.identify.sentences import headline, sentences
from tdcr_fe.io.measured import write_measured
from tdcr_fe.io.processes import STATUS_SIGINT, STATUS_SIGTERM


@pytest.fixture(scope="module")
def bent():
    """Readings of a robot with gravity that is not declared."""
    return measured({"gravity": {"g_x": 3.0, "g_y": -6.0, "g_z": -7.0}})


def run(data, tmp_path, change=None):
    """Exit status and ``result.json`` (None where there is none) of the command on a folder."""
    write_measured(data, tmp_path / "set")
    path = tmp_path / "set" / "observations.csv"
    if change is not None:
        head, *rows = path.read_text().splitlines()
        path.write_text("\n".join([head, *change(rows)]) + "\n")
    status = main(["identify", str(tmp_path / "set"), "-o", str(tmp_path / "out"), "--processes", "1", "-q"])
    result = tmp_path / "out" / "result.json"
    return status, json.loads(result.read_text()) if result.exists() else None


def test_readings_in_millimetres_without_sigma_stop_the_run(bent, tmp_path, capsys):
    """e3bbe5d: most rows were left out, the rest taken as metres: "nothing missing", exit status 0."""

    def in_millimetres(rows):
        fields = [r.split(",") for r in rows]
        return [",".join([*f[:3], f"{1e3 * float(f[3]):.6f}", ""]) for f in fields]

    status, result = run(bent, tmp_path, in_millimetres)
    text = capsys.readouterr().err
    assert (status, result) == (2, None) and not (tmp_path / "out").exists()
    assert "for a robot of 0.2 m: are they in mm?" in text and "rows would be left" in text


@pytest.mark.parametrize("sigma", ["", "0.0001"])
def test_a_single_reading_gives_no_verdict(bent, tmp_path, sigma):
    """e3bbe5d: "nothing missing"."""
    status, result = run(bent, tmp_path, lambda rows: [rows[3].rsplit(",", 1)[0] + "," + sigma])
    assert (status, result["verdict"], result["observations"]) == (0, "cannot tell", 1)
    assert result["remaining"]["description"].startswith("1 reading")
    assert result["effects"] == [] and result["simulations"] < 10


def test_without_sigma_a_model_that_leaves_noise_proves_nothing(tmp_path):
    """The noise is estimated from what the model leaves, so that it cannot speak for the model."""
    data = measured(given=False)
    status, result = run(data, tmp_path)
    assert (status, result["verdict"], result["sigma_estimated"]) == (0, "cannot tell", True)
    assert result["effects"] == [] and result["remaining"]["where"] == "the noise"
    text = (tmp_path / "out/report.html").read_text()
    assert "the noise of the sensors is not known" in text and "No sigma is given for position" in text
    assert "The noise is estimated from the scatter of the readings" in text
    assert unknown_noise(data) == []


def test_readings_without_sigma_beside_more_that_have_one_prove_nothing_missing():
    data = measured()
    few = tuple(replace(r, sigma=None) if r.step <= 4 else r for r in data.readings)
    assert mostly_estimated_noise(replace(data, readings=few)) == ""
    assert mostly_estimated_noise(measured(given=False)).startswith("no sigma is given for position")


def test_without_sigma_an_effect_is_named_all_the_same():
    result = identify(measured({"gravity": {"g_x": 3.0}}, given=False))
    assert (result.verdict, [e.name for e in result.effects]) == ("explained", ["gravity"])


def test_without_sigma_two_steps_give_no_verdict(bent, tmp_path):
    """e3bbe5d: the residual itself was taken for the noise, and the verdict was "nothing missing"."""
    status, result = run(
        bent,
        tmp_path,
        lambda rows: [r.rsplit(",", 1)[0] + "," for r in rows if r.startswith(("1,", "2,"))],
    )
    assert (status, result["verdict"]) == (0, "cannot tell")
    assert "no sigma is given for position" in result["remaining"]["description"]


def test_noise_larger_than_the_motion_gives_no_verdict(tmp_path):
    status, result = run(measured(sigma=0.09), tmp_path)
    assert (status, result["verdict"]) == (0, "cannot tell")
    assert "the noise is larger than the motion of the robot" in result["remaining"]["description"]


def test_few_readings_that_an_effect_follows_prove_nothing(bent):
    """Nine readings of three steps: effects may be named, but no steps are left to test them."""
    steps = {2, 7, 10}
    few = tuple(r for r in bent.readings if r.step in steps and r.location == 0.2)
    result = identify(replace(bent, readings=few))
    assert len(few) == 9 and result.verdict in ("cannot tell", "partly explained", "unexplained")
    assert len(result.effects) <= 1 and result.held_out_steps == ()
    # Steps after the last reading, several effects and local causes are not simulated.
    assert len(result.data.steps) == 10 and result.runs < 150


def test_candidates_with_more_parameters_than_readings_are_not_fitted(bent):
    few = tuple(r for r in bent.readings if r.step in (2, 7) and r.location == 0.2)[:4]
    result = identify(replace(bent, readings=few))
    declared = Experiment(bent.robot, bent.model, bent.steps)
    sizes = {form.name: len(form.parameters) for e in EFFECTS for form in (e, *e.forms(declared))}
    assert any(c.fitted for c in result.candidates)
    assert all(sizes[c.name] < len(few) for c in result.candidates if c.fitted)
    two = replace(bent, readings=few)
    problem = FitProblem.of(two, np.full(4, 1e-4), np.array([False, False, True, True]), ForwardModel())
    fit = evaluate(problem, (), {})
    scores = screen(problem, fit, [effect("gravity"), effect("actuator_gain")])
    assert {s.effect.name: identifiable(problem, fit, s) for s in scores} == {
        "gravity": False,
        "actuator_gain": True,
    }


def test_the_report_gives_the_reason_for_no_verdict(bent):
    result = identify(replace(bent, readings=bent.readings[:1]))
    assert headline(result).startswith("Cannot tell")
    assert any("at least 4 are needed" in s for s in sentences(result))


# ------------------------------------------------------------------------------------------- interruptions

#: The command, with a search that does not end by itself. Workers import nothing of it, as those of the real command.
SCRIPT = """
import sys, time

if __name__ == "__main__":
    from tdcr_fe.cli import main
    from tdcr_fe.identify import identification

    real = identification.search_effects

    def endless(search, state):
        print("searching", flush=True)
        state = yield from real(search, state)
        time.sleep(120.0)
        return state

    identification.search_effects = endless
    sys.exit(main(["identify", sys.argv[1], "-o", sys.argv[2], "-q", "--processes", "2"]))
"""


def children(pid):
    """Worker processes of a process, by Linux's table of processes; not Python's tracker of resources."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if "spawn_main" not in (entry / "cmdline").read_text():
                    continue
                fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            except OSError:
                continue
            if int(fields[1]) == pid and fields[0] != "Z":
                found.append(int(entry.name))
    return found


def running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux's table of processes")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGKILL"])
def test_an_interruption_ends_all_processes_and_keeps_what_was_found(bent, tmp_path, name):
    """e3bbe5d: after SIGTERM nothing was written and a worker kept running; after SIGKILL all workers did."""
    write_measured(bent, tmp_path / "set")
    script = tmp_path / "command.py"
    script.write_text(SCRIPT)
    process = start_python(str(script), str(tmp_path / "set"), str(tmp_path / "out"), stderr=subprocess.PIPE)
    try:
        assert process.stdout.readline() == "searching\n"
        begun = time.perf_counter()
        while len(workers := children(process.pid)) < 2:
            assert time.perf_counter() - begun < 60.0
            time.sleep(0.1)
        time.sleep(1.0)
        process.send_signal(getattr(signal, name))
        begun = time.perf_counter()
        while any(running(p) for p in workers):
            assert time.perf_counter() - begun < 20.0
            time.sleep(0.05)
        errors = process.communicate(timeout=60)[1]
    finally:
        process.kill()
    if name == "SIGKILL":
        assert process.returncode == -signal.SIGKILL
        return
    assert process.returncode == {"SIGINT": STATUS_SIGINT, "SIGTERM": STATUS_SIGTERM}[name], errors
    document = json.loads((tmp_path / "out" / "result.json").read_text())
    assert document["verdict"] == "unfinished" and document["interrupted"]
    assert "interrupted" in errors
    assert "nfinished" in (tmp_path / "out" / "report.html").read_text()


def test_forms_of_one_effect_are_separated_by_one_experiment():
    """``pretension`` for all tendons beside the same for each: the sentence on it stood there twice."""
    own, other = effect("pretension"), effect("gravity")
    text = separating_experiments(own, ("pretension (each)", "gravity"), EFFECTS)
    assert text == f"for pretension: {own.separating_experiment}; for gravity: {other.separating_experiment}"
    assert separating_experiments(own, ("pretension (each)",), EFFECTS).count(own.separating_experiment) == 1
    assert separating_experiments(own, (), EFFECTS) == ""
