"""Read `robot.toml`, `scenario.toml` and `model.toml` into the frozen description.

All mistakes in the files are found in one pass and reported with file, key, value and what is allowed. The allowed
values of a key are annotations of the field of the description, see `tdcr_fe.model.schema`.
"""

from __future__ import annotations

import hashlib
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_fe.effects import EFFECTS, Effect, Experiment
from tdcr_fe.io.files import InputError, Problem, Reporter, StrPath, decoded, read_bytes, refusal
from tdcr_fe.io.keys import BACKBONE, DISKS, MODEL_FILE, ROBOT, SCENARIO, tendon_keys
from tdcr_fe.io.user_effects import apply_effects
from tdcr_fe.model import checks
from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.checks import ARC_TOLERANCE, Contradiction
from tdcr_fe.model.loading import LoadStep, Model, SolverSettings
from tdcr_fe.model.messages import shown
from tdcr_fe.model.robot import Disks, Robot, Tendon
from tdcr_fe.model.routing import ROUTINGS
from tdcr_fe.model.schema import FieldError, keys_of


@dataclass(frozen=True)
class Scenario:
    """Contents of a `scenario.toml` and of the `robot.toml` that it names.

    Attributes
    ----------
    robot : Robot
    model : Model
    steps : tuple of LoadStep
    path : pathlib.Path
        Path of the scenario.
    robot_path : pathlib.Path
    digests : mapping of str to str
        SHA-256 of both files, in hexadecimal, by file name as the user named it.
    settings : SolverSettings
        The ``[solver]`` table.
    ends : tuple of int
        For every load step of the file, the number from 1 of that of ``steps`` with which it ends: effects may divide
        load steps.
    """

    robot: Robot
    model: Model
    steps: tuple[LoadStep, ...]
    path: Path
    robot_path: Path
    digests: Mapping[str, str] = field(default_factory=dict)
    settings: SolverSettings = field(default_factory=SolverSettings)
    ends: tuple[int, ...] = ()


# ----------------------------------------------------------------------------------------------- the robot


@dataclass(frozen=True)
class RobotParts:
    """The valid parts of a robot: enough to check a scenario against it."""

    robot: Robot | None = None
    length: float | None = None  # of the backbone [m]
    names: tuple[str, ...] | None = None  # of the tendons
    tendons: tuple[Tendon, ...] = ()  # those that are valid


def _build_robot(data: dict[str, Any], reporter: Reporter) -> RobotParts:
    if {"robot", "steps"} & data.keys():
        name = data.get("robot", "the robot.toml")
        raise refusal(reporter.file, f"is the file of a scenario; give its robot, {name}")
    before = len(reporter.problems)
    top, bad = ROBOT.read(data, "", reporter)
    backbone, length = _build_backbone(top["backbone"], reporter) if "backbone" in top else (None, None)
    disks = _build_disks(top["disks"], length, reporter) if "disks" in top else None
    tables = top.get("tendons", ())
    built = [_build_tendon(i, table, disks, length, reporter) for i, table in enumerate(tables)]
    tendons = tuple(tendon for tendon, _ in built if tendon is not None)
    names = tuple(name for _, name in built if name is not None)
    reporter.contradictions(checks.name_contradictions(names))
    if length is not None:
        reporter.contradictions(checks.spring_contradictions(top.get("springs", ()), length))
    robot = None
    if len(reporter.problems) == before and backbone is not None and disks is not None:
        robot = Robot(**{**top, "backbone": backbone, "disks": disks, "tendons": tendons})
    known = "tendons" not in bad and len(set(names)) == len(tables)
    return RobotParts(robot, length, names if known else None, tendons)


def _build_backbone(data: Any, reporter: Reporter) -> tuple[Backbone | None, float | None]:
    """The backbone, None where it is invalid; and its length [m]."""
    values, bad = BACKBONE.read(data, "backbone", reporter)
    length = values.get("length")
    if bad:
        return None, length
    if isinstance(taper := values["radius"], tuple):
        values |= {"radius": taper[0][1], "taper": taper}
    backbone = Backbone(**values)
    reporter.contradictions(checks.backbone_contradictions(backbone))
    return backbone, length


def _build_disks(data: dict[str, Any] | None, length: float | None, reporter: Reporter) -> Disks | None:
    """The disks; None where they, or their positions on a backbone of that length [m], are invalid."""
    if data is None:
        return Disks()
    values, bad = DISKS.read(data, "disks", reporter)
    given = {key: data[key] for key in ("count", "positions") if key in data}
    if len(given) != 1:
        reporter("disks", shown(given) if given else "", "must have exactly one of count and positions")
    if bad or length is None or len(given) != 1:
        return None
    if (count := values.pop("count")) is not None:
        values["positions"] = Disks.equally_spaced(count, length).positions
    disks = Disks(**values)
    found = [*checks.disk_contradictions(disks, length)]
    reporter.contradictions(found)
    return None if any(c.key.startswith("disks.positions") for c in found) else disks


