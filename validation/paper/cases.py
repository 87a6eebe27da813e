"""The paper's robots and scenarios as packaged files, and functions that read them."""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path

from tdcr_fe.io.atomic import write_text
from tdcr_fe.io.toml import read_robot, read_scenario
from tdcr_fe.io.write_toml import robot_to_toml, scenario_to_toml
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.robot import Robot

_PACKAGE = "tdcr_fe.validation.paper"

#: The models that are compared, in the paper's order; the paper's friction first, then the one with history.
MODELS: dict[str, Model] = {
    "classical": Model("continuous", "none"),
    "discrete": Model("straight", "none"),
    "per-tendon": Model("straight", "per-tendon"),
    "per-hole": Model("straight", "per-hole"),
}

#: Names of the models in figures and tables.
MODEL_NAMES: dict[str, str] = {
    "classical": "classical, continuous",
    "discrete": "discrete, no friction",
    "per-tendon": "discrete, friction per tendon (the paper's)",
    "per-hole": "discrete, friction per hole",
}


@dataclass(frozen=True)
class PaperCase:
    """A figure of the paper as a robot and a loading sequence."""

    id: str  # name of its folder
    title: str
    assumed: str  # assumption where the paper is silent
    marked: tuple[
        str, ...
    ]  # labels of the steps that are the paper's own; the others lead there in small steps
    robot: Robot
    steps: tuple[LoadStep, ...]


_FIGURES = {
    "fig3": (
        "Fig. 3: single segment, 1.5 N, load at the tip",
        "Load of 0.05 N (that of Table 1) along +y, across the plane of bending.",
        ("pull 1.5 N", "0.05 N at the tip"),
    ),
    "fig4": (
        "Fig. 4: two segments, 1 N, 0.2 to 0.4 N at the tip",
        "The first tendon of each segment pulls; the load acts along +y; tendons of the second segment are turned "
        "by 60 degrees.",
        ("pull 1.0 N", "0.2 N at the tip", "0.3 N at the tip", "0.4 N at the tip"),
    ),
    "fig5": (
        "Fig. 5: one helical tendon, 720 degrees, 1.2 N, 0.4 to 0.8 N along y at the tip",
        "The tendon winds right-handed from +x.",
        ("pull 1.2 N", "0.4 N at the tip", "0.6 N at the tip", "0.8 N at the tip"),
    ),
    "fig6-sequence": (
        "Fig. 6: converging tendon, the three-step loading sequence",
        "The third step, 'a subsequent X-axis concentrated load', acts on the seventh disk, besides the first.",
        ("1.1 N at the tip", "pull 0.3 N", "1.1 N at disk 7"),
    ),
    "fig6-loads": (
        "Fig. 6a: converging tendon, 1.5 N, 1.0 to 2.5 N along x at the tip",
        "The load acts along +x, in the plane of the tendon.",
        ("pull 1.5 N", "1 N at the tip", "1.5 N at the tip", "2 N at the tip", "2.5 N at the tip"),
    ),
}

#: Every packaged figure.
CASE_IDS = tuple(_FIGURES)


def paper_case(case: str) -> PaperCase:
    """One figure of the paper.

    Parameters
    ----------
    case
        One of `CASE_IDS`.

    Raises
    ------
    KeyError
        There is no such case; those that exist are named.
    """
    if case not in _FIGURES:
        raise KeyError(f"no case {case!r}; there are {', '.join(CASE_IDS)}")
    title, assumed, marked = _FIGURES[case]
    with as_file(files(_PACKAGE) / "data" / case) as folder:
        scenario = read_scenario(folder / "scenario.toml")
    return PaperCase(case, title, assumed, marked, scenario.robot, tuple(scenario.steps))


def prototype(table: int) -> Robot:
    """The robot of Table 1, 2, 3 or 4 as the paper declares it (section 3.2)."""
    with as_file(files(_PACKAGE) / "data" / f"table{table}" / "robot.toml") as path:
        return read_robot(path)


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
    for name in CASE_IDS:
        case = paper_case(name)
        place = Path(folder) / name
        place.mkdir(parents=True, exist_ok=True)
        write_text(robot_to_toml(case.robot), place / "robot.toml")
        for key, model in MODELS.items():
            path = place / f"{key}.toml"
            write_text(scenario_to_toml(model, case.steps), path)
            written.append(path)
    return written
