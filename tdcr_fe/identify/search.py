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
from tdcr_fe.effects.base import Points
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
from tdcr_fe.identify.screening import Score, apart, best_pairs, screen
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

#: A cause may explain what another one explains where its columns leave of the other's change at most this sum of
#: squares, or this share of it: the first order is not exact [1].
LITTLE, SMALL_SHARE = 60.0, 0.002

#: A pair is fitted where it promises a criterion smaller than this share of that of the best single cause [1].
TOGETHER = 0.8

#: A cause beyond so many is added only where it removes at least so much of the misfit on held-out steps [1].
MANY, WORTHWHILE = 4, 0.1

#: Candidates of a round that the report shows.
SHOWN = 40

#: The first of two effects that show only together is tried so many times as strong as its probe points.
STRENGTHS = (1.0, 8.0, 64.0)


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


def scores_beside(state: SearchState, fit: Fit) -> tuple[SearchState, list[Score], Fit]:
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
    """Fit models with candidates beside a model.

    The first is fitted at once. Where one leaves noise, those are not tried that promise much less. The others are
    evaluated at their predicted values, and the best of them fitted.
    """
    problem = state.problem
    race = fitting.Race(state.best.cost, search.deadline)
    begun: list[tuple[float, Fit, Score]] = []
    ahead: Score | None = None  # one that leaves noise
    for number, x in enumerate(scores):
        key = frozenset({*parent.names, *x.names})
        late = search.out_of_time and bool(state.best.effects)
        if key in state.fits or late or (ahead is not None and not alike(problem, parent, ahead, x)):
            continue
        now = _begun(problem, parent, x)
        if not now.solved:
            continue
        if number == 0:
            state, now = _fitted(state, x, now, race)
            ahead = x if search.is_noise(problem, now) else None
            most -= 1
        else:
            begun.append(
                (fitting.reachable_cost(problem, now) + len(now.free) * math.log(problem.count), now, x)
            )
    for _, now, x in sorted(begun, key=lambda b: b[0])[:most]:
        late = search.out_of_time and bool(state.best.effects)
        if late or (ahead is not None and not alike(problem, parent, ahead, x)):
            continue
        state, now = _fitted(state, x, now, race)
        ahead = x if ahead is None and search.is_noise(problem, now) else ahead
    keys = [frozenset({*parent.names, *x.names}) for x in scores]
    return state, [state.fits[k] for k in keys if k in state.fits and state.fits[k].solved]


def alike(problem: FitProblem, fit: Fit, score: Score, other: Score, noise: float = 1.0) -> bool:
    """Whether another candidate beside a model may explain what a candidate explains, to first order, in its place."""
    if set(score.names) & set(other.names):
        return False
    if not other.signature.size:
        return True
    left, whole = apart(problem, fit, fit.residual - score.predicted, other)
    return left <= max(LITTLE * noise, SMALL_SHARE * whole)


def _begun(problem: FitProblem, parent: Fit, x: Score) -> Fit:
    """A model with candidates at their predicted values; at other starts where these are worse than without."""
    effects = (*parent.effects, *x.effects)
    (now,) = fitting.run_fits(
        problem, [fitting.begin(problem, effects, x.starts[:1], fitting.Race(), parent)]
    )
    if not now.cost < parent.cost and len(x.starts) > 1:
        more = [fitting.begin(problem, effects, x.starts[1:], fitting.Race(), parent)]
        now = min(now, *fitting.run_fits(problem, more), key=lambda f: f.cost)
    return now


def _fitted(state: SearchState, x: Score, now: Fit, race: fitting.Race) -> tuple[SearchState, Fit]:
    """A model with candidates fitted, to the end where it comes near the best."""
    problem = state.problem
    (now,) = fitting.run_fits(problem, [fitting.descend(problem, now, race, 8, x.predicted)])
    race.reached(now.cost)
    if now.cost <= race.limit:
        (now,) = fitting.run_fits(problem, [fitting.finish(problem, replace(now, pruned=False), race)])
    return with_note_on_differences(state.with_fit(now), now.differenced), now


def refitted(state: SearchState, effects: Sequence[Effect]) -> tuple[SearchState, Fit]:
    """A part of the best model, fitted from its values; or as it was fitted before, where that is better."""
    key = frozenset(e.name for e in effects)
    if not effects:
        return state, state.fits.get(key, state.declared)
    problem, best, known = state.problem, state.best, state.fits.get(key)
    if known is None or known.pruned or known.cost > best.cost:
        start = {e.name: best.values[e.name] for e in effects}
        try:
            problem.with_effects(effects, start)
        except ValueError:
            return state, replace(best, cost=math.inf, held_cost=math.inf)
        (new,) = fitting.run_fits(problem, [fitting.smaller(problem, effects, [start], best, fitting.Race())])
        if known is None or known.pruned or new.cost < known.cost:
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
        search.report(
            f"round {number}: candidates beside {listed_names(state.best.names) or 'the declared model'}",
            progress,
        )
        parent = state.best
        state, scores, reference = scores_beside(state, parent)
        problem = state.problem
        chosen = worth_fitting(search, problem, parent, scores)
        singles = distinct(chosen, settings.candidates + 3)
        pairs: list[Score] = []
        if len(parent.effects) + 2 <= most_effects and not lacks_test(problem, parent):
            pairs = best_pairs(problem, parent, chosen[:60], settings.candidates)
            alone = min((promised(problem, parent, x) for x in singles), default=math.inf)
            pairs = [x for x in pairs if promised(problem, parent, x) < TOGETHER * alone]
            pairs += [
                x for x in together(state, reference) if promised(problem, parent, x) < TOGETHER * alone
            ]
        search.report(f"fitting {listed_names([x.names[-1] for x in singles[:5]])}", progress)
        state, fits = fit_candidates(
            search, state, reference, [*singles, *pairs], settings.candidates + len(pairs)
        )
        entries = [_entry(state, number, parent, x) for x in [*scores[:SHOWN], *pairs]]
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


