"""``tdcr-fe new``: the files it writes are read, solved, and name every key of the schema with its default."""

import json
import re

import numpy as np
import pytest

import tdcr_fe as tdcr
from tdcr_fe import Backbone, LoadStep, Model, SolverSettings, cli
from tdcr_fe.io.keys import DISKS, ROBOT, tendon_keys
from tdcr_fe.io.write_toml import EXAMPLES
from tdcr_fe.model.channels import CHANNELS
from tdcr_fe.model.routing import ROUTINGS
from tdcr_fe.model.schema import keys_of


def begin(tmp_path, kind, *options):
    folder = tmp_path / kind
    assert cli.main(["new", kind, "-o", str(folder), "-q", *options]) == 0
    return folder


@pytest.mark.parametrize("tendons", [1, 3, 5])
def test_a_new_robot_is_solved(tmp_path, tendons, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new", "robot", "-q", "--tendons", str(tendons)]) == 0
    assert len(tdcr.read_robot("tdcr-fe-robot/robot.toml").tendons) == tendons
    assert cli.main(["run", "tdcr-fe-robot/scenario.toml", "-o", "out", "-q", "--no-pictures"]) == 0


def test_every_key_of_the_files_is_there(tmp_path):
    folder = begin(tmp_path, "robot")
    robot = (folder / "robot.toml").read_text()
    own = [f for routing in ROUTINGS.values() for f in keys_of(routing)]
    for name in (*ROBOT, *keys_of(Backbone), *DISKS, *tendon_keys("parallel"), *own):
        assert re.search(rf"\b{name}\b", robot), name
    scenario = (folder / "scenario.toml").read_text()
    for name in (*keys_of(Model), *keys_of(SolverSettings), *keys_of(LoadStep)):
        assert re.search(rf"\b{name}\b", scenario), name


def test_a_default_that_is_commented_out_is_what_applies_without_it(tmp_path):
    """Examples of keys without a default, and keys of tables that are commented out, only have to be readable."""
    folder = begin(tmp_path, "robot")
    before = tdcr.read_scenario(folder / "scenario.toml")
    tried = 0
    for file in ("robot.toml", "scenario.toml"):
        text = (folder / file).read_text()
        for k, line in enumerate(text.splitlines()):
            found, lines = re.match(r"# (\w+) = (?!\.\.\.)", line), text.splitlines()  # a key with a value
            name = found[1] if found else ""
            if name in ("", "stiffness", "displacements", "motor_angles") or lines[k - 1].startswith("# ["):
                continue
            lines[k] = lines[k].removeprefix("# ")
            other = {"positions": "count", "friction": "friction_coefficient"}.get(name)
            if other:  # exactly one of the two is allowed
                lines.remove(next(line for line in lines if line.startswith(f"{other} =")))
            (folder / file).write_text("\n".join(lines) + "\n")
            after = tdcr.read_scenario(folder / "scenario.toml")
            parts = ("robot", "model", "steps", "settings")
            same = all(getattr(after, part) == getattr(before, part) for part in parts)
            assert same == (name not in EXAMPLES), name
            (folder / file).write_text(text)
            tried += 1
    assert tried > 20


def test_a_new_experiment_is_read_without_a_faulty_row(tmp_path):
    folder = begin(tmp_path, "experiment", "--tendons", "2")
    data = tdcr.read_measured(folder)
    assert not data.left_out and len(data.steps) == 8 and len(data.readings) == 8 * (6 + 2)
    assert data.branches[:4] == ("t1 pull", "t1 pull", "t1 release", "t1 release")
    result = tdcr.simulate(data.robot, data.model, data.steps, data.settings)
    # Without errors, `identify` answered "the data have a fault: sigma is too large" to its own template.
    tips = [r for r in data.readings if r.quantity.startswith("position") and r.location == 0.2]
    scaled = [(r.value - result.tips[r.step - 1, "xyz".index(r.quantity[-1])]) / r.sigma for r in tips]
    assert len(scaled) == 24 and 0.3 < np.mean(np.square(scaled)) < 2.0
    assert all(f"`{c.quantity}` [{c.unit}]" in (folder / "NOTES.md").read_text() for c in CHANNELS)


def test_a_new_sweep_is_read_and_nothing_overwritten(tmp_path, capsys):
    assert tdcr.read_sweep(begin(tmp_path, "sweep") / "sweep.toml").count == 100
    folder = begin(tmp_path, "robot")
    (folder / "robot.toml").write_text("mine")
    assert cli.main(["new", "sweep", "-o", str(folder)]) == 2
    assert "robot.toml: is there already" in capsys.readouterr().err
    assert (folder / "robot.toml").read_text() == "mine" and not (folder / "sweep.toml").exists()


@pytest.mark.parametrize("text", ["0", "25", "two", "-1"])
def test_a_number_of_tendons_that_cannot_be_is_refused(tmp_path, text, capsys):
    with pytest.raises(SystemExit):
        cli.main(["new", "robot", "-o", str(tmp_path / "x"), f"--tendons={text}"])
    assert "from 1 to 24" in capsys.readouterr().err


@pytest.mark.parametrize("file", ["robot", "scenario", "model", "sweep"])
def test_schema_is_printed_as_json(capsys, file):
    assert cli.main(["schema", file]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema["title"] == f"{file}.toml of tdcr_fe" and schema["properties"]
