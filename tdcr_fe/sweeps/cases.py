"""Solve cases of a sweep, also for Exudyn: from their values to their numbers or the reason why there are none."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any, Literal, get_args

import exudyn
import numpy as np

from tdcr_fe.io.files import InputError, Problem, StrPath
from tdcr_fe.io.toml import Scenario, ScenarioTables, build_scenario, read_scenario_tables
from tdcr_fe.io.user_effects import read_own_effects
from tdcr_fe.model.columns import AFTER_TENDONS, tendon_columns
from tdcr_fe.model.messages import join, meant, shown, warnings_to
from tdcr_fe.model.results import SequenceResult
from tdcr_fe.model.units import number_or_none
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.sweeps.description import Change, Mode, Output, Sweep
from tdcr_fe.sweeps.keys import Key, KeyProblem, parse_key, set_value, unit_of

#: "converged"; "not converged": a load step failed; "invalid": no robot or scenario has these values; "error": an
#: unexpected failure, also of a function of the user's own; "not run".
Status = Literal["converged", "not converged", "invalid", "error", "not run"]
STATUSES: tuple[Status, ...] = get_args(Status)

#: Further numbers of a result, by name; a function of a module, so that workers find it.
Evaluate = Callable[[SequenceResult], Mapping[str, float]]

#: Columns of the table of cases before the variations.
ABOUT_CASE = ("case", "status", "reason", "warnings")
#: Results beyond the columns of `steps.csv`.
ESTIMATES = ("discretisation_error", "buckling_load_fraction")


@dataclass(frozen=True)
class Job:
    """What a worker needs besides the values of a case."""

    sweep: Sweep  # without its variations
    evaluate: Evaluate | None = None  # further numbers of a result
    inputs: tuple[str, ...] = ()  # columns of the variations


@dataclass(frozen=True)
class Outcome:
    """What a case gave; a line of the journal."""

    case: int  # number, from 1
    status: Status
    reason: str = ""  # why it did not converge
    numbers: Mapping[str, float] = field(default_factory=dict)  # by column
    warnings: tuple[str, ...] = ()

    @staticmethod
    def from_record(record: Mapping[str, Any]) -> Outcome:
        """From a line of the journal."""
        numbers = {k: math.nan if v is None else float(v) for k, v in record["numbers"].items()}
        return Outcome(**{**record, "numbers": numbers, "warnings": tuple(record["warnings"])})


def solve_case(job: Job, case: tuple[int, Sequence[Change]]) -> Outcome:
    """Solve a case, given by its number from 1 and what changes in it."""
    exudyn.config.printToConsole = False
    with warnings_to(), np.errstate(over="ignore", invalid="ignore"):  # on the way to a failure
        return _solved(job, *case)


def _solved(job: Job, number: int, changes: Sequence[Change]) -> Outcome:
    """The outcome of one case; no exception leaves it but an interruption."""
    numbers: dict[str, float] = {}
    warnings: tuple[str, ...] = ()
    try:
        scenario = scenario_of(job.sweep, changes)
        result = simulate(scenario.robot, scenario.model, scenario.steps, scenario.settings)
        numbers, warnings = numbers_of(result, job.sweep.output, scenario.ends), result.warnings
        if not result.converged:
            return Outcome(number, "not converged", result.message, numbers, warnings)
    except InputError as error:
        text = "; ".join(f"{p.key} = {p.value}: {p.allowed}" for p in error.problems)
        return Outcome(number, "invalid", text)
    except ValueError as error:  # also a KeyProblem; a contradiction that only the solver can detect
        return Outcome(number, "invalid", str(error))
    except Exception as error:
        return Outcome(number, "error", f"{type(error).__name__}: {error}")
    try:
        further = {str(k): float(v) for k, v in (job.evaluate(result) if job.evaluate else {}).items()}
        if taken := {*ABOUT_CASE, *numbers, *job.inputs} & set(further):
            raise ValueError(f"evaluate gives {min(taken)!r}, which is the name of another column")
    except Exception as error:
        return Outcome(number, "error", f"{type(error).__name__}: {error}", numbers, warnings)
    return Outcome(number, "converged", "", numbers | further, warnings)


_own_effects = lru_cache(maxsize=4)(read_own_effects)


def scenario_of(sweep: Sweep, changes: Iterable[Change] = ()) -> Scenario:
    """The scenario with some changes; the user's effects are read once."""
    return build_scenario(tables_with(sweep, changes), _own_effects(sweep.effects))


