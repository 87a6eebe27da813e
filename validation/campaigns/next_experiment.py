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

from tdcr_fe.effects import Experiment, Observation, with_effects
from tdcr_fe.identify import IdentificationResult, identify
from tdcr_fe.io.measured import MeasuredData, join_measured
from tdcr_fe.model.loading import Model
from tdcr_fe.model.messages import count
from tdcr_fe.validation.blind.declared import draw_loading, draw_robot
from tdcr_fe.validation.blind.readings import draw_markers, measured, planned, read, solved
from tdcr_fe.validation.blind.recipes import ROBOTS
from tdcr_fe.validation.reference import ReferenceSettings
from tdcr_fe.validation.runner import Campaign

#: Standard deviation of the readings, all of which are positions [m].
SIGMA = 2e-4


@dataclass(frozen=True)
class Ambiguity:
    """Two effects that look alike where nothing is read while the tip is loaded."""

    truth: str  # name of an effect
    rival: str
    robot: str  # kind, see `tdcr_fe.validation.blind.recipes.ROBOTS`
    seed: int  # of robot, loading sequence, size of the effect and noise


_ALIKE = (("stiffness_scale", "actuator_gain"), ("actuator_gain", "stiffness_scale"))
_SEEDS = [(robot, 100 * k) for k, robot in enumerate(("parallel", "single", *ROBOTS[2:]))]
#: Both effects with each robot.
AMBIGUITIES = tuple(Ambiguity(*x, robot, seed + n) for robot, seed in _SEEDS for n, x in enumerate(_ALIKE))


@dataclass(frozen=True)
class Outcome:
    """What became of a set."""

    set: str
    ambiguous: bool  # whether the first readings leave both effects
    expected: float | None = None  # separation that the chosen experiment was expected to bring [sigma]
    named: str = ""  # effects that are named with the experiment added
    separated: bool = False  # whether that is the truth alone, and the rival would not do as well

    @property
    def passed(self) -> bool:
        """Whether nothing is left open."""
        return self.separated or not self.ambiguous


def _explanations(result: IdentificationResult) -> set[str]:
    """The effect that is named and those that would do as well; none where several effects are needed."""
    if len(result.effects) != 1:
        return set()
    return {result.effects[0].name, *result.effects[0].indistinguishable_from}


class NextExperimentSets(Campaign):
    """See the text of this module."""

    unit = "set"
    outcome = Outcome

    def cases(self, options: argparse.Namespace) -> Mapping[str, Ambiguity]:
        """Every kind of ambiguity with every robot, by seed."""
        return {str(a.seed): a for a in AMBIGUITIES}

    def run(self, case: Ambiguity, out: Path) -> Outcome:
        """Make a set, identify it, simulate the experiment that is suggested, and identify both together."""
        name = f"{case.truth} or {case.rival}, {case.robot}"
        rng = np.random.default_rng([12, case.seed])
        robot = draw_robot(case.robot, rng)
        steps, branches = draw_loading(robot, "tension", False, rng)
        markers = draw_markers(robot, rng)
        model = Model(friction="none", elements_per_bay=2)
        declared = Experiment(robot, model, steps, Observation(markers=markers))
        share = float(rng.uniform(0.05, 0.2))
        truth = {"bending": 1.0 + share, "torsion": 1.0 + share}
        if case.truth == "actuator_gain":
            truth = {"gain": 1.0 - share}

        def carried_out(name: str, planned_one: Experiment, branches: Sequence[str]) -> MeasuredData:
            """Positions on the true robot, with noise, where nothing pushes the tip in the first experiment."""
            setup = with_effects(planned_one, {case.truth: truth})
            marks = [m for m in planned(setup, markers) if m[1].startswith("position_")]
            if name == "first":
                loaded = [any(any(load.force) for load in s.loads.values()) for s in planned_one.steps]
                marks = [m for m in marks if not loaded[m[0]]]
            exact = read(solved(setup, ReferenceSettings(markers, substeps=1)), setup, marks)
            noisy = exact + rng.normal(0.0, SIGMA, len(exact))
            return measured(name, planned_one, branches, (marks, noisy, np.full(len(exact), SIGMA)))

        first = carried_out("first", declared, branches)
        found = identify(first)
        if not {case.truth, case.rival} <= _explanations(found):
            return Outcome(name, False)
        chosen = found.next_experiment
        if chosen is None or not chosen.separation:
            return Outcome(name, True)
        added = carried_out("next", replace(declared, steps=chosen.steps), ["next"] * len(chosen.steps))
        after = identify(join_measured([first, added]))
        named = ", ".join(e.name for e in after.effects)
        separated = named == case.truth and case.rival not in _explanations(after)
        return Outcome(name, True, min(chosen.separation.values()), named, separated)

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """All sets, and how many are separated."""
        ambiguous = [o for o in outcomes if o.ambiguous]
        separated = sum(o.separated for o in ambiguous)
        text = f"{separated} of {count(len(ambiguous), 'set')} with two explanations are separated"
        return [self.table(outcomes), text]

    def passed(self, outcomes: Sequence[Outcome]) -> bool:
        """Nine tenths of the ambiguous sets, of which there are some."""
        ambiguous = [o for o in outcomes if o.ambiguous]
        return bool(ambiguous) and sum(o.separated for o in ambiguous) >= 0.9 * len(ambiguous)


CAMPAIGN = NextExperimentSets()
