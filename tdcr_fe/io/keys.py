"""The keys of every table in the files, made from the annotated fields of the description; their JSON schema."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, Any, Literal

from tdcr_fe.effects import EFFECTS, Parameter
from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import LoadStep, Model, SolverSettings
from tdcr_fe.model.messages import quoted
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ROUTINGS
from tdcr_fe.model.schema import Checked, Keys, Quantity, all_keys_of, keys_of
from tdcr_fe.model.tendon import Tendon

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


@cache
def tendon_keys(routing: str | None) -> Keys:
    """Keys of ``[[tendons]]`` with that routing; if it is unknown, those of all routings, none of them required."""
    own, name = keys_of(Tendon), Literal[tuple(ROUTINGS)]
    allowed = "one of " + ", ".join(map(quoted, ROUTINGS))
    of_routing: dict[str, Any] = {
        "routing": Annotated[name, Quantity("where the holes lie", allowed=allowed)]
    }
    defaults: dict[str, Any] = {}
    for keys in [keys_of(cls) for kind, cls in ROUTINGS.items() if routing in (kind, None)]:
        of_routing |= keys
        defaults |= keys.defaults if routing else dict.fromkeys(keys)
    return Keys({"name": own["name"], **of_routing, **own}, {**defaults, **own.defaults})


@cache
def parameter_keys(parameters: tuple[Parameter, ...]) -> Keys:
    """Keys of the table of an effect, none of them required."""
    keys = {}
    for p in parameters:
        low, high = (None if math.isinf(x) else x for x in (p.lower, p.upper))
        keys[p.name] = Annotated[float, Quantity(p.meaning, p.unit, ge=low, le=high)]
    return Keys(keys, dict.fromkeys(keys))


@cache
def effect_keys(names: tuple[str, ...]) -> Keys:
    """Keys of the table ``[effects]``, each with the table of an effect."""
    return Keys(dict.fromkeys(names, Annotated[dict[str, Any], Quantity()]), dict.fromkeys(names))


_COUNT = Quantity("disks at equal distances, the last at the tip", ge=1, le=10_000)
#: Keys of ``[disks]``, of which exactly one of ``count`` and ``positions`` is given.
_POSITIONS = replace(
    *keys_of(Disks)["positions"].__metadata__,
    description="arc lengths of the disks, in place of count",
    min_items=1,
)
DISKS = Keys(
    {
        **keys_of(Disks),
        "count": Annotated[int, _COUNT],
        "positions": Annotated[tuple[float, ...], _POSITIONS],
    },
    {**keys_of(Disks).defaults, "count": None, "positions": None},
)
_RADIUS = "radius of the (round) cross-section, or pairs of arc length and radius from base to tip, linear in between"
_RADII = Annotated[float, Quantity(gt=0.0)] | tuple[tuple[float, float], ...]
#: Keys of ``[backbone]``; its radius may change along it.
BACKBONE = Keys(
    {**keys_of(Backbone), "radius": Annotated[_RADII, Quantity(_RADIUS, "m")]}, keys_of(Backbone).defaults
)


def _table(name: str, description: str, keys: str = "") -> Any:
    """A key with a table, which is read by keys of its own."""
    allowed = f"a table [{name}]" + f" with {keys}" * bool(keys)
    return Annotated[dict[str, Any], Quantity(description, allowed=allowed)]


def _tables(name: str, description: str, least: int = 0) -> Any:
    """A key with a list of tables, each of which is read by keys of its own."""
    allowed = f"tables [[{name}]]" + ", at least one" * bool(least)
    return Annotated[list[Any], Quantity(description, min_items=least, allowed=allowed)]


_ROBOT = all_keys_of(Robot)
_DISKS = "the rigid disks on it; without it tendons follow the backbone"
#: Keys at the top of ``robot.toml``.
ROBOT = Keys(
    {
        "name": _ROBOT["name"],
        **_ROBOT,
        "backbone": _table("backbone", "the elastic rod", "length, radius, youngs_modulus, poisson_ratio"),
        "disks": _table("disks", _DISKS, "count or positions"),
        "tendons": _tables("tendons", "one table per tendon"),
    },
    {**_ROBOT.defaults, "disks": None},
)
_SIGMA = "a number above zero [N, m or rad], or a table with one for every tendon"


@dataclass(frozen=True)
class InputErrors(Checked):
    """Independent errors of the inputs; the table ``[inputs]`` of measured data.

    Attributes
    ----------
    sigma : float or mapping of str to float
        Standard deviation of all inputs, or by tendon [N, m or rad].
    """

    sigma: Annotated[float | dict[str, float], Quantity(gt=0.0, allowed=_SIGMA)]


_SOLVER = "numerics of the quasi-static solver"
_SHARED = {
    "model": Annotated[Model, Quantity("how the robot is modelled", allowed="a table [model]")],
    "solver": Annotated[SolverSettings, Quantity(_SOLVER, allowed="a table [solver]")],
    "effects": _table("effects", "effects that the model includes, by name"),
}
#: Keys at the top of ``model.toml``; ``effects`` and ``inputs`` are those of measured data.
MODEL_FILE = Keys(
    {
        **_SHARED,
        "inputs": Annotated[InputErrors, Quantity("errors of the inputs", allowed="a table [inputs]")],
    },
    {"solver": SolverSettings(), "effects": {}, "inputs": None},
)
_PATH = "the path of a robot.toml, in quotes, relative to this file"
#: Keys at the top of ``scenario.toml``.
SCENARIO = Keys(
    {
        "robot": Annotated[str, Quantity("path of the robot.toml", allowed=_PATH)],
        **_SHARED,
        "steps": _tables("steps", "the loading sequence", least=1),
    },
    {"model": Model(), "solver": SolverSettings(), "effects": {}},
)


@cache
def _contents() -> dict[str, dict[str, Any]]:
    """JSON schemas of the tables that are read by keys of their own."""
    tendons = []
    for name in ROUTINGS:
        table = tendon_keys(name).json_schema
        kind = {"description": table["properties"]["routing"]["description"], "enum": [name]}
        tendons.append({**table, "properties": {**table["properties"], "routing": kind}})
    either = [{"required": ["count"]}, {"required": ["positions"]}]
    return {
        "steps": keys_of(LoadStep).json_schema,
        "backbone": BACKBONE.json_schema,
        "disks": {**DISKS.json_schema, "oneOf": either},
        "tendons": {"type": "object", "oneOf": tendons},
        "effects": _effects_schema(),
    }


def _effects_schema() -> dict[str, Any]:
    """Of the table ``[effects]``: by name of the effect, a table of its parameters."""
    properties: dict[str, dict[str, Any]] = {}
    for effect in EFFECTS:
        table = {**parameter_keys(tuple(effect.parameters)).json_schema, "description": effect.description}
        # Numbers of single tendons or markers, whose names the schema does not know.
        for name, p in effect.further_parameters.items():
            further = table.setdefault("patternProperties", {})
            further[name] = parameter_keys((p,)).json_schema["properties"][p.name]
        properties[effect.name] = table
    return {"type": "object", "properties": properties, "additionalProperties": False}


def json_schema(file: Literal["robot", "scenario", "model"]) -> dict[str, Any]:
    """JSON schema (draft 2020-12) of ``robot.toml``, ``scenario.toml`` or ``model.toml``.

    Conditions between keys, such as holes within the disks, are checked only when the file is read.

    Raises
    ------
    ValueError
        There is no such file.
    """
    keys = {"robot": ROBOT, "scenario": SCENARIO, "model": MODEL_FILE}
    if file not in keys:
        raise ValueError(f"no schema of {file!r}; there are {', '.join(keys)}")
    schema, contents = keys[file].json_schema, _contents()
    nodes = {name: dict(node) for name, node in schema["properties"].items()}
    for name in nodes.keys() & contents.keys():
        inner = contents[name] if nodes[name]["type"] == "object" else {"items": contents[name]}
        nodes[name] |= inner
    return {**schema, "properties": nodes, "$schema": _DIALECT, "title": f"{file}.toml of tdcr_fe"}
