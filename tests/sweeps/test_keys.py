"""Keys of a sweep name values of the files as the files have them."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from sweep_files import ROBOT, SCENARIO

from tdcr_fe.io.toml import ScenarioTables, build_scenario
from tdcr_fe.sweeps.keys import KeyProblem, parse_key, set_value

TABLES = ScenarioTables(
    tomllib.loads(SCENARIO), tomllib.loads(ROBOT), Path("scenario.toml"), Path("robot.toml")
)


def with_value(key, value, tables=TABLES):
    return set_value(tables, parse_key(key), lambda declared: value)


@pytest.mark.parametrize(
    ("key", "value", "get"),
    [
        ("backbone.radius", 0.5e-3, lambda s: s.robot.backbone.radius),
        ("backbone.precurvature[1]", 2.0, lambda s: s.robot.backbone.precurvature[1]),
        ("tip_mass", 0.01, lambda s: s.robot.tip_mass),
        ("tendons.t2.friction_coefficient", 0.3, lambda s: s.robot.tendon("t2").friction_coefficient),
        ("tendons[1].offset", 4e-3, lambda s: s.robot.tendon("t2").routing.offset),
        ('tendons."t1".angle_deg', 10.0, lambda s: s.robot.tendon("t1").routing.angle_deg),
        ("model.gravity[2]", -9.81, lambda s: s.model.gravity[2]),
        ("model.friction", "none", lambda s: s.model.friction),
        ("solver.max_iterations", 30, lambda s: s.settings.max_iterations),
        ("steps[0].tensions.t2", 0.7, lambda s: s.steps[0].tensions.get("t2")),
        ("steps[-1].tensions.t1", 0.8, lambda s: s.steps[0].tensions["t1"]),
        ("effects.gravity.g_z", -9.0, lambda s: s.model.gravity[2]),
    ],
)
def test_a_key_sets_the_value_and_leaves_the_given_tables(key, value, get):
    before = build_scenario(TABLES)
    assert get(build_scenario(with_value(key, value))) == value
    assert build_scenario(TABLES) == before
    assert get(before) != value


def test_a_key_without_a_name_means_all_tendons():
    scenario = build_scenario(with_value("tendons.friction_coefficient", 0.4))
    assert [t.friction_coefficient for t in scenario.robot.tendons] == [0.4, 0.4]


def test_a_key_without_a_number_means_the_steps_that_have_it():
    steps = [{"tensions": {"t1": 1.0}}, {"tensions": {"t2": 1.0}}, {"tensions": {"t1": 2.0}}]
    tables = ScenarioTables({**TABLES.scenario, "steps": steps}, TABLES.robot, TABLES.path, TABLES.robot_path)
    changed = set_value(tables, parse_key("steps.tensions.t1"), lambda declared: 10.0 * declared)
    assert [s.tensions for s in build_scenario(changed).steps] == [{"t1": 10.0}, {"t2": 1.0}, {"t1": 20.0}]


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("backbon.radius", "did you mean backbone"),
        ("", "dotted key"),
        ("backbone..radius", "dotted key"),
        ("backbone.radius.", "dotted key"),
        ("[0].radius", "dotted key"),
    ],
)
def test_what_is_no_key_is_refused(key, text):
    with pytest.raises(KeyProblem, match=text):
        parse_key(key)


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("steps[1].tensions.t1", r"there are 1 steps; must be from steps\[0\] to steps\[0\]"),
        ("steps.tensions.t2", r"no load step has tensions.t2; steps\[0\].tensions.t2 sets it"),
        ("tendons.t3.offset", 'there is no tendon "t3"; there are t1, t2'),
        ("backbone.radius.base", "backbone.radius is not a table"),
        ("backbone.radius[0]", "backbone.radius is not a list"),
    ],
)
def test_what_is_not_in_the_files_is_refused(key, text):
    with pytest.raises(KeyProblem, match=text):
        with_value(key, 1.0)
