"""The tables of one case: those of scenario and robot with the values of the case in their places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from tdcr_fe.io.toml import ScenarioTables
from tdcr_fe.model.messages import shown
from tdcr_fe.sweeps.description import Mode, Sweep, Variation
from tdcr_fe.sweeps.keys import Change, Key, KeyProblem, set_value


def case_tables(sweep: Sweep, values: Sequence[Any]) -> ScenarioTables:
    """Tables of a case.

    Parameters
    ----------
    sweep
        Of the case.
    values
        One a variation.

    Raises
    ------
    KeyProblem
        A key names nothing in the robot of this case.
    """
    return with_values(sweep, list(zip(sweep.variations, values, strict=True)))


def with_values(sweep: Sweep, values: Sequence[tuple[Variation, Any]]) -> ScenarioTables:
    """Tables with the values of some variations; a robot that is exchanged comes first."""
    tables = sweep.tables
    robots = dict(sweep.robots)
    pairs = [(key, v.mode, value) for v, value in values for key in v.keys]
    for key, mode, value in sorted(pairs, key=lambda pair: not pair[0].names_robot):
        if key.names_robot:
            other = robots[value]
            tables = replace(other, scenario={**tables.scenario, "robot": value})
        else:
            tables = set_value(tables, key, _change(key, mode, value))
    return tables


def _change(key: Key, mode: Mode, value: Any) -> Change:
    """The change of a declared value in this mode."""
    if mode == "value":
        return lambda declared: value

    def change(declared: Any) -> Any:
        if isinstance(declared, bool) or not isinstance(declared, int | float):
            given = "is not in the file" if declared is None else f"is {shown(declared)} in the file"
            raise KeyProblem(f'{key.text} {given}; mode = "{mode}" needs a number there')
        return declared * value if mode == "factor" else declared + value

    return change
