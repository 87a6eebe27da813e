"""Good input files and the commands that read them, small enough to be solved in a fraction of a second."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory


@dataclass(frozen=True)
class Inputs:
    """Good files, and the command that reads them."""

    name: str
    #: Arguments of ``tdcr-fe``; ``{}`` stands for the folder of the files. ``-o OUT`` is added.
    command: str
    files: Mapping[str, str]  # by name, those of ``data`` with their contents
    weight: int  # how often it is drawn, relative to the others
    optional: tuple[str, ...] = ()  # files without which the command can run


_PLAIN = {"robot.toml": "plain_robot.toml"}
_FILES = {"robot.toml": "robot.toml", "scenario.toml": "scenario.toml"}

#: All good inputs; those of `view` are solved when they are first needed.
INPUTS: tuple[Inputs, ...] = (
    Inputs("run", "run {}/scenario.toml -q --no-pictures", _FILES, weight=8),
    Inputs(
        "run, soft",
        "run {}/scenario.toml -q --no-pictures",
        {"robot.toml": "soft_robot.toml", "scenario.toml": "soft_scenario.toml"},
        weight=3,
    ),
    Inputs(
        "follow",
        "follow {}/robot.toml {}/path.csv --largest 2 --model {}/model.toml -q --no-pictures",
        {**_PLAIN, "path.csv": "path.csv", "model.toml": "model.toml"},
        weight=3,
    ),
    Inputs(
        "identify",
        "identify {} -q --processes 1",
        {**_PLAIN, **{name: name for name in ("loading.csv", "observations.csv", "model.toml")}},
        weight=5,
        optional=("model.toml",),
    ),
    Inputs("sweep", "sweep {}/sweep.toml --check", {**_FILES, "sweep.toml": "sweep.toml"}, weight=3),
    Inputs("sweep, grid", "sweep {}/sweep.toml --check", {**_FILES, "sweep.toml": "grid.toml"}, weight=2),
    Inputs("view", "view {}", {}, weight=2),
)

#: What `view` needs of the files that `run` writes.
_OF_VIEW = ("summary.json", "steps.csv", "shape.csv", "tensions.csv")


def files_of(inputs: Inputs) -> Mapping[str, bytes]:
    """Contents of the good files of an input."""
    if not inputs.files:
        return _results()
    data = files("tdcr_fe.validation.broken_files") / "data"
    return {name: (data / source).read_bytes() for name, source in inputs.files.items()}


def is_required(inputs: Inputs, file: str) -> bool:
    """Whether the command cannot run without a file."""
    return file not in inputs.optional if inputs.files else file in _OF_VIEW


@cache
def _results() -> dict[str, bytes]:
    """Tables that `tdcr-fe run` writes, for `tdcr-fe view`."""
    from tdcr_fe.io.result_files import write_results
    from tdcr_fe.io.toml import read_scenario
    from tdcr_fe.solve.simulate import simulate

    data = files("tdcr_fe.validation.broken_files") / "data"
    steps = "[[steps]]\ntensions = { t1 = 0.5 }\n[[steps]]\ntensions = { t2 = 0.5 }\n"
    with TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "robot.toml").write_bytes((data / "plain_robot.toml").read_bytes())
        (folder / "scenario.toml").write_text('robot = "robot.toml"\n' + steps, encoding="utf-8")
        given = read_scenario(folder / "scenario.toml")
        result = simulate(given.robot, given.model, given.steps).raise_if_failed()
        return {p.name: p.read_bytes() for p in write_results(result, folder / "out", pictures=False)}
