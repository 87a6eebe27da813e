"""Search of places: effects at one place, tried at every place beside several models."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from tdcr_fe.effects import EffectAtPlace
from tdcr_fe.identify import fitting
from tdcr_fe.identify.candidates import candidate_fit, local_scores_beside, names_with
from tdcr_fe.identify.criteria import (
    BIC_DIFFERENCE,
    bic,
    is_improvement,
    reduced_chi_square,
    required_drop,
    residual_is_noise,
)
from tdcr_fe.identify.problem import Fit
from tdcr_fe.identify.screening import Score
from tdcr_fe.identify.search_state import (
    Names,
    Search,
    SearchState,
    Stage,
    listed_names,
    refined,
    without,
)


def local_search(search: Search, state: SearchState) -> Stage:
    """Try single bays, and springs at one location, beside the best model, smaller ones, and the declared one."""
    bases: dict[Names, Fit] = {frozenset(): state.declared}
    if not residual_is_noise(state.problem, state.best, search.significance):
        bases[frozenset(state.best.names)] = state.best
    for e in state.best.effects:
        state, smaller = without(state, e)
        if smaller.solved:
            bases[frozenset(smaller.names)] = smaller
    state = search_places(search, state, list(bases.values()))
    yield state
    return state


def search_places(search: Search, state: SearchState, bases: Sequence[Fit]) -> SearchState:
    """Try single bays, and springs at one location, beside the three best of the given models."""
    found: list[tuple[float, Fit, Score]] = []
    problem = state.problem
    for base in sorted(bases, key=lambda f: bic(problem, f))[:3]:
        # A local cause is fitted only if it does about as well as the best model to first order; the best candidate
        # has more margin, because the linearisation is inaccurate.
        margin = 0.1 * base.cost + 5.0 * state.best.cost if base is not state.best else math.inf
        state, scored = local_scores_beside(state, base)
        needed = required_drop(1, search.significance, reduced_chi_square(state.problem, base))
        scores = [x for x in scored if x.drop > needed]
        found += [
            (x.cost(state.problem), base, x)
            for i, x in enumerate(scores[:2])
            if names_with(base, x) not in state.fits
            and x.cost(state.problem) < (margin if i else max(margin, 0.6 * base.cost))
        ]
    chosen = [(base, score) for _, base, score in sorted(found, key=lambda p: p[0])[:3]]
    if not chosen:
        return state
    search.report(f"fitting {listed_names([score.effect.name for _, score in chosen])}", 0.9)
    race = fitting.Race(state.best.cost, search.deadline)
    fits = fitting.run_fits(state.problem, [candidate_fit(state.problem, b, x, race) for b, x in chosen])
    fits = [
        new
        for new, (base, _) in zip(fits, chosen, strict=True)
        if new.solved and is_improvement(state.problem, new, base, search.significance)
    ]
    return _with_local(state, fits) if fits else state


def _with_local(state: SearchState, fits: Sequence[Fit]) -> SearchState:
    """Take the best model with an effect at a place where it explains more than the present one.

    The place itself counts as one or two fitted numbers more.
    """
    problem = state.problem
    local = min(fits, key=lambda f: bic(problem, f))
    effect = local.effects[-1]
    assert isinstance(effect, EffectAtPlace)
    chosen = len(effect.place) * math.log(problem.count)
    gain = (bic(problem, state.best) - bic(problem, local) - chosen) / reduced_chi_square(problem, local)
    if gain <= BIC_DIFFERENCE:
        return state
    rivals = {k: v for k, v in state.rivals.items() if k in local.names}
    state = replace(state.with_fit(local), best=local, rivals=rivals)
    return refined(state.with_history(f"{effect.name} explains more than effects along the whole robot"))
