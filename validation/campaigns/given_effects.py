"""What each of a list of effects takes away from measured data, fitted in a given order.

Effects are added one after another, with those before them fitted again; the mean distance of the markers is reported
on fitted and on held-out branches.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tdcr_fe.effects import Effect, Experiment, effect
from tdcr_fe.identify import fitting
from tdcr_fe.identify.criteria import robust_threshold
from tdcr_fe.identify.forward import ForwardModel
from tdcr_fe.identify.load_steps import held_out_branches
from tdcr_fe.identify.noise import estimate_sigma
from tdcr_fe.identify.problem import Fit, FitProblem, evaluate
from tdcr_fe.identify.screening import screen
from tdcr_fe.io.measured import MeasuredData, join_measured, read_measured
from tdcr_fe.validation.runner import Campaign

#: Path tolerance of the runs, over the length [1].
PATH_TOLERANCE = 5e-4


@dataclass(frozen=True)
class Stage:
    """A model with the effects up to one of the list."""

    added: str  # the effect that was added last; empty for the declared model
    problem: FitProblem
    fit: Fit

    def distance(self, which: NDArray[np.bool_]) -> float:
        """Mean distance between measured and predicted markers, over some readings [m]."""
        readings, use = self.problem.readings, which & self.problem.readings.is_position
        if not np.any(use):
            return float("nan")
        lengths = self.fit.residual * self.problem.sigma
        square = np.bincount(readings.markers[use], weights=lengths[use] ** 2)
        return float(np.mean(np.sqrt(square[np.bincount(readings.markers[use]) > 0])))


@dataclass(frozen=True)
class Outcome:
    """The models of all stages."""

    stages: list[
        dict[str, Any]
    ]  # what was added, mean distances [m] (also by branch), values of all parameters
    passed: bool  # whether every model was solved


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
    yield Stage("", problem, now)
    for e in effects:
        threshold = robust_threshold(now.residual)
        problem = replace(problem, robust_threshold=threshold)
        (score,) = screen(problem, now, [e])
        problem = replace(problem, scales={**problem.scales, **score.scales})
        starts = score.starts[:1] or [{**now.values, e.name: e.null_values(problem.experiment)}]
        now = fitting.fit(problem, (*now.effects, e), starts)
        yield Stage(e.name, problem, now)


@dataclass(frozen=True)
class Case:
    """What is asked for on the command line."""

    folders: list[str]
    effects: list[str]
    hold_out: list[str]
    every: int
    friction: str
    processes: int


def fit_all(case: Case) -> Outcome:
    """Read the data and fit all stages."""
    data = join_measured([every_nth_step(read_measured(folder), case.every) for folder in case.folders])
    if case.friction == "none":
        data = replace(data, model=replace(data.model, friction="none"))
    stages = []
    with ForwardModel(case.processes, data.settings) as forward:
        for stage in fit_in_order(data, case.effects, case.hold_out, forward):
            stages.append(stage)
            print(stage.added or "declared", file=sys.stderr)
    return Outcome([_document(s) for s in stages], all(s.fit.solved for s in stages))


def _document(stage: Stage) -> dict[str, Any]:
    data = stage.problem.data
    branch = dict(zip(data.step_ids, data.branches, strict=True))
    of_reading = np.array([branch[r.step] for r in data.readings])
    return {
        "added": stage.added,
        "fitted": stage.distance(stage.problem.fitted),
        "held_out": stage.distance(stage.problem.held_out),
        "values": stage.fit.values,
        "by_branch": {b: stage.distance(of_reading == b) for b in dict.fromkeys(branch.values())},
    }


class GivenEffects(Campaign):
    """See the text of this module."""

    unit = "case"
    outcome = Outcome

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        """The data, the effects, and how they are fitted."""
        parser.add_argument("folder", nargs="+", help="measured data, as for tdcr-fe identify")
        parser.add_argument(
            "--effects", nargs="+", required=True, metavar="NAME", help="in the order of adding"
        )
        parser.add_argument("--hold-out", nargs="+", required=True, metavar="PATTERN", help="branches")
        parser.add_argument("--every", type=int, default=1, metavar="N", help="every Nth step (1)")
        parser.add_argument(
            "--friction", choices=("declared", "none"), default="declared", help="of the model"
        )

    def cases(self, options: argparse.Namespace) -> Mapping[str, Case]:
        """One case: everything depends on what was fitted before."""
        if options.every < 1:
            raise ValueError("--every must be at least 1")
        asked = {k: v for k, v in vars(options).items() if k in ("effects", "hold_out", "every", "friction")}
        return {"fit": Case(options.folder, processes=options.processes, **asked)}

    def run(self, case: Case, out: Path) -> Outcome:
        """Fit all stages; an unknown name ends the command.

        Raises
        ------
        ValueError
            An unknown effect.
        """
        try:
            return fit_all(case)
        except KeyError as error:
            raise ValueError(error.args[0]) from error

    def table(self, outcomes: Sequence[Outcome]) -> pd.DataFrame:
        """Mean distance of the markers by stage [mm]."""
        rows = [
            (s["added"] or "declared", round(1e3 * s["fitted"], 2), round(1e3 * s["held_out"], 2))
            for o in outcomes
            for s in o.stages
        ]
        return pd.DataFrame(rows, columns=["added", "fitted [mm]", "held out [mm]"])

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """All stages, and the values of the last one."""
        (outcome,) = outcomes
        blocks: list[str | pd.DataFrame] = [self.table(outcomes)]
        for name, values in outcome.stages[-1]["values"].items():
            blocks.append(f"{name}: " + ", ".join(f"{key} = {value:.5g}" for key, value in values.items()))
        return blocks


CAMPAIGN = GivenEffects()
