"""Readings: the rows of ``observations.csv``, each checked against the robot."""

from __future__ import annotations

import difflib
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.io.spreadsheet import millimetres_hint, number, whole_number
from tdcr_fe.model.channels import QUANTITIES, Channel, channel
from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.robot import Robot

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
    quantity : str
        Of the reading, as the file has it.
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


def read_observations(
    table: pd.DataFrame, robot: Robot, steps: set[int], file: str
) -> tuple[list[Reading], list[BadRow]]:
    """Readings of ``observations.csv``.

    Parameters
    ----------
    table
        Of texts, with the columns `OBSERVATION_COLUMNS` and ``line``.
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
    """
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
            found = str(row[fault.column])
            bad.append(
                BadRow(name, line, fault.column, found, fault.allowed, fault.unit, str(row["quantity"]))
            )
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
    step = whole_number(row["step"])
    if step is None or step not in steps:
        return _Fault("step", "must be a step of loading.csv"), None
    quantity = row["quantity"]
    if quantity not in QUANTITIES:
        near = difflib.get_close_matches(quantity, QUANTITIES, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        return _Fault("quantity", f"must be one of {', '.join(QUANTITIES)}{hint}"), None
    known = channel(quantity)
    fault, location = _location(known, row["location"], robot)
    value = number(row["value"])
    fault = fault or _value_fault(known, value, robot.backbone.length)
    sigma: float | None = None
    if fault is None and row["sigma"] != "":
        sigma = number(row["sigma"])
        fault = _sigma_fault(known, sigma, robot.backbone.length)
    if fault is not None:
        return fault, None
    return None, Reading(step, quantity, location, value, sigma, line)


def _location(known: Channel, text: str, robot: Robot) -> tuple[_Fault | None, float | str | None]:
    """The location of a reading, or what is wrong with it."""
    length = robot.backbone.length
    if known.location == "arc length":
        s = number(text)
        if not 0.0 <= s <= length + 10 * ARC_TOLERANCE:
            hint = millimetres_hint(s, length) if math.isfinite(s) else ""
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


def refuse_if_doubtful(bad: Sequence[BadRow], sound: Sequence[Reading], robot: Robot, file: str) -> None:
    """Refuse the data set if too many rows were left out, or many of one quantity look like another unit.

    Raises
    ------
    InputError
        Names the number of rows, the reasons, and the unit that was probably meant.
    """
    in_unit = [b for b in bad if b.unit and b.column == "value"]
    total = len(sound) + len(bad)
    counts = Counter([b.quantity for b in bad] + [r.quantity for r in sound])
    doubtful = Counter(b.quantity for b in in_unit)
    several_units = any(n > MANY_IN_ANOTHER_UNIT * counts[q] and n > 2 for q, n in doubtful.items())
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
