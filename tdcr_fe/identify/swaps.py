"""Swaps: each effect of the best model replaced by others; those that explain as much are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.identify.backward import backward_selection
from tdcr_fe.identify.candidates import fit_and_rank, identifiable, scores_beside
from tdcr_fe.identify.criteria import (
    BIC_DIFFERENCE,
    BOUND_PENALTY,
    at_bound,
    bic,
    effective_noise,
    is_improvement,
    rank,
    reduced_chi_square,
)
from tdcr_fe.identify.problem import Point
from tdcr_fe.identify.screening import Score
from tdcr_fe.identify.search_state import Search, SearchState, Stage, with_rival, without
from tdcr_fe.identify.time_limit import EXCHANGES

Array = NDArray[np.float64]

#: Repetitions of swapping, at most.
REPETITIONS = 3


def swap_effects(search: Search, state: SearchState) -> Stage:
    """Replace each effect by others; name those that explain as much, take those that explain more."""
    for _ in range(REPETITIONS):
        state, swapped = _swap_one(search, replace(state, rivals={}))
        yield state
        if not swapped:
            break
        # A better effect may make others unnecessary that were added beside the one it replaces.
        state = yield from backward_selection(search, state)
    state = _with_rival_sets(search, state)
    yield state
    return state


def _swap_one(search: Search, state: SearchState) -> tuple[SearchState, bool]:
    """Try others in place of each effect until one explains more; indistinguishable rivals found so far are kept."""
    for e in state.best.effects:
        if search.late:
            return state.without_trying(EXCHANGES), False
        state, rest = without(state, e)
        state, every = scores_beside(state, rest)
        scores = [x for x in every if x.effect.name != e.name and x.starts]
        margin = state.best.cost * 1.5 + 60.0
        chosen = [x for i, x in enumerate(scores) if i < 3 or x.cost(state.problem) < margin]
        most = rest.cost - 0.3 * max(1e-9, rest.cost - state.best.cost)
        worth = [x for x in chosen[: search.settings.candidates] if x.cost(state.problem) <= most]
        if at_bound(state.problem, state.best, e):
            worth += [x for x in scores if x not in worth and _as_good_alone(state, x.effect.name, e.name)]
        worth = [x for x in worth if identifiable(state.problem, rest, x)]
        # Fitted alone, the rest may have moved far away: the fits may begin beside its values in the best model, too.
        beside = {x.name: state.best.values[x.name] for x in rest.effects}
        more = {x.effect.name: _starts_beside(state, x, beside) for x in worth if beside}
        noise = effective_noise(state.problem, state.best, search.significance)
        state, raced = fit_and_rank(
            search,
            state,
            [(rest, x) for x in worth],
            state.best.cost,
            0.75,
            more,
            margin=2.0 * BIC_DIFFERENCE * noise,
        )
        problem, best = state.problem, state.best
        for _, x, other in raced:
            if not other.solved:
                continue
            difference = rank(problem, other) - rank(problem, best)
            if difference / reduced_chi_square(problem, best) < -BIC_DIFFERENCE and is_improvement(
                problem, other, rest, search.significance
            ):
                yields = at_bound(problem, best) and bic(problem, other) > bic(problem, best)
                why = "nearly as good, and not at a bound" if yields else "it explains more"
                state = state.with_history(f"{x.effect.name} in place of {e.name}: {why}")
                return replace(state, best=other), True
            alike = bic(problem, other) - bic(problem, best) < BIC_DIFFERENCE * noise
            if alike and at_bound(problem, best, e) and not at_bound(problem, other):
                sentence = f"{x.effect.name} in place of {e.name}: as good within noise, and not at a bound"
                return replace(state.with_history(sentence), best=other), True
            if alike:
                state = with_rival(state, e.name, x.effect.name)
    return state, False


def _as_good_alone(state: SearchState, name: str, other: str) -> bool:
    """Whether one effect alone was fitted and explains nearly as much as another one alone."""
    a, b = (state.fits.get(frozenset({n})) for n in (name, other))
    return a is not None and b is not None and a.solved and a.cost <= (1.0 + BOUND_PENALTY) * b.cost


def _starts_beside(state: SearchState, score: Score, values: Point) -> list[Point]:
    """Where a fit may begin beside other effects at these values: as predicted, and as alone where that is known."""
    name = score.effect.name
    alone = state.fits.get(frozenset({name}))
    found = [{**values, name: score.starts[0][name]}]
    return found if alone is None else [*found, {**values, name: alone.values[name]}]


def _with_rival_sets(search: Search, state: SearchState) -> SearchState:
    """Name effects of other models of the same size that explain as much, each beside the effect it resembles."""
    state, scores = scores_beside(state, state.declared)
    signatures = {x.effect.name: x.signature for x in scores}
    problem, best = state.problem, state.best
    noise = effective_noise(problem, best, search.significance)
    mine = set(best.names)
    for key, other in state.fits.items():
        if not other.solved or len(key) != len(mine) or len(key & mine) > len(mine) - 2:
            continue
        if bic(problem, other) - bic(problem, best) >= BIC_DIFFERENCE * noise:
            continue
        for name in key - mine:
            likeness = {e: _similarity(signatures.get(e), signatures.get(name)) for e in mine - key}
            like = max(likeness, key=lambda e: likeness[e])
            state = with_rival(state, like, name)
    return state


def _similarity(a: Array | None, b: Array | None) -> float:
    """Largest cosine between the sensitivities of two effects; zero where one is not known."""
    if a is None or b is None or not a.size or not b.size:
        return 0.0
    first, second = np.linalg.qr(a)[0], np.linalg.qr(b)[0]
    return float(np.linalg.svd(first.T @ second, compute_uv=False)[0])
