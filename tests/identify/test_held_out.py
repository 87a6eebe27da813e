"""Load steps: held out by patterns of their branches, and joined where no state depends on those before."""

from dataclasses import replace

import numpy as np
import pytest
from identify_data import GRAVITY, MODEL, measured, simulated
from identify_search import identified, problem_of

from tdcr_fe import Experiment, InputError, effect
from tdcr_fe.identify import IdentifySettings, identify
from tdcr_fe.identify.problem import join_steps
from tdcr_fe.identify.rows import held_out_branches

NAMES = (*["one_up"] * 3, *["one_down"] * 2, *["two_up"] * 2, "two_down", *["pair_up"] * 2, "pair_down")


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
    assert identified(tmp_path, data, "--hold-out", "triple*") == 2
    assert "one_up, one_down" in capsys.readouterr().err and not (tmp_path / "out").exists()


# ------------------------------------------------------------ parts of steps


def lagged(model):
    """Experiment of the identification with a lag of a quarter of a second, and the same with its steps in parts."""
    data, e = measured(), effect("time_lag")
    steps = tuple(replace(s, time=float(k)) for k, s in enumerate(data.steps))
    problem = problem_of(replace(data, model=model, steps=steps))
    return problem.with_effects((e,), {"time_lag": {"lag": 0.25}}), e.apply(problem.experiment, {"lag": 0.25})


def tips(experiment):
    run = simulated(experiment)
    assert run.solved and len(run.positions) == 11
    return run.positions[:, -1]


def test_a_time_lag_divides_no_step_without_friction_and_the_shapes_are_the_same():
    """Every step was divided where the commands have a kink: 20 solves for 11 steps."""
    joined, parts = lagged(MODEL)
    assert (len(joined.steps), len(parts.steps), joined.ends) == (11, 20, None)
    np.testing.assert_allclose(tips(joined), tips(parts), atol=1e-9)


@pytest.mark.parametrize("friction", ["per-hole", "per-tendon"])
def test_with_friction_the_parts_stay(friction):
    joined, parts = lagged(replace(MODEL, friction=friction))
    assert joined.steps == parts.steps and joined.ends == parts.ends


def test_what_the_last_part_does_not_name_stays_as_the_first_has_left_it():
    data = measured()
    first, second = replace(data.steps[0], tensions={"t1": 0.4}), replace(data.steps[0], tensions={"t2": 0.3})
    experiment = Experiment(data.robot, MODEL, (first, second), ends=((0, 0.5), (0, 1.0)))
    (step,) = join_steps(experiment).steps
    assert step.tensions == {"t1": 0.4, "t2": 0.3}
