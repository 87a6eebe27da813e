"""Random robots with any option of robot.toml; every state called converged is checked from outside the solver.

Positions, rotations and tensions alone must be in equilibrium for every free body, lie within the Capstan bounds, and
have the prescribed inputs; on a sample the energy balance and the reference are compared, too.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from tdcr_fe.model.messages import count
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.campaigns.random_robots import compare
from tdcr_fe.validation.drawing import RandomCase
from tdcr_fe.validation.fuzz.checks import CHECKS, check_step
from tdcr_fe.validation.fuzz.drawing import draw
from tdcr_fe.validation.fuzz.energy import divided, is_covered, ledger
from tdcr_fe.validation.reference import ReferenceSettings, solve_reference
from tdcr_fe.validation.runner import Campaign

#: One case in so many is solved by the reference, too, and one in so many with every load step divided.
REFERENCE_EVERY, ENERGY_EVERY = 50, 20
#: Parts of a load step for the energy balance.
PARTS = 8

#: Largest value that is right, by check: those of a state, and three of a whole history (distance of a node from the
#: reference over the length, besides twice the announced error; energy over the turnover).
TOLERANCES = {
    **{c.name: c.tolerance for c in CHECKS},
    "reference": 1e-3,
    "energy balance": 0.05,
    "no hole gives energy": 1e-4,
}


@dataclass(frozen=True)
class Outcome:
    """What was found for one case."""

    number: int  # seed
    steps: int  # load steps
    solved: int  # those that converged
    message: str  # why the rest did not; empty where all did
    error: str  # exception of the program; empty where there was none
    worst: dict[str, float | None]  # largest value of each check that was made; None where it is not finite
    warnings: list[str]

    @property
    def broken(self) -> list[str]:
        """Checks that do not hold."""
        return [name for name in self.worst if not self.value(name) <= TOLERANCES[name]]

    @property
    def passed(self) -> bool:
        """All load steps are solved, and everything that was checked holds."""
        return not self.error and self.solved == self.steps and not self.broken

    def value(self, check: str) -> float:
        """Largest value of a check."""
        found = self.worst[check]
        return np.inf if found is None else found


def check_case(case: RandomCase) -> Outcome:
    """Solve and check one case."""
    result, error = None, ""
    try:
        result = simulate(case.robot, case.model, case.steps)
    except Exception as problem:
        error = f"{type(problem).__name__}: {problem}"
    worst: dict[str, float] = {}
    try:
        if result is not None:
            for step in result.steps:
                for name, value in check_step(result.robot, result.model, step).items():
                    worst[name] = max(worst.get(name, 0.0), value if np.isfinite(value) else np.inf)
            if result.converged:
                worst |= _history(case)
    except Exception as problem:
        error = f"in a check: {type(problem).__name__}: {problem}"
    steps = () if result is None else result.steps
    solved, warnings = sum(s.converged for s in steps), [] if result is None else list(result.warnings)
    message = "" if result is None or result.converged else result.message
    rounded: dict[str, float | None] = {name: float(f"{value:.3g}") for name, value in worst.items()}
    return Outcome(case.number, len(case.steps), solved, message, error, rounded, warnings)


def _history(case: RandomCase) -> dict[str, float]:
    """Checks of the whole history, on a sample of the cases."""
    found: dict[str, float] = {}
    if case.number % REFERENCE_EVERY == 0:
        found |= _reference(case)
    if case.number % ENERGY_EVERY == 1 and is_covered(case.robot, case.model, case.steps):
        mesh = 2 if case.model.elements_per_bay == "auto" else case.model.elements_per_bay
        model = replace(case.model, elements_per_bay=mesh)
        fine = simulate(case.robot, model, divided(case.robot, case.steps, PARTS))
        if fine.converged and not fine.warnings:
            balance = ledger(fine)
            found["energy balance"] = balance.gap
            # With one mobilisation per tendon, a hole may have friction along its own slip.
            if model.friction != "per-tendon":
                found["no hole gives energy"] = balance.gain
    return found


def _reference(case: RandomCase) -> dict[str, float]:
    """Distance of the nodes at the disks from the reference, less twice the announced error of the mesh."""
    if case.robot.without_disks:
        return {}
    reference = partial(solve_reference, settings=ReferenceSettings(substeps=16))
    found = compare(case, {"fe": simulate, "reference": reference})
    # The reference does not have everything.
    if found.failures or any(w.startswith("fe: ") for w in found.warnings):
        return {}
    return {"reference": max(g - 2.0 * e for g, e in zip(found.gaps, found.estimates, strict=True))}


def reason(message: str) -> str:
    """A message without its numbers, to count those that are alike."""
    text = re.sub(r"^step \d+ \([^)]*\) ", "", message)
    return re.sub(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?", "#", text)[:120]


class Fuzz(Campaign):
    """See the text of this module."""

    count: ClassVar[int | None] = 10_000
    outcome = Outcome

    def run(self, case: int, out: Path) -> Outcome:
        """Draw, solve and check one case."""
        return check_case(draw(case))

    def row(self, outcome: Outcome) -> dict[str, Any]:
        """What was found, with the largest value of every check."""
        kept = {k: v for k, v in super().row(outcome).items() if k != "worst"}
        values = {name: outcome.value(name) if name in outcome.worst else np.nan for name in TOLERANCES}
        return {**kept, "passed": outcome.passed, "broken": "; ".join(outcome.broken), **values}

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """Counts, a table by check, and the cases that did not pass."""
        failed = [o for o in outcomes if o.solved < o.steps and not o.error]
        wrong = [o for o in outcomes if o.broken or o.error]
        alike = Counter(reason(o.message) for o in failed).most_common(8)
        return [
            f"{count(len(outcomes), 'robot')}, {sum(o.steps for o in outcomes)} load steps, "
            f"{sum(o.solved for o in outcomes)} solved; {count(len(failed), 'robot')} did not converge, "
            f"{len(wrong)} wrong",
            checks_table(outcomes),
            *(f"{number} did not converge: {text}" for text, number in alike),
            *(f"{o.number}: {_complaint(o)}" for o in (wrong + failed)[:30]),
        ]


def _complaint(outcome: Outcome) -> str:
    broken = ", ".join(f"{name} {outcome.value(name):.1e}" for name in outcome.broken)
    return outcome.error or broken or outcome.message[:100]


def checks_table(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """By check: cases, median and largest value, tolerance, and cases beyond it."""
    rows = []
    for name, limit in TOLERANCES.items():
        values = np.array([o.value(name) for o in outcomes if name in o.worst])
        if values.size:
            beyond = int((values > limit).sum())
            rows.append((name, values.size, f"{np.median(values):.2g}", f"{values.max():.2g}", limit, beyond))
    return pd.DataFrame(rows, columns=["check", "cases", "median", "largest", "tolerance", "beyond"])


CAMPAIGN = Fuzz()
