"""Numbers that steer the search: each of these tests fails where its number is halved or doubled."""

from dataclasses import replace

import numpy as np
import pytest
from identify_data import measured, problem_of, searching, state_of
from test_rows import long_data

from tdcr_fe.effects import effect
from tdcr_fe.identify.criteria import is_improvement, price, rank, robust_threshold
from tdcr_fe.identify.load_steps import choose_rows
from tdcr_fe.identify.screening import Score
from tdcr_fe.identify.search import _heads, _limit, promised
from tdcr_fe.identify.search_state import posterior
from tdcr_fe.identify.verdict import added_effects


@pytest.fixture(scope="module")
def begun():
    """A search of the small robot that has the declared model alone, a hundred thousand times worse than noise."""
    state = state_of(problem_of(measured(), held=(2, 4, 6)))
    residual = np.full(state.problem.count, 300.0)
    declared = replace(state.declared, residual=residual, cost=9e4 * 48.0, held_cost=9e4 * 18.0)
    return replace(state, declared=declared, best=declared, fits={frozenset(): declared})


def added(state, names, cost, held_cost=None, residual=0.0):
    """A state with a fit of effects with these sums of squares, and the fit."""
    own = state.problem
    effects = tuple(effect(n) for n in names)
    fit = replace(
        state.declared,
        effects=effects,
        values={e.name: e.null_values(own.experiment) for e in effects},
        cost=cost,
        held_cost=cost if held_cost is None else held_cost,
        residual=np.full(own.count, residual),
        jacobian=np.zeros((own.count, 0)),
    )
    return state.with_fit(fit), fit


def score(names, drop, readings):
    """A candidate of one parameter each."""
    return Score(
        tuple(effect(n) for n in names), drop, [{}], np.zeros(readings), np.ones((readings, len(names)))
    )


@pytest.mark.parametrize(("left", "simpler_first"), [(0.015, True), (0.03, False)])
def test_what_first_order_leaves_below_a_fiftieth_does_not_count(begun, left, simpler_first):
    """The pair leaves nothing, one of its effects alone this share of the sum of squares."""
    problem, fit = begun.problem, begun.declared
    one = score(["precurvature"], (1.0 - left) * fit.cost, problem.count)
    both = score(["precurvature", "marker_offset"], fit.cost, problem.count)
    criteria = [promised(problem, fit, x.drop, (x,)) for x in (one, both)]
    assert (criteria[0] < criteria[1]) is simpler_first


def test_two_models_of_listed_effects_are_extended_besides_the_best_one(begun):
    state = begun
    for name, cost in (
        ("precurvature", 100.0),
        ("marker_offset", 2e3),
        ("gravity", 4e3),
        ("frame_misalignment", 8e3),
    ):
        state, fit = added(state, [name], cost * 1e2, residual=cost)
        if name == "precurvature":
            state = replace(state, best=fit)
    assert [f.names for f in _heads(searching(), state)] == [("precurvature",), ("marker_offset",)]
    assert len(_heads(searching(), replace(state, best=state.declared))) == 3


def test_a_model_within_six_of_the_criterion_may_be_as_probable(begun):
    _, fit = added(begun, ["marker_offset"], 50.0)
    beyond = _limit(begun.problem, fit) - 50.0 - price(fit.effects, begun.problem.data.robot)
    assert 4.0 < beyond < 8.0


@pytest.mark.parametrize(("size", "same"), [(0.75, True), (1.5, False)])
def test_predictions_that_differ_by_less_than_one_are_one_explanation(begun, size, same):
    state, best = added(begun, ["marker_offset"], 50.0)
    state, _ = added(state, ["precurvature"], 50.0, residual=np.sqrt(size / state.problem.count))
    found = posterior(searching(), replace(state, best=best))
    assert sum(w for f, w in found if f is best) == pytest.approx(1.0 if same else 0.5, abs=1e-3)


