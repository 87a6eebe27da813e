"""Tables 1 to 4 beside the declared robot and the robots with one stiffness, and with a dead band, fitted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pandas as pd

from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.paper.cases import prototype
from tdcr_fe.validation.paper.studies.comparison import (
    Deviation,
    Reading,
    TableFit,
    compare_table,
    deviation,
    fit_table,
)
from tdcr_fe.validation.paper.tables import paper_table


@dataclass(frozen=True)
class TableStudy:
    """A table beside the models.

    Attributes
    ----------
    number : int
    table : DataFrame
        Of `paper_table`.
    readings : dict
        By model: "declared", "stiffness" (one EI fitted), "dead band" (EI and a dead band fitted; not Table 2).
    deviations : dict
        By model, with parts "all", "without load", "with load", "consistent rows".
    fits : dict of str to TableFit
    """

    number: int
    table: pd.DataFrame
    readings: dict[str, list[Reading]]
    deviations: dict[str, dict[str, Deviation]]
    fits: dict[str, TableFit]


def study_table(number: int) -> TableStudy:
    """One table beside the declared and the fitted robots."""
    readings = {"declared": compare_table(number)}
    fits = {"stiffness": fit_table(number)}
    readings["stiffness"] = compare_table(number, fits["stiffness"].robot)
    if number != 2:
        fits["dead band"] = fit_table(number, dead_band=True)
        readings["dead band"] = compare_table(
            number, fits["dead band"].robot, dead_band=fits["dead band"].dead_band
        )
    length = prototype(number).backbone.length
    parts: dict[str, Callable[[Reading], bool]] = {
        "all": lambda r: True,
        "without load": lambda r: not r.loaded,
        "with load": lambda r: r.loaded,
        "consistent rows": lambda r: r.consistent,
    }
    deviations = {
        name: {part: deviation(found, length, where) for part, where in parts.items()}
        for name, found in readings.items()
    }
    return TableStudy(number, paper_table(number), readings, deviations, fits)


def unloaded_deviation(robot: Robot) -> Deviation:
    """Of the rows of Table 1 without load from a robot."""
    length = prototype(1).backbone.length
    return deviation(compare_table(1, robot), length, lambda r: not r.loaded)
