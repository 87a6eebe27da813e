"""Effects of one's own: the example of the documentation, used like a listed effect; and files that are refused."""

import json
import re
from pathlib import Path

import pytest
from identify_data import LENGTH, measured
from searches import identified, tips_of_run

from tdcr_fe.cli import main
from tdcr_fe.effects import EFFECTS
from tdcr_fe.io.files import InputError
from tdcr_fe.io.user_effects import read_own_effects

PAGE = (Path(__file__).parents[2] / "docs" / "identify.md").read_text(encoding="utf-8")
EXAMPLE = re.search(r"```python\n# cable_pull\.py\n(.*?)```", PAGE, re.S)[1]
TRUTH = {"force_x": 0.02, "force_y": -0.015, "force_z": 0.03}


@pytest.fixture
def example(tmp_path):
    """The file of the documentation page."""
    path = tmp_path / "cable_pull.py"
    path.write_text(EXAMPLE, encoding="utf-8")
    return path


@pytest.mark.integration
def test_the_example_of_the_page_is_found_and_runs(example, tmp_path, capsys):
    """On readings with a force at the tip, ``identify`` names it, and ``run`` repeats the fit."""
    (own,) = read_own_effects([example])
    data = measured({"cable_pull": TRUTH}, catalogue=(*EFFECTS, own))
    out, option = tmp_path / "out", ["--effects", str(example)]
    assert identified(tmp_path, data, *option) == 0
    assert "A camera cable pulls at the tip" in (out / "report.html").read_text(encoding="utf-8")
    document = json.loads((out / "result.json").read_text())
    (found,) = document["effects"]
    assert (found["effect"], document["verdict"]) == ("cable_pull", "explained")
    for name, true in TRUTH.items():
        estimate = found["parameters"][name]
        assert abs(estimate["value"] - true) < 4.0 * estimate["std_error"] < 0.01
    capsys.readouterr()
    # Without the option the scenario names an unknown effect.
    assert main(["run", str(out / "effects.toml"), "-o", str(tmp_path / "run")]) == 2
    assert "effects.cable_pull" in capsys.readouterr().err
    steps = tips_of_run(out / "effects.toml", tmp_path / "run", *option)
    tips = [r for r in data.readings if r.location == LENGTH and r.quantity == "position_x"]
    assert all(abs(steps.loc[str(r.step), "tip_x"] - r.value) < 5.0 * r.sigma for r in tips)


WRONG_FILES = [
    (lambda t: t.replace("class CablePull(Effect)", "class CablePull"), "must define a class derived from"),
    (lambda t: t.replace('"cable_pull"', '"gravity"'), "is the name of another effect"),
    (lambda t: t.replace('"cable_pull"', '"cable pull"'), "must be a word"),
    (lambda t: t.replace("def apply", "def act"), "apply: must be defined"),
    (lambda t: t.replace("parameters = tuple(", "numbers = tuple("), "at least one"),
    (lambda t: t.replace("0.0, 1e-3", "9.0, 1e-3"), "must lie within its bounds, -5 to 5 N"),
    (lambda t: t.replace("import replace", "import substitute"), "cannot be run: ImportError"),
    (lambda t: t + "\n1 +", "cannot be run: SyntaxError"),
    # before anything is simulated
    (lambda t: t.replace("values[p.name]", 'values["force"]'), "CablePull.apply: fails at null values: KeyError"),
    (lambda t: t.replace("return replace(experiment, steps=steps)", "return steps"), "must return an Experiment"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "text"), WRONG_FILES)
def test_a_file_that_is_no_effect_is_refused_with_what_is_allowed(example, tmp_path, capsys, change, text):
    changed = change(EXAMPLE)
    assert changed != EXAMPLE
    example.write_text(changed, encoding="utf-8")
    assert identified(tmp_path, measured(), "--effects", str(example)) == 2
    said = capsys.readouterr().err
    assert text in said and str(example) in said and not (tmp_path / "out").exists()
    with pytest.raises(InputError, match="is a directory; must be a Python file with an effect"):
        read_own_effects([tmp_path])
