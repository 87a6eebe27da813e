"""Search of places: effects at one place, tried at every place beside several models, alone or with another effect."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from tdcr_fe.effects import Effect, EffectAtPlace, PlaceEffect
from tdcr_fe.identify import fitting
from tdcr_fe.identify.candidates import (
    Extended,
    at_full_strength,
    candidate_fit,
    finished,
    first_order_local_scores,
    identifiable,
    local_candidates,
    local_scores_beside,
    scores_beside,
    with_screened,
)
from tdcr_fe.identify.criteria import (
    BIC_DIFFERENCE,
    bic,
    is_improvement,
    reduced_chi_square,
    required_drop,
)
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.identify.screening import Score, screen
from tdcr_fe.identify.search_state import Names, Search, SearchState, Stage, listed_names, refined, without

#: A local cause is fitted before effects along the whole robot where it leaves this share of what they leave, to first
#: order [1].
AHEAD = 0.5

#: Models whose place is moved to neighbouring ones, the best first; and only while their cost is at most so many times
#: that at which a fit is of interest, fewer where the best model leaves noise.
MOVED, MOVABLE, MOVABLE_BESIDE_NOISE = 2, 10.0, 3.0

#: A place is left where its linear model does not come below so many times the cost of the place before.
OUT_OF_REACH = 10.0


def local_search(search: Search, state: SearchState) -> Stage:
    """Try single bays, and springs at one location, beside the best model, smaller ones, and the declared one."""
    bases: dict[Names, Fit] = {frozenset(): state.declared}
    if not search.explained(state):
        bases[frozenset(state.best.names)] = state.best
    for e in state.best.effects:
        state, smaller = without(state, e)
        if smaller.solved:
            bases[frozenset(smaller.names)] = smaller
    state = search_places(search, state, list(bases.values()))
    yield state
    return state


def place_ahead(search: Search, state: SearchState) -> tuple[SearchState, SearchState | None]:
    """A single local cause that leaves noise, where one promises far more than every effect along the whole robot.

    Then the fits of all other effects have a mark that they must come near, and most are stopped at once.

    Returns
    -------
    state : SearchState
        With the scores.
    located : SearchState or None
        With the model of that cause as the best one; None where there is no such cause.
    """
    declared = state.declared
    state, scores = scores_beside(state, declared)
    state, local = first_order_local_scores(state, declared)
    listed, local_cost = (
        min((x.cost(state.problem) for x in every if x.starts), default=math.inf) for every in (scores, local)
    )
    if not local_cost < AHEAD * listed:
        return state, None
    located = search_places(search, state, [declared])
    found = located.best is not state.best
    explains = found and search.explained(located)
    return state, located if explains else None


def search_places(search: Search, state: SearchState, bases: Sequence[Fit]) -> SearchState:
    """Try single bays, and springs at one location, beside the three best of the given models."""
    found: list[tuple[float, Extended]] = []
    sizes: dict[str, Mapping[str, float]] = {}
    problem = state.problem
    explained = search.is_noise(problem, state.best)
    for base in sorted(bases, key=lambda f: bic(problem, f))[:3]:
        # A local cause is fitted only if it does about as well as the best model to first order; the best candidate
        # has more margin, because the linearisation is inaccurate, unless the best model leaves noise.
        margin = 0.1 * base.cost + 5.0 * state.best.cost if base is not state.best else math.inf
        state, scored = local_scores_beside(search, state, base)
        needed = required_drop(1, search.significance, reduced_chi_square(state.problem, base))
        for x in scored:
            if x.starts:
                sizes.setdefault(x.effect.name, x.starts[0][x.effect.name])
        scores = _best_of_each_kind([x for x in scored if x.drop > needed])
        found += [
            (x.cost(state.problem), Extended(base, x))
            for i, x in enumerate(scores[:2])
            if Extended(base, x).names not in state.fits
            and x.cost(state.problem) < (margin if i or explained else max(margin, 0.6 * base.cost))
        ]
    chosen = [new for _, new in sorted(found, key=lambda p: p[0])[:3]]
    if not chosen:
        return state
    search.report(f"fitting {listed_names([x.score.effect.name for x in chosen])}", 0.9)
    race = fitting.Race(state.best.cost, search.deadline)
    fits = fitting.run_fits(state.problem, [candidate_fit(state.problem, x, None, race) for x in chosen])
    explained = explained or any(search.is_noise(state.problem, f) for f in fits)
    movable = MOVABLE_BESIDE_NOISE if explained else MOVABLE
    fits = finished(state.problem, better_places(state.problem, fits, sizes, race, movable), race)
    for new in fits:
        state = state.with_fit(new)
    fits = [
        new
        for new, x in zip(fits, chosen, strict=True)
        if new.solved and is_improvement(state.problem, new, x.parent, search.significance)
    ]
    return with_local(state, fits) if fits else state


def _best_of_each_kind(scores: Sequence[Score]) -> list[Score]:
    """The best place of every effect, and of every tendon that it may be at, in their order."""
    found: dict[tuple[object, ...], Score] = {}
    for x in scores:
        effect = x.effect
        assert isinstance(effect, EffectAtPlace)
        found.setdefault((effect.listed, effect.place.get("tendon")), x)
    return list(found.values())


def better_places(
    problem: FitProblem,
    fits: Sequence[Fit],
    sizes: Mapping[str, Mapping[str, float]],
    race: fitting.Race,
    movable: float = MOVABLE,
) -> list[Fit]:
    """Models whose last effect is at one place, moved to neighbouring places for as long as the cost falls.

    Scores find the neighbourhood of a place; how well a strong effect explains the readings there, only fits tell.

    Parameters
    ----------
    problem
        Readings.
    fits
        The models.
    sizes
        By effect at a place, the size from which a fit may begin, besides that of the place before.
    race
        With the lowest cost of all models; nothing begins after its deadline.
    movable
        A model is moved while its cost is at most so many times that at which a fit is of interest [1].
    """
    found = list(fits)
    order = sorted(range(len(found)), key=lambda i: found[i].cost)
    for i in order[:MOVED]:
        tried = {found[i].names[-1]}
        while found[i].solved and not race.out_of_time and found[i].cost <= movable * race.limit:
            effect = found[i].effects[-1]
            assert isinstance(effect, EffectAtPlace)
            near = [x for x in effect.neighbours(problem.data.robot) if x.name not in tried]
            tried |= {x.name for x in near}
            nearer = fitting.Race(found[i].cost, race.deadline, left_behind=(1.0, 0.0))
            moved = fitting.run_fits(
                problem, [_moved(problem, found[i], x, sizes.get(x.name), nearer) for x in near]
            )
            best = min(moved, key=lambda f: f.cost, default=found[i])
            if not best.cost < found[i].cost:
                break
            found[i] = best
    return found


def _moved(
    problem: FitProblem,
    fit: Fit,
    effect: EffectAtPlace,
    size: Mapping[str, float] | None,
    race: fitting.Race,
) -> fitting.Fitting:
    """A model with its last effect at another place, fitted from the same size or another, if it may win the race."""
    values = {k: v for k, v in fit.values.items() if k != fit.names[-1]}
    effects = (*fit.effects[:-1], effect)
    sizes = [*([] if size is None else [dict(size)]), fit.values[fit.names[-1]]]
    best: Fit | None = None
    for x in sizes:
        now = yield from fitting.begin(problem, effects, [{**values, effect.name: x}], race, fit)
        if best is None or fitting.reachable_cost(problem, now) < fitting.reachable_cost(problem, best):
            best = now
        if fitting.reachable_cost(problem, best) <= race.limit or race.out_of_time:
            break
    assert best is not None
    if fitting.reachable_cost(problem, best) > OUT_OF_REACH * race.limit:
        return replace(best, pruned=True)
    return (yield from fitting.descend(problem, best, race))


def with_local(state: SearchState, fits: Sequence[Fit]) -> SearchState:
    """Take the best model with an effect at a place where it explains more than the present one.

    Each place itself counts as one or two fitted numbers more.
    """
    problem = state.problem
    local = min(fits, key=lambda f: bic(problem, f))
    added = [e for e in local.effects if isinstance(e, EffectAtPlace) and e.name not in state.best.names]
    chosen = sum(len(e.place) for e in added) * math.log(problem.count)
    gain = (bic(problem, state.best) - bic(problem, local) - chosen) / reduced_chi_square(problem, local)
    if gain <= BIC_DIFFERENCE:
        return state
    rivals = {k: v for k, v in state.rivals.items() if k in local.names}
    state = replace(state.with_fit(local), best=local, rivals=rivals)
    where = " and ".join(e.name for e in added)
    verb = "explains" if len(added) == 1 else "explain"
    return refined(state.with_history(f"{where} {verb} more than effects along the whole robot"))


#: Local causes at full strength beside which effects are tried: so many at first, those that leave least; and in all.
CAUSES, MOST_CAUSES = 4, 16

#: Pairs that are fitted.
PAIRS = 3


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


def _promising_pairs(search: Search, state: SearchState) -> tuple[SearchState, list[Extended]]:
    """The pairs that promise most; the place of the local cause is moved for as long as its best pair promises more.

    Alone, the local cause need not leave least where it is, because the other effect is missing there, too.
    """
    problem, declared = state.problem, state.declared
    waiting = sorted(at_full_strength(problem, declared), key=lambda f: f.cost)[:CAUSES]
    known = {f.names for f in waiting}
    pairs: list[tuple[float, Extended]] = []  # with the BIC of the fitted readings to first order
    while waiting and not search.out_of_time:
        for cause in waiting:
            scores = screen(problem, cause, _others(state, cause))
            state = with_screened(state, scores)
            pairs += [
                (x.cost(problem) + x.count * math.log(problem.count), Extended(cause, x))
                for x in scores
                if x.starts and identifiable(problem, cause, x)
            ]
        pairs.sort(key=lambda p: p[0])
        at = pairs[0][1].parent.effects[-1] if pairs else None
        assert at is None or isinstance(at, EffectAtPlace)
        near = [] if at is None else [e for e in at.neighbours(problem.data.robot) if (e.name,) not in known]
        near = near[: max(0, MOST_CAUSES - len(known))]
        known |= {(e.name,) for e in near}
        waiting = at_full_strength(problem, declared, near)
    return state, [pair for _, pair in pairs[:PAIRS]]


def _others(state: SearchState, cause: Fit) -> list[Effect]:
    """Candidates beside a local cause: along the whole robot, and at every place."""
    problem = state.problem
    forms = [form for e in problem.catalogue for form in e.forms(problem.experiment)]
    places = [e for family in local_candidates(problem, cause) for e in family]
    return [e for e in (*forms, *places) if e.name not in state.refused]


def _fitted_pairs(search: Search, state: SearchState, pairs: Sequence[Extended]) -> list[Fit]:
    """Pairs fitted, and both effects moved to the places where they explain most."""
    problem = state.problem
    race = fitting.Race(state.best.cost, search.deadline)
    fits = fitting.run_fits(problem, [candidate_fit(problem, p, None, race) for p in pairs])
    for _ in range(2):
        fits = [_last_first(f) for f in fits]
        fits = _at_better_places(problem, fits, race)
    return finished(problem, fits, race)


def _at_better_places(problem: FitProblem, fits: Sequence[Fit], race: fitting.Race) -> list[Fit]:
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
