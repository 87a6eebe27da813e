"""Random robots of the campaigns: what is drawn, and how both solutions are compared."""

from __future__ import annotations

import hashlib
import json
import tomllib
from dataclasses import replace

import pytest

from tdcr_fe.io.write_toml import robot_to_toml, scenario_to_toml
from tdcr_fe.validation import random_robots, runner
from tdcr_fe.validation.campaigns import cut_steps
from tdcr_fe.validation.campaigns.random_robots import Outcome, compare
from tdcr_fe.validation.fuzz import drawing


def digest(cases):
    """Of the robots and scenarios as files, with numbers to nine digits: the last ones depend on the processor."""
    texts = [
        text for c in cases for text in (robot_to_toml(c.robot), scenario_to_toml(c.model, list(c.steps)))
    ]
    tables = [tomllib.loads(text, parse_float=lambda number: f"{float(number):.9g}") for text in texts]
    data = json.dumps(tables, sort_keys=True)
    return hashlib.sha256(data.encode()).hexdigest()[:16]


def test_seeds_draw_the_same_robots_as_ever():
    """One to six tendons; tension, displacement, elastic tendons."""
    cases = [random_robots.draw(number) for number in range(60)]
    assert digest(cases) == "428914800711bac1"
    assert {len(case.robot.tendons) for case in cases} == set(range(1, 7))
    elastic = {(case.by_displacement, case.robot.tendons[0].axial_stiffness is not None) for case in cases}
    assert elastic == {(False, False), (True, False), (True, True)}


def test_seeds_draw_the_same_robots_with_all_options_as_ever():
    cases = [drawing.draw(number) for number in range(100)]
    written = [c for c in cases if not any(t.routing.kind == "twisted" for t in c.robot.tendons)]
    assert digest(written) == "0b1b5f9f10e0556d"


OUTCOME = Outcome(6, 1, 4, "tension", [0.0], [0.0], [False], [], [], 1.0, 1.0)


@pytest.mark.parametrize(
    ("gap", "estimate", "announced", "passed"),
    [
        (9e-4, 0.0, False, True),
        (2e-3, 0.0, False, False),
        (2e-3, 1.1e-3, False, True),
        (0.1, 0.0, True, True),
    ],
)
def test_a_difference_must_be_small_or_announced(gap, estimate, announced, passed):
    """0.1 % of the length, twice the announced error of the mesh, or a warning that names the step."""
    outcome = replace(OUTCOME, gaps=[0.0, gap], estimates=[0.0, estimate], announced=[False, announced])
    assert outcome.passed is passed
    assert not replace(outcome, failures=["fe: no"]).passed


def test_an_error_of_the_program_is_a_failure_of_its_case():
    def broken(*_):
        raise FloatingPointError("on purpose")

    found = compare(random_robots.draw(6), {"fe": broken, "reference": broken})
    assert not found.passed and found.failures[0] == "fe: FloatingPointError: on purpose"


@pytest.mark.integration
@pytest.mark.parametrize("number", [0, 6])
def test_finite_elements_and_reference_agree_with_default_settings(tmp_path, number):
    """To the error that the finite elements announce."""
    found = runner.load("random_robots").run(number, tmp_path)
    assert found.passed
    assert max(found.gaps) < 2.0 * max(found.estimates) + 1e-6


@pytest.mark.integration
@pytest.mark.parametrize(("number", "parts"), [(20, 8), (16, 16)])
def test_a_robot_does_not_depend_on_how_its_steps_are_cut(number, parts):
    """Seed 16 comes near a buckling load: with states that lay far from the path, the last step moved by 1.2e-5."""
    assert cut_steps.compare(random_robots.draw(number), parts).passed
