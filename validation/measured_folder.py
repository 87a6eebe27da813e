"""Write measured data as the folder that `tdcr_fe.io.measured.read_measured` reads."""

from __future__ import annotations

from pathlib import Path

from tdcr_fe.io.files import StrPath, write_text
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.readings import observations_table
from tdcr_fe.io.tables import loading_table
from tdcr_fe.io.write_toml import model_to_toml, robot_to_toml, value_to_toml
from tdcr_fe.model.loading import SolverSettings


def write_measured(data: MeasuredData, folder: StrPath) -> None:
    """Write data as a folder that `read_measured` reads.

    Raises
    ------
    ValueError
        The files have no place for a part of robot or loading sequence; nothing is written.
    """
    robot = robot_to_toml(data.robot)
    loading = loading_table(data.robot, data.step_ids, data.steps, data.branches)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    settings = None if data.settings == SolverSettings() else data.settings
    write_text(robot, folder / "robot.toml")
    text = model_to_toml(data.model, settings, data.effects)
    if data.input_sigma:
        own = zip(data.robot.tendon_names, data.input_sigma, strict=True)
        text += f"\n[inputs]\nsigma = {value_to_toml(dict(own))}\n"
    write_text(text, folder / "model.toml")
    loading.to_csv(folder / "loading.csv", index=False)
    observations_table(data.readings).to_csv(folder / "observations.csv", index=False)
