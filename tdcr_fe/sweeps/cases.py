"""Solve cases of a sweep: from their values to their numbers or the reason why there are none. Runs in workers."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal, cast, get_args

import exudyn
import numpy as np

from tdcr_fe.io.effects import effects_reader
from tdcr_fe.io.own_effects import read_own_effects
from tdcr_fe.io.problems import InputError
from tdcr_fe.io.toml import TableReader, build_scenario
from tdcr_fe.model.results import SequenceResult
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.sweeps.case_tables import case_tables
from tdcr_fe.sweeps.columns import ABOUT_CASE, numbers_of
from tdcr_fe.sweeps.description import Sweep

#: "converged"; "not converged": a load step failed; "invalid": no robot or scenario has these values; "error": an
#: unexpected failure, also of a function of the user's own; "not run".
Status = Literal["converged", "not converged", "invalid", "error", "not run"]
STATUSES: tuple[Status, ...] = get_args(Status)

#: Further numbers of a result, by name; a function of a module, so that workers find it.
Evaluate = Callable[[SequenceResult], Mapping[str, float]]


@dataclass(frozen=True)
class Job:
    """What a worker needs besides the values of a case.

    Attributes
    ----------
    sweep : Sweep
    evaluate : callable or None
        Further numbers of a result.
    """

    sweep: Sweep
    evaluate: Evaluate | None = None


@dataclass(frozen=True)
class Outcome:
    """What a case gave.

    Attributes
    ----------
    case : int
        Number, from 1.
    status : Status
    reason : str
        Why it did not converge; else empty.
    numbers : mapping of str to float
        By column.
    warnings : tuple of str
    seconds : float
        Time that it took.
    """

    case: int
    status: Status
    reason: str = ""
    numbers: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0


def solve_cases(job: Job, cases: Sequence[tuple[int, tuple[Any, ...]]]) -> list[Outcome]:
    """Solve some cases, given by their numbers from 1 and their values, one after the other."""
    exudyn.config.printToConsole = False
    with np.errstate(over="ignore", invalid="ignore"):  # on the way to a failure, which the status reports
        return [_solved(job, number, values) for number, values in cases]


def _solved(job: Job, number: int, values: Sequence[Any]) -> Outcome:
    begun = time.perf_counter()
    status, reason, numbers, warnings = _numbers(job, values)
    return Outcome(number, status, reason, numbers, warnings, time.perf_counter() - begun)


def _numbers(job: Job, values: Sequence[Any]) -> tuple[Status, str, dict[str, float], tuple[str, ...]]:
    """Status, reason, numbers and warnings of one case; no exception leaves it but an interruption."""
    try:
        result = simulate_case(job.sweep, values)
    except InputError as error:
        return "invalid", "; ".join(f"{p.key} = {p.value}: {p.allowed}" for p in error.problems), {}, ()
    except ValueError as error:  # also a KeyProblem; a contradiction that only the solver can detect
        return "invalid", str(error), {}, ()
    except Exception as error:
        return "error", f"{type(error).__name__}: {error}", {}, ()
    numbers = numbers_of(result, job.sweep.output)
    status: Status = "converged" if result.converged else "not converged"
    reason = "" if result.converged else result.message
    if job.evaluate is not None and result.converged:
        try:
            numbers |= _own(job, numbers, job.evaluate(result))
        except Exception as error:
            return "error", f"{type(error).__name__}: {error}", numbers, result.warnings
    return status, reason, numbers, result.warnings


def _own(job: Job, numbers: Mapping[str, float], found: Mapping[str, float]) -> dict[str, float]:
    """Numbers of the user's own function, under names that no other column has."""
    taken = {*ABOUT_CASE, *numbers, *(v.name for v in job.sweep.variations)}
    own = {str(k): float(v) for k, v in found.items()}
    if taken & set(own):
        raise ValueError(f"evaluate gives {min(taken & set(own))!r}, which is the name of another column")
    return own


def simulate_case(sweep: Sweep, values: Sequence[Any]) -> SequenceResult:
    """The whole result of one case, as `tdcr_fe.simulate` gives it.

    Raises
    ------
    InputError, KeyProblem, ValueError
        No robot or scenario has these values.
    """
    scenario = build_scenario(case_tables(sweep, values), _readers(sweep.effects))
    return simulate(scenario.robot, scenario.model, scenario.steps, scenario.settings)


@lru_cache(maxsize=4)
def _readers(effects: tuple[str, ...]) -> Mapping[str, TableReader]:
    return {"effects": effects_reader(read_own_effects(effects))} if effects else {}


def to_record(outcome: Outcome) -> dict[str, Any]:
    """An outcome as a line of the journal."""
    return {
        "case": outcome.case,
        "status": outcome.status,
        "reason": outcome.reason,
        "numbers": dict(outcome.numbers),
        "warnings": list(outcome.warnings),
        "seconds": outcome.seconds,
    }


def from_record(record: Mapping[str, Any]) -> Outcome:
    """An outcome from a line of the journal.

    Raises
    ------
    KeyError, TypeError, ValueError
        It is none.
    """
    if record["status"] not in STATUSES or type(record["case"]) is not int:
        raise ValueError(f"no outcome of a case: {record}")
    numbers = {str(k): float("nan") if v is None else float(v) for k, v in record["numbers"].items()}
    return Outcome(
        record["case"],
        cast(Status, record["status"]),
        str(record["reason"]),
        numbers,
        tuple(map(str, record["warnings"])),
        float(record["seconds"]),
    )
