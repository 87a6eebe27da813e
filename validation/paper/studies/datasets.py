"""The paper's tables as measured data for `tdcr_fe.identify`.

A data set contains only readings that are possible for some robot. A contradictory pair of offset and angle is left
out, and so is a row whose load acts like a fraction of itself. Every omission is listed with its reason.

Every row starts from the robot at rest. Where a data set has rows without load only, the rows follow each other with
rising tension, which is the same: the tendon is always being pulled. Step numbers are those of the rows; where a row
takes more than one step they are ten times the row, plus 1 for the tension and 2 for the load.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.paper.cases import prototype
from tdcr_fe.validation.paper.studies.comparison import row_steps
from tdcr_fe.validation.paper.tables import STATED_ERROR, paper_table


@dataclass(frozen=True)
class TableData:
    """A table as a data set.

    Attributes
    ----------
    id : str
        One of `DATASETS`.
    title : str
    number : int
        Of the table.
    data : MeasuredData
        The robot as declared, the loading sequence, the readings that are consistent.
    left_out : tuple of (str, str)
        Row and state that is left out, and the reason.
    note : str
        Assumptions, or what the file format cannot express.
    in_files : bool
        Whether `tdcr_fe.io.measured.write_measured` can write it.
    """

    id: str
    title: str
    number: int
    data: MeasuredData
    left_out: tuple[tuple[str, str], ...]
    note: str
    in_files: bool = True

    def row(self, step: int) -> int:
        """Row of the table that a step belongs to."""
        return step // 10 if max(self.data.step_ids) > 9 else step

    @property
    def rows(self) -> tuple[int, ...]:
        """Rows of the table that have readings."""
        return tuple(sorted({self.row(r.step) for r in self.data.readings}))


_TITLES = {
    "table1": "Table 1, consistent rows",
    "table1-angles": "Table 1, every angle",
    "table2": "Table 2",
    "table3": "Table 3",
    "table4": "Table 4",
}

#: Every data set, by name.
DATASETS = tuple(_TITLES)

_NOTES = {
    "table1": "",
    "table1-angles": (
        "The consistent rows, and of the others the angle: over all rows the angles rise more evenly "
        "than the offsets."
    ),
    "table2": (
        "There are no rows without load; all are used, because what speaks against them is the robot of Table 1, which "
        "need not be this one. The location of the concentrated load is not given (here: the end of the first "
        "segment), nor is its direction (here: in the plane of bending). The first segment gives its offset only. A "
        "load elsewhere than at the tip cannot be written into loading.csv."
    ),
    "table3": "",
    "table4": (
        "Rows by rising tension, each from the robot at rest. The direction of the load is not given (here: in the "
        "plane of bending)."
    ),
}


def table_dataset(name: str) -> TableData:
    """A table of the paper as measured data.

    Parameters
    ----------
    name
        One of `DATASETS`.

    Raises
    ------
    KeyError
        There is no such data set; those that exist are named.
    """
    if name not in _TITLES:
        raise KeyError(f"no data set {name!r}; there are {', '.join(DATASETS)}")
    number = int(name[5])
    robot, table = prototype(number), paper_table(number)
    if number == 2:
        data, left_out = _with_two_places(name, robot, table)
    else:
        data, left_out = _with_tip(name, robot, table)
    return TableData(name, _TITLES[name], number, data, tuple(left_out), _NOTES[name], in_files=number != 2)


def _angle(step: int, degrees: float, robot: Robot) -> Reading:
    return Reading(
        step, "chord_angle", None, float(np.deg2rad(degrees)), STATED_ERROR / robot.backbone.length
    )


def _offset(step: int, millimetres: float) -> Reading:
    return Reading(step, "tip_offset", None, 1e-3 * millimetres, STATED_ERROR)


def _with_tip(name: str, robot: Robot, table: pd.DataFrame) -> tuple[MeasuredData, list[tuple[str, str]]]:
    """Tables 1, 3 and 4: the tip, without and with a load at it."""
    number = int(name[5])
    readings: list[Reading] = []
    left_out: list[tuple[str, str]] = []
    elastic = table["elastic_ok"] & (table.get("wrong_loaded", "") == "") & (table["load_N"] > 0.0)
    several = bool(elastic.any())
    ids: list[int] = []
    steps: list[LoadStep] = []
    branches: list[str] = []
    for _, row in table.sort_values("tension_N", kind="stable").iterrows():
        k = int(row["row"])
        pull, load = row_steps(number, row, robot, True)
        parts = [(k, pull)]
        if several:
            # The load stays until it is taken off: a row begins with the robot at rest.
            still = {n: Load(x.at, (0.0, 0.0, 0.0)) for n, x in load.loads.items()}
            rest = LoadStep("rest", {n: 0.0 for n in pull.tensions}, loads=still)
            parts = [(10 * k, rest), (10 * k + 1, pull)]
            parts += [(10 * k + 2, replace(load, tensions=pull.tensions))] if elastic[k - 1] else []
        before = len(readings)
        at = 10 * k + 1 if several else k
        wrong = str(row["wrong"])
        if not wrong:
            readings += [_angle(at, row["angle_deg"], robot), _offset(at, row["offset_mm"])]
        elif name == "table1-angles":
            readings.append(_angle(at, row["angle_deg"], robot))
            left_out.append((f"row {k}, offset", wrong))
        else:
            left_out.append((f"row {k}, without load", wrong))
        if elastic[k - 1]:
            readings += [
                _angle(10 * k + 2, row["angle_loaded_deg"], robot),
                _offset(10 * k + 2, row["offset_loaded_mm"]),
            ]
        else:
            reason = "; ".join(x for x in str(row["reasons"]).split("; ") if x != wrong)
            left_out.append((f"row {k}, with load", reason))
        if len(readings) > before:
            ids += [i for i, _ in parts]
            steps += [s for _, s in parts]
            branches += [f"row {k}"] * len(parts) if several else [""]
    data = MeasuredData(
        f"paper-{name}", robot, Model(), tuple(ids), tuple(steps), tuple(branches), tuple(readings)
    )
    return data, sorted(left_out)


def _with_two_places(
    name: str, robot: Robot, table: pd.DataFrame
) -> tuple[MeasuredData, list[tuple[str, str]]]:
    """Table 2: the end of the first segment and the tip, always with load."""
    readings: list[Reading] = []
    left_out: list[tuple[str, str]] = []
    ids: list[int] = []
    steps: list[LoadStep] = []
    branches: list[str] = []
    half, length = 0.5 * robot.backbone.length, robot.backbone.length
    for _, row in table.iterrows():
        k = int(row["row"])
        pull, load = row_steps(2, row, robot, True)
        nothing = {"middle": Load(half, (0.0, 0.0, 0.0)), "tip": Load(length, (0.0, 0.0, 0.0))}
        ids += [10 * k, 10 * k + 1, 10 * k + 2]
        steps += [LoadStep("rest", {n: 0.0 for n in robot.tendon_names}, loads=nothing), pull, load]
        branches += [f"row {k}"] * 3
        at = 10 * k + 2
        for suffix, found in (
            ("_1", [Reading(at, "position_x", half, 1e-3 * float(row["offset_1_mm"]), STATED_ERROR)]),
            ("_2", [_angle(at, row["angle_2_deg"], robot), _offset(at, row["offset_2_mm"])]),
        ):
            wrong = str(row[f"wrong{suffix}"])
            if wrong:
                left_out.append((f"row {k}, {'first segment' if suffix == '_1' else 'tip'}", wrong))
            else:
                readings += found
    data = MeasuredData(
        f"paper-{name}", robot, Model(), tuple(ids), tuple(steps), tuple(branches), tuple(readings)
    )
    return data, left_out