def _entry(state: SearchState, number: int, parent: Fit, score: Score) -> Candidate:
    """A candidate for the report, with what its fit gave."""
    problem, drop = state.problem, score.drop / reduced_chi_square(state.problem, parent)
    entry = Candidate(number, parent.names, " + ".join(score.names), drop, note=score.note)
    fit = state.fits.get(frozenset({*parent.names, *score.names}))
    if fit is None:
        return entry
    held_out = mean_cost(fit.held_cost, problem.held_out) if np.any(problem.held_out) else None
    note = "" if fit.solved else "the model did not converge there"
    return replace(
        entry, fitted=True, chi2_fit=mean_cost(fit.cost, problem.fitted), chi2_held_out=held_out, note=note
    )


def _accepted(search: Search, state: SearchState, fits: Sequence[Fit]) -> list[Fit]:
    """Models that improve on those that they contain and on the best one, the best first."""
    problem = state.problem
    found = [
        f
        for f in fits
        if is_improvement(problem, f, parent_of(state, f), search.significance)
        and rank(problem, f) < rank(problem, state.best) - BIC_DIFFERENCE
        and _worthwhile(state, f)
    ]
    return sorted(found, key=lambda f: rank(problem, f))


def _worthwhile(state: SearchState, fit: Fit) -> bool:
    """Whether a model with many causes removes enough of the misfit that the best one leaves, on held-out steps."""
    if len(fit.effects) <= MANY:
        return True
    before, after = (f.held_cost if np.any(state.problem.held_out) else f.cost for f in (state.best, fit))
    return after <= (1.0 - WORTHWHILE) * before


def together(state: SearchState, fit: Fit) -> list[Score]:
    """Effects that data show only beside another one (`Effect.after`), each with that one, which is made strong."""
    problem = state.problem
    experiment = problem.with_effects(fit.effects, fit.values)
    excitation, present = problem.excitation_range(fit.run), {e.listed for e in fit.effects}
    found = []
    for later in problem.catalogue:
        firsts = [e for e in problem.catalogue if e.name in later.after and e.name not in present]
        if later.name in present or not firsts or later.probe_points(experiment, excitation):
            continue
        for first in (form for e in firsts for form in e.forms(problem.experiment)):
            scores = []
            for strength in STRENGTHS:
                values = _probe_values(problem, first, strength, first.probe_points(experiment, excitation))
                if not values or not later.probe_points(first.apply(experiment, values), excitation):
                    continue
                free = (*fit.free, *((first.name, name) for name in values))
                point = {**fit.values, first.name: values}
                (base,) = fitting.run_fits(
                    problem, [fitting.evaluated(problem, (*fit.effects, first), point, free, fit)]
                )
                if base.solved:
                    own, _ = screen(problem, base, later.forms(problem.experiment))
                    scores += [
                        replace(x, effects=(first, x.effect), drop=fit.cost - base.cost + x.drop)
                        for x in own
                        if x.starts
                    ]
            found += sorted(scores, key=lambda x: -x.drop)[:1]
    return found


def _probe_values(problem: FitProblem, effect: Effect, strength: float, probes: Points) -> dict[str, float]:
    """Values of an effect, all parameters moved from their null values by so many times the way to the probe points."""
    if not probes:
        return {}
    null = effect.null_values(problem.experiment)
    values = dict(null)
    for point in probes[0]:
        values |= {name: x for name, x in point.items() if x != null[name]}
    for p in effect.parameters:
        low, high = problem.bounds(effect, p.name)
        start = p.coordinate(null[p.name])
        z = start + strength * (p.coordinate(values[p.name]) - start)
        values[p.name] = p.value(min(max(z, low), high))
    return values


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
            if smaller.solved and not (
                worse and bic(state.problem, smaller) > bic(state.problem, state.best)
            ):
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
            own = [x for x in scores if x.effect in gone and x.starts and x.signature.size]
            if len(gone) == 1 and own:
                near = [x for x in others if alike(problem, reference, own[0], x, noise)]
            else:
                near = [x for x in others if problem.cost(x.predicted)[0] < 2.0 * best.cost + LITTLE * noise]
            state, fits = fit_candidates(search, state, reference, distinct(near, 6), 4)
            for f in sorted(fits, key=lambda f: rank(problem, f)):
                better = rank(problem, f) < rank(problem, best) - (
                    0.0 if len(gone) > 1 else BIC_DIFFERENCE * noise
                )
                if better and is_improvement(problem, f, base, search.significance):
                    names = listed_names([e.name for e in gone])
                    new = listed_names([n for n in f.names if n not in base.names])
                    state = replace(state, best=f).with_history(
                        f"{new} in place of {names}: it explains more"
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
        if (
            not other.solved
            or other is best
            or bic(problem, other) - bic(problem, best) >= BIC_DIFFERENCE * noise
        ):
            continue
        theirs = set(other.names)
        if len(theirs - mine) != 1 or at_bound(problem, other):
            continue
        for name in mine - theirs:
            state = with_rival(state, name, next(iter(theirs - mine)))
    return state
