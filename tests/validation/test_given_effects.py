"""Effects that are given by name: fitted in their order, and what each takes away."""

import json
from dataclasses import replace

import numpy as np
import pytest
from robots import LENGTH, three

from tdcr_fe.effects import Experiment, with_effects
from tdcr_fe.identify.forward import Task, run_settings, simulate_experiment
from tdcr_fe.identify.run import Reader
from tdcr_fe.io.measured import MeasuredData, write_measured
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.loading import LoadStep, Model, SolverSettings
from tdcr_fe.validation.campaigns.given_effects import chosen_form
from tdcr_fe.validation.runner import main

HIDDEN = {
    "tendon_stretch": {"axial_stiffness": 300.0},
    "marker_offset": {"offset_x": 1e-3, "offset_y": -5e-4, "offset_z": 3e-3},
}


@pytest.fixture(scope="module")
def data() -> MeasuredData:
    """Three tendons pulled in by displacement one after another; the tip without noise."""
    steps, branches = [], []
    for name in ("t1", "t2", "t3"):
        for share in (0.25, 0.5, 0.75, 1.0, 0.5):
            values = {n: (4e-3 if n == name else -2e-3) * share for n in ("t1", "t2", "t3")}
            steps.append(LoadStep(displacements=values))
            branches.append(f"pull_{name}")
    ids = tuple(range(1, len(steps) + 1))
    readings = tuple(Reading(n, f"position_{a}", LENGTH, 0.0, 2e-4) for n in ids for a in "xyz")
    empty = MeasuredData(
        "three", three(0.0), Model(friction="none"), ids, tuple(steps), tuple(branches), readings
    )
    model = replace(empty.model, elements_per_bay=1)
    true = with_effects(Experiment(empty.robot, model, empty.steps, empty.observation), HIDDEN)
    run = simulate_experiment(Task(true, run_settings(SolverSettings(), 5e-4)))
    values = Reader(readings, ids, empty.robot.tendon_names).read(run, true)
    return replace(
        empty, readings=tuple(replace(r, value=float(x)) for r, x in zip(readings, values, strict=True))
    )


NAMES = ["tendon_stretch", "marker_offset (along the tangent, too)"]


def test_the_command_prints_and_writes_what_each_takes_away(data, tmp_path, capsys):
    write_measured(data, tmp_path / "set")
    arguments = [
        "given_effects",
        str(tmp_path / "set"),
        "--hold-out",
        "pull_t3",
        "-o",
        str(tmp_path / "out"),
        "--effects",
    ]
    assert main([*arguments, NAMES[0]]) == 0
    assert "tendon_stretch: axial_stiffness = " in capsys.readouterr().out
    (line,) = (tmp_path / "out" / "given_effects.jsonl").read_text().splitlines()[1:]
    declared, found = json.loads(line)["stages"]
    assert found["held_out"] < declared["held_out"]
    branches = found["by_branch"]
    assert set(branches) == {"pull_t1", "pull_t2", "pull_t3"}
    assert np.mean([branches["pull_t1"], branches["pull_t2"]]) == pytest.approx(found["fitted"], rel=1e-6)
    other = [*arguments, "tendon_stretch (by segment)"]
    assert main(other) == 2
    assert "options differ" in capsys.readouterr().err
    other[other.index(str(tmp_path / "out"))] = str(tmp_path / "other")
    assert main(other) == 2
    assert "no form 'tendon_stretch (by segment)'; there are tendon_stretch," in capsys.readouterr().err
    with pytest.raises(ValueError, match="no effect 'wind'"):
        chosen_form("wind", Experiment(data.robot, data.model))
