"""Selection of effects: forward and backward, swaps of single effects, and a search for local causes.

Every function takes a `SearchState` and gives a new one. The stages are generators of states, so that an interruption
keeps the last one that was complete.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Effect, EffectAtPlace
from tdcr_fe.identify import fitting
from tdcr_fe.identify.criteria import (
    BIC_DIFFERENCE,
    BOUND_PENALTY,
    at_bound,
    bic,
    chi_square_threshold,
    effective_noise,
    is_improvement,
    rank,
    reduced_chi_square,
    residual_is_noise,
    robust_threshold,
)
from tdcr_fe.identify.information import lacks_test
from tdcr_fe.identify.outcome import Candidate, IdentifySettings
from tdcr_fe.identify.problem import Fit, FitProblem, Point, evaluate, refine
from tdcr_fe.identify.screening import Score, screen
from tdcr_fe.identify.unlisted import local_candidates

Array = NDArray[np.float64]
Names = frozenset[str]

#: Called with a sentence on what is done, and about which fraction of the work is done [1].
Progress = Callable[[str, float], None]

#: A stage of the search: yields every complete state, and returns the last one.
Stage = Generator["SearchState", None, "SearchState"]

#: Repetitions of swapping, and of refining the discretisation, at most.
REPETITIONS = 3


@dataclass(frozen=True)
class Search:
    """What does not change during a search.

    Attributes
    ----------
    settings : IdentifySettings
    report : Progress
    """

    settings: IdentifySettings
    report: Progress

    @property
    def significance(self) -> float:
        """Chance of adding an effect to data that miss nothing [1]."""
        return self.settings.significance


@dataclass(frozen=True)
class SearchState:
    """State of the search; every stage returns a new one.

    Attributes
    ----------
    problem : FitProblem
    declared, best : Fit
        The declared model, and the best so far.
    fits : mapping
        Every model that was fitted, by the names of its effects.
    scores, local_scores : mapping
        Scores of candidates, and of local causes, beside a model.
    candidates : tuple of Candidate
        Result of each, for the report.
    refused : mapping of str to str
        Effects that are not tried, with the reason.
    rivals : mapping of str to tuple of str
        By effect of the best model, those that explain the data as well.
    history : tuple of str
    interrupted : bool
    data_fault : str
        The fault of the data that explains the misfit of the declared model; empty where there is none.
    """

    problem: FitProblem
    declared: Fit
    best: Fit
    fits: Mapping[Names, Fit]
    scores: Mapping[Names, Sequence[Score]] = field(default_factory=dict)
    local_scores: Mapping[Names, Sequence[Score]] = field(default_factory=dict)
    candidates: tuple[Candidate, ...] = ()
    refused: Mapping[str, str] = field(default_factory=dict)
    rivals: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    history: tuple[str, ...] = ()
    interrupted: bool = False
    data_fault: str = ""

    @classmethod
    def start(cls, problem: FitProblem, declared: Fit) -> SearchState:
        """With the declared model alone."""
        return cls(problem, declared, declared, {frozenset(): declared})

    def with_fit(self, fit: Fit) -> SearchState:
        """With another fit."""
        return replace(self, fits={**self.fits, frozenset(fit.names): fit})

    def with_history(self, sentence: str) -> SearchState:
        """With another sentence of history."""
        return replace(self, history=(*self.history, sentence))


# ----------------------------------------------------------------------------------------------- the search


def search_effects(search: Search, state: SearchState) -> Stage:
    """The whole search."""
    search.report("forward selection", 0.05)
    if lacks_test(state.problem, state.declared):
        # Too few readings to separate several effects, or to locate a cause: one effect, at most.
        single = replace(search, settings=replace(search.settings, max_effects=1))
        return (yield from forward_selection(single, state, locate=False))
    state = yield from forward_selection(search, state)
    if state.best.effects:
        search.report("backward selection and swaps", 0.75)
        state = yield from backward_selection(search, state)
        state = yield from swap_effects(search, state)
    if state.best.effects or not residual_is_noise(state.problem, state.best, search.significance):
        search.report("local causes along the backbone", 0.85)
        state = local_search(search, state)
        yield state
    return state


def forward_selection(search: Search, state: SearchState, locate: bool = True) -> Stage:
    """Forward selection: add one effect at a time, several models in parallel (beam search).

    ``locate``: after the first round, see whether a single local cause explains everything.
    """
    level = [state.best]
    for number in range(1, search.settings.max_effects + 1):
        progress = 0.05 + 0.65 * (1.0 - 0.5 ** (number - 1))
        state, proposals = _propose(search, state, number, level, progress)
        yield state
        state, fits = _fit_proposals(search, state, number, proposals, progress)
        accepted = [
            f
            for f in fits
            if is_improvement(state.problem, f, _parent(state, f), search.significance) and _better(state, f)
        ]
        if not accepted:
            reason = "improves fitted and held-out steps" if proposals else "is significant"
            state = state.with_history(f"round {number}: no candidate {reason}")
            break
        state = _refined(replace(state, best=accepted[0]))
        problem, best = state.problem, state.best
        state = state.with_history(
            f"round {number}: {_list(best.names)}, misfit per reading "
            f"{_mean(best.cost, problem.fitted):.3g} on fitted and "
            f"{_mean(best.held_cost, problem.held_out):.3g} on held-out steps"
        )
        yield state
        others = [state.fits[frozenset(f.names)] for f in accepted[1 : search.settings.beam]]
        explained = residual_is_noise(problem, best, search.significance)
        if not explained and number == 1:
            again = [fitting.descend(problem, f, fitting.Race(), 5) for f in others]
            others = fitting.run_fits(problem, again)
        level = [best] if explained or number > 1 else [best, *others]
        if number == 1 and not explained and locate:
            # If one local cause explains everything, the search for several effects that mimic it is skipped.
            located = _local_search(search, state, [state.declared])
            if located.best is not state.best and residual_is_noise(
                located.problem, located.best, search.significance
            ):
                state = located
                break
            scales = located.problem.scales
            problem = replace(state.problem, scales=scales)
            state = replace(state, local_scores=located.local_scores, problem=problem)
    yield state
    return state


def backward_selection(search: Search, state: SearchState) -> Stage:
    """Backward selection: drop effects that the others make unnecessary."""
    while len(state.best.effects) > 1:
        unnecessary: list[tuple[Effect, Fit]] = []
        for e in state.best.effects:
            state, smaller = _without(state, e)
            if smaller.solved and not is_improvement(state.problem, state.best, smaller, search.significance):
                unnecessary.append((e, smaller))
        if not unnecessary:
            break
        problem = state.problem
        e, best = min(unnecessary, key=lambda p: bic(problem, p[1]))
        state = replace(state, best=best).with_history(f"{e.name} dropped: the others suffice")
        yield state
    return state


def swap_effects(search: Search, state: SearchState) -> Stage:
    """Replace each effect by others; name those that explain as much, take those that explain more."""
    for _ in range(REPETITIONS):
        state, swapped = _swap_one(search, replace(state, rivals={}))
        yield state
        if not swapped:
            break
    state = _with_rival_sets(search, state)
    yield state
    return state


def local_search(search: Search, state: SearchState) -> SearchState:
    """Try single bays, and springs at one location, beside the best model, smaller ones, and the declared one."""
    bases: dict[Names, Fit] = {frozenset(): state.declared}
    if not residual_is_noise(state.problem, state.best, search.significance):
        bases[frozenset(state.best.names)] = state.best
    for e in state.best.effects:
        state, smaller = _without(state, e)
        if smaller.solved:
            bases[frozenset(smaller.names)] = smaller
    return _local_search(search, state, list(bases.values()))


def _local_search(search: Search, state: SearchState, bases: Sequence[Fit]) -> SearchState:
    """Try single bays, and springs at one location, beside the three best of the given models."""
    found: list[tuple[float, Fit, Score]] = []
    problem = state.problem
    for base in sorted(bases, key=lambda f: bic(problem, f))[:3]:
        # A local cause is fitted only if it does about as well as the best model to first order; the best candidate
        # has more margin, because the linearisation is inaccurate.
        margin = 0.1 * base.cost + 5.0 * state.best.cost if base is not state.best else math.inf
        state, scored = _local_scores(state, base)
        threshold = chi_square_threshold(1, search.significance)
        level = max(1.0, reduced_chi_square(state.problem, base) * 0.02)
        scores = [x for x in scored if x.drop > threshold * level]
        found += [
            (x.cost(state.problem), base, x)
            for i, x in enumerate(scores[:2])
            if _names(base, x) not in state.fits
            and x.cost(state.problem) < (margin if i else max(margin, 0.6 * base.cost))
        ]
    chosen = [(base, score) for _, base, score in sorted(found, key=lambda p: p[0])[:3]]
    if not chosen:
        return state
    search.report(f"fitting {_list([score.effect.name for _, score in chosen])}", 0.9)
    race = fitting.Race(state.best.cost)
    fits = fitting.run_fits(state.problem, [_candidate_fit(state.problem, b, x, race) for b, x in chosen])
    fits = [
        new
        for new, (base, _) in zip(fits, chosen, strict=True)
        if new.solved and is_improvement(state.problem, new, base, search.significance)
    ]
    return _with_local(state, fits) if fits else state


def with_intermediate_models(state: SearchState) -> SearchState:
    """Fit the models between the declared and the best one where a swap has skipped them."""
    effects = state.best.effects
    for i in range(1, len(effects)):
        part = effects[:i]
        known = state.fits.get(frozenset(e.name for e in part))
        if known is None or not known.solved:
            state, _ = fitted_model(state, part, [{e.name: state.best.values[e.name] for e in part}])
    return state


# --------------------------------------------------------------------------------------- parts of the search


def _propose(
    search: Search, state: SearchState, number: int, level: Sequence[Fit], progress: float
) -> tuple[SearchState, list[tuple[Fit, Score]]]:
    """The best candidates beside each model, by the predicted BIC to first order."""
    proposals: list[tuple[float, Fit, Score]] = []
    for fit in level:
        beside = _list(fit.names) or "the declared model"
        search.report(f"round {number}: scores beside {beside}", progress)
        state, scores = _scores(state, fit)
        noise = reduced_chi_square(state.problem, fit)
        for score in scores:
            note = score.note
            threshold = chi_square_threshold(score.count, search.significance) * max(1.0, noise * 0.02)
            if score.drop > threshold:
                if identifiable(state.problem, fit, score):
                    expected = fit.cost - score.drop + score.count * math.log(state.problem.count)
                    proposals.append((expected, fit, score))
                else:
                    note = "more parameters than these readings determine"
            entry = Candidate(number, fit.names, score.effect.name, score.drop / noise, note=note)
            state = replace(state, candidates=(*state.candidates, entry))
    chosen: dict[Names, tuple[Fit, Score]] = {}
    for _, fit, score in sorted(proposals, key=lambda p: p[0]):
        if len(chosen) < search.settings.candidates:
            # Of the forms of one effect that with the best criterion, which counts their parameters.
            chosen.setdefault(frozenset({*fit.names, score.effect.listed}), (fit, score))
    return state, list(chosen.values())


def identifiable(problem: FitProblem, fit: Fit, score: Score) -> bool:
    """Whether the fitted readings leave at least one degree of freedom with the parameters of a candidate."""
    return len(fit.free) + score.count < int(np.count_nonzero(problem.fitted))


def _fit_proposals(
    search: Search,
    state: SearchState,
    number: int,
    proposals: Sequence[tuple[Fit, Score]],
    progress: float,
) -> tuple[SearchState, list[Fit]]:
    """Fit the candidates of a round; those that were solved, best first."""
    state, raced = _fit_and_rank(search, state, proposals, math.inf, progress)
    problem = state.problem
    for fit, score, new in raced:
        entries = tuple(
            replace(
                c,
                fitted=True,
                chi2_fit=_mean(new.cost, problem.fitted),
                chi2_held_out=_mean(new.held_cost, problem.held_out) if np.any(problem.held_out) else None,
                note="" if new.solved else "the model did not converge there",
            )
            if (c.round, c.model, c.name) == (number, fit.names, score.effect.name)
            else c
            for c in state.candidates
        )
        state = replace(state, candidates=entries)
    solved = [new for _, _, new in raced if new.solved]
    return state, sorted(solved, key=lambda f: rank(problem, f))


def _fit_and_rank(
    search: Search,
    state: SearchState,
    starters: Sequence[tuple[Fit, Score]],
    known: float,
    progress: float,
    more: Mapping[str, Sequence[Point]] | None = None,
) -> tuple[SearchState, list[tuple[Fit, Score, Fit]]]:
    """Fit models, each a fitted one with one more effect; those that cannot come near the best are stopped.

    ``more``: by effect, further points to begin from where the lowest cost is not reached.
    """
    new = [x for x in starters if _names(*x) not in state.fits]
    known = min([known, *(state.fits[_names(*x)].cost for x in starters if _names(*x) in state.fits)])
    if new:
        search.report(f"fitting {_list([score.effect.name for _, score in new])}", progress)
    race = fitting.Race(known)
    fittings = [
        _candidate_fit(state.problem, parent, score, race, (more or {}).get(score.effect.name, ()))
        for parent, score in new
    ]
    for found in fitting.run_fits(state.problem, fittings):
        state = _with_note_on_differences(state.with_fit(found), found.differenced)
    return state, [(parent, score, state.fits[_names(parent, score)]) for parent, score in starters]


def _names(parent: Fit, score: Score) -> Names:
    """Names of the effects of a model with one more."""
    return frozenset({*parent.names, score.effect.name})


def _candidate_fit(
    problem: FitProblem, parent: Fit, score: Score, race: fitting.Race, more: Sequence[Point] = ()
) -> fitting.Fitting:
    """Fit a candidate beside a model from the first start; from the others where its cost stays too high."""
    effects, drop = (*parent.effects, score.effect), parent.cost - score.cost(problem)
    now = yield from fitting.begin(problem, effects, score.starts[:1], race, parent.run)
    now = yield from fitting.descend(problem, now, race, 5, score.predicted)
    starts = list(more) if now.cost > 1.5 * race.lowest else []
    if now.cost > max(1.5 * race.lowest, parent.cost - 0.7 * drop):
        starts += score.starts[1:]
    if starts:
        other = yield from fitting.begin(problem, effects, starts, race, parent.run)
        other = yield from fitting.descend(problem, other, race, 12 if more else 5)
        now = min(now, other, key=lambda f: f.cost)
    if now.solved and now.cost <= race.limit:
        now = yield from fitting.finish(problem, replace(now, given_up=False), race)
    return now


def _swap_one(search: Search, state: SearchState) -> tuple[SearchState, bool]:
    """Try others in place of each effect until one explains more; indistinguishable rivals found so far are kept."""
    for e in state.best.effects:
        state, rest = _without(state, e)
        state, every = _scores(state, rest)
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
        state, raced = _fit_and_rank(search, state, [(rest, x) for x in worth], state.best.cost, 0.75, more)
        problem, best = state.problem, state.best
        noise = effective_noise(problem, best, search.significance)
        for _, x, other in raced:
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
                state = _with_rival(state, e.name, x.effect.name)
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
    state, scores = _scores(state, state.declared)
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
            state = _with_rival(state, like, name)
    return state


def _with_rival(state: SearchState, name: str, rival: str) -> SearchState:
    """With another rival of an effect, without duplicates."""
    known = state.rivals.get(name, ())
    if rival in known:
        return state
    return replace(state, rivals={**state.rivals, name: (*known, rival)})


def _with_local(state: SearchState, fits: Sequence[Fit]) -> SearchState:
    """Take the best model with an effect at a place where it explains more than the present one.

    The place itself counts as one or two fitted numbers more.
    """
    problem = state.problem
    local = min(fits, key=lambda f: bic(problem, f))
    effect = local.effects[-1]
    assert isinstance(effect, EffectAtPlace)
    chosen = len(effect.place) * math.log(problem.count)
    gain = (bic(problem, state.best) - bic(problem, local) - chosen) / reduced_chi_square(problem, local)
    if gain <= BIC_DIFFERENCE:
        return state
    rivals = {k: v for k, v in state.rivals.items() if k in local.names}
    state = replace(state.with_fit(local), best=local, rivals=rivals)
    return _refined(state.with_history(f"{effect.name} explains more than effects along the whole robot"))


def _refined(state: SearchState) -> SearchState:
    """Refine the discretisation at the best model, and evaluate its fits again."""
    before = state.best
    threshold = min(state.problem.robust_threshold, robust_threshold(before.residual))
    problem = replace(state.problem, robust_threshold=threshold)
    changed = False
    for _ in range(REPETITIONS):
        problem, more = refine(problem, before.effects, before.values)
        if not more:
            break
        changed = True
    if changed:
        fitted = fitting.evaluated(problem, before.effects, before.values, before.free)
        (again,) = fitting.run_fits(problem, [fitted])
    else:
        again = _recounted(problem, before, problem.correction - state.problem.correction)
    shift = again.residual - before.residual
    fits = {key: _recounted(problem, old, shift) for key, old in state.fits.items()}
    (best,) = fitting.run_fits(problem, [fitting.finish(problem, again, fitting.Race())])
    fits[frozenset(best.names)] = best
    declared = evaluate(problem, (), {}) if changed else fits[frozenset()]
    fits[frozenset()] = declared
    return replace(state, problem=problem, best=best, declared=declared, fits=fits)


def _recounted(problem: FitProblem, fit: Fit, shift: Array) -> Fit:
    """A fit with its residual shifted, and its cost by the measures of a problem."""
    r = fit.residual + shift
    cost, held_cost = problem.cost(r)
    return replace(fit, residual=r, cost=cost, held_cost=held_cost)


def _parent(state: SearchState, fit: Fit) -> Fit:
    """The best smaller model that was fitted and is contained in a model."""
    inside = [f for k, f in state.fits.items() if k < frozenset(fit.names) and f.solved]
    return min(inside, key=lambda f: f.cost)


def _better(state: SearchState, fit: Fit) -> bool:
    """Whether a model is better than the best so far, which need not be contained in it."""
    return rank(state.problem, fit) < rank(state.problem, state.best) - BIC_DIFFERENCE


def _without(state: SearchState, effect: Effect) -> tuple[SearchState, Fit]:
    """The best model less one effect, fitted anew."""
    best = state.best
    rest = tuple(e for e in best.effects if e is not effect)
    if not rest:
        return state, state.declared
    return fitted_model(state, rest, [{e.name: best.values[e.name] for e in rest}])


def fitted_model(
    state: SearchState, effects: Sequence[Effect], starts: Sequence[Point]
) -> tuple[SearchState, Fit]:
    """Fit a model, or return the fit made before."""
    key = frozenset(e.name for e in effects)
    if key not in state.fits:
        new = fitting.fit(state.problem, effects, starts)
        state = state.with_fit(new)
    return state, state.fits[key]


def _scores(state: SearchState, fit: Fit) -> tuple[SearchState, Sequence[Score]]:
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
        state = _with_screened(replace(state, scores={**state.scores, key: scores}), scores)
        if not fit.effects:
            refused = {x.effect.name: x.note for x in scores if x.note and not x.effect.after}
            state = replace(state, refused={**state.refused, **refused})
    return state, state.scores[key]


def _local_scores(state: SearchState, fit: Fit) -> tuple[SearchState, Sequence[Score]]:
    """Scores of local causes beside a model, computed once."""
    key = frozenset(fit.names)
    if key not in state.local_scores:
        scores = screen(
            state.problem, fit, [e for family in local_candidates(state.problem, fit) for e in family]
        )
        state = _with_screened(state, scores)
        state = replace(state, local_scores={**state.local_scores, key: scores})
    return state, state.local_scores[key]


def _with_screened(state: SearchState, scores: Sequence[Score]) -> SearchState:
    """Typical steps of parameters, as the score tests found them; and what had no derivative."""
    scales = dict(state.problem.scales)
    for score in scores:
        scales |= score.scales
        why = {(score.effect.name, name): reason for name, reason in score.differenced.items()}
        state = _with_note_on_differences(state, why)
    return replace(state, problem=replace(state.problem, scales=scales))


def _with_note_on_differences(state: SearchState, why: Mapping[tuple[str, str], str]) -> SearchState:
    """Say once of every parameter that its derivative was a difference of two runs."""
    for (name, parameter), reason in why.items():
        sentence = f"{name}.{parameter}: derivative by a difference of two runs ({reason})"
        if sentence not in state.history:
            state = state.with_history(sentence)
    return state


def _similarity(a: Array | None, b: Array | None) -> float:
    """Largest cosine between the sensitivities of two effects; zero where one is not known."""
    if a is None or b is None or not a.size or not b.size:
        return 0.0
    first, second = np.linalg.qr(a)[0], np.linalg.qr(b)[0]
    return float(np.linalg.svd(first.T @ second, compute_uv=False)[0])


def _mean(cost: float, which: NDArray[np.bool_]) -> float:
    """Cost per reading."""
    return cost / max(1, int(np.count_nonzero(which)))


def _list(names: Sequence[str]) -> str:
    return " + ".join(names)
