"""JSON schema for editors: it accepts what the reader accepts, and refuses single wrong values."""

import tomllib
from pathlib import Path

import pytest
import sweep_files
from inputs import REMOVED, ROBOT, SCENARIO, changed

import tdcr_fe
from tdcr_fe import Model, SolverSettings, json_schema, model_to_toml
from tdcr_fe.io.write_toml import template
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


def test_what_the_program_writes_fits_the_schema():
    model = model_to_toml(Model(elements_per_bay=3), SolverSettings())
    assert errors(json_schema("model"), tomllib.loads(model)) == []
    assert errors(sweep_schema(), tomllib.loads(template("sweep.toml", ["t1"]))) == []
    pull = {"key": "steps[0].tensions.t1", "normal": {"mean": "1.5 N", "std": "50 mN"}}
    assert errors(sweep_schema(), {"scenario": "scenario.toml", "vary": [pull]}) == []


SWEEP = f"""
{sweep_files.SWEEP}
sampling = {{ method = "latin-hypercube", samples = 4 }}
output = {{ steps = [1, 2], quantities = ["tip_x"] }}
workspace = {{ largest = {{ t1 = 2.0 }} }}
"""


WRONG = [
    ("robot", {"backbone.length": -1}),
    ("robot", {"backbone.length": "long"}),
    ("robot", {"backbone.radius": REMOVED}),
    ("robot", {"disks.positions": [0.25]}),
    ("robot", {"tendons.0.turns": 1.0}),
    ("robot", {"tendons.0.friction": {"kind": "strybeck"}}),
    ("scenario", {"model.elements_per_bay": 0}),
    ("scenario", {"effects": {"gravty": {}}}),
    ("scenario", {"effects": {"gravity": {"g_z": -100.0}}}),
    ("scenario", {"effects": {"gravity": {"g_z": 100.0}}}),
    ("scenario", {"steps": []}),
    ("sweep", {"scenario": REMOVED}),
    ("sweep", {"vary.0.values": REMOVED}),
    ("sweep", {"output.steps": [0]}),
    ("sweep", {"workspace.largest.t1": -2.0}),
]
RIGHT = [
    ("robot", {"tip_mass": 0.01, "backbone.patches": [{"start": 0.0, "end": 0.1, "bending": 2}]}),
    ("robot", {"backbone.superelastic": {"threshold_strain": 0.01, "plateau_ratio": 0.3}}),
    ("robot", {"tendons.0.friction": {"kind": "constant", "mu": 0.2}, "tendons.0.adhesion": 0.1}),
    ("robot", {"backbone.length": "250 mm", "backbone.precurvature": ["1/m", "2.5e-3 1/mm"]}),
    ("robot", {"backbone.radius": [[0, "0.4 mm"], ["25 cm", 0.3e-3]]}),
    ("scenario", {"model.elements_per_bay": "auto", "solver": {"max_substeps": 128}}),
    ("scenario", {"effects": {"gravity": {"g_z": "-9.81 m/s^2"}}, "steps.0.tensions.t1": "1500 mN"}),
    ("sweep", {}),
]


@pytest.mark.parametrize("file, change, fits", [(*w, False) for w in WRONG] + [(*r, True) for r in RIGHT])
def test_what_the_reader_takes_fits_the_schema_and_nothing_else(file, change, fits):
    text = {"robot": ROBOT, "scenario": SCENARIO, "sweep": SWEEP}[file]
    schema = sweep_schema() if file == "sweep" else json_schema(file)
    assert (errors(schema, tomllib.loads(changed(text, change))) == []) == fits
