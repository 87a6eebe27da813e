"""Whole load steps of random robots against the same steps cut in parts.

With friction the result depends on the path, which `tdcr_fe.simulate` resolves within a load step. Cut in many parts,
each with a tight tolerance, the same history leaves little to resolve. Both use one element per bay, so the mesh is the
same.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count as numbers
from itertools import islice
from pathlib import Path
from typing import ClassVar

import numpy as np
import pandas as pd

from tdcr_fe.model.loading import SolverSettings
from tdcr_fe.model.messages import count
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.drawing import RandomCase
from tdcr_fe.validation.fuzz.energy import divided
from tdcr_fe.validation.random_robots import MOST_TENDONS, draw
from tdcr_fe.validation.runner import Campaign

#: Largest unreported difference of a node's position, over the length [1].
ALLOWED = 1e-5
#: Path tolerance of the parts [1].
TIGHT = 1e-7
#: Parts of each load step.
PARTS = 64


@dataclass(frozen=True)
class Outcome:
    """Differences of one robot."""

    number: int  # seed
    moved: list[float]  # by load step, largest difference of a node's coordinate over the length [1]
    reported: bool  # whether a warning of either run names the friction path or a snap-through

    @property
    def passed(self) -> bool:
        """No unreported difference is larger than allowed."""
        return self.reported or max(self.moved) <= ALLOWED


def compare(case: RandomCase, parts: int) -> Outcome:
    """Solve a history whole and in parts.

    Raises
    ------
    RuntimeError
        A run did not converge.
    """
    model = replace(case.model, elements_per_bay=1)
    settings = SolverSettings(path_tolerance=TIGHT, mesh_tolerance=np.inf)
    whole = simulate(case.robot, model, case.steps)
    fine = simulate(case.robot, model, divided(case.robot, case.steps, parts), settings)
    for run in (whole, fine):
        if not run.converged:
            raise RuntimeError(f"robot {case.number}: {run.message}")
    ends = fine.steps[parts - 1 :: parts]
    gaps = [float(np.abs(a.positions - b.positions).max()) for a, b in zip(whole.steps, ends, strict=True)]
    reported = any("Friction path" in w or "snapped" in w for w in (*whole.warnings, *fine.warnings))
    return Outcome(case.number, [gap / case.robot.backbone.length for gap in gaps], reported)


class CutSteps(Campaign):
    """See the text of this module."""

    count: ClassVar[int | None] = 200
    outcome = Outcome

    def cases(self, options: argparse.Namespace) -> Mapping[str, int]:
        """Seeds of robots with three and six tendons."""
        seeds = (k for k in numbers(options.first) if 1 + k % MOST_TENDONS in (3, 6))
        return {str(seed): seed for seed in islice(seeds, options.n)}

    def run(self, case: int, out: Path) -> Outcome:
        """Draw a robot and compare."""
        return compare(draw(case), PARTS)

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """Median and largest difference, and those that are not reported."""
        moved = np.array([x for o in outcomes for x in o.moved])
        unreported = [o for o in outcomes if not o.passed]
        return [
            f"{count(len(outcomes), 'robot')}, {count(len(moved), 'load step')} cut: median {np.median(moved):.1e}, "
            f"largest {moved.max():.1e} of the length; beyond {ALLOWED:g} and unreported: {len(unreported)}",
            *(f"robot {o.number}, step {np.argmax(o.moved) + 1}: {max(o.moved):.1e}" for o in unreported),
        ]


CAMPAIGN = CutSteps()
