"""Input files: valid values are read unchanged; every mistake is named with file, key, value and what is allowed."""

import dataclasses
import os
import re
import tomllib
from pathlib import Path
from typing import Annotated

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from inputs import REMOVED, ROBOT, SCENARIO, changed, write

import tdcr_fe as tdcr
from tdcr_fe import ConstantFriction, Disks, Load, LoadStep, Model, Robot, SolverSettings, Spool, Tendon
from tdcr_fe.cli import main
from tdcr_fe.elements.friction import FRICTION_MODELS
from tdcr_fe.elements.hysteresis import HYSTERESES
from tdcr_fe.io import toml
from tdcr_fe.io.files import InputError, Problem
from tdcr_fe.io.toml import read_model, read_model_file, read_robot, read_scenario
from tdcr_fe.io.write_toml import model_to_toml, robot_to_toml, scenario_to_toml
from tdcr_fe.model.backbone import Backbone, StiffnessPatch, Superelastic
from tdcr_fe.model.routing import ROUTINGS
from tdcr_fe.model.schema import Keys, Quantity, keys_of
from tdcr_fe.validation.fuzz.drawing import draw


def problems_of(path: Path) -> list[Problem]:
    with pytest.raises(InputError) as caught:
        read_scenario(path)
    assert caught.value.problems
    for p in caught.value.problems:
        assert str(p) in str(caught.value)
    return list(caught.value.problems)


# --------------------------------------------------------------------------------------------- what is right


def test_robot_is_read_as_written(tmp_path):
    robot = read_scenario(write(tmp_path)).robot
    assert (robot.name, robot.backbone) == ("single-segment", Backbone(0.25, 0.4e-3, 85e9, 0.3, 5600.0))
    assert robot.disks == Disks.equally_spaced(5, 0.25, mass=0.17e-3, radius=5e-3)
    holes = ((1e-3, 0.0), (1e-3, 1e-3), (0.0, 1e-3), (0.0, 0.0), (2e-3, 0.0), (3e-3, 1e-3))
    assert robot.tendons == (
        Tendon("t1", tdcr.ParallelRouting(4.5e-3, 0.0), 0.3),
        Tendon("t2", tdcr.ConvergingRouting(4.5e-3, 0.15e-3, 120.0), 0.0, 0.15, 400.0),
        Tendon("t3", tdcr.PointsRouting((0.0, *robot.disks.positions), holes)),
        Tendon("t4", tdcr.HelicalRouting(4.5e-3, -2.0, 0.0)),
    )


def test_scenario_is_read_as_written_and_needs_no_model_table(tmp_path):
    scenario = read_scenario(write(tmp_path))
    assert scenario.model == Model("straight", "per-hole", 2, (0.0, 0.0, -9.81))
    assert scenario.steps == (
        LoadStep("pull", {"t1": 1.5, "t3": 1.0}, {"t2": 5e-3}, {"tip": Load(0.25, (0.0, 0.05, 0.0))}, 5),
        LoadStep(loads={"tip": Load(0.25), "middle": Load(0.1, (0.1, 0.0, 0.0), frame="section")}),
    )
    assert isinstance(scenario.steps[0].tensions["t3"], float)
    path = write(tmp_path, scenario=changed(SCENARIO, {"model": REMOVED}))
    assert read_scenario(path).model == Model("straight", "per-hole", "auto", (0.0, 0.0, 0.0))


def test_model_file_holds_the_model_table_alone(tmp_path):
    path = tmp_path / "model.toml"
    path.write_text('[model]\nfriction = "none"\ntendon_path = "continuous"\n')
    assert read_model(path) == Model("continuous", "none")
    path.write_text('robot = "x"\n[model]\nfriction = "nine"\n')
    with pytest.raises(InputError) as caught:
        read_model(path)
    assert [p.key for p in caught.value.problems] == ["model.friction", "robot"]


def test_hole_on_the_rim_is_not_outside_and_points_of_a_course_are_equally_spaced(tmp_path):
    changes = {"tendons.0.offset": 5e-3, "tendons.0.angle_deg": 33.0}
    assert read_scenario(write(tmp_path, changed(ROBOT, changes))).robot.tendons[0].routing.offset == 5e-3
    write(tmp_path, changed(SOFT, {"tendons": [HOLES]}))
    assert read_robot(tmp_path / "robot.toml").tendons[0].routing.fixed_arc_lengths == (0.0, 0.1, 0.2)


