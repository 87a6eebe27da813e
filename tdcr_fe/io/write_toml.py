"""Write `robot.toml`, `scenario.toml` and `model.toml`; nothing of the description is left out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from typing import Any

from tdcr_fe.model.friction import FRICTION_COEFFICIENTS
from tdcr_fe.model.loading import LoadStep, Model, SolverSettings
from tdcr_fe.model.messages import bare, quoted
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ROUTINGS
from tdcr_fe.model.schema import REQUIRED, keys_of


def value_to_toml(value: Any) -> str:
    """A number, text, list, flat mapping or object of the description as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, Mapping):
        pairs = ", ".join(f"{bare(k)} = {value_to_toml(v)}" for k, v in value.items())
        return f"{{ {pairs} }}" if pairs else "{}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(value_to_toml(v) for v in value) + "]"
    if is_dataclass(value):
        return value_to_toml(_table(value))
    return repr(int(value)) if isinstance(value, int) else repr(float(value))


def _table(instance: Any) -> dict[str, Any]:
    """Fields of an object that are written to a file, without those that are None, empty, or zero by default."""
    keys = keys_of(type(instance))
    values = {name: getattr(instance, name) for name in keys}
    return {name: v for name, v in values.items() if not _is_nothing(v, keys.defaults.get(name, REQUIRED))}


def _is_nothing(value: Any, default: Any) -> bool:
    if isinstance(value, tuple | Mapping | str) and len(value) == 0:
        return True
    zero = not any(value) if isinstance(value, tuple) else not value
    return value is None or (value == default and zero)


def _lines(table: Mapping[str, Any]) -> list[str]:
    return [f"{bare(k)} = {value_to_toml(v)}" for k, v in table.items() if v is not None]


def robot_to_toml(robot: Robot) -> str:
    """A robot as the text of a `robot.toml`, from which `tdcr_fe.io.toml.read_robot` makes an equal one.

    Raises
    ------
    ValueError
        The robot has what the file format cannot express, such as a user-defined routing; all of it is named.
    """
    foreign = [
        f"tendons[{i}].routing ({t.routing.kind})"
        for i, t in enumerate(robot.tendons)
        if ROUTINGS.get(t.routing.kind) is not type(t.routing)
    ]
    foreign += [
        f"tendons[{i}].friction ({t.friction.kind})"
        for i, t in enumerate(robot.tendons)
        if t.friction is not None and FRICTION_COEFFICIENTS.get(t.friction.kind) is not type(t.friction)
    ]
    if foreign:
        raise ValueError(f"robot {robot.name!r}: robot.toml cannot express {', '.join(foreign)}")
    backbone, disks = _table(robot.backbone), _table(robot.disks)
    if robot.backbone.taper:
        backbone["radius"] = robot.backbone.taper
    count = len(robot.disks.positions)
    if count and Disks.equally_spaced(count, robot.backbone.length).positions == robot.disks.positions:
        disks = {"count": count, **{k: v for k, v in disks.items() if k != "positions"}}
    lines = _lines(
        {"name": robot.name, "tip_mass": robot.tip_mass or None, "base_stiffness": robot.base_stiffness}
    )
    lines += ["", "[backbone]", *_lines(backbone)]
    if count:
        lines += ["", "[disks]", *_lines(disks)]
    for spring in robot.springs:
        lines += ["", "[[springs]]", *_lines(_table(spring))]
    for tendon in robot.tendons:
        own = _table(tendon)
        first = {"name": own.pop("name"), "routing": tendon.routing.kind}
        lines += ["", "[[tendons]]", *_lines({**first, **tendon.routing.to_table(), **own})]
    return "\n".join(lines) + "\n"


def model_to_toml(
    model: Model,
    settings: SolverSettings | None = None,
    effects: Mapping[str, Mapping[str, float]] | None = None,
) -> str:
    """A model, and solver settings, as the text of a `model.toml`; `tdcr_fe.io.toml.read_model` gives equal ones.

    Parameters
    ----------
    model, settings, effects
        Description to write; None leaves out the tables `[solver]` and `[effects]`.
    """
    lines = ["[model]", *_lines(_table(model))]
    if settings is not None:
        lines += ["", "[solver]", *_lines(_table(settings))]
    if effects:
        lines += ["", "[effects]", *_lines(effects)]
    return "\n".join(lines) + "\n"


def scenario_to_toml(
    model: Model,
    steps: Iterable[LoadStep],
    robot: str = "robot.toml",
    settings: SolverSettings | None = None,
    effects: Mapping[str, Mapping[str, float]] | None = None,
) -> str:
    """Model, solver settings, effects and loading sequence as the text of a `scenario.toml`.

    Parameters
    ----------
    model, steps
        Description to write.
    robot
        Path of the `robot.toml`, relative to where the scenario will lie.
    settings
        None leaves out the table `[solver]`.
    effects
        By name, values of their parameters; None leaves out the table `[effects]`.
    """
    steps = list(steps)
    lines = [f"robot = {value_to_toml(robot)}", "", model_to_toml(model, settings).rstrip()]
    if effects is not None:
        lines += ["", "[effects]", *_lines(effects)]
    for step in steps:
        lines += ["", "[[steps]]", *_lines(_table(step))]
    return "\n".join(lines) + "\n"
