"""A set of measured data as tables that can be changed and written."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pandas as pd


@dataclass
class Tables:
    """The files of one set.

    Attributes
    ----------
    loading, observations : pandas.DataFrame
        ``loading.csv`` and ``observations.csv``.
    robot, model : str
        Texts of ``robot.toml`` and ``model.toml``.
    """

    loading: pd.DataFrame
    observations: pd.DataFrame
    robot: str
    model: str

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
