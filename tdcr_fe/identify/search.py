"""The search for effects: forward and backward selection, exchanges, and the order of these stages.

Every function takes a `SearchState` and gives a new one. The stages are generators of states, so that an interruption
keeps the last one that was complete.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Effect, EffectAtPlace
from tdcr_fe.identify import fitting
from tdcr_fe.identify.candidates import (
    Contest,
    Extended,
    Round,
    fit_and_rank,
    fit_proposals,
    identifiable,
    propose,
    scores_beside,
)
from tdcr_fe.identify.criteria import (
    BIC_DIFFERENCE,
    BOUND_PENALTY,
    at_bound,
    bic,
    effective_noise,
    is_improvement,
    lacks_test,
    rank,
    reduced_chi_square,
)
from tdcr_fe.identify.law_search import LEAST_ITERATIONS, law_ahead
from tdcr_fe.identify.places import local_search, place_ahead, saturated_pairs, search_places
from tdcr_fe.identify.problem import Fit, Point
from tdcr_fe.identify.screening import Score
from tdcr_fe.identify.search_state import (
    Search,
    SearchState,
    Stage,
    cut_short,
    fitted_model,
    in_time,
    listed_names,
    mean_cost,
    parent_of,
    refined,
    with_rival,
    without,
)
from tdcr_fe.identify.settings import EXCHANGES, FURTHER_EFFECTS, PLACES, SMALLER_MODELS, OutOfTime


def backward_selection(search: Search, state: SearchState) -> Stage:
    """Backward selection: drop effects that the others make unnecessary."""
    while len(state.best.effects) > 1:
        unnecessary: list[tuple[Effect, Fit]] = []
        for e in state.best.effects:
            state, smaller = without(state, e)
            if smaller.solved and not is_improvement(state.problem, state.best, smaller, search.significance):
                unnecessary.append((e, smaller))
        if not unnecessary:
            break
        problem = state.problem
        e, best = min(unnecessary, key=lambda p: bic(problem, p[1]))
        state = replace(state, best=best).with_history(f"{e.name} dropped: the others suffice")
        yield state
    return state


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
        if search.out_of_time:
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
        contest = Contest(state.best.cost, 0.75, more, margin=2.0 * BIC_DIFFERENCE * noise)
        state, fits = fit_and_rank(search, state, [Extended(rest, x) for x in worth], contest)
        problem, best = state.problem, state.best
        for (_, x), other in fits:
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


#: A local cause that leaves less than so much of the misfit of the best effect along the whole robot is kept [1].
FAR_AHEAD = 0.1

#: An effect beyond so many is added only where it removes at least so much of the misfit on held-out steps [1].
MANY_EFFECTS, WORTHWHILE = 4, 0.1


def search_effects(search: Search, state: SearchState) -> Stage:
    """The whole search."""
    search.report("forward selection", 0.05)
    if lacks_test(state.problem, state.declared):
        # Too few readings to separate several effects, or to locate a cause: one effect, at most.
        single = replace(search, settings=replace(search.settings, max_effects=1))
        one = forward_selection(single, state, locate=False)
        return (yield from in_time(state, one, FURTHER_EFFECTS))
    state = yield from in_time(state, forward_selection(search, state), FURTHER_EFFECTS)
    if _law_is_ahead(search, state):
        return state
    if state.best.effects and search.out_of_time:
        state = state.without_trying(EXCHANGES)
    elif state.best.effects:
        search.report("backward selection and swaps", 0.75)
        state = yield from in_time(state, backward_selection(search, state), EXCHANGES)
        state = yield from in_time(state, swap_effects(search, state), EXCHANGES)
    if search.out_of_time:
        state = state.without_trying(PLACES)
        yield state
    elif state.best.effects or not search.explained(state):
        search.report("local causes along the backbone", 0.85)
        before = state.best
        state = yield from in_time(state, local_search(search, state), PLACES)
        if state.best is not before:
            state = yield from _beside_local_cause(search, state)
        if not (search.out_of_time or search.explained(state)):
            before = state.best
            state = yield from in_time(state, saturated_pairs(search, state), PLACES)
            if state.best is not before:
                state = yield from _beside_local_cause(search, state)
                state = yield from in_time(state, swap_effects(search, state), EXCHANGES)
        state = cut_short(search, state, PLACES)
        yield state
    return state


def _law_is_ahead(search: Search, state: SearchState) -> bool:
    """Whether an unlisted law leaves noise, and the best listed effects do not."""
    return state.law_ahead is not None and not search.explained(state)


def _beside_local_cause(search: Search, state: SearchState) -> Stage:
    """What is left beside a local cause may be an effect along the whole robot; others may be unnecessary then."""
    if not search.explained(state):
        beside = forward_selection(search, state, locate=False)
        state = yield from in_time(state, beside, FURTHER_EFFECTS)
    return (yield from in_time(state, backward_selection(search, state), EXCHANGES))


def forward_selection(search: Search, state: SearchState, locate: bool = True) -> Stage:
    """Forward selection: add one effect at a time, several models in parallel (beam search).

    An effect that data show only beside another one comes with that one, as one step.

    ``locate``: after the first round, see whether a single local cause explains everything.
    """
    level, begun = [state.best], state.problem.forward.iterations
    for number in range(1, search.settings.max_effects + 1):
        if len(state.best.effects) >= search.settings.max_effects:
            break
        if number > 1 and search.out_of_time and not search.explained(state):
            state = state.without_trying(FURTHER_EFFECTS)
            break
        progress = 0.05 + 0.65 * (1.0 - 0.5 ** (number - 1))
        located: SearchState | None = None
        if locate and not state.best.effects:
            state, located = place_ahead(search, state)
        if located is not None:
            state = replace(located, best=located.declared, rivals={})
            level = [state.declared]
        this = Round(number, progress, _ahead(state, located))
        state, proposals = propose(search, state, this, level)
        yield state
        state, fits = fit_proposals(search, state, this, proposals)
        accepted = _accepted(search, state, fits)
        explaining = any(search.is_noise(state.problem, f) for f in accepted)
        if located is not None and not explaining:
            state = replace(state, best=located.best).with_history(
                "no effect along the whole robot explains as much"
            )
            break
        if not explaining and _law_is_ahead(search, state):
            state = state.with_history("no further listed effect explains as much")
            break
        if not accepted:
            reason = "improves fitted and held-out steps" if proposals else "is significant"
            state = state.with_history(f"round {number}: no candidate {reason}")
            break
        state = refined(replace(state, best=accepted[0]))
        problem, best = state.problem, state.best
        state = state.with_history(
            f"round {number}: {listed_names(best.names)}, misfit per reading "
            f"{mean_cost(best.cost, problem.fitted):.3g} on fitted and "
            f"{mean_cost(best.held_cost, problem.held_out):.3g} on held-out steps"
        )
        yield state
        others = [state.fits[frozenset(f.names)] for f in accepted[1 : search.settings.beam]]
        explained = search.is_noise(problem, best)
        if not explained and number == 1:
            again = [fitting.descend(problem, f, fitting.Race(), 5) for f in others]
            others = fitting.run_fits(problem, again)
        level = [best] if explained or number > 1 else [best, *others]
        if explained or not locate or search.out_of_time:
            continue
        before = state.best
        state = yield from _causes_ahead(search, state, number, state.problem.forward.iterations - begun)
        if state.best is not before:
            level = [state.best]
            if search.explained(state):
                break
    yield state
    return state


def _accepted(search: Search, state: SearchState, fits: Sequence[Fit]) -> list[Fit]:
    """Models that improve on those that they contain and on the best one, in their order."""
    return [
        f
        for f in fits
        if is_improvement(state.problem, f, parent_of(state, f), search.significance)
        and _better(state, f)
        and _worthwhile(state, f)
    ]


def _causes_ahead(search: Search, state: SearchState, number: int, iterations: int) -> Stage:
    """After a round that leaves more than noise: a single local cause as the best model, or an unlisted law ahead."""
    if number == 1:
        state = _with_local_cause(search, state)
        yield state
    if not any(isinstance(e, EffectAtPlace) for e in state.best.effects):
        state = law_ahead(search, state, max(LEAST_ITERATIONS, iterations))
    yield state
    return state


def _ahead(state: SearchState, located: SearchState | None) -> Fit | None:
    """A model that leaves noise, which further effects must come near: a local cause, or an unlisted law."""
    if located is not None:
        return located.best
    return None if state.law_ahead is None else state.law_ahead.fit.as_fit()


def _with_local_cause(search: Search, state: SearchState) -> SearchState:
    """A single local cause in place of the best effect along the whole robot, if it explains everything or nearly so.

    The search for several effects that mimic it is then skipped.
    """
    located = search_places(search, state, [state.declared])
    if located.best is not state.best:
        explains = search.explained(located)
        if explains or located.best.cost < FAR_AHEAD * state.best.cost:
            return located
    problem = replace(state.problem, scales=located.problem.scales)
    return replace(state, local_scores=located.local_scores, problem=problem)


def with_intermediate_models(state: SearchState) -> SearchState:
    """Fit the models between the declared and the best one where a swap has skipped them, as far as time suffices."""
    effects = state.best.effects
    for i in range(1, len(effects)):
        part = effects[:i]
        known = state.fits.get(frozenset(e.name for e in part))
        if known is None or not known.solved or known.pruned:
            values = state.best.values if known is None or not known.solved else known.values
            try:
                state, _ = fitted_model(state, part, [{e.name: values[e.name] for e in part}], whole=True)
            except OutOfTime:
                return state.without_trying(SMALLER_MODELS)
    return state


def _better(state: SearchState, fit: Fit) -> bool:
    """Whether a model is better than the best so far, which need not be contained in it."""
    return rank(state.problem, fit) < rank(state.problem, state.best) - BIC_DIFFERENCE


def _worthwhile(state: SearchState, fit: Fit) -> bool:
    """Whether a model with many effects removes enough of the misfit that the best one leaves, on held-out steps."""
    if len(fit.effects) <= MANY_EFFECTS:
        return True
    before, after = (f.held_cost if np.any(state.problem.held_out) else f.cost for f in (state.best, fit))
    return after <= (1.0 - WORTHWHILE) * before
