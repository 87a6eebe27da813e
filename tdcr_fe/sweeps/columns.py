"""Numbers that are kept of a case: columns of `steps.csv`, and estimates of the mesh and of buckling."""

from __future__ import annotations

import math
from collections.abc import Iterable

from tdcr_fe.model.dataframes import AFTER_TENDONS, OF_TENDONS
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.sweeps.description import Output

#: Columns of the table of cases before the variations.
ABOUT_CASE = ("case", "status", "reason", "warnings")
#: Columns beyond those of `steps.csv`.
ESTIMATES = ("discretisation_error", "buckling_load_fraction")


def columns_of_steps(tendons: Iterable[str]) -> list[str]:
    """Names of all numbers that a load step has."""
    names = list(tendons)
    return [*(f"{quantity}_{n}" for quantity in OF_TENDONS for n in names), *AFTER_TENDONS, *ESTIMATES]


def numbers_of_step(step: StepResult, tendons: Iterable[str]) -> dict[str, float]:
    """All numbers of a load step, by column; NaN where an estimate was not made."""
    found = [float(x) for values in OF_TENDONS.values() for x in values(step)]
    found += [float(value(step)) for value in AFTER_TENDONS.values()]  # type: ignore[arg-type]
    found += [math.nan if x is None else float(x) for x in (getattr(step, name) for name in ESTIMATES)]
    return dict(zip(columns_of_steps(tendons), found, strict=True))


def numbers_of(result: SequenceResult, output: Output) -> dict[str, float]:
    """What is kept of a result.

    Columns of the last step have the names of `steps.csv`; where steps were chosen, ``_step1`` and so on is added.
    Steps that were not solved are left out.
    """
    wanted = set(output.quantities)
    names = result.robot.tendon_names
    if not output.steps:
        chosen = [("", result.steps[-1])] if result.converged and result.steps else []
    else:
        solved = {s.step: s for s in result.steps if s.converged}
        chosen = [(f"_step{k}", solved[k]) for k in output.steps if k in solved]
    return {
        f"{name}{suffix}": value
        for suffix, step in chosen
        for name, value in numbers_of_step(step, names).items()
        if not wanted or name in wanted
    }
