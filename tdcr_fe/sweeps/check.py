"""Checks of the values of a sweep against the schema of robot and scenario, before anything is solved."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.io.toml import TableReader, build_scenario
from tdcr_fe.model.messages import quoted, shown
from tdcr_fe.sweeps.cases import tables_with
from tdcr_fe.sweeps.description import Sweep, Variation
from tdcr_fe.sweeps.keys import KeyProblem
from tdcr_fe.sweeps.sampling import Column, Design

#: Most values of one variation that are checked; of more, as many at equal distances.
MOST_CHECKED = 200
#: Most cases that are tried with a value that is wrong alone.
MOST_TRIED = 30
#: Most values of one variation that are reported.
MOST_REPORTED = 10


def value_problems(sweep: Sweep, further_tables: Mapping[str, TableReader]) -> list[Problem]:
    """Values that the files do not allow.

    A value is refused where it is wrong alone, all others as declared, and in every case tried that has it as well.
    Other contradictions, which only some combinations have, become the status of their cases.
    """
    design = sweep.design()
    found: list[Problem] = []
    for i, (variation, column) in enumerate(zip(sweep.variations, design.columns, strict=True)):
        mine: list[Problem] = []
        for case in _checked(column):
            problems = _alone(sweep, i, variation, column[case], further_tables)
            cases = _cases_with(column, case) if problems else ()
            if problems and not any(_case_is_sound(sweep, design, k, further_tables) for k in cases):
                mine += [p for p in problems if p not in mine]
        if len(mine) > MOST_REPORTED:
            last = mine[MOST_REPORTED - 1]
            more = f"{last.allowed} (and {len(mine) - MOST_REPORTED} more)"
            mine = [*mine[: MOST_REPORTED - 1], Problem(last.file, last.key, last.value, more)]
        found += mine
    return found


def _checked(column: Column) -> Iterable[int]:
    """First cases, from 0, with the values that are checked: the options, or the smallest and the largest number."""
    if not column.options:
        return dict.fromkeys((int(column.numbers.argmin()), int(column.numbers.argmax())))
    numbers, first = np.unique(column.numbers, return_index=True)
    if len(numbers) > MOST_CHECKED:
        first = first[np.linspace(0, len(numbers) - 1, MOST_CHECKED).astype(int)]
    return [int(k) for k in first]


def _cases_with(column: Column, case: int) -> Iterable[int]:
    """Cases with the same value, from 0: all of them, or some drawn at random."""
    same = np.flatnonzero(column.numbers == column.numbers[case])
    if len(same) > MOST_TRIED:
        same = np.random.default_rng(0).choice(same, MOST_TRIED, replace=False)
    return [int(k) for k in same]


def _alone(
    sweep: Sweep, i: int, variation: Variation, value: Any, further_tables: Mapping[str, TableReader]
) -> list[Problem]:
    """Mistakes of one value where all others are as declared."""
    where = f"vary[{i}]" if not variation.name.startswith("pull_") or not sweep.workspace else "workspace"
    texts = [key.text for key in variation.keys]
    try:
        build_scenario(tables_with(sweep, [(variation, value)]), further_tables)
    except KeyProblem as error:
        return [Problem(sweep.path, f"{where}.key", ", ".join(map(quoted, texts)), str(error))]
    except InputError as error:
        return [_problem(sweep.path, where, variation, value, p) for p in error.problems]
    return []


def _problem(path: str, where: str, variation: Variation, value: Any, found: Problem) -> Problem:
    """A mistake of the files, said of the sweep that made it."""
    texts = [key.text for key in variation.keys]
    if found.allowed.startswith("unknown"):
        return Problem(path, f"{where}.key", ", ".join(map(quoted, texts)), found.allowed)
    about = found.allowed if found.key in texts else f"{found.key} = {found.value}: {found.allowed}"
    if variation.distribution is not None:
        name = type(variation.distribution).__name__.lower()
        about = (
            f"the sample has this value of {texts[0]}: {about}; bounds (lower, upper) leave such values out"
        )
        return Problem(path, f"{where}.{name}", f"{value:.6g}", about)
    return Problem(path, f"{where}.values", shown(value), f"{', '.join(texts)}: {about}")


def _case_is_sound(
    sweep: Sweep, design: Design, case: int, further_tables: Mapping[str, TableReader]
) -> bool:
    try:
        build_scenario(
            tables_with(sweep, zip(sweep.variations, design.case(case), strict=True)), further_tables
        )
    except (InputError, KeyProblem):
        return False
    return True
