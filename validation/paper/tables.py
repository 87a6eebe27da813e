"""The paper's Tables 1-4, and consistency checks of every row.

Offsets are distances of a point from the z axis; angles are chord angles, between the line from the base to the point
and the z axis (the definition that fits the pairs in the tables). Two checks need no model of the robot:

- the chord, ``offset / sin(angle)``, cannot be longer than the backbone between base and point;
- a backbone that bends uniformly to one side has the chord ``L sin(angle) / angle``; a much shorter one requires
  a backbone folded back on itself at that small an angle.

The third assumes elasticity only: one bending stiffness must explain the deflections by tension and by load.
To first order in the deflection

    EI_tension = T |int_0^L (L - s) r(s) ds| / offset,      EI_load = F L^3 / (3 (loaded - unloaded offset)),

with ``r(s)`` the hole's position in the section. Both are valid for any offset and routing without friction; friction
makes ``EI_tension`` too large by less than the Capstan factor.
"""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
import pandas as pd

from tdcr_fe.model.robot import Robot
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.validation.paper.cases import packaged_text, prototype

#: Tables there are.
TABLES = (1, 2, 3, 4)

#: A chord may be longer than the backbone by this share: reading errors of the tables' digits [1].
CHORD_TOLERANCE = 0.01

#: A chord may be shorter than that of an even bend by this share [1].
FOLD_TOLERANCE = 0.08

#: The same where the offset is that along one axis only (Tables 3 and 4): the tip may lie beside that axis [1].
AXIS_TOLERANCE = 0.15

#: Two stiffnesses of one robot may differ by this factor: first-order formulas, friction [1].
STIFFNESS_FACTOR = 3.0

#: Measurement error that the paper states: below 0.1 mm (section 3.2) [m].
STATED_ERROR = 1e-4

#: The axis beside the one whose offset is given.
_BESIDE = {3: "x", 4: "y"}

_LABELS = {1: "single segment", 2: "two segments", 3: "helical tendon", 4: "converging tendon"}


def table_title(number: int) -> str:
    """Number and robot of a table."""
    return f"Table {number}: {_LABELS[number]}"


def typed_table(number: int) -> pd.DataFrame:
    """A table of the paper as printed; columns name their units.

    Raises
    ------
    KeyError
        There is no such table.
    """
    if number not in TABLES:
        raise KeyError(f"no Table {number}; there are Tables 1 to 4")
    text = packaged_text("data", "tables", f"table{number}.csv")
    return pd.read_csv(io.StringIO(text), dtype=float)


def paper_table(number: int) -> pd.DataFrame:
    """A table of the paper with the checks of its rows.

    Parameters
    ----------
    number
        1 to 4.

    Returns
    -------
    DataFrame
        The printed columns; ``row`` from 1; ``chord..._mm``, ``even_bend_chord..._mm`` and ``wrong...`` (a sentence,
        or nothing) for every pair of offset and angle; ``stiffness_from_tension_Nm2`` and
        ``stiffness_from_load_Nm2`` where the row has both; ``geometry_ok`` (some robot can have this shape),
        ``elastic_ok`` (one stiffness fits the tension and the load), and ``reasons``, a sentence for each check that
        fails.

    Raises
    ------
    KeyError
        There is no such table.
    """
    table = typed_table(number)
    robot = prototype(number)
    table.insert(0, "row", np.arange(1, len(table) + 1))
    reasons: list[list[str]] = [[] for _ in range(len(table))]
    if number == 1:
        pairs = [("", "offset_mm", "angle_deg", 1e3 * robot.backbone.length)]
    elif number == 2:
        half = 0.5e3 * robot.backbone.length
        pairs = [("_1", "offset_1_mm", "angle_1_deg", half), ("_2", "offset_2_mm", "angle_2_deg", 2.0 * half)]
    else:
        length = 1e3 * robot.backbone.length
        pairs = [
            ("", "offset_mm", "angle_deg", length),
            ("_loaded", "offset_loaded_mm", "angle_loaded_deg", length),
        ]
    for suffix, offset, angle, length in pairs:
        _check_chord(table, suffix, offset, angle, length, _BESIDE.get(number, ""), reasons)
    table["geometry_ok"] = [not r for r in reasons]
    elastic: list[list[str]] = [[] for _ in range(len(table))]
    if number == 2:
        _check_first_segment(table, robot, elastic)
    else:
        _check_stiffness(table, robot, elastic)
    if number in (3, 4):
        _check_order(table, elastic)
    table["elastic_ok"] = [not e for e in elastic]
    table["reasons"] = ["; ".join([*r, *e]) for r, e in zip(reasons, elastic, strict=True)]
    return table


def _check_chord(
    table: pd.DataFrame,
    suffix: str,
    offset: str,
    angle: str,
    length: float,
    beside: str,
    reasons: Sequence[list[str]],
) -> None:
    tolerance = AXIS_TOLERANCE if beside else FOLD_TOLERANCE
    phi = np.deg2rad(table[angle].to_numpy())
    chord = table[offset].to_numpy() / np.sin(phi)
    even = length * np.sin(phi) / phi
    table[f"chord{suffix}_mm"] = chord
    table[f"even_bend_chord{suffix}_mm"] = even
    found: list[str] = [""] * len(table)
    what = {"": "", "_loaded": "loaded ", "_1": "first segment's ", "_2": "tip's "}[suffix]
    for k, (c, e) in enumerate(zip(chord, even, strict=True)):
        if c > length * (1.0 + CHORD_TOLERANCE):
            found[k] = f"{what}chord of {c:.0f} mm on a {length:.0f} mm robot"
        elif c < e * (1.0 - tolerance):
            aside = np.sqrt((e * np.sin(phi[k])) ** 2 - table[offset][k] ** 2)
            found[k] = (
                f"{what}chord of {c:.0f} mm where {table[angle][k]:g} deg needs about {e:.0f} mm: offset "
                f"{table[offset][k]:g} mm, or the angle, is wrong"
                + (
                    f" (or the tip lies {aside:.0f} mm off along {beside}, which is not given)"
                    if beside
                    else ""
                )
            )
    table[f"wrong{suffix}"] = found
    for r, text in zip(reasons, found, strict=True):
        r.extend([text] if text else [])


