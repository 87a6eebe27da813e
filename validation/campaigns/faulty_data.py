"""Measured data with one of forty faults each: identify must name the fault or say that it cannot tell.

Clean sets are in OUT/base, faulty ones in OUT/sets, what identify writes in OUT/reports.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tdcr_fe.validation.blind.maker import make_blind
from tdcr_fe.validation.blind.recipes import Recipe
from tdcr_fe.validation.faulty_data import FAULTS, Fault, Tables
from tdcr_fe.validation.runner import Campaign

#: Clean sets, by drive: three parallel tendons, noise of 0.2 mm.
BASES = {
    "tension": Recipe(9100, robot="parallel", drive="tension", sigma=2e-4),
    "displacement": Recipe(9103, robot="parallel", drive="displacement", sigma=2e-4),
}
#: Of a clean set so many steps and markers are used.
STEPS, MARKERS = 24, 3
#: Exit statuses of the command that computes nothing: the declared model does not converge, the input is wrong.
REFUSED = (1, 2)
#: Words of faults that are names of effects, and count only as such.
_EFFECT_LIKE = ("marker_offset", "frame_misalignment", "stiffness_scale", "actuator_gain")


@dataclass(frozen=True)
class Outcome:
    """What the command says of one faulty set.

    Right outcomes are "refused" (input error that names it), "named" (in the report) and "cannot tell". Wrong are
    "refused without naming it", "not explained" (no cause is given, but the report says that one is missing),
    "explained otherwise" (another cause is given) and "nothing missing" (whatever else the report says).
    """

    fault: str
    outcome: str
    verdict: str  # of the report; empty where the input was refused
    effects: list[str]  # that were added
    text: str  # first words of the error or of the report

    @property
    def passed(self) -> bool:
        """Named, refused, or left open; never "nothing missing" or another cause."""
        return self.outcome in ("refused", "named", "cannot tell")


def judge(fault: Fault, status: int, errors: str, output: str, report: Path) -> Outcome:
    """What the exit status, the messages and the report of the command amount to."""
    if status in REFUSED:
        named = any(word in errors.lower() for word in fault.words)
        return Outcome(fault.name, "refused" if named else "refused without naming it", "", [], errors[:400])
    result = json.loads((report / "result.json").read_text(encoding="utf-8"))
    verdict, effects = result["verdict"], [e["effect"] for e in result["effects"]]
    said = re.sub(r"\s+", " ", f"{output} {errors}")
    # The report's own advice repeats what the errors on the first screen say; candidates are not what is concluded.
    named = any(w in effects or (w not in _EFFECT_LIKE and w in said.lower()) for w in fault.words)
    if verdict == "nothing missing" or (verdict == "cannot tell" and not named):
        outcome = verdict
    elif named:
        outcome = "named"
    else:
        outcome = "explained otherwise" if verdict.startswith("explained") else "not explained"
    return Outcome(fault.name, outcome, verdict, effects, said[:400])


class FaultyData(Campaign):
    """See the text of this module."""

    unit = "set"
    outcome = Outcome

    def cases(self, options: argparse.Namespace) -> Mapping[str, int]:
        """Numbers of the faults, from 1."""
        return {str(k): k for k in range(1, len(FAULTS) + 1)}

    def prepare(self, out: Path) -> None:
        """Make the clean sets."""
        for drive, recipe in BASES.items():
            if not (out / "base" / drive).exists():
                make_blind(out / "base" / drive, recipe)

    def run(self, case: int, out: Path) -> Outcome:
        """Make the set with this fault, run the command, and judge what it says."""
        fault = FAULTS[case - 1]
        tables = Tables.read(out / "base" / fault.base, STEPS, MARKERS)
        fault.change(tables, np.random.default_rng([3, case]))
        made, report = out / "sets" / str(case), out / "reports" / str(case)
        tables.write(made)
        shutil.rmtree(report, ignore_errors=True)
        program = [sys.executable, "-m", "tdcr_fe", "identify"]
        command = [*program, str(made), "-o", str(report), "--processes", "1"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        return judge(fault, done.returncode, done.stderr, done.stdout, report)

    def row(self, outcome: Outcome) -> dict[str, Any]:
        """What is said of the fault."""
        return {k: v for k, v in super().row(outcome).items() if k != "text"}

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """All faults, and counts."""
        table = self.table(outcomes)
        counts = table["outcome"].value_counts().items()
        return [table, ", ".join(f"{name}: {number}" for name, number in counts)]


CAMPAIGN = FaultyData()
