"""Candidates beside a model: their scores, the choice of those that are fitted, and their fits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from tdcr_fe.effects import Effect, EffectAtPlace, Experiment, PlaceEffect
from tdcr_fe.identify import fitting
from tdcr_fe.identify.criteria import noise_cost, rank, reduced_chi_square, required_drop
from tdcr_fe.identify.problem import Fit, FitProblem, Point
from tdcr_fe.identify.result import Candidate
from tdcr_fe.identify.screening import Score, screen
from tdcr_fe.identify.search_state import (
    Names,
    Search,
    SearchState,
    listed_names,
    mean_cost,
    with_note_on_differences,
)
from tdcr_fe.identify.settings import OutOfTime
from tdcr_fe.model.loading import resolve

#: Two effects are tried together where that promises a criterion smaller by this share than the first of them alone.
PROMISE = 0.1

#: So many more candidates than are fitted are evaluated at their predicted values, where strong effects differ from the
#: prediction.
SECOND_LOOK = 4

#: So many that promise most go first. Where one of them leaves noise, those are not tried whose predicted cost is more
#: than so many times that at which a fit is of interest, or that take off less than this share of what that one does.
FIRST, PRUNED_ABOVE, LITTLE_BESIDE_NOISE = 2, 10.0, 0.15

#: The best of them is fitted to the end at once where its cost is at most so many times that of noise: the error of a
#: path that is not its own may be larger than noise.
NEARLY = 4.0

#: Where it leaves less than this share of the misfit, those are not tried that take off less than this share.
LITTLE = 0.05

#: Fits whose BIC differs by less than this share and this constant may change order on substeps of their own, see
#: `fitting.NEAR_PATH` [1].
PATH_SHARE, PATH_MARGIN = 0.03, 20.0

#: Local causes that saturate are simulated where no other one leaves less than this share of the misfit to first order,
#: nor the best model.
SOLVED = 0.1

#: The first of them is tried so many times as strong as its probe points, which show only itself [1].
STRENGTHS = (1.0, 8.0, 64.0)


class Round(NamedTuple):
    """A round of forward selection."""

    number: int
    progress: float  # fraction of the search that is done [1]
    ahead: Fit | None = None  # a model that leaves noise, which the candidates must come near


class Extended(NamedTuple):
    """A fitted model with one more effect."""

    parent: Fit
    score: Score

    @property
    def effects(self) -> tuple[Effect, ...]:
        """All effects, that one last."""
        return (*self.parent.effects, self.score.effect)

    @property
    def names(self) -> Names:
        """Names of the effects."""
        return frozenset({*self.parent.names, self.score.effect.name})


@dataclass(frozen=True)
class Contest:
    """How models that extend others compete."""

    lowest: float  # cost so far [1]
    progress: float  # fraction of the search that is done [1]
    # by effect, further points to begin from where the lowest cost is not reached
    more: Mapping[str, Sequence[Point]] = field(default_factory=dict)
    most: int | None = None  # models fitted at most: those that promise most at their predicted values
    margin: float = 0.0  # see `finished`
    explained: bool = (
        False  # whether a model with the lowest cost leaves noise, besides the best of the state
    )


#: A model that is proposed, with the BIC that it promises to first order.
Proposal = tuple[float, Extended]


def propose(
    search: Search, state: SearchState, this: Round, level: Sequence[Fit]
) -> tuple[SearchState, list[Extended]]:
    """The best candidates beside each model, by the predicted BIC to first order; `SECOND_LOOK` more than are fitted.

    Pairs of effects (see `_pairs`) are not tried beside a model that leaves noise, or where another one does.
    """
    proposals: list[Proposal] = []
    for fit in level:
        beside = listed_names(fit.names) or "the declared model"
        search.report(f"round {this.number}: scores beside {beside}", this.progress)
        state, scores = scores_beside(state, fit)
        noise = reduced_chi_square(state.problem, fit)
        for score in scores:
            note = score.note
            if score.drop > required_drop(score.count, search.significance, noise):
                if identifiable(state.problem, fit, score):
                    expected = fit.cost - score.drop + score.count * math.log(state.problem.count)
                    proposals.append((expected, Extended(fit, score)))
                else:
                    note = "more parameters than these readings determine"
            entry = Candidate(this.number, fit.names, score.effect.name, score.drop / noise, note=note)
            state = replace(state, candidates=(*state.candidates, entry))
        if this.ahead is None and not search.is_noise(state.problem, fit):
            state, pairs = _pairs(search, state, this.number, fit)
            proposals += _promising(pairs, [p for p in proposals if p[1].parent is fit])
    chosen: dict[Names, Extended] = {}
    for _, new in sorted(proposals, key=lambda p: p[0]):
        if len(chosen) < search.settings.candidates + SECOND_LOOK:
            # Of the forms of one effect that with the best criterion, which counts their parameters.
            chosen.setdefault(frozenset({*new.parent.names, new.score.effect.listed}), new)
    return state, list(chosen.values())


def _promising(pairs: Sequence[Proposal], single: Sequence[Proposal]) -> list[Proposal]:
    """The best pair of effects beside a model, if it promises more than the first of the two alone; else none."""
    if not pairs:
        return []
    best = min(pairs, key=lambda p: p[0])
    first = best[1].parent.effects[-1].listed
    alone = min((p[0] for p in single if p[1].score.effect.listed == first), default=math.inf)
    return [best] if best[0] < (1.0 - PROMISE) * alone else []


def _pairs(search: Search, state: SearchState, number: int, fit: Fit) -> tuple[SearchState, list[Proposal]]:
    """Effects that data show only beside another one (`Effect.after`), each together with that one.

    The other one is as strong as lets the two promise most, and the parameters of both are free in the score test.
    """
    problem = state.problem
    noise = reduced_chi_square(problem, fit)
    experiment = problem.with_effects(fit.effects, fit.values)
    excitation = problem.excitation_range(fit.run)
    present = {e.listed for e in fit.effects}
    found = []
    for later in problem.catalogue:
        firsts = [e for e in problem.catalogue if e.name in later.after and e.name not in present]
        if later.name in present or not firsts or later.probe_points(experiment, excitation):
            continue
        if len(fit.effects) + 2 > search.settings.max_effects:
            continue
        for first in firsts:
            values = _probe_values(problem, fit, first, 1.0, experiment)
            if not values or not later.probe_points(first.apply(experiment, values), excitation):
                continue
            for base, score in _scores_with(problem, fit, first, later, experiment):
                state = with_screened(state, [score])
                drop = fit.cost - (base.cost - score.drop)
                count = len(base.free) - len(fit.free) + score.count
                entry = Candidate(number, base.names, score.effect.name, drop / noise)
                state = replace(state, candidates=(*state.candidates, entry))
                needed = required_drop(count, search.significance, noise)
                if drop > needed and identifiable(problem, base, score):
                    expected = fit.cost - drop + count * math.log(problem.count)
                    found.append((expected, Extended(base, score)))
    return state, found


def _scores_with(
    problem: FitProblem, fit: Fit, first: Effect, later: Effect, experiment: Experiment
) -> list[tuple[Fit, Score]]:
    """Scores of the forms of an effect, beside a model with each form of another one, and that model.

    How strong the other one is, is chosen with the form that has most parameters.
    """
    found: dict[float, list[tuple[Fit, Score]]] = {}
    forms = list(first.forms(problem.experiment))

    def scored(form: Effect, strength: float) -> list[tuple[Fit, Score]]:
        base = _at_probe(problem, fit, form, strength, experiment)
        if base is None:
            return []
        return [(base, x) for x in screen(problem, base, later.forms(problem.experiment)) if x.starts]

    for strength in STRENGTHS:
        found[strength] = scored(forms[-1], strength)
    best = min(STRENGTHS, key=lambda x: min((b.cost - score.drop for b, score in found[x]), default=math.inf))
    return [*found[best], *(pair for form in forms[:-1] for pair in scored(form, best))]


def _at_probe(
    problem: FitProblem, fit: Fit, first: Effect, strength: float, experiment: Experiment
) -> Fit | None:
    """A model with one more effect, stronger than its probe points, with derivatives; None where it is not solved."""
    values = _probe_values(problem, fit, first, strength, experiment)
    if not values:
        return None
    effects, free = (*fit.effects, first), (*fit.free, *((first.name, name) for name in values))
    fitted = fitting.evaluated(problem, effects, {**fit.values, first.name: values}, free, fit)
    (base,) = fitting.run_fits(problem, [fitted])
    return base if base.solved else None


def _probe_values(
    problem: FitProblem, fit: Fit, first: Effect, strength: float, experiment: Experiment
) -> dict[str, float]:
    """Values of an effect, all parameters moved from their null values by so many times the way to the probe points."""
    alternatives = first.probe_points(experiment, problem.excitation_range(fit.run))
    if not alternatives:
        return {}
    null = first.null_values(experiment)
    values = dict(null)
    for point in alternatives[0]:
        values |= {name: x for name, x in point.items() if x != null[name]}
    for p in first.parameters:
        low, high = problem.bounds(first, p.name)
        start = p.coordinate(null[p.name])
        z = start + strength * (p.coordinate(values[p.name]) - start)
        values[p.name] = p.value(min(max(z, low), high))
    return values


def identifiable(problem: FitProblem, fit: Fit, score: Score) -> bool:
    """Whether the fitted readings leave at least one degree of freedom with the parameters of a candidate."""
    return len(fit.free) + score.count < int(np.count_nonzero(problem.fitted))


def fit_proposals(
    search: Search, state: SearchState, this: Round, proposals: Sequence[Extended]
) -> tuple[SearchState, list[Fit]]:
    """Fit the candidates of a round; those that were solved, best first."""
    lowest = math.inf if this.ahead is None else this.ahead.cost
    most, explained = search.settings.candidates, this.ahead is not None
    contest = Contest(lowest, this.progress, most=most, explained=explained)
    state, fits = fit_and_rank(search, state, proposals, contest)
    problem = state.problem
    made = {(this.number, new.parent.names, new.score.effect.name): fit for new, fit in fits}
    entries = [_with_fit(problem, c, made.get((c.round, c.model, c.name))) for c in state.candidates]
    state = replace(state, candidates=tuple(entries))
    return state, sorted((fit for _, fit in fits if fit.solved), key=lambda f: rank(problem, f))


def _with_fit(problem: FitProblem, entry: Candidate, fit: Fit | None) -> Candidate:
    """An entry of the report with what its fit gave."""
    if fit is None:
        return entry
    held_out = mean_cost(fit.held_cost, problem.held_out) if np.any(problem.held_out) else None
    note = "" if fit.solved else "the model did not converge there"
    fitted = mean_cost(fit.cost, problem.fitted)
    return replace(entry, fitted=True, chi2_fit=fitted, chi2_held_out=held_out, note=note)


def fit_and_rank(
    search: Search, state: SearchState, starters: Sequence[Extended], contest: Contest
) -> tuple[SearchState, list[tuple[Extended, Fit]]]:
    """Fit models with one more effect, where they were not before; those that cannot come near the best are stopped."""
    problem, most = state.problem, contest.most
    new = [x for x in starters if x.names not in state.fits]
    lowest = min([contest.lowest, *(state.fits[x.names].cost for x in starters if x.names in state.fits)])
    if new:
        search.report(f"fitting {listed_names([x.score.effect.name for x in new])}", contest.progress)
    # The first effect is fitted to the end, whatever time that takes.
    race = fitting.Race(lowest, search.deadline if state.best.effects else math.inf)
    explained = contest.explained or search.is_noise(problem, state.best)
    begun: list[tuple[Extended, Fit]] = []
    if most is not None and not explained:
        begun = _first(problem, new[:FIRST], race)
        explained = any(search.is_noise(problem, f) for _, f in begun)
    rest = [x for x in new[len(begun) :] if _has_a_chance(problem, x, race, explained)]
    begun += _begun(problem, rest, race)
    if most is not None:
        begun.sort(key=lambda c: _outlook(problem, *c))
        begun = begun[: max(1, most - (len(starters) - len(new)))]
    fittings = [
        candidate_fit(problem, x, now, race, contest.more.get(x.score.effect.name, ())) for x, now in begun
    ]
    for found in finished(problem, fitting.run_fits(problem, fittings), race, contest.margin):
        state = with_note_on_differences(state.with_fit(found), found.differenced)
    return state, [(x, state.fits[x.names]) for x in starters if x.names in state.fits]


def _has_a_chance(problem: FitProblem, new: Extended, race: fitting.Race, explained: bool) -> bool:
    """Whether a candidate promises enough, to first order, beside the model that is ahead."""
    parent, score = new
    predicted = score.cost(problem)
    share = (parent.cost - predicted) / max(1e-300, parent.cost - race.lowest)
    if explained:
        return predicted <= PRUNED_ABOVE * race.limit and share >= LITTLE_BESIDE_NOISE
    return share >= LITTLE or race.lowest > LITTLE * parent.cost


def _begun(
    problem: FitProblem, starters: Sequence[Extended], race: fitting.Race
) -> list[tuple[Extended, Fit]]:
    """Models with one more effect at their predicted values."""
    begun = [fitting.begin(problem, x.effects, x.score.starts[:1], race, x.parent) for x in starters]
    return list(zip(starters, fitting.run_fits(problem, begun), strict=True))


def _first(
    problem: FitProblem, starters: Sequence[Extended], race: fitting.Race
) -> list[tuple[Extended, Fit]]:
    """Models with one more effect, fitted on the path of those without; the best to the end if it may leave noise."""
    begun = _begun(problem, starters, race)
    fits = [fitting.descend(problem, f, race, 5, x.score.predicted) for x, f in begun]
    found = fitting.run_fits(problem, fits)
    best = min(range(len(found)), key=lambda i: found[i].cost, default=None)
    if best is not None and found[best].cost <= NEARLY * noise_cost(problem):
        (found[best],) = fitting.run_fits(problem, [fitting.finish(problem, found[best], race)])
    return list(zip(starters, found, strict=True))


def _outlook(problem: FitProblem, new: Extended, fit: Fit) -> float:
    """BIC of the fitted readings that a model promises from where it is, to first order.

    Where it is worse than without the effect, the prediction went too far, as with effects that saturate: then what
    was predicted counts if that is better, and the fit decides.
    """
    cost = fitting.reachable_cost(problem, fit)
    if fit.cost > new.parent.cost:
        cost = min(cost, new.score.cost(problem))
    return cost + len(fit.free) * math.log(problem.count)


def candidate_fit(
    problem: FitProblem, new: Extended, now: Fit | None, race: fitting.Race, more: Sequence[Point] = ()
) -> fitting.Fitting:
    """Fit a candidate beside a model, on its path, from the first start; from the others where the cost stays too high.

    ``now``: the candidate at the first start; None where it was not evaluated yet. ``more``: further points to begin
    from where the lowest cost is not reached.
    """
    parent, score = new
    drop = parent.cost - score.cost(problem)
    if now is None:
        now = yield from fitting.begin(problem, new.effects, score.starts[:1], race, parent)
    now = yield from fitting.descend(problem, now, race, 5, score.predicted)
    starts = list(more) if now.cost > 1.5 * race.lowest else []
    if now.cost > max(1.5 * race.lowest, parent.cost - 0.7 * drop):
        starts += score.starts[1:]
    if starts:
        try:
            other = yield from fitting.begin(problem, new.effects, starts, race, parent)
        except OutOfTime:
            return now
        other = yield from fitting.descend(problem, other, race, 12 if more else 5)
        now = min(now, other, key=lambda f: f.cost)
    return now


def finished(problem: FitProblem, fits: Sequence[Fit], race: fitting.Race, margin: float = 0.0) -> list[Fit]:
    """Fits of which those that come near the best are improved to the end, see `tdcr_fe.identify.fitting.finish`.

    First those that the race has not left behind, all at a time; then, for as long as the order changes, those whose
    BIC is near that of the best, or within ``margin`` of it.
    """
    found, done = list(fits), set[int]()
    todo = [i for i, f in enumerate(found) if f.solved and f.cost <= race.limit]
    while todo:
        ready = [fitting.finish(problem, replace(found[i], pruned=False), race) for i in todo]
        for i, fit in zip(todo, fitting.run_fits(problem, ready), strict=True):
            found[i] = fit
            done.add(i)
        ranks = [rank(problem, f) if f.solved else math.inf for f in found]
        lowest = min(ranks, default=math.inf)
        near = lowest + max(margin, PATH_SHARE * lowest + PATH_MARGIN)
        todo = [i for i, f in enumerate(found) if i not in done and f.cost <= race.limit and ranks[i] <= near]
    return found


def scores_beside(state: SearchState, fit: Fit) -> tuple[SearchState, Sequence[Score]]:
    """Scores of all candidates beside a fitted model, computed once."""
    key = frozenset(fit.names)
    if key not in state.scores:
        others = [
            form
            for e in state.problem.catalogue
            for form in e.forms(state.problem.experiment)
            if form.listed not in {x.listed for x in fit.effects} and form.name not in state.refused
        ]
        scores = screen(state.problem, fit, others)
        state = with_screened(replace(state, scores={**state.scores, key: scores}), scores)
        if not fit.effects:
            refused = {x.effect.name: x.note for x in scores if x.note and not x.effect.after}
            state = replace(state, refused={**state.refused, **refused})
    return state, state.scores[key]


def first_order_local_scores(state: SearchState, fit: Fit) -> tuple[SearchState, Sequence[Score]]:
    """Scores of local causes beside a model, to first order, computed once."""
    key = frozenset(fit.names)
    if key not in state.first_order_local_scores:
        every = [e for family in local_candidates(state.problem, fit) for e in family]
        scores = screen(state.problem, fit, every)
        known = {**state.first_order_local_scores, key: scores}
        state = with_screened(replace(state, first_order_local_scores=known), scores)
    return state, state.first_order_local_scores[key]


def local_scores_beside(search: Search, state: SearchState, fit: Fit) -> tuple[SearchState, Sequence[Score]]:
    """Scores of local causes beside a model, with those that saturate simulated, computed once."""
    key = frozenset(fit.names)
    if key not in state.local_scores:
        state, scores = first_order_local_scores(state, fit)
        least = min((x.cost(state.problem) for x in scores), default=math.inf)
        explained = search.explained(state)
        beaten = fit is not state.best and state.best.cost <= SOLVED * fit.cost
        if least > SOLVED * fit.cost and not (explained or beaten):
            scores = sorted([*scores, *_strong_scores(state.problem, fit)], key=lambda s: -s.drop)
            scores = _joined(scores)
        state = replace(state, local_scores={**state.local_scores, key: scores})
    return state, state.local_scores[key]


def at_full_strength(
    problem: FitProblem, fit: Fit, causes: Sequence[EffectAtPlace] | None = None
) -> list[Fit]:
    """A model with each local cause that saturates at full strength, with derivatives by its parameters as before.

    ``causes``: those that are tried; None for some on every tendon, see `strong_candidates`.
    """
    fits = []
    for e in strong_candidates(problem, fit) if causes is None else causes:
        point = {**fit.values, e.name: e.full_strength(problem.experiment)}
        fits.append(fitting.evaluated(problem, (*fit.effects, e), point, fit.free, fit))
    return [new for new in fitting.run_fits(problem, fits) if new.solved]


def _strong_scores(problem: FitProblem, fit: Fit) -> list[Score]:
    """Scores of local causes that saturate, from simulations at full strength; the model's own parameters adapt."""
    none = np.zeros((fit.residual.size, 0))
    scores = []
    for new in at_full_strength(problem, fit):
        point, left = fitting.linear_optimum(problem, new)
        starts = [point, new.values] if new.free else [point]
        scores.append(Score(new.effects[-1], fit.cost - problem.cost(left)[0], starts, left, none))
    return scores


