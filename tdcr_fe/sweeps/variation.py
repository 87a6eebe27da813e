"""A scenario as the parameter function of `exudyn.processing.ParameterVariation` and Exudyn's optimisers."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tdcr_fe.io.effects import effects_reader
from tdcr_fe.io.own_effects import read_own_effects
from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.io.toml import ScenarioTables, build_scenario, read_scenario_tables
from tdcr_fe.model.messages import meant
from tdcr_fe.sweeps.cases import Job, columns_of_steps, solve_cases, tables_with
from tdcr_fe.sweeps.description import Output, Sampling, Sweep, Variation
from tdcr_fe.sweeps.keys import KeyProblem, parse_key

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
        variations = tuple(Variation(key.text, (key,)) for key, _ in named)
        values = tuple(v.item() if hasattr(v, "item") else v for _, v in named)
        one = Sweep(self.sweep.tables, variations, Sampling(), self.sweep.output, effects=self.sweep.effects)
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
    tables: ScenarioTables = read_scenario_tables(scenario)
    own = {"effects": effects_reader(read_own_effects(effects))}
    known = columns_of_steps(build_scenario(tables, own).robot.tendon_names)
    wrong = [q for q in quantities if q not in known]
    if wrong:
        problems = [
            Problem(
                "parameter_function",
                "quantities",
                q,
                f"unknown{meant(q, known)}; there are {', '.join(known)}",
            )
            for q in wrong
        ]
        raise InputError(problems)
    base = Sweep(
        tables, (), Sampling(), Output(quantities=tuple(quantities)), effects=tuple(map(str, effects))
    )
    return ParameterFunction(base, tuple(quantities))


__all__ = ["KeyProblem", "ParameterFunction", "parameter_function"]