# --------------------------------------------------------------------------------------------- what is wrong

NAN = float("nan")
WITHOUT_COUNT = {"disks.count": REMOVED}
ROBOT_MISTAKES = [
    # change, key, value, words of what is allowed
    ({"backbone.lenght": 1.0}, "backbone.lenght", "1.0", ["unknown key", "did you mean length?", "radius"]),
    ({"backbone.length": -0.25}, "backbone.length", "-0.25", ["positive"]),
    ({"backbone.length": "250 N"}, "backbone.length", '"250 N"', ["at most 1000, or a number with its unit"]),
    ({"backbone.radius": REMOVED}, "backbone.radius", "", ["missing", "a positive number [m]"]),
    ({"backbone.radius": [1.0]}, "backbone.radius", "[1.0]", ["a positive number [m]"]),
    ({"backbone.radius": [[0.0, 1e-3], [0.2, 5e-4]]}, "backbone.radius", "", ["ascend from 0 to the length"]),
    ({"backbone.radius": [[0.0, 1e-3], [0.25, -5e-4]]}, "backbone.radius", "", ["a radius"]),
    ({"backbone.radius": [[0.0, 2**63], [0.25, 5e-4]]}, "backbone.radius", "", ["a radius"]),
    ({"backbone.radius": [[0.0, 1e-3]]}, "backbone.radius", "", ["ascend from 0"]),
    ({"backbone.nonlinear": {"quadratic": 80.0}}, "backbone.nonlinear", "", ["falls from 0.00625 on"]),
    ({"backbone.nonlinear": {"cubic": -1e5}}, "backbone.nonlinear.cubic", "", []),
    ({"backbone.nonlinear": {"cubic": 1.0}, "backbone.creep_rate": 1e-3}, "backbone.nonlinear", "", ["creep_rate"]),
    ({"backbone.radius": 1e-90}, "backbone.radius", "1e-90", ["a positive number [m]"]),
    ({"backbone.poisson_ratio": 0.51}, "backbone.poisson_ratio", "0.51", ["at most 0.5"]),
    ({"backbone": REMOVED}, "backbone", "", ["missing", "[backbone]"]),
    ({"disks.count": REMOVED}, "disks", "", ["must have exactly one of count and positions"]),
    ({"disks.positions": [0.25]}, "disks", "{ count = 5, positions = [0.25] }", ["exactly one of"]),
    ({"disks.thickness": 0.05}, "disks.thickness", "0.05", ["flexible", "0.05 m"]),
    ({"tendons": {"name": "t1"}}, "tendons", '{ name = "t1" }', ["[[tendons]]"]),
    ({"tendons.0": 7}, "tendons[0]", "7", ["must be a table", "routing"]),
    ({"tendons.1.name": "t1"}, "tendons[1].name", '"t1"', ["2 times"]),
    ({"tendons.0.routing": "paralel"}, "tendons[0].routing", '"paralel"', ["helical", "did you mean parallel?"]),
    ({"tendons.0.offset": REMOVED}, "tendons[0].offset", "", ["missing", "a number [m], zero or more"]),
    ({"tendons.0.offset": 6e-3}, "tendons[0].offset", "0.006", ["base plate", "outside the disk", "0.005 m"]),
    ({"tendons.0.angle_deg": "50 %"}, "tendons[0].angle_deg", '"50 %"', ["rad, mrad, deg, turns); unknown unit %"]),
    ({"tendons.0.turns": 1.0}, "tendons[0].turns", "1.0", ["unknown key; allowed here: name, routing, offset"]),
    ({"tendons.1.end_offset": 9e-3}, "tendons[1].end_offset", "0.009", ["disk 1", "0.005 m"]),
    ({"tendons.1.end": 0.16}, "tendons[1].end", "0.16", ["no disk is there", "0.15 and 0.2 m"]),
    ({"tendons.2.holes": [[0.0, 0.0]] * 5}, "tendons[2].holes", "5 holes", ["6 are needed"]),
    ({"tendons.2.holes.3": [9e-3, 0.0]}, "tendons[2].holes[3]", "0.009 m", ["disk 3", "0.005 m"]),
    ({"tendons.2.holes.3.0": NAN}, "tendons[2].holes[3][0]", "nan", ["pairs [x, y]"]),
    ({"tendons.2.end": 0.15}, "tendons[2].holes", "6 holes", ["4 are needed"]),
    ({"tendons.3.friction": {"kind": "stribek"}}, "tendons[3].friction.kind", '"stribek"', ["mean stribeck?"]),
    ({"tendons.3.friction": {"kind": "constant"}}, "tendons[3].friction.mu", "", ["missing"]),
    ({**WITHOUT_COUNT, "disks.positions": [0.05, 0.04, 0.25]}, "disks.positions", "[0.05, 0.04, 0.25]", ["ascend"]),
    ({**WITHOUT_COUNT, "disks.positions": [0.15, 0.26]}, "disks.positions[1]", "0.26", ["beyond the tip"]),
    ({**WITHOUT_COUNT, "disks.positions": []}, "disks.positions", "[]", ["arc lengths"]),
    ({**WITHOUT_COUNT, "disks.positions": [0.15, "x"]}, "disks.positions[1]", '"x"', ["arc lengths"]),
    (
        {**WITHOUT_COUNT, "disks.positions": [0.15, 0.2], "tendons.0.end": 0.2, "tendons.3.end": 0.2,
         "tendons.2": {"name": "t3", "routing": "parallel", "offset": 0}},
        "tendons[2].end", "not given, so the tip at backbone.length = 0.25", ["no disk is there", "0.15 and 0.2 m"]),
]  # fmt: skip


