"""Several robots of one design: common values and scatter, in closed form and from readings."""

import json
from dataclasses import replace

import numpy as np
import pytest
from identify_data import measured
from searches import concluded, problem_of, state_of

from tdcr_fe.cli import main
from tdcr_fe.commands import identify as command
from tdcr_fe.identify import robots
from tdcr_fe.identify.robots import Common
from tdcr_fe.validation.measured_folder import write_measured


def test_with_equal_errors_the_scatter_is_what_the_errors_leave_of_the_variance():
    """Then the restricted likelihood has the closed form scatter^2 = S^2 - s^2, and the common value is the mean."""
    values = np.array([1.0, 1.3, 0.9, 1.6, 1.2])
    found = Common.of(values, np.full(5, 0.1))
    scatter = np.sqrt(np.var(values, ddof=1) - 0.01)
    assert found.scatter == pytest.approx(scatter, rel=1e-2) and found.value == pytest.approx(np.mean(values))
    assert found.std_error == pytest.approx(np.std(values, ddof=1) / np.sqrt(5.0), rel=1e-2)
    assert found.interval[0] < scatter < found.interval[1]


def test_values_that_differ_by_their_errors_have_no_scatter_and_the_weighted_mean():
    values, errors = np.array([1.0, 1.02, 0.9]), np.array([0.1, 0.1, 0.2])
    found, weight = Common.of(values, errors), errors**-2.0
    assert found.scatter == 0.0 and found.interval[0] == 0.0
    assert found.value == pytest.approx(weight @ values / weight.sum())
    assert found.std_error == pytest.approx(weight.sum() ** -0.5)


def test_intervals_of_the_scatter_contain_it_as_often_as_they_claim():
    """400 samples of eight robots, errors of different sizes."""
    rng, inside = np.random.default_rng(0), 0
    for _ in range(400):
        errors = rng.uniform(0.05, 0.3, 8)
        low, high = Common.of(1.0 + 0.2 * rng.normal(size=8) + errors * rng.normal(size=8), errors).interval
        inside += low <= 0.2 <= high
    assert 0.92 <= inside / 400 <= 0.99


def test_an_interruption_keeps_the_robots_that_are_finished(tmp_path, monkeypatch):
    data = measured()
    for name in ("r1", "r2"):
        write_measured(replace(data, name=name), tmp_path / name)
    finished = [concluded(state_of(problem_of(data)))]

    def until_interrupted(*_):
        if not finished:
            raise KeyboardInterrupt
        return finished.pop()

    monkeypatch.setattr(robots, "identify", until_interrupted)
    folders, out = [str(tmp_path / name) for name in ("r1", "r2")], tmp_path / "out"
    assert main(["identify", *folders, "--robots", "-q", "-o", str(out)]) == 130
    assert (out / "r1" / "report.html").exists() and not (out / "r2").exists()
    assert list(json.loads((out / "robots.json").read_text())["robots"]) == ["r1"]


@pytest.mark.integration
def test_robots_of_one_design_share_their_effect_and_its_scatter(tmp_path, capsys, monkeypatch):
    """Stiffer than declared by 20 and by 35 %."""
    truth = {"r1": 1.20, "r2": 1.35}
    for seed, (name, bending) in enumerate(truth.items()):
        data = measured({"stiffness_scale": {"bending": bending, "torsion": 1.0}}, seed=seed)
        write_measured(replace(data, name=name), tmp_path / name)
    folders = [str(tmp_path / name) for name in truth]
    monkeypatch.setattr(command, "LOG_INTERVAL", -1.0)
    assert main(["identify", *folders, "--robots", "-o", str(tmp_path / "out"), "--processes", "1"]) == 0
    log = capsys.readouterr().err
    begun = [log.index(f": {name}: the declared model") for name in truth]
    assert begun == sorted(log.index(f": {name}: ") for name in truth)
    found = json.loads((tmp_path / "out" / "robots.json").read_text())
    assert found["effects"] == ["stiffness_scale"] and set(found["robots"].values()) == {"explained"}
    bending = found["parameters"]["stiffness_scale.bending"]
    for name, value in truth.items():
        assert bending["robots"][name]["value"] == pytest.approx(value, abs=0.01)
        assert (tmp_path / "out" / name / "report.html").exists()
    assert bending["common"]["value"] == pytest.approx(np.mean(list(truth.values())), abs=0.01)
    assert bending["scatter"]["value"] == pytest.approx(np.std(list(truth.values()), ddof=1), rel=0.15)
    assert main(["identify", folders[0], "--robots", "-o", str(tmp_path / "one")]) == 2
