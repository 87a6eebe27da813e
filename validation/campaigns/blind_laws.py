"""Identification of laws that are on no list: twelve blind sets, and whether the formula is found.

It passes where the held-out error is halved in three quarters of the sets and the formula is right in half of them.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from tdcr_fe.identify import IdentificationResult, identify
from tdcr_fe.model.messages import count
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.blind.laws import LAWS, LawRecipe, make_law_set
from tdcr_fe.validation.runner import Campaign

#: In so large a share of the sets the held-out error is halved, and in so large a one the formula is right.
HALVED, RIGHT = 0.75, 0.5


@dataclass(frozen=True)
class Outcome:
    """What the identification says of one set."""

    law: str  # name of the recipe
    verdict: str
    effects: list[str]  # listed effects that were named
    formula: str  # that was found, with its numbers; empty where none was
    right: bool  # whether it is that of the recipe, at its place, and nothing besides
    among_others: bool  # whether the recipe's formula is at least named as one that explains the data as well
    before: float | None  # distance between predicted and measured markers on the held-out steps, rms [m]
    after: float | None
    noise: float | None  # the distance that the noise makes, by its sigma [m]
    seconds: float  # processor time of the identification [s]

    @property
    def halved(self) -> bool:
        """Whether the held-out error fell to half or less."""
        return self.before is not None and self.after is not None and self.after <= 0.5 * self.before

    @property
    def passed(self) -> bool:
        """Whether the error is halved and the formula right."""
        return self.halved and self.right


def judge(recipe: LawRecipe, result: IdentificationResult, seconds: float) -> Outcome:
    """What was found, beside what the recipe hides."""
    law = result.law
    found = [(c.name.split(" in bay ")[0], c.where) for c in result.causes]
    where = where_it_acts(recipe, result.data.robot)
    return Outcome(
        law=recipe.name,
        verdict=result.verdict,
        effects=[e.name for e in result.effects if e.found],
        formula="" if law is None else law.formula,
        right=found == [(recipe.product, where)],
        among_others=law is not None
        and any(other.split(" in bay ")[0] == recipe.product for other in law.alternatives),
        before=result.before_held_out.rms_position,
        after=result.after_held_out.rms_position,
        noise=result.noise.rms_position,
        seconds=seconds,
    )


def where_it_acts(recipe: LawRecipe, robot: Robot) -> str:
    """Where the law of a recipe acts, in the words of `identify`."""
    edges, disks = robot.bay_edges, robot.disks.positions
    if recipe.name == "cubic spring":
        return f"disk at s = {disks[len(disks) // 2]:.4g} m"
    if recipe.name == "hardening in one bay":
        bay = round(0.4 * len(disks))
        return f"bay {bay + 1} (s = {edges[bay]:.4g} to {edges[bay + 1]:.4g} m)"
    return "everywhere"


class BlindLaws(Campaign):
    """See the text of this module."""

    unit = "set"
    outcome = Outcome

    def cases(self, options: argparse.Namespace) -> Mapping[str, int]:
        """Seeds of all recipes."""
        return {str(recipe.seed): recipe.seed for recipe in LAWS}

    def run(self, case: int, out: Path) -> Outcome:
        """Make the set, identify it, and compare."""
        recipe = next(r for r in LAWS if r.seed == case)
        made = make_law_set(recipe, out / "sets" / str(case))
        begun = time.process_time()
        result = identify(made.data)
        if result.interrupted:  # it is not the result of this set
            raise KeyboardInterrupt
        return judge(recipe, result, time.process_time() - begun)

    def row(self, outcome: Outcome) -> dict[str, Any]:
        """Errors in millimetres."""
        errors = {"before": outcome.before, "after": outcome.after, "noise": outcome.noise}
        return {
            "law": outcome.law,
            "verdict": outcome.verdict,
            "effects": ", ".join(outcome.effects),
            "formula": outcome.formula,
            "right": outcome.right,
            "among others": outcome.among_others,
            **{f"{k} [mm]": None if x is None else round(1e3 * x, 3) for k, x in errors.items()},
            "seconds": round(outcome.seconds, 3),
        }

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """All sets, and counts."""
        halved, right = sum(o.halved for o in outcomes), sum(o.right for o in outcomes)
        listed = sum(bool(o.effects) for o in outcomes)
        return [
            self.table(outcomes),
            f"of {count(len(outcomes), 'set')}: held-out error halved in {halved}, formula right in {right}, listed "
            f"effects named in {listed}",
        ]

    def passed(self, outcomes: Sequence[Outcome]) -> bool:
        """Whether enough sets are right."""
        halved, right = sum(o.halved for o in outcomes), sum(o.right for o in outcomes)
        return halved >= HALVED * len(outcomes) and right >= RIGHT * len(outcomes)


CAMPAIGN = BlindLaws()
