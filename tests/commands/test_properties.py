"""Random robots and scenarios through ``tdcr-fe run``: no traceback, complete tables, the results of the Python API.

Where the reference covers a case, its tip is met within the tolerance, or the summary says more. The seed of a failing
case is in the name of its test. The slow set: ``pytest -m campaign tests/commands/test_properties.py``.
"""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from random_scenarios import RandomScenario, draw

from tdcr_fe.cli import main
from tdcr_fe.io.toml import Scenario, read_scenario
from tdcr_fe.model.results import SequenceResult
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.reference import ReferenceSettings, solve_reference

#: Largest distance of the tip from the reference over the length, unless the summary's estimate or warnings say more.
TOLERANCE = 5e-4
#: In CI these go through a process of their own; all others run in this one.
OWN_PROCESS = (3, 17)


def run_command(path: Path, out: Path, own_process: bool) -> int:
    arguments = ["run", str(path), "-o", str(out), "--no-pictures", "-q"]
    if not own_process:
        return main(arguments)
    done = subprocess.run(
        [sys.executable, "-m", "tdcr_fe", *arguments], capture_output=True, text=True, check=False
    )
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode


def read_table(path: Path) -> dict[str, list[str]]:
    """Columns of a table as text; Python's floats take the numbers in them back bit for bit."""
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    return {name: [row[k] for row in rows] for k, name in enumerate(header)}


def numbers(table: dict[str, list[str]], *names: str) -> np.ndarray:
    return np.array([[float(x) for x in table[name]] for name in names]).T


def check_tables(scenario: Scenario, result: SequenceResult, out: Path) -> None:
    """Every table has every step, tendon and segment, and the numbers of the Python API bit for bit."""
    steps, tensions, shape = (read_table(out / f"{name}.csv") for name in ("steps", "tensions", "shape"))
    robot, count = scenario.robot, len(result.steps)
    assert [int(k) for k in steps["step"]] == list(range(1, count + 1))
    segments = {t.name: len(robot.hole_arc_lengths(t)) - 1 for t in robot.tendons}
    expected = [
        (str(k), name, str(i + 1))
        for k in range(1, count + 1)
        for name, n in segments.items()
        for i in range(n)
    ]
    assert list(zip(tensions["step"], tensions["tendon"], tensions["segment"], strict=True)) == expected
    found = numbers(tensions, "tension")[:, 0] if expected else np.zeros(0)
    positions = numbers(shape, "x", "y", "z")
    np.testing.assert_array_equal(
        found, np.concatenate([np.zeros(0), *(t for s in result.steps for t in s.tensions)])
    )
    if count:
        np.testing.assert_array_equal(numbers(steps, "tip_x", "tip_y", "tip_z"), result.tips)
        np.testing.assert_array_equal(positions, np.concatenate([s.positions for s in result.steps]))
    assert np.all(np.isfinite(found)) and np.all(np.isfinite(positions))


def reference_covers(case: RandomScenario, scenario: Scenario) -> bool:
    """Without friction the solution does not depend on the path, and the reference is fast."""
    few = len(scenario.robot.disks.positions) <= 13
    return few and scenario.model.friction == "none" and case.seed % 2 == 0


def check_reference(scenario: Scenario, result: SequenceResult) -> None:
    """Tip of every step against the reference."""
    length = scenario.robot.backbone.length
    settings = ReferenceSettings(substeps=8)
    reference = solve_reference(scenario.robot, scenario.model, scenario.steps, settings=settings)
    for step, expected in zip(result.steps, reference.steps, strict=False):
        deviation = float(np.linalg.norm(step.tip - expected.tip)) / length
        said = 2.0 * (step.discretisation_error or 0.0) / length
        named = any(f"step {step.step}" in w or "steps (" in w for w in result.warnings)
        assert deviation <= max(TOLERANCE, said) or named, (step.step, deviation, said, result.warnings)


def check(seed: int, folder: Path, own_process: bool = False) -> None:
    case = draw(seed)
    path = case.write(folder)
    out = folder / "out"
    status = run_command(path, out, own_process)
    assert status in (0, 1), f"exit status {status}"
    scenario = read_scenario(path)
    result = simulate(scenario.robot, scenario.model, scenario.steps, scenario.settings)
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert status == (0 if result.converged else 1)
    assert summary["converged"] == result.converged
    assert summary["steps_asked"] == len(scenario.steps)
    assert summary["warnings"][-len(result.warnings) :] == list(result.warnings) or not result.warnings
    assert [s["discretisation_error"] for s in summary["steps"]] == [
        s.discretisation_error for s in result.steps
    ]
    check_tables(scenario, result, out)
    if result.converged:
        assert len(result.steps) == len(scenario.steps)
    else:
        assert result.failed_step == len(result.steps) + 1
        assert f"step {result.failed_step}" in summary["message"]
    if reference_covers(case, scenario):
        check_reference(scenario, result)


@pytest.mark.parametrize("seed", range(40))
def test_random_scenarios_through_the_command(seed: int, tmp_path: Path) -> None:
    """Seed 2, a continuous tendon path without tendons: an AttributeError before 0.2."""
    check(seed, tmp_path, seed in OWN_PROCESS)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(40, 540))
def test_many_random_scenarios_through_the_command(seed: int, tmp_path: Path) -> None:
    check(seed, tmp_path, seed % 50 == 0)