SCENARIO_MISTAKES = [
    ({"modle": {}}, "modle", "{}", ["unknown key", "did you mean model?", "robot, model, solver, effects, steps"]),
    ({"robot": REMOVED}, "robot", "", ["missing", "robot.toml"]),
    ({"robot": "robo.toml"}, "robot", '"robo.toml"', ["there is no file", "did you mean robot.toml?"]),
    ({"robot": "a\0b"}, "robot", '"a\\u0000b"', ["no file"]),
    ({"robot": "a\nb"}, "robot", '"a\\nb"', ["there is no file", "a\\nb"]),
    ({"model.friction": "per_hole"}, "model.friction", '"per_hole"', ["did you mean per-hole?"]),
    ({"model.tendon_path": "continuous"}, "model.friction", '"per-hole"', ['set friction = "none"']),
    ({"model.tendon_path": "continuous", "model.friction": REMOVED}, "model.friction", "", ['set friction = "none"']),
    ({"model.elements_per_bay": "automatic"}, "model.elements_per_bay", '"automatic"', ['"auto"']),
    ({"model.gravity": [0, 0, NAN]}, "model.gravity[2]", "nan", ["three finite numbers"]),
    ({"steps": []}, "steps", "[]", ["at least one"]),
    ({"steps.0.tension": {"t1": 1}}, "steps[0].tension", "{ t1 = 1 }", ["did you mean tensions?", "substeps"]),
    ({"steps.0.tensions": 1.5}, "steps[0].tensions", "1.5", ["by name, each a number [N], zero or more"]),
    ({"steps.0.tensions.t1": "1.5 Nm"}, "steps[0].tensions.t1", '"1.5 Nm"', ["mN, kN, gf, kgf); Nm cannot be"]),
    ({"effects": {"gravity": {"g_z": "9.81 m/s"}}}, "effects.gravity.g_z", '"9.81 m/s"', ["[m/s^2] from -12 to 12"]),
    ({"steps.0.tensions.t11": 1.5}, "steps[0].tensions.t11", "1.5", ["unknown", "mean t1?", "t2, t3"]),
    ({"steps.0.displacements.x y": 0.1}, 'steps[0].displacements."x y"', "0.1", ["unknown tendon", "t1, t2"]),
    ({"steps.0.displacements.t1": 0.1}, "steps[0].displacements.t1", "0.1", ["exactly one"]),
    ({"steps.0.loads.tip.at": 0.26}, "steps[0].loads.tip.at", "0.26", ["beyond the tip", "0 to 0.25 m"]),
    ({"steps.0.loads.tip.at": REMOVED}, "steps[0].loads.tip.at", "", ["missing", "arc length"]),
    ({"steps.0.loads.tip.frame": "body"}, "steps[0].loads.tip.frame", '"body"', ['"world" or "section"']),
    ({"steps.0.time": 2.0, "steps.1.time": 1.0}, "steps[1].time", "1.0", ["not be earlier", "2 s"]),
]  # fmt: skip


