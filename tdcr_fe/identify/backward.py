"""Backward selection: effects that the others of a model make unnecessary are dropped."""

from __future__ import annotations

from dataclasses import replace

from tdcr_fe.effects import Effect
from tdcr_fe.identify.criteria import bic, is_improvement
from tdcr_fe.identify.problem import Fit
from tdcr_fe.identify.search_state import Search, SearchState, Stage, without


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
