"""Effects that a builder declares for identify, in the table [effects] of model.toml."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from robots import LENGTH, three

from tdcr_fe.effects import Experiment, with_effects
from tdcr_fe.identify.forward import ForwardModel, Task, run_settings, simulate_experiment
from tdcr_fe.identify.problem import FitProblem, evaluate
from tdcr_fe.identify.reader import Reader
from tdcr_fe.io.measured import MeasuredData, join_measured, read_measured, write_measured
from tdcr_fe.io.problems import InputError
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.loading import LoadStep, Model, SolverSettings

DECLARED = {
    "actuator_backlash": {"backlash": 3e-4},
    "gravity": {"g_y": -9.81},
    "pretension": {"tension_t2": 0.4},
    "marker_offset": {"offset_z": 8e-3},
    "frame_misalignment": {"rot_z": 0.1, "shift_x": 2e-3},
}
ELASTIC = three(0.05).with_tendons(axial_stiffness=300.0)


@pytest.fixture(scope="module")
def data() -> MeasuredData:
    """What a robot shows that is as declared."""
    pulls = (1e-3, 2e-3, 3e-3, 2e-3, 1e-3, 2.5e-3)
    steps = tuple(LoadStep(displacements={"t1": x, "t2": -0.5 * x, "t3": -0.5 * x}) for x in pulls)
    ids = tuple(range(1, len(steps) + 1))
    readings = tuple(
        Reading(n, f"position_{a}", s, 0.0, 1e-4) for n in ids for s in (0.125, LENGTH) for a in "xyz"
    )
    plain = MeasuredData("set", ELASTIC, Model(), ids, steps, ("",) * len(ids), readings)
    model = Model(elements_per_bay=1)
    true = with_effects(Experiment(ELASTIC, model, steps, plain.observation), DECLARED)
    run = simulate_experiment(Task(true, run_settings(SolverSettings(), 5e-5)))
    values = Reader(readings, ids, ELASTIC.tendon_names).read(run, true)
    return replace(
        plain, readings=tuple(replace(r, value=float(x)) for r, x in zip(readings, values, strict=True))
    )


def folder(data, tmp_path, text, name="set"):
    write_measured(data, tmp_path / name)
    model = tmp_path / name / "model.toml"
    model.write_text(model.read_text() + "\n[effects]\n" + text)
    return tmp_path / name


TEXT = "\n".join(
    f"{name} = {{ {', '.join(f'{k} = {v}' for k, v in values.items())} }}"
    for name, values in DECLARED.items()
)


def test_what_is_declared_is_part_of_the_declared_model(data, tmp_path):
    declared = read_measured(folder(data, tmp_path, TEXT))
    assert declared.robot.tendon("t2").pretension == 0.4 and declared.model.gravity == (0.0, -9.81, 0.0)
    assert set(declared.effects) == {"actuator_backlash", "marker_offset", "frame_misalignment"}
    assert len(declared.steps) == 6 and len(declared.experiment.steps) > 6
    held = np.zeros(len(data.readings), dtype=bool)
    problem = FitProblem.of(declared, np.full(len(held), 1e-4), held, ForwardModel())
    assert np.max(np.abs(evaluate(problem, (), {}).residual)) < 0.05
    plain = FitProblem.of(data, np.full(len(held), 1e-4), held, ForwardModel())
    assert np.max(np.abs(evaluate(plain, (), {}).residual)) > 50.0


def test_it_goes_through_the_files(data, tmp_path):
    declared = read_measured(folder(data, tmp_path, TEXT))
    write_measured(declared, tmp_path / "again")
    again = read_measured(tmp_path / "again")
    assert (again.robot, again.model, again.effects) == (declared.robot, declared.model, declared.effects)
    assert again.experiment == declared.experiment


def test_two_sets_must_declare_the_same(data, tmp_path):
    a = read_measured(folder(data, tmp_path, "marker_offset = { offset_z = 8e-3 }", "a"))
    b = read_measured(folder(data, tmp_path, "marker_offset = { offset_z = 9e-3 }", "b"))
    with pytest.raises(InputError, match="effects"):
        join_measured([a, b])
    both = join_measured([a, replace(a, name="c")])
    assert both.experiment.observation.along == 8e-3 and both.experiment.restarts == (6,)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gravitas = { g_z = 1.0 }", "did you mean gravity"),
        ("actuator_gain = { gain = -1.0 }", "must be a number .* from 0.05 to 20"),
        ("marker_offset = { offset_z_marker_3 = 1e-3 }", "offset_z_marker_2"),
        ("time_lag = { lag = 0.1 }", "time_lag needs a time in every step"),
    ],
)
def test_mistakes_are_named(data, tmp_path, text, message):
    with pytest.raises(InputError, match=message) as caught:
        read_measured(folder(data, tmp_path, text))
    assert "model.toml" in str(caught.value)


def test_example_in_the_docs_is_read_without_mistake(data, tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "files.md").read_text("utf-8")
    (text,) = re.findall(r"```toml\n(\[model\]\nfriction.*?)```", page, re.DOTALL)
    write_measured(data, tmp_path / "set")
    (tmp_path / "set" / "model.toml").write_text(text)
    declared = read_measured(tmp_path / "set")
    assert declared.effects["marker_offset"]["offset_z"] == 8e-3
    assert set(declared.effects) == {"actuator_backlash", "marker_offset", "frame_misalignment"}
