"""The files of the corrected robot: ``tdcr-fe run`` repeats the fit."""

from dataclasses import replace

import numpy as np
import pytest
from identify_data import FRICTIONAL, GRAVITY, ROBOT, measured
from searches import check_run, concluded, problem_of, state_of, tips_of_run, with_model, write_corrected

from tdcr_fe import Load, identify, read_robot, read_scenario
from tdcr_fe.effects import Parameter, effect, with_effects
from tdcr_fe.effects.base import Kind
from tdcr_fe.identify.causes import StateLoad
from tdcr_fe.identify.corrected import corrected_motion, observation_effects
from tdcr_fe.identify.report import render

PRECURVATURE = {"precurvature": {"kappa_x": 0.6, "kappa_y": -0.4}}
COMMANDS = {"actuator_loss": {"dead_band": 0.05, "efficiency": 0.9}}


def found(values, data=None):
    """The result of a search that ended with effects at these values."""
    return concluded(with_model(state_of(problem_of(measured() if data is None else data)), values))


def rough():
    """Readings of a robot with friction."""
    return measured(robot=ROBOT.with_tendons(friction_coefficient=0.25), model=FRICTIONAL)


ACTS_ON = {"model": (GRAVITY, measured), "robot": (PRECURVATURE, measured), "commands": (COMMANDS, rough)}


@pytest.mark.parametrize(("values", "data"), ACTS_ON.values(), ids=ACTS_ON)
def test_a_run_of_the_corrected_robot_repeats_the_fit(values, data, tmp_path):
    """Tip positions agree with the fit's within 1e-9 m, for effects on the model, the robot and the commands."""
    check_run(found(values, data()), tmp_path, 1e-9)


def test_the_robot_file_has_what_a_robot_can_have_and_the_effects_file_the_rest(tmp_path):
    write_corrected(found({**PRECURVATURE, **GRAVITY}), tmp_path)
    corrected = read_robot(tmp_path / "robot.toml").backbone.precurvature
    assert corrected == tuple(PRECURVATURE["precurvature"].values())
    text = (tmp_path / "effects.toml").read_text()
    assert "gravity = {" in text and "precurvature" not in text
    assert read_scenario(tmp_path / "effects.toml").model.gravity == tuple(GRAVITY["gravity"].values())


def test_effects_on_the_measurement_are_comments(tmp_path):
    result = found({"frame_misalignment": {"rot_x": 0.03, "rot_y": -0.02, "rot_z": 0.05}})
    write_corrected(result, tmp_path)
    assert "# acts on the measurement only: frame_misalignment" in (tmp_path / "effects.toml").read_text()
    assert read_scenario(tmp_path / "effects.toml").robot == result.data.robot


def test_divided_steps_are_written_in_parts_with_the_effects_on_their_commands(tmp_path):
    """Also where an effect divides a step that a declared effect has divided already."""
    result = found(COMMANDS, rough())
    whole = result.simulated.commanded
    before, after = whole.steps[1].tensions, whole.steps[2].tensions
    shares = (0.25, 0.5, 0.75, 1.0)
    pulls = [{n: before[n] + x * (after[n] - before[n]) for n in after} for x in shares]
    parts = [replace(whole.steps[2], tensions=pull) for pull in pulls]
    ends = [(k, 1.0) for k in range(len(whole.steps))]
    ends[2:3] = [(2, x) for x in shares]
    commanded = replace(whole, steps=(*whole.steps[:2], *parts, *whole.steps[3:]), ends=tuple(ends))
    write_corrected(replace(result, simulated=replace(result.simulated, commanded=commanded)), tmp_path)
    scenario = read_scenario(tmp_path / "effects.toml")
    expected = with_effects(commanded, result.effects_table)
    assert [s.tensions for s in scenario.steps] == [s.tensions for s in expected.steps]
    assert [s.label for s in scenario.steps].count("3 (part 1 of 4)") >= 1
    assert expected == effect("actuator_loss").apply(commanded, COMMANDS["actuator_loss"])


def test_loads_of_a_law_are_written_where_the_robot_cannot_be(tmp_path, monkeypatch):
    """The cause stood in the table of effects, which `tdcr-fe run` refused: a soft robot with misplaced channels."""
    result = found({**PRECURVATURE, **GRAVITY, **COMMANDS}, rough())
    pull = replace(result.effects[0], name="attraction", sentence="a force towards a point")
    parameters = tuple(Parameter(n, "N", -1.0, 1.0, 0.0, 0.1, n) for n in pull.parameters)
    cause = StateLoad("attraction", Kind("force", ("position",)), parameters, (), pull.sentence)
    corrected, catalogue = result.simulated.corrected, (*result.simulated.catalogue, cause)
    loaded = [replace(s, loads={**s.loads, "law 1": Load(0.1, (0.01, 0.0, 0.0))}) for s in corrected.steps]
    corrected = replace(corrected, steps=tuple(loaded))
    simulated = replace(result.simulated, corrected=corrected, catalogue=catalogue)

    def declared_only(robot, write=identify.corrected.robot_to_toml):
        if robot != result.data.robot:
            raise ValueError
        return write(robot)

    monkeypatch.setattr(identify.corrected, "robot_to_toml", declared_only)
    write_corrected(replace(result, simulated=simulated, effects=(*result.effects, pull)), tmp_path)
    scenario = read_scenario(tmp_path / "effects.toml")
    assert [s.tensions for s in scenario.steps] == [s.tensions for s in corrected.steps]
    assert all(s.loads["law 1"].at == 0.1 for s in scenario.steps)
    assert scenario.robot.backbone.precurvature == corrected.robot.backbone.precurvature
    assert scenario.model.gravity == corrected.model.gravity


def test_effects_that_need_each_other_are_written_and_drawn(tmp_path):
    """Pretension needs the stretch of the tendons: applied alone, it ended the command in a traceback."""
    data = measured()
    moved = [{n: 1e-3 * x for n, x in s.tensions.items()} for s in data.steps]
    steps = [replace(s, tensions={}, displacements=x) for s, x in zip(data.steps, moved, strict=True)]
    steps = tuple(replace(s, time=float(k)) for k, s in enumerate(steps))
    values = {
        "pretension": {"tension": 0.5},
        "tendon_stretch": {"axial_stiffness": 500.0},
        "gravity": {"g_x": 0.0, "g_y": -6.0, "g_z": -7.0},
        "frame_misalignment": {"rot_x": 0.02, "rot_y": 0.0, "rot_z": 0.0},
        "time_lag": {"lag": 0.2},
    }
    result = found(values, replace(data, steps=steps))
    assert observation_effects(result) == ["frame_misalignment"]
    write_corrected(result, tmp_path)
    tendons = read_robot(tmp_path / "robot.toml").tendons
    assert all(t.axial_stiffness == 500.0 and t.pretension == pytest.approx(0.5) for t in tendons)
    assert "The robot in 3D" in render(result, corrected_motion(result, tmp_path))
    seen = result.simulated.corrected.observation.in_base(result.shapes.backbone_after[-1, -1])
    run = tips_of_run(tmp_path / "effects.toml", tmp_path / "out")
    np.testing.assert_allclose(run.to_numpy()[-1], seen, rtol=0.0, atol=1e-8)
