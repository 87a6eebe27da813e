"""Curvature along the arc length as the only measurement, made by the independent reference, through the command."""

import json

import numpy as np
import pytest
from identify_data import MODEL, ROBOT, sequence

from tdcr_fe.cli import main
from tdcr_fe.effects import Experiment, with_effects
from tdcr_fe.io.measured import MeasuredData, write_measured
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.channels import channel
from tdcr_fe.model.observed_step import ObservedStep
from tdcr_fe.validation.reference import ReferenceSettings, solve_reference

#: Noise of a fibre grating [1/m].
SIGMA = 0.02

#: Precurvature of the true robot [1/m].
KAPPA = (0.6, -0.4)


@pytest.mark.integration
def test_precurvature_is_found_from_readings_of_curvature(tmp_path):
    steps = sequence()
    ids = tuple(range(1, len(steps) + 1))
    gratings = [0.0125 + 0.025 * k for k in range(8)]
    sampled = tuple(s + d for s in gratings for d in (-2e-4, 2e-4))
    true = with_effects(
        Experiment(ROBOT, MODEL, steps),
        {"precurvature": dict(zip(("kappa_x", "kappa_y"), KAPPA, strict=True))},
    )
    solved = solve_reference(
        true.robot, true.model, true.steps, settings=ReferenceSettings(sample_at=sampled)
    )
    assert solved.converged
    noise = np.random.default_rng(3)
    readings = []
    for n, step in zip(ids, solved.steps, strict=True):
        observed = ObservedStep.of(step, tuple(ROBOT.tendon_names))
        for axis in "xy":
            values = channel(f"curvature_{axis}").predict(observed, gratings)
            readings += [
                Reading(n, f"curvature_{axis}", s, float(v + noise.normal(0.0, SIGMA)), SIGMA)
                for s, v in zip(gratings, values, strict=True)
            ]
    data = MeasuredData("gratings", ROBOT, MODEL, ids, steps, ("",) * len(ids), tuple(readings))
    write_measured(data, tmp_path / "set")
    status = main(["identify", str(tmp_path / "set"), "-o", str(tmp_path / "out"), "--processes", "1", "-q"])
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert (status, found["verdict"]) == (0, "explained")
    assert [e["effect"] for e in found["effects"]] == ["precurvature"]
    for name, true_value in zip(("kappa_x", "kappa_y"), KAPPA, strict=True):
        p = found["effects"][0]["parameters"][name]
        assert abs(p["value"] - true_value) < 4.0 * p["std_error"] < 0.05
    page = (tmp_path / "out" / "report.html").read_text()
    assert "1/m" in page and "curvature" in page
