"""Fit effects that are given by name, one after another, with those before them fitted again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Effect, Experiment, effect
from tdcr_fe.identify import fitting
from tdcr_fe.identify.criteria import robust_threshold
from tdcr_fe.identify.forward import ForwardModel
from tdcr_fe.identify.load_steps import held_out_branches
from tdcr_fe.identify.noise import estimate_sigma
from tdcr_fe.identify.problem import Fit, FitProblem, evaluate
from tdcr_fe.identify.screening import screen
from tdcr_fe.io.measured import MeasuredData

Array = NDArray[np.float64]

#: Path tolerance of the runs, over the length [1].
PATH_TOLERANCE = 5e-4


@dataclass(frozen=True)
class Stage:
    """A model with the effects up to one of the list.

    Attributes
    ----------
    added : str
        The effect that was added last; empty for the declared model.
    problem : FitProblem
    fit : Fit
    fitted, held_out : float
        Mean distance between measured and predicted markers [m].
    """

    added: str
    problem: FitProblem
    fit: Fit
    fitted: float
    held_out: float


def chosen_form(name: str, experiment: Experiment) -> Effect:
    """An effect of the list, or a form of one, by its name such as ``"pretension (each)"``.

    Raises
    ------
    KeyError
        Names those that exist.
    """
    forms = effect(name.split(" (")[0]).forms(experiment)
    for form in forms:
        if form.name == name:
            return form
    raise KeyError(f"no form {name!r}; there are {', '.join(f.name for f in forms)}")


def every_nth_step(data: MeasuredData, every: int) -> MeasuredData:
    """Every nth step of each branch, the first of each among them. History between them is lost."""
    seen: dict[str, int] = {}
    kept = []
    for k, branch in enumerate(data.branches):
        if seen.setdefault(branch, 0) % every == 0:
            kept.append(k)
        seen[branch] += 1
    numbers = {data.step_ids[k] for k in kept}
    return replace(
        data,
        step_ids=tuple(data.step_ids[k] for k in kept),
        steps=tuple(data.steps[k] for k in kept),
        branches=tuple(data.branches[k] for k in kept),
        readings=tuple(r for r in data.readings if r.step in numbers),
    )


def mean_distance(problem: FitProblem, residual: Array, which: NDArray[np.bool_]) -> float:
    """Mean distance in space between measured and predicted markers, over some readings [m]."""
    use = which & problem.readings.is_position
    if not np.any(use):
        return float("nan")
    square = np.bincount(problem.readings.markers[use], weights=(residual * problem.sigma)[use] ** 2)
    count = np.bincount(problem.readings.markers[use])
    return float(np.mean(np.sqrt(square[count > 0])))


def fit_in_order(
    data: MeasuredData, names: Sequence[str], patterns: Sequence[str], forward: ForwardModel
) -> Iterator[Stage]:
    """Fit the declared model with more and more effects.

    Parameters
    ----------
    data
        Measured data.
    names
        Effects or forms of effects, in the order of adding.
    patterns
        Branches that are held out.
    forward
        Simulates.

    Yields
    ------
    Stage
        The declared model, then one with each further effect.

    Raises
    ------
    KeyError
        An unknown name.
    """
    held = {data.step_ids[k] for k in held_out_branches(data, patterns)}
    held_out = np.array([r.step in held for r in data.readings])
    problem = FitProblem.of(data, np.ones(len(data.readings)), held_out, forward, PATH_TOLERANCE)
    effects = [chosen_form(name, problem.experiment) for name in names]
    now = evaluate(problem, (), {})
    problem = replace(problem, sigma=estimate_sigma(data, now.residual)[0])
    now = evaluate(problem, (), {})
    yield _stage("", problem, now)
    for e in effects:
        threshold = robust_threshold(now.residual)
        problem = replace(problem, robust_threshold=threshold)
        (score,) = screen(problem, now, [e])
        problem = replace(problem, scales={**problem.scales, **score.scales})
        starts = score.starts[:1] or [{**now.values, e.name: e.null_values(problem.experiment)}]
        now = fitting.fit(problem, (*now.effects, e), starts)
        yield _stage(e.name, problem, now)


def _stage(added: str, problem: FitProblem, fit: Fit) -> Stage:
    return Stage(
        added,
        problem,
        fit,
        mean_distance(problem, fit.residual, problem.fitted),
        mean_distance(problem, fit.residual, problem.held_out),
    )
