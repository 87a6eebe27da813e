"""Held-out branches by pattern: whole branches, and errors that name the branches there are."""

from dataclasses import replace

import pytest
from identify_data import GRAVITY, measured

from tdcr_fe.cli import main
from tdcr_fe.identify import IdentifySettings, identify
from tdcr_fe.identify.load_steps import held_out_branches
from tdcr_fe.io.measured import write_measured
from tdcr_fe.io.problems import InputError

NAMES = (
    ("one_up",) * 3 + ("one_down",) * 2 + ("two_up",) * 2 + ("two_down",) + ("pair_up",) * 2 + ("pair_down",)
)


@pytest.fixture(scope="module")
def data():
    """Eleven steps in six named branches, gravity not declared."""
    return replace(measured(GRAVITY), branches=NAMES)


@pytest.mark.parametrize(
    ("patterns", "held"),
    [
        (["pair*"], (8, 9, 10)),
        (["*_down"], (3, 4, 7, 10)),
        (["two_up", "pair_d?wn"], (5, 6, 10)),
        (["[ot]*_up"], (0, 1, 2, 5, 6)),
    ],
)
def test_all_steps_of_matching_branches_are_held_out(data, patterns, held):
    assert held_out_branches(data, patterns) == held


def test_steps_without_readings_are_not_counted(data):
    some = replace(data, readings=tuple(r for r in data.readings if r.step != 9))
    assert held_out_branches(some, ["pair_up"]) == (9,)


@pytest.mark.parametrize(
    ("patterns", "text"),
    [
        (["triple*"], "branches with readings are one_up, one_down, two_up, two_down, pair_up, pair_down"),
        (["pair*", "Pair*"], "--hold-out = Pair*: matches no branch"),
        (["*"], "nothing is left to fit"),
    ],
)
def test_patterns_that_match_no_branch_or_all_are_refused_by_name(data, patterns, text):
    with pytest.raises(InputError, match="--hold-out") as caught:
        held_out_branches(data, patterns)
    assert text in str(caught.value)


def test_without_branches_a_pattern_is_refused():
    with pytest.raises(InputError, match=r"loading\.csv names no branches"):
        identify(measured(), IdentifySettings(hold_out_branches=("pair*",)))


def test_the_command_refuses_a_pattern_that_matches_nothing(data, tmp_path, capsys):
    write_measured(data, tmp_path / "set")
    assert (
        main(["identify", str(tmp_path / "set"), "-o", str(tmp_path / "out"), "--hold-out", "triple*"]) == 2
    )
    assert "one_up, one_down" in capsys.readouterr().err and not (tmp_path / "out").exists()
