"""Measured data: read a folder of robot, loading sequence and readings, check every row, and write such a folder."""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from tdcr_fe.io.atomic import write_text
from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.io.spreadsheet import read_table
from tdcr_fe.io.toml import digest, read_model_file, read_robot
from tdcr_fe.io.write_toml import model_to_toml, robot_to_toml
from tdcr_fe.model.channels import QUANTITIES, Channel, channel
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import ARC_TOLERANCE, Robot
from tdcr_fe.model.settings import SolverSettings

OBSERVATION_COLUMNS = ("step", "quantity", "location", "value", "sigma")

#: Largest fraction of rows that may be left out before the data set is refused [1].
MOST_LEFT_OUT = 0.5

#: Largest fraction of values that look like another unit before the data set is refused [1].
MANY_IN_ANOTHER_UNIT = 0.1


@dataclass(frozen=True)
class Reading:
    """One measured number.

    Attributes
    ----------
    step : int
        Of the loading sequence, as the file numbers it.
    quantity : str
        Of a channel in `tdcr_fe.model.channels.CHANNELS`.
    location : float, str or None
        Arc length [m], tendon name, or None where the quantity has no location.
    value : float
        In the unit of the quantity.
    sigma : float or None
        Standard uncertainty, in the unit of the value; None where it is not known.
    line : int
        Line of ``observations.csv``; 0 where the reading comes from elsewhere.
    """

    step: int
    quantity: str
    location: float | str | None
    value: float
    sigma: float | None = None
    line: int = 0

    @property
    def channel(self) -> Channel:
        """Unit, display and prediction of the quantity."""
        return channel(self.quantity)

    @property
    def unit(self) -> str:
        """Of value and sigma."""
        return self.channel.unit


@dataclass(frozen=True)
class BadRow:
    """A reading that was left out.

    Attributes
    ----------
    file : str
    line : int
        In that file, its header being line 1.
    column, value : str
        Column with the mistake, and the text found there.
    allowed : str
        What is allowed there.
    unit : str
        The unit in which the value would be plausible, where it is not in the right one: "mm", "degrees".
    """

    file: str
    line: int
    column: str
    value: str
    allowed: str
    unit: str = ""

    def __str__(self) -> str:
        """One line."""
        shown = self.value if self.value else "empty"
        return f"{self.file}, line {self.line}: {self.column} = {shown}: {self.allowed}"


@dataclass(frozen=True)
class MeasuredData:
    """A declared robot, its loading sequence, and the readings.

    Attributes
    ----------
    name : str
    robot : Robot
    model : Model
    step_ids : tuple of int
        Number of every load step, in order.
    steps : tuple of LoadStep
        The loading sequence.
    branches : tuple of str
        The ``branch`` of every step; empty texts where the file has none.
    readings : tuple of Reading
        Sound readings.
    left_out : tuple of BadRow
        Readings that are not sound.
    digests : mapping of str to str
        SHA-256 of the files, by name.
    settings : SolverSettings
        The ``[solver]`` table of ``model.toml``.
    """

    name: str
    robot: Robot
    model: Model
    step_ids: tuple[int, ...]
    steps: tuple[LoadStep, ...]
    branches: tuple[str, ...]
    readings: tuple[Reading, ...]
    left_out: tuple[BadRow, ...] = ()
    digests: Mapping[str, str] | None = None
    settings: SolverSettings = field(default_factory=SolverSettings)

    def __post_init__(self) -> None:
        if not len(self.step_ids) == len(self.steps) == len(self.branches):
            raise ValueError("step_ids, steps and branches must have one entry a step")
        unknown = sorted({r.step for r in self.readings} - set(self.step_ids))
        if unknown:
            raise ValueError(f"a reading names step {unknown[0]}, which the loading sequence has not")

    @property
    def driven_by_displacement(self) -> bool:
        """Whether any tendon is driven by displacement."""
        return any(s.displacements for s in self.steps)

    @property
    def has_time(self) -> bool:
        """Whether the steps carry times."""
        return any(s.time is not None for s in self.steps)


# ------------------------------------------------------------------------------------------------- reading


