"""``tdcr-fe run --sensitivities ... --compliance``: tables for every tendon path, mistakes named."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from run_files import write_robot

from tdcr_fe import cli


@pytest.mark.parametrize(("tendon_path", "friction"), [("straight", "per-hole"), ("continuous", "none")])
def test_derivatives_and_responses_are_written(tmp_path, capsys, tendon_path, friction):
    """One row a step and parameter; the response of the tip in every step of the summary."""
    scenario, out = write_robot(tmp_path, tendon_path, friction), tmp_path / "out"
    names = ["backbone.youngs_modulus", "tendons.helical.turns", "inputs.points"]
    options = ["--no-pictures", "--sensitivities", *names, "--compliance"]
    assert cli.main(["run", str(scenario), "-o", str(out), *options]) == 0
    text = capsys.readouterr().out
    assert "last step, derivative by" in text and "all holes stick (reversal)" in text
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
        assert np.shape(first["compliance"]) == (6, 6) and np.shape(first["motor_stiffness"]) == (5, 5)
    # Without the options, neither is written.
    assert cli.main(["run", str(scenario), "-o", str(out), "--no-pictures", "-q"]) == 0
    assert not (out / "sensitivities.csv").exists()
    assert "tip_response" not in json.loads((out / "summary.json").read_text())["steps"][0]


def test_a_parameter_that_does_not_exist_is_named(tmp_path, capsys):
    scenario = write_robot(tmp_path, "straight", "per-hole")
    arguments = ["run", str(scenario), "-o", str(tmp_path / "out"), "--sensitivities", "backbone.elasticity"]
    assert cli.main(arguments) == 2
    assert "  --sensitivities: 'backbone.elasticity' names no number" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
