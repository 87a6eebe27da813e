"""Conclusions from a finished or interrupted search: verdict, effects with their numbers, and what remains."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from tdcr_fe.effects import Effect, EffectAtPlace
from tdcr_fe.elements import Array, Flags
from tdcr_fe.identify import criteria
from tdcr_fe.identify.causes import Cause, is_named
from tdcr_fe.identify.data_faults import gross_errors, wrong_sigma
from tdcr_fe.identify.fitting import covariance
from tdcr_fe.identify.forward import run_settings
from tdcr_fe.identify.noise import ALL_READINGS, REPORTED, held_out_ceiling, outliers, structure
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.identify.result import (
    NAMED,
    NOT_EVALUATED,
    NOT_KNOWN,
    THE_DATA,
    THE_INPUTS,
    THE_NOISE,
    AddedEffect,
    Errors,
    Estimate,
    IdentificationResult,
    Parameters,
    Remainder,
    Residuals,
    SetErrors,
    Shapes,
    Simulated,
    Structure,
    Verdict,
)
from tdcr_fe.identify.search_state import SearchState, posterior
from tdcr_fe.identify.settings import MAY_EXPLAIN, Part, clock


def conclude(state: SearchState, begun: float = 0.0, deadline: float = math.inf) -> IdentificationResult:
    """What a search has found.

    ``begun``: reading of `time.perf_counter` at the beginning; ``deadline``: of these conclusions, of
    `tdcr_fe.identify.settings.clock` [s].
    """
    wall_time = time.perf_counter() - begun
    problem, best, declared, data = state.problem, state.best, state.declared, state.problem.data
    tests = structure(data, best.residual, len(best.free))
    explained = criteria.residual_is_noise(problem, best)
    unknown = criteria.probability_of_unknown(best) if explained else 0.0
    undecided = _undecided(state, explained)
    ceiling = None
    if not state.log.interrupted and (undecided is None or undecided.where in (THE_INPUTS, THE_NOISE)):
        if clock() > deadline:
            state = state.without_trying(Part.CEILING)
        else:
            ceiling = held_out_ceiling(problem, declared, best)
    spread = covariance(problem, best)
    deviation = np.sqrt(np.maximum(np.diag(spread), 0.0))
    effects = tuple(added_effects(state, deviation, explained))
    certain = unknown <= 1.0 - NAMED and all(e.kind_probability > NAMED for e in effects)
    held = {data.readings[i].step for i in np.flatnonzero(problem.held_out)}
    corrected = problem.acted(best.effects, best.values, best.run)
    left = problem.lengths(declared.residual), problem.lengths(best.residual), problem.whole_sigma
    correlation = spread / np.maximum(np.outer(deviation, deviation), 1e-300)
    free = tuple(map(".".join, best.free))
    catalogue = (*problem.catalogue, *(e for e in best.effects if isinstance(e, Cause)))
    models = problem.experiment, corrected, run_settings(problem.forward.settings, problem.path_tolerance)
    return IdentificationResult(
        data=data,
        verdict=_verdict(state, undecided, explained, certain),
        effects=effects,
        before=_errors(problem, declared),
        after=_errors(problem, best, parameters=len(best.free)),
        noise=problem.misfit(problem.whitened(problem.whole_sigma / problem.sigma)),
        held_out_steps=tuple(n for n in data.step_ids if n in held),
        remaining=undecided or _remaining(explained, tests),
        shapes=_shapes(problem, declared, best, held),
        residuals=Residuals(*left, outliers(best.residual), tests[:12]),
        parameters=Parameters(free, correlation, state.profiles, tuple(deviation.tolist())),
        log=replace(state.log, runs=problem.forward.runs, wall_time=wall_time),
        simulated=Simulated(*models, catalogue, best.run.trajectories, problem.mesh_error),
        ceiling=ceiling,
        next_experiment=state.next_experiment,
        scatter=state.scatter,
        by_set=tuple(_by_set(problem, declared, best)),
        unknown=unknown,
    )


def _errors(problem: FitProblem, fit: Fit, which: Flags | bool = True, parameters: int = 0) -> Errors:
    """Errors of a model, on some readings; ``parameters``: how many were fitted."""
    r, fitted = fit.residual, which & problem.fitted
    return Errors(problem.misfit(r, fitted, parameters), problem.misfit(r, which & problem.held_out))


def _undecided(state: SearchState, explained: bool) -> Remainder | None:
    """Why the data do not tell what is missing; None where they do."""
    problem, best = state.problem, state.best
    insufficient = criteria.insufficient_data(problem, state.declared, best, explained)
    alone = not (insufficient or best.effects)
    scatter = state.scatter if not insufficient and state.scatter and state.scatter.explains_all else None
    faulty = state.data_fault or (wrong_sigma(problem, best) if alone and scatter is None else "")
    faulty = faulty or ("" if explained else gross_errors(problem, best))
    unknown_noise = criteria.mostly_estimated_noise(problem.data) if explained and alone else ""
    what = "" if scatter is None else scatter.what
    shifted = "another shift of all positions in every step would explain all of the remaining error"
    inputs = "errors of the inputs, different in every step, would explain all of the remaining error"
    reasons = (
        Remainder(THE_DATA, faulty),
        Remainder(NOT_KNOWN, insufficient),
        Remainder(THE_DATA, shifted if what == "positions" else ""),
        Remainder(THE_INPUTS, inputs if what == "inputs" else ""),
        Remainder(THE_NOISE, unknown_noise),
    )
    return next((reason for reason in reasons if reason.description), None)


def _verdict(state: SearchState, undecided: Remainder | None, explained: bool, certain: bool) -> Verdict:
    """The verdict: the first that holds; ``certain``: whether kinds and places of all causes are."""
    best = state.best
    verdicts = (
        (Verdict.UNFINISHED, state.log.interrupted),
        (Verdict.CANNOT_TELL, undecided is not None),
        (Verdict.UNFINISHED, not explained and not MAY_EXPLAIN.isdisjoint(state.log.not_tried)),
        (Verdict.PARTLY_EXPLAINED, not explained and best.effects),
        (Verdict.UNEXPLAINED, not explained),
        (Verdict.LAW_FOUND, certain and not best.named),
        (Verdict.EXPLAINED, best.effects),
        (Verdict.NOTHING_MISSING, True),
    )
    return next(verdict for verdict, holds in verdicts if holds)


def _remaining(explained: bool, tests: Sequence[Structure]) -> Remainder:
    """Location and kind of the remaining error, as texts."""
    if explained:
        return Remainder("nowhere", "what is left has the size and the structure of the noise")
    groups = [t.group for t in tests if t.p_value < REPORTED and t.group != ALL_READINGS]
    if not groups:
        return Remainder(ALL_READINGS, "more than noise is left, in no group of readings more than in others")
    return Remainder(groups[0], f"the residual is least like noise in: {', '.join(groups[:3])}")


def _by_set(problem: FitProblem, declared: Fit, best: Fit) -> Iterator[SetErrors]:
    """Errors on every one of several data sets; none where there is one."""
    first, steps = 0, problem.readings.step
    for name, count in problem.data.parts:
        both = (_errors(problem, fit, (steps >= first) & (steps < first + count)) for fit in (declared, best))
        yield SetErrors(name, first + 1, first + count, *both)
        first += count


def _shapes(problem: FitProblem, base: Fit, best: Fit, held_out: set[int]) -> Shapes:
    """Measured and predicted positions by step, location and axis."""
    data, readings = problem.data, problem.readings
    index = np.flatnonzero(readings.is_position)
    s = np.array([float(data.readings[i].location or 0.0) for i in index])
    locations = np.unique(s)
    table = np.full((3, len(data.steps), locations.size, 3), np.nan)
    at = readings.step[index], np.searchsorted(locations, s), readings.axes[index]
    for part, residual in zip(table, (0.0 * base.residual, base.residual, best.residual), strict=True):
        part[at] = (readings.values - problem.lengths(residual))[index]
    each = ((problem.with_effects(fit.effects, fit.values), fit.run) for fit in (base, best))
    backbones = (experiment.observation.seen(run.positions) for experiment, run in each)
    return Shapes(np.array([n in held_out for n in data.step_ids]), locations, *table, *backbones)


def added_effects(state: SearchState, deviation: Array, explained: bool) -> Iterator[AddedEffect]:
    """Effects in the order of adding, with the evidence for each."""
    problem, best, weights = state.problem, state.best, posterior(state)
    # if all causes are of one kind, a single unknown cause in their place is of that kind, too
    another = criteria.probability_of_unknown(best) if len({e.kind for e in best.effects}) == 1 else 0.0
    before: Fit | None = state.declared
    for i, e in enumerate(best.effects):
        kind, names = e.kind, frozenset(x.name for x in best.effects[: i + 1])
        after = best if i == len(best.effects) - 1 else state.fits.get(names)
        rivals = state.rivals.get(e.name, ())
        probability = sum(w for f, w in weights if any(x.listed == e.listed for x in f.effects))
        alike = another + sum(w for f, w in weights if any(x.kind == kind for x in f.effects))
        errors = NOT_EVALUATED if after is None else _errors(problem, after, parameters=len(after.free))
        evidence: dict[str, float] = {}
        if before is not None and after is not None:
            threshold = criteria.chi_square_threshold(len(e.parameters))
            evidence = {
                "chi2_drop_fit": before.cost - after.cost,
                "chi2_drop_held_out": before.held_cost - after.held_cost,
                "needed_drop": threshold * criteria.reduced_chi_square(problem, after),
            }
        yield AddedEffect(
            name=e.listed,
            parameters=estimates(problem, best, e, deviation),
            after=errors,
            evidence=evidence,
            kind=kind,
            indistinguishable_from=rivals,
            separating_experiment=separating_experiments(e, rivals, problem.catalogue),
            found=explained and is_named(e) and probability > NAMED,
            probability=min(probability, 1.0),  # sums of weights round off
            kind_probability=min(alike, 1.0),
            form=e.name,
            sentence=e.sentence if isinstance(e, Cause) else "",
        )
        before = after


def separating_experiments(e: Effect, rivals: Sequence[str], catalogue: Sequence[Effect]) -> str:
    """Experiments that separate an effect from its rivals, those of each listed effect once; empty without rivals.

    Rivals may be other forms of the same listed effect. Unlisted causes have none.
    """
    if not rivals:
        return ""
    listed = {name.split(" (")[0] for name in rivals} - {e.listed}
    known = [x for x in (e, *(x for x in catalogue if x.name in listed)) if x.separating_experiment]
    return "; ".join(f"for {x.listed}: {x.separating_experiment}" for x in known)


def estimates(problem: FitProblem, best: Fit, e: Effect, deviation: Array) -> dict[str, Estimate]:
    """Values of an effect's parameters with their standard errors; of a place, half the way to the next one."""
    numbers = {}
    if isinstance(e, EffectAtPlace):
        of = e.general
        spread, units = of.spread(problem.data.robot, e.place), {p.name: p.unit for p in of.parameters}
        for name, value in e.place.items():
            numbers[name] = Estimate(value, spread[name], units[name], "the best of all places")
    for p in e.parameters:
        value = best.values[e.name][p.name]
        null = e.null_values(problem.experiment)[p.name]
        kept = "left at its null value" if value == null else "it changes nothing besides the other values"
        error, note = None, f"not determined by these data; {kept}"
        if (e.name, p.name) in best.free:
            factor = value**2 if p.inverse and math.isfinite(value) else 1.0
            error = float(deviation[best.free.index((e.name, p.name))]) * factor
            low, high = problem.bounds(e, p.name)
            z = p.coordinate(value)
            near = min(abs(z - low), abs(high - z)) < 1e-9 * max(1.0, abs(high - low))
            note = "at its bound" if near else ""
        numbers[p.name] = Estimate(float(value), error, p.unit, note)
    return numbers
