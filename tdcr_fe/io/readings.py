"""Readings: the rows of ``observations.csv``, each checked against the robot."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from tdcr_fe.io.files import InputError, Problem, refusal
from tdcr_fe.io.tables import number, read_table
from tdcr_fe.model.channels import QUANTITIES, Channel, channel
from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.messages import meant
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.units import mistaken

OBSERVATION_COLUMNS = ("step", "quantity", "location", "value", "sigma")

#: Largest fraction of rows that may be left out before the data set is refused [1].
MOST_LEFT_OUT = 0.5

#: Largest fraction of values of a quantity that look like another unit before the data set is refused [1].
MANY_IN_ANOTHER_UNIT = 0.1


@dataclass(frozen=True)
class Reading:
    """One measured number.

    Attributes
    ----------
    step : int
        Step of the loading sequence, as the file numbers it.
    quantity : str
        Quantity of a channel in `tdcr_fe.model.channels.CHANNELS`.
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
        """Unit and prediction of the quantity."""
        return channel(self.quantity)

    @property
    def unit(self) -> str:
        """Unit of value and sigma."""
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
    quantity : str
        Quantity of the reading, as the file has it.
    """

    file: str
    line: int
    column: str
    value: str
    allowed: str
    unit: str = ""
    quantity: str = ""

    def __str__(self) -> str:
        """One line."""
        shown = self.value if self.value else "empty"
        return f"{self.file}, line {self.line}: {self.column} = {shown}: {self.allowed}"


def read_rows(path: Path) -> pd.DataFrame:
    """The table ``observations.csv`` as texts, refused where a column is missing."""
    table = read_table(path)
    allowed = f"missing column; must have {', '.join(OBSERVATION_COLUMNS)}"
    missing = [Problem(str(path), c, "", allowed) for c in OBSERVATION_COLUMNS if c not in table.columns]
    if missing:
        raise InputError(missing)
    return table


def read_observations(
    table: pd.DataFrame, robot: Robot, steps: set[int], file: str
) -> tuple[list[Reading], list[BadRow]]:
    """Readings of ``observations.csv``.

    Parameters
    ----------
    table
        See `read_rows`.
    robot
        Its tendons and length bound the readings.
    steps
        Numbers of the load steps.
    file
        For messages.

    Returns
    -------
    readings : list of Reading
        Sound rows.
    bad : list of BadRow
        The others.

    Raises
    ------
    InputError
        No row is sound, or so many are not that the rest cannot be trusted.
    """
    readings: list[Reading] = []
    bad: list[BadRow] = []
    name = Path(file).name
    seen: dict[tuple[int, str, float | str | None], Any] = {}
    for line, row in zip(table.index.tolist(), table.to_dict("records"), strict=True):
        try:
            reading = _reading(row, robot, steps, line)
            at = reading.location
            key = (reading.step, reading.quantity, round(at, 7) if isinstance(at, float) else at)
            if key in seen:
                text = f"the same quantity at the same location and step is in line {seen[key]}"
                raise _Fault("step", f"{text}; that one is kept")
        except _Fault as fault:
            found, quantity = str(row[fault.column]), str(row["quantity"])
            bad.append(BadRow(name, line, fault.column, found, fault.allowed, fault.unit, quantity))
        else:
            seen[key] = line
            readings.append(reading)
    _refuse_if_doubtful(bad, readings, file)
    if not readings:
        raise refusal(file, "has no readings")
    return readings, bad


class _Fault(Exception):
    """What is wrong with a row: the column, what is allowed there, and the unit that was probably meant."""

    def __init__(self, column: str, allowed: str, unit: str = "") -> None:
        self.column, self.allowed, self.unit = column, allowed, unit


def _reading(row: Mapping[Any, str], robot: Robot, steps: set[int], line: int) -> Reading:
    """The reading in a row; raises a `_Fault`."""
    step, quantity = number(row["step"]), row["quantity"]
    if step not in steps:
        raise _Fault("step", "must be a step of loading.csv")
    if quantity not in QUANTITIES:
        raise _Fault("quantity", f"must be one of {', '.join(QUANTITIES)}{meant(quantity, QUANTITIES)}")
    known, length = channel(quantity), robot.backbone.length
    location = _location(known, row["location"], robot)
    value = _value(known, row["value"], length)
    sigma = None if row["sigma"] == "" else _sigma(known, row["sigma"], length)
    return Reading(int(step), quantity, location, value, sigma, line)


def _location(known: Channel, text: str, robot: Robot) -> float | str | None:
    length = robot.backbone.length
    if known.location == "arc length":
        s = number(text)
        if not 0.0 <= s <= length + 10 * ARC_TOLERANCE:
            unit = "mm" if 0.0 <= s / 1000.0 <= length else ""
            hint = f"; {s / 1000.0:g} would fit, are these mm?" if unit else ""
            raise _Fault("location", f"must be an arc length from 0 to {length:g} m{hint}", unit)
        return min(s, length)
    if known.location == "tendon" and text not in robot.tendon_names:
        raise _Fault("location", f"must be a tendon: {', '.join(robot.tendon_names)}")
    if not known.location and text != "":
        raise _Fault("location", f"must be empty for {known.quantity}")
    return text or None


def _value(known: Channel, text: str, length: float) -> float:
    value = number(text)
    if math.isnan(value):
        raise _Fault("value", f"must be a finite number [{known.unit}]")
    low, high, *_ = known.plausible(length)
    if low <= value <= high:
        return value
    beyond = abs(value) > max(abs(low), abs(high))
    fits = {u: value * x for u, x in mistaken(known.unit).items() if beyond and low <= value * x <= high}
    unit, converted = next(iter(fits.items()), ("", value))
    hint = f"; {converted:.4g} would fit, are these {unit}?" if unit else ""
    between = f"lies between {low:.4g} and {high:.4g} {known.unit}"
    raise _Fault("value", f"{known.quantity} of a robot of {length:g} m {between}{hint}", unit)


def _sigma(known: Channel, text: str, length: float) -> float:
    sigma = number(text)
    if not sigma > 0.0:
        raise _Fault("sigma", f"must be positive and finite [{known.unit}], or empty where it is not known")
    if sigma > known.plausible(length).sigma:
        unit = next(iter(mistaken(known.unit)), "")
        hint = f", is this {unit}?" if unit else ""
        raise _Fault("sigma", f"larger than the robot allows; must be in {known.unit}{hint}", unit)
    return sigma


def _refuse_if_doubtful(bad: Sequence[BadRow], sound: Sequence[Reading], file: str) -> None:
    """Refuse the data set if too many rows were left out, or many of one quantity look like another unit.

    Raises
    ------
    InputError
        Names the number of rows, the reasons, and the unit that was probably meant.
    """
    total = len(sound) + len(bad)
    counts = Counter([b.quantity for b in bad] + [r.quantity for r in sound])
    doubtful = Counter(b.quantity for b in bad if b.column == "value" and b.unit)
    several_units = any(n > MANY_IN_ANOTHER_UNIT * counts[q] and n > 2 for q, n in doubtful.items())
    if len(bad) <= MOST_LEFT_OUT * total and not several_units:
        return
    groups: dict[tuple[str, str], list[BadRow]] = {}
    for b in bad:
        groups.setdefault((b.column, b.unit or b.allowed), []).append(b)
    problems = []
    for (column, _), rows in sorted(groups.items(), key=lambda x: -len(x[1]))[:5]:
        found = f"{len(rows)} of {total} rows, the first in line {rows[0].line}"
        problems.append(Problem(file, column, found, f"{rows[0].value or 'empty'}: {rows[0].allowed}"))
    left = f"{total - len(bad)} of {total} rows would be left, too few to trust"
    raise InputError([*problems, Problem(file, "", "", left)])


def observations_table(readings: Iterable[Reading]) -> pd.DataFrame:
    """Readings as ``observations.csv`` has them."""
    return pd.DataFrame([vars(r) for r in readings], columns=list(OBSERVATION_COLUMNS))
