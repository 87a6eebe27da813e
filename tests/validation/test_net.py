"""The safety net: what is computed now is what is stored, and what moves is found."""

from pathlib import Path

import numpy as np
import pytest

from tdcr_fe.validation.campaigns.net import CAMPAIGN, Case
from tdcr_fe.validation.net.comparison import differences, report
from tdcr_fe.validation.net.storage import read_part, write_part
from tdcr_fe.validation.runner import main

STORED = Path(__file__).parents[1] / "net"


@pytest.mark.parametrize(
    ("part", "key"),
    [
        ("robots", "18"),
        ("robots", "40"),
        ("cases", "converging_straight_per-hole_gravity_10"),
        ("scenes", "ball"),
        ("scenes", "swing"),
        ("derivatives", "tension, per hole: friction_coefficient.mu"),
        ("files", "120"),
    ],
)
def test_a_case_is_the_stored_one(part: str, key: str, tmp_path: Path) -> None:
    """The whole net is compared by ``python -m tdcr_fe.validation net``."""
    found = CAMPAIGN.run(Case(part, key, STORED), tmp_path)
    assert found.passed, found.moved


def test_a_movement_is_named_with_its_place_and_size() -> None:
    """Numbers within and beyond the tolerance, a state, a shape, and an error in place of a result."""
    points = np.linspace(0.0, 0.2, 30).reshape(5, 2, 3)
    stored = {"positions": points, "tensions": np.ones((5, 4)), "states": "pp/pr"}
    assert not differences("robots", "7", stored, dict(stored), 1e-9)
    positions, tensions = stored["positions"].copy(), stored["tensions"].copy()
    positions[3, 1, 2] += 2e-6
    tensions[0, 0] += 1e-12
    found = {"positions": positions, "tensions": tensions, "states": "pp/ps"}
    moved = {d.quantity: d for d in differences("robots", "7", stored, found, 1e-9)}
    assert moved["positions"].step == 4 and moved["positions"].place == "[1, 2]"
    assert moved["positions"].size == pytest.approx(1e-5) and moved["positions"].beyond
    assert not moved["tensions"].beyond
    assert moved["states"].step == 2 and "'pr' is now 'ps'" in moved["states"].text
    lines = report({"robots": 3}, list(moved.values()))
    assert lines[1].split() == ["robots", "3", "2", "0", "1"]
    assert any("robots | 7, step 4 | positions [1, 2]" in line for line in lines)
    shorter = differences("robots", "7", stored, {**stored, "positions": positions[:4]}, 1e-9)
    assert shorter[0].beyond and "shape (5, 2, 3) is now (4, 2, 3)" in shorter[0].text
    assert all(d.beyond for d in differences("robots", "7", stored, {"failure": "StepFailed"}, 1e-9))


def test_the_command_ends_with_status_1_where_a_stored_number_is_another(tmp_path: Path, capsys) -> None:
    record = read_part("robots", STORED)["0"]
    tips = record["positions"].copy()
    tips[2, -1, 0] += 1e-7
    for name, status, stored in (("same", 0, record), ("other", 1, {**record, "positions": tips})):
        write_part("robots", {"0": stored}, tmp_path / name)
        arguments = ["--stored", str(tmp_path / name), "-o", str(tmp_path / name)]
        assert main(["net", "--parts", "robots", *arguments]) == status
    assert "robots | 0, step 3 | positions" in capsys.readouterr().out


def test_outside_a_checkout_it_says_where_the_net_is_looked_for(tmp_path: Path, capsys) -> None:
    command = ["net", "--quick", "--stored", str(tmp_path / "nowhere"), "-o", str(tmp_path / "out")]
    assert main(command) == 2
    assert "nowhere: the net is not there" in capsys.readouterr().err
