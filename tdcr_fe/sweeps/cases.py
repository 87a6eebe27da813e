"""Solve cases of a sweep, also for Exudyn: from their values to their numbers or the reason why there are none."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from typing import Any, Literal, get_args

import exudyn
import numpy as np

from tdcr_fe.io.problems import InputError, Reporter
from tdcr_fe.io.toml import ScenarioTables, TableReader, build_scenario, read_scenario_tables
from tdcr_fe.io.user_effects import effects_reader, read_own_effects
from tdcr_fe.model.dataframes import AFTER_TENDONS, OF_TENDONS
from tdcr_fe.model.messages import meant, shown
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.model.units import number_or_none
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.sweeps.description import Mode, Output, Sampling, Sweep, Variation
from tdcr_fe.sweeps.keys import Change, Key, KeyProblem, parse_key, set_value, unit_of

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

    sweep: Sweep
    evaluate: Evaluate | None = None  # further numbers of a result


@dataclass(frozen=True)
class Outcome:
    """What a case gave; a line of the journal."""

    case: int  # number, from 1
    status: Status
    reason: str = ""  # why it did not converge
    numbers: Mapping[str, float] = field(default_factory=dict)  # by column
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0  # time that it took

    def record(self) -> dict[str, Any]:
        """As a line of the journal."""
        return asdict(self)

    @staticmethod
    def from_record(record: Any) -> Outcome | None:
        """From a line of the journal; None where it is no outcome."""
        try:
            if record["status"] not in STATUSES or type(record["case"]) is not int:
                return None
            numbers = {str(k): math.nan if v is None else float(v) for k, v in record["numbers"].items()}
            warnings = tuple(map(str, record["warnings"]))
            return Outcome(**{**record, "numbers": numbers, "warnings": warnings})
        except (AttributeError, KeyError, TypeError, ValueError):
            return None


def solve_cases(job: Job, cases: Sequence[tuple[int, tuple[Any, ...]]]) -> list[Outcome]:
    """Solve some cases, given by their numbers from 1 and their values, one after the other."""
    exudyn.config.printToConsole = False
    found = []
    with np.errstate(over="ignore", invalid="ignore"):  # on the way to a failure, which the status reports
        for number, values in cases:
            begun = time.perf_counter()
            outcome = _solved(job, number, values)
            found.append(replace(outcome, seconds=time.perf_counter() - begun))
    return found


def _solved(job: Job, number: int, values: Sequence[Any]) -> Outcome:
    """The outcome of one case; no exception leaves it but an interruption."""
    try:
        result = simulate_case(job.sweep, values)
    except InputError as error:
        return Outcome(
            number, "invalid", "; ".join(f"{p.key} = {p.value}: {p.allowed}" for p in error.problems)
        )
    except ValueError as error:  # also a KeyProblem; a contradiction that only the solver can detect
        return Outcome(number, "invalid", str(error))
    except Exception as error:
        return Outcome(number, "error", f"{type(error).__name__}: {error}")
    numbers = numbers_of(result, job.sweep.output)
    if not result.converged:
        return Outcome(number, "not converged", result.message, numbers, result.warnings)
    if job.evaluate is not None:
        try:
            numbers |= _own_numbers(job, numbers, job.evaluate(result))
        except Exception as error:
            return Outcome(number, "error", f"{type(error).__name__}: {error}", numbers, result.warnings)
    return Outcome(number, "converged", "", numbers, result.warnings)


def _own_numbers(job: Job, numbers: Mapping[str, float], found: Mapping[str, float]) -> dict[str, float]:
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
    tables = tables_with(sweep, zip(sweep.variations, values, strict=True))
    scenario = build_scenario(tables, _readers(sweep.effects))
    return simulate(scenario.robot, scenario.model, scenario.steps, scenario.settings)


@lru_cache(maxsize=4)
def _readers(effects: tuple[str, ...]) -> Mapping[str, TableReader]:
    return {"effects": effects_reader(read_own_effects(effects))} if effects else {}


def tables_with(sweep: Sweep, values: Iterable[tuple[Variation, Any]]) -> ScenarioTables:
    """Tables of scenario and robot with the values of some variations; a robot that is exchanged comes first.

    Raises
    ------
    KeyProblem
        A key names nothing in the robot of this case.
    """
    tables = sweep.tables
    robots = dict(sweep.robots)
    pairs = [(key, v.mode, value) for v, value in values for key in v.keys]
    for key, mode, value in sorted(pairs, key=lambda pair: not pair[0].names_robot):
        if key.names_robot:
            tables = replace(robots[value], scenario={**tables.scenario, "robot": value})
        else:
            tables = set_value(tables, key, _change(key, mode, value))
    return tables


def _change(key: Key, mode: Mode, value: Any) -> Change:
    """The change of a declared value in this mode."""

    def change(declared: Any) -> Any:
        if mode == "value":
            return value
        number = number_or_none(declared, unit_of(key))
        if number is None:
            given = "is not in the file" if declared is None else f"is {shown(declared)} in the file"
            raise KeyProblem(f'{key.text} {given}; mode = "{mode}" needs a number there')
        return number * value if mode == "factor" else number + value

    return change


def columns_of_steps(tendons: Iterable[str]) -> list[str]:
    """Names of all numbers that a load step has."""
    names = list(tendons)
    return [*(f"{quantity}_{n}" for quantity in OF_TENDONS for n in names), *AFTER_TENDONS, *ESTIMATES]


def _numbers_of_step(step: StepResult) -> list[float]:
    """All numbers of a load step, in the order of `columns_of_steps`; NaN where an estimate was not made."""
    found: list[Any] = [x for values in OF_TENDONS.values() for x in values(step)]
    found += [value(step) for value in AFTER_TENDONS.values()]
    found += [getattr(step, name) for name in ESTIMATES]
    return [math.nan if x is None else float(x) for x in found]


def numbers_of(result: SequenceResult, output: Output) -> dict[str, float]:
    """What is kept of a result.

    Columns of the last step have the names of `steps.csv`; where steps were chosen, ``_step1`` and so on is added.
    Steps that were not solved are left out.
    """
    if output.steps:
        solved = {s.step: s for s in result.steps if s.converged}
        chosen = [(f"_step{k}", solved[k]) for k in output.steps if k in solved]
    else:
        chosen = [("", result.steps[-1])] if result.converged and result.steps else []
    names = columns_of_steps(result.robot.tendon_names)
    return {
        f"{name}{suffix}": value
        for suffix, step in chosen
        for name, value in zip(names, _numbers_of_step(step), strict=True)
        if not output.quantities or name in output.quantities
    }


#: Keys that Exudyn adds to the parameters of a case.
_OF_EXUDYN = {"computationIndex", "functionData"}


@dataclass(frozen=True)
class ParameterFunction:
    """Called with values by key, it solves the scenario with them; made by `parameter_function`.

    Attributes
    ----------
    sweep : Sweep
        The scenario, and what is kept of a result.
    columns : tuple of str
        What a call returns.
    """

    sweep: Sweep
    columns: tuple[str, ...]

    def __call__(self, parameterDict: Mapping[str, Any]) -> list[float]:
        """Solve the scenario with these values.

        Parameters
        ----------
        parameterDict
            Values by keys such as ``"backbone.radius"`` or ``"steps[0].tensions.t1"``.

        Returns
        -------
        list of float
            One number a column; NaN where the case did not converge or is invalid.

        Raises
        ------
        KeyProblem
            A key names nothing in the files.
        """
        named = [(parse_key(k), v) for k, v in parameterDict.items() if k not in _OF_EXUDYN]
        values = tuple(v.item() if hasattr(v, "item") else v for _, v in named)
        variations = tuple(Variation(key.text, (key,)) for key, _ in named)
        one = replace(self.sweep, variations=variations)
        tables_with(one, zip(variations, values, strict=True))  # a wrong key is the caller's mistake
        (outcome,) = solve_cases(Job(one), [(1, values)])
        return [outcome.numbers.get(name, math.nan) for name in self.columns]


def parameter_function(
    scenario: str | os.PathLike[str],
    quantities: Sequence[str] = ("tip_x", "tip_y", "tip_z"),
    *,
    effects: Sequence[str | os.PathLike[str]] = (),
) -> ParameterFunction:
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
    ParameterFunction
        From a dictionary of values by key to a list of numbers. It can be sent to other processes.

    Raises
    ------
    InputError
        A file is wrong, or a quantity is unknown.
    """
    tables, files = read_scenario_tables(scenario), tuple(map(str, effects))
    known = columns_of_steps(build_scenario(tables, _readers(files)).robot.tendon_names)
    report = Reporter("parameter_function")
    for name in quantities:
        if name not in known:
            report("quantities", name, f"unknown{meant(name, known)}; there are {', '.join(known)}")
    if report.problems:
        raise InputError(report.problems)
    base = Sweep(tables, (), Sampling(), Output(quantities=tuple(quantities)), effects=files)
    return ParameterFunction(base, tuple(quantities))
