"""Faults that measured data have in practice: how each is put into a clean set, and by which words it is named."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd


@dataclass
class Tables:
    """The files of one set."""

    loading: pd.DataFrame  # loading.csv
    observations: pd.DataFrame  # observations.csv
    robot: str  # text of robot.toml
    model: str  # text of model.toml

    @classmethod
    def read(cls, folder: Path, most_steps: int, markers: int) -> Tables:
        """The first steps of a set without readings of tendons, with so many markers, the last one among them."""
        loading = pd.read_csv(folder / "loading.csv").head(most_steps)
        observations = pd.read_csv(folder / "observations.csv", dtype={"location": object})
        robot_alone = ~observations["quantity"].isin(("tendon_displacement", "distal_tension"))
        observations = observations[observations["step"].isin(loading["step"]) & robot_alone]
        known = sorted({x for x in observations["location"] if isinstance(x, str)}, key=float)
        left_out = known[: len(known) - markers]
        observations = observations[~observations["location"].isin(left_out)].reset_index(drop=True)
        texts = [(folder / name).read_text(encoding="utf-8") for name in ("robot.toml", "model.toml")]
        return cls(loading, observations, *texts)

    def write(self, folder: Path) -> None:
        """As a new folder; an old one is replaced."""
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        self.loading.to_csv(folder / "loading.csv", index=False)
        self.observations.to_csv(folder / "observations.csv", index=False)
        (folder / "robot.toml").write_text(self.robot, encoding="utf-8")
        (folder / "model.toml").write_text(self.model, encoding="utf-8")

    @property
    def steps(self) -> list[int]:
        """Steps with readings, in order."""
        return sorted(self.observations["step"].unique().tolist())

    @property
    def markers(self) -> list[str]:
        """Arc lengths of the markers as the file has them, in order."""
        return sorted({x for x in self.observations["location"] if isinstance(x, str)}, key=float)

    def of(self, begins: str) -> pd.Series:
        """Rows whose quantity begins like this."""
        return self.observations["quantity"].str.startswith(begins)

    def at(self, marker: str) -> pd.Series:
        """Rows of one marker."""
        return self.observations["location"] == marker

    def change_robot(self, key: str, change: Callable[[float], float]) -> None:
        """Change the first number of this key in the robot's file."""
        found = re.search(rf"^{key} = (.*)$", self.robot, re.MULTILINE)
        if found is None:
            raise KeyError(key)
        number = change(float(found[1]))
        self.robot = f"{self.robot[: found.start(1)]}{number!r}{self.robot[found.end(1) :]}"


#: What changes the tables of a set in place.
Change = Callable[[Tables, np.random.Generator], None]


@dataclass(frozen=True)
class Fault:
    """One fault."""

    name: str
    base: str  # the clean set that it is put into: "tension" or "displacement"
    change: Change  # puts it into the tables
    #: The fault is named where an error or the report has one of these (in lower case), or where one is the name of an
    #: effect that was added.
    words: tuple[str, ...]


def _scale(quantity: str, factor: float) -> Change:
    def change(t: Tables, _: np.random.Generator) -> None:
        t.observations.loc[t.of(quantity), ["value"]] *= factor

    return change


def _sigma(factor: float) -> Change:
    def change(t: Tables, _: np.random.Generator) -> None:
        t.observations["sigma"] *= factor

    return change


def _exchange_columns(first: str, second: str) -> Change:
    def change(t: Tables, _: np.random.Generator) -> None:
        t.loading[[first, second]] = t.loading[[second, first]].to_numpy()

    return change


def _scale_columns(begins: str, factor: float) -> Change:
    def change(t: Tables, _: np.random.Generator) -> None:
        for name in t.loading.columns[t.loading.columns.str.startswith(begins)]:
            t.loading[name] *= factor

    return change


def _exchange_axes(t: Tables, _: np.random.Generator) -> None:
    x, y = t.of("position_x"), t.of("position_y")
    t.observations.loc[x, "quantity"], t.observations.loc[y, "quantity"] = "position_y", "position_x"


def _exchange_markers(t: Tables, _: np.random.Generator) -> None:
    first, *_rest, last = t.markers
    at_first, at_last = t.at(first), t.at(last)
    t.observations.loc[at_first, "location"], t.observations.loc[at_last, "location"] = last, first


def _shuffle_steps(t: Tables, rng: np.random.Generator) -> None:
    names = t.observations["step"].unique()
    order = dict(zip(names, rng.permutation(names), strict=True))
    t.observations["step"] = t.observations["step"].map(order)


def _shift_steps(t: Tables, _: np.random.Generator) -> None:
    t.observations["step"] += 1
    t.observations = t.observations[t.observations["step"] <= t.loading["step"].max()].copy()


