"""The files of the corrected robot: ``tdcr-fe run`` repeats the fit."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from identify_data import MODEL, ROBOT, measured

from tdcr_fe.cli import main
from tdcr_fe.effects import effect, with_effects
from tdcr_fe.identify import IdentifySettings, identify
from tdcr_fe.identify.conclude import conclude
from tdcr_fe.identify.corrected import corrected_files, observation_effects
from tdcr_fe.identify.divide import divide_steps
from tdcr_fe.identify.forward import ForwardModel
from tdcr_fe.identify.problem import FitProblem, evaluate
from tdcr_fe.identify.replay import corrected_motion
from tdcr_fe.identify.report import write_report
from tdcr_fe.identify.search_state import Search, SearchState
from tdcr_fe.io.toml import read_robot, read_scenario

ROUGH = replace(ROBOT, tendons=tuple(replace(t, friction_coefficient=0.25) for t in ROBOT.tendons))
TRUTHS = {
    "model": {"gravity": {"g_x": 3.0, "g_y": -6.0, "g_z": -7.0}},
    "robot": {"precurvature": {"kappa_x": 0.6, "kappa_y": -0.4}},
    "commands": {"actuator_loss": {"dead_band": 0.05, "efficiency": 0.9}},
}


def write(result, folder):
    for name, text in corrected_files(result).items():
        (folder / name).write_text(text, encoding="utf-8")


@pytest.mark.parametrize(("kind", "friction"), [("model", False), ("robot", False), ("commands", True)])
def test_a_run_of_the_corrected_robot_repeats_the_fit(kind, friction, tmp_path):
    """Tip positions agree with the fit's within 1e-9 m, for effects on the model, the robot and the commands."""
    robot, model = (ROUGH, replace(MODEL, friction="per-hole")) if friction else (ROBOT, MODEL)
    result = identify(measured(TRUTHS[kind], robot=robot, model=model))
    assert list(TRUTHS[kind]) == [e.name for e in result.effects]
    write(result, tmp_path)
    scenario = str(tmp_path / "effects.toml")
    assert main(["run", scenario, "-o", str(tmp_path / "out"), "--no-pictures", "-q"]) == 0
    table = pd.read_csv(tmp_path / "out" / "steps.csv", dtype={"label": str})
    ends = table.drop_duplicates("label", keep="last").set_index("label")
    tips = ends.loc[[str(n) for n in result.data.step_ids], ["tip_x", "tip_y", "tip_z"]].to_numpy()
    np.testing.assert_allclose(tips, result.shapes.backbone_after[:, -1], rtol=0.0, atol=1e-9)


def test_the_robot_file_has_what_a_robot_can_have_and_the_effects_file_the_rest(tmp_path):
    truth = {**TRUTHS["robot"], **TRUTHS["model"]}
    result = identify(measured(truth))
    write(result, tmp_path)
    values = result.effects_table
    corrected = read_robot(tmp_path / "robot.toml").backbone.precurvature
    assert corrected == tuple(values["precurvature"].values())
    text = (tmp_path / "effects.toml").read_text()
    assert "gravity = {" in text and "precurvature" not in text
    assert read_scenario(tmp_path / "effects.toml").model.gravity == tuple(values["gravity"].values())


def test_effects_on_the_measurement_are_comments(tmp_path):
    result = identify(measured({"frame_misalignment": {"rot_x": 0.03, "rot_y": -0.02, "rot_z": 0.05}}))
    assert [e.name for e in result.effects] == ["frame_misalignment"]
    write(result, tmp_path)
    assert "# acts on the measurement only: frame_misalignment" in (tmp_path / "effects.toml").read_text()
    assert read_scenario(tmp_path / "effects.toml").robot == result.data.robot


def test_divided_steps_are_written_in_parts_with_the_effects_on_their_commands(tmp_path):
    """Also where an effect divides a step that is divided already."""
    model = replace(MODEL, friction="per-hole")
    result = identify(measured(TRUTHS["commands"], robot=ROUGH, model=model))
    commanded = divide_steps(result.commanded, {2, 8}, 4)
    again = replace(result, commanded=commanded)
    write(again, tmp_path)
    scenario = read_scenario(tmp_path / "effects.toml")
    expected = with_effects(commanded, result.effects_table)
    assert [s.tensions for s in scenario.steps] == [s.tensions for s in expected.steps]
    assert [s.label for s in scenario.steps].count("3 (part 1 of 4)") >= 1
    e = effect("actuator_loss")
    assert expected == e.apply(commanded, result.effects_table["actuator_loss"])


def test_effects_that_need_each_other_are_written_and_drawn(tmp_path):
    """Pretension needs the stretch of the tendons: applied alone, it ended the command in a traceback."""
    data = measured()
    moved = tuple(
        replace(s, tensions={}, displacements={n: 1e-3 * x for n, x in s.tensions.items()}, time=float(k))
        for k, s in enumerate(data.steps)
    )
    data = replace(data, steps=moved)
    values = {
        "pretension": {"tension": 0.5},
        "tendon_stretch": {"axial_stiffness": 500.0},
        "gravity": {"g_x": 0.0, "g_y": -6.0, "g_z": -7.0},
        "frame_misalignment": {"rot_x": 0.02, "rot_y": 0.0, "rot_z": 0.0},
        "time_lag": {"lag": 0.2},
    }
    count = len(data.readings)
    problem = FitProblem.of(data, np.full(count, 1e-4), np.zeros(count, dtype=bool), ForwardModel())
    state = SearchState.start(problem, evaluate(problem, (), {}))
    best = evaluate(problem, tuple(effect(name) for name in values), values)
    search = Search(IdentifySettings(), lambda text, share: None)
    result = conclude(search, replace(state, best=best), False, 0.0)
    assert observation_effects(result) == ["frame_misalignment"]
    write(result, tmp_path)
    tendons = read_robot(tmp_path / "robot.toml").tendons
    assert all(t.axial_stiffness == 500.0 and t.pretension == pytest.approx(0.5) for t in tendons)
    motion = corrected_motion(result, tmp_path)
    write_report(result, tmp_path / "report.html", motion)
    scenario = str(tmp_path / "effects.toml")
    assert main(["run", scenario, "-o", str(tmp_path / "out"), "--no-pictures", "-q"]) == 0
    table = pd.read_csv(tmp_path / "out" / "steps.csv", dtype={"label": str})
    tip = table.drop_duplicates("label", keep="last")[["tip_x", "tip_y", "tip_z"]].to_numpy()[-1]
    seen = result.corrected.observation.in_base(result.shapes.backbone_after[-1, -1])
    np.testing.assert_allclose(tip, seen, rtol=0.0, atol=1e-8)
