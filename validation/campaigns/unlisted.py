"""Causes beyond the list of effects: sixty blind sets, and whether `identify` tells their kind and dependence.

It passes where kind and dependence are right in five sixths of the sets and no wrong effect is found.
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
from tdcr_fe.validation.blind.unlisted import RECIPES, Recipe, make_unlisted
from tdcr_fe.validation.measured_folder import write_measured
from tdcr_fe.validation.runner import Campaign

#: Kind and dependence are right in so large a share of the sets.
RIGHT = 5.0 / 6.0
#: Sets of each recipe, with seeds from here on that no other campaign has.
SETS, FIRST_SEED = 3, 9000


@dataclass(frozen=True)
class Outcome:
    """What the identification says of one set."""

    cause: str  # name of the recipe
    truth: str  # what is perturbed, and what that depends on
    verdict: str
    effects: list[str]  # listed effects that are wrongly reported as found
    causes: list[str]  # kinds that are reported, with their probabilities
    right: bool  # whether these are of the kind and dependence of the recipe alone
    before: float | None  # distance between predicted and measured markers on the held-out steps, rms [m]
    after: float | None
    noise: float | None  # the distance that the noise makes, by its sigma [m]
    seconds: float  # processor time of the identification [s]

    @property
    def passed(self) -> bool:
        """Whether the kind is right and no wrong effect is named."""
        return self.right and not self.effects


def judge(recipe: Recipe, result: IdentificationResult, seconds: float) -> Outcome:
    """What was found, beside what the recipe hides."""
    kinds = [(e.kind, e.kind_probability) for e in result.effects]
    return Outcome(
        cause=recipe.name,
        truth=f"{recipe.perturbs}: {recipe.depends_on}",
        verdict=result.verdict,
        effects=[e.name for e in result.effects if e.found and e.name != recipe.listed],
        causes=[f"{k.perturbs}: {', '.join(k.depends_on)}; {k.where} ({p:.2f})" for k, p in kinds],
        right={k[:2] for k, _ in kinds} == {(recipe.perturbs, (recipe.depends_on,))},
        before=result.before.held_out.rms_position,
        after=result.after.held_out.rms_position,
        noise=result.noise.rms_position,
        seconds=seconds,
    )


class Unlisted(Campaign):
    """See the text of this module."""

    unit = "set"
    outcome = Outcome

    def cases(self, options: argparse.Namespace) -> Mapping[str, int]:
        """Seeds: of every recipe the first set, then of every recipe the second."""
        seeds = range(FIRST_SEED, FIRST_SEED + SETS * len(RECIPES))
        return {str(seed): seed for seed in seeds}

    def run(self, case: int, out: Path) -> Outcome:
        """Make the set, identify it, and compare."""
        recipe = RECIPES[(case - FIRST_SEED) % len(RECIPES)]
        made = make_unlisted(recipe, case)
        write_measured(made.data, out / "sets" / str(case))
        begun = time.process_time()
        result = identify(made.data)
        if result.log.interrupted:  # it is not the result of this set
            raise KeyboardInterrupt
        return judge(recipe, result, time.process_time() - begun)

    def row(self, outcome: Outcome) -> dict[str, Any]:
        """Errors in millimetres."""
        row = {**super().row(outcome), "passed": outcome.passed, "seconds": round(outcome.seconds, 1)}
        known = (k for k in ("before", "after", "noise") if row[k] is not None)
        return row | {k: round(1e3 * row[k], 3) for k in known}

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """All sets, errors in millimetres, and counts."""
        right, named = sum(o.right for o in outcomes), sum(bool(o.effects) for o in outcomes)
        text = f"kind and dependence right in {right}, wrong effects named in {named}"
        return [self.table(outcomes), f"of {count(len(outcomes), 'set')}: {text}"]

    def passed(self, outcomes: Sequence[Outcome]) -> bool:
        """Whether enough sets are right, and none has a wrong name."""
        return sum(o.passed for o in outcomes) == sum(o.right for o in outcomes) >= RIGHT * len(outcomes)


CAMPAIGN = Unlisted()
