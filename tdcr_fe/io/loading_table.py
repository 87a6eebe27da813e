"""The loading sequence of a measurement: the rows of ``loading.csv``, read with every mistake by name, and written."""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from tdcr_fe.io.problems import Problem
from tdcr_fe.io.spreadsheet import millimetres_hint, number, whole_number
from tdcr_fe.model.loading import Actuation, Load, LoadStep, resolve
from tdcr_fe.model.robot import Robot

FORCES = ("force_x", "force_y", "force_z")
#: A table with more mistakes is not read on.
MOST_PROBLEMS = 1000


class Loading(NamedTuple):
    """A loading sequence as a file has it.

    Attributes
    ----------
    step_ids : tuple of int
        Number of every step, in order.
    steps : tuple of LoadStep
    branches : tuple of str
        Empty texts where the file has none.
    """

    step_ids: tuple[int, ...] = ()
    steps: tuple[LoadStep, ...] = ()
    branches: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Row:
    """A row of texts.

    Attributes
    ----------
    cells : mapping
        By column.
    file : str
    """

    cells: Mapping[Any, Any]
    file: str

    def problem(self, column: str, allowed: str) -> Problem:
        """What is wrong with one cell."""
        where = f"line {self.cells['line']}, {column}"
        return Problem(self.file, where, str(self.cells[column]) or "empty", allowed)


def read_loading(table: pd.DataFrame, robot: Robot, file: str) -> tuple[Loading, list[Problem]]:
    """The loading sequence, and all mistakes in it.

    Parameters
    ----------
    table
        Of texts, with the column ``line``.
    robot
        Whose tendons are named.
    file
        For messages.

    Returns
    -------
    loading : Loading
        Complete where there are no problems.
    problems : list of Problem
        Those of the first rows where there are more than `MOST_PROBLEMS`.
    """
    problems = _column_problems(table.columns, robot, file)
    if problems:
        return Loading(), problems
    if table.empty:
        return Loading(), [Problem(file, "", "", "has no steps")]
    numbers: dict[int, None] = {}  # in order; many steps are found in it fast
    steps, branches = [], []
    last_time = 0.0
    for cells in table.to_dict("records"):
        row = _Row(cells, file)
        step_id, wrong = _step_id(row, numbers)
        values, more = _values(row, robot.backbone.length)
        wrong += more
        if values.get("time", last_time) < last_time:
            wrong.append(row.problem("time", f"must not be before the step before, at {last_time:g} s"))
        last_time = max(last_time, values.get("time", last_time))
        numbers[step_id] = None
        problems += wrong
        if len(problems) > MOST_PROBLEMS:
            break
        if not wrong:
            steps.append(_load_step(step_id, values, robot))
            branches.append(str(cells.get("branch", "")))
    return Loading(tuple(numbers), tuple(steps), tuple(branches)), problems


