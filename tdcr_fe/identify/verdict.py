"""Conclusions from a finished or interrupted search: verdict, effects with their numbers, and what remains."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Effect, EffectAtPlace
from tdcr_fe.identify.bay_state import with_action
from tdcr_fe.identify.causes import Cause, is_named, kind_of
from tdcr_fe.identify.criteria import (
    chi_square_threshold,
    insufficient_data,
    mostly_estimated_noise,
    reduced_chi_square,
)
from tdcr_fe.identify.data_faults import jump_of_residual, wrong_sigma
from tdcr_fe.identify.explainable_variance import held_out_ceiling
from tdcr_fe.identify.fitting import covariance
from tdcr_fe.identify.forward import run_settings
from tdcr_fe.identify.long_data import RowChoice
from tdcr_fe.identify.noise import ALL_READINGS, outliers, structure
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.identify.result import (
    HALF_WIDTH,
    NOT_EVALUATED,
    NOT_KNOWN,
    THE_DATA,
    THE_INPUTS,
    THE_NOISE,
    AddedEffect,
    Estimate,
    FoundCause,
    FoundLaw,
    IdentificationResult,
    InputNoise,
    Misfit,
    NextExperiment,
    Profile,
    Remainder,
    SetErrors,
    Shapes,
    Structure,
    Verdict,
)
from tdcr_fe.identify.search_state import Search, SearchState, posterior
from tdcr_fe.identify.settings import CEILING, MAY_EXPLAIN

Array = NDArray[np.float64]

#: What remains where errors of the inputs account for it, and where nothing remains.
INPUTS_EXPLAIN = (
    "random errors of the inputs, independent in every step, would explain all of the remaining error"
)
ONLY_NOISE = "what is left has the size and the structure of the noise"

#: A group of readings is named where chance gives it so large a residual this rarely [1].
SIGNIFICANT = 1e-4


class Found(NamedTuple):
    """What an identification has found besides the last state of its search."""

    next_experiment: NextExperiment | None = None
    input_noise: InputNoise | None = None
    profiles: tuple[Profile, ...] = ()  # of the fitted parameters
    rows: RowChoice | None = None  # load steps that the search used; None for all
    sigma_estimated: bool = False  # whether any sigma was not given


def conclude(search: Search, state: SearchState, found: Found, begun: float = 0.0) -> IdentificationResult:
    """What a search has found.

    ``search``: with the deadline of these conclusions; ``begun``: reading of `time.perf_counter` at the beginning.
    """
    wall_time = time.perf_counter() - begun
    problem, best, declared = state.problem, state.best, state.declared
    data, held_out, fitted = problem.data, problem.held_out, problem.fitted
    judged = _judged(search, state, found)
    if not (judged.insufficient or judged.faulty):
        state, ceiling = _with_ceiling(search, state)
    else:
        ceiling = None
    law = found_law(state)
    verdict = _verdict(state, judged, law)
    tests = structure(data, best.residual, len(best.free))
    spread = covariance(problem, best)
    deviation = np.sqrt(np.maximum(np.diag(spread), 0.0))
    held_ids = sorted({data.readings[i].step for i in np.flatnonzero(held_out)}, key=data.step_ids.index)
    corrected = problem.with_effects(best.effects, best.values)
    declared_mesh = replace(corrected.model, elements_per_bay=data.model.elements_per_bay)
    return IdentificationResult(
        data=data,
        verdict=verdict,
        effects=added_effects(search, state, deviation, judged.explained),
        causes=found_causes(search, state),
        before_fit=problem.misfit(declared.residual, fitted),
        before_held_out=problem.misfit(declared.residual, held_out),
        after_fit=problem.misfit(best.residual, fitted, len(best.free)),
        after_held_out=problem.misfit(best.residual, held_out),
        held_out_steps=tuple(held_ids),
        remaining=_remaining(state, judged, tests),
        candidates=state.candidates,
        structure=tests[:12],
        residual_before=declared.residual * problem.sigma,
        residual_after=best.residual * problem.sigma,
        sigma=problem.sigma,
        sigma_estimated=found.sigma_estimated,
        outliers=outliers(best.residual),
        correlation=spread / np.maximum(np.outer(deviation, deviation), 1e-300),
        parameter_names=tuple(f"{a}.{b}" for a, b in best.free),
        mesh_error=problem.mesh_error,
        noise=problem.misfit(np.ones(problem.count), np.ones(problem.count, dtype=bool)),
        shapes=_shapes(problem, declared, best, set(held_ids)),
        corrected=replace(corrected, model=declared_mesh),
        commanded=problem.experiment,
        solver=run_settings(problem.forward.settings, problem.path_tolerance),
        left_out_candidates=dict(state.refused),
        runs=problem.forward.runs,
        wall_time=wall_time,
        not_tried=state.not_tried,
        interrupted=state.interrupted,
        history=state.history,
        catalogue=(*problem.catalogue, *(e for e in best.effects if isinstance(e, Cause))),
        law=law,
        next_experiment=found.next_experiment,
        input_noise=found.input_noise,
        profiles=found.profiles,
        jump=None if judged.explained or judged.faulty else jump_of_residual(problem, best),
        searched=None if found.rows is None else found.rows.described(data),
        by_set=_by_set(problem, declared, best),
        ceiling=ceiling,
        path=best.run.trajectory,
    )


class _Judgement(NamedTuple):
    """What is to be thought of the data and of what is left."""

    explained: bool  # whether what is left is noise
    # Why the data do not suffice, and their fault; empty where they do, and have none
    insufficient: str
    faulty: str
    inputs_explain: bool  # whether errors of the inputs account for all that is left
    # why what the declared model leaves cannot be told from noise, although it looks like noise; empty where
    # it can
    unknown_noise: str = ""

    @property
    def undecided(self) -> bool:
        """Whether the data do not tell what is missing."""
        return bool(self.insufficient or self.faulty or self.inputs_explain or self.unknown_noise)


def _judged(search: Search, state: SearchState, found: Found) -> _Judgement:
    """What is to be thought of the data and of what is left."""
    problem, best = state.problem, state.best
    explained = search.is_noise(problem, best)
    insufficient = insufficient_data(problem, state.declared, best, explained)
    alone = not (insufficient or best.effects)
    inputs_explain = alone and found.input_noise is not None and found.input_noise.explains_all
    faulty = state.data_fault or (wrong_sigma(problem, best) if alone and not inputs_explain else "")
    unknown_noise = mostly_estimated_noise(problem.data) if explained and alone and not faulty else ""
    return _Judgement(explained, insufficient, faulty, inputs_explain, unknown_noise)


def _with_ceiling(search: Search, state: SearchState) -> tuple[SearchState, Misfit | None]:
    """The ceiling of the held-out misfit, if the time suffices."""
    if state.interrupted:
        return state, None
    if search.out_of_time:
        return state.without_trying(CEILING), None
    return state, held_out_ceiling(state.problem, state.declared, state.best)


def _verdict(state: SearchState, judged: _Judgement, law: FoundLaw | None) -> Verdict:
    """The verdict."""
    if state.interrupted:
        return Verdict.UNFINISHED
    if judged.undecided:
        return Verdict.CANNOT_TELL
    if not judged.explained and not MAY_EXPLAIN.isdisjoint(state.not_tried):
        return Verdict.UNFINISHED
    if not judged.explained:
        return Verdict.PARTLY_EXPLAINED if state.best.effects or law is not None else Verdict.UNEXPLAINED
    if law is not None:
        return Verdict.LAW_FOUND
    return Verdict.EXPLAINED if state.best.effects else Verdict.NOTHING_MISSING


def _by_set(problem: FitProblem, declared: Fit, best: Fit) -> tuple[SetErrors, ...]:
    """Errors on every one of several data sets; empty where there is one."""
    found, first = [], 0
    for name, count in problem.data.parts:
        steps = problem.readings.reader.step
        own = (steps >= first) & (steps < first + count)
        fit, held = own & problem.fitted, own & problem.held_out
        misfits = [problem.misfit(f.residual, which) for f in (declared, best) for which in (fit, held)]
        found.append(SetErrors(name, first + 1, first + count, *misfits))
        first += count
    return tuple(found)


def _shapes(problem: FitProblem, base: Fit, best: Fit, held_out: set[int]) -> Shapes:
    """Measured and predicted positions by step, location and axis."""
    data = problem.data
    index = np.flatnonzero(problem.readings.is_position)
    locations = np.unique([float(data.readings[i].location or 0.0) for i in index])
    table = np.full((3, len(data.steps), locations.size, 3), np.nan)
    for i in index:
        r = data.readings[i]
        at = (
            problem.readings.reader.step[i],
            int(np.searchsorted(locations, float(r.location or 0.0))),
            "xyz".index(r.quantity[-1]),
        )
        for k, value in enumerate((0.0, base.residual[i], best.residual[i])):
            table[(k, *at)] = r.value - value * problem.sigma[i]
    backbones = []
    for fit in (base, best):
        observation = problem.with_effects(fit.effects, fit.values).observation
        seen = np.full((len(data.steps), *fit.run.positions.shape[1:]), np.nan)
        seen[: len(fit.run.positions)] = observation.seen(fit.run.positions)
        backbones.append(seen)
    return Shapes(
        held_out=np.array([n in held_out for n in data.step_ids]),
        arc_lengths=locations,
        measured=table[0],
        before=table[1],
        after=table[2],
        backbone_before=backbones[0],
        backbone_after=backbones[1],
    )


def _remaining(state: SearchState, judged: _Judgement, tests: Sequence[Structure]) -> Remainder:
    """Location and kind of the remaining error, as texts."""
    if judged.faulty:
        return Remainder(THE_DATA, judged.faulty)
    if judged.insufficient:
        return Remainder(NOT_KNOWN, judged.insufficient)
    if judged.inputs_explain:
        return Remainder(THE_INPUTS, INPUTS_EXPLAIN)
    if judged.unknown_noise:
        return Remainder(THE_NOISE, judged.unknown_noise)
    if judged.explained:
        return Remainder("nowhere", ONLY_NOISE)
    groups = [t.group for t in tests if t.p_value < SIGNIFICANT and t.group != ALL_READINGS]
    if not groups:
        return Remainder(ALL_READINGS, "more than noise is left, in no group of readings more than in others")
    return Remainder(
        groups[0], f"the residual is largest in these groups of readings: {', '.join(groups[:3])}"
    )


def found_law(state: SearchState) -> FoundLaw | None:
    """The causes without a name in the best model, with their numbers and in words; None where there are none."""
    problem, best = state.problem, state.best
    causes = [e for e in best.effects if isinstance(e, Cause)]
    if not causes:
        return None
    deviation = np.sqrt(np.maximum(np.diag(covariance(problem, best)), 0.0))
    formulas = []
    for e in causes:
        numbers = []
        for p in e.parameters:
            width = ""
            if (e.name, p.name) in best.free:
                width = f" +- {HALF_WIDTH * deviation[best.free.index((e.name, p.name))]:.2g}"
            unit = "" if p.unit == "1" else f" {p.unit}"
            numbers.append(f"{p.name} = {best.values[e.name][p.name]:.4g}{width}{unit}")
        formulas.append(f"{e.name} ({', '.join(numbers)})")
    experiment = problem.with_effects(best.effects, best.values)
    if best.run.acted is not None:
        experiment = with_action(experiment, best.run.acted.action)
    others = dict.fromkeys(n for e in causes for n in state.rivals.get(e.name, ()))
    sentence = "; ".join(e.sentence for e in causes)
    return FoundLaw(
        formula=" + ".join(formulas),
        sentence=f"{sentence[:1].upper()}{sentence[1:]}: the declared model does not have it.",
        where="; ".join(dict.fromkeys(e.kind.where for e in causes)),
        terms=tuple(e.name for e in causes),
        after_fit=problem.misfit(best.residual, problem.fitted, len(best.free)),
        after_held_out=problem.misfit(best.residual, problem.held_out),
        alternatives=tuple(others),
        steps=experiment.steps,
    )


def found_causes(search: Search, state: SearchState) -> tuple[FoundCause, ...]:
    """The kinds of the causes in the best model, with their probabilities among all models that were fitted."""
    weights = posterior(search, state)
    found = []
    for e in state.best.effects:
        kind = kind_of(e)
        same = sum(w for f, w in weights if any(kind_of(x) == kind for x in f.effects))
        found.append(FoundCause(e.name, kind.perturbs, kind.depends_on, kind.where, same))
    return tuple(found)


def added_effects(
    search: Search, state: SearchState, deviation: Array, explained: bool
) -> tuple[AddedEffect, ...]:
    """Effects in the order of adding, with the evidence for each."""
    problem, best, weights = state.problem, state.best, posterior(search, state)
    added = []
    before: Fit | None = state.declared
    for i, e in enumerate(best.effects):
        after: Fit | None = best
        if i < len(best.effects) - 1:
            after = state.fits.get(frozenset(x.name for x in best.effects[: i + 1]))
        rivals = tuple(state.rivals.get(e.name, ()))
        threshold = chi_square_threshold(len(e.parameters), search.significance)
        after_fit = after_held_out = NOT_EVALUATED
        probability = sum(w for f, w in weights if any(x.listed == e.listed for x in f.effects))
        evidence: dict[str, float] = {}
        if after is not None:
            after_fit = problem.misfit(after.residual, problem.fitted, len(after.free))
            after_held_out = problem.misfit(after.residual, problem.held_out)
        if before is not None and after is not None:
            evidence = {
                "chi2_drop_fit": before.cost - after.cost,
                "chi2_drop_held_out": before.held_cost - after.held_cost,
                "needed_drop": threshold * reduced_chi_square(problem, after),
            }
        added.append(
            AddedEffect(
                e.listed,
                _estimates(problem, best, e, deviation),
                after_fit,
                after_held_out,
                evidence,
                rivals,
                separating_experiments(e, rivals, problem.catalogue),
                explained and is_named(e),
                probability,
                e.name,
            )
        )
        before = after
    return tuple(added)


def separating_experiments(e: Effect, rivals: Sequence[str], catalogue: Sequence[Effect]) -> str:
    """Experiments that separate an effect from its rivals, those of each listed effect once; empty without rivals.

    Rivals may be other forms of the same listed effect.
    """
    if not rivals:
        return ""
    listed = {name.split(" (")[0] for name in rivals} - {e.listed}
    others = [x for x in catalogue if x.name in listed]
    sentences = [f"for {e.listed}: {e.separating_experiment}"]
    return "; ".join([*sentences, *(f"for {x.name}: {x.separating_experiment}" for x in others)])


def _estimates(problem: FitProblem, best: Fit, e: Effect, deviation: Array) -> dict[str, Estimate]:
    """Values of an effect's parameters with their standard errors; of a place, half the way to the next one."""
    numbers = {}
    if isinstance(e, EffectAtPlace):
        spread, units = e.spread(problem.data.robot), {p.name: p.unit for p in e.general.parameters}
        numbers = {
            name: Estimate(value, spread[name], units[name], "the best of all places")
            for name, value in e.place.items()
        }
    for p in e.parameters:
        value = best.values[e.name][p.name]
        null = e.null_values(problem.experiment)[p.name]
        kept = "left at its null value" if value == null else "it changes nothing beside the other values"
        error, note = None, f"not determined by these data; {kept}"
        if (e.name, p.name) in best.free:
            note = ""
            factor = value**2 if p.inverse and math.isfinite(value) else 1.0
            error = float(deviation[best.free.index((e.name, p.name))]) * factor
            low, high = problem.bounds(e, p.name)
            z = p.coordinate(value)
            if min(abs(z - low), abs(high - z)) < 1e-9 * max(1.0, abs(high - low)):
                note = "at its bound"
        numbers[p.name] = Estimate(float(value), error, p.unit, note)
    return numbers
