"""Keys of a sweep, and mistakes in it: found before anything is solved, with file, key, value and what is allowed."""

import re
import tomllib
from pathlib import Path

import pytest
from inputs import said
from sweep_files import ROBOT, SCENARIO, InProcess, write_files

import tdcr_fe as tdcr
from tdcr_fe.io.toml import ScenarioTables, build_scenario
from tdcr_fe.sweeps.keys import KeyProblem, parse_key, set_value


def problems_of(folder, text, **files):
    with pytest.raises(tdcr.InputError) as caught:
        tdcr.read_sweep(write_files(folder, text, **files))
    return [str(p).replace(f"{folder}/", "") for p in caught.value.problems]


HEAD = 'scenario = "scenario.toml"\n'


MANY = "range = { start = 0.0, stop = 1.0, count = 2000 }"
ONE = "values = [1.0]"
UNIFORM = "uniform = { lower = 0.1, upper = 0.5 }"
SOBOL = '[sampling]\nmethod = "sobol"\n'
LIST = '[sampling]\nmethod = "list"\n'


def vary(key, rest, before=""):
    return f'{HEAD}{before}[[vary]]\nkey = "{key}"\n{rest}\n'


WRONG_FILES = [
    ("", "sweep.toml: scenario: missing"),
    (SCENARIO, "sweep.toml: is the file of a scenario; give the sweep.toml that names it"),
    ('scenario = "other.toml"', 'sweep.toml: scenario = "other.toml": there is no file'),
    ('scenario = ".."', 'sweep.toml: scenario = "..": '),
    (HEAD, "sweep.toml: vary: nothing is varied"),
    (vary("backbone.raduis", ONE, "[sampling]\nmethod = 'gird'\n"), 'raduis": unknown key; did you mean radius'),
    (vary("effects.gravity.g_q", ONE), 'key = "effects.gravity.g_q": unknown key; did you mean g_z'),
    (vary("backbone.radius", "values = [1e-3, -1e-3]"), "values = -0.001: backbone.radius: must be a positive"),
    (vary("model.friction", 'values = ["none", "coulomb"]'), 'values = "coulomb": model.friction: must be "none"'),
    (vary("tip_mass", ""), "must have exactly one of values, range"),
    (vary("tip_mass", "uniform = { lower = 1.0, upper = 0.5 }"), "lower must be below upper"),
    (vary("tip_mass", UNIFORM), 'vary[0] = "tip_mass": a distribution needs sampling.method = "latin-hypercube"'),
    (vary("tip_mass", UNIFORM, f"{SOBOL}samples = 100\n"), "sampling.samples = 100: must be a power of two"),
    (HEAD + SOBOL, "sweep.toml: sampling.samples: missing"),
    (HEAD + "[sampling]\nsamples = 4", 'sweep.toml: sampling.samples = 4: only for method = "latin'),
    (vary("tendons.friction_coefficient", "normal = { mean = 0.05, std = 0.05 }", f"{SOBOL}samples = 64\n"),
        "bounds (lower, upper) leave such values out"),
    (vary("backbone.density", 'mode = "factor"\nvalues = [1.1]'), 'mode = "factor" needs a number there'),
    (vary("tip_mass", f"{ONE}\n[[vary]]\nkey = 'tip_mass'\n{ONE}"), 'vary = "tip_mass": is varied twice'),
    (vary("tip_mass", "name = 'tip_x'\nvalues = [0.0]"), 'vary = "tip_x": is the name of another column'),
    (vary("tip_mass", f"values = [0, 1]\n[[vary]]\nkey = 'backbone.density'\n{ONE}", LIST),
        'method = "list" needs as many values of each; there are 2 of tip_mass, 1 of backbone.density'),
    (vary("tip_mass", f"{MANY}\n[[vary]]\nkey = 'backbone.density'\n{MANY}"),
        'sampling.method = "grid": gives 4000000 cases; must be at most 1000000'),
    (HEAD + '[output]\nquantities = ["tipx"]', 'output.quantities[0] = "tipx": unknown; did you mean tip_x'),
    (HEAD + "[output]\nsteps = [2]", 'sweep.toml: output.steps = [2]: must be "last", "all", or'),
    (HEAD + "[workspace]\nlargest = 2.0", "sweep.toml: workspace.count: missing"),
    (HEAD + "[workspace]\nlargest = { t1 = 2.0, t9 = 1.0 }\ncount = 3", "t9 = 1.0 }: unknown tendon t9"),
    (vary("robot", 'values = ["robot.toml"]'), 'vary[0].key = "robot": unknown key; must begin with one of'),
]  # fmt: skip


