"""Tables: as spreadsheets write them, with decimal commas, too; the loading sequence and the targets in them.

Every mistake is named by its line and column.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import pandas as pd

from tdcr_fe.elements.drives import DRIVES
from tdcr_fe.io.files import Reporter, StrPath, decoded, read_bytes, refusal
from tdcr_fe.model.loading import Actuation, Load, LoadStep, resolve
from tdcr_fe.model.messages import PlausibilityWarning, bare, issue, meant
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.schema import Keys, Quantity
from tdcr_fe.model.targets import TipTarget

_DECIMAL = {mark: re.compile(rf"(?=.*\d)[+-]?\d*\{mark}\d*([eE][+-]?\d+)?") for mark in ",."}


def read_table(path: StrPath) -> pd.DataFrame:
    """A table as texts; where semicolons or tabs separate the cells, decimal commas become points.

    Parameters
    ----------
    path
        Text file with a header, which decides what separates the cells.

    Returns
    -------
    pandas.DataFrame
        One row per row that is not empty and no comment (``# ...``), all cells as text without blanks at their ends;
        the index is the line of the row in the file.

    Raises
    ------
    InputError
        The file cannot be read, has a column twice, a row longer than its header, or both decimal commas and points.
    """
    path = Path(path)
    text = _text(path)
    header = next((line for line in text.splitlines() if line.strip() and not line.startswith("# ")), "")
    delimiter = next((mark for mark in ";\t" if mark in header), ",")
    rows, line = dict[int, list[str]](), 1
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            comment = bool(cells) and cells[0].startswith("# ") and (bool(rows) or not any(cells[1:]))
            if any(cells) and not comment:
                rows[line] = cells
            line = reader.line_num + 1
    except csv.Error as error:
        raise refusal(path, f"not a table: {error}", f"line {line}") from error
    if not rows:
        raise refusal(path, "is empty; must have a header")
    names = rows.pop(next(iter(rows)))
    while not names[-1]:
        names.pop()
    if twice := [c for c in names if names.count(c) > 1]:
        raise refusal(path, "the column appears more than once", twice[0])
    for line, cells in rows.items():
        if any(cells[len(names) :]):
            text = f"has {len(cells)} cells; the header has {len(names)}"
            if delimiter == ",":
                text += "; where these are decimal commas, separate the cells by semicolons or tabs"
            raise refusal(path, text, f"line {line}")
    equal = [(row + [""] * len(names))[: len(names)] for row in rows.values()]
    table = pd.DataFrame(equal, columns=names, index=pd.Index(rows, name="line"), dtype=object)
    return table if delimiter == "," else _with_points(path, table)


def number(text: str) -> float:
    """A finite number, or NaN."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def _text(path: Path) -> str:
    """The text of a file."""
    raw = read_bytes(path)
    if raw.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise refusal(path, "is an Excel workbook; save it as CSV")
    return decoded(raw, path, 'encoding: must be UTF-8; save as "CSV UTF-8"')


def _with_points(path: Path, table: pd.DataFrame) -> pd.DataFrame:
    """The table with decimal points in place of decimal commas; with these no number may have a point."""
    cells = {(line, name): x for name in table for line, x in table[name].items()}
    commas, points = ([k for k, x in cells.items() if mark.fullmatch(x)] for mark in _DECIMAL.values())
    if commas and points:
        (line, name), (other, column) = commas[0], points[0]
        text = f"decimal: line {other}, {column} has {cells[points[0]]}; use a point or a comma throughout"
        raise refusal(path, text, f"line {line}, {name}", cells[commas[0]])
    return table.map(lambda x: x.replace(",", ".") if _DECIMAL[","].fullmatch(x) else x)


# ----------------------------------------------------------------------------------------------- loading and targets

FORCES, POSITION, DIRECTION = ("force_x", "force_y", "force_z"), ("x", "y", "z"), ("dx", "dy", "dz")


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


_STEP, _TEXT = Annotated[int, Quantity(allowed="a whole number")], Annotated[str, Quantity()]
#: A number, or an empty cell.
_OPEN = Annotated[float | None, Quantity(allowed="a finite number, or empty")]


def _cell(text: str) -> float | str | None:
    """A number, another text, or nothing."""
    value = number(text)
    if math.isnan(value):
        return text or None
    return int(value) if value.is_integer() else value


def _rows(
    table: pd.DataFrame,
    columns: Keys,
    file: str,
    check: Callable[[Mapping[str, Any]], dict[str, str]] = lambda row: {},
) -> list[dict[str, Any]]:
    """Values of each row by column; numbers of steps differ, and times do not run backwards.

    Parameters
    ----------
    table
        Table of texts; its index is the line in the file.
    columns
        That may be there.
    file
        For messages.
    check
        What is wrong with the values of a row, by column.

    Raises
    ------
    InputError
        With every mistake.
    """
    reporter = Reporter(file)
    for column, text in _wrong_columns([str(c) for c in table.columns], columns):
        reporter(column, "", text)
    if not reporter.problems and table.empty:
        reporter("", "", "has no rows")
    reporter.refuse()
    names, rows, steps, last = {bare(c): c for c in columns}, [], set[Any](), 0.0
    for line, texts in table.to_dict("index").items():
        found = Reporter(file)
        given = {str(c): text if columns[str(c)] is _TEXT else _cell(text) for c, text in texts.items()}
        row, _ = columns.read(given, "", found)
        wrong = {names[p.key]: p.allowed for p in found.problems}
        step, time = row.get("step"), row.get("time")
        if step in steps:
            wrong["step"] = "the step appears more than once; the order of the rows is the order of loading"
        if time is not None and time < last:
            wrong["time"] = f"must not be earlier than in the row before, {last:g} s"
        for column, said in (wrong or check(row)).items():
            reporter(f"line {line}, {column}", texts[column] or "empty", said)
        rows.append(row)
        steps.add(step)
        last = max(last, time or 0.0)
    reporter.refuse()
    numbers = [row["step"] for row in rows]
    if numbers != sorted(numbers):
        text = "numbers of steps do not ascend; the order of the rows is taken for the order in time"
        issue([f"{file}: {text}"], PlausibilityWarning)
    return rows


def _wrong_columns(there: Sequence[str], known: Keys) -> Iterator[tuple[str, str]]:
    """Columns that are unknown, missing, or given twice, and what is allowed."""
    required = [column for column in known if column not in known.defaults]
    for column in there:
        if column not in known:
            yield column, f"unknown column{meant(column, known)}; allowed: {', '.join(known)}"
        for other, drive in combinations(DRIVES, 2):
            tendon = column.removeprefix(f"{drive.name}_")
            if tendon != column and f"{other.name}_{tendon}" in there:
                yield column, f"the tendon has a {other.label} too; one of the two is allowed"
    for column in required:
        if column not in there:
            yield column, f"missing column; must have {', '.join(required)}"
    for three in (FORCES, DIRECTION):
        if 0 < len(set(three) & set(there)) < 3 and three[0] in known:
            yield ", ".join(three), "all three or none of these columns"


def read_loading(table: pd.DataFrame, robot: Robot, file: str) -> Loading:
    """The loading sequence.

    Parameters
    ----------
    table
        Table of texts; its index is the line in the file.
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
    force = Quantity(allowed=f"a finite number [N]{lost}")
    further = {"branch": _TEXT, "time": _OPEN, **dict.fromkeys(FORCES, Annotated[float, force])}
    for drive in DRIVES:
        for tendon in [t for t in robot.tendons if not drive.obstacle(t)]:
            most = length / drive.scale(tendon)
            unit = "m, not mm" if drive.unit == "m" else drive.unit
            text = f"within the robot's length: at most {most:.4g} {unit}{lost}"
            pulls = Quantity(ge=0.0, allowed=f"a {drive.label} [{drive.unit}], zero or more{lost}")
            own = Quantity(ge=-most, le=most, allowed=text) if drive.winds else pulls
            further[f"{drive.name}_{tendon.name}"] = Annotated[float, own]
    rows = _rows(table, Keys({"step": _STEP, **further}, {**dict.fromkeys(further), "branch": ""}), file)
    steps = tuple(_load_step(row, robot) for row in rows)
    return Loading(tuple(row["step"] for row in rows), steps, tuple(row["branch"] for row in rows))


def _load_step(row: Mapping[str, Any], robot: Robot) -> LoadStep:
    given = {column: x for column, x in row.items() if x is not None}
    force = tuple(given[c] for c in FORCES if c in given)
    loads = {"tip": Load(robot.backbone.length, force)} if force else {}
    inputs: dict[str, Any] = {
        d.inputs: {n: given[f"{d.name}_{n}"] for n in robot.tendon_names if f"{d.name}_{n}" in given}
        for d in DRIVES
    }
    return LoadStep(str(row["step"]), loads=loads, time=row["time"], **inputs)


def loading_table(
    robot: Robot, step_ids: Sequence[int], steps: Sequence[LoadStep], branches: Sequence[str]
) -> pd.DataFrame:
    """A loading sequence as ``loading.csv`` has it.

    Parameters
    ----------
    robot
        That is loaded.
    step_ids, steps, branches
        Number, contents and branch of every step; there is no column of branches where all are empty texts.

    Raises
    ------
    ValueError
        The file has no columns for some of it; the message names what.
    """
    states = resolve(robot, steps)
    if foreign := without_columns(robot, states):
        raise ValueError(f"loading.csv cannot express {'; '.join(foreign)}")
    table = pd.DataFrame({"step": step_ids})
    if any(branches):
        table["branch"] = branches
    if any(step.time is not None for step in steps):
        table["time"] = [step.time for step in steps]
    named = {name for step in steps for _, given in step.inputs() for name in given}
    for i, name in enumerate(robot.tendon_names):
        if name in named:
            column = f"{states[-1].drives.kinds[i].name}_{name}"
            table[column] = [float(state.values[i] / state.drives.scale[i]) for state in states]
    if any(step.loads for step in steps):
        for k, column in enumerate(FORCES):
            table[column] = [sum((x.force[k] for x in state.loads.values()), 0.0) for state in states]
    return table


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
        f"tendon {name}: driven by {' and by '.join(kinds)}"
        for i, name in enumerate(robot.tendon_names)
        if len(kinds := [d.label for d in DRIVES if any(state.drives.kinds[i] is d for state in states)]) > 1
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
    """A loading sequence as the text of a ``loading.csv``, see `loading_table`; numerics write no tables."""
    return str(loading_table(robot, step_ids, steps, branches).to_csv(index=False))


def read_path(path: StrPath) -> tuple[TipTarget, ...]:
    """Read ``path.csv``.

    Parameters
    ----------
    path
        Columns ``step,x,y,z`` and, optionally, ``dx,dy,dz``, ``label`` and ``time``; an empty cell leaves a
        coordinate open.

    Raises
    ------
    InputError
        With every mistake in the file.
    """
    numbers, further = dict.fromkeys((*POSITION, *DIRECTION, "time"), _OPEN), (*DIRECTION, "time")
    columns = Keys({"step": _STEP, **numbers, "label": _TEXT}, {**dict.fromkeys(further), "label": ""})
    targets = []
    for row in _rows(read_table(path), columns, str(path), _wrong_target):
        position = row["x"], row["y"], row["z"]
        direction = None if row["dx"] is None else (row["dx"], row["dy"], row["dz"])
        targets.append(TipTarget(position, direction, row["label"] or f"step {row['step']}", row["time"]))
    return tuple(targets)


def _wrong_target(row: Mapping[str, Any]) -> dict[str, str]:
    """Nothing given, or a direction of which a part is missing or that is zero; all of it may be left out."""
    direction = {column: row[column] for column in DIRECTION}
    given = [x for x in direction.values() if x is not None]
    if not given and all(row[column] is None for column in POSITION):
        return {"x": "must be a finite number where y and z are open"}
    if given and len(given) < 3:
        return {column: "must be a finite number" for column, x in direction.items() if x is None}
    if given and not any(given):
        return {"dx": "the direction is zero; leave dx, dy and dz empty where it does not matter"}
    return {}