def _build_tendon(
    i: int, data: Any, disks: Disks | None, length: float | None, reporter: Reporter
) -> tuple[Tendon | None, str | None]:
    """A tendon, None where it is invalid; and its name, None where that is invalid."""
    key, kind = f"tendons[{i}]", data.get("routing") if isinstance(data, dict) else None
    routing = ROUTINGS.get(kind) if isinstance(kind, str) else None

    values, bad = tendon_keys(kind if routing else None).read(data, key, reporter)
    name = values.get("name")
    if routing is None or bad or disks is None or length is None:
        return None, name
    end = length if values["end"] is None else values["end"]
    arcs = (0.0, *(s for s in disks.positions if s <= end + ARC_TOLERANCE))
    if not disks.positions:  # a tendon that follows the backbone: points at equal distances
        arcs = tuple(np.linspace(0.0, end, max(len(values.get("holes", ())), 2)).tolist())
    found = [*checks.end_contradictions(i, values["end"], disks, length)]
    if not found:
        own = {name: values.pop(name) for name in keys_of(routing)}
        try:
            values["routing"] = routing.from_table(own, arcs)
            tendon = Tendon(**values)
            found = [*checks.tendon_contradictions(i, tendon, disks, length)]
        except FieldError as error:
            found = [Contradiction(f"{key}.{error.field}", error.value, error.allowed)]
    reporter.contradictions(found)
    return (None if found else tendon), name


# ---------------------------------------------------------------------------------------- model and loading


def _with_default_model(data: dict[str, Any], robot: Robot | None) -> dict[str, Any]:
    """A file with what its table ``[model]`` leaves out, where that is other for the robot than for most."""
    table = data.get("model", {})
    if robot is None or not robot.without_disks or not isinstance(table, dict):
        return data
    default = Model.default_for(robot)
    table = {"tendon_path": default.tendon_path, **table}
    if table["tendon_path"] == default.tendon_path:
        table = {"friction": default.friction, **table}
    return {**data, "model": table}


def _build_step(i: int, data: Any, parts: RobotParts, reporter: Reporter) -> LoadStep:
    """A load step, without what is invalid in it."""
    step = LoadStep(**keys_of(LoadStep).read(data, f"steps[{i}]", reporter)[0])
    reporter.contradictions(checks.step_contradictions(i, step, parts.names, parts.length, parts.tendons))
    return step


# --------------------------------------------------------------------------------------------------- reading


def read_toml(path: StrPath, named: Problem | None = None) -> tuple[dict[str, Any], str]:
    """Contents of a TOML file, and its SHA-256 in hexadecimal.

    Parameters
    ----------
    path
        Path of the file.
    named
        The key of another file that names this one; a missing file is reported there.

    Raises
    ------
    InputError
        It cannot be read, or is not TOML.
    """
    raw = read_bytes(Path(path), named)
    try:
        data = tomllib.loads(decoded(raw, path, "not UTF-8; save the file as UTF-8"))
    except tomllib.TOMLDecodeError as error:
        reason, _, where = str(error).partition(" (at ")
        hint = "; write a decimal point" if re.search(rb"=\s*[+-]?\d+,\d", raw) else ""
        twice = r"[\1] is there twice; lists of tables are written [[\1]]"
        reason = re.sub(r"Cannot declare \('(\w+)',\) twice", twice, reason)
        reason = reason.replace("Cannot overwrite a value", "the key is there already")
        key, reason = where.rstrip(")"), f"not TOML: {reason}{hint}"
    except (ValueError, RecursionError) as error:
        key, reason = "", f"not TOML that can be read: {str(error).partition(';')[0]}"
    else:
        return data, hashlib.sha256(raw).hexdigest()
    raise refusal(path, reason, key)