def tables_with(sweep: Sweep, changes: Iterable[Change]) -> ScenarioTables:
    """Tables of scenario and robot with some changes.

    Raises
    ------
    KeyProblem
        A key names nothing.
    """
    tables = sweep.tables
    for key, mode, value in changes:
        tables = set_value(tables, key, partial(_changed, key, mode, value))
    return tables


def _changed(key: Key, mode: Mode, value: Any, declared: Any) -> Any:
    """A declared value after a change."""
    if mode == "value":
        return value
    number = number_or_none(declared, unit_of(key))
    if number is None:
        given = "is not in the file" if declared is None else f"is {shown(declared)} in the file"
        raise KeyProblem(f'{join("", *key)} {given}; mode = "{mode}" needs a number there')
    return number * value if mode == "factor" else number + value


def columns_of_steps(tendons: Iterable[str]) -> list[str]:
    """Names of all numbers that a load step has."""
    return [*tendon_columns(tendons), *AFTER_TENDONS, *ESTIMATES]


def numbers_of(result: SequenceResult, output: Output, ends: Sequence[int]) -> dict[str, float]:
    """What is kept of a result, at the ``ends`` of load steps, see `Scenario`; those not solved are left out.

    Columns of the last step have the names of `steps.csv`; where steps were chosen, ``_step1`` and so on is added.
    """
    known = columns_of_steps(result.robot.tendon_names)
    kept = [name for name in known if not output.quantities or name in output.quantities]
    estimates = {name: [getattr(s, name) for s in result.steps] for name in ESTIMATES}
    frame = result.to_frame().assign(**estimates).set_index("step")
    solved = frame.loc[[s.converged for s in result.steps], kept].astype(float)
    return {
        f"{name}{suffix}": value
        for suffix, number in output.suffixes(len(ends)).items()
        if (end := ends[number - 1]) in solved.index
        for name, value in solved.loc[end].to_dict().items()
    }


#: Keys that Exudyn adds to the parameters of a case.
_OF_EXUDYN = {"computationIndex", "functionData"}


def _values_at(job: Job, columns: tuple[str, ...], parameterDict: Mapping[str, Any]) -> list[float]:
    """One number a column, with the values of some keys; NaN where there is none."""
    changes: list[Change] = []
    for text, value in parameterDict.items():
        if text not in _OF_EXUDYN:
            changes.append((parse_key(text), "value", value.item() if hasattr(value, "item") else value))
    tables_with(job.sweep, changes)  # a wrong key is the caller's mistake
    numbers = solve_case(job, (1, changes)).numbers
    return [numbers.get(name, math.nan) for name in columns]


def parameter_function(
    scenario: StrPath,
    quantities: Sequence[str] = ("tip_x", "tip_y", "tip_z"),
    *,
    effects: Sequence[StrPath] = (),
) -> Callable[[Mapping[str, Any]], list[float]]:
    """A scenario as a function of parameters, as `exudyn.processing.ParameterVariation` takes it.

    Parameters
    ----------
    scenario
        Path of a `scenario.toml`.
    quantities
        Columns of `steps.csv`; those of the last load step are returned, in this order.
    effects
        Python files with effects of one's own.

    Returns
    -------
    callable
        From a dictionary of values by keys such as ``"backbone.radius"`` to a list of numbers, which are NaN where the
        case did not converge or is invalid. It can be sent to other processes.

    Raises
    ------
    InputError
        A file is wrong, or a quantity is unknown.
    """
    tables, files = read_scenario_tables(scenario), tuple(map(str, effects))
    known = columns_of_steps(build_scenario(tables, _own_effects(files)).robot.tendon_names)
    wrong = [name for name in quantities if name not in known]
    if wrong:
        there = f"; there are {', '.join(known)}"
        texts = {name: f"unknown{meant(name, known)}{there}" for name in wrong}
        raise InputError(Problem("parameter_function", "quantities", *item) for item in texts.items())
    sweep = Sweep(tables, output=Output(quantities=tuple(quantities)), effects=files)
    return partial(_values_at, Job(sweep), tuple(quantities))
