"""The search for causes over one dictionary: models are extended, the best first, exchanged and reduced.

One run of a model linearises it by all causes of the dictionary (`tdcr_fe.identify.screening`). They are ordered by the
evidence that they promise; the first are fitted. In every round the best model is extended. Where nothing helps, what
first order hardly shows is tried. Where several causes leave more than noise, and at the end, causes of the best model
are exchanged for others, and those dropped that the others make unnecessary.

Stages (`search_causes`, `grow`, `backward_selection`, `exchange`) keep every complete state (`Search.keep`), with which
the search ends where it is interrupted or its time is over.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence, Set
from dataclasses import replace
from functools import partial
from itertools import pairwise
from statistics import fmean
from typing import NamedTuple, TypeGuard

import numpy as np

from tdcr_fe.effects import Effect, EffectAtPlace
from tdcr_fe.identify import criteria, fitting
from tdcr_fe.identify.causes import Cause, is_named
from tdcr_fe.identify.dictionary import dictionary
from tdcr_fe.identify.forward import Work, advance
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.identify.result import Candidate
from tdcr_fe.identify.scatter import find_scatter
from tdcr_fe.identify.screening import FIRST_ORDER, Score, Start, apart, rescored, screen
from tdcr_fe.identify.search_state import Search, SearchState, as_good, in_time, parent_of, refined
from tdcr_fe.identify.settings import OutOfTime, Part

#: Number of causes from which on a further one has to remove `WORTHWHILE` of the misfit on held-out steps.
MANY = 4

#: Candidates of a round that the report shows.
SHOWN = 40

#: Where even the most promising cause leaves more than this misfit per fitted reading, to first order, the derivatives
#: say little about which cause is right, so listed effects are fitted before they are compared. (An adhesion that held
#: back most of the tension came 30th to first order; the first would have left 3000. Fitted, the adhesion left 1.)
FAR = 1000.0

#: How many of the causes that saturate are simulated at full strength beside a model, by their fall to first order. A
#: saturating cause shows little in the derivative, so that the right one need not come first (it came sixth once).
STRONG = 10

#: Typical steps with which the first of two effects that show only together is tried [1].
STRENGTHS = (1.0, 8.0, 64.0)


def search_causes(search: Search, state: SearchState) -> SearchState:
    """The whole search.

    A search on a part of the load steps is kept fast: unlisted causes are tried only once no listed effect improves the
    model, and exchanges only at the end.
    """
    search.report("the dictionary of causes", 0.03)
    every = dictionary(state.problem, state.declared.run)
    if state.log.rows is not None:
        state = replace(state, dictionary=tuple(filter(is_named, every)))
        state = in_time(search, state, grow, Part.FURTHER_EFFECTS)
        state = replace(state, extended=frozenset())
    state = replace(state, dictionary=every)
    for _ in range(3):
        state = in_time(search, state, grow, Part.FURTHER_EFFECTS)
        grown = state.best
        if not state.scatter:
            state = in_time(search, state, exchange, Part.EXCHANGES)
        if state.best is grown or state.scatter:
            break
    return with_rivals(state)


# -------------------------------------------------------------------------------------------------- candidates


def scores_beside(state: SearchState, fit: Fit, costly: bool = False) -> tuple[SearchState, list[Score], Fit]:
    """Scores of all causes of the dictionary beside a fitted model, computed once; and the model as a reference.

    ``costly``: whether unlisted causes that take a run each are scored, too.
    """
    key = frozenset(fit.names)
    done, reference = state.scores.get(key, ([], fit))
    seen = {x.effect.name for x in done} | state.log.refused.keys()
    known = {e.listed for e in fit.effects}
    others = [e for e in state.dictionary if e.listed not in known and e.name not in seen]
    others = [e for e in others if costly or not _takes_a_run(e)]
    if others:
        scores, screened = screen(state.problem, fit, others)
        # Forces towards points need the response to actions, which only a run for such causes has.
        reference = screened if reference.run.acted is None else reference
        done = sorted([*done, *scores], key=lambda x: -x.drop)
        state = replace(state, scores={**state.scores, key: (done, reference)})
        scales = {name: x for score in scores for name, x in score.scales.items()}
        state = replace(state, problem=replace(state.problem, scales={**state.problem.scales, **scales}))
        if not fit.effects:
            refused = {x.effect.name: x.note for x in scores if x.note and not x.effect.after}
            state = state.logged(refused={**state.log.refused, **refused})
    return state, done, reference


def own_price(problem: FitProblem, score: Score) -> float:
    """What a candidate costs by itself, in the criterion."""
    values = score.start.point if score.effect.name == "gravity" else {}
    return criteria.complexity(problem, (score.effect,), values, score.count)


class Proposal(NamedTuple):
    """A candidate beside a model."""

    parent: Fit
    score: Score
    criterion: float  # that the model with it promises

    @property
    def effects(self) -> tuple[Effect, ...]:
        """All causes together."""
        return (*self.parent.effects, self.score.effect)

    @property
    def names(self) -> frozenset[str]:
        """Names of all causes together."""
        return frozenset({*self.parent.names, self.score.effect.name})

    @property
    def laws(self) -> frozenset[str]:
        """Laws of its causes, that is, their names without place, tendon and rows."""
        return _laws(self.effects)

    @property
    def named(self) -> bool:
        """Whether all causes are listed effects."""
        return self.parent.named and is_named(self.score.effect)


def worth_fitting(
    problem: FitProblem, parent: Fit, scores: Sequence[Score], reference: Fit | None = None
) -> list[Proposal]:
    """Candidates beside a model that promise more than chance and leave degrees of freedom, the most promising first.

    Far above noise, the error of first order counts as noise. A predicted misfit below the noise and that error counts
    as that limit, so that simpler candidates come first. ``reference``: the model with another run, from which fits
    begin.
    """
    noise, found = max(1.0, FIRST_ORDER * criteria.reduced_chi_square(problem, parent)), []
    fitted = int(np.count_nonzero(problem.fitted))
    for x in scores:
        needed = noise * criteria.chi_square_threshold(x.count)
        if x.count < fitted - len(parent.free) and x.drop > needed:
            cost = max(parent.cost - x.drop, fitted + FIRST_ORDER * parent.cost)
            criterion = cost + own_price(problem, x) + criteria.price_of(problem, parent)
            found.append(Proposal(reference or parent, x, criterion))
    return sorted(found, key=lambda x: x.criterion)


#: The state after a search for candidates beside a model, and these.
_Proposed = tuple[SearchState, list[Proposal]]


def singles(search: Search, state: SearchState, parent: Fit, costly: bool = False) -> _Proposed:
    """Single causes beside a model that are worth a fit.

    Causes that saturate are among them only beside the declared model, and beside several causes, in whose place one of
    them may be the right one.
    """
    state, scores, reference = scores_beside(state, parent, costly)
    found = [x for x in scores if not _saturates(x.effect)]
    left = parent.cost - max((x.drop for x in found), default=0.0)
    if not costly and left > FAR * np.count_nonzero(state.problem.fitted):
        found = _roughly_fitted(state.problem, parent, found)
    proposals = worth_fitting(state.problem, parent, found, reference)
    if not costly and len(parent.effects) != 1 and not criteria.residual_is_noise(state.problem, parent):
        state, strong = at_full_strength(search, state, parent)
        done = frozenset(parent.names), at_full_strength.__name__
        state, proposals = replace(state, extended=state.extended | {done}), proposals + strong
    return state, proposals


def _in_whole_steps(problem: FitProblem, fit: Fit) -> FitProblem:
    """The problem with each load step solved as a whole, corrected for what that does to a model."""
    rough = problem.rough
    (base,) = fitting.run_fits(rough, [fitting.evaluated(rough, fit.effects, fit.values, ())])
    return replace(rough, correction=rough.correction + fit.residual - base.residual)


def _roughly_fitted(problem: FitProblem, parent: Fit, scores: Sequence[Score]) -> list[Score]:
    """Scores far from the data, where first order tells little: of each listed effect, its best form fitted.

    Load steps are each solved as a whole, which takes about a tenth of the time. Fits that are left behind end early.
    """
    rough, found, race = _in_whole_steps(problem, parent), {x.effect.name: x for x in scores}, fitting.Race()
    best: dict[str, Score] = {}
    for x in scores:
        if is_named(x.effect) and x.start.point:
            best.setdefault(x.effect.listed, x)

    def fitted(x: Score) -> fitting.Fitting:
        now = yield from fitting.begin(rough, (*parent.effects, x.effect), x.start.point)
        return (yield from fitting.fitted(rough, now, race, x.start.predicted))

    for x in best.values():
        (fit,) = fitting.run_fits(rough, [fitted(x)])
        if parent.cost - fit.cost > x.drop:
            begin = partial(Start, fit.values, fit.residual)
            found[x.effect.name] = replace(x, drop=parent.cost - fit.cost, begin=begin)
    return sorted(found.values(), key=lambda x: -x.drop)


def costly_singles(search: Search, state: SearchState, parent: Fit) -> _Proposed:
    """Single causes that take a run each, beside the declared model."""
    if parent.effects:
        return state, []
    state, found = singles(search, state, parent, True)
    return state, [x for x in found if _takes_a_run(x.score.effect)]


def _takes_a_run(effect: Effect) -> bool:
    """Whether an unlisted cause takes a run of its own."""
    return not (is_named(effect) or effect.exact_derivatives)


# ------------------------------------------------------------------------------------------------------- fits


def fit_proposals(
    search: Search, state: SearchState, pool: Sequence[Proposal], ahead: Fit | None = None
) -> tuple[SearchState, list[Fit]]:
    """Fit the models that promise most, of listed effects and of others.

    They are evaluated at their predicted values, and the best fitted: the first of all at once, if it may leave noise;
    then those of listed effects, which cost less, and then others. Where one leaves noise, or one is given, those are
    not tried that cannot become as probable, to first order. Where none of the best improves on the best model so far,
    also on held-out steps, the others that were evaluated are fitted, too, until one does.
    """
    problem, half = state.problem, (search.settings.candidates + 1) // 2
    waiting = sorted(pool, key=lambda x: x.criterion)
    lowest = {x: min(f.cost for f in state.fits.values() if not x or f.named) for x in (True, False)}
    races = {x: fitting.Race(fitting.limit_beside(cost)) for x, cost in lowest.items()}
    noise, ready = fitting.limit_beside(float(np.count_nonzero(problem.fitted))), list[_Evaluated]()
    proposed = {x.names for x in pool}

    def fits() -> list[Fit]:
        return [f for k, f in state.fits.items() if k in proposed and f.solved]

    # None: the first of all, which waits if it will not leave noise. True: listed effects. False: the others.
    for named in (None, True, False):
        try:
            ready += _evaluated(state, _to_evaluate(search, state, waiting, named, ahead))
        except OutOfTime:
            state = state.without_trying(Part.FURTHER_EFFECTS)
            break
        now = [f.may_leave(noise) if named is None else f.proposal.named is named for f in ready]
        queue = sorted(itertools.compress(ready, now), key=lambda f: f.criterion)
        ready, left = [f for f, chosen_now in zip(ready, now, strict=True) if not chosen_now], half
        while queue:
            together: list[fitting.Fitting] = []
            while queue and len(together) < problem.forward.processes:
                one = queue.pop(0)
                race, predicted = races[one.proposal.named], one.proposal.score.start.predicted
                if ahead is not None:
                    price = criteria.price_of(problem, one.fit)
                    race = replace(race, limit=criterion_of(problem, ahead) + criteria.BIC_DIFFERENCE - price)
                    if not race.in_reach(one.cost, fitting.distance(problem, one.fit.residual, predicted)):
                        state = state.with_fit(replace(one.fit, pruned=True))
                        continue
                if left > 0 or (ahead is None and not _accepted(state, fits())):
                    left -= 1
                    together.append(fitting.fitted(problem, one.fit, race, predicted))
            for new in fitting.run_fits(problem, together):
                state = state.with_fit(new)
                better = ahead is None or criteria.rank(problem, new) < criteria.rank(problem, ahead)
                ahead = new if better and criteria.residual_is_noise(problem, new) else ahead
    return state, fits()


def _to_evaluate(
    search: Search, state: SearchState, waiting: Sequence[Proposal], named: bool | None, ahead: Fit | None
) -> list[Proposal]:
    """The first of all that wait (``named`` is None), or of the rest those of listed effects, or the others.

    Of so many laws, half as many forms or places each. Unlisted causes are tried where they may do better than listed
    effects, or match the model ahead; and where they promise about as much as the first of all or of listed effects,
    whatever that has reached.
    """
    problem, most = state.problem, search.settings.candidates
    batch = waiting[:1] if named is None else [x for x in waiting[1:] if x.named is named]
    promised = {x.names: x.criterion for x in waiting}
    listed = [x for x in waiting if x.named]
    fitted = (state.fits.get(x.names) for x in listed)
    needed = min((_reached(problem, f) for f in fitted if f is not None), default=math.inf)
    needed = max([needed, *(x.criterion for x in (*waiting[:1], *listed[:1]))])
    chosen: dict[frozenset[str], Proposal] = {}
    for x in batch:
        if not x.named and ahead is None and x.criterion > needed + FIRST_ORDER * x.parent.cost:
            continue
        same = [y.laws for y in chosen.values()]
        enough = same.count(x.laws) >= (most + 1) // 2 or (x.laws not in same and len(set(same)) >= most)
        if enough or x.names in state.fits or x.names in chosen:
            continue
        if ahead is None or could_match(problem, ahead, x, promised.get(frozenset(ahead.names))):
            chosen[x.names] = x
    return list(chosen.values())


class _Evaluated(NamedTuple):
    """A model with a candidate, at its predicted values."""

    proposal: Proposal
    fit: Fit  # nothing fitted yet
    # That it can reach, by its derivatives there
    cost: float
    criterion: float

    def may_leave(self, cost: float) -> bool:
        """Whether it may come down to a cost, by the error of first order."""
        return self.cost <= cost + FIRST_ORDER * self.proposal.parent.cost


def _evaluated(state: SearchState, proposals: Sequence[Proposal]) -> list[_Evaluated]:
    """Models at their predicted values, where these can be solved.

    Of every law, the form or place that promises most is evaluated; others where one comes near the lowest cost.
    """
    first: dict[frozenset[str], Proposal] = {}
    for x in proposals:
        first.setdefault(x.laws, x)
    found = _each_evaluated(state.problem, list(first.values()))
    costs = [(e.proposal.laws, e.cost) for e in found]
    costs += [(_laws(f.effects), f.cost) for f in state.fits.values()]
    limit = fitting.limit_beside(min(cost for _, cost in costs))
    near = {laws for laws, cost in costs if cost <= limit}
    others = [x for x in proposals if x.laws in near and x is not first[x.laws]]
    return [*found, *_each_evaluated(state.problem, others)]


def _each_evaluated(problem: FitProblem, proposals: Sequence[Proposal]) -> list[_Evaluated]:
    """Models at their predicted values, where these can be solved."""
    found = advance([_begun(problem, x) for x in proposals], problem.run)
    return [x for x in found if x.fit.solved]


def _laws(effects: Sequence[Effect]) -> frozenset[str]:
    return frozenset(e.law for e in effects)


def _reached(problem: FitProblem, fit: Fit) -> float:
    """Criterion of a model, by its misfit on held-out steps where that is larger than on fitted ones."""
    times = np.count_nonzero(problem.fitted) / max(1, int(np.count_nonzero(problem.held_out)))
    return criterion_of(problem, fit) + max(0.0, times * fit.held_cost - fit.cost)


def criterion_of(problem: FitProblem, fit: Fit) -> float:
    """Criterion of a model over the fitted readings, to be compared with what candidates promise."""
    return fit.cost + criteria.price_of(problem, fit)


def could_match(problem: FitProblem, ahead: Fit, proposal: Proposal, promised: float | None = None) -> bool:
    """Whether a candidate may become about as probable as another model, to first order.

    It may where it promises as much as the other model has reached or promised, or can change the predictions as that
    one does. Other forms of the same effects always may, and listed effects that perturb the same, since the error of
    first order is not known. Forms with more numbers that are not worth them to first order may not; `_in_best_forms`
    comes back to these. ``promised``: the criterion that first order gave the other model beside the same parent.
    """
    parent, x, criterion = proposal
    mine, theirs = proposal.effects, ahead.effects
    forms = {e.listed for e in mine} == {e.listed for e in theirs}
    numbers, others = (sum(len(e.parameters) for e in effects) for effects in (mine, theirs))
    as_much = promised is not None and criterion < promised + criteria.BIC_DIFFERENCE
    if forms and promised is not None and numbers > others and not as_much:
        return False
    forms |= proposal.named and {e.kind.perturbs for e in mine} == {e.kind.perturbs for e in theirs}
    limit = criterion_of(problem, ahead) + criteria.BIC_DIFFERENCE
    if forms or as_much or not x.signature.size or criterion < limit:
        return True
    left, whole = apart(problem, parent, parent.residual - ahead.residual, x)
    own = criteria.price_of(problem, parent) + own_price(problem, x)
    return ahead.cost + max(0.0, left - FIRST_ORDER * whole) + own < limit


def _begun(problem: FitProblem, proposal: Proposal) -> Work[_Evaluated]:
    """A model with a candidate at its predicted values; at half of them where these are worse than the model without.

    First order overshoots where an effect is not linear. From half the value a superelastic backbone was found in the
    first round, in 55 simulations; from the whole one only after gravity, in 88.
    """
    start, effects, parent = proposal.score.start, proposal.effects, proposal.parent
    now = yield from fitting.begin(problem, effects, start.point, parent)
    if start.half and not now.cost < parent.cost:
        half = yield from fitting.begin(problem, effects, start.half, parent)
        now = min(now, half, key=lambda f: f.cost)
    cost = fitting.reachable_cost(problem, now)
    return _Evaluated(proposal, now, cost, cost + criteria.price_of(problem, now))


def refitted(state: SearchState, parts: Sequence[tuple[Effect, ...]]) -> tuple[SearchState, list[Fit]]:
    """Parts of the best model, each fitted from its values once; or as it was fitted before, where that is better.

    They may have causes in other forms, see `other_forms`.
    """
    problem, best, whole = state.problem, state.best, frozenset(state.best.names)
    fittings, keys = [], [frozenset(e.name for e in effects) for effects in parts]
    for key, effects in zip(keys, parts, strict=True):
        start = {e.name: _carried_over(problem, best, e) for e in effects}
        try:
            problem.with_effects(effects, start)
        except ValueError:  # there is no such robot: not solved
            continue
        if effects and (key, whole) not in state.refits:
            fittings.append(fitting.smaller(problem, effects, start, best, state.fits.get(key)))
    for new in fitting.run_fits(problem, fittings):
        known = state.fits.get(frozenset(new.names))
        if known is None or known.pruned or new.cost < known.cost:
            state = state.with_fit(new)
    unsolved = replace(best, cost=math.inf, held_cost=math.inf)
    state = replace(state, refits=state.refits | {(key, whole) for key in keys})
    return state, [state.fits.get(key, unsolved) for key in keys]


def _carried_over(problem: FitProblem, best: Fit, e: Effect) -> dict[str, float]:
    """Values of a cause of the best model, or of another form of it; null values of numbers that it does not have.

    A number of all is the mean of those of each, and one of each is that of all.
    """
    same = next((x for x in best.effects if x.listed == e.listed), None)
    causes = (x for x in best.effects if isinstance(x, Cause))
    same = same or next(x for x in causes if e.law == x.law or e.name == x.everywhere)
    own, null = best.values[same.name], e.null_values(problem.experiment)
    alike = {
        n: [x for m, x in own.items() if f"{m}_".startswith(f"{n}_") or n.startswith(f"{m}_")] for n in null
    }
    return {n: own.get(n, fmean(x) if x else null[n]) for n, x in alike.items()}


def other_forms(state: SearchState) -> list[tuple[Effect, ...]]:
    """The best model with one of its causes in another form, each a model of its own.

    Such forms have more numbers, or fewer (only the one that promises most), or one number for all tendons in place of
    one for each, or the reverse. An unlisted cause at one place may act everywhere, and every cause at the place before
    or after, because first order does not find places surely: it ranked the right one, a cord at the tip, fifth.
    """
    best, found = state.best, []
    for e in best.effects:
        mine = {p.name for p in e.parameters}
        forms = {f: {p.name for p in f.parameters} for f in state.dictionary if f.law == e.law}
        places = [f for f, own in forms.items() if own == mine]
        larger = [f for f, own in forms.items() if own > mine or (not own & mine and len(own) != len(mine))]
        smaller = [f for f, own in forms.items() if own < mine]
        if smaller:
            larger.append(min(smaller, key=lambda f: _cost_without(state.problem, best, e, mine - forms[f])))
        if isinstance(e, Cause) and e.everywhere not in best.names:
            larger += [f for f in state.dictionary if f.name == e.everywhere]
        larger += [f for f, g in (*pairwise(places), *pairwise(places[::-1])) if g.name == e.name]
        found += [tuple(f if x is e else x for x in best.effects) for f in larger]
    return found


def _in_best_forms(state: SearchState) -> SearchState:
    """The best model with its causes in the forms that the data support.

    Or the best model of listed effects, where these forms make it the better one: coefficients of friction, one for
    each tendon, explained no more than an unlisted law of friction, but one for all did so with fewer numbers.
    """
    while True:
        fits, best = list[Fit](), state.best
        for model in (best, *_best_named(state)):
            at = replace(state, best=model)
            at, found = refitted(at, other_forms(at))
            state, fits = replace(at, best=best), fits + found
        ranks = [(criteria.rank(state.problem, f), f) for f in fits if _admissible(state, f)]
        lowest, new = min(ranks, key=lambda x: x[0], default=(math.inf, state.best))
        if not lowest < criteria.rank(state.problem, state.best):
            return state
        why = "it explains more" if len(new.free) == len(state.best.free) else "as many numbers as needed"
        text = f"{new.title} in place of {state.best.title}: {why}"
        state = replace(state, best=new).with_history(text)


def _cost_without(problem: FitProblem, fit: Fit, e: Effect, names: Set[str]) -> float:
    """Cost of a model, to first order, with some numbers of a cause at their null values, to which the others adapt."""
    null = {**fit.values, e.name: e.null_values(problem.experiment)}
    here, there = (problem.coordinates(fit.effects, values, fit.free) for values in (fit.values, null))
    gone = np.array([k[0] == e.name and k[1] in names for k in fit.free])
    left = fit.residual - fit.jacobian[:, gone] @ (there - here)[gone]
    kept = tuple(k for k, away in zip(fit.free, gone, strict=True) if not away)
    rest = replace(fit, residual=left, cost=problem.cost(left)[0], jacobian=fit.jacobian[:, ~gone], free=kept)
    return fitting.reachable_cost(problem, rest)


# --------------------------------------------------------------------------------------------------- selection


def grow(search: Search, state: SearchState) -> SearchState:
    """Extend the best model by a cause as long as the evidence grows.

    Where several leave more than noise, they are exchanged. What first order hardly shows is tried where nothing helps.
    """
    most_effects = 1 if criteria.lacks_test(state.problem, state.declared) else search.settings.max_effects
    before = state.best
    for number in itertools.count(1):
        if number > 1 and not search.explained(state) and state.best.cost > criteria.HALVED * before.cost:
            state = with_scatter(state)
            if state.scatter:
                break
        names, before = frozenset(state.best.names), state.best
        progress = 0.05 + 0.65 * (1.0 - 0.5 ** (number - 1))
        more = len(names) < most_effects and (names, singles.__name__) not in state.extended
        tries = _visible(search, state) if more else _hidden(search, state)
        # Several causes that leave more than noise may stand for others.
        anew = (names, exchange.__name__) not in state.extended and state.log.rows is None
        if anew and len(state.best.effects) > 1 and not search.explained(state):
            state = exchange(search, state, progress)
            if state.best is not before:
                continue
        if not tries:
            break
        pool: list[Proposal] = []
        for propose, parent in tries:
            search.report(f"round {number}: candidates in addition to {parent.title}", progress)
            state = replace(state, extended=state.extended | {(frozenset(parent.names), propose.__name__)})
            state, new = propose(search, state, parent)
            new = [x for x in new if len(x.names) <= most_effects]
            pool += new
            if new:
                search.report(f"fitting {' + '.join(x.score.effect.name for x in new[:5])}", progress)
            ahead = state.best if search.explained(state) else None
            state, fits = fit_proposals(search, state, new, ahead)
            better = _accepted(state, fits)
            if better:
                state = search.keep(replace(state, best=better[0]))
            if better and (search.explained(state) or not more):
                break
        entries = [_entry(state, number, x) for x in pool[:SHOWN]]
        state = state.logged(candidates=(*state.log.candidates, *entries))
        if state.best is before:
            reason = "improves fitted and held-out steps" if pool else "is significant"
            state = state.with_history(f"round {number}: no candidate {reason}")
            continue
        state = backward_selection(search, refined(state))
        best = state.best
        fitted, held_out = _mean_costs(state.problem, best)
        left = f"misfit per reading {fitted:.3g} on fitted and {held_out:.3g} on held-out steps"
        state = search.keep(state.with_history(f"round {number}: {best.title}, {left}"))
    return state


def with_scatter(state: SearchState) -> SearchState:
    """The state with errors that differ in every step, where these explain all that declared or best model leave.

    If the best model explains most of the misfit, they are looked for beside that one alone: beside the declared model
    a force would have explained everything, although dry friction had already left only 3 %.
    """
    left, whole = (f.cost + f.held_cost for f in (state.best, state.declared))
    for fit in (state.declared, state.best) if left > criteria.HALVED * whole else (state.best,):
        tried = frozenset(fit.names), find_scatter.__name__
        if state.scatter or tried in state.extended:
            continue
        state = replace(state, extended=state.extended | {tried})
        scatter = find_scatter(state.problem, fit)
        if scatter:
            text = f"what is different in every step explains all beside {fit.title}"
            state = replace(state, best=fit, scatter=scatter).with_history(text)
    return state


#: A search for candidates beside a model, and that model.
_Try = tuple[Callable[[Search, SearchState, Fit], _Proposed], Fit]


def _visible(search: Search, state: SearchState) -> list[_Try]:
    """Single causes beside the best model.

    If that has an unlisted cause and leaves more than noise, they are first tried beside the best model of listed
    effects, because a wrong first cause can lead to a wrong second one: gravity and friction were once taken for a
    force on one disk and friction up to another, and no exchange of a single cause corrected that.
    """
    first = [] if search.explained(state) else _best_named(state)
    return [(singles, fit) for fit in (*first, state.best)]


def _best_named(state: SearchState) -> list[Fit]:
    """The best model of listed effects, where the best of all with as many causes has others: one or none."""
    if state.best.named:
        return []
    size = len(state.best.effects)
    named = [f for f in state.fits.values() if len(f.effects) == size and f.named and f.solved]
    return sorted(named, key=lambda f: criteria.rank(state.problem, f))[:1]


def _hidden(search: Search, state: SearchState) -> list[_Try]:
    """What first order hardly shows, beside the best and the declared model, where nothing explains the data.

    Pairs of listed effects are tried as well where an unlisted cause does.
    """
    explained = search.explained(state)
    if explained and state.best.named:
        return []
    stages = (pairs,) if explained else (at_full_strength, pairs, costly_singles)
    models = {frozenset(f.names): f for f in (state.best, state.fits[frozenset()])}
    each = itertools.product(models.items(), stages)
    return [(stage, fit) for (names, fit), stage in each if (names, stage.__name__) not in state.extended]


def _admissible(state: SearchState, fit: Fit) -> bool:
    """Whether a model with causes improves on those that it contains."""
    return criteria.is_improvement(state.problem, fit, parent_of(state, fit))


def _entry(state: SearchState, number: int, proposal: Proposal) -> Candidate:
    """A candidate for the report, with what its fit gave."""
    problem, (parent, score, _) = state.problem, proposal
    drop = score.drop / criteria.reduced_chi_square(problem, parent)
    entry = Candidate(number, parent.names, score.effect.name, drop, note=score.note)
    fit = state.fits.get(proposal.names)
    if fit is None:
        return entry
    chi2, held_out = _mean_costs(problem, fit)
    known = held_out if np.any(problem.held_out) else None
    note = "" if fit.solved else "the model did not converge there"
    return replace(entry, fitted=not fit.pruned, chi2_fit=chi2, chi2_held_out=known, note=note)


def _mean_costs(problem: FitProblem, fit: Fit) -> tuple[float, float]:
    """Cost per reading, on fitted and on held-out steps."""
    count = int(np.count_nonzero(problem.fitted))
    return fit.cost / max(1, count), fit.held_cost / max(1, problem.count - count)


def _accepted(state: SearchState, fits: Sequence[Fit]) -> list[Fit]:
    """Models that improve on those that they contain and on the best one, the best first."""
    problem = state.problem
    limit = criteria.rank(problem, state.best) - criteria.BIC_DIFFERENCE
    found = [f for f in fits if _admissible(state, f) and criteria.rank(problem, f) < limit]
    return sorted((f for f in found if _worthwhile(state, f)), key=lambda f: criteria.rank(problem, f))


def _worthwhile(state: SearchState, fit: Fit) -> bool:
    """Whether a model with many causes removes enough of the misfit that the best one leaves, on held-out steps."""
    if len(fit.effects) <= MANY:
        return True
    before, after = (f.held_cost if np.any(state.problem.held_out) else f.cost for f in (state.best, fit))
    return after <= (1.0 - criteria.WORTHWHILE) * before


def pairs(search: Search, state: SearchState, parent: Fit) -> _Proposed:
    """Effects that show only beside another one (`Effect.after`), beside that one, which is made strong.

    Where the best model leaves noise, those that cost so much more than it that they cannot become as probable are left
    out. Before, half of the time went into them after a jump of an input had explained all.
    """
    state, scores, _ = scores_beside(state, parent)
    found, present, problem = list[Proposal](), {e.listed for e in parent.effects}, state.problem
    if len(parent.effects) + 2 > search.settings.max_effects or criteria.lacks_test(problem, parent):
        return state, found
    excitation = problem.excitation_range(parent.run)
    most = criteria.price_of(problem, state.best) + criteria.BIC_DIFFERENCE
    most = most if search.explained(state) else math.inf
    for later in (e for e in problem.catalogue if e.after and e.name not in present):
        firsts = [x for x in scores if x.effect.listed in later.after and not x.note]
        for x, strength in itertools.product(firsts, STRENGTHS):
            name = x.effect.name
            effects = *parent.effects, x.effect
            point = {**parent.values, name: _strong_values(problem, x, strength)}
            experiment = problem.with_effects(effects, point)
            free = (*parent.free, *((name, n) for n in point[name]))
            shown = [
                e
                for e in later.forms(problem.experiment)
                if e.probe_points(experiment, excitation)
                and criteria.complexity(problem, (*effects, e), point, len(free) + len(e.parameters)) <= most
            ]
            if not shown:
                continue
            (base,) = fitting.run_fits(problem, [fitting.evaluated(problem, effects, point, free, parent)])
            if base.solved:
                own, _ = screen(problem, base, shown)
                found += worth_fitting(problem, base, own)
    return state, found


def _strong_values(problem: FitProblem, score: Score, strength: float) -> dict[str, float]:
    """Parameters of a candidate so many typical steps from their null values."""
    e = score.effect
    null, free = {e.name: e.null_values(problem.experiment)}, [(e.name, p.name) for p in e.parameters]
    return problem.moved([e], null, free, strength * np.array([score.scales[k] for k in free]))[e.name]


def _saturates(effect: Effect) -> TypeGuard[EffectAtPlace]:
    return isinstance(effect, EffectAtPlace) and effect.general.saturates


def at_full_strength(search: Search, state: SearchState, parent: Fit) -> _Proposed:
    """Causes that saturate, simulated at full strength beside a model: their derivatives tell the direction.

    The most promising ones to first order are simulated with every load step solved as a whole, which takes a seventh
    of the time of friction paths. The best two, where they explain more than the model without, are simulated with
    these.
    """
    state, scores, _ = scores_beside(state, parent)
    problem = state.problem
    causes = [x.effect for x in scores if x.drop > 0.0 and _saturates(x.effect)][:STRONG]

    def simulated(at: FitProblem, chosen: Sequence[EffectAtPlace], along: Fit | None) -> list[Fit]:
        points = [{**parent.values, e.name: e.general.full_strength(problem.experiment)} for e in chosen]
        models = [((*parent.effects, e), p) for e, p in zip(chosen, points, strict=True)]
        evaluated = [fitting.evaluated(at, effects, p, parent.free, along) for effects, p in models]
        return fitting.run_fits(at, evaluated)

    rough = _in_whole_steps(problem, parent)
    costs = [fitting.linear_optimum(problem, f).cost for f in simulated(rough, causes, None)]
    best = [causes[i] for i in np.argsort(costs)[:2] if costs[i] < parent.cost]
    scores = []
    for e, new in zip(best, simulated(problem, best, parent), strict=True):
        if new.solved:
            there, nothing = fitting.linear_optimum(problem, new), np.zeros((problem.count, 0))
            begin = partial(Start, there.values, there.residual)
            scores.append(Score(e, parent.cost - there.cost, nothing, begin))
    found = worth_fitting(problem, parent, scores)
    # those that were fitted from small values begin anew
    kept = {k: f for k, f in state.fits.items() if k not in {x.names for x in found}}
    return replace(state, fits=kept), found


def backward_selection(search: Search, state: SearchState) -> SearchState:
    """Give causes the form that the data support, and drop those that the others make unnecessary."""
    state = search.keep(_in_best_forms(state))
    while len(state.best.effects) > 1:
        problem, best = state.problem, state.best
        parts = [tuple(x for x in best.effects if x is not e) for e in best.effects]
        state, smaller = refitted(state, parts)
        without = zip(best.effects, smaller, strict=True)
        unnecessary = [(e, f) for e, f in without if f.solved and not _falls_behind(problem, f, best)]
        if not unnecessary:
            break
        e, best = min(unnecessary, key=lambda p: criteria.bic(problem, p[1]))
        state = search.keep(replace(state, best=best).with_history(f"{e.name} dropped: the others suffice"))
    return state


def _falls_behind(problem: FitProblem, smaller: Fit, best: Fit) -> bool:
    """Whether the best model is better than one without a cause by all criteria."""
    improves = criteria.is_improvement(problem, best, smaller)
    return improves and criteria.bic(problem, smaller) > criteria.bic(problem, best)


def exchange(search: Search, state: SearchState, progress: float = 0.75) -> SearchState:
    """Exchange every cause, and every two, of the best model for one other; the best of all is taken.

    What a cause explains is the difference of the models with and without it. Which others may explain it follows from
    their columns beside the best model.
    """
    best, problem = state.best, state.problem
    done = frozenset(best.names), exchange.__name__
    if done in state.extended:
        return state
    state, fits = replace(state, extended=state.extended | {done}), list[Fit]()
    every = [gone for n in (1, 2) for gone in itertools.combinations(best.effects, n)]
    left = [tuple(e for e in best.effects if e not in gone) for gone in every]
    state, bases = refitted(state, left[: len(best.effects)])
    for gone, rest in zip(every, left, strict=True):
        search.report(f"other causes in place of {' + '.join(e.name for e in gone)}", progress)
        if len(gone) == 1:
            base = bases.pop(0)
        elif not rest:
            base = state.fits[frozenset()]
        else:
            free = [k for k in best.free if k[0] in {e.name for e in rest}]
            values = {e.name: best.values[e.name] for e in rest}
            (base,) = fitting.run_fits(problem, [fitting.evaluated(problem, rest, values, free, best)])
        if not base.solved:
            continue
        state, scores, reference = scores_beside(state, best)
        problem, names = state.problem, {e.listed for e in (*gone, *rest)}
        others = [x for x in scores if x.signature.size and x.effect.listed not in names]
        near = worth_fitting(problem, base, rescored(problem, base, others, reference.run))
        state, more = fit_proposals(search, state, near, best)
        fits += more
    limit = criteria.rank(problem, best)
    better = [f for f in fits if criteria.rank(problem, f) < limit and _admissible(state, f)]
    if better:
        new = min(better, key=lambda f: criteria.rank(problem, f))
        text = f"{new.title} in place of {best.title}: it explains more"
        state = search.keep(refined(replace(state, best=new).with_history(text)))
        state = backward_selection(search, state)
    return state


def with_rivals(state: SearchState) -> SearchState:
    """Name causes of other models that explain as much, each beside the cause that it replaces."""
    rivals, mine = dict[str, tuple[str, ...]](), set(state.best.names)
    for other in as_good(state):
        theirs = set(other.names)
        if len(theirs - mine) != 1 or criteria.at_bound(state.problem, other):
            continue
        for name in mine - theirs:
            rivals[name] = tuple(dict.fromkeys((*rivals.get(name, ()), *(theirs - mine))))
    return replace(state, rivals=rivals)
