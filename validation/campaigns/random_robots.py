"""Finite elements against the reference on random robots, both with default settings.

One to six tendons with friction, three to five load steps. A case passes where the disks of both solutions are close
together in every step, or a solver warned of the step.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from tdcr_fe.model.messages import count
from tdcr_fe.model.results import SequenceResult
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.drawing import RandomCase
from tdcr_fe.validation.random_robots import draw
from tdcr_fe.validation.reference import solve_reference
from tdcr_fe.validation.runner import Campaign

#: Largest distance of a disk between both solutions over the length that need not be announced [1].
TOLERANCE = 1e-3


@dataclass(frozen=True)
class Outcome:
    """Comparison of both solutions of a case, by load step that both solved."""

    number: int  # seed
    gaps: list[float]  # largest distance of a disk between both, over the length [1]
    estimates: list[float]  # discretisation error that the finite elements announce, over the length [1]
    announced: list[bool]  # whether a solver warned of the step
    failures: list[str]  # messages of the solvers that did not converge
    warnings: list[str]

    @property
    def unannounced(self) -> int:
        """Steps that differ without a warning."""
        rows = zip(self.gaps, self.estimates, self.announced, strict=True)
        return sum(not said and gap > max(TOLERANCE, 2.0 * estimate) for gap, estimate, said in rows)

    @property
    def passed(self) -> bool:
        """Both solved every step, and every difference is announced."""
        return not self.failures and self.unannounced == 0


def compare(case: RandomCase, solvers: Mapping[str, Callable[..., SequenceResult]]) -> Outcome:
    """Solve a case with both solvers, and compare; an error of the program is a failure like any other."""
    results, failures, warnings = {}, [], []
    for name, solver in solvers.items():
        try:
            results[name] = result = solver(case.robot, case.model, case.steps)
            warnings += [f"{name}: {w}" for w in result.warnings]
            failures += [] if result.converged else [f"{name}: {result.message}"]
        except Exception as error:
            failures.append(f"{name}: {type(error).__name__}: {error}")
    at, length = np.array(case.robot.disks.positions), case.robot.backbone.length
    # Of an error there are no steps.
    pairs = list(zip(*(r.steps for r in results.values()), strict=False)) if len(results) == 2 else []
    gaps = [np.linalg.norm(a.position_at(at) - b.position_at(at), axis=1).max() / length for a, b in pairs]
    errors = [(a.discretisation_error or 0.0) / length for a, _ in pairs]
    named = [rf"\bsteps? (?:\d+, )*{k}\b" for k in range(1, len(pairs) + 1)]
    announced = [any(re.search(step, w) for w in warnings) for step in named]
    return Outcome(case.number, [float(gap) for gap in gaps], errors, announced, failures, warnings)


class RandomRobots(Campaign):
    """See the text of this module."""

    count: ClassVar[int | None] = 500
    outcome = Outcome

    def run(self, case: int, out: Path) -> Outcome:
        """Solve a case with both and compare."""
        return compare(draw(case), {"fe": simulate, "reference": solve_reference})

    def row(self, outcome: Outcome) -> dict[str, Any]:
        """Numbers of a case, the largest of its steps."""
        row = super().row(outcome)
        largest = {f"largest_{k[:-1]}": max(vars(outcome)[k], default=np.nan) for k in ("gaps", "estimates")}
        kept = {k: v for k, v in row.items() if k not in ("gaps", "estimates", "announced")}
        return {**kept, "passed": outcome.passed, **largest}

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """Gaps and unannounced differences."""
        gaps = np.array([gap for o in outcomes for gap in o.gaps] or [np.nan])
        failed = [str(o.number) for o in outcomes if not o.passed]
        return [
            f"{count(len(outcomes), 'robot')}, {sum(len(o.gaps) for o in outcomes)} load steps",
            f"largest distance of a disk over the length: median {np.median(gaps):.1e}, 99 % below "
            f"{np.quantile(gaps, 0.99):.1e}, worst {gaps.max():.1e}",
            f"{int((gaps > TOLERANCE).sum())} steps differ by more than {100.0 * TOLERANCE:g} %, "
            f"{sum(o.unannounced for o in outcomes)} of them unannounced",
            "all passed" if not failed else f"{len(failed)} failed: {', '.join(failed)}",
        ]


CAMPAIGN = RandomRobots()
