"""Whether the experiment that identify suggests next separates two effects that explain the first readings alike.

Each set is simulated by the reference; it passes where nine tenths of the ambiguous ones are separated.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tdcr_fe.effects import Experiment, Observation, effect, with_effects
from tdcr_fe.identify import IdentifySettings, fitting
from tdcr_fe.identify.criteria import bic, residual_is_noise
from tdcr_fe.identify.forward import ForwardModel
from tdcr_fe.identify.next_experiment import choose_next, leading_rivals
from tdcr_fe.identify.problem import Fit, FitProblem, evaluate, refine
from tdcr_fe.identify.result import NextExperiment
from tdcr_fe.identify.screening import screen
from tdcr_fe.identify.search_state import Search, SearchState
from tdcr_fe.io.measured import MeasuredData, join_measured
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.messages import count
from tdcr_fe.validation.blind.declared import draw_loading, draw_markers, draw_robot, planned_readings, read
from tdcr_fe.validation.blind.recipes import Drive
from tdcr_fe.validation.reference import ReferenceSettings, solve_reference
from tdcr_fe.validation.runner import Campaign

Array = NDArray[np.float64]

#: Standard deviation of the readings, all of which are positions [m].
SIGMA = 2e-4

_SEARCH = Search(IdentifySettings(), lambda text, share: None)


@dataclass(frozen=True)
class Ambiguity:
    """Two effects that look alike where nothing is read while the tip is loaded."""

    truth: str  # name of an effect
    rival: str
    robot: str  # kind, see `tdcr_fe.validation.blind.recipes.ROBOTS`
    drive: Drive
    seed: int  # of robot, loading sequence, size of the effect and noise


_KINDS: tuple[tuple[str, str, Drive], ...] = (
    ("stiffness_scale", "actuator_gain", "tension"),
    ("actuator_gain", "stiffness_scale", "tension"),
)
_ROBOTS = ("parallel", "single", "helical", "converging", "points", "two-segment")

#: Each kind with each robot; stretch of tendons and a gain of displacements are separated by the first readings.
AMBIGUITIES = tuple(
    Ambiguity(truth, rival, robot, drive, 100 * k + n)
    for k, robot in enumerate(_ROBOTS)
    for n, (truth, rival, drive) in enumerate(_KINDS)
)


@dataclass(frozen=True)
class Outcome:
    """What became of a set."""

    set: str
    ambiguous: (
        bool  # whether both effects explain the first readings, within noise and with nothing that decides
    )
    expected: float | None = None  # separation that the chosen experiment was expected to bring [sigma]
    difference: float | None = None  # BIC of the rival less that of the truth with the experiment added [1]
    separated: bool = False  # whether the truth is then the best model and the rival explains it no more

    @property
    def passed(self) -> bool:
        """Whether nothing is left open."""
        return self.separated or not self.ambiguous


def run_set(which: Ambiguity) -> Outcome:
    """Make a set, choose the next experiment between its two explanations, simulate it, add it, and fit both again."""
    name = f"{which.truth} or {which.rival}, {which.robot}"
    rng = np.random.default_rng([12, which.seed])
    robot = draw_robot(which.robot, rng)
    steps, branches = draw_loading(robot, which.drive, False, rng)
    declared = Experiment(robot, Model(friction="none", elements_per_bay=2), steps)
    markers = draw_markers(robot, rng)
    declared = replace(declared, observation=Observation(markers=markers))
    truth = {which.truth: _size(which.truth, rng)}
    unloaded = [k for k, s in enumerate(steps) if not any(any(load.force) for load in s.loads.values())]
    first = _measured("first", declared, truth, branches, markers, unloaded, rng)
    state = _fitted(first, (which.truth, which.rival))
    if not _both_explain(state):
        return Outcome(name, False)
    chosen = choose_next(_SEARCH, state)
    if chosen is None or not chosen.separated:
        return Outcome(name, True)
    added = _added(declared, truth, chosen, markers, rng)
    after = _fitted(join_measured([first, added]), (which.truth, which.rival))
    right, wrong = (after.fits[frozenset({name})] for name in (which.truth, which.rival))
    separated = after.best is right and wrong not in leading_rivals(_SEARCH, after)
    difference = bic(after.problem, wrong) - bic(after.problem, right)
    return Outcome(name, True, min(chosen.separation), difference, separated)


def _size(name: str, rng: np.random.Generator) -> dict[str, float]:
    """Values of an effect, some 5 to 20 % of what the robot does."""
    share = float(rng.uniform(0.05, 0.2))
    if name == "actuator_gain":
        return {"gain": 1.0 - share}
    return {"bending": 1.0 + share, "torsion": 1.0 + share}


def _measured(
    name: str,
    declared: Experiment,
    truth: dict[str, dict[str, float]],
    branches: Sequence[str],
    markers: tuple[float, ...],
    chosen: Sequence[int],
    rng: np.random.Generator,
) -> MeasuredData:
    """Positions on some steps of the true robot, by the reference, with noise.

    Raises
    ------
    RuntimeError
        The reference does not solve the true robot.
    """
    setup = with_effects(declared, truth)
    result = solve_reference(
        setup.robot, setup.model, setup.steps, settings=ReferenceSettings(sample_at=markers, substeps=1)
    )
    if not result.converged:
        raise RuntimeError(f"the true robot is not solved: {result.message}")
    every = [m for m in planned_readings(setup, markers, []) if m[1].startswith("position_")]
    marks = [m for m in every if m[0] in set(chosen)]
    exact = read(result, setup, marks)
    values = exact + rng.normal(0.0, SIGMA, len(exact))
    readings = tuple(
        Reading(step + 1, quantity, location, float(v), SIGMA)
        for (step, quantity, location), v in zip(marks, values, strict=True)
    )
    ids = tuple(range(1, len(declared.steps) + 1))
    return MeasuredData(name, declared.robot, declared.model, ids, declared.steps, tuple(branches), readings)


def _added(
    declared: Experiment,
    truth: dict[str, dict[str, float]],
    chosen: NextExperiment,
    markers: tuple[float, ...],
    rng: np.random.Generator,
) -> MeasuredData:
    """The chosen experiment, carried out on the true robot."""
    steps: tuple[LoadStep, ...] = chosen.steps
    planned = replace(declared, steps=steps)
    return _measured("next", planned, truth, ["next"] * len(steps), markers, range(len(steps)), rng)


def _fitted(data: MeasuredData, names: Sequence[str]) -> SearchState:
    """Each of the effects fitted alone; the best of the state is the one with the lower BIC."""
    held_out = np.zeros(len(data.readings), dtype=bool)
    problem = FitProblem.of(data, np.full(held_out.size, SIGMA), held_out, ForwardModel())
    problem, _ = refine(problem, (), {})
    state = SearchState.start(problem, evaluate(problem, (), {}))
    fits: list[Fit] = []
    for e in map(effect, names):
        (score,) = screen(problem, state.declared, [e])
        problem = replace(problem, scales={**problem.scales, **score.scales})
        starts = score.starts[:1] or [{e.name: e.null_values(problem.experiment)}]
        fits.append(fitting.fit(problem, (e,), starts))
    best = min(fits, key=lambda f: bic(problem, f))
    return replace(state, problem=problem, best=best, fits={frozenset(f.names): f for f in fits})


def _both_explain(state: SearchState) -> bool:
    """Whether every model leaves noise, and the other one is a rival of the best."""
    noise = all(residual_is_noise(state.problem, f, _SEARCH.significance) for f in state.fits.values())
    return noise and bool(leading_rivals(_SEARCH, state))


class NextExperimentSets(Campaign):
    """See the text of this module."""

    unit = "set"
    outcome = Outcome

    def cases(self, options: argparse.Namespace) -> Mapping[str, Ambiguity]:
        """Every kind of ambiguity with every robot, by seed."""
        return {str(a.seed): a for a in AMBIGUITIES}

    def run(self, case: Ambiguity, out: Path) -> Outcome:
        """Make a set, choose the experiment, add it."""
        return run_set(case)

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """All sets, and how many are separated."""
        ambiguous = [o for o in outcomes if o.ambiguous]
        separated = sum(o.separated for o in ambiguous)
        return [
            self.table(outcomes),
            f"{separated} of {count(len(ambiguous), 'set')} with two explanations are separated",
        ]

    def passed(self, outcomes: Sequence[Outcome]) -> bool:
        """Nine tenths of the ambiguous sets, of which there are some."""
        ambiguous = [o for o in outcomes if o.ambiguous]
        return bool(ambiguous) and sum(o.separated for o in ambiguous) >= 0.9 * len(ambiguous)


CAMPAIGN = NextExperimentSets()
