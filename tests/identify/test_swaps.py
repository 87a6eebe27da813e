"""Exchanges of effects: what a better effect makes unnecessary is dropped with it."""

from dataclasses import replace

from identify_data import GRAVITY, ROBOT, measured, problem_of, searching, state_of

from tdcr_fe.effects import effect
from tdcr_fe.identify.fitting import fit
from tdcr_fe.identify.search import swap_effects, with_intermediate_models
from tdcr_fe.identify.search_state import without


def test_effects_that_an_exchange_makes_unnecessary_are_dropped():
    """A blind set (precurvature and stiffness) ended with five effects, three of them of no size.

    Gravity had been added first, then others that mend what it leaves; the true ones took the places of two.
    """
    data = measured({"precurvature": {"kappa_x": 0.8, "kappa_y": -0.5}})
    own = problem_of(data, held=(3, 7, 9))
    effects = tuple(effect(n) for n in ("gravity", "marker_offset"))
    start = {e.name: dict(e.null_values(own.experiment)) for e in effects}
    wrong = fit(own, effects, [start])
    state = replace(state_of(own).with_fit(wrong), best=wrong)
    *_, last = swap_effects(searching(), state)
    assert last.best.names == ("precurvature",)


def test_a_smaller_model_that_cannot_come_near_is_not_fitted_to_the_end_before_it_is_reported():
    """Without gravity a blind set took seven runs to a misfit 140 times that of the best model."""
    truth = {**GRAVITY, "superelastic": {"threshold_strain": 4e-4, "plateau_ratio": 0.6}}
    own = problem_of(measured(truth, robot=ROBOT))
    gravity, other = effect("gravity"), effect("superelastic")
    best = fit(own, (gravity, other), [truth])
    state = replace(state_of(own).with_fit(best), best=best)
    before = own.forward.runs
    state, smaller = without(state, gravity)
    assert smaller.pruned and smaller.cost > 10.0 * best.cost and own.forward.runs - before <= 3
    reported = with_intermediate_models(replace(state, best=replace(best, effects=(other, gravity))))
    whole = reported.fits[frozenset({"superelastic"})]
    assert not whole.pruned and whole.cost <= smaller.cost