def _joined(scores: Sequence[Score]) -> list[Score]:
    """Scores of which those of one effect are one: the best, which may begin where the others do as well."""
    by_name: dict[str, Score] = {}
    for x in scores:
        known = by_name.get(x.effect.name)
        by_name[x.effect.name] = (
            x
            if known is None
            else replace(known, starts=[*known.starts, *x.starts[:1]], scales={**x.scales, **known.scales})
        )
    return list(by_name.values())


def with_screened(state: SearchState, scores: Sequence[Score]) -> SearchState:
    """Typical steps of parameters, as the score tests found them; and what had no derivative."""
    scales = dict(state.problem.scales)
    for score in scores:
        scales |= score.scales
        why = {(score.effect.name, name): reason for name, reason in score.differenced.items()}
        state = with_note_on_differences(state, why)
    return replace(state, problem=replace(state.problem, scales=scales))


def local_candidates(problem: FitProblem, fit: Fit) -> list[list[Effect]]:
    """Effects at every place of the robot, each kind from the base on, without the kinds that the model has."""
    robot = problem.with_effects(fit.effects, fit.values).robot
    return [
        [e.at(place) for place in e.places(robot)]
        for e in problem.catalogue
        if isinstance(e, PlaceEffect) and e.name not in {x.listed for x in fit.effects}
    ]


def strong_candidates(problem: FitProblem, fit: Fit) -> list[EffectAtPlace]:
    """Local causes that saturate, at two places along every tendon that is driven."""
    data = problem.data
    driven = np.ptp([a.values for a in resolve(data.robot, data.steps)], axis=0) > 0.0
    found: list[EffectAtPlace] = []
    for e in problem.catalogue:
        if not isinstance(e, PlaceEffect) or not e.saturates or e.name in {x.listed for x in fit.effects}:
            continue
        for i in np.flatnonzero(driven):
            places = [p for p in e.places(data.robot) if p.get("tendon") == i + 1.0]
            count = len(places)
            found += [e.at(places[k]) for k in sorted({count // 4, (3 * count) // 4}) if k < count]
    return found
