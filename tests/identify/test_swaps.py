"""Exchanges of effects: what a better effect makes unnecessary is dropped with it."""

import numpy as np
from identify_data import measured

from tdcr_fe.effects import effect
from tdcr_fe.identify.fitting import fit
from tdcr_fe.identify.forward import ForwardModel
from tdcr_fe.identify.problem import FitProblem, evaluate
from tdcr_fe.identify.search_state import Search, SearchState
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