def read_measured(folder: str | os.PathLike[str], strict: bool = False) -> MeasuredData:
    """Read a folder of measured data.

    Parameters
    ----------
    folder
        Contains ``robot.toml``, ``loading.csv``, ``observations.csv`` and, optionally, ``model.toml``.
    strict
        Refuse readings that are not sound, instead of leaving them out by name.

    Returns
    -------
    MeasuredData
        With every reading that was left out in ``left_out``.

    Raises
    ------
    InputError
        A file or column is missing, a load step is not sound (its history would be lost), no reading is sound, or
        so many had to be left out that the rest cannot be trusted.
    """
    folder = Path(folder)
    problems: list[Problem] = []
    if not folder.is_dir():
        raise InputError(
            [
                Problem(
                    str(folder), "", "", "no such folder; must hold robot.toml, loading.csv, observations.csv"
                )
            ]
        )
    robot, model, settings = None, Model(), SolverSettings()
    try:
        robot = read_robot(folder / "robot.toml")
    except InputError as error:
        problems += error.problems
    if (folder / "model.toml").exists():
        try:
            model, settings = read_model_file(folder / "model.toml")
        except InputError as error:
            problems += error.problems
    loading = _table(folder / "loading.csv", problems)
    observed = _table(folder / "observations.csv", problems)
    if robot is None or loading is None or observed is None:
        raise InputError(problems)
    file = str(folder / "loading.csv")
    step_ids, steps, branches = _loading(loading, robot, file, problems)
    file = str(folder / "observations.csv")
    missing = [c for c in OBSERVATION_COLUMNS if c not in observed.columns]
    problems += [
        Problem(file, c, "", f"missing column; must have {', '.join(OBSERVATION_COLUMNS)}") for c in missing
    ]
    if problems:
        raise InputError(problems)
    readings, bad = _observations(observed, robot, set(step_ids), file)
    if bad and strict:
        raise InputError(
            [Problem(b.file, f"line {b.line}, {b.column}", b.value or "empty", b.allowed) for b in bad]
        )
    _refuse_if_doubtful(bad, len(readings) + len(bad), robot, file)
    if not readings:
        raise InputError([Problem(file, "", "", "has no readings")])
    names = [
        n for n in ("robot.toml", "model.toml", "loading.csv", "observations.csv") if (folder / n).exists()
    ]
    return MeasuredData(
        folder.resolve().name,
        robot,
        model,
        tuple(step_ids),
        tuple(steps),
        tuple(branches),
        tuple(readings),
        tuple(bad),
        {n: digest(folder / n) for n in names},
        settings,
    )


def _table(path: Path, problems: list[Problem]) -> pd.DataFrame | None:
    """A table as texts, with the column ``line``; None where it cannot be read."""
    try:
        table = read_table(path)
    except InputError as error:
        problems += error.problems
        return None
    table.insert(0, "line", table.index)
    return table


