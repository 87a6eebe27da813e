"""Faults that measured data have in practice: how each is put into a clean set, and by which words it is named."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
        of_tendons = observations["quantity"].isin(("tendon_displacement", "base_tension", "distal_tension"))
        observations = observations[observations["step"].isin(loading["step"]) & ~of_tendons]
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


def _values(quantity: str, new: Callable[[pd.DataFrame, np.random.Generator], pd.Series]) -> Change:
    """Other values in the rows whose quantity begins like this."""

    def change(t: Tables, rng: np.random.Generator) -> None:
        rows = t.of(quantity)
        t.observations.loc[rows, "value"] = new(t.observations[rows], rng)

    return change


def _scale(quantity: str, factor: float) -> Change:
    return _values(quantity, lambda r, _: r["value"] * factor)


def _late(r: pd.DataFrame) -> pd.Series:
    """Rows of the steps after the one in the middle."""
    return r["step"] > _middle(r)


def _middle(r: pd.DataFrame) -> int:
    steps = sorted(r["step"].unique())
    return int(steps[len(steps) // 2])


def _at_tip(r: pd.DataFrame) -> pd.Series:
    return r["location"] == max(r["location"], key=float)


def _clipped(r: pd.DataFrame, _: np.random.Generator) -> pd.Series:
    limit = 0.4 * r["value"].abs().max()
    return r["value"].clip(-limit, limit)


def _dead(r: pd.DataFrame, _: np.random.Generator) -> pd.Series:
    return r["value"].mask(_at_tip(r), r.groupby(["quantity", "location"])["value"].transform("first"))


def _frozen(r: pd.DataFrame, _: np.random.Generator) -> pd.Series:
    kept = r[r["step"] == _middle(r)].set_index(["quantity", "location"])["value"]
    frozen = kept.loc[pd.MultiIndex.from_frame(r[["quantity", "location"]])].to_numpy()
    return r["value"].mask(_late(r), pd.Series(frozen, r.index))


def _outlying(r: pd.DataFrame, rng: np.random.Generator) -> pd.Series:
    values = r["value"].copy()
    hit = rng.choice(r.index, len(r) * 3 // 10, replace=False)
    values[hit] += rng.choice([-0.03, 0.03], len(hit))
    return values


def _noisy(size: float) -> Change:
    return _values("position_", lambda r, rng: r["value"] + size * rng.standard_normal(len(r)))


def _both(*changes: Change) -> Change:
    def change(t: Tables, rng: np.random.Generator) -> None:
        for one in changes:
            one(t, rng)

    return change


def _moved(axis: str, by: float) -> Change:
    return _values(f"position_{axis}", lambda r, _: r["value"] + by)


def _turned_camera(t: Tables, _: np.random.Generator) -> None:
    c, s = np.cos(0.25), np.sin(0.25)
    x, y = t.of("position_x"), t.of("position_y")
    a, b = t.observations.loc[x, "value"].to_numpy(), t.observations.loc[y, "value"].to_numpy()
    t.observations.loc[x, "value"], t.observations.loc[y, "value"] = c * a - s * b, s * a + c * b


def _sigma(factor: float) -> Change:
    def change(t: Tables, _: np.random.Generator) -> None:
        t.observations["sigma"] *= factor

    return change


def _renamed(column: str, names: Callable[[Tables], dict[str, str]]) -> Change:
    """Other names of quantities or markers."""

    def change(t: Tables, _: np.random.Generator) -> None:
        t.observations[column] = t.observations[column].replace(names(t))

    return change


def _shuffle_steps(t: Tables, rng: np.random.Generator) -> None:
    names = t.observations["step"].unique()
    order = dict(zip(names, rng.permutation(names), strict=True))
    t.observations["step"] = t.observations["step"].map(order)


def _shift_steps(t: Tables, _: np.random.Generator) -> None:
    t.observations["step"] += 1
    t.observations = t.observations[t.observations["step"] <= t.loading["step"].max()].copy()


def _missing_values(t: Tables, rng: np.random.Generator) -> None:
    rows = rng.choice(t.observations.index, len(t.observations) * 6 // 10, replace=False)
    t.observations.loc[rows, "value"] = np.nan


def _text(t: Tables, rng: np.random.Generator) -> None:
    rows = rng.choice(t.observations.index, len(t.observations) // 2, replace=False)
    t.observations["value"] = t.observations["value"].astype(object)
    t.observations.loc[rows, "value"] = "lost"


def _contradicting_rows(t: Tables, _: np.random.Generator) -> None:
    again = t.observations.copy()
    again.loc[t.of("position_"), "value"] += 0.01
    t.observations = pd.concat([t.observations, again], ignore_index=True)


def _unloaded(t: Tables, _: np.random.Generator) -> None:
    inputs = t.loading.filter(regex="^(tension|displacement|force)_")
    moved = t.loading.loc[inputs.abs().sum(axis=1) > 0.0, "step"]
    t.observations = t.observations[~t.observations["step"].isin(moved)].copy()


def _kept(rows: Callable[[Tables], pd.DataFrame]) -> Change:
    """Only some of the readings."""

    def change(t: Tables, _: np.random.Generator) -> None:
        t.observations = rows(t).copy()

    return change


def _loading(columns: str, new: Callable[[pd.DataFrame], Any]) -> Change:
    """Other inputs in the columns that match."""

    def change(t: Tables, _: np.random.Generator) -> None:
        own = t.loading.filter(regex=columns)
        t.loading[own.columns] = new(own)

    return change


def _exchanged(own: pd.DataFrame) -> Any:
    return own.to_numpy()[:, ::-1]


def _robot(key: str, change: Callable[[float], float]) -> Change:
    def apply(t: Tables, _: np.random.Generator) -> None:
        t.change_robot(key, change)

    return apply


#: All faults, in the order of the table that is printed.
FAULTS: tuple[Fault, ...] = (
    Fault("positions in mm", "tension", _scale("position_", 1000.0), ("mm",)),
    Fault("positions in cm", "tension", _scale("position_", 100.0), ("cm", "mm", "unit")),
    Fault("z alone in mm", "tension", _scale("position_z", 1000.0), ("mm",)),
    Fault("angles in degrees", "tension", _scale("bending_angle", 180.0 / np.pi), ("deg",)),
    Fault("one reading", "tension",
          _kept(lambda t: t.observations.iloc[[len(t.observations) // 2]]), ("too few", "1 reading")),
    Fault("two steps", "tension",
          _kept(lambda t: t.observations[t.observations["step"].isin(t.steps[4:6])]), ("too few",)),
    Fault("no noise column", "tension", _sigma(np.nan), ("noise is estimated", "sigma is estimated", "no sigma")),
    Fault("sigma a tenth of the noise", "tension", _sigma(0.1), ("sigma is too",)),
    Fault("sigma ten times the noise", "tension", _sigma(10.0), ("sigma is too",)),
    Fault("sensor clips", "tension",
          _both(_values("position_x", _clipped), _values("position_y", _clipped)), ("saturated",)),
    Fault("tendons t1 and t2 exchanged", "tension", _loading("^tension_t[12]$", _exchanged), ("exchanged",)),
    Fault("displacements of t1 and t2 exchanged", "displacement",
          _loading("^displacement_t[12]$", _exchanged), ("exchanged",)),
    Fault("steps of the readings shuffled", "tension", _shuffle_steps, ("their order",)),
    Fault("readings one step late", "tension", _shift_steps, ("shifted",)),
    Fault("axes x and y exchanged", "tension",
          _renamed("quantity", lambda t: {"position_x": "position_y", "position_y": "position_x"}),
          ("axes", "frame_misalignment")),
    Fault("z counted down", "tension", _scale("position_z", -1.0), ("axes", "axis")),
    Fault("left-handed axes", "tension", _scale("position_y", -1.0), ("axes", "axis")),
    Fault("first and last marker exchanged", "tension",
          _renamed("location", lambda t: {t.markers[0]: t.markers[-1], t.markers[-1]: t.markers[0]}),
          ("markers at s",)),
    Fault("marker at the tip dead", "tension", _values("position_", _dead), ("is constant",)),
    Fault("readings frozen from the middle on", "tension", _values("position_", _frozen), ("is constant",)),
    Fault("marker slips in the middle", "tension",
          _values("position_z", lambda r, _: r["value"] - 0.02 * (_at_tip(r) & _late(r))), ("marker at s",)),
    Fault("camera pushed in the middle", "tension",
          _values("position_x", lambda r, _: r["value"] + 0.015 * _late(r)), ("jump",)),
    Fault("camera drifts", "tension",
          _values("position_y", lambda r, _: r["value"] + 0.0004 * r["step"]), ("drift",)),
    Fault("another origin", "tension",
          _both(_moved("x", 0.02), _moved("y", -0.01), _moved("z", 0.015)), ("marker_offset", "origin", "frame")),
    Fault("camera turned by 14 degrees", "tension", _turned_camera, ("frame_misalignment",)),
    Fault("three in ten are outliers", "tension", _values("position_", _outlying), ("are outliers",)),
    Fault("six in ten are empty", "tension", _missing_values, ("rows would be left",)),
    Fault("half of the values are text", "tension", _text, ("rows would be left",)),
    Fault("rows twice, 10 mm apart", "tension", _contradicting_rows, ("were left out: too many",)),
    Fault("only unloaded steps", "tension", _unloaded, ("noise is larger", "too few")),
    Fault("noise larger than the motion", "tension", _noisy(0.2), ("noise is larger", "lies between")),
    Fault("noise thirty times its sigma", "tension", _noisy(0.006), ("times their sigma",)),
    Fault("readings rounded to 5 mm", "tension",
          _values("position_", lambda r, _: (r["value"] / 0.005).round() * 0.005), ("rounded",)),
    Fault("tensions in grams", "tension",
          _loading("^tension_", lambda own: 102.0 * own), ("actuator_gain", "meant in mn")),
    Fault("displacements in mm", "displacement", _loading("^displacement_", lambda own: 1000.0 * own), ("mm",)),
    Fault("displacements counted the other way", "displacement",
          _loading("^displacement_", lambda own: -own), ("opposite sign",)),
    Fault("tension of t2 not recorded", "tension",
          _loading("^tension_t2$", lambda own: 0.0), ("tendon t2 has no input",)),
    Fault("diameter given as radius", "tension", _robot("radius", lambda x: 2.0 * x), ("stiffness_scale",)),
    Fault("modulus in MPa", "tension", _robot("youngs_modulus", lambda x: 1e-06 * x), ("youngs_modulus",)),
    Fault("length a tenth too short", "tension", _robot("length", lambda x: 0.9 * x), ("length",)),
)  # fmt: skip
