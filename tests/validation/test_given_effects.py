"""Effects that are given by name: fitted in their order, and what each takes away."""

import json
from dataclasses import replace

import numpy as np
import pytest
from identify_data import GRAVITY, measured

from tdcr_fe.effects import Experiment
from tdcr_fe.io.measured import write_measured
from tdcr_fe.validation.campaigns.given_effects import chosen_form
from tdcr_fe.validation.runner import main


def test_the_command_prints_and_writes_what_each_takes_away(tmp_path, capsys):
    branches = ("one",) * 5 + ("other",) * 3 + ("both",) * 3
    data = replace(measured(GRAVITY), branches=branches)
    write_measured(data, tmp_path / "set")
    folders = [str(tmp_path / "set"), "-o", str(tmp_path / "out")]
    arguments = ["given_effects", *folders, "--hold-out", "both", "--effects"]
    assert main([*arguments, "gravity"]) == 0
    assert "gravity: g_x = " in capsys.readouterr().out
    (line,) = (tmp_path / "out" / "given_effects.jsonl").read_text().splitlines()[1:]
    declared, found = json.loads(line)["stages"]
    assert found["held_out"] < declared["held_out"]
    assert set(found["by_branch"]) == set(branches)
    by_branch = np.array([found["by_branch"][name] for name in ("one", "other")])
    assert by_branch.min() <= found["fitted"] <= by_branch.max()
    assert main([*arguments, "tendon_stretch (by segment)"]) == 2
    assert "options differ" in capsys.readouterr().err
    with pytest.raises(ValueError, match="no effect 'wind'"):
        chosen_form("wind", Experiment(data.robot, data.model))