def _number(text: str) -> float:
    """A finite number, or NaN."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def _whole(text: str) -> int | None:
    value = _number(text)
    return int(value) if math.isfinite(value) and value == int(value) else None


def _loading(
    table: pd.DataFrame, robot: Robot, file: str, problems: list[Problem]
) -> tuple[list[int], list[LoadStep], list[str]]:
    before = len(problems)
    tendons = robot.tendon_names
    known = {"line", "step", "branch", "time", "force_x", "force_y", "force_z"}
    known |= {f"{kind}_{name}" for kind in ("tension", "displacement") for name in tendons}
    if "step" not in table.columns:
        problems.append(Problem(file, "step", "", "missing column"))
    for column in table.columns:
        if column not in known:
            near = difflib.get_close_matches(column, known - {"line"}, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            allowed = ", ".join(sorted(known - {"line"}))
            problems.append(Problem(file, column, "", f"unknown column{hint}; allowed: {allowed}"))
    for name in tendons:
        if {f"tension_{name}", f"displacement_{name}"} <= set(table.columns):
            problems.append(
                Problem(
                    file,
                    f"displacement_{name}",
                    "",
                    "the tendon has a tension too; one of the two is allowed",
                )
            )
    forces = [c for c in ("force_x", "force_y", "force_z") if c in table.columns]
    if 0 < len(forces) < 3:
        problems.append(Problem(file, "force_x, force_y, force_z", "", "all three or none of these columns"))
    if len(problems) > before:
        return [], [], []
    if table.empty:
        problems.append(Problem(file, "", "", "has no steps"))
    ids: list[int] = []
    steps, branches = [], []
    length = robot.backbone.length
    last = 0.0
    for row in table.to_dict("records"):
        line = row["line"]
        noted = len(problems)

        def refuse(column: str, allowed: str, row: Mapping[Any, Any] = row, line: int = line) -> None:
            problems.append(Problem(file, f"line {line}, {column}", str(row[column]) or "empty", allowed))

        number = _whole(row["step"])
        if number is None:
            refuse("step", "must be a whole number")
            number = 0
        elif number in ids:
            refuse("step", "the step is there more than once; the order of the rows is the order of loading")
        values: dict[str, float] = {}
        for column in table.columns:
            if column in ("line", "step", "branch") or (column == "time" and row[column] == ""):
                continue
            values[column] = value = _number(row[column])
            if math.isnan(value):
                refuse(column, "must be a finite number; without it the history of loading is lost")
            elif column.startswith("tension_") and value < 0.0:
                refuse(column, "a tension must be zero or more [N]")
            elif column.startswith("displacement_") and abs(value) > length:
                refuse(
                    column,
                    f"more than the robot's length of {length:g} m; must be in m"
                    + _millimetres(value, length),
                )
        if "time" in values:
            if values["time"] < last:
                refuse("time", f"must not be before the step before, at {last:g} s")
            last = max(last, values["time"])
        ids.append(number)
        if len(problems) > noted:
            continue
        loads = {}
        if forces:
            force = tuple(values[c] for c in forces)
            loads["tip"] = Load(length, (force[0], force[1], force[2]))
        branches.append(str(row.get("branch", "")))
        steps.append(
            LoadStep(
                label=str(number),
                tensions={n: values[f"tension_{n}"] for n in tendons if f"tension_{n}" in values},
                displacements={
                    n: values[f"displacement_{n}"] for n in tendons if f"displacement_{n}" in values
                },
                loads=loads,
                time=values.get("time"),
            )
        )
    return ids, steps, branches


def _millimetres(value: float, limit: float) -> str:
    return f"; {value / 1000.0:g} would fit, are these mm?" if abs(value) / 1000.0 <= limit else ""


def _observations(
    table: pd.DataFrame, robot: Robot, steps: set[int], file: str
) -> tuple[list[Reading], list[BadRow]]:
    readings: list[Reading] = []
    bad: list[BadRow] = []
    seen: dict[tuple[int, str, float | str | None], int] = {}
    name = Path(file).name
    for row in table.to_dict("records"):
        line = int(row["line"])
        fault, reading = _reading(row, robot, steps, line)
        if fault is None and reading is not None:
            at = reading.location
            key = (reading.step, reading.quantity, round(at, 7) if isinstance(at, float) else at)
            if key in seen:
                fault = _Fault(
                    "step",
                    f"the same quantity at the same location and step stands in line {seen[key]}; that one is kept",
                )
            else:
                seen[key] = line
                readings.append(reading)
        if fault is not None:
            bad.append(BadRow(name, line, fault.column, str(row[fault.column]), fault.allowed, fault.unit))
    return readings, bad


@dataclass(frozen=True)
class _Fault:
    """What is wrong with a row: the column, what is allowed there, and the unit that was probably meant."""

    column: str
    allowed: str
    unit: str = ""


def _reading(
    row: Mapping[Any, Any], robot: Robot, steps: set[int], line: int
) -> tuple[_Fault | None, Reading | None]:
    """A reading, or the column and what is allowed there."""
    step = _whole(row["step"])
    if step is None or step not in steps:
        return _Fault("step", "must be a step of loading.csv"), None
    quantity = row["quantity"]
    if quantity not in QUANTITIES:
        near = difflib.get_close_matches(quantity, QUANTITIES, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        return _Fault("quantity", f"must be one of {', '.join(QUANTITIES)}{hint}"), None
    known = channel(quantity)
    fault, location = _location(known, row["location"], robot)
    value = _number(row["value"])
    fault = fault or _value_fault(known, value, robot.backbone.length)
    sigma: float | None = None
    if fault is None and row["sigma"] != "":
        sigma = _number(row["sigma"])
        fault = _sigma_fault(known, sigma, robot.backbone.length)
    if fault is not None:
        return fault, None
    return None, Reading(step, quantity, location, value, sigma, line)


def _location(known: Channel, text: str, robot: Robot) -> tuple[_Fault | None, float | str | None]:
    """The location of a reading, or what is wrong with it."""
    length = robot.backbone.length
    if known.location == "arc length":
        s = _number(text)
        if not 0.0 <= s <= length + 10 * ARC_TOLERANCE:
            hint = _millimetres(s, length) if math.isfinite(s) else ""
            fault = _Fault(
                "location", f"must be an arc length from 0 to {length:g} m{hint}", "mm" if hint else ""
            )
            return fault, None
        return None, min(s, length)
    if known.location == "tendon":
        if text not in robot.tendon_names:
            return _Fault("location", f"must be a tendon: {', '.join(robot.tendon_names)}"), None
        return None, text
    if text != "":
        return _Fault("location", f"must be empty for {known.quantity}"), None
    return None, None


def _value_fault(known: Channel, value: float, length: float) -> _Fault | None:
    """What is wrong with a value."""
    if math.isnan(value):
        return _Fault("value", f"must be a finite number [{known.unit}]")
    low, high = known.limits(length)
    if low <= value <= high:
        return None
    converted = value * known.mistaken_factor
    beyond = abs(value) > max(abs(low), abs(high))
    unit = known.mistaken_unit if beyond and low <= converted <= high else ""
    hint = f"; {converted:.4g} would fit, are these {unit}?" if unit else ""
    return _Fault(
        "value",
        f"{known.quantity} of a robot of {length:g} m lies between {low:.4g} and {high:.4g} {known.unit}{hint}",
        unit,
    )


def _sigma_fault(known: Channel, sigma: float, length: float) -> _Fault | None:
    """What is wrong with a standard uncertainty."""
    if not sigma > 0.0:
        return _Fault("sigma", f"must be positive and finite [{known.unit}], or empty where it is not known")
    if sigma <= known.largest_sigma(length):
        return None
    hint = f", is this {known.mistaken_unit}?" if known.mistaken_unit else ""
    return _Fault(
        "sigma", f"larger than the robot allows; must be in {known.unit}{hint}", known.mistaken_unit
    )


def _refuse_if_doubtful(bad: Sequence[BadRow], total: int, robot: Robot, file: str) -> None:
    """Refuse the data set if too many rows were left out.

    Raises
    ------
    InputError
        Names the number of rows, the reasons, and the unit that was probably meant.
    """
    in_unit = [b for b in bad if b.unit and b.column == "value"]
    several_units = len(in_unit) > MANY_IN_ANOTHER_UNIT * total and len(in_unit) > 2
    if len(bad) <= MOST_LEFT_OUT * total and not several_units:
        return
    problems = []
    for unit in dict.fromkeys(b.unit for b in in_unit):
        largest = max((abs(float(b.value)) for b in in_unit if b.unit == unit), default=0.0)
        count = sum(b.unit == unit for b in in_unit)
        problems.append(
            Problem(
                file,
                "value",
                f"{count} of {total} rows",
                f"values up to {largest:g} for a robot of {robot.backbone.length:g} m: are they in {unit}? "
                "All numbers must be in SI units (m, rad, N)",
            )
        )
    reasons: dict[tuple[str, str], list[BadRow]] = {}
    for b in bad:
        if b not in in_unit:
            reasons.setdefault((b.column, b.allowed), []).append(b)
    for (column, allowed), rows in sorted(reasons.items(), key=lambda x: -len(x[1]))[:5]:
        first = rows[0]
        what = f"{len(rows)} of {total} rows, the first in line {first.line}"
        problems.append(Problem(file, column, what, f"{first.value or 'empty'}: {allowed}"))
    left = f"{total - len(bad)} of {total} rows would be left, too few to trust"
    raise InputError([*problems, Problem(file, "", "", left)])


# ------------------------------------------------------------------------------------------------- writing


def loading_table(data: MeasuredData) -> pd.DataFrame:
    """The loading sequence as ``loading.csv`` has it."""
    rows = []
    any_load = any(s.loads for s in data.steps)
    any_branch = any(data.branches)
    for number, branch, step in zip(data.step_ids, data.branches, data.steps, strict=True):
        row: dict[str, object] = {"step": number}
        if any_branch:
            row["branch"] = branch
        if step.time is not None:
            row["time"] = step.time
        row |= {f"tension_{n}": v for n, v in step.tensions.items()}
        row |= {f"displacement_{n}": v for n, v in step.displacements.items()}
        if any_load:
            force = step.loads["tip"].force if "tip" in step.loads else (0.0, 0.0, 0.0)
            row |= dict(zip(("force_x", "force_y", "force_z"), force, strict=True))
        rows.append(row)
    return pd.DataFrame(rows)


def observations_table(readings: Iterable[Reading]) -> pd.DataFrame:
    """Readings as ``observations.csv`` has them."""
    rows = [
        (
            r.step,
            r.quantity,
            "" if r.location is None else r.location,
            r.value,
            "" if r.sigma is None else r.sigma,
        )
        for r in readings
    ]
    return pd.DataFrame(rows, columns=list(OBSERVATION_COLUMNS))


def write_measured(data: MeasuredData, folder: str | os.PathLike[str]) -> None:
    """Write data as a folder that `read_measured` reads."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    settings = None if data.settings == SolverSettings() else data.settings
    write_text(robot_to_toml(data.robot), folder / "robot.toml")
    write_text(model_to_toml(data.model, settings), folder / "model.toml")
    loading_table(data).to_csv(folder / "loading.csv", index=False)
    observations_table(data.readings).to_csv(folder / "observations.csv", index=False)
