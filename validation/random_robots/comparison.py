"""Compare the answers of the finite elements and of the reference to a random case."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from tdcr_fe.validation.random_robots.answers import Answer
from tdcr_fe.validation.random_robots.drawing import RandomCase, draw

#: Largest distance of a disk between both solutions over the length that need not be announced [1].
TOLERANCE = 1e-3


@dataclass(frozen=True)
class StepComparison:
    """One load step.

    Attributes
    ----------
    gap : float
        Largest distance of a disk between both solutions over the length [1].
    estimate : float
        Discretisation error that the finite elements announce, over the length [1].
    announced : bool
        Whether a solver warned of this step.
    milliseconds : float
        Processor time of the finite elements, the sequence's divided by its steps [ms].
    """

    gap: float
    estimate: float
    announced: bool
    milliseconds: float

    @property
    def passed(self) -> bool:
        """Close together, or the difference is announced."""
        return self.announced or self.gap <= max(TOLERANCE, 2.0 * self.estimate)


@dataclass(frozen=True)
class Comparison:
    """One random case.

    Attributes
    ----------
    number : int
        Seed.
    tendons, disks : int
    drive : str
        "tension", "displacement" or "elastic".
    steps : tuple of StepComparison
        Those that both solved.
    failures : tuple of str
        Messages of the solvers that did not converge; empty where both did.
    warnings : tuple of str
        Of both solvers.
    seconds, seconds_reference : float
        Processor time [s].
    """

    number: int
    tendons: int
    disks: int
    drive: str
    steps: tuple[StepComparison, ...]
    failures: tuple[str, ...]
    warnings: tuple[str, ...]
    seconds: float
    seconds_reference: float

    @property
    def gap(self) -> float:
        """Largest of all steps [1]."""
        return max((step.gap for step in self.steps), default=0.0)

    @property
    def passed(self) -> bool:
        """Both solved every step, and no difference is unannounced."""
        return not self.failures and all(step.passed for step in self.steps)


def compare(fe: Answer, reference: Answer) -> Comparison:
    """Compare the answers of both solvers to the same case.

    Parameters
    ----------
    fe, reference
        Of the finite elements and of the reference.
    """
    case = draw(fe.number)
    both = {"fe": fe, "reference": reference}
    warnings = tuple(f"{name}: {w}" for name, answer in both.items() for w in answer.warnings)
    count = min(len(fe.positions), len(reference.positions))
    return Comparison(
        case.number,
        len(case.robot.tendons),
        len(case.robot.disks.positions),
        _drive(case),
        tuple(_compare_step(case, k, fe, reference, warnings) for k in range(count)),
        tuple(f"{name}: {answer.failure}" for name, answer in both.items() if answer.failure),
        warnings,
        fe.seconds,
        reference.seconds,
    )


def _drive(case: RandomCase) -> str:
    if not case.by_displacement:
        return "tension"
    return "displacement" if case.robot.tendons[0].axial_stiffness is None else "elastic"


def _compare_step(
    case: RandomCase, k: int, fe: Answer, reference: Answer, warnings: tuple[str, ...]
) -> StepComparison:
    """Distances of the disks in one step, and whether a warning names it."""
    length = case.robot.backbone.length
    gap = np.linalg.norm(np.subtract(fe.positions[k], reference.positions[k]), axis=1).max() / length
    named = re.compile(rf"\bsteps? (?:\d+, )*{k + 1}\b")
    return StepComparison(
        float(gap),
        fe.estimates[k] / length,
        any(named.search(w) for w in warnings),
        1e3 * fe.seconds / len(fe.positions),
    )
