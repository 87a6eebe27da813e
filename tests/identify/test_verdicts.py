"""Verdicts on insufficient data, interruptions of the command, and the end of its workers."""

import json
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identify_data import GRAVITY, begun, concluded, measured, searching, with_model
from interrupts import start_python

from tdcr_fe.cli import main
from tdcr_fe.effects import EFFECTS, Experiment, effect
from tdcr_fe.identify import identify
from tdcr_fe.identify.criteria import mostly_estimated_noise, unknown_noise, unusable_data
from tdcr_fe.identify.report import render
from tdcr_fe.identify.screening import screen
from tdcr_fe.identify.search import worth_fitting
from tdcr_fe.identify.sentences import headline, sentences
from tdcr_fe.identify.verdict import separating_experiments
from tdcr_fe.io.measured import write_measured
from tdcr_fe.io.processes import STATUS_SIGINT, STATUS_SIGTERM


@pytest.fixture(scope="module")
def bent():
    """Readings of a robot with gravity that is not declared."""
    return measured(GRAVITY)


def test_readings_in_millimetres_without_sigma_stop_the_run(bent, tmp_path, capsys):
    """e3bbe5d: most rows were left out, the rest taken as metres: "nothing missing", exit status 0."""
    write_measured(bent, tmp_path / "set")
    path = tmp_path / "set" / "observations.csv"
    head, *rows = path.read_text().splitlines()
    fields = [r.split(",") for r in rows]
    rows = [",".join([*f[:3], f"{1e3 * float(f[3]):.6f}", ""]) for f in fields]
    path.write_text("\n".join([head, *rows]) + "\n")
    assert main(["identify", str(tmp_path / "set"), "-o", str(tmp_path / "out"), "-q"]) == 2
    text = capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert "for a robot of 0.2 m: are they in mm?" in text and "rows would be left" in text


def some(data, chosen, **changes):
    """Some of the readings, changed."""
    return replace(data, readings=tuple(replace(r, **changes) for r in data.readings if chosen(r)))


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (lambda bent: replace(bent, readings=bent.readings[3:4]), "1 reading: at least 4 are needed"),
        (lambda bent: some(bent, lambda r: r.step <= 2, sigma=None), "no sigma is given for position"),
        (lambda bent: measured(sigma=0.09), "the noise is larger than the motion of the robot"),
    ],
    ids=["one reading", "two steps", "noise"],
)
def test_unusable_data_give_no_verdict(bent, data, reason):
    """e3bbe5d: "nothing missing", with the residual itself taken for the noise."""
    state = begun(data(bent))
    assert unusable_data(state.problem, state.declared).startswith(reason)
    result = concluded(state)
    assert result.verdict == "cannot tell" and headline(result).startswith("Inconclusive")
    assert sentences(result)[0].lower().startswith(reason.lower())


def test_without_sigma_a_model_that_leaves_noise_proves_nothing():
    """The noise is estimated from what the model leaves, so that it cannot speak for the model."""
    data = measured(given=False)
    result = concluded(begun(data), sigma_estimated=True)
    assert (result.verdict, result.remaining.where) == ("cannot tell", "the noise")
    text = render(result)
    assert (
        "the noise of the sensors is not known" in text
        and "No sigma is given for position: the noise is estimated" in text
    )
    assert unknown_noise(data) == []


def test_readings_without_sigma_beside_more_that_have_one_prove_nothing_missing():
    data = measured()
    few = tuple(replace(r, sigma=None) if r.step <= 4 else r for r in data.readings)
    assert mostly_estimated_noise(replace(data, readings=few)) == ""
    assert mostly_estimated_noise(measured(given=False)).startswith("no sigma is given for position")


def test_without_sigma_an_effect_is_named_all_the_same():
    truth = {"gravity": {"g_x": 3.0, "g_y": 0.0, "g_z": 0.0}}
    assert concluded(with_model(begun(measured(truth, given=False)), truth)).verdict == "explained"


@pytest.fixture
def few(bent):
    """Nine readings of three steps: none can be held out."""
    return some(bent, lambda r: r.step in (2, 7, 10) and r.location == 0.2)


def test_few_readings_that_an_effect_follows_prove_nothing(few):
    result = concluded(with_model(begun(few), GRAVITY))
    assert len(few.readings) == 9 and result.held_out_steps == ()
    assert result.verdict == "cannot tell" and "too few" in result.remaining.description


@pytest.mark.integration
def test_few_readings_get_one_effect_with_fewer_parameters_than_readings_at_most(few):
    result = identify(few)
    assert result.verdict in ("cannot tell", "partly explained", "unexplained") and len(result.effects) <= 1
    # Steps after the last reading, several effects and local causes are not simulated.
    assert len(result.data.steps) == 10 and result.log.runs < 150
    declared = Experiment(few.robot, few.model, few.steps)
    sizes = {form.name: len(form.parameters) for e in EFFECTS for form in (e, *e.forms(declared))}
    assert any(c.fitted for c in result.log.candidates)
    named = [n for c in result.log.candidates if c.fitted for n in c.name.split(" + ") if n in sizes]
    assert named and all(sizes[n] < len(few.readings) for n in named)


def test_candidates_with_more_parameters_than_readings_are_not_fitted(bent):
    state = begun(replace(bent, readings=bent.readings[:4]))
    problem = replace(state.problem, held_out=np.array([False, False, True, True]))
    scores, _ = screen(problem, state.declared, [effect("gravity"), effect("actuator_gain")])
    strong = [replace(s, drop=1e9) for s in scores]
    fitted = worth_fitting(searching(), problem, state.declared, strong)
    assert [x.names for x in fitted] == [("actuator_gain",)]


def test_several_causes_that_leave_noise_together_are_stated_but_not_named():
    truth = {
        "gravity": {"g_x": 9.81, "g_y": 0.0, "g_z": 0.0},
        "precurvature": {"kappa_x": 1.0, "kappa_y": 0.0},
        "actuator_gain": {"gain": 1.1},
    }
    result = concluded(with_model(begun(measured(truth)), truth))
    assert result.verdict == "explained" and not any(e.found for e in result.effects)
    assert headline(result) == (
        "Explained, but none of it is certain: gravity, precurvature and actuator gain together leave only noise. One "
        "cause that is not in the dictionary would look the same."
    )
    document = result.to_json()
    assert document["effects"] == [] and list(document["stand_ins"]) == list(truth)
    assert all(cause["probability"] < 0.6 for cause in document["causes"])
    assert "none of it is certain" in render(result)


# ------------------------------------------------------------------------------------------- interruptions

#: The command, with a search that does not end by itself. Workers import nothing of it, as those of the real command.
SCRIPT = """
import sys, time

if __name__ == "__main__":
    from tdcr_fe.cli import main
    from tdcr_fe.identify import identification

    real = identification.search_causes

    def endless(search, state):
        state.problem.forward.map(abs, [1, 2])  # starts the workers
        print("searching", flush=True)
        state = yield from real(search, state)
        time.sleep(120.0)
        return state

    identification.search_causes = endless
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


@pytest.mark.integration
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
