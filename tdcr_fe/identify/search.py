"""The search for causes: forward selection over one dictionary, with exchanges and a backward step.

Every round linearises the present model by all causes of the dictionary (`tdcr_fe.identify.screening`), fits the few
that promise most, alone and in pairs, and keeps the best. It ends where only noise is left, or nothing improves the
evidence. Then every cause is exchanged for others, which gives the probabilities of the explanations.

The functions are generators of states, so that an interruption keeps the last one that was complete.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tdcr_fe.effects import Effect, EffectAtPlace
from tdcr_fe.identify import fitting
from tdcr_fe.identify.criteria import (
    BIC_DIFFERENCE,
    at_bound,
    bic,
    effective_noise,
    is_improvement,
    lacks_test,
    price,
    rank,
    reduced_chi_square,
    required_drop,
)
from tdcr_fe.identify.dictionary import dictionary
from tdcr_fe.identify.forward import Job
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.identify.result import Candidate
from tdcr_fe.identify.screening import Score, best_pairs, screen
from tdcr_fe.identify.search_state import (
    Search,
    SearchState,
    Stage,
    in_time,
    listed_names,
    mean_cost,
    parent_of,
    refined,
    with_note_on_differences,
    with_rival,
)
from tdcr_fe.identify.settings import EXCHANGES, FURTHER_EFFECTS
from tdcr_fe.model.loading import resolve


def search_causes(search: Search, state: SearchState) -> Stage:
    """The whole search."""
    problem = state.problem
    search.report("the dictionary of causes", 0.03)
    (run,) = problem.run([Job(problem.experiment, state.declared.run, states=True)])
    assert run.bays is not None
    state = replace(state, dictionary=dictionary(problem, run.bays))
    state = yield from in_time(state, forward_selection(search, state), FURTHER_EFFECTS)
    if state.best.effects and search.out_of_time:
        state = state.without_trying(EXCHANGES)
    elif state.best.effects:
        search.report("exchanges", 0.75)
        state = yield from in_time(state, exchange(search, state), EXCHANGES)
    yield state
    return state


# -------------------------------------------------------------------------------------------------- candidates


def scores_beside(state: SearchState, fit: Fit) -> tuple[SearchState, Sequence[Score], Fit]:
    """Scores of all causes of the dictionary beside a fitted model, computed once; and the model as a reference."""
    key = frozenset(fit.names)
    if key not in state.scores:
        known = {e.listed for e in fit.effects}
        others = [e for e in state.dictionary if e.listed not in known and e.name not in state.refused]
        scores, reference = screen(state.problem, fit, others)
        state = replace(state, scores={**state.scores, key: (scores, reference)})
        state = with_screened(state, scores)
        if not fit.effects:
            refused = {x.effect.name: x.note for x in scores if x.note and not x.effect.after}
            state = replace(state, refused={**state.refused, **refused})
    scores, reference = state.scores[key]
    return state, scores, reference


def with_screened(state: SearchState, scores: Sequence[Score]) -> SearchState:
    """Typical steps of parameters, as the scores found them; and what had no derivative."""
    scales = dict(state.problem.scales)
    for score in scores:
        scales |= score.scales
        why = {(score.effect.name, name): reason for name, reason in score.differenced.items()}
        state = with_note_on_differences(state, why)
    return replace(state, problem=replace(state.problem, scales=scales))


def promised(problem: FitProblem, fit: Fit, score: Score) -> float:
    """Criterion over the fitted readings that a candidate promises to first order, with its prior."""
    own = score.count * math.log(problem.count) + price(score.effects, problem.data.robot)
    return fit.cost - score.drop + own


def worth_fitting(search: Search, problem: FitProblem, fit: Fit, scores: Sequence[Score]) -> list[Score]:
    """Candidates that promise more than chance and leave degrees of freedom, the most promising first."""
    noise = reduced_chi_square(problem, fit)
    spare = int(np.count_nonzero(problem.fitted)) - len(fit.free)
    found = [
        x
        for x in scores
        if x.starts and x.count < spare and x.drop > required_drop(x.count, search.significance, noise)
    ]
    return sorted(found, key=lambda x: promised(problem, fit, x))


def distinct(scores: Sequence[Score], most: int) -> list[Score]:
    """The first of those whose predictions differ, at most so many."""
    found: list[Score] = []
    changes: list[np.ndarray] = []
    for x in scores:
        if len(found) >= most:
            break
        change = x.predicted
        size = max(float(np.linalg.norm(change)), 1e-300)
        alike = [y for y, c in zip(found, changes, strict=True) if np.linalg.norm(change - c) < 1e-6 * size]
        if any(y.names == x.names for y in alike):
            continue
        found.append(x)
        changes.append(change)
    return found


# ------------------------------------------------------------------------------------------------------- fits


def fit_candidates(
    search: Search, state: SearchState, parent: Fit, scores: Sequence[Score], most: int
) -> tuple[SearchState, list[Fit]]:
    """Fit models with candidates beside a model; all are evaluated at their predicted values, the best fitted."""
    problem = state.problem
    new = [x for x in scores if frozenset({*parent.names, *x.names}) not in state.fits]
    race = fitting.Race(state.best.cost, search.deadline)
    begun: list[tuple[float, Fit, Score]] = []
    for x in new:
        effects = (*parent.effects, *x.effects)
        (now,) = fitting.run_fits(problem, [fitting.begin(problem, effects, x.starts[:1], fitting.Race(), parent)])
        if not now.cost < parent.cost and len(x.starts) > 1:
            more = [fitting.begin(problem, effects, x.starts[1:], fitting.Race(), parent)]
            now = min(now, *fitting.run_fits(problem, more), key=lambda f: f.cost)
        if now.solved:
            outlook = fitting.reachable_cost(problem, now)
            begun.append((outlook + len(now.free) * math.log(problem.count), now, x))
    begun.sort(key=lambda b: b[0])
    for _, now, x in begun[:most]:
        if search.out_of_time and state.best.effects:
            break
        (now,) = fitting.run_fits(problem, [fitting.descend(problem, now, race, 8, x.predicted)])
        race.reached(now.cost)
        if now.cost <= race.limit:
            (now,) = fitting.run_fits(problem, [fitting.finish(problem, replace(now, pruned=False), race)])
        state = with_note_on_differences(state.with_fit(now), now.differenced)
    keys = [frozenset({*parent.names, *x.names}) for x in scores]
    return state, [state.fits[k] for k in keys if k in state.fits and state.fits[k].solved]


def refitted(state: SearchState, effects: Sequence[Effect]) -> tuple[SearchState, Fit]:
    """A part of the best model, fitted from its values, or as it was fitted before."""
    key = frozenset(e.name for e in effects)
    if not effects:
        return state, state.fits.get(key, state.declared)
    if key not in state.fits or state.fits[key].pruned:
        problem, best = state.problem, state.best
        start = {e.name: best.values[e.name] for e in effects}
        try:
            problem.with_effects(effects, start)
        except ValueError:
            return state, replace(best, cost=math.inf, held_cost=math.inf)
        fits = [fitting.smaller(problem, effects, [start], best, fitting.Race())]
        (new,) = fitting.run_fits(problem, fits)
        state = state.with_fit(new)
    return state, state.fits[key]


# --------------------------------------------------------------------------------------------------- selection


def forward_selection(search: Search, state: SearchState) -> Stage:
    """Add the cause, or the pair, that gives the best model, as long as the evidence grows."""
    settings = search.settings
    most_effects = 1 if lacks_test(state.problem, state.declared) else settings.max_effects
    for number in range(1, most_effects + 1):
        if search.explained(state) or len(state.best.effects) >= most_effects:
            break
        if number > 1 and search.out_of_time:
            state = state.without_trying(FURTHER_EFFECTS)
            break
        progress = 0.05 + 0.65 * (1.0 - 0.5 ** (number - 1))
        search.report(f"round {number}: candidates beside {listed_names(state.best.names) or 'the declared model'}", progress)
        parent = state.best
        state, scores, reference = scores_beside(state, parent)
        problem = state.problem
        chosen = worth_fitting(search, problem, parent, scores)
        singles = distinct(chosen, 2 * settings.candidates)
        pairs: list[Score] = []
        if len(parent.effects) + 2 <= most_effects and not lacks_test(problem, parent):
            pairs = best_pairs(problem, parent, chosen[:60], settings.candidates)
            alone = min((promised(problem, parent, x) for x in singles), default=math.inf)
            pairs = [x for x in pairs if promised(problem, parent, x) < 0.8 * alone]
        search.report(f"fitting {listed_names([x.names[-1] for x in singles[:5]])}", progress)
        state, fits = fit_candidates(search, state, reference, [*singles, *pairs], settings.candidates + len(pairs))
        noise = reduced_chi_square(problem, parent)
        entries = [
            Candidate(number, parent.names, " + ".join(x.names), x.drop / noise, note=x.note)
            for x in [*scores[:40], *pairs]
        ]
        state = replace(state, candidates=(*state.candidates, *entries))
        accepted = _accepted(search, state, fits)
        if not any(search.is_noise(problem, f) for f in accepted):
            state, fits = _strong(search, state, reference)
            accepted = _accepted(search, state, [*accepted, *fits])
        if not accepted:
            reason = "improves fitted and held-out steps" if singles else "is significant"
            state = state.with_history(f"round {number}: no candidate {reason}")
            break
        state = refined(replace(state, best=accepted[0]))
        state = yield from backward_selection(search, state)
        best = state.best
        state = state.with_history(
            f"round {number}: {listed_names(best.names)}, misfit per reading "
            f"{mean_cost(best.cost, problem.fitted):.3g} on fitted and "
            f"{mean_cost(best.held_cost, problem.held_out):.3g} on held-out steps"
        )
        yield state
    return state


def _accepted(search: Search, state: SearchState, fits: Sequence[Fit]) -> list[Fit]:
    """Models that improve on those that they contain and on the best one, the best first."""
    problem = state.problem
    found = [
        f
        for f in fits
        if is_improvement(problem, f, parent_of(state, f), search.significance)
        and rank(problem, f) < rank(problem, state.best) - BIC_DIFFERENCE
    ]
    return sorted(found, key=lambda f: rank(problem, f))


def _strong(search: Search, state: SearchState, parent: Fit) -> tuple[SearchState, list[Fit]]:
    """Models with a cause that saturates, which are simulated at full strength: their derivatives promise too much."""
    problem, data = state.problem, state.problem.data
    driven = np.ptp([a.values for a in resolve(data.robot, data.steps)], axis=0) > 0.0
    causes = [
        e
        for e in state.dictionary
        if isinstance(e, EffectAtPlace)
        and e.general.saturates
        and e.listed not in {x.listed for x in parent.effects}
        and driven[round(e.place.get("tendon", 1.0)) - 1]
    ]
    scores = []
    for e in causes:
        point = {**parent.values, e.name: e.full_strength(problem.experiment)}
        fits = [fitting.evaluated(problem, (*parent.effects, e), point, parent.free, parent)]
        (new,) = fitting.run_fits(problem, fits)
        if new.solved:
            start, left = fitting.linear_optimum(problem, new)
            drop = parent.cost - problem.cost(left)[0]
            starts = [start, new.values] if new.free else [start]
            scores.append(Score((e,), drop, starts, left, np.zeros((problem.count, 0))))
    chosen = worth_fitting(search, problem, parent, scores)[:2]
    return fit_candidates(search, state, parent, chosen, 2)


def backward_selection(search: Search, state: SearchState) -> Stage:
    """Drop causes that the others make unnecessary."""
    while len(state.best.effects) > 1:
        unnecessary: list[tuple[Effect, Fit]] = []
        for e in state.best.effects:
            state, smaller = refitted(state, tuple(x for x in state.best.effects if x is not e))
            worse = is_improvement(state.problem, state.best, smaller, search.significance)
            if smaller.solved and not (worse and bic(state.problem, smaller) > bic(state.problem, state.best)):
                unnecessary.append((e, smaller))
        if not unnecessary:
            break
        e, best = min(unnecessary, key=lambda p: bic(state.problem, p[1]))
        state = replace(state, best=best).with_history(f"{e.name} dropped: the others suffice")
        yield state
    return state


def exchange(search: Search, state: SearchState) -> Stage:
    """Exchange every cause, and every two, for one other: the better is taken, those that are as good are kept."""
    for _ in range(3):
        before = state.best
        sets = [(e,) for e in before.effects] + list(itertools.combinations(before.effects, 2))
        for gone in sets:
            if search.out_of_time:
                return state.without_trying(EXCHANGES)
            rest = tuple(e for e in before.effects if e not in gone)
            state, base = refitted(state, rest)
            if not base.solved:
                continue
            state, scores, reference = scores_beside(state, base)
            problem, best = state.problem, state.best
            noise = effective_noise(problem, best, search.significance)
            others = [x for x in worth_fitting(search, problem, base, scores) if x.effect not in gone]
            margin = 1.3 * best.cost + 20.0 * noise
            near = [x for x in others if problem.cost(x.predicted)[0] < margin + 0.1 * base.cost]
            state, fits = fit_candidates(search, state, reference, distinct(near, 8), 5)
            for f in sorted(fits, key=lambda f: rank(problem, f)):
                better = rank(problem, f) < rank(problem, best) - (0.0 if len(gone) > 1 else BIC_DIFFERENCE * noise)
                if better and is_improvement(problem, f, base, search.significance):
                    names = listed_names([e.name for e in gone])
                    state = replace(state, best=f).with_history(
                        f"{listed_names([n for n in f.names if n not in base.names])} in place of {names}: it explains more"
                    )
                    state = refined(state)
                    yield state
                    break
            if state.best is not best:
                break
        if state.best is before:
            break
        state = yield from backward_selection(search, state)
    return _with_rivals(search, state)


def _with_rivals(search: Search, state: SearchState) -> SearchState:
    """Name causes of other models that explain as much, each beside the cause that it replaces."""
    problem, best = state.problem, state.best
    noise = effective_noise(problem, best, search.significance)
    state, mine = replace(state, rivals={}), set(best.names)
    for other in state.fits.values():
        if not other.solved or other is best or bic(problem, other) - bic(problem, best) >= BIC_DIFFERENCE * noise:
            continue
        theirs = set(other.names)
        if len(theirs - mine) != 1 or at_bound(problem, other):
            continue
        for name in mine - theirs:
            state = with_rival(state, name, next(iter(theirs - mine)))
    return state