def _clip(t: Tables, _: np.random.Generator) -> None:
    for quantity in ("position_x", "position_y"):
        rows = t.of(quantity)
        limit = 0.4 * t.observations.loc[rows, "value"].abs().max()
        t.observations.loc[rows, "value"] = t.observations.loc[rows, "value"].clip(-limit, limit)


def _dead_marker(t: Tables, _: np.random.Generator) -> None:
    for axis in "xyz":
        rows = t.of(f"position_{axis}") & t.at(t.markers[-1])
        t.observations.loc[rows, "value"] = t.observations.loc[rows, "value"].iloc[0]


def _frozen_since_half(t: Tables, _: np.random.Generator) -> None:
    half = t.steps[len(t.steps) // 2]
    for axis in "xyz":
        for marker in t.markers:
            rows = t.of(f"position_{axis}") & t.at(marker)
            kept = t.observations.loc[rows & (t.observations["step"] == half), "value"].iloc[0]
            t.observations.loc[rows & (t.observations["step"] > half), "value"] = kept


def _marker_slips(t: Tables, _: np.random.Generator) -> None:
    late = t.observations["step"] > t.steps[len(t.steps) // 2]
    t.observations.loc[t.of("position_z") & t.at(t.markers[-1]) & late, "value"] -= 0.02


def _camera_moves(t: Tables, _: np.random.Generator) -> None:
    late = t.observations["step"] > t.steps[len(t.steps) // 2]
    t.observations.loc[t.of("position_x") & late, "value"] += 0.015


def _drift(t: Tables, _: np.random.Generator) -> None:
    rows = t.of("position_y")
    t.observations.loc[rows, "value"] += 4e-4 * t.observations.loc[rows, "step"]


def _other_origin(t: Tables, _: np.random.Generator) -> None:
    for axis, by in zip("xyz", (0.02, -0.01, 0.015), strict=True):
        t.observations.loc[t.of(f"position_{axis}"), "value"] += by


def _turned_camera(t: Tables, _: np.random.Generator) -> None:
    c, s = np.cos(0.25), np.sin(0.25)
    x, y = t.of("position_x"), t.of("position_y")
    a, b = t.observations.loc[x, "value"].to_numpy(), t.observations.loc[y, "value"].to_numpy()
    t.observations.loc[x, "value"], t.observations.loc[y, "value"] = c * a - s * b, s * a + c * b


def _outliers(t: Tables, rng: np.random.Generator) -> None:
    rows = t.observations.index[t.of("position_")]
    hit = rng.choice(rows, len(rows) * 3 // 10, replace=False)
    t.observations.loc[hit, "value"] += rng.choice([-0.03, 0.03], len(hit))


def _missing_values(t: Tables, rng: np.random.Generator) -> None:
    rows = rng.choice(t.observations.index, len(t.observations) * 6 // 10, replace=False)
    t.observations.loc[rows, "value"] = np.nan


def _text(t: Tables, rng: np.random.Generator) -> None:
    rows = rng.choice(t.observations.index, len(t.observations) // 2, replace=False)
    t.observations["value"] = t.observations["value"].astype(object)
    t.observations.loc[rows, "value"] = "lost"


def _contradicting_rows(t: Tables, _: np.random.Generator) -> None:
    again = t.observations.copy()
    again.loc[again["quantity"].str.startswith("position_"), "value"] += 0.01
    t.observations = pd.concat([t.observations, again], ignore_index=True)


def _unloaded(t: Tables, _: np.random.Generator) -> None:
    begins = ("tension_", "displacement_", "force_")
    moved = t.loading[[c for c in t.loading.columns if c.startswith(begins)]].abs().sum(axis=1) > 0.0
    t.observations = t.observations[~t.observations["step"].isin(t.loading.loc[moved, "step"])].copy()


def _noise(size: float) -> Change:
    def change(t: Tables, rng: np.random.Generator) -> None:
        rows = t.of("position_")
        t.observations.loc[rows, "value"] += size * rng.standard_normal(int(rows.sum()))

    return change


def _unplugged(name: str) -> Change:
    def change(t: Tables, _: np.random.Generator) -> None:
        t.loading[name] = 0.0

    return change


def _round(t: Tables, _: np.random.Generator) -> None:
    rows = t.of("position_")
    t.observations.loc[rows, "value"] = (t.observations.loc[rows, "value"] / 5e-3).round() * 5e-3


def _robot(key: str, change: Callable[[float], float]) -> Change:
    def apply(t: Tables, _: np.random.Generator) -> None:
        t.change_robot(key, change)

    return apply


def _no_sigma(t: Tables, _: np.random.Generator) -> None:
    t.observations["sigma"] = np.nan


def _one_reading(t: Tables, _: np.random.Generator) -> None:
    t.observations = t.observations.iloc[[len(t.observations) // 2]].copy()


def _two_steps(t: Tables, _: np.random.Generator) -> None:
    t.observations = t.observations[t.observations["step"].isin(t.steps[4:6])].copy()


#: All faults, in the order of the table that is printed.
FAULTS: tuple[Fault, ...] = (
    Fault("positions in mm", "tension", _scale("position_", 1e3), ("mm",)),
    Fault("positions in cm", "tension", _scale("position_", 1e2), ("cm", "mm", "unit")),
    Fault("z alone in mm", "tension", _scale("position_z", 1e3), ("mm",)),
    Fault("angles in degrees", "tension", _scale("bending_angle", 180.0 / np.pi), ("deg",)),
    Fault("one reading", "tension", _one_reading, ("too few", "1 reading")),
    Fault("two steps", "tension", _two_steps, ("too few",)),
    Fault("no noise column", "tension", _no_sigma, ("noise is estimated", "sigma is estimated", "no sigma")),
    Fault("sigma a tenth of the noise", "tension", _sigma(0.1), ("sigma is too",)),
    Fault("sigma ten times the noise", "tension", _sigma(10.0), ("sigma is too",)),
    Fault("sensor clips", "tension", _clip, ("saturated",)),
    Fault(
        "tendons t1 and t2 exchanged",
        "tension",
        _exchange_columns("tension_t1", "tension_t2"),
        ("exchanged",),
    ),
    Fault(
        "displacements of t1 and t2 exchanged",
        "displacement",
        _exchange_columns("displacement_t1", "displacement_t2"),
        ("exchanged",),
    ),
    Fault("steps of the readings shuffled", "tension", _shuffle_steps, ("their order",)),
    Fault("readings one step late", "tension", _shift_steps, ("shifted",)),
    Fault("axes x and y exchanged", "tension", _exchange_axes, ("axes", "frame_misalignment")),
    Fault("z counted down", "tension", _scale("position_z", -1.0), ("axes", "axis")),
    Fault("left-handed axes", "tension", _scale("position_y", -1.0), ("axes", "axis")),
    Fault("first and last marker exchanged", "tension", _exchange_markers, ("markers at s",)),
    Fault("marker at the tip dead", "tension", _dead_marker, ("is constant",)),
    Fault("readings frozen from the middle on", "tension", _frozen_since_half, ("is constant",)),
    Fault("marker slips in the middle", "tension", _marker_slips, ("marker at s",)),
    Fault("camera pushed in the middle", "tension", _camera_moves, ("jump",)),
    Fault("camera drifts", "tension", _drift, ("drift",)),
    Fault("another origin", "tension", _other_origin, ("marker_offset", "origin", "frame")),
    Fault("camera turned by 14 degrees", "tension", _turned_camera, ("frame_misalignment",)),
    Fault("three in ten are outliers", "tension", _outliers, ("are outliers",)),
    Fault("six in ten are empty", "tension", _missing_values, ("rows would be left",)),
    Fault("half of the values are text", "tension", _text, ("rows would be left",)),
    Fault("rows twice, 10 mm apart", "tension", _contradicting_rows, ("were left out: too many",)),
    Fault("only unloaded steps", "tension", _unloaded, ("noise is larger", "too few")),
    Fault("noise larger than the motion", "tension", _noise(0.2), ("noise is larger", "values up to")),
    Fault("noise thirty times its sigma", "tension", _noise(6e-3), ("times their sigma",)),
    Fault("readings rounded to 5 mm", "tension", _round, ("rounded",)),
    Fault(
        "tensions in grams", "tension", _scale_columns("tension_", 102.0), ("actuator_gain", "meant in mn")
    ),
    Fault("displacements in mm", "displacement", _scale_columns("displacement_", 1e3), ("mm",)),
    Fault(
        "displacements counted the other way",
        "displacement",
        _scale_columns("displacement_", -1.0),
        ("opposite sign",),
    ),
    Fault("tension of t2 not recorded", "tension", _unplugged("tension_t2"), ("tendon t2 has no input",)),
    Fault("diameter given as radius", "tension", _robot("radius", lambda x: 2.0 * x), ("stiffness_scale",)),
    Fault("modulus in MPa", "tension", _robot("youngs_modulus", lambda x: 1e-6 * x), ("youngs_modulus",)),
    Fault("length a tenth too short", "tension", _robot("length", lambda x: 0.9 * x), ("length",)),
)
