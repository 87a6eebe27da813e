"""The effects of the final model with their parameters, their evidence, and what separates them from others."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Effect, EffectAtPlace
from tdcr_fe.identify.criteria import chi_square_threshold, reduced_chi_square
from tdcr_fe.identify.estimate import Estimate
from tdcr_fe.identify.findings import AddedEffect
from tdcr_fe.identify.misfit import NOT_EVALUATED
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.identify.search_state import Search, SearchState

Array = NDArray[np.float64]


def added_effects(search: Search, state: SearchState, deviation: Array) -> tuple[AddedEffect, ...]:
    """Effects in the order of adding, with the evidence for each."""
    problem, best = state.problem, state.best
    added = []
    before: Fit | None = state.declared
    for i, e in enumerate(best.effects):
        after: Fit | None = best
        if i < len(best.effects) - 1 or ("law" in {k for k, _ in best.free}):
            after = state.fits.get(frozenset(x.name for x in best.effects[: i + 1]))
        rivals = tuple(state.rivals.get(e.name, ()))
        threshold = chi_square_threshold(len(e.parameters), search.significance)
        after_fit = after_held_out = NOT_EVALUATED
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
            )
        )
        before = after
    return tuple(added)


def separating_experiments(e: Effect, rivals: Sequence[str], catalogue: Sequence[Effect]) -> str:
    """Experiments that separate an effect from its rivals, those of each listed effect once; empty without rivals.

    Parameters
    ----------
    e
        In the final model.
    rivals
        Names of effects that explain the data as well, which may be other forms of the same listed effect.
    catalogue
        The candidates.
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
