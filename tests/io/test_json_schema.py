"""JSON schema for editors: it accepts what the reader accepts, and refuses single wrong values."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from inputs import REMOVED, ROBOT, SCENARIO, changed

import tdcr_fe
from tdcr_fe.io.keys import json_schema
from tdcr_fe.io.templates import template
from tdcr_fe.io.write_toml import model_to_toml
from tdcr_fe.model.loading import Model, SolverSettings
from tdcr_fe.sweeps.read import sweep_schema
from tdcr_fe.validation.paper import cases

jsonschema = pytest.importorskip("jsonschema")

FOLDERS = [Path(tdcr_fe.__file__).parent / "data" / "demo", *(Path(cases.__file__).parent / "data").iterdir()]


def errors(schema, value):
    """Keys of a value that a schema refuses."""
    found = jsonschema.Draft202012Validator(schema).iter_errors(value)
    return [".".join(map(str, error.absolute_path)) for error in found]


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda f: f.name)
def test_files_of_the_demo_and_the_paper_fit_the_schema(folder):
    for name in ("robot", "scenario"):
        path = folder / f"{name}.toml"
        if path.exists():
            assert errors(json_schema(name), tomllib.loads(path.read_text("utf-8"))) == []


def test_files_of_the_reader_tests_fit_the_schema():
    assert errors(json_schema("robot"), tomllib.loads(ROBOT)) == []
    assert errors(json_schema("scenario"), tomllib.loads(SCENARIO)) == []
    model = model_to_toml(Model(elements_per_bay=3), SolverSettings())
    assert errors(json_schema("model"), tomllib.loads(model)) == []


@pytest.mark.parametrize(
    ("file", "change"),
    [
        ("robot", {"backbone.length": -1}),
        ("robot", {"backbone.length": "long"}),
        ("robot", {"backbone.radius": REMOVED}),
        ("robot", {"disks.count": REMOVED}),
        ("robot", {"disks.positions": [0.25]}),
        ("robot", {"tendons.0.turns": 1.0}),
        ("robot", {"tendons.0.friction": {"kind": "strybeck"}}),
        ("scenario", {"robot": REMOVED}),
        ("scenario", {"model.elements_per_bay": 0}),
        ("scenario", {"effects": {"gravty": {}}}),
        ("scenario", {"effects": {"gravity": {"g_z": -100.0}}}),
        ("scenario", {"effects": {"gravity": {"g_z": 100.0}}}),
        ("scenario", {"steps": []}),
        ("scenario", {"steps.0.tensions.t1": -1.0}),
    ],
)
def test_wrong_value_does_not_fit_the_schema(file, change):
    text = {"robot": ROBOT, "scenario": SCENARIO}[file]
    assert errors(json_schema(file), tomllib.loads(changed(text, change)))


@pytest.mark.parametrize(
    ("file", "change"),
    [
        ("robot", {"tip_mass": 0.01, "backbone.patches": [{"start": 0.0, "end": 0.1, "bending": 2}]}),
        ("robot", {"backbone.superelastic": {"threshold_strain": 0.01, "plateau_ratio": 0.3}}),
        ("robot", {"tendons.0.friction": {"kind": "constant", "mu": 0.2}, "tendons.0.adhesion": 0.1}),
        ("scenario", {"model.elements_per_bay": "auto", "solver": {"max_substeps": 128}}),
        ("scenario", {"effects": {"gravity": {"g_z": -9.81}}}),
        ("scenario", {"effects": {"gravity": {"g_z": "-9.81 m/s^2"}}, "steps.0.tensions.t1": "1500 mN"}),
        ("robot", {"backbone.length": "250 mm", "backbone.precurvature": ["1/m", "2.5e-3 1/mm"]}),
        ("robot", {"backbone.radius": [[0, "0.4 mm"], ["25 cm", 0.3e-3]]}),
    ],
)
def test_optional_keys_fit_the_schema(file, change):
    text = {"robot": ROBOT, "scenario": SCENARIO}[file]
    assert errors(json_schema(file), tomllib.loads(changed(text, change))) == []


SWEEP = """
scenario = "scenario.toml"
[sampling]
method = "latin-hypercube"
samples = 4
[[vary]]
key = "backbone.youngs_modulus"
mode = "factor"
normal = { mean = 1.0, std = 0.03 }
[[vary]]
key = "steps.tensions.t1"
values = [0.5, 1]
[output]
steps = [1, 2]
quantities = ["tip_x"]
[workspace]
largest = { t1 = 2.0 }
"""


def test_sweeps_fit_their_schema():
    schema = sweep_schema()
    assert errors(schema, tomllib.loads(SWEEP)) == []
    assert errors(schema, tomllib.loads(template("sweep.toml", ["t1"]))) == []


@pytest.mark.parametrize(
    "change",
    [
        {"scenario": REMOVED},
        {"vary.0.key": REMOVED},
        {"vary.0.normal": REMOVED},
        {"output.steps": [0]},
        {"workspace.largest.t1": -2.0},
    ],
)
def test_a_wrong_value_of_a_sweep_does_not_fit_the_schema(change):
    assert errors(sweep_schema(), tomllib.loads(changed(SWEEP, change)))


def test_no_schema_of_another_file():
    with pytest.raises(ValueError, match="robot, scenario, model"):
        json_schema("loading")
