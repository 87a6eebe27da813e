"""Random robots and histories through ``tdcr-fe run``: no traceback, complete tables, the results of the Python API."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from tdcr_fe.cli import main
from tdcr_fe.io.toml import read_scenario
from tdcr_fe.io.write_toml import robot_to_toml, scenario_to_toml
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.fuzz.drawing import draw


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
    *range(20),
    *(pytest.param(k, marks=pytest.mark.integration) for k in range(20, 40)),
    *(pytest.param(k, marks=pytest.mark.campaign) for k in range(40, 500)),
]


@pytest.mark.parametrize("seed", TIERS)
def test_random_scenarios_through_the_command(seed, tmp_path):
    case = draw(seed)
    if any(t.routing.kind == "twisted" for t in case.robot.tendons):
        pytest.skip("robot.toml has no such routing")
    (tmp_path / "robot.toml").write_text(robot_to_toml(case.robot), encoding="utf-8")
    path, out = tmp_path / "scenario.toml", tmp_path / "out"
    path.write_text(scenario_to_toml(case.model, case.steps), encoding="utf-8")
    status = main(["run", str(path), "-o", str(out), "--no-pictures", "-q"])
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
