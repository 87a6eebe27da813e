"""Write input files: a description, of which nothing is left out, and commented files with every key to start from.

The latter are the templates of ``tdcr_fe/io/templates``; descriptions and defaults come from the keys.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from typing import Any

from tdcr_fe.effects import EFFECTS
from tdcr_fe.io.keys import BACKBONE, DISKS, ROBOT, tendon_keys
from tdcr_fe.model.channels import CHANNELS
from tdcr_fe.model.friction import FRICTION_COEFFICIENTS
from tdcr_fe.model.loading import LoadStep, Model, SolverSettings
from tdcr_fe.model.messages import as_toml, bare, options, quoted
from tdcr_fe.model.robot import Disks, Robot, SideSpring
from tdcr_fe.model.routing import ROUTINGS
from tdcr_fe.model.schema import REQUIRED, keys_of


def value_to_toml(value: Any) -> str:
    """A number, text, list, flat mapping or object of the description as TOML."""
    return as_toml(value, lambda x: value_to_toml(_table(x)) if is_dataclass(x) else str(x))


def to_toml(data: Mapping[str, Any]) -> str:
    """A file: keys with values first, then tables, and lists of tables of the description."""
    above, below = [], []
    for key, value in data.items():
        if isinstance(value, Mapping):
            below += ["", f"[{key}]", *_lines(value)]
        elif isinstance(value, list):
            below += [line for table in value for line in ("", f"[[{key}]]", *_lines(table))]
        else:
            above += _lines({key: value})
    return "\n".join([*above, *below]).lstrip("\n") + "\n"


def _lines(table: Mapping[str, Any]) -> list[str]:
    return [f"{bare(k)} = {value_to_toml(v)}" for k, v in table.items() if v is not None]


def _table(instance: Any) -> dict[str, Any]:
    """Fields of an object that are written to a file, without those that are None, empty, or zero by default."""
    keys = keys_of(type(instance))
    values = {name: getattr(instance, name) for name in keys}
    return {name: v for name, v in values.items() if not _is_nothing(v, keys.defaults.get(name, REQUIRED))}


def _is_nothing(value: Any, default: Any) -> bool:
    """None, empty, or zero by default."""
    zero = not any(value) if isinstance(value, tuple) else not value
    return zero and (value in (None, (), {}, "") or value == default)


def robot_to_toml(robot: Robot) -> str:
    """A robot as the text of a `robot.toml`, from which `tdcr_fe.io.toml.read_robot` makes an equal one.

    Raises
    ------
    ValueError
        The robot has what the file format cannot express, such as a user-defined routing; all of it is named.
    """
    foreign = []
    for i, t in enumerate(robot.tendons):
        for what, known in (("routing", ROUTINGS), ("friction", FRICTION_COEFFICIENTS)):
            part = getattr(t, what)
            if part is not None and known.get(part.kind) is not type(part):
                foreign.append(f"tendons[{i}].{what} ({part.kind})")
    if foreign:
        raise ValueError(f"robot {robot.name!r}: robot.toml cannot express {', '.join(foreign)}")
    data = {**_table(robot), "backbone": _table(robot.backbone), "disks": None}
    if robot.backbone.taper:
        data["backbone"]["radius"] = robot.backbone.taper
    if count := len(robot.disks.positions):
        data["disks"] = _table(robot.disks)
        if Disks.equally_spaced(count, robot.backbone.length).positions == robot.disks.positions:
            data["disks"] = {"count": count, **{k: v for k, v in data["disks"].items() if k != "positions"}}
    data["springs"] = [_table(spring) for spring in robot.springs]
    data["tendons"] = []
    for t in robot.tendons:
        own = _table(t)
        first = {"name": own.pop("name"), "routing": t.routing.kind, **_table(t.routing)}
        data["tendons"].append({**first, **own})
    return to_toml(data)


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
    solver = {} if settings is None else {"solver": _table(settings)}
    return to_toml({"model": _table(model), **solver, **({"effects": effects} if effects else {})})


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
    above, below = to_toml({"robot": robot}), to_toml({"steps": [*map(_table, steps)]})
    return f"{above}\n{model_to_toml(model, settings, effects)}\n{below}".rstrip("\n") + "\n"


# ----------------------------------------------------------------------------------------------- files to start from

#: Tables of the files.
_TABLES = {
    "robot": ROBOT,
    "backbone": BACKBONE,
    "disks": DISKS,
    "tendons": tendon_keys("parallel"),
    "springs": keys_of(SideSpring),
    "model": keys_of(Model),
    "solver": keys_of(SolverSettings),
    "steps": keys_of(LoadStep),
}
#: Examples of keys that describe what few robots have.
EXAMPLES = {
    "superelastic": "{ threshold_strain = 0.01, plateau_ratio = 0.1 }",
    "nonlinear": "{ quadratic = 0.0, cubic = -20.0 }",
    "patches": "[{ start = 0.05, end = 0.1, bending = 1.2 }]",
    "tight_holes": "[{ at = 0.1, drop = 0.05 }]",
    "friction": '{ kind = "stribeck", static = 0.3, kinetic = 0.2, stribeck_rate = 1e-3 }',
    "positions": "[0.05, 0.1, 0.15, 0.2]",
}


def _template_line(table: str, name: str, value: str | None = None) -> str:
    """A key with its description; commented out where no value is given."""
    keys = _TABLES[table]
    node, default = keys.json_schema["properties"][name], keys.defaults.get(name)
    note = node["description"]
    if texts := options(node):
        note += ("; one of " if "enum" in node else "; or ") + ", ".join(map(quoted, texts))
    text = f"{name} = {value}"
    if value is None:
        example = EXAMPLES.get(name, "...") if default in (None, ()) else value_to_toml(default)
        text = f"# {name} = {example}"
    return f"{text:<33} # {note}"


def _template_table(table: str, **given: str) -> str:
    """The lines of a table: the keys that are given first, then the others, commented out."""
    rest = {name: None for name in _TABLES[table] if name not in given}
    return "\n".join(_template_line(table, name, value) for name, value in {**given, **rest}.items())


def template(file: str, tendons: Sequence[str]) -> str:
    """An input file with every key.

    Parameters
    ----------
    file
        Name: ``robot.toml``, ``scenario.toml``, ``model.toml``, ``sweep.toml``, or ``NOTES.md`` of an experiment.
    tendons
        Names of the tendons, which are at equal angles.
    """
    from tdcr_fe.report.environment import environment

    chosen = environment(__package__).get_template(f"{file}.j2")
    text = chosen.render(
        tendons=tendons,
        line=_template_line,
        table=_template_table,
        routings={kind: list(keys_of(cls)) for kind, cls in ROUTINGS.items()},
        effects=[e.name for e in EFFECTS],
        channels=CHANNELS,
    )
    return text.rstrip("\n") + "\n"
