"""Contents of a sweep given in Python, where robot, model and load steps may be objects."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any

from tdcr_fe.io.write_toml import model_to_toml, robot_to_toml, scenario_to_toml
from tdcr_fe.model.loading import LoadStep, Model, SolverSettings
from tdcr_fe.model.robot import Robot

#: What stands in the scenario for a robot that has no file.
OBJECT = "(robot given in Python)"


def as_tables(source: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """The contents as `sweep.toml` would have them, and the tables of the robot where it is an object.

    Parameters
    ----------
    source
        Contents of a `sweep.toml`. ``robot`` may be a `Robot`, ``model`` a `Model`, ``solver`` a `SolverSettings`, and
        ``steps`` may be `LoadStep` objects.

    Raises
    ------
    ValueError
        The robot has what the file format cannot express.
    """
    data, robot = dict(source), None
    if isinstance(data.get("robot"), Robot):
        robot = tomllib.loads(robot_to_toml(data["robot"]))
        data["robot"] = OBJECT
    if isinstance(data.get("model"), Model):
        data["model"] = tomllib.loads(model_to_toml(data["model"])).get("model", {})
    if isinstance(data.get("solver"), SolverSettings):
        data["solver"] = tomllib.loads(model_to_toml(Model(), data["solver"])).get("solver", {})
    steps = data.get("steps")
    if isinstance(steps, list | tuple):
        data["steps"] = [_step(s) if isinstance(s, LoadStep) else s for s in steps]
    return data, robot


def _step(step: LoadStep) -> Any:
    (table,) = tomllib.loads(scenario_to_toml(Model(), [step]))["steps"]
    return table
