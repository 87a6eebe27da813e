"""Solve a random case with the finite elements and with the reference, both with default settings, and compare."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.results import StepResult
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.random_robots.drawing import RandomCase
from tdcr_fe.validation.reference import solve_reference

Array = NDArray[np.float64]

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


def compare(case: RandomCase) -> Comparison:
    """Solve a case with both solvers.

    Parameters
    ----------
    case
        What to solve.
    """
    begun = time.process_time()
    fe = simulate(case.robot, case.model, case.steps)
    between = time.process_time()
    reference = solve_reference(case.robot, case.model, case.steps)
    done = time.process_time()
    warnings = tuple(
        f"{name}: {w}" for name, result in (("fe", fe), ("reference", reference)) for w in result.warnings
    )
    seconds = between - begun
    return Comparison(
        case.number,
        len(case.robot.tendons),
        len(case.robot.disks.positions),
        _drive(case),
        tuple(
            _compare_step(case, a, b, warnings, 1e3 * seconds / len(fe.steps))
            for a, b in zip(fe.steps, reference.steps, strict=False)
        ),
        tuple(
            f"{name}: {result.message}"
            for name, result in (("fe", fe), ("reference", reference))
            if not result.converged
        ),
        warnings,
        seconds,
        done - between,
    )


def _drive(case: RandomCase) -> str:
    if not case.by_displacement:
        return "tension"
    return "displacement" if case.robot.tendons[0].axial_stiffness is None else "elastic"


def _compare_step(
    case: RandomCase, a: StepResult, b: StepResult, warnings: tuple[str, ...], milliseconds: float
) -> StepComparison:
    """Distances of the disks, and whether a warning names this step."""
    length = case.robot.backbone.length
    at = np.array(case.robot.disks.positions)
    gap = np.linalg.norm(_disks(a, at) - _disks(b, at), axis=1).max() / length
    named = re.compile(rf"\bsteps? (?:\d+, )*{a.step}\b")
    return StepComparison(
        float(gap),
        (a.discretisation_error or 0.0) / length,
        any(named.search(w) for w in warnings),
        milliseconds,
    )


def _disks(step: StepResult, at: Array) -> Array:
    """Positions of the nodes at the disks, shape (n_disks, 3) [m]."""
    nodes = np.abs(step.s[:, None] - at).argmin(axis=0)
    if np.abs(step.s[nodes] - at).max() > 1e-9:
        raise RuntimeError("a disk is no node of the solution")
    return step.positions[nodes]
