"""Search of places: a strong effect is found where it is, not where its derivative predicts the most."""

from dataclasses import replace

import pytest
from identify_data import FRICTIONAL, ROBOT, measured, problem_of, searching, state_of

from tdcr_fe.effects import EffectAtPlace, effect
from tdcr_fe.identify import identify
from tdcr_fe.identify.fitting import Race, fit
from tdcr_fe.identify.places import better_places, saturated_pairs, search_places


def test_a_spring_moves_to_the_place_where_it_explains_most():
    """A strong spring: beside the declared model its neighbours may have the larger score."""
    own = problem_of(measured({"side_spring": {"s": 0.15, "stiffness": 3.0}}))
    start = effect("side_spring").at({"s": 0.05})
    first = fit(own, (start,), [{start.name: {"stiffness": 1.0}}])
    sizes = {effect("side_spring").at({"s": s}).name: {"stiffness": 1.0} for s in (0.1, 0.15, 0.2)}
    (found,) = better_places(own, [first], sizes, Race())
    assert found.names == ("side_spring (s = 0.15)",) and found.cost < 0.1 * first.cost
    assert abs(found.values[found.names[0]]["stiffness"] - 3.0) < 0.1


def test_a_hole_that_holds_fast_is_found_although_its_derivative_is_that_of_a_small_drop():
    """A blind set with a stuck hole, 170 sigma from the declared robot, ended with `gravity`, partly explained."""
    data = measured({"stuck_hole": {"tendon": 2.0, "s": 0.05}}, robot=ROBOT, model=FRICTIONAL)
    own = problem_of(data)
    state = state_of(own)
    search = searching()
    best = search_places(search, state, [state.declared]).best
    assert best.names == ("stuck_hole (tendon = 2, s = 0.05)",)
    assert best.cost < 2.0 * own.count < 0.1 * state.declared.cost


@pytest.mark.integration
def test_a_place_that_explains_is_fitted_before_the_effects_along_the_whole_robot():
    """Five effects were fitted to convergence first, none of which came near: 113 runs."""
    result = identify(measured({"soft_bay": {"s": 0.125, "factor": 0.4}}, robot=ROBOT, model=FRICTIONAL))
    (added,) = result.effects
    assert (result.verdict, added.name) == ("explained", "soft_bay")
    assert added.parameters["s"].value == 0.125
    assert abs(added.parameters["factor"].value - 0.4) < 3.0 * added.parameters["factor"].std_error
    assert result.runs < 90


def test_a_place_that_cannot_come_near_the_best_model_is_not_moved():
    """Gravity explained everything; a spring was then moved along the whole backbone, in a third of the time."""
    own = problem_of(measured({"side_spring": {"s": 0.15, "stiffness": 3.0}}))
    start = effect("side_spring").at({"s": 0.05})
    first = fit(own, (start,), [{start.name: {"stiffness": 1.0}}])
    (found,) = better_places(own, [first], {}, Race(1e-3 * first.cost))
    assert found is first


@pytest.mark.parametrize(
    ("tendon", "at"),
    [
        pytest.param(1.0, 0.1, marks=pytest.mark.integration),
        pytest.param(2.0, 0.05, marks=pytest.mark.campaign),
    ],
)
def test_beside_a_hole_that_holds_fast_the_search_goes_on(tendon, at):
    """A hole and precurvature: they ended as friction of 2.6, and as the hole alone, partly explained."""
    causes = {"stuck_hole": {"tendon": tendon, "s": at}, "precurvature": {"kappa_x": 0.01, "kappa_y": 0.0}}
    result = identify(measured(causes, robot=ROBOT, model=FRICTIONAL))
    assert result.verdict == "explained"
    hole, bend = result.effects
    assert (hole.name, bend.name) == ("stuck_hole", "precurvature")
    assert (hole.parameters["tendon"].value, hole.parameters["s"].value) == (tendon, at)
    for name, true in causes["precurvature"].items():
        found = bend.parameters[name]
        assert abs(found.value - true) < 3.0 * found.std_error


@pytest.mark.parametrize(
    ("name", "values", "place"),
    [
        pytest.param("soft_bay", {"factor": 0.5}, {"s": 0.125}, marks=pytest.mark.integration),
        pytest.param("stiffness_scale", {"bending": 0.9, "torsion": 0.9}, {}, marks=pytest.mark.campaign),
    ],
)
def test_a_hole_that_holds_fast_is_found_together_with_what_it_hides(name, values, place):
    """Alone, the hole made held-out steps worse, and beside the declared model so did the other: unexplained."""
    causes = {"stuck_hole": {"tendon": 1.0, "s": 0.1}, name: {**values, **place}}
    own = problem_of(measured(causes, robot=ROBOT, model=FRICTIONAL))
    state = state_of(own)
    for latest in saturated_pairs(searching(), state):
        state = latest
    assert {e.listed for e in state.best.effects} == {"stuck_hole", name}
    where = {e.listed: e.place for e in state.best.effects if isinstance(e, EffectAtPlace)}
    assert where["stuck_hole"] == {"tendon": 1.0, "s": 0.1}
    assert where.get(name, {}) == place
    assert state.best.cost < 1.5 * own.count < 0.1 * state.declared.cost


def test_beside_a_model_that_adapts_a_hole_that_holds_fast_is_found():
    """Gravity fitted without the hole is a little off; at those values the hole, at its place, explained nothing."""
    gravity = {"gravity": {"g_x": 0.0, "g_y": -4.0, "g_z": 0.0}}
    causes = {"stuck_hole": {"tendon": 2.0, "s": 0.15}, **gravity}
    own = problem_of(measured(causes, robot=ROBOT, model=FRICTIONAL))
    state = state_of(own)
    beside = fit(own, (effect("gravity"),), [gravity])
    state = replace(state.with_fit(beside), best=beside)
    best = search_places(searching(), state, [beside]).best
    assert best.names == ("gravity", "stuck_hole (tendon = 2, s = 0.15)")
    assert best.cost < 1.5 * own.count < 0.2 * beside.cost
