"""Exchanges of effects: what a better effect makes unnecessary is dropped with it."""

from dataclasses import replace

import numpy as np
from identify_data import ROBOT, measured

from tdcr_fe.effects import effect
from tdcr_fe.identify.fitting import fit
from tdcr_fe.identify.forward import ForwardModel
from tdcr_fe.identify.problem import FitProblem, evaluate
from tdcr_fe.identify.search_state import Search, SearchState, without
from tdcr_fe.identify.selection import with_intermediate_models
from tdcr_fe.identify.settings import IdentifySettings
from tdcr_fe.identify.swaps import swap_effects


def test_effects_that_an_exchange_makes_unnecessary_are_dropped():
    """A blind set (precurvature and stiffness) ended with five effects, three of them of no size.

    Gravity had been added first, then others that mend what it leaves; the true ones took the places of two.
    """
    data = measured({"precurvature": {"kappa_x": 0.8, "kappa_y": -0.5}})
    held_out = np.isin([r.step for r in data.readings], (3, 7, 9))
    own = FitProblem.of(data, np.full(len(held_out), 1e-4), held_out, ForwardModel())
    effects = tuple(effect(n) for n in ("gravity", "marker_offset"))
    start = {e.name: dict(e.null_values(own.experiment)) for e in effects}
    wrong = fit(own, effects, [start])
    state = SearchState.start(own, evaluate(own, (), {})).with_fit(wrong)
    state = SearchState(**{**vars(state), "best": wrong})
    *_, last = swap_effects(Search(IdentifySettings(), lambda text, share: None), state)
    assert last.best.names == ("precurvature",)


def test_a_smaller_model_that_cannot_come_near_is_not_fitted_to_the_end_before_it_is_reported():
    """Without gravity a blind set took seven runs to a misfit 140 times that of the best model."""
    truth = {
        "gravity": {"g_x": 3.0, "g_y": -6.0, "g_z": -7.0},
        "superelastic": {"threshold_strain": 4e-4, "plateau_ratio": 0.6},
    }
    data = measured(truth, robot=ROBOT)
    count = len(data.readings)
    own = FitProblem.of(data, np.full(count, 1e-4), np.zeros(count, dtype=bool), ForwardModel())
    gravity, other = effect("gravity"), effect("superelastic")
    best = fit(own, (gravity, other), [truth])
    state = replace(SearchState.start(own, evaluate(own, (), {})).with_fit(best), best=best)
    before = own.forward.runs
    state, smaller = without(state, gravity)
    assert smaller.given_up and smaller.cost > 10.0 * best.cost and own.forward.runs - before <= 3
    reported = with_intermediate_models(replace(state, best=replace(best, effects=(other, gravity))))
    whole = reported.fits[frozenset({"superelastic"})]
    assert not whole.given_up and whole.cost <= smaller.cost
