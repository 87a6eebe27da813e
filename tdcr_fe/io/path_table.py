"""Targets of the tip: the rows of ``path.csv``, read with every mistake by name."""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tdcr_fe.io.loading_table import MOST_PROBLEMS
from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.io.spreadsheet import millimetres_hint, number, read_table, whole_number
from tdcr_fe.model.targets import TipTarget

POSITION, DIRECTION = ("x", "y", "z"), ("dx", "dy", "dz")
#: A target farther away than this many lengths of the robot is taken for one in another unit.
FARTHEST = 10.0


def read_path(path: str | os.PathLike[str], length: float) -> tuple[TipTarget, ...]:
    """Read ``path.csv``.

    Parameters
    ----------
    path
        Columns ``step,x,y,z`` and, optionally, ``dx,dy,dz``, ``label`` and ``time``.
    length
        Of the robot [m], by which positions in another unit are recognised.

    Raises
    ------
    InputError
        With every mistake in the file.
    """
    path = Path(path)
    table = read_table(path)
    problems = _column_problems(list(table.columns), str(path))
    if not problems and table.empty:
        problems = [Problem(str(path), "", "", "has no targets")]
    if problems:
        raise InputError(problems)
    targets, taken, last_time = [], set[int](), 0.0
    for line, cells in table.to_dict("index").items():
        target, wrong = _target(cells, length)
        step = whole_number(cells["step"])
        if step is None or step in taken:
            wrong.append(
                ("step", "must be a whole number" if step is None else "the step is there more than once")
            )
        taken.add(step if step is not None else 0)
        if target is not None and target.time is not None:
            if target.time < last_time:
                wrong.append(("time", f"must not be before the target before, at {last_time:g} s"))
            last_time = max(last_time, target.time)
        problems += [
            Problem(str(path), f"line {line}, {column}", cells[column] or "empty", allowed)
            for column, allowed in wrong
        ]
        if len(problems) > MOST_PROBLEMS:
            break
        if target is not None:
            targets.append(target)
    if problems:
        raise InputError(problems)
    return tuple(targets)


def _column_problems(columns: list[str], file: str) -> list[Problem]:
    """Columns that are unknown or missing."""
    known = ("step", *POSITION, *DIRECTION, "label", "time")
    problems = []
    for column in columns:
        if column not in known:
            near = difflib.get_close_matches(column, known, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            problems.append(Problem(file, column, "", f"unknown column{hint}; allowed: {', '.join(known)}"))
    missing = [c for c in ("step", *POSITION) if c not in columns]
    problems += [Problem(file, c, "", "missing column; must have step, x, y, z") for c in missing]
    if 0 < len(set(DIRECTION) & set(columns)) < 3:
        problems.append(Problem(file, ", ".join(DIRECTION), "", "all three or none of these columns"))
    return problems


def _target(cells: Mapping[Any, str], length: float) -> tuple[TipTarget | None, list[tuple[str, str]]]:
    """The target of a row, None where it is not sound; and mistakes as column and what is allowed."""
    wrong = []
    values = {c: number(cells[c]) for c in (*POSITION, *DIRECTION, "time") if cells.get(c)}
    free = all(not cells.get(c) for c in DIRECTION)
    for column in (*POSITION, *(() if free else DIRECTION)):
        if math.isnan(values.get(column, math.nan)):
            wrong.append((column, "must be a finite number"))
    for column in POSITION:
        value = values.get(column, 0.0)
        if abs(value) > FARTHEST * length:
            hint = millimetres_hint(value, length)
            wrong.append((column, f"more than {FARTHEST:g} lengths of the robot away; must be in m{hint}"))
    if not free and not any(values.get(c, 1.0) for c in DIRECTION):
        wrong.append(("dx", "the direction is zero; leave dx, dy and dz empty where it does not matter"))
    time = values.get("time")
    if time is not None and not time >= 0.0:
        wrong.append(("time", "must be a time of zero or more [s]"))
    if wrong:
        return None, wrong
    x, y, z = (values[c] for c in POSITION)
    direction = None if free else (values["dx"], values["dy"], values["dz"])
    return TipTarget((x, y, z), direction, cells.get("label") or f"step {cells['step']}", time), []
