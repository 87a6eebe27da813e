"""Tables of commands: the loading sequence `loading.csv`, read and written, and the targets of the tip, `path.csv`.

Every mistake is named by its line and column.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.io.spreadsheet import millimetres_hint, number, read_table, whole_number
from tdcr_fe.model.loading import Actuation, Load, LoadStep, resolve
from tdcr_fe.model.messages import meant
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.targets import TipTarget

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


#: What is wrong with a cell: its column, and what is allowed there.
_Wrong = tuple[str, str]


class _Rows:
    """What both tables share: numbers of steps are different, times do not run backwards, mistakes have a line."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.problems: list[Problem] = []
        self.taken: dict[int, None] = {}  # in order; many steps are found in it fast
        self.last_time = 0.0

    def check_columns(self, columns: Iterable[str], known: Sequence[str], required: Sequence[str]) -> None:
        """Columns that are unknown or missing."""
        columns = [c for c in columns if c != "line"]
        for column in columns:
            if column not in known:
                text = f"unknown column{meant(column, known)}; allowed: {', '.join(known)}"
                self.problems.append(Problem(self.file, column, "", text))
        text = f"missing column; must have {', '.join(required)}"
        self.problems += [Problem(self.file, c, "", text) for c in required if c not in columns]
        for three in (FORCES, DIRECTION):
            if 0 < len(set(three) & set(columns)) < 3 and three[0] in known:
                text = "all three or none of these columns"
                self.problems.append(Problem(self.file, ", ".join(three), "", text))

    def step(self, cells: Mapping[Any, Any], time: float | None, wrong: list[_Wrong]) -> int:
        """Number of the step in a row, 0 where it has none; what is wrong with number and time goes to ``wrong``."""
        step = whole_number(cells["step"])
        if step is None:
            wrong.append(("step", "must be a whole number"))
        elif step in self.taken:
            text = "the step is there more than once; the order of the rows is the order of loading"
            wrong.append(("step", text))
        if time is not None and time < self.last_time:
            wrong.append(("time", f"must not be before the step before, at {self.last_time:g} s"))
        self.last_time = max(self.last_time, time or 0.0)
        self.taken[step or 0] = None
        return step or 0

    def report(self, line: Any, cells: Mapping[Any, Any], wrong: Iterable[_Wrong]) -> bool:
        """Take mistakes of a row; whether there are too many to read on."""
        self.problems += [
            Problem(self.file, f"line {line}, {column}", str(cells[column]) or "empty", allowed)
            for column, allowed in wrong
        ]
        return len(self.problems) > MOST_PROBLEMS


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
    tendons, rows = robot.tendon_names, _Rows(file)
    inputs = [f"{kind}_{name}" for kind in ("displacement", "tension") for name in tendons]
    rows.check_columns(table.columns, sorted({"step", "branch", "time", *FORCES, *inputs}), ["step"])
    both = "the tendon has a tension too; one of the two is allowed"
    rows.problems += [
        Problem(file, f"displacement_{name}", "", both)
        for name in tendons
        if {f"tension_{name}", f"displacement_{name}"} <= set(table.columns)
    ]
    if not rows.problems and table.empty:
        rows.problems.append(Problem(file, "", "", "has no steps"))
    if rows.problems:
        return Loading(), rows.problems
    steps, branches = [], []
    for cells in table.to_dict("records"):
        values, wrong = _values(cells, robot.backbone.length)
        step_id = rows.step(cells, values.get("time"), wrong)
        if rows.report(cells["line"], cells, wrong):
            break
        if not wrong:
            steps.append(_load_step(step_id, values, robot))
            branches.append(str(cells.get("branch", "")))
    return Loading(tuple(rows.taken), tuple(steps), tuple(branches)), rows.problems


def _values(cells: Mapping[Any, Any], length: float) -> tuple[dict[str, float], list[_Wrong]]:
    """Inputs, forces and time of a step, by column, NaN where a cell is no finite number; and what is wrong."""
    values: dict[str, float] = {}
    wrong = []
    for column, text in cells.items():
        if column in ("line", "step", "branch") or (column == "time" and text == ""):
            continue
        values[column] = value = number(text)
        if math.isnan(value):
            wrong.append((column, "must be a finite number; without it the history of loading is lost"))
        elif column.startswith("tension_") and value < 0.0:
            wrong.append((column, "a tension must be zero or more [N]"))
        elif column.startswith("displacement_") and abs(value) > length:
            hint = millimetres_hint(value, length)
            wrong.append((column, f"more than the robot's length of {length:g} m; must be in m{hint}"))
    return values, wrong


def _load_step(step_id: int, values: Mapping[str, float], robot: Robot) -> LoadStep:
    loads = {}
    if FORCES[0] in values:
        x, y, z = (values[c] for c in FORCES)
        loads["tip"] = Load(robot.backbone.length, (x, y, z))
    tensions, displacements = (
        {n: values[f"{kind}_{n}"] for n in robot.tendon_names if f"{kind}_{n}" in values}
        for kind in ("tension", "displacement")
    )
    return LoadStep(str(step_id), tensions, displacements, loads, time=values.get("time"))


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
    table, rows = read_table(path), _Rows(str(path))
    known = ("step", *POSITION, *DIRECTION, "label", "time")
    rows.check_columns(table.columns, known, ("step", *POSITION))
    if not rows.problems and table.empty:
        rows.problems.append(Problem(str(path), "", "", "has no targets"))
    if rows.problems:
        raise InputError(rows.problems)
    targets = []
    for line, cells in table.to_dict("index").items():
        target, wrong = _target(cells, length)
        rows.step(cells, None if target is None else target.time, wrong)
        if rows.report(line, cells, wrong):
            break
        if target is not None:
            targets.append(target)
    if rows.problems:
        raise InputError(rows.problems)
    return tuple(targets)


def _target(cells: Mapping[Any, str], length: float) -> tuple[TipTarget | None, list[_Wrong]]:
    """The target of a row, None where it is not sound; and what is wrong."""
    wrong = []
    values = {c: number(cells[c]) for c in (*POSITION, *DIRECTION, "time") if cells.get(c)}
    free = all(not cells.get(c) for c in DIRECTION)
    for column in (*POSITION, *(() if free else DIRECTION)):
        value = values.get(column, math.nan)
        if math.isnan(value):
            wrong.append((column, "must be a finite number"))
        elif column in POSITION and abs(value) > FARTHEST * length:
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