MISTAKES = [("robot", *row) for row in ROBOT_MISTAKES] + [("scenario", *row) for row in SCENARIO_MISTAKES]


@pytest.mark.parametrize(("file", "change", "key", "value", "words"), MISTAKES)
def test_a_mistake_is_named_alone(tmp_path, file, change, key, value, words):
    text = {"robot": ROBOT, "scenario": SCENARIO}[file]
    (problem,) = problems_of(write(tmp_path, **{file: changed(text, change)}))
    assert problem.file == str(tmp_path / f"{file}.toml")
    assert (problem.key, value in problem.value) == (key, True)
    assert [w for w in words if w not in problem.allowed] == []


UNREADABLE = [
    ("x = = 1", "line 1, column 5", "not TOML"),
    ("[a\n", "line 1, column 3", "not TOML"),
    ("a = 1\na = 2\n", "line 2, column 6", "the key is there already"),
    ("[tendons]\n[tendons]\n", "line 2, column 9", "are written [[tendons]]"),
    ("a = 0,2\n", "line 1, column 6", "write a decimal point"),
    (b'name = "x"\nb = "\xff"\n', "line 2", "not UTF-8"),
    ("a = " + "1" * 5000, "", "not TOML that can be read"),
    ("a = " + "[" * 20000, "", "not TOML"),
]


@pytest.mark.parametrize(("text", "key", "words"), UNREADABLE)
def test_file_that_is_not_toml_is_named_with_its_line(tmp_path, text, key, words):
    for file in ("robot", "scenario"):
        (problem,) = problems_of(write(tmp_path, **{file: text}))
        assert (problem.file, problem.key) == (str(tmp_path / f"{file}.toml"), key)
        assert words in problem.allowed


NO_FILE = {
    "missing": ("scenari.toml", "", "no such file; did you mean scenario.toml?"),
    "link to nowhere": ("link.toml", "moved.toml", "is a link to moved.toml, which is not there"),
    "link to itself": ("link.toml", "link.toml", "is a link to link.toml, which is not there"),
    "directory": ("", "", "is a directory, not a file"),
    "too long": ("x" * 5000, "", "cannot be read"),
}


@pytest.mark.parametrize(("name", "link", "reason"), NO_FILE.values(), ids=NO_FILE)
def test_what_is_no_file_is_named_with_the_reason(tmp_path, name, link, reason):
    """Of a link, its own name was proposed in its place."""
    write(tmp_path)
    path = tmp_path / name
    if link and os.name == "nt":
        pytest.skip("symbolic links need rights on Windows")
    if link:
        path.symlink_to(link)
    (problem,) = problems_of(path)
    assert problem.file == str(path) and reason in problem.allowed


def test_every_mistake_of_both_files_is_reported_at_once(tmp_path):
    robot = {"backbone.density": -1, "disks.mas": 1, "tendons.0.offset": 6e-3, "tendons.1.end": 0.16,
             "tendons.1.turns": 3, "tendons.3.routing": "helix"}  # fmt: skip
    scenario = {"model.friction": 1, "model.gravity": [0], "steps.0.tensions.t9": -1, "steps.0.loads.tip.at": 9,
                "steps.1.label": 1}  # fmt: skip
    found = problems_of(write(tmp_path, changed(ROBOT, robot), changed(SCENARIO, scenario)))
    named = {(Path(p.file).stem, re.sub(r"\[(\d)\]", r".\1", p.key)) for p in found}
    assert named == {*(("robot", key) for key in robot), *(("scenario", key) for key in scenario)}


value = st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.sampled_from([[], {}, [[1.0]]])


