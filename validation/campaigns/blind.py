"""Identification of hidden effects on blind sets, which the reference simulates; scored against the answers.

Without --effects the plan has every listed effect alone, pairs, clean sets, weak effects, and effects at one place.
Sets are kept in OUT/sets, answers in OUT/answers.
"""

from __future__ import annotations

import argparse
import json
import time
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import ClassVar

import numpy as np
import pandas as pd

from tdcr_fe.identify import identify
from tdcr_fe.io.files import write_json
from tdcr_fe.io.measured import read_measured
from tdcr_fe.validation.blind.maker import Answer, make_blind
from tdcr_fe.validation.blind.recipes import Recipe, plan, plan_of
from tdcr_fe.validation.blind.scoring import Score, score
from tdcr_fe.validation.runner import Campaign

#: Intervals that are counted [%], and their half-widths over the standard error; bounds of groups of probabilities [1].
INTERVALS = {50: 0.674, 80: 1.282, 95: 1.960}
PROBABILITIES = (0.0, 0.5, 0.8, 0.95, 1.01)
#: Largest ratio of the held-out misfit to that of the true robot that counts as noise level [1].
NOISE_FLOOR = 1.15


def made_set(recipe: Recipe, out: Path) -> Answer:
    """The answer of a set, which is made unless it is there."""
    file = out / "answers" / f"{recipe.seed}.json"
    if file.exists():
        return Answer.from_json(json.loads(file.read_text(encoding="utf-8")))
    answer = make_blind(out / "sets" / str(recipe.seed), recipe)
    write_json(asdict(answer), file)
    return answer


def summary(scores: Sequence[Score]) -> dict[str, str]:
    """Shares and counts over all sets."""
    kinds = {k: [s for s in scores if s.kind == k] for k in ("clean", "single", "pair", "weak", "place")}
    listed, places = [*kinds["single"], *kinds["pair"]], kinds["place"]
    right = [s for s in [*listed, *places] if s.outcome in ("right", "named together")]
    ratios = [s.after / s.noise_floor for s in right] or [np.nan]
    seconds = [s.seconds for s in scores if s.passed] or [np.nan]
    percent = round(100.0 * (NOISE_FLOOR - 1.0))
    within = sum(r <= NOISE_FLOOR for r in ratios)
    together = sum(s.outcome == "named together" for s in scores)
    return {
        "one listed effect: right name": _share(kinds["single"], "right", "named together"),
        "two listed effects: both names, no other": _share(kinds["pair"], "right", "named together"),
        "clean data: nothing missing": _share(kinds["clean"], "right"),
        "weak effects (about two sigma): right name": _share(kinds["weak"], "right", "named together"),
        "... named together with effects that look the same": f"{together}",
        f"right names: held-out error within {percent} % of the noise": f"{within} of {len(right)}",
        "held-out error over the noise, median and largest": f"{np.median(ratios):.3g}, {max(ratios):.3g}",
        "effects at a place: kind and place right": _share(places, "right"),
        "... right, or not called explained": _share(places, "right", "honest"),
        "processor time per set, median and largest": f"{np.median(seconds):.0f} s, {max(seconds):.0f} s",
        "sets that failed": str(sum(not s.passed for s in scores)),
    }


def _share(sets: Sequence[Score], *outcomes: str) -> str:
    """How many sets have one of these outcomes."""
    part = sum(s.outcome in outcomes for s in sets)
    return f"{part} of {len(sets)}" + (f" ({100.0 * part / len(sets):.0f} %)" if sets else "")


def calibration(scores: Sequence[Score]) -> pd.DataFrame:
    """How often what is claimed holds: intervals contain the truth, effects of stated probabilities are hidden ones."""
    off = np.abs([x for s in scores for x in s.deviations.values()])
    claims = [
        (f"{percent} % intervals contain the true parameter", [(0.01 * percent, x <= width) for x in off])
        for percent, width in INTERVALS.items()
    ]
    stated = [(p, name in s.hidden) for s in scores for name, p in s.probabilities.items()]
    for low, high in pairwise(PROBABILITIES):
        text = f"effects with a stated probability from {low:g} to {min(high, 1.0):g} are right"
        claims.append((text, [x for x in stated if low <= x[0] < high]))
    rows = []
    for text, own in claims:
        claimed, held = np.array(own, dtype=float).reshape(-1, 2).T
        shares = [f"{np.mean(x):.2f}" if x.size else "-" for x in (claimed, held)]
        rows.append((text, f"{int(held.sum())} of {held.size}", *shares))
    return pd.DataFrame(rows, columns=["claim", "holds in", "claimed", "seen"])


class Blind(Campaign):
    """See the text of this module."""

    unit = "set"
    count: ClassVar[int | None] = 60
    outcome = Score

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        """Which plan."""
        parser.add_argument("--plan", type=int, default=0, metavar="SEED", help="seed of the plan (0)")
        parser.add_argument("--effects", nargs="+", metavar="NAME", help="one of these in each set, in turn")

    def cases(self, options: argparse.Namespace) -> Mapping[str, Recipe]:
        """Recipes of the plan, by seed."""
        n, seed = options.first + options.n, options.plan
        recipes = plan_of(options.effects, n, seed) if options.effects else plan(n, seed)
        return {str(r.seed): r for r in recipes[options.first :]}

    def run(self, case: Recipe, out: Path) -> Score:
        """Make, identify and score one set; one that fails does not end the campaign."""
        try:
            answer = made_set(case, out)
            data = read_measured(out / "sets" / str(case.seed))
            begun = time.process_time()
            result = identify(data)
            seconds = time.process_time() - begun
        except Exception:
            return Score(case.seed, case.kind, list(case.effects), "failed", error=traceback.format_exc())
        if result.log.interrupted:  # it is not the result of this set
            raise KeyboardInterrupt
        return score(answer, result, seconds)

    def row(self, outcome: Score) -> dict[str, object]:
        """What was hidden, what was named, and the errors."""
        o, rivals = outcome, outcome.indistinguishable_from
        named = [n + (f" (or {', '.join(rivals[n])})" if rivals[n] else "") for n in o.named]
        before, after = (f"{x / o.noise_floor:.3g}" if o.passed else "" for x in (o.before, o.after))
        missed = [n for n, x in o.deviations.items() if abs(x) > INTERVALS[95]]
        return {
            "seed": o.seed,
            "robot": o.robot,
            "drive": o.drive,
            "noise [mm]": f"{1e3 * o.sigma:.3g}",
            "hidden": " + ".join(o.hidden) or "nothing",
            "declared off [sigma]": f"{o.declared_off:.3g}",
            "named": " + ".join(named) or "-",
            "verdict": o.verdict,
            "outcome": o.outcome if o.passed else f"failed: {o.error.splitlines()[-1]}",
            "held-out before / noise": before,
            "after / noise": after,
            "missed intervals": ", ".join(missed) or "-",
        }

    def report(self, outcomes: Sequence[Score]) -> list[str | pd.DataFrame]:
        """Counts, calibration, and one row for each set."""
        counts = pd.DataFrame(summary(outcomes).items(), columns=["what", "found"])
        made = [o for o in outcomes if o.passed]
        return [counts, calibration(made), self.table(outcomes)]


CAMPAIGN = Blind()
