"""The paper's robots and scenarios as packaged files, and functions that read them."""

from __future__ import annotations

import os
from pathlib import Path

from tdcr_fe.io.files import write_text
from tdcr_fe.io.toml import Scenario, read_robot, read_scenario
from tdcr_fe.io.write_toml import robot_to_toml, scenario_to_toml
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot

#: A folder for each figure and for each table's robot. What the paper does not say is assumed in the files.
DATA = Path(__file__).parent / "data"

#: The models that are compared, in the paper's order; the paper's friction first, then the one with history.
MODELS: dict[str, Model] = {
    "classical": Model("continuous", "none"),
    "discrete": Model("straight", "none"),
    "per-tendon": Model("straight", "per-tendon"),
    "per-hole": Model("straight", "per-hole"),
}

#: By figure, labels of the steps that are the paper's own; the others lead there in small steps.
MARKED: dict[str, tuple[str, ...]] = {
    "fig3": ("pull 1.5 N", "0.05 N at the tip"),
    "fig4": ("pull 1.0 N", "0.2 N at the tip", "0.3 N at the tip", "0.4 N at the tip"),
    "fig5": ("pull 1.2 N", "0.4 N at the tip", "0.6 N at the tip", "0.8 N at the tip"),
    "fig6-sequence": ("1.1 N at the tip", "pull 0.3 N", "1.1 N at disk 7"),
    "fig6-loads": ("pull 1.5 N", "1 N at the tip", "1.5 N at the tip", "2 N at the tip", "2.5 N at the tip"),
}


def figure(name: str) -> Scenario:
    """Robot and loading sequence of one of `MARKED`."""
    return read_scenario(DATA / name / "scenario.toml")


def prototype(table: int) -> Robot:
    """The robot of Table 1, 2, 3 or 4 as the paper declares it (section 3.2)."""
    return read_robot(DATA / f"table{table}" / "robot.toml")


def write_cases(folder: str | os.PathLike[str]) -> list[Path]:
    """Write every figure, with every model, as files for ``tdcr-fe run``.

    Parameters
    ----------
    folder
        Receives one folder for each figure, with ``robot.toml`` and one ``MODEL.toml`` a model.

    Returns
    -------
    list of Path
        The scenarios.
    """
    written = []
    for name in MARKED:
        case = figure(name)
        write_text(robot_to_toml(case.robot), Path(folder) / name / "robot.toml")
        for key, model in MODELS.items():
            written.append(Path(folder) / name / f"{key}.toml")
            write_text(scenario_to_toml(model, list(case.steps)), written[-1])
    return written