def _column_problems(columns: Iterable[str], robot: Robot, file: str) -> list[Problem]:
    """Columns that are unknown, missing, or exclude each other."""
    columns, tendons = list(columns), robot.tendon_names
    known = {"step", "branch", "time", *FORCES}
    known |= {f"{kind}_{name}" for kind in ("tension", "displacement") for name in tendons}
    problems = []
    if "step" not in columns:
        problems.append(Problem(file, "step", "", "missing column"))
    for column in columns:
        if column not in known and column != "line":
            near = difflib.get_close_matches(column, known, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            allowed = ", ".join(sorted(known))
            problems.append(Problem(file, column, "", f"unknown column{hint}; allowed: {allowed}"))
    both = "the tendon has a tension too; one of the two is allowed"
    problems += [
        Problem(file, f"displacement_{name}", "", both)
        for name in tendons
        if {f"tension_{name}", f"displacement_{name}"} <= set(columns)
    ]
    if 0 < len(set(FORCES) & set(columns)) < 3:
        problems.append(Problem(file, ", ".join(FORCES), "", "all three or none of these columns"))
    return problems


def _step_id(row: _Row, taken: Collection[int]) -> tuple[int, list[Problem]]:
    """Number of a step; 0 where it has none."""
    found = whole_number(row.cells["step"])
    if found is None:
        return 0, [row.problem("step", "must be a whole number")]
    if found in taken:
        allowed = "the step is there more than once; the order of the rows is the order of loading"
        return found, [row.problem("step", allowed)]
    return found, []


def _values(row: _Row, length: float) -> tuple[dict[str, float], list[Problem]]:
    """Inputs, forces and time of a step, by column; NaN where a cell is no finite number."""
    values: dict[str, float] = {}
    problems = []
    for column, text in row.cells.items():
        if column in ("line", "step", "branch") or (column == "time" and text == ""):
            continue
        values[column] = value = number(text)
        allowed = _allowed(column, value, length)
        if allowed:
            problems.append(row.problem(column, allowed))
    return values, problems


def _allowed(column: str, value: float, length: float) -> str:
    """What is allowed in a column; empty where the value is."""
    if math.isnan(value):
        return "must be a finite number; without it the history of loading is lost"
    if column.startswith("tension_") and value < 0.0:
        return "a tension must be zero or more [N]"
    if column.startswith("displacement_") and abs(value) > length:
        hint = millimetres_hint(value, length)
        return f"more than the robot's length of {length:g} m; must be in m{hint}"
    return ""


def _load_step(step_id: int, values: Mapping[str, float], robot: Robot) -> LoadStep:
    loads = {}
    if FORCES[0] in values:
        x, y, z = (values[c] for c in FORCES)
        loads["tip"] = Load(robot.backbone.length, (x, y, z))

    def inputs(kind: str) -> dict[str, float]:
        return {n: values[f"{kind}_{n}"] for n in robot.tendon_names if f"{kind}_{n}" in values}

    return LoadStep(str(step_id), inputs("tension"), inputs("displacement"), loads, time=values.get("time"))


def loading_table(
    robot: Robot, step_ids: Sequence[int], steps: Sequence[LoadStep], branches: Sequence[str]
) -> pd.DataFrame:
    """A loading sequence as ``loading.csv`` has it.

    Parameters
    ----------
    robot
        That is loaded.
    step_ids, steps, branches
        Of every step; there is no column of branches where all are empty texts.

    Raises
    ------
    ValueError
        The file has no columns for some of it; the message names what.
    """
    states = resolve(robot, steps)
    foreign = without_columns(robot, states)
    if foreign:
        raise ValueError(f"loading.csv cannot express {'; '.join(foreign)}")
    named = {name for step in steps for name in (*step.tensions, *step.displacements)}
    driven = [(i, name) for i, name in enumerate(robot.tendon_names) if name in named]
    rows = []
    for step_id, branch, step, state in zip(step_ids, branches, steps, states, strict=True):
        row: dict[str, object] = {"step": step_id}
        if any(branches):
            row["branch"] = branch
        if step.time is not None:
            row["time"] = step.time
        row |= {
            f"{'displacement' if state.by_displacement[i] else 'tension'}_{name}": float(state.values[i])
            for i, name in driven
        }
        if any(s.loads for s in steps):
            force = np.sum([load.force for load in state.loads.values()], axis=0, initial=0.0)
            row |= dict(zip(FORCES, np.broadcast_to(force, 3).tolist(), strict=True))
        rows.append(row)
    return pd.DataFrame(rows)


def without_columns(robot: Robot, states: Sequence[Actuation]) -> list[str]:
    """What of a loading sequence has no columns in ``loading.csv``, in words.

    Parameters
    ----------
    robot
        That is loaded.
    states
        What acts at the end of every step.
    """
    found = [
        f"tendon {name}: driven by tension and by displacement"
        for i, name in enumerate(robot.tendon_names)
        if len({bool(state.by_displacement[i]) for state in states}) > 1
    ]
    for name, load in {(n, load) for state in states for n, load in state.loads.items()}:
        if not any((*load.force, *load.moment)):
            continue
        if any(load.moment):
            found.append(f"load {name}: a moment")
        if load.frame != "world" and any(load.force):
            found.append(f"load {name}: a force in the frame of the section")
        if abs(load.at - robot.backbone.length) > 1e-9 * robot.backbone.length:
            found.append(f"load {name}: not at the tip")
    return sorted(set(found))


def loading_text(
    robot: Robot, step_ids: Sequence[int], steps: Sequence[LoadStep], branches: Sequence[str]
) -> str:
    """A loading sequence as the text of a ``loading.csv``, see `loading_table`."""
    text: str = loading_table(robot, step_ids, steps, branches).to_csv(index=False)
    return text
