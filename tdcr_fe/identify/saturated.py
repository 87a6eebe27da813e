"""Effects beside a local cause that saturates: a hole that holds its tendon fast hides what else is missing.

With the tendon held in the wrong way, no other effect fits; and the hole alone explains too little, or makes held-out
steps worse. So the two are tried as one step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from tdcr_fe.effects import Effect, EffectAtPlace, PlaceEffect
from tdcr_fe.identify import fitting
from tdcr_fe.identify.candidates import at_full_strength, candidate_fit, finished, identifiable, with_screened
from tdcr_fe.identify.criteria import is_improvement
from tdcr_fe.identify.local_search import MOVABLE, better_places, with_local
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.identify.screening import Score, screen
from tdcr_fe.identify.search_state import Search, SearchState, Stage, listed_names
from tdcr_fe.identify.unlisted import local_candidates

#: Local causes at full strength beside which effects are tried: so many at first, those that leave least; and in all.
CAUSES, MOST_CAUSES = 4, 16

#: Pairs that are fitted.
PAIRS = 3


class _Pair(NamedTuple):
    """A local cause at full strength and another effect.

    Attributes
    ----------
    expected : float
        BIC of the fitted readings to first order.
    cause : Fit
        The model with the local cause alone.
    score : Score
        Of the other effect beside it.
    """

    expected: float
    cause: Fit
    score: Score


def saturated_pairs(search: Search, state: SearchState) -> Stage:
    """Try a local cause that saturates together with another effect, beside the declared model."""
    if not any(isinstance(e, PlaceEffect) and e.saturates for e in state.problem.catalogue):
        return state
    search.report("local causes at full strength with another effect", 0.87)
    state, pairs = _promising_pairs(search, state)
    if not pairs:
        return state
    search.report(f"fitting {listed_names([p.score.effect.name for p in pairs])}", 0.88)
    fits = _fitted_pairs(search, state, pairs)
    for new in fits:
        state = state.with_fit(new)
    better = [
        f for f in fits if f.solved and is_improvement(state.problem, f, state.declared, search.significance)
    ]
    if better:
        state = with_local(state, better)
    yield state
    return state


def _promising_pairs(search: Search, state: SearchState) -> tuple[SearchState, list[_Pair]]:
    """The pairs that promise most; the place of the local cause is moved for as long as its best pair promises more.

    Alone, the local cause need not leave least where it is, because the other effect is missing there, too.
    """
    problem, declared = state.problem, state.declared
    waiting = sorted(at_full_strength(problem, declared), key=lambda f: f.cost)[:CAUSES]
    known = {f.names for f in waiting}
    pairs: list[_Pair] = []
    while waiting and not search.late:
        for cause in waiting:
            scores = screen(problem, cause, _others(state, cause))
            state = with_screened(state, scores)
            pairs += [
                _Pair(x.cost(problem) + x.count * math.log(problem.count), cause, x)
                for x in scores
                if x.starts and identifiable(problem, cause, x)
            ]
        pairs.sort(key=lambda p: p.expected)
        at = pairs[0].cause.effects[-1] if pairs else None
        assert at is None or isinstance(at, EffectAtPlace)
        near = [] if at is None else [e for e in at.neighbours(problem.data.robot) if (e.name,) not in known]
        near = near[: max(0, MOST_CAUSES - len(known))]
        known |= {(e.name,) for e in near}
        waiting = at_full_strength(problem, declared, near)
    return state, pairs[:PAIRS]


def _others(state: SearchState, cause: Fit) -> list[Effect]:
    """Candidates beside a local cause: along the whole robot, and at every place."""
    problem = state.problem
    forms = [form for e in problem.catalogue for form in e.forms(problem.experiment)]
    places = [e for family in local_candidates(problem, cause) for e in family]
    return [e for e in (*forms, *places) if e.name not in state.refused]


def _fitted_pairs(search: Search, state: SearchState, pairs: Sequence[_Pair]) -> list[Fit]:
    """Pairs fitted, and both effects moved to the places where they explain most."""
    problem = state.problem
    race = fitting.Race(state.best.cost, search.deadline)
    fits = fitting.run_fits(problem, [candidate_fit(problem, p.cause, p.score, None, race) for p in pairs])
    for _ in range(2):
        fits = [_last_first(f) for f in fits]
        fits = _moved(problem, fits, race)
    return finished(problem, fits, race)


def _moved(problem: FitProblem, fits: Sequence[Fit], race: fitting.Race) -> list[Fit]:
    """Those of which the last effect is at a place, at better places."""
    found = list(fits)
    movable = [i for i, f in enumerate(found) if isinstance(f.effects[-1], EffectAtPlace)]
    for i, new in zip(
        movable, better_places(problem, [found[i] for i in movable], {}, race, MOVABLE), strict=True
    ):
        found[i] = new
    return found


def _last_first(fit: Fit) -> Fit:
    """The same fit with its last effect first; effects act in the order of the catalogue."""
    return replace(fit, effects=(fit.effects[-1], *fit.effects[:-1]))