@pytest.mark.parametrize(("text", "expected"), WRONG_FILES)
def test_a_mistake_is_named(tmp_path, text, expected):
    found = problems_of(tmp_path, text)
    assert any(expected in line for line in found), found


def test_all_mistakes_of_all_files_come_at_once(tmp_path, capsys):
    text = vary("nonsense", "values = [1]", f"{SOBOL}samples = 3\n")
    text += '[[vary]]\nkey = "tip_mass"\nuniform = { lower = 0.0 }\n'
    robot = "[backbone]\nlength = -1.0\nradius = 1e-3\nyoungs_modulus = 1e9\npoisson_ratio = 0.3\n[disks]\ncount = 1\n"
    printed = said(capsys, 2, "sweep", write_files(tmp_path, text, robot=robot), "-o", tmp_path / "out")
    for key in ("sampling.samples", "vary[0].key", "vary[1].uniform.upper", "robot.toml: backbone.length"):
        assert key in printed, key
    assert not (tmp_path / "out").exists()
    text = vary("backbone.raduis", f"{ONE}\n" + 2 * f"[[vary]]\nkey = 'tip_mass'\n{ONE}\n")
    found = "\n".join(problems_of(tmp_path, text + "[output]\nquantities = ['tipx']"))
    for expected in ("did you mean radius", "is varied twice", "did you mean tip_x"):
        assert expected in found


def test_a_value_that_is_wrong_only_alone_is_no_mistake(tmp_path):
    """Holes outside the declared disks are inside the larger ones of the same cases."""
    text = vary("tendons.offset", "values = [4e-3, 9e-3]", LIST)
    text += '[[vary]]\nkey = "disks.radius"\nvalues = [5e-3, 10e-3]\n'
    result = tdcr.sweep(write_files(tmp_path, text), executor=InProcess())
    assert result.counts == {"converged": 2}
    # The first case with 9 mm is invalid, the second is not.
    result = tdcr.sweep(write_files(tmp_path, text.replace(LIST, "")), executor=InProcess())
    assert result.cases["status"].tolist() == ["converged", "converged", "invalid", "converged"]


def test_the_workspace_varies_every_tension_of_the_last_step(tmp_path):
    text = HEAD + '[sampling]\nmethod = "sobol"\nsamples = 16\nseed = 1\n[workspace]\nlargest = 2.0\n'
    described = tdcr.read_sweep(write_files(tmp_path, text))
    assert [v.key for v in described.variations] == ["steps[-1].tensions.t1", "steps[-1].tensions.t2"]
    cases = set(zip(*described.design().values(), strict=True))
    assert len(cases) == 16 and all(0.0 <= x <= 2.0 for case in cases for x in case)


DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "sweeps.md").read_text(encoding="utf-8")


def test_a_workspace_of_a_tendon_that_the_last_step_winds_is_refused_as_such(tmp_path):
    """It was said of the smallest and the largest tension of the sample, with bounds as the remedy."""
    text = HEAD + "[workspace]\nlargest = 2.0\ncount = 3\n"
    wound = SCENARIO.replace("tensions = { t1 = 1.0 }", "displacements = { t1 = 1e-3 }")
    (found,) = problems_of(tmp_path, text, scenario=wound)
    assert "workspace: varies tensions; the last load step gives the displacement of t1" in found