def first_moment(robot: Robot, tendon: Tendon) -> float:
    """``|int_0^L (L - s) r(s) ds|`` of a tendon's path, base to tip [m^3]."""
    length, end = robot.backbone.length, robot.end(tendon)
    s = np.linspace(0.0, end, 4001)
    path = tendon.routing.position(s, end)
    return float(np.linalg.norm(np.trapezoid((length - s)[:, None] * path, s, axis=0)))


def _check_stiffness(table: pd.DataFrame, robot: Robot, elastic: Sequence[list[str]]) -> None:
    length = robot.backbone.length
    tension, load = table["tension_N"].to_numpy(), table["load_N"].to_numpy()
    angle, loaded = (
        np.deg2rad(table["angle_deg"].to_numpy()),
        np.deg2rad(table["angle_loaded_deg"].to_numpy()),
    )
    # Offsets are computed from the angles, which are consistent in every table.
    offset, offset_loaded = (length * np.sin(a) ** 2 / a for a in (angle, loaded))
    by_tension = tension * first_moment(robot, robot.tendons[0]) / offset
    with np.errstate(divide="ignore"):
        by_load = load * length**3 / (3.0 * (offset_loaded - offset))
    table["stiffness_from_tension_Nm2"] = by_tension
    table["stiffness_from_load_Nm2"] = by_load
    for k, (a, b, f) in enumerate(zip(by_tension, by_load, load, strict=True)):
        if b < 0.0:
            elastic[k].append(f"{f:g} N bends the robot less, not more")
        elif b > STIFFNESS_FACTOR * a or a > STIFFNESS_FACTOR * b:
            elastic[k].append(
                f"{f:g} N acts like {f * a / b:.3f} N: EI {1e3 * b:.3g}e-3 N m² from the load, "
                f"{1e3 * a:.3g}e-3 from the "
                "tension"
            )


def _check_first_segment(table: pd.DataFrame, robot: Robot, elastic: Sequence[list[str]]) -> None:
    first = robot.tendons[0]
    end = robot.end(first)
    lever = float(np.linalg.norm(robot.holes(first)[0]))
    tension = (table["tension_1_N"] + table["tension_2_N"]).to_numpy()
    angle = np.deg2rad(table["angle_1_deg"].to_numpy())
    by_tension = tension * lever * end / (2.0 * angle)
    table["stiffness_from_tension_Nm2"] = by_tension
    reference = typed_table(1)
    single = prototype(1)
    middle = reference.iloc[2]
    phi = np.deg2rad(middle["angle_deg"])
    other = float(middle["tension_N"] * lever * single.backbone.length / (2.0 * phi))
    for k, a in enumerate(by_tension):
        if a > STIFFNESS_FACTOR * other or other > STIFFNESS_FACTOR * a:
            elastic[k].append(
                f"first segment as stiff as EI {1e3 * a:.3g}e-3 N m², before its load is counted; the robot of "
                "Table 1 has "
                f"{1e3 * other:.3g}e-3"
            )


def _check_order(table: pd.DataFrame, elastic: Sequence[list[str]]) -> None:
    for k in range(1, len(table)):
        same = table["load_N"][k] == table["load_N"][k - 1]
        for column, what in (("offset_mm", "offset"), ("offset_loaded_mm", "loaded offset")):
            if (
                same
                and table["tension_N"][k] > table["tension_N"][k - 1]
                and table[column][k] <= table[column][k - 1]
            ):
                elastic[k].append(f"{what} falls although the tension rises")


def table_remarks(number: int) -> list[str]:
    """Remarks on a table as a whole."""
    table = paper_table(number)
    robot = prototype(number)
    declared = robot.backbone.EI
    found = table["stiffness_from_tension_Nm2"].to_numpy()
    remarks = [
        f"The tension column requires EI {1e3 * found.min():.2f} to {1e3 * found.max():.2f}e-3 N m² from row to row; "
        f"the rod as declared has {1e3 * declared:.2f}e-3."
    ]
    if number != 2:
        by_load = table["stiffness_from_load_Nm2"].to_numpy()
        good = by_load[by_load > 0.0]
        remarks.append(
            f"The load column requires EI {1e3 * good.min():.3g} to {1e3 * good.max():.3g}e-3 N m²: "
            f"{(good / found[by_load > 0.0]).min():.1f} to {(good / found[by_load > 0.0]).max():.0f} times the "
            "tension's."
        )
        remarks.append(
            f"The offset grows like T^{growth_exponent(table):.2f}; linear elasticity with Capstan friction gives an "
            "exponent of 1 while the deflection is small, and a little less beyond."
        )
    return remarks


def growth_exponent(table: pd.DataFrame) -> float:
    """Exponent ``p`` of offset ~ tension^p over the unloaded, consistent rows of a table [1]."""
    used = table[table["geometry_ok"]]
    return float(np.polyfit(np.log(used["tension_N"]), np.log(used["offset_mm"]), 1)[0])
