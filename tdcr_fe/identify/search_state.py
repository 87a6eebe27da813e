"""State of a search for effects: what was fitted, the best model, and what a new model makes of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tdcr_fe.effects import Effect
from tdcr_fe.elements import Array
from tdcr_fe.identify import criteria, fitting
from tdcr_fe.identify.problem import Fit, FitProblem, fit_of_run, refine
from tdcr_fe.identify.result import NextExperiment, Profile, Scatter, SearchLog
from tdcr_fe.identify.rows import RowChoice
from tdcr_fe.identify.scatter import with_input_sigma
from tdcr_fe.identify.screening import Score
from tdcr_fe.identify.settings import IdentifySettings, OutOfTime

Names = frozenset[str]

#: Called with a sentence on what is done, and about which fraction of the work is done [1].
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Search:
    """What does not change during a search, and what it keeps."""

    settings: IdentifySettings
    report: Progress
    # the last complete state, which remains where the search is interrupted or its time is over; none before the
    # declared model is solved
    kept: list[SearchState] = field(default_factory=list)

    def keep(self, state: SearchState) -> SearchState:
        """A complete state, which remains until the next one."""
        self.kept[:] = [state]
        return state

    def explained(self, state: SearchState) -> bool:
        """Whether the best model leaves nothing but noise."""
        return criteria.residual_is_noise(state.problem, state.best)


@dataclass(frozen=True)
class SearchState:
    """State of the search; every stage returns a new one."""

    problem: FitProblem
    declared: Fit  # the model as it was declared
    best: Fit  # the best model so far
    fits: Mapping[Names, Fit]  # every model that was fitted, by the names of its effects
    # Scores of candidates beside a model, and that model as a reference for fits
    scores: Mapping[Names, tuple[list[Score], Fit]] = field(default_factory=dict)
    # models to which a function of the search was applied, and its name
    extended: frozenset[tuple[Names, str]] = frozenset()
    # parts of models that were fitted from the values of these, with them
    refits: frozenset[tuple[Names, Names]] = frozenset()
    # by effect of the best model, those that explain the data as well
    rivals: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    log: SearchLog = field(default_factory=SearchLog)  # for the report
    # the fault of the data that explains the misfit of the declared model; empty where there is none
    data_fault: str = ""
    scatter: Scatter | None = None  # what is different in every step
    dictionary: tuple[Effect, ...] = ()  # all candidate causes
    next_experiment: NextExperiment | None = None
    profiles: tuple[Profile, ...] = ()  # of the parameters of the best model

    @classmethod
    def start(cls, problem: FitProblem, declared: Fit, rows: RowChoice | None = None) -> SearchState:
        """A search that has only the declared model."""
        return cls(problem, declared, declared, {frozenset(): declared}, log=SearchLog(rows=rows))

    def begun_anew(self, problem: FitProblem, declared: Fit, best: Fit) -> SearchState:
        """The search begun anew with another problem: of it only the declared and the best model are fitted."""
        fits = {frozenset(fit.names): fit for fit in (declared, best)}
        anew = replace(self, scores={}, extended=frozenset(), refits=frozenset(), scatter=None)
        return replace(anew, problem=problem, declared=declared, best=best, fits=fits)

    def with_fit(self, fit: Fit) -> SearchState:
        """The state with another fit."""
        return replace(self, fits={**self.fits, frozenset(fit.names): fit})

    def without_trying(self, what: str) -> SearchState:
        """The state with a part of the identification noted for which the time did not suffice."""
        if what in self.log.not_tried:
            return self
        noted = self.logged(not_tried=(*self.log.not_tried, what))
        return noted.with_history(f"out of time: {what} not tried")

    def ending_at(self, deadline: float) -> SearchState:
        """The state with another deadline of all simulations, see `FitProblem.deadline`."""
        return replace(self, problem=replace(self.problem, deadline=deadline))

    def with_history(self, sentence: str) -> SearchState:
        """The state with another sentence of history."""
        return self.logged(history=(*self.log.history, sentence))

    def logged(self, **entries: Any) -> SearchState:
        """The state with other entries of the log."""
        return replace(self, log=replace(self.log, **entries))


#: A part of an identification: from the state before it to that after it.
Stage = Callable[[Search, SearchState], SearchState]


def in_time(search: Search, state: SearchState, stage: Stage, what: str) -> SearchState:
    """The state after a part; where the time passes within a simulation, the last complete one, with that part noted.

    ``what``: the part of the identification that is then noted as not tried.
    """
    search.keep(state)
    try:
        return search.keep(stage(search, state))
    except OutOfTime:
        return search.keep(search.kept[0].without_trying(what))


def parent_of(state: SearchState, fit: Fit) -> Fit:
    """The best smaller model that was fitted and is contained in a model."""
    inside = [f for k, f in state.fits.items() if k < frozenset(fit.names) and f.solved]
    return min(inside, key=lambda f: f.cost)


def refined(state: SearchState) -> SearchState:
    """Refine the discretisation at the best model, with its covariance of the readings.

    The best model is fitted again. The residuals of all others are shifted by the correction of the best one.
    """
    state = _reweighted(state)
    threshold = min(state.problem.robust_threshold, criteria.robust_threshold(state.best.residual))
    problem = replace(state.problem, robust_threshold=threshold)
    start = replace(state.best, stuck=False)
    (before,) = fitting.run_fits(problem, [fitting.finish(problem, start, fitting.Race())])
    correction, run = problem.correction, before.run
    for _ in range(3):
        problem, refined_run = refine(problem, before.effects, before.values, run)
        if refined_run is run:
            break
        run = refined_run
    changed = run is not before.run
    if changed:
        # The run is repeated along its known path, which makes the derivatives cheap.
        start = fit_of_run(problem, before.effects, before.values, run)
        fitted = fitting.evaluated(problem, before.effects, before.values, before.free, start)
        (again,) = fitting.run_fits(problem, [fitted])
    else:
        again = _shifted(problem, before, problem.correction - correction)
    if not again.solved:
        return state.with_history("on a finer mesh the best model is not solved; it stays as it was")
    shift = again.residual - before.residual
    fits = {key: _shifted(problem, old, shift) for key, old in state.fits.items()}
    (best,) = fitting.run_fits(problem, [fitting.finish(problem, again, fitting.Race())])
    fits[frozenset(best.names)] = best
    declared = fits[frozenset()]
    if changed:
        (declared,) = fitting.run_fits(problem, [fitting.evaluated(problem, (), {}, (), state.declared)])
        fits[frozenset()] = declared
    return replace(state, problem=problem, best=best, declared=declared, fits=fits)


def _reweighted(state: SearchState) -> SearchState:
    """With the covariance that declared errors of the inputs give the readings of the best model."""
    old, best = state.problem, state.best
    if not old.roots:
        return state
    problem = with_input_sigma(old, best.effects, best.values)

    def rewhitened(x: Array) -> Array:
        return problem.whitened((old.lengths(x).T / old.sigma).T)

    problem = replace(problem, correction=rewhitened(old.correction))

    def changed(fit: Fit) -> Fit:
        r, path = rewhitened(fit.residual), rewhitened(fit.path_residual)
        moved = replace(fit, residual=r, jacobian=rewhitened(fit.jacobian), path_residual=path)
        return _shifted(problem, moved, np.zeros(problem.count))

    fits = {key: changed(fit) for key, fit in state.fits.items()}
    declared, best = fits[frozenset()], fits[frozenset(best.names)]
    return replace(state, problem=problem, declared=declared, best=best, fits=fits, scores={})


def _shifted(problem: FitProblem, fit: Fit, shift: Array) -> Fit:
    """A fit with its residual shifted, and its cost by the measures of a problem."""
    return replace(problem.with_residual(fit, fit.residual + shift), path_residual=fit.path_residual + shift)


def as_good(state: SearchState) -> list[Fit]:
    """Other models that explain the data about as well as the best one, by their evidence."""
    problem, best = state.problem, state.best
    noise = criteria.effective_noise(problem, best)
    limit = criteria.bic(problem, best) + criteria.BIC_DIFFERENCE * noise
    others = [(criteria.bic(problem, f), f) for f in state.fits.values() if f.solved and f is not best]
    return [f for value, f in sorted(others, key=lambda x: x[0]) if value < limit]


def posterior(state: SearchState) -> list[tuple[Fit, float]]:
    """Probabilities of all models that were fitted, from their evidence; those below one in a million are left out.

    The weight of a model counts for the best one if both predict the same (they differ by less than sigma in all
    readings together) and it has unlisted causes, or the same effects in other forms. Where the best model has several
    causes, the rest up to 1 is the probability that one unknown cause acts instead of them.
    """
    problem, best = state.problem, state.best

    def same_explanation(fit: Fit) -> bool:
        alike = not fit.named or {e.listed for e in fit.effects} == {e.listed for e in best.effects}
        return alike and float(np.sum((fit.residual - best.residual) ** 2)) < 1.0

    noise = criteria.effective_noise(problem, best)
    solved = [f for f in state.fits.values() if f.solved] or [best]
    logarithms = np.array([-0.5 * criteria.rank(problem, f) / noise for f in solved])
    weights = np.exp(logarithms - np.max(logarithms))
    weights *= (1.0 - criteria.probability_of_unknown(best)) / np.sum(weights)
    every = zip(solved, weights.tolist(), strict=True)
    return [(best if same_explanation(f) else f, w) for f, w in every if w > 1e-6]