@settings(max_examples=50, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_no_value_of_any_key_raises_an_unexpected_error(tmp_path_factory, data):
    """Any value of any key is accepted or refused; no other error occurs."""
    folder = tmp_path_factory.mktemp("any")
    texts = []
    for text in (ROBOT, SCENARIO):
        places = list(paths(tomllib.loads(text)))
        chosen = data.draw(st.lists(st.sampled_from(places), max_size=2, unique=True))
        chosen = [c for c in chosen if not any(o != c and c.startswith(o) for o in chosen)]
        texts.append(changed(text, {place: data.draw(value) for place in chosen}))
    path = write(folder, *texts)
    try:
        read_scenario(path)
    except InputError as error:
        assert all(p.file and p.allowed for p in error.problems)


def paths(data, prefix=""):
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        yield f"{prefix}{key}"
        if isinstance(value, dict | list):
            yield from paths(value, f"{prefix}{key}.")


# ---------------------------------------------------------------------------------------------- written back


def middle(key):
    """A number in the middle of what the JSON schema of a key allows."""
    low = key.get("minimum", key.get("exclusiveMinimum", 0.0))
    number = 0.5 * (low + key.get("maximum", low + 1.0))
    return round(number) if key["type"] == "integer" else number


def described():
    """Robots, models, settings and load steps: random ones with all options, and one with what these leave out."""
    keys = keys_of(SolverSettings).json_schema["properties"]
    settings = SolverSettings(**{n: middle(x) for n, x in keys.items()})
    # Zeros of keys that must be given are written, too.
    declared = {"axial_stiffness": 5e3, "shear_stiffness": 2e3, "retardation_time": 1e-3}
    backbone = Backbone(0.25, 0.4e-3, 85e9, 0.0, **declared)
    wound = Tendon("t", tdcr.ParallelRouting(0.0), spool=Spool(8e-3))
    robot = Robot(backbone, Disks.equally_spaced(5, 0.25), (wound,))
    found = [(robot, Model(hysteresis="dahl"), settings, (LoadStep(motor_angles={"t": 0.1}),))]
    for case in map(draw, range(120)):
        if not any(t.routing.kind == "twisted" for t in case.robot.tendons):  # robot.toml has no such routing
            found.append((case.robot, case.model, SolverSettings(), case.steps))
    return found


def test_what_is_written_and_read_is_the_same_for_every_field(tmp_path):
    """In 0.1 the creep rate was dropped; precurvature, patches, clearance, adhesion, tip mass were refused.

    Each field has a value other than its default somewhere.
    """
    parts = []
    for robot, model, solver, steps in described():
        scenario = scenario_to_toml(model, steps, settings=solver)
        read = read_scenario(write(tmp_path, robot_to_toml(robot), scenario))
        assert (read.robot, read.model, read.settings, read.steps) == (robot, model, solver, tuple(steps))
        (tmp_path / "model.toml").write_text(model_to_toml(model, solver))
        assert read_model_file(tmp_path / "model.toml", robot) == (model, solver)
        parts += [robot, robot.backbone, robot.disks, *robot.tendons, model, solver, *steps]
        parts += [load for step in steps for load in step.loads.values()]
    for cls in (Robot, Backbone, Disks, Tendon, Model, SolverSettings, LoadStep, Load):
        own = [p for p in parts if isinstance(p, cls)]
        for field in dataclasses.fields(cls):
            assert any(getattr(p, field.name) != field.default for p in own), (cls, field.name)


def test_every_field_of_a_robot_is_in_the_file_or_follows_from_it():
    """A field that is added without a key in `robot.toml`, or without a sentence in the docstring, fails here."""
    follows = {
        Robot: {"tendons"},  # [[tendons]]
        Backbone: {"taper"},  # the key radius
        Tendon: {"routing"},  # the key routing, with the keys of that routing
        tdcr.PointsRouting: {"arc_lengths"},  # those of the holes
    }
    for cls in (Robot, Backbone, Superelastic, StiffnessPatch, Disks, Tendon, *ROUTINGS.values()):
        assert {f.name for f in dataclasses.fields(cls)} - set(keys_of(cls)) == follows.get(cls, set())
        described = {n: x.get("description") for n, x in keys_of(cls).json_schema["properties"].items()}
        assert [n for n, text in described.items() if text is None or text.partition(" [")[0] == n] == []


def test_a_new_key_at_the_top_of_robot_toml_is_read_and_written(tmp_path, monkeypatch):
    longer = dataclasses.make_dataclass("Longer", [("cable", float, 0.0)], bases=(Robot,), frozen=True)
    cable = {"cable": Annotated[float, Quantity()]}
    monkeypatch.setattr(toml, "Robot", longer)
    monkeypatch.setattr(toml, "ROBOT", Keys(toml.ROBOT | cable, {**toml.ROBOT.defaults, "cable": 0.0}))
    (tmp_path / "robot.toml").write_text(changed(ROBOT, {"cable": 2.0}))
    read = read_robot(tmp_path / "robot.toml")
    assert read.cable == 2.0
    assert "cable = 2.0" in robot_to_toml(read)


@pytest.mark.parametrize(("key", "table"), [("friction", FRICTION_MODELS), ("hysteresis", HYSTERESES)])
def test_the_names_that_a_model_takes_are_those_of_the_table(key, table):
    assert keys_of(Model).json_schema["properties"][key]["enum"] == list(table)
    assert all(f'"{name}"' in Model.__doc__ for name in table)


def test_what_the_format_cannot_express_is_refused_and_named():
    @dataclasses.dataclass(frozen=True)
    class OwnLaw(ConstantFriction):
        kind: str = "own"

    course = tdcr.ParallelRouting(1e-3)
    tendons = (Tendon("t1", tdcr.TwistedRouting(course, 0.1)), Tendon("t2", course, friction=OwnLaw(0.1)))
    robot = Robot(Backbone(0.25, 0.4e-3, 85e9, 0.3), Disks.equally_spaced(5, 0.25), tendons)
    with pytest.raises(ValueError, match=r"robot\.toml cannot express") as caught:
        robot_to_toml(robot)
    for word in ("tendons[0].routing (twisted)", "tendons[1].friction (own)"):
        assert word in str(caught.value)


# ------------------------------------------------------------------------------------------------- the docs

PAGE = (Path(__file__).parents[2] / "docs" / "files.md").read_text("utf-8")
EXAMPLES = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)[:2]


