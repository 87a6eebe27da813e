"""Reproduction of the paper: its figures and tables, and a verdict on each of its claims.

Wang, Du, Mao: Cosserat Rod-Based Tendon Friction Modeling, Simulation, and Experiments for Tendon-Driven Continuum
Robots, Micromachines 2025, 16(3), 346, https://doi.org/10.3390/mi16030346. The figures are written as input for
``tdcr-fe run``, which draws them. It passes where every claim has the verdict that it had before.
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from tdcr_fe.validation.paper.cases import write_cases
from tdcr_fe.validation.paper.claims import CLAIMS
from tdcr_fe.validation.runner import Campaign


@dataclass(frozen=True)
class Outcome:
    """Verdict on one claim."""

    claim: str  # as the paper has it
    verdict: str
    evidence: str  # the numbers
    reason: str
    expected: str  # the verdict that was found before

    @property
    def passed(self) -> bool:
        """Whether the verdict is the expected one."""
        return self.verdict == self.expected


class Paper(Campaign):
    """See the text of this module."""

    unit = "claim"
    outcome = Outcome

    def cases(self, options: argparse.Namespace) -> Mapping[str, str]:
        """The claims by their names."""
        return {name: name for name in CLAIMS}

    def run(self, case: str, out: Path) -> Outcome:
        """Judge a claim."""
        texts = tomllib.loads((files("tdcr_fe.validation.paper") / "claims.toml").read_text(encoding="utf-8"))
        verdict, evidence = CLAIMS[case]()
        return Outcome(verdict=verdict, evidence=evidence, **texts[case])

    def write(self, outcomes: Sequence[Outcome], out: Path) -> None:
        """Write the figures as input for ``tdcr-fe run``."""
        write_cases(out / "cases")


CAMPAIGN = Paper()
