"""Solve random robots, and check every state that is called converged."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from tdcr_fe.io.records import Record
from tdcr_fe.io.summary import versions
from tdcr_fe.model.results import SequenceResult
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.crosscheck.campaign import source_digest
from tdcr_fe.validation.fuzz.checks import CHECKS, check_step
from tdcr_fe.validation.fuzz.drawing import FuzzCase, draw
from tdcr_fe.validation.fuzz.energy import divided, is_covered, ledger
from tdcr_fe.validation.reference import ReferenceSettings, solve_reference

#: One case in so many is solved by the reference, too, and one in so many with every load step divided.
REFERENCE_EVERY, ENERGY_EVERY = 50, 20
#: Parts of a load step for the energy balance.
PARTS = 8
#: Largest distance of a node from the reference over the length, besides twice the announced error [1].
REFERENCE_TOLERANCE = 1e-3
#: Largest gap of the energy balance with `PARTS` parts, and largest gain of a hole, over the turnover [1].
ENERGY_TOLERANCE, GAIN_TOLERANCE = 0.05, 1e-4

#: Further checks of whole histories, with their tolerances.
HISTORY_CHECKS = {
    "reference": REFERENCE_TOLERANCE,
    "energy balance": ENERGY_TOLERANCE,
    "no hole gives energy": GAIN_TOLERANCE,
}
TOLERANCES = {**{c.name: c.tolerance for c in CHECKS}, **HISTORY_CHECKS}


@dataclass(frozen=True)
class Outcome:
    """What was found for one case.

    Attributes
    ----------
    number : int
        Seed.
    options : tuple of str
        What the robot has.
    steps, solved : int
        Load steps, and those that converged.
    message : str
        Why the rest did not; empty where all did.
    error : str
        Exception of the program; empty where there was none.
    worst : dict
        Largest value of each check over all steps; the checks of whole histories only where they were made.
    warnings : tuple of str
        Of the solver.
    announced : dict
        Largest residual, and estimated discretisation error over the length, that the solver announces.
    seconds : float
        Processor time of the solution [s].
    """

    number: int
    options: tuple[str, ...]
    steps: int
    solved: int
    message: str
    error: str
    worst: dict[str, float]
    warnings: tuple[str, ...]
    announced: dict[str, float]
    seconds: float
    broken: tuple[str, ...] = field(default=())

    @property
    def converged(self) -> bool:
        """Whether all load steps were solved."""
        return not self.error and self.solved == self.steps

    @property
    def passed(self) -> bool:
        """Solved, and everything that was checked holds."""
        return self.converged and not self.broken


def solve_case(number: int) -> Record:
    """Draw, solve and check one case; returns the fields of an `Outcome`."""
    case = draw(number)
    begun = time.process_time()
    try:
        result = simulate(case.robot, case.model, case.steps)
    except Exception as error:
        text = f"{type(error).__name__}: {error}"
        return _record(case, None, {}, text, time.process_time() - begun)
    seconds = time.process_time() - begun
    worst: dict[str, float] = {}
    error_text = ""
    try:
        for step in result.steps:
            for name, value in check_step(result.robot, result.model, step).items():
                worst[name] = max(worst.get(name, 0.0), value if np.isfinite(value) else np.inf)
        if result.converged:
            worst |= _history(case, result)
    except Exception as error:
        error_text = f"in a check: {type(error).__name__}: {error}"
    return _record(case, result, worst, error_text, seconds)


def _record(
    case: FuzzCase, result: SequenceResult | None, worst: dict[str, float], error: str, seconds: float
) -> Record:
    steps = () if result is None else result.steps
    length = case.robot.backbone.length
    announced = {
        "residual": max((s.residual for s in steps), default=0.0),
        "discretisation_error": max((s.discretisation_error or 0.0 for s in steps), default=0.0) / length,
    }
    outcome = Outcome(
        case.number,
        case.options,
        len(case.steps),
        sum(s.converged for s in steps),
        "" if result is None or result.converged else result.message,
        error,
        {name: float(f"{value:.3g}") for name, value in worst.items()},
        () if result is None else result.warnings,
        announced,
        round(seconds, 4),
        tuple(name for name, value in worst.items() if not value <= TOLERANCES[name]),
    )
    return asdict(outcome)


def outcome_of(record: Record) -> Outcome:
    """The outcome that a record holds; what is broken follows from the present tolerances."""
    values: dict[str, Any] = {k: (tuple(v) if isinstance(v, list) else v) for k, v in record.items()}
    found = Outcome(**values)
    # JSON has no infinity: a value that is not finite was kept as null.
    worst = {name: np.inf if x is None else x for name, x in found.worst.items()}
    return replace(found, worst=worst, broken=tuple(n for n, x in worst.items() if not x <= TOLERANCES[n]))


def _history(case: FuzzCase, result: SequenceResult) -> dict[str, float]:
    """Checks of the whole history, on a sample of the cases."""
    found: dict[str, float] = {}
    if case.number % REFERENCE_EVERY == 0:
        found |= _reference(case, result)
    if case.number % ENERGY_EVERY == 1 and is_covered(case.robot, case.model, case.steps):
        mesh = 2 if case.default_mesh else case.model.elements_per_bay
        model = replace(case.model, elements_per_bay=mesh)
        fine = simulate(case.robot, model, divided(case.robot, case.steps, PARTS))
        if fine.converged and not fine.warnings:
            balance = ledger(fine)
            found["energy balance"] = balance.gap
            # With one mobilisation per tendon, a hole may have friction along its own slip.
            if model.friction != "per-tendon":
                found["no hole gives energy"] = balance.gain
    return found


def _reference(case: FuzzCase, result: SequenceResult) -> dict[str, float]:
    """Distance of the nodes at the disks from the reference, less twice the announced error of the mesh."""
    if case.robot.without_disks or result.warnings:
        return {}
    try:
        expected = solve_reference(
            case.robot, case.model, case.steps, settings=ReferenceSettings(substeps=16)
        )
    except ValueError:  # something that the reference does not have
        return {}
    if not expected.converged:
        return {}
    length, worst = case.robot.backbone.length, 0.0
    for step, other in zip(result.steps, expected.steps, strict=True):
        for s in case.robot.disks.positions:
            away = float(np.linalg.norm(step.position_at(s) - other.position_at(s)))
            worst = max(worst, (away - 2.0 * (step.discretisation_error or 0.0)) / length)
    return {"reference": worst}


def head() -> dict[str, Any]:
    """What the records depend on: the source of the cases and checks, and the versions of all packages.

    The solver's own source is among them: a record of other code is not taken for one of this.
    """
    packages = ("elements", "model", "scene", "solve", "effects", "validation.fuzz", "validation.reference")
    return {"source": source_digest(packages), "versions": versions()}