def digest(path: StrPath) -> str:
    """SHA-256 of a file, in hexadecimal."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def read_robot(path: StrPath) -> Robot:
    """Read `robot.toml`.

    Raises
    ------
    InputError
        With every mistake in the file.
    """
    data, _ = read_toml(path)
    reporter = Reporter(str(path))
    robot = _build_robot(data, reporter).robot
    if reporter.problems or robot is None:
        raise InputError(reporter.problems)
    return robot


def read_model(path: StrPath, robot: Robot | None = None) -> Model:
    """Read the model of a `model.toml`; `read_model_file` gives its solver settings, too.

    Parameters
    ----------
    path
        Path of the file.
    robot
        Whose model it is; one without disks has other defaults.

    Raises
    ------
    InputError
        With every mistake in the file.
    """
    return read_model_file(path, robot)[0]


def read_model_file(path: StrPath | None, robot: Robot | None = None) -> tuple[Model, SolverSettings]:
    """Read the tables `[model]` and `[solver]` of a `model.toml`.

    The tables `[effects]` and `[inputs]` are refused: they belong to a folder of measured data.

    Parameters
    ----------
    path
        Path of the file; None: there is none, so that all has its defaults.
    robot
        Whose model it is; one without disks has other defaults.

    Returns
    -------
    Model, SolverSettings
        Defaults where a key, or the table `[solver]`, is not there.

    Raises
    ------
    InputError
        With every mistake in the file.
    """
    tables = read_model_tables(path, robot)
    if of_data := [name for name in ("effects", "inputs") if tables[name]]:
        raise refusal(path or "", "only in a folder of measured data; leave it out", of_data[0])
    return tables["model"], tables["solver"]


def read_model_tables(path: StrPath | None, robot: Robot | None) -> dict[str, Any]:
    """The tables of a `model.toml` by name, see `read_model_file`; also those of measured data, effects and inputs."""
    if path is None:
        return {**MODEL_FILE.defaults, "model": Model() if robot is None else Model.default_for(robot)}
    data, _ = read_toml(path)
    reporter = Reporter(str(path))
    top, _ = MODEL_FILE.read(_with_default_model(data, robot), "", reporter)
    if robot is not None and "model" in top:
        reporter.contradictions(checks.course_contradictions(robot, top["model"]))
    reporter.refuse()
    return top


@dataclass(frozen=True)
class ScenarioTables:
    """Tables of a `scenario.toml` and of the `robot.toml` that it names, as they stand there.

    Attributes
    ----------
    scenario : dict
    robot : dict or None
        None where the robot could not be read.
    path, robot_path : pathlib.Path
    digests : mapping of str to str
        SHA-256 of both files, in hexadecimal, by file name as the user named it.
    problems : tuple of Problem
        Why the robot could not be read.
    """

    scenario: dict[str, Any]
    robot: dict[str, Any] | None
    path: Path
    robot_path: Path
    digests: Mapping[str, str] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()


def read_scenario_tables(path: StrPath, named: Problem | None = None) -> ScenarioTables:
    """Tables of a `scenario.toml` and of the robot that it names; their contents are not checked.

    Parameters
    ----------
    path, named
        See `read_toml`.

    Raises
    ------
    InputError
        The scenario cannot be read, or is not TOML.
    """
    scenario, sha256 = read_toml(path, named)
    path = Path(path)
    digests, name = {str(path): sha256}, scenario.get("robot")
    if not isinstance(name, str):
        return ScenarioTables(scenario, None, path, path, digests)
    robot_path = path.parent / name
    try:
        robot, digests[str(robot_path)] = read_toml(robot_path, Problem(str(path), "robot", shown(name), ""))
    except InputError as error:
        return ScenarioTables(scenario, None, path, robot_path, digests, error.problems)
    return ScenarioTables(scenario, robot, path, robot_path, digests)


def read_scenario(path: StrPath, effects: Sequence[Effect] = ()) -> Scenario:
    """Read `scenario.toml` and the `robot.toml` that it names.

    Parameters
    ----------
    path
        Path of the scenario.
    effects
        Effects of your own, besides the listed ones; see `tdcr_fe.io.user_effects.read_own_effects`.

    Raises
    ------
    InputError
        With every mistake in both files.
    """
    return build_scenario(read_scenario_tables(path), effects)


def build_scenario(tables: ScenarioTables, effects: Sequence[Effect] = ()) -> Scenario:
    """The scenario that the tables of its files describe; see `read_scenario`.

    Raises
    ------
    InputError
        With every mistake in both files.
    """
    problems: list[Problem] = []
    data = tables.scenario
    if "backbone" in data and not {"robot", "steps"} & data.keys():
        raise refusal(tables.path, "is the file of a robot; give the scenario.toml that names it")
    parts = RobotParts()
    if tables.robot is not None:
        parts = _build_robot(tables.robot, Reporter(str(tables.robot_path), problems))
    problems += tables.problems
    robot, reporter = parts.robot, Reporter(str(tables.path), problems)
    top, _ = SCENARIO.read(_with_default_model(data, robot), "", reporter)
    model = top.get("model")
    steps = tuple(_build_step(i, table, parts, reporter) for i, table in enumerate(top.get("steps", ())))
    reporter.contradictions(checks.time_contradictions([s.time for s in steps]))
    if robot is not None and model is not None:
        reporter.contradictions(checks.course_contradictions(robot, model))
    if problems or robot is None or model is None:
        raise InputError(problems)
    changed = _with_effects(top["effects"], Experiment(robot, model, steps), reporter, effects)
    robot, model, steps = changed.robot, changed.model, changed.steps
    reporter.contradictions(checks.size_contradictions(robot, model, len(steps)))
    reporter.refuse()
    paths, ends = (tables.path, tables.robot_path), tuple(j + 1 for j in changed.whole_steps)
    return Scenario(robot, model, steps, *paths, tables.digests, top["solver"], ends)


def _with_effects(
    table: Any, experiment: Experiment, reporter: Reporter, own: Sequence[Effect]
) -> Experiment:
    """The experiment with the table ``[effects]``."""
    sound, changed = apply_effects(table, experiment, reporter, own)
    if changed.observation != experiment.observation:
        names = " and ".join(e.name for e in (*EFFECTS, *own) if e.name in sound and e.is_of_reading)
        text = "acts on the measurement only; the results of a run are those of the robot itself"
        reporter("effects", names, text)
    return changed
