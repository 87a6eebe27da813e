"""Reproduction of the paper: its figures, tables and algorithms, and a verdict on each of its claims.

Wang, Du, Mao: Cosserat Rod-Based Tendon Friction Modeling, Simulation, and Experiments for Tendon-Driven Continuum
Robots, Micromachines 2025, 16(3), 346, https://doi.org/10.3390/mi16030346. The pictures, and the cases as input for
``tdcr-fe run``, are written beside the tables. It passes where every claim has the verdict that it had before.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from tdcr_fe.validation.paper.cases import CASE_IDS, write_cases
from tdcr_fe.validation.paper.claims import claims
from tdcr_fe.validation.paper.critical import study_critical
from tdcr_fe.validation.paper.figures import study_figure
from tdcr_fe.validation.paper.limitations import study_dynamics, study_limitations
from tdcr_fe.validation.paper.signs import study_signs
from tdcr_fe.validation.paper.stiffness import study_stiffness
from tdcr_fe.validation.paper.tables import TABLES, study_table
from tdcr_fe.validation.runner import Campaign

#: What is computed, by name, from the folder of the results.
PARTS: dict[str, Callable[[Path], dict[str, Any]]] = {
    **{name: partial(study_figure, name) for name in CASE_IDS},
    **{f"table{number}": partial(study_table, number) for number in TABLES},
    "critical": study_critical,
    "signs": lambda out: study_signs(),
    "stiffness": lambda out: study_stiffness(),
    "limitations": lambda out: study_limitations(),
    "dynamics": lambda out: study_dynamics(),
}


@dataclass(frozen=True)
class Outcome:
    """Numbers of one part of the paper."""

    part: str
    numbers: dict[str, Any]
    passed: bool = True


class Paper(Campaign):
    """See the text of this module."""

    unit = "part"
    outcome = Outcome

    def cases(self, options: argparse.Namespace) -> Mapping[str, str]:
        """Figures, tables, and what else is claimed."""
        return {name: name for name in PARTS}

    def run(self, case: str, out: Path) -> Outcome:
        """Compute a part."""
        return Outcome(case, PARTS[case](out / "pictures"))

    def table(self, outcomes: Sequence[Outcome]) -> pd.DataFrame:
        """Verdict, evidence and reason of every claim."""
        return pd.DataFrame([vars(c) for c in claims({o.part: o.numbers for o in outcomes})])

    def passed(self, outcomes: Sequence[Outcome]) -> bool:
        """Whether every verdict is the expected one."""
        table = self.table(outcomes)
        return bool((table["verdict"] == table["expected"]).all())

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """The claims, then the numbers of every part."""
        blocks: list[str | pd.DataFrame] = [self.table(outcomes).drop(columns="expected")]
        for o in outcomes:
            blocks.append(f"## {o.part}")
            for name, value in o.numbers.items():
                if isinstance(value, list) and value and isinstance(value[0], dict):
                    rows = pd.DataFrame(value).drop(columns=["loads", "eigenvalues"], errors="ignore")
                    blocks.append(rows.map(_short))
                else:
                    blocks.append(f"{name}: {_short(value)}")
        return blocks

    def write(self, outcomes: Sequence[Outcome], out: Path) -> None:
        """Write the figures as input for ``tdcr-fe run``."""
        write_cases(out / "cases")


def _short(value: Any) -> Any:
    return f"{value:.5g}" if isinstance(value, float) else value


CAMPAIGN = Paper()