def test_example_in_the_docs_is_read_without_mistake(tmp_path):
    read = read_scenario(write(tmp_path, *EXAMPLES))
    assert [len(read.robot.holes(t)) for t in read.robot.tendons] == [11, 6, 11, 3]
    assert [s.label for s in read.steps] == ["pull", "push the tip", "twist and let go"]


def test_example_of_mistakes_in_the_docs_is_what_is_printed(tmp_path, monkeypatch):
    (printed,) = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
    robot, scenario = EXAMPLES
    robot = robot.replace("end = 0.125", "end = 0.13").replace("[backbone]", "[backbone]\nlenght = 0.25")
    scenario = scenario.replace("per-hole", "per_hole").replace("free = 0.2", "t2 = 1.5")
    write(tmp_path, robot, scenario)
    monkeypatch.chdir(tmp_path)
    lines = [str(p) for p in problems_of(Path("scenario.toml"))]
    for shown, line in zip(printed.splitlines()[1:], lines, strict=True):
        assert line.startswith(shown.strip().removesuffix(", ..."))


# ------------------------------------------------------------ without disks


SOFT = """
tendons = [{ name = "a", routing = "converging", offset = 9e-3, end_offset = 3e-3, end = 0.25 }]
[backbone]
length = 0.3
radius = [[0.0, 12e-3], [0.3, 5e-3]]
youngs_modulus = 0.4e6
poisson_ratio = 0.45
density = 1100.0
"""
HOLES = {"name": "a", "routing": "points", "end": 0.2, "holes": [[8e-3, 0.0], [7e-3, 1e-3], [5e-3, 2e-3]]}
PULL = 'robot = "robot.toml"\n[[steps]]\ntensions = { a = 1.0 }\n'


def test_its_tendons_follow_the_backbone_by_default(tmp_path):
    assert read_scenario(write(tmp_path, SOFT, PULL)).model == Model("continuous", "none")
    path = tmp_path / "model.toml"
    path.write_text("[model]\ngravity = [0.0, 0.0, 9.81]\n")
    robot = read_robot(tmp_path / "robot.toml")
    assert read_model(path, robot) == Model("continuous", "none", gravity=(0.0, 0.0, 9.81))


@pytest.mark.parametrize(("key", "value"), [("tendon_path", "straight"), ("friction", "per-hole")])
def test_a_model_with_holes_is_refused_by_name(tmp_path, key, value):
    (problem,) = problems_of(write(tmp_path, SOFT, f'{PULL}[model]\n{key} = "{value}"'))
    assert problem.key == f"model.{key}"


def test_the_command_runs_it(tmp_path, capsys):
    """Version 0.1 refused a robot without disks."""
    assert main(["run", str(write(tmp_path, SOFT, PULL)), "-o", str(tmp_path / "out")]) == 0
    lines = (tmp_path / "out" / "tensions.csv").read_text().splitlines()
    assert lines == ["step,tendon,segment,tension,hole_state", "1,a,1,1.0,anchor"]
    assert (tmp_path / "out" / "view.html").exists()
