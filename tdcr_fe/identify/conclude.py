"""Conclusions from a finished or interrupted search: verdict, effects with their numbers, and what remains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.identify.added_effects import added_effects
from tdcr_fe.identify.ceiling import held_out_ceiling
from tdcr_fe.identify.criteria import residual_is_noise
from tdcr_fe.identify.data_faults import jump_of_residual, wrong_sigma
from tdcr_fe.identify.findings import (
    THE_DATA,
    THE_INPUTS,
    THE_NOISE,
    InputScatter,
    NextExperiment,
    Remainder,
    SetErrors,
    Shapes,
)
from tdcr_fe.identify.fitting import covariance
from tdcr_fe.identify.found_law import FoundLaw
from tdcr_fe.identify.information import insufficient_data, mostly_estimated_noise
from tdcr_fe.identify.misfit import Misfit, Noise, Structure
from tdcr_fe.identify.noise import outliers, structure
from tdcr_fe.identify.outcome import IdentificationResult, Verdict
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.identify.rows import RowChoice
from tdcr_fe.identify.search_state import Search, SearchState
from tdcr_fe.identify.simulate_run import run_settings
from tdcr_fe.identify.time_limit import CEILING, MAY_EXPLAIN, clock
from tdcr_fe.identify.unlisted import describe_moment, missing_moment

Array = NDArray[np.float64]

#: What remains where errors of the inputs account for it.
INPUTS_EXPLAIN = "errors of the inputs, other ones in every step, would account for all that is left"


def conclude(
    search: Search,
    state: SearchState,
    sigma_estimated: bool,
    begun: float,
    law: FoundLaw | None = None,
    next_experiment: NextExperiment | None = None,
    rows: RowChoice | None = None,
    input_scatter: InputScatter | None = None,
) -> IdentificationResult:
    """What a search has found.

    Parameters
    ----------
    search, state
        The search, with the deadline of these conclusions, and its last state.
    sigma_estimated
        Whether any sigma was not given.
    begun
        Reading of `tdcr_fe.identify.time_limit.clock` at the begin of the identification [s].
    law
        On no list, and part of the state's best model.
    next_experiment
        That helps most.
    rows
        Load steps that the search used; None for all.
    input_scatter
        That would account for a part of what is left.
    """
    wall_time = clock() - begun
    problem, best, declared = state.problem, state.best, state.declared
    data, held_out, fitted = problem.data, problem.held_out, problem.fitted
    judged = _judged(search, state, law, input_scatter)
    doubtful = bool(judged.insufficient or judged.faulty)
    state, ceiling = (state, None) if doubtful else _with_ceiling(search, state)
    tests = structure(data, best.residual, len(best.free))
    spread = covariance(problem, best)
    deviation = np.sqrt(np.maximum(np.diag(spread), 0.0))
    moment, edges = missing_moment(problem, best)
    held_ids = sorted({data.readings[i].step for i in np.flatnonzero(held_out)}, key=data.step_ids.index)
    corrected = problem.with_effects(best.effects, best.values)
    declared_mesh = replace(corrected.model, elements_per_bay=data.model.elements_per_bay)
    return IdentificationResult(
        data=data,
        verdict=_verdict(state, judged, law),
        effects=added_effects(search, state, deviation),
        before_fit=problem.misfit(declared.residual, fitted),
        before_held_out=problem.misfit(declared.residual, held_out),
        after_fit=problem.misfit(best.residual, fitted, len(best.free)),
        after_held_out=problem.misfit(best.residual, held_out),
        held_out_steps=tuple(held_ids),
        remaining=_remaining(state, judged, tests, moment, edges),
        candidates=state.candidates,
        structure=tests[:12],
        residual_before=declared.residual * problem.sigma,
        residual_after=best.residual * problem.sigma,
        sigma=problem.sigma,
        sigma_estimated=sigma_estimated,
        outliers=outliers(best.residual),
        correlation=spread / np.maximum(np.outer(deviation, deviation), 1e-300),
        parameter_names=tuple(f"{a}.{b}" for a, b in best.free),
        mesh_error=problem.mesh_error,
        noise=_noise(problem, sigma_estimated),
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
        catalogue=problem.catalogue,
        law=law,
        next_experiment=next_experiment,
        input_scatter=input_scatter,
        jump="" if judged.explained or judged.faulty else jump_of_residual(problem, best),
        searched=None if rows is None else rows.described(data),
        by_set=_by_set(problem, declared, best),
        ceiling=ceiling,
        path=best.run.trajectory,
    )


class _Judgement(NamedTuple):
    """What is to be thought of the data and of what is left.

    Attributes
    ----------
    explained : bool
        Whether what is left is noise.
    insufficient, faulty : str
        Why the data do not suffice, and their fault; empty where they do, and have none.
    inputs_explain : bool
        Whether errors of the inputs account for all that is left.
    unknown_noise : str
        Why what the declared model leaves cannot be told from noise, although it looks like noise; empty where it can.
    """

    explained: bool
    insufficient: str
    faulty: str
    inputs_explain: bool
    unknown_noise: str = ""

    @property
    def undecided(self) -> bool:
        """Whether the data do not tell what is missing."""
        return bool(self.insufficient or self.faulty or self.inputs_explain or self.unknown_noise)


def _judged(
    search: Search, state: SearchState, law: FoundLaw | None, input_scatter: InputScatter | None
) -> _Judgement:
    """What is to be thought of the data and of what is left."""
    problem, best = state.problem, state.best
    explained = residual_is_noise(problem, best, search.significance)
    insufficient = insufficient_data(problem, state.declared, best, explained)
    alone = not (insufficient or best.effects or law)
    inputs_explain = alone and input_scatter is not None and input_scatter.explains_all
    faulty = state.data_fault or (wrong_sigma(problem, best) if alone and not inputs_explain else "")
    unknown_noise = mostly_estimated_noise(problem.data) if explained and alone and not faulty else ""
    return _Judgement(explained, insufficient, faulty, inputs_explain, unknown_noise)


def _with_ceiling(search: Search, state: SearchState) -> tuple[SearchState, Misfit | None]:
    """The ceiling of the held-out misfit, if the time suffices."""
    if state.interrupted:
        return state, None
    if search.late:
        return state.without_trying(CEILING), None
    return state, held_out_ceiling(state.problem, state.declared, state.best)


def _verdict(state: SearchState, judged: _Judgement, law: FoundLaw | None) -> Verdict:
    """The verdict."""
    if state.interrupted:
        return "unfinished"
    if judged.undecided:
        return "cannot tell"
    if not judged.explained and not MAY_EXPLAIN.isdisjoint(state.not_tried):
        return "unfinished"
    if not judged.explained:
        return "partly explained" if state.best.effects or law is not None else "unexplained"
    if law is not None:
        return "explained by a law found"
    return "explained" if state.best.effects else "nothing missing"


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


def _noise(problem: FitProblem, estimated: bool) -> Noise:
    """Noise given by sigma, in the measures of a misfit."""
    all_readings = np.ones(len(problem.readings.values), dtype=bool)
    size = problem.misfit(np.ones(len(problem.readings.values)), all_readings)
    return Noise(size.rms_position, size.rms_coordinate, size.rms_angle, size.rms_by_quantity, estimated)


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
        step_ids=data.step_ids,
        branches=data.branches,
        held_out=np.array([n in held_out for n in data.step_ids]),
        arc_lengths=locations,
        measured=table[0],
        before=table[1],
        after=table[2],
        backbone_before=backbones[0],
        backbone_after=backbones[1],
    )


def _remaining(
    state: SearchState,
    judged: _Judgement,
    tests: Sequence[Structure],
    moment: Array,
    edges: Array,
) -> Remainder:
    """Location and kind of the remaining error, as texts."""
    problem = state.problem
    if judged.faulty:
        return Remainder(THE_DATA, judged.faulty, moment, edges)
    if judged.insufficient:
        return Remainder("not known", judged.insufficient, moment, edges)
    if judged.inputs_explain:
        return Remainder(THE_INPUTS, INPUTS_EXPLAIN, moment, edges)
    if judged.unknown_noise:
        return Remainder(THE_NOISE, judged.unknown_noise, moment, edges)
    if judged.explained:
        text = "what is left has the size and the structure of the noise"
        return Remainder("nowhere", text, moment, edges)
    where, text = describe_moment(problem, moment, edges)
    significant = [t for t in tests if t.p_value < 1e-4][:3]
    if significant:
        text += "; the residual is largest in: " + ", ".join(t.group for t in significant)
    return Remainder(where, text, moment, edges)
