"""Checks of the values of a sweep against the schema of robot and scenario, before anything is solved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.io.toml import TableReader, build_scenario
from tdcr_fe.model.messages import quoted, shown
from tdcr_fe.sweeps.cases import tables_with
from tdcr_fe.sweeps.description import Sweep, Variation
from tdcr_fe.sweeps.keys import KeyProblem
from tdcr_fe.sweeps.sampling import Column

#: Most values of one variation that are checked (of more, as many at equal distances), most cases that are tried with
#: a value that is wrong alone, and most values of one variation that are reported.
MOST_CHECKED, MOST_TRIED, MOST_REPORTED = 200, 30, 10


def value_problems(sweep: Sweep, further_tables: Mapping[str, TableReader]) -> list[Problem]:
    """Values that the files do not allow.

    A value is refused where it is wrong alone, all others as declared, and in every case tried that has it as well.
    Other contradictions, which only some combinations have, become the status of their cases.
    """
    design = sweep.design()

    def mistakes(number: int) -> list[Problem]:
        """Of a case, counted from 0."""
        return _mistakes(sweep, list(zip(sweep.variations, design.case(number), strict=True)), further_tables)

    found: list[Problem] = []
    for i, (variation, column) in enumerate(zip(sweep.variations, design.columns, strict=True)):
        in_workspace = sweep.workspace and variation.name.startswith("pull_")
        where = "workspace" if in_workspace else f"vary[{i}]"
        mine: dict[Problem, None] = {}
        for case in _checked(column):
            problems = _mistakes(sweep, [(variation, column[case])], further_tables)
            if problems and all(mistakes(k) for k in _cases_with(column, case)):
                mine |= dict.fromkeys(_said(sweep.path, where, variation, column[case], p) for p in problems)
        some = list(mine)[:MOST_REPORTED]
        if len(mine) > len(some):
            some[-1] = replace(some[-1], allowed=f"{some[-1].allowed} (and {len(mine) - len(some)} more)")
        found += some
    return found


def _checked(column: Column) -> list[int]:
    """First cases, from 0, with the values that are checked: the options, or the smallest and the largest number."""
    if not column.options:
        return list(dict.fromkeys((int(column.numbers.argmin()), int(column.numbers.argmax()))))
    numbers, first = np.unique(column.numbers, return_index=True)
    if len(numbers) > MOST_CHECKED:
        first = first[np.linspace(0, len(numbers) - 1, MOST_CHECKED).astype(int)]
    return [int(k) for k in first]


def _cases_with(column: Column, case: int) -> list[int]:
    """Cases with the same value, from 0: all of them, or some drawn at random."""
    same = np.flatnonzero(column.numbers == column.numbers[case])
    if len(same) > MOST_TRIED:
        same = np.random.default_rng(0).choice(same, MOST_TRIED, replace=False)
    return [int(k) for k in same]


def _mistakes(
    sweep: Sweep, values: list[tuple[Variation, Any]], further_tables: Mapping[str, TableReader]
) -> list[Problem]:
    """Mistakes of the files with some values, all others as declared; a key that names nothing is one without a key."""
    try:
        build_scenario(tables_with(sweep, values), further_tables)
    except KeyProblem as error:
        return [Problem("", "", "", str(error))]
    except InputError as error:
        return list(error.problems)
    return []


def _said(path: str, where: str, variation: Variation, value: Any, found: Problem) -> Problem:
    """A mistake of the files, said of the sweep that made it."""
    texts = [key.text for key in variation.keys]
    if not found.key or found.allowed.startswith("unknown"):
        return Problem(path, f"{where}.key", ", ".join(map(quoted, texts)), found.allowed)
    about = found.allowed if found.key in texts else f"{found.key} = {found.value}: {found.allowed}"
    if variation.distribution is None:
        return Problem(path, f"{where}.values", shown(value), f"{', '.join(texts)}: {about}")
    name, _ = variation.distribution.described()
    text = f"the sample has this value of {texts[0]}: {about}; bounds (lower, upper) leave such values out"
    return Problem(path, f"{where}.{name}", f"{value:.6g}", text)
