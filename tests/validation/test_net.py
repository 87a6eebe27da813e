"""The safety net: what is computed now is what is stored, and what moves is found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tdcr_fe.validation.net.__main__ import main
from tdcr_fe.validation.net.comparison import Comparison, compare, differences
from tdcr_fe.validation.net.parts import PARTS
from tdcr_fe.validation.net.storage import read_part, write_part

STORED = Path(__file__).parents[1] / "net"


@pytest.mark.parametrize("part", ["robots", "cases", "scenes", "derivatives"])
def test_a_few_cases_are_those_stored(part: str) -> None:
    """The whole net is compared by ``python -m tdcr_fe.validation.net``."""
    found = compare([part], STORED, every=len(read_part(part, STORED)) // 3)
    assert found.passed, "\n".join(found.lines())


def test_a_movement_is_named_with_its_place_and_size() -> None:
    """Numbers within and beyond the tolerance, a state, a shape, and an error in place of a result."""
    stored = {
        "positions": np.linspace(0.0, 0.2, 30).reshape(5, 2, 3),
        "tensions": np.ones((5, 4)),
        "states": "pp/pr",
    }
    assert not differences("robots", "7", stored, {k: v for k, v in stored.items()}, 1e-9)
    positions, tensions = stored["positions"].copy(), stored["tensions"].copy()
    positions[3, 1, 2] += 2e-6
    tensions[0, 0] += 1e-12
    moved = differences(
        "robots", "7", stored, {"positions": positions, "tensions": tensions, "states": "pp/ps"}, 1e-9
    )
    by_quantity = {d.quantity: d for d in moved}
    assert by_quantity["positions"].step == 4 and by_quantity["positions"].place == "[1, 2]"
    assert by_quantity["positions"].size == pytest.approx(1e-5) and by_quantity["positions"].beyond
    assert not by_quantity["tensions"].beyond
    assert by_quantity["states"].step == 2 and "'pr' is now 'ps'" in by_quantity["states"].text
    lines = Comparison({"robots": 3}, moved).lines()
    assert lines[1].split() == ["robots", "3", "2", "0", "1"]
    assert any("robots | 7, step 4 | positions [1, 2]" in line for line in lines)
    shorter = differences("robots", "7", stored, {**stored, "positions": positions[:4]}, 1e-9)
    assert shorter[0].beyond and "shape (5, 2, 3) is now (4, 2, 3)" in shorter[0].text
    assert all(d.beyond for d in differences("robots", "7", stored, {"failure": "StepFailed"}, 1e-9))


def test_the_command_ends_with_status_1_where_a_stored_number_is_another(tmp_path: Path, capsys) -> None:
    keys = [str(k) for k in range(len(PARTS["robots"].keys()))]
    records = {**{key: {} for key in keys}, "0": PARTS["robots"].solve("0")}
    write_part("robots", records, tmp_path)
    arguments = ["robots", "--folder", str(tmp_path), "--every", str(len(keys))]
    assert main(arguments) == 0
    tips = records["0"]["positions"].copy()
    tips[2, -1, 0] += 1e-7
    write_part("robots", {**records, "0": {**records["0"], "positions": tips}}, tmp_path)
    assert main(arguments) == 1
    assert "robots | 0, step 3 | positions" in capsys.readouterr().out
