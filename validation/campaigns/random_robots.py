"""Finite elements against the reference on random robots, both with default settings.

One to six tendons with friction, three to five load steps. A case passes where the disks of both solutions are close
together in every step, or a solver warned of the step.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pandas as pd

from tdcr_fe.model.messages import count
from tdcr_fe.model.results import SequenceResult
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.random_robots import RandomCase, draw
from tdcr_fe.validation.reference import solve_reference
from tdcr_fe.validation.runner import Campaign

#: Largest distance of a disk between both solutions over the length that need not be announced [1].
TOLERANCE = 1e-3


@dataclass(frozen=True)
class Outcome:
    """Comparison of both solutions of a case, by load step that both solved."""

    number: int  # seed
    tendons: int
    disks: int
    drive: str  # "tension", "displacement" or "elastic"
    gaps: list[float]  # largest distance of a disk between both, over the length [1]
    estimates: list[float]  # discretisation error that the finite elements announce, over the length [1]
    announced: list[bool]  # whether a solver warned of the step
    failures: list[str]  # messages of the solvers that did not converge
    warnings: list[str]
    seconds: float  # processor time of the finite elements [s]
    seconds_reference: float

    @property
    def unannounced(self) -> int:
        """Steps that differ without a warning."""
        rows = zip(self.gaps, self.estimates, self.announced, strict=True)
        return sum(not said and gap > max(TOLERANCE, 2.0 * estimate) for gap, estimate, said in rows)

    @property
    def passed(self) -> bool:
        """Both solved every step, and every difference is announced."""
        return not self.failures and self.unannounced == 0


class Answer(NamedTuple):
    """What one solver finds."""

    positions: list[list[list[float]]]  # of the disks, by solved step [m]
    estimates: list[float]  # announced discretisation error, by solved step [m]
    warnings: list[str]
    failure: str  # why not all steps were solved; empty where they were
    seconds: float  # processor time [s]


def solve(case: RandomCase, solver: Callable[..., SequenceResult]) -> Answer:
    """Solve a case; an error of the program is a failure like any other."""
    begun = time.process_time()
    try:
        result = solver(case.robot, case.model, case.steps)
    except Exception as error:
        return Answer([], [], [], f"{type(error).__name__}: {error}", time.process_time() - begun)
    seconds = time.process_time() - begun
    at = np.array(case.robot.disks.positions)
    positions = [step.position_at(at).tolist() for step in result.steps]
    estimates = [step.discretisation_error or 0.0 for step in result.steps]
    failure = "" if result.converged else result.message
    return Answer(positions, estimates, list(result.warnings), failure, seconds)


def compare(case: RandomCase, fe: Answer, reference: Answer) -> Outcome:
    """Compare the answers of both solvers to the same case."""
    both = {"fe": fe, "reference": reference}
    warnings = [f"{name}: {w}" for name, answer in both.items() for w in answer.warnings]
    length = case.robot.backbone.length
    pairs = list(zip(fe.positions, reference.positions, strict=False))
    drive = "tension"
    if case.by_displacement:
        drive = "displacement" if case.robot.tendons[0].axial_stiffness is None else "elastic"
    return Outcome(
        case.number,
        len(case.robot.tendons),
        len(case.robot.disks.positions),
        drive,
        [float(np.linalg.norm(np.subtract(a, b), axis=1).max()) / length for a, b in pairs],
        [e / length for e in fe.estimates[: len(pairs)]],
        [any(re.search(rf"\bsteps? (?:\d+, )*{k + 1}\b", w) for w in warnings) for k in range(len(pairs))],
        [f"{name}: {answer.failure}" for name, answer in both.items() if answer.failure],
        warnings,
        fe.seconds,
        reference.seconds,
    )


class RandomRobots(Campaign):
    """See the text of this module."""

    count: ClassVar[int | None] = 500
    outcome = Outcome

    def run(self, case: int, out: Path) -> Outcome:
        """Solve a case with both and compare."""
        drawn = draw(case)
        return compare(drawn, solve(drawn, simulate), solve(drawn, solve_reference))

    def row(self, outcome: Outcome) -> dict[str, Any]:
        """Numbers of a case, the largest of its steps."""
        return {
            "number": outcome.number,
            "tendons": outcome.tendons,
            "disks": outcome.disks,
            "drive": outcome.drive,
            "passed": outcome.passed,
            "largest_gap": max(outcome.gaps, default=0.0),
            "largest_estimate": max(outcome.estimates, default=np.nan),
            "milliseconds_per_step": 1e3 * outcome.seconds / max(1, len(outcome.gaps)),
            "seconds": outcome.seconds,
            "seconds_reference": outcome.seconds_reference,
            "failures": " | ".join(outcome.failures),
            "warnings": " | ".join(outcome.warnings),
        }

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """Gaps, unannounced differences and times."""
        gaps = np.array([gap for o in outcomes for gap in o.gaps] or [np.nan])
        times = np.array(
            [1e3 * o.seconds / max(1, len(o.gaps)) for o in outcomes for _ in o.gaps] or [np.nan]
        )
        failed = [str(o.number) for o in outcomes if not o.passed]
        return [
            f"{count(len(outcomes), 'robot')}, {sum(len(o.gaps) for o in outcomes)} load steps",
            f"largest distance of a disk over the length: median {np.median(gaps):.1e}, 99 % below "
            f"{np.quantile(gaps, 0.99):.1e}, worst {gaps.max():.1e}",
            f"{int((gaps > TOLERANCE).sum())} steps differ by more than {100.0 * TOLERANCE:g} %, "
            f"{sum(o.unannounced for o in outcomes)} of them unannounced",
            f"finite elements, processor time per step: median {np.median(times):.3g} ms, 90 % below "
            f"{np.quantile(times, 0.9):.3g} ms, worst {times.max():.3g} ms",
            "all passed" if not failed else f"{len(failed)} failed: {', '.join(failed)}",
        ]


CAMPAIGN = RandomRobots()
