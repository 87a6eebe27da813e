"""Load steps: rows and branches that a search takes, held out by patterns, joined where no state depends on others."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from identify_data import FRICTIONAL, GRAVITY, MODEL, ROBOT, data_of, measured, positions, simulated
from searches import concluded, identified, problem_of, searching, state_of

from tdcr_fe import Experiment, InputError, LoadStep, Reading, effect, with_effects
from tdcr_fe.identify import IdentifySettings, identification, identify, rows
from tdcr_fe.identify.fitting import fit
from tdcr_fe.identify.identification import fit_to_all_rows, with_friction, without_friction
from tdcr_fe.identify.problem import evaluate, join_steps
from tdcr_fe.identify.report import render
from tdcr_fe.identify.rows import IN_BRANCH, SEARCHED, blocks, choose_rows, held_out_branches, inputs
from tdcr_fe.identify.search_state import in_time
from tdcr_fe.identify.sentences import sentences
from tdcr_fe.identify.settings import Part, end_at

SIGMA = 1e-4


def long_data(branches=24, model=MODEL, truth=None):
    """Pulls and releases of two tendons in ten small steps each, as branches; readings of a robot with effects."""
    steps, names = [], []
    for n in range(branches):
        turn = 0.4 * n
        top = np.maximum(0.0, np.array([np.cos(turn), np.sin(turn)]) * (0.5 + 0.02 * n))
        for x in (*np.linspace(0.1, 1.0, 10), *np.linspace(0.9, 0.0, 10)):
            steps.append(LoadStep(tensions=dict(zip(("t1", "t2"), (x * top).tolist(), strict=True))))
            names.append(f"branch {n}")
    true = Experiment(ROBOT, replace(model, elements_per_bay=3), tuple(steps))
    if truth:
        return data_of(steps, positions(with_effects(true, truth), SIGMA, 1, 1e-4), ROBOT, model, names)
    ids = range(1, len(steps) + 1)
    readings = [Reading(n, f"position_{a}", s, 0.0, SIGMA) for n in ids for s in (0.1, 0.2) for a in "xyz"]
    return data_of(steps, tuple(readings), ROBOT, model, names)


@pytest.fixture(scope="module")
def chosen():
    data = long_data()
    held = [k for k, b in enumerate(data.branches) if int(b.split()[1]) % 3 == 0]
    return data, set(held), choose_rows(data, held)


def test_short_data_are_searched_whole():
    assert choose_rows(long_data(rows.LONG // 20), range(20)) is None
    assert choose_rows(long_data(rows.LONG // 20 + 1), range(20)) is not None


def test_the_choice_is_small_and_has_fitted_and_held_out_branches(chosen):
    data, held, found = chosen
    assert len(found.steps) <= SEARCHED and list(found.steps) == sorted(set(found.steps))
    assert 0.2 < np.mean([k in held for k in found.steps]) < 0.45
    names = [data.branches[k] for k in found.steps]
    assert all(names.count(n) == IN_BRANCH for n in set(names))


def test_more_inputs_take_more_rows(chosen):
    """Seven tendons, each pulled in branches of its own: all have branches among the rows that are fitted."""
    data, _, _ = chosen
    tendons = tuple(replace(ROBOT.tendons[0], name=f"t{i + 1}") for i in range(7))
    pulls = [max(s.tensions.values()) * (np.arange(7) == k // 20 % 7) for k, s in enumerate(data.steps)]
    names = [t.name for t in tendons]
    steps = tuple(LoadStep(tensions=dict(zip(names, x.tolist(), strict=True))) for x in pulls)
    data = replace(data, robot=replace(ROBOT, tendons=tendons), steps=steps)
    found = choose_rows(data, range(12 * 20, 24 * 20))
    pulled = {n for k in found.steps if k < 12 * 20 for n, v in steps[k].tensions.items() if v > 0.0}
    assert SEARCHED < len(found.steps) <= 13 * 7 and pulled == set(names)


def test_the_turning_point_of_every_chosen_branch_stays(chosen):
    """Between pull and release, friction changes its sign: without that step, the history would be another."""
    data, _, found = chosen
    for name in {data.branches[k] for k in found.steps}:
        pulls = {k: max(data.steps[k].tensions.values()) for k, b in enumerate(data.branches) if b == name}
        assert max(pulls, key=pulls.get) in found.steps


def test_data_that_turn_at_every_step_keep_pieces_without_gaps():
    """Random tensions without branches: the choice is of consecutive steps, since no history is shorter."""
    data = long_data(11)
    draw = np.random.default_rng(0).uniform(0.0, 1.0, (len(data.steps), 2))
    steps = tuple(LoadStep(tensions={"t1": a, "t2": b}) for a, b in draw.tolist())
    data = replace(data, steps=steps, branches=("",) * len(steps))
    found = choose_rows(data, range(60, 120))
    pieces = np.diff([-1, *np.flatnonzero(np.diff(found.steps) > 1), len(found.steps) - 1])
    assert len(found.steps) > 40 and np.median(pieces) >= 2 * IN_BRANCH
    assert {k in range(60, 120) for k in found.steps} == {True, False}


@pytest.mark.parametrize(("true", "kept"), [(0.0, False), (0.3, True)])
@pytest.mark.integration
def test_declared_friction_stays_where_the_model_is_better_with_it(true, kept):
    """The search runs without friction; the declared robot has 0.3 at every hole."""
    robot = ROBOT.with_tendons(friction_coefficient=0.3)
    bend = {"precurvature": {"kappa_x": 0.6, "kappa_y": -0.9}}
    mu = {"friction_coefficient": {"mu": true}} if true else {}
    data = replace(long_data(11, FRICTIONAL, {**bend, **mu}), robot=robot)
    problem = problem_of(data, range(1, 61), SIGMA)
    problem = problem.of_rows(choose_rows(data, range(60)))
    search, free = searching(), state_of(without_friction(problem))
    best = fit(free.problem, (effect("precurvature"),), bend)
    state = with_friction(problem, search, replace(free.with_fit(best), best=best))
    assert (state.problem.experiment.model.friction == "per-hole") is kept
    assert state.best.names == ("precurvature",) and state.best.cost < 1.5 * np.count_nonzero(problem.fitted)
    assert ("left out" in state.log.history[-1]) is not kept


def test_friction_has_the_same_history_on_the_chosen_steps_of_a_branch():
    """All branches, of which each has 6 of 20 steps: within 2e-5 of the length of the run over all steps."""
    robot = ROBOT.with_tendons(friction_coefficient=0.2)
    data = replace(long_data(4), robot=robot, model=FRICTIONAL)
    kept = [k for b in blocks(data) for k in rows._simplified(inputs(data), b)]
    assert len(kept) == 4 * IN_BRANCH

    def tips(steps):
        return simulated(Experiment(robot, FRICTIONAL, tuple(data.steps[k] for k in steps))).positions[:, -1]

    every = tips(range(len(data.steps)))
    assert np.max(np.abs(simulated(Experiment(robot, MODEL, data.steps)).positions[:, -1] - every)) > 3e-4
    np.testing.assert_allclose(tips(kept), every[kept], atol=4e-6)


@pytest.mark.integration
def test_the_final_fit_and_all_errors_are_of_all_rows():
    """220 load steps, of which the search uses at most 72; the errors are those of all readings, and near the noise."""
    data = long_data(11, truth={"gravity": {"g_x": 0.0, "g_y": -6.0, "g_z": -7.76}})
    result = identify(data, IdentifySettings(max_effects=1, candidates=2))
    assert [e.name for e in result.effects] == ["gravity"] and result.verdict == "explained"
    assert len(result.log.rows.numbers) <= SEARCHED and result.fitted_to_all
    assert result.before.fit.count + result.before.held_out.count == len(data.readings)
    assert result.after.fit.count + result.after.held_out.count == len(data.readings)
    assert 0.85 < result.after.held_out.chi2_per_dof < 1.15
    e = result.effects[0].parameters["g_y"]
    assert abs(e.value + 6.0) < 4.0 * e.std_error
    assert result.to_json()["searched_steps"] == list(result.log.rows.numbers)
    (text,) = [s for s in sentences(result) if s.startswith("The search used")]
    count = len(result.log.rows.numbers)
    assert text.startswith(f"The search used {count} of 220 load steps; the final fit and all")


@pytest.fixture(scope="module")
def searched():
    """All load steps, the choice of them, and a search that has found two effects on these."""
    bend = {"kappa_x": 0.9, "kappa_y": 0.0}
    truth = {"gravity": {"g_x": 0.0, "g_y": -6.0, "g_z": -7.76}, "precurvature": bend}
    data = long_data(11, truth=truth)
    held = [k for k, b in enumerate(data.branches) if int(b.split()[1]) % 3 == 0]
    problem = problem_of(data, [k + 1 for k in held], SIGMA)
    chosen = choose_rows(data, held)
    state = state_of(problem.of_rows(chosen))
    effects = tuple(effect(name) for name in truth)
    for some in (effects[:1], effects):
        best = fit(state.problem, some, {e.name: truth[e.name] for e in some})
        state = state.with_fit(best)
    return problem, chosen, replace(state, best=best)


@pytest.mark.parametrize("missed", [Part.ALL_STEPS, Part.OTHER_MODELS])
def test_a_final_fit_without_enough_time_loses_nothing(searched, tmp_path, missed, monkeypatch):
    """Without any time no simulation of all load steps ends; with some, none of other models."""
    problem, chosen, state = searched
    whole = replace(problem, deadline=0.0 if missed == Part.ALL_STEPS else math.inf)
    monkeypatch.setattr(identification, "_with_other_models", lambda *_: end_at(0.0, None))
    state = in_time(searching(), state, partial(fit_to_all_rows, whole), Part.ALL_STEPS)
    result = concluded(state.logged(rows=chosen), 0.0)
    assert [e.name for e in result.effects] == ["gravity", "precurvature"]
    assert set(result.log.not_tried) == {missed, Part.CEILING}
    assert result.fitted_to_all == (missed != Part.ALL_STEPS)
    count = len(problem.data.readings) if result.fitted_to_all else 6 * len(chosen.steps)
    assert result.after.fit.count + result.after.held_out.count == count
    assert result.after.held_out.chi2_per_dof < 0.1 * result.before.held_out.chi2_per_dof
    first, second = result.effects
    assert (first.evidence == {}) == (missed == Part.OTHER_MODELS) and second.parameters
    assert math.isnan(first.after.fit.chi2_per_dof) == (missed == Part.OTHER_MODELS)
    (tmp_path / "report.html").write_text(render(result), encoding="utf-8")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert ("What it adds alone is not known" in page) == (missed == Part.OTHER_MODELS)


def test_models_that_explain_as_much_on_chosen_rows_are_compared_on_all(searched):
    """With the best one alone its probability was one: a gain was named where any stiffness explained as much."""
    problem, _, state = searched
    values = {"precurvature": state.best.values["precurvature"]}
    other = evaluate(state.problem, state.best.effects[1:], values)
    other = replace(other, cost=state.best.cost, held_cost=state.best.held_cost)
    last = fit_to_all_rows(problem, searching(), state.with_fit(other))
    again = last.fits[frozenset({"precurvature"})]
    assert again.residual.size == problem.count and again.cost > 2.0 * last.best.cost


# ------------------------------------------------------------ held out by patterns


NAMES = (*["one_up"] * 3, *["one_down"] * 2, *["two_up"] * 2, "two_down", *["pair_up"] * 2, "pair_down")


@pytest.fixture(scope="module")
def data():
    """Eleven steps in six named branches, gravity not declared."""
    return replace(measured(GRAVITY), branches=NAMES)


HELD_OUT = [
    (["pair*"], (8, 9, 10)),
    (["*_down"], (3, 4, 7, 10)),
    (["two_up", "pair_d?wn"], (5, 6, 10)),
    (["[ot]*_up"], (0, 1, 2, 5, 6)),
]


@pytest.mark.parametrize(("patterns", "held"), HELD_OUT)
def test_all_steps_of_matching_branches_are_held_out(data, patterns, held):
    assert held_out_branches(data, patterns) == held


def test_steps_without_readings_are_not_counted(data):
    some = replace(data, readings=tuple(r for r in data.readings if r.step != 9))
    assert held_out_branches(some, ["pair_up"]) == (9,)


WRONG_PATTERNS = [
    (["triple*"], "branches with readings are one_up, one_down, two_up, two_down, pair_up, pair_down"),
    (["pair*", "Pair*"], "--hold-out = Pair*: matches no branch"),
    (["*"], "nothing is left to fit"),
]


@pytest.mark.parametrize(("patterns", "text"), WRONG_PATTERNS)
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
    assert (len(joined.steps), len(parts.steps), joined.ends) == (11, 20, tuple((k, 1.0) for k in range(11)))
    np.testing.assert_allclose(tips(joined), tips(parts), atol=1e-9)


@pytest.mark.parametrize("friction", ["per-hole", "per-tendon"])
def test_with_friction_the_parts_stay(friction):
    joined, parts = lagged(replace(MODEL, friction=friction))
    assert joined.steps == parts.steps and joined.ends == parts.ends


def test_what_the_last_part_does_not_name_stays_as_the_first_has_left_it():
    data = measured()
    first, second = replace(data.steps[0], tensions={"t1": 0.4}), replace(data.steps[0], tensions={"t2": 0.3})
    (step,) = join_steps(Experiment(data.robot, MODEL, (first, second), ends=((0, 0.5), (0, 1.0)))).steps
    assert step.tensions == {"t1": 0.4, "t2": 0.3}