@pytest.mark.parametrize(("probability", "named"), [(0.85, False), (0.95, True)])
def test_a_name_needs_a_probability_of_nine_tenths(begun, probability, named):
    state, best = added(begun, ["marker_offset"], 50.0)
    odds = 2.0 * np.log(probability / (1.0 - probability))
    state, _ = added(state, ["precurvature"], 50.0, 50.0 + odds, residual=0.5)
    (found,) = added_effects(searching(), replace(state, best=best), np.zeros(0), True)
    assert found.probability == pytest.approx(probability, abs=0.02) and found.found is named


def test_a_cause_without_a_name_is_less_probable_by_the_square_of_e(begun):
    from test_search import whole_dictionary

    (taper,) = [e for e in whole_dictionary(begun.problem) if e.name == "radius along s"]
    robot = begun.problem.data.robot
    assert price((taper,), robot) - price((effect("gravity"),), robot) == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("names", "named"),
    [
        (["marker_offset"], True),
        (["marker_offset", "precurvature"], True),
        (["marker_offset", "precurvature", "gravity"], False),
    ],
)
def test_a_sum_of_three_causes_names_none_of_them(begun, names, named):
    """One cause that is not in the dictionary is then about as probable: a glued-in angle became a sum of three."""
    state, best = added(begun, names, 50.0)
    found = added_effects(searching(), replace(state, best=best), np.zeros(0), True)
    assert all(e.found is named for e in found)
    assert found[0].probability == pytest.approx(
        1.0 if len(names) == 1 else 0.97 if named else 0.56, abs=0.01
    )


@pytest.mark.parametrize(("share", "named"), [(0.005, False), (0.02, True)])
def test_a_small_effect_beside_a_cause_without_a_name_may_correct_its_form(begun, share, named):
    """Tensions that fall with every row became a drifting gain and an actuator gain of 1.006, which was named."""
    from test_search import whole_dictionary

    (taper,) = [e for e in whole_dictionary(begun.problem) if e.name == "radius along s"]
    state, both = added(begun, ["marker_offset"], 50.0, 50.0)
    values = {**both.values, taper.name: taper.null_values(begun.problem.experiment)}
    best = replace(both, effects=(*both.effects, taper), values=values)
    squares = begun.declared.cost + begun.declared.held_cost
    alone = replace(best, effects=(taper,), cost=50.0 + share * squares)
    state = replace(state, best=best, fits={frozenset(f.names): f for f in (begun.declared, alone, best)})
    first, _ = added_effects(searching(), state, np.zeros(0), True)
    assert first.probability > 0.9 and first.found is named


@pytest.mark.parametrize(("drop", "better"), [(3.0, False), (5.0, True)])
def test_held_out_readings_must_improve_by_four(begun, drop, better):
    """The two models predict other held-out readings, so that these decide."""
    _, old = added(begun, ["marker_offset"], 200.0, 50.0)
    _, new = added(begun, ["marker_offset", "precurvature"], 40.0, 50.0 - drop, residual=3.0)
    assert is_improvement(begun.problem, new, old, 1e-3) is better


def test_a_residual_counts_in_full_up_to_four_sigma():
    assert 3.5 < robust_threshold(np.full(10, 0.1)) < 4.5
    assert 11.0 < robust_threshold(np.array([1.0, 2.0, 2.0, 3.0])) < 13.0


def test_data_of_more_than_two_hundred_steps_are_long():
    """Ten branches of twenty steps are searched whole, eleven are not; of these about six steps a branch are taken."""
    assert choose_rows(long_data(10), range(20)) is None
    for branches, steps in ((11, (40, 72)), (24, (60, 72))):
        found = choose_rows(long_data(branches), [k for k in range(20 * branches) if k // 20 % 3 == 0])
        assert steps[0] <= len(found.steps) <= steps[1]
        assert {sum(k // 20 == n for k in found.steps) for n in {k // 20 for k in found.steps}} == {6}


def test_a_model_at_a_bound_ranks_as_if_it_were_a_third_worse(begun, monkeypatch):
    _, fit = added(begun, ["marker_offset"], 500.0)
    free = rank(begun.problem, fit)
    monkeypatch.setattr("tdcr_fe.identify.criteria.at_bound", lambda problem, fit: True)
    assert 0.2 < (rank(begun.problem, fit) - free) / (fit.cost + fit.held_cost) < 0.4