@pytest.mark.parametrize(("name", "cases"), [("uncertainty", 384), ("workspace", 512)])
def test_the_sweeps_of_the_page_are_the_files_of_the_examples(name, cases):
    path = DOCS / "examples" / "sweeps" / f"{name}.toml"
    shown = re.search(rf"^```toml\n# {name}\.toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)[1]
    assert shown == path.read_text(encoding="utf-8")
    assert tdcr.read_sweep(path).count == cases


UNITS = """
sampling = { method = "latin-hypercube", samples = 3 }
vary = [
  { key = "tendons.t1.offset", values = ["3 mm", 4e-3] },
  { key = "steps.tensions.t1", range = { start = "500 mN", stop = "2 N", count = 4 } },
  { key = "backbone.youngs_modulus", normal = { mean = "85 GPa", std = "3 GPa" } },
  { key = "tendons[1].angle_deg", uniform = { lower = "90 deg", upper = "2.0943951023931953 rad" } },
]
"""


def test_values_with_units_are_numbers_in_the_units_of_their_keys(tmp_path):
    offset, tension, modulus, angle = tdcr.read_sweep(write_files(tmp_path, HEAD + UNITS)).variations
    assert offset.options == (3e-3, 4e-3)
    assert tension.options == pytest.approx([0.5, 1.0, 1.5, 2.0], rel=1e-15)
    assert (modulus.distribution.mean, modulus.distribution.std) == (85e9, 3e9)
    assert (angle.distribution.lower, angle.distribution.upper) == pytest.approx((90.0, 120.0), rel=1e-15)
    wrong = UNITS.replace('"3 GPa"', '"3 Gpa"').replace('"2 N"', '"2 m"')
    words = [p.split(" = ")[0] for p in problems_of(tmp_path, HEAD + wrong)]
    assert words == ["sweep.toml: vary[1].range.stop", "sweep.toml: vary[2].normal.std"]


def test_what_is_implausible_is_warned_of_before_any_case_is_solved(tmp_path):
    robot = ROBOT.replace("[backbone]", "[backbone]\nbending_stiffness = 1e3\n")
    with pytest.warns(tdcr.PlausibilityWarning, match="backbone.bending_stiffness = 1000 N m"):
        tdcr.read_sweep(write_files(tmp_path, robot=robot))


# ------------------------------------------------------------ keys


PATHS = Path("scenario.toml"), Path("robot.toml")
TABLES = ScenarioTables(tomllib.loads(SCENARIO), tomllib.loads(ROBOT), *PATHS)


def with_value(key, value, tables=TABLES):
    return set_value(tables, parse_key(key), lambda declared: value)


KEYS = [
    ("backbone.radius", 0.5e-3, lambda s: s.robot.backbone.radius),
    ("backbone.precurvature[1]", 2.0, lambda s: s.robot.backbone.precurvature[1]),
    ("tip_mass", 0.01, lambda s: s.robot.tip_mass),
    ("tendons.t2.friction_coefficient", 0.3, lambda s: s.robot.tendons[1].friction_coefficient),
    ("tendons.friction_coefficient", 0.4, lambda s: s.robot.tendons[0].friction_coefficient),
    ("tendons.friction_coefficient", 0.4, lambda s: s.robot.tendons[1].friction_coefficient),
    ("tendons[1].offset", 4e-3, lambda s: s.robot.tendons[1].routing.offset),
    ('tendons."t1".angle_deg', 10.0, lambda s: s.robot.tendons[0].routing.angle_deg),
    ("model.gravity[2]", -9.81, lambda s: s.model.gravity[2]),
    ("model.friction", "none", lambda s: s.model.friction),
    ("solver.max_iterations", 30, lambda s: s.settings.max_iterations),
    ("steps[0].tensions.t2", 0.7, lambda s: s.steps[0].tensions.get("t2")),
    ("steps[-1].tensions.t1", 0.8, lambda s: s.steps[0].tensions["t1"]),
    ("effects.gravity.g_z", -9.0, lambda s: s.model.gravity[2]),
]


@pytest.mark.parametrize(("key", "value", "get"), KEYS)
def test_a_key_sets_the_value_and_leaves_the_given_tables(key, value, get):
    before = build_scenario(TABLES)
    assert get(build_scenario(with_value(key, value))) == value
    assert build_scenario(TABLES) == before
    assert get(before) != value


def test_a_key_without_a_number_means_the_steps_that_have_it():
    steps = [{"tensions": {"t1": 1.0}}, {"tensions": {"t2": 1.0}}, {"tensions": {"t1": 2.0}}]
    tables = ScenarioTables({**TABLES.scenario, "steps": steps}, TABLES.robot, *PATHS)
    changed = set_value(tables, parse_key("steps.tensions.t1"), lambda declared: 10.0 * declared)
    assert [s.tensions for s in build_scenario(changed).steps] == [{"t1": 10.0}, {"t2": 1.0}, {"t1": 20.0}]
    last = with_value("steps[-1].tensions.t1", 3.0, tables)
    assert [s.tensions for s in build_scenario(last).steps] == [{"t1": 1.0}, {"t2": 1.0}, {"t1": 3.0}]


WRONG_KEYS = [
    ("backbon.radius", "did you mean backbone"),
    ("", "dotted key"),
    ("backbone..radius", "dotted key"),
    ("[0].radius", "dotted key"),
    ("steps[1].tensions.t1", r"there are 1 steps; must be from steps\[0\] to steps\[0\]"),
    ("steps.tensions.t2", r"no load step has tensions.t2; steps\[0\].tensions.t2 sets it"),
    ("tendons.t3.offset", 'there is no tendon "t3"; there are t1, t2'),
    ("backbone.radius.base", "backbone.radius is not a table"),
    ("backbone.radius[0]", "backbone.radius is not a list"),
]


@pytest.mark.parametrize(("key", "text"), WRONG_KEYS)
def test_what_is_no_key_of_the_files_is_refused(key, text):
    with pytest.raises(KeyProblem, match=text):
        with_value(key, 1.0)
