"""Selection of effects: forward and backward; the order of the stages of a search.

Every function takes a `SearchState` and gives a new one. The stages are generators of states, so that an interruption
keeps the last one that was complete.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tdcr_fe.identify import fitting
from tdcr_fe.identify.backward import backward_selection
from tdcr_fe.identify.candidates import fit_proposals, propose
from tdcr_fe.identify.criteria import BIC_DIFFERENCE, is_improvement, rank, residual_is_noise
from tdcr_fe.identify.information import lacks_test
from tdcr_fe.identify.local_search import local_search, place_ahead, search_places
from tdcr_fe.identify.problem import Fit
from tdcr_fe.identify.saturated import saturated_pairs
from tdcr_fe.identify.search_state import (
    Search,
    SearchState,
    Stage,
    fitted_model,
    in_time,
    listed_names,
    mean_cost,
    parent_of,
    refined,
)
from tdcr_fe.identify.swaps import swap_effects
from tdcr_fe.identify.time_limit import EXCHANGES, FURTHER_EFFECTS, PLACES, SMALLER_MODELS, OutOfTime

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
    return state


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
    level = [state.best]
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
        state, proposals = propose(search, state, number, level, progress, located is not None)
        yield state
        known = None if located is None else located.best
        state, fits = fit_proposals(search, state, number, proposals, progress, known)
        accepted = [
            f
            for f in fits
            if is_improvement(state.problem, f, parent_of(state, f), search.significance)
            and _better(state, f)
            and _worthwhile(state, f)
        ]
        explaining = any(residual_is_noise(state.problem, f, search.significance) for f in accepted)
        if located is not None and not explaining:
            state = replace(state, best=located.best).with_history(
                "no effect along the whole robot explains as much"
            )
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
        if number == 1 and not explained and locate and not search.late:
            state, taken = _with_local_cause(search, state)
            if taken and residual_is_noise(state.problem, state.best, search.significance):
                break
            level = [state.best] if taken else level
    yield state
    return state


def _with_local_cause(search: Search, state: SearchState) -> tuple[SearchState, bool]:
    """A single local cause in place of the best effect along the whole robot, if it explains everything or nearly so.

    The search for several effects that mimic it is then skipped.

    Returns
    -------
    state : SearchState
    taken : bool
        Whether there is such a cause.
    """
    located = search_places(search, state, [state.declared])
    if located.best is not state.best:
        explains = residual_is_noise(located.problem, located.best, search.significance)
        if explains or located.best.cost < FAR_AHEAD * state.best.cost:
            return located, True
    problem = replace(state.problem, scales=located.problem.scales)
    return replace(state, local_scores=located.local_scores, problem=problem), False


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
