"""Tables of commands: the loading sequence `loading.csv`, read and written, and the targets of the tip, `path.csv`.

Every mistake is named by its line and column.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.io.spreadsheet import millimetres_hint, number, read_table, whole_number
from tdcr_fe.model.loading import Actuation, Load, LoadStep, resolve
from tdcr_fe.model.messages import PlausibilityWarning, issue, meant
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.targets import TipTarget

FORCES, POSITION, DIRECTION = ("force_x", "force_y", "force_z"), ("x", "y", "z"), ("dx", "dy", "dz")
#: A table with more mistakes is not read on.
MOST_PROBLEMS = 1000
#: A target farther away than this many lengths of the robot is taken for one in another unit.
FARTHEST = 10.0


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


#: From the text of a cell to its value; raises a ValueError with what is allowed.
_Cell = Callable[[str], Any]


def _step(text: str) -> int:
    step = whole_number(text)
    if step is None:
        raise ValueError("must be a whole number")
    return step


def _number(
    least: float = -math.inf,
    most: float = math.inf,
    allowed: str = "",
    *,
    missing: str = "",
    empty: bool = False,
) -> _Cell:
    """Cells with a number within bounds; those that may be empty are None then.

    Parameters
    ----------
    least, most, allowed
        Bounds, and what is allowed where a number is outside.
    missing
        Said where there is no number.
    empty
        Whether a cell may be empty.
    """

    def read(text: str) -> float | None:
        value = number(text)
        if empty and not text:
            return None
        if math.isnan(value):
            raise ValueError(f"must be a finite number{missing}")
        if not least <= value <= most:
            raise ValueError(allowed + (millimetres_hint(value, most) if math.isfinite(most) else ""))
        return value

    return read


def _rows(
    table: pd.DataFrame,
    cells: Mapping[str, _Cell],
    required: Sequence[str],
    file: str,
    check: Callable[[dict[str, Any]], dict[str, str]] = lambda values: {},
) -> list[dict[str, Any]]:
    """Values of each row by column; numbers of steps differ, and times do not run backwards.

    Parameters
    ----------
    table
        Of texts; its index is the line in the file.
    cells
        How the cells of each column that may be there are read.
    required
        Columns that must be there.
    file
        For messages.
    check
        What is wrong with the values of a row, by column.

    Raises
    ------
    InputError
        With every mistake, or those of the first rows where there are more than `MOST_PROBLEMS`.
    """
    problems = [Problem(file, column, "", text) for column, text in _wrong_columns(table, cells, required)]
    if not problems and table.empty:
        problems = [Problem(file, "", "", "has no rows")]
    if problems:
        raise InputError(problems)
    rows: list[dict[str, Any]] = []
    steps, last = set(), 0.0
    for line, texts in table.to_dict("index").items():
        values, wrong = {}, {}
        for column, text in texts.items():
            try:
                values[str(column)] = cells[str(column)](text)
            except ValueError as error:
                wrong[str(column)] = str(error)
        if "step" in values and values["step"] in steps:
            wrong["step"] = "the step is there more than once; the order of the rows is the order of loading"
        time = values.get("time") or 0.0
        if time < last and "time" in values:
            wrong["time"] = f"must not be before the step before, at {last:g} s"
        wrong = wrong or check(values)
        problems += [
            Problem(file, f"line {line}, {column}", texts[column] or "empty", text)
            for column, text in wrong.items()
        ]
        if len(problems) > MOST_PROBLEMS:
            break
        rows.append(values)
        steps.add(values.get("step"))
        last = max(last, time)
    if problems:
        raise InputError(problems)
    numbers = [values["step"] for values in rows]
    if numbers != sorted(numbers):
        text = "numbers of steps do not ascend; the order of the rows is taken for the order in time"
        issue([f"{file}: {text}"], PlausibilityWarning)
    return rows


def _wrong_columns(
    table: pd.DataFrame, known: Mapping[str, Any], required: Sequence[str]
) -> Iterator[tuple[str, str]]:
    """Columns that are unknown, missing, or given twice, and what is allowed."""
    for column in table.columns:
        if column not in known:
            yield column, f"unknown column{meant(column, known)}; allowed: {', '.join(known)}"
        if (
            column.startswith("displacement_")
            and column.replace("displacement", "tension", 1) in table.columns
        ):
            yield column, "the tendon has a tension too; one of the two is allowed"
    for column in required:
        if column not in table.columns:
            yield column, f"missing column; must have {', '.join(required)}"
    for three in (FORCES, DIRECTION):
        if 0 < len(set(three) & set(table.columns)) < 3 and three[0] in known:
            yield ", ".join(three), "all three or none of these columns"


def read_loading(table: pd.DataFrame, robot: Robot, file: str) -> Loading:
    """The loading sequence.

    Parameters
    ----------
    table
        Of texts; its index is the line in the file.
    robot
        Whose tendons are named.
    file
        For messages.

    Raises
    ------
    InputError
        With every mistake in the file.
    """
    length, lost = robot.backbone.length, "; without it the history of loading is lost"
    too_long = f"more than the robot's length of {length:g} m; must be in m"
    force = _number(missing=lost)
    tension = _number(0.0, allowed="a tension must be zero or more [N]", missing=lost)
    displacement = _number(-length, length, too_long, missing=lost)
    cells: dict[str, _Cell] = {"step": _step, "branch": str, "time": _number(missing=lost, empty=True)}
    cells |= {**dict.fromkeys(FORCES, force), **{f"tension_{name}": tension for name in robot.tendon_names}}
    cells |= {f"displacement_{name}": displacement for name in robot.tendon_names}
    rows = _rows(table, cells, ["step"], file)
    return Loading(
        tuple(row["step"] for row in rows),
        tuple(_load_step(row, robot) for row in rows),
        tuple(row.get("branch", "") for row in rows),
    )


def _load_step(row: Mapping[str, Any], robot: Robot) -> LoadStep:
    force = tuple(row[c] for c in FORCES if c in row)
    loads = {"tip": Load(robot.backbone.length, force)} if force else {}
    tensions, displacements = (
        {n: row[f"{kind}_{n}"] for n in robot.tendon_names if f"{kind}_{n}" in row}
        for kind in ("tension", "displacement")
    )
    return LoadStep(str(row["step"]), tensions, displacements, loads, time=row.get("time"))


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
    return str(loading_table(robot, step_ids, steps, branches).to_csv(index=False))


def read_path(path: str | os.PathLike[str], length: float) -> tuple[TipTarget, ...]:
    """Read ``path.csv``.

    Parameters
    ----------
    path
        Columns ``step,x,y,z`` and, optionally, ``dx,dy,dz``, ``label`` and ``time``; an empty cell leaves a
        coordinate open.
    length
        Of the robot [m], by which positions in another unit are recognised.

    Raises
    ------
    InputError
        With every mistake in the file.
    """
    most = FARTHEST * length
    far = f"more than {FARTHEST:g} lengths of the robot away; must be in m"
    cells: dict[str, _Cell] = {
        "step": _step,
        **dict.fromkeys(POSITION, _number(-most, most, far, empty=True)),
    }
    cells |= {**dict.fromkeys(DIRECTION, _number(empty=True)), "label": str, "time": _number(empty=True)}
    rows = _rows(read_table(path), cells, ("step", *POSITION), str(path), _wrong_target)
    return tuple(
        TipTarget(
            (row["x"], row["y"], row["z"]),
            None if row.get("dx") is None else (row["dx"], row["dy"], row["dz"]),
            row.get("label") or f"step {row['step']}",
            row.get("time"),
        )
        for row in rows
    )


def _wrong_target(row: Mapping[str, Any]) -> dict[str, str]:
    """Nothing given, or a direction of which a part is missing or that is zero; all of it may be left out."""
    direction = {column: row[column] for column in DIRECTION if column in row}
    given = [x for x in direction.values() if x is not None]
    if not given and all(row.get(column) is None for column in POSITION):
        return {"x": "must be a finite number where y and z are open"}
    if given and len(given) < 3:
        return {column: "must be a finite number" for column, x in direction.items() if x is None}
    if given and not any(given):
        return {"dx": "the direction is zero; leave dx, dy and dz empty where it does not matter"}
    return {}
