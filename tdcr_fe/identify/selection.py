"""Selection of effects: forward and backward; the order of the stages of a search.

Every function takes a `SearchState` and gives a new one. The stages are generators of states, so that an interruption
keeps the last one that was complete.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tdcr_fe.effects import EffectAtPlace
from tdcr_fe.identify import fitting
from tdcr_fe.identify.backward import backward_selection
from tdcr_fe.identify.candidates import fit_proposals, propose
from tdcr_fe.identify.criteria import BIC_DIFFERENCE, is_improvement, rank, residual_is_noise
from tdcr_fe.identify.information import lacks_test
from tdcr_fe.identify.law import LEAST_ITERATIONS, law_ahead
from tdcr_fe.identify.local_search import local_search, place_ahead, search_places
from tdcr_fe.identify.problem import Fit
from tdcr_fe.identify.saturated import saturated_pairs
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
)
from tdcr_fe.identify.swaps import swap_effects
from tdcr_fe.identify.time_limit import (
    EXCHANGES,
    FURTHER_EFFECTS,
    PLACES,
    SMALLER_MODELS,
    OutOfTime,
)

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
    if state.best.effects and search.late:
        state = state.without_trying(EXCHANGES)
    elif state.best.effects:
        search.report("backward selection and swaps", 0.75)
        state = yield from in_time(state, backward_selection(search, state), EXCHANGES)
        state = yield from in_time(state, swap_effects(search, state), EXCHANGES)
    if search.late:
        state = state.without_trying(PLACES)
        yield state
    elif state.best.effects or not residual_is_noise(state.problem, state.best, search.significance):
        search.report("local causes along the backbone", 0.85)
        before = state.best
        state = yield from in_time(state, local_search(search, state), PLACES)
        if state.best is not before:
            state = yield from _beside_local_cause(search, state)
        if not (search.late or residual_is_noise(state.problem, state.best, search.significance)):
            before = state.best
            state = yield from in_time(state, saturated_pairs(search, state), PLACES)
            if state.best is not before:
                state = yield from _beside_local_cause(search, state)
                state = yield from in_time(state, swap_effects(search, state), EXCHANGES)
        state = cut_short(search, state, PLACES)
        yield state
    return state


def _law_is_ahead(search: Search, state: SearchState) -> bool:
    """Whether a law on no list leaves noise, and the best listed effects do not."""
    return state.law_ahead is not None and not residual_is_noise(
        state.problem, state.best, search.significance
    )


def _beside_local_cause(search: Search, state: SearchState) -> Stage:
    """What is left beside a local cause may be an effect along the whole robot; others may be unnecessary then."""
    if not residual_is_noise(state.problem, state.best, search.significance):
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
        if (
            number > 1
            and search.late
            and not residual_is_noise(state.problem, state.best, search.significance)
        ):
            state = state.without_trying(FURTHER_EFFECTS)
            break
        progress = 0.05 + 0.65 * (1.0 - 0.5 ** (number - 1))
        located: SearchState | None = None
        if locate and not state.best.effects:
            state, located = place_ahead(search, state)
        if located is not None:
            state = replace(located, best=located.declared, rivals={})
            level = [state.declared]
        known = _ahead(state, located)
        state, proposals = propose(search, state, number, level, progress, known is not None)
        yield state
        state, fits = fit_proposals(search, state, number, proposals, progress, known)
        accepted = _accepted(search, state, fits)
        explaining = any(residual_is_noise(state.problem, f, search.significance) for f in accepted)
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
        explained = residual_is_noise(problem, best, search.significance)
        if not explained and number == 1:
            again = [fitting.descend(problem, f, fitting.Race(), 5) for f in others]
            others = fitting.run_fits(problem, again)
        level = [best] if explained or number > 1 else [best, *others]
        if explained or not locate or search.late:
            continue
        before = state.best
        state = yield from _causes_ahead(search, state, number, state.problem.forward.iterations - begun)
        if state.best is not before:
            level = [state.best]
            if residual_is_noise(state.problem, state.best, search.significance):
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
    """After a round that leaves more than noise: a single local cause as the best model, or a law on no list ahead."""
    if number == 1:
        state = _with_local_cause(search, state)
        yield state
    if not any(isinstance(e, EffectAtPlace) for e in state.best.effects):
        state = law_ahead(search, state, max(LEAST_ITERATIONS, iterations))
    yield state
    return state


def _ahead(state: SearchState, located: SearchState | None) -> Fit | None:
    """A model that leaves noise, which further effects must come near: a local cause, or a law on no list."""
    if located is not None:
        return located.best
    return None if state.law_ahead is None else state.law_ahead.fit.as_fit()


def _with_local_cause(search: Search, state: SearchState) -> SearchState:
    """A single local cause in place of the best effect along the whole robot, if it explains everything or nearly so.

    The search for several effects that mimic it is then skipped.
    """
    located = search_places(search, state, [state.declared])
    if located.best is not state.best:
        explains = residual_is_noise(located.problem, located.best, search.significance)
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
        if known is None or not known.solved or known.given_up:
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
