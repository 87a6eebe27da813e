"""The keys of every table in the files, made from the annotated fields of the description; their JSON schema."""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any, Literal

from tdcr_fe.effects import EFFECTS, Parameter
from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import LoadStep, Model, SolverSettings
from tdcr_fe.model.messages import quoted
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ROUTINGS
from tdcr_fe.model.schema import Keys, Quantity, all_keys_of, keys_of
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.model.units import PATTERN, has_unit

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


@cache
def tendon_keys(routing: str | None) -> Keys:
    """Keys of ``[[tendons]]`` with that routing; if it is unknown, those of all routings, none of them required."""
    own = keys_of(Tendon)
    name = Literal[tuple(ROUTINGS)]  # type: ignore[valid-type]
    allowed = "one of " + ", ".join(map(quoted, ROUTINGS))
    first: dict[str, Any] = {
        "name": own["name"],
        "routing": Annotated[name, Quantity("where the tendon's holes lie", allowed=allowed)],
    }
    keys: dict[str, Any] = {}
    defaults: dict[str, Any] = {}
    for each in ROUTINGS.values() if routing is None else [ROUTINGS[routing]]:
        keys |= dict(keys_of(each))
        defaults |= dict.fromkeys(keys_of(each)) if routing is None else keys_of(each).defaults
    return Keys({**first, **keys, **own, "name": own["name"]}, {**defaults, **own.defaults})


def routings_with(key: str) -> list[str]:
    """Names of the routings that have a key."""
    return [name for name, r in ROUTINGS.items() if key in keys_of(r)]


def _tendon_schema() -> dict[str, Any]:
    """One alternative a routing."""
    options = []
    for name in ROUTINGS:
        table = tendon_keys(name).json_schema
        kind = {"description": table["properties"]["routing"]["description"], "enum": [name]}
        options.append({**table, "properties": {**table["properties"], "routing": kind}})
    return {"type": "object", "oneOf": options}


_POSITIONS = Quantity(
    "arc lengths of the disks",
    "m",
    gt=0.0,
    min_items=1,
    allowed="arc lengths of the disks [m], at least one, ascending from above 0 to at most the length",
)
#: Keys of ``[disks]``, of which exactly one of ``count`` and ``positions`` is given.
_COUNT = Quantity("disks at equal distances, the last at the tip", ge=1, le=10_000)
DISKS = Keys({"count": Annotated[int, _COUNT]}, {"count": None}).with_keys(
    {**keys_of(Disks), "positions": Annotated[tuple[float, ...], _POSITIONS]},
    **{**keys_of(Disks).defaults, "positions": None},
)


def _disks_schema() -> dict[str, Any]:
    return {**DISKS.json_schema, "oneOf": [{"required": ["count"]}, {"required": ["positions"]}]}


_RADIUS = "radius of the (round) cross-section, or pairs of arc length and radius from base to tip"
#: Keys of ``[backbone]``; its radius may change along it.
BACKBONE = keys_of(Backbone).with_keys(
    {
        "radius": Annotated[
            Annotated[float, Quantity(_RADIUS, gt=0.0)] | tuple[tuple[float, float], ...],
            Quantity(_RADIUS, unit="m"),
        ]
    }
)
_BACKBONE = Quantity(
    "the elastic rod",
    allowed="a table [backbone] with length, radius, youngs_modulus, poisson_ratio",
    contents=lambda: BACKBONE.json_schema,
)
_DISKS = Quantity(
    "the rigid disks on it; without it tendons follow the backbone",
    allowed="a table [disks] with count or positions",
    contents=_disks_schema,
)
_TENDONS = Quantity("one table per tendon", allowed="tables [[tendons]]", contents=_tendon_schema)
_MODEL = Quantity(
    "how the robot is modelled", allowed="a table [model]", contents=lambda: keys_of(Model).json_schema
)
_SOLVER = Quantity(
    "numerics of the quasi-static solver",
    allowed="a table [solver]",
    contents=lambda: keys_of(SolverSettings).json_schema,
)
_STEPS = Quantity(
    "the loading sequence",
    min_items=1,
    allowed="tables [[steps]], at least one",
    contents=lambda: keys_of(LoadStep).json_schema,
)
_PATH = Quantity(
    "path of the robot.toml", allowed="the path of a robot.toml, in quotes, relative to this file"
)
_TABLE, _TABLES = dict[str, Any], list[Any]
_ROBOT = all_keys_of(Robot)

#: Keys at the top of ``robot.toml``.
ROBOT = Keys(
    {
        "name": _ROBOT["name"],
        "backbone": Annotated[_TABLE, _BACKBONE],
        "disks": Annotated[_TABLE, _DISKS],
        "tip_mass": _ROBOT["tip_mass"],
        "tendons": Annotated[_TABLES, _TENDONS],
        "springs": _ROBOT["springs"],
        "base_stiffness": _ROBOT["base_stiffness"],
    },
    {**_ROBOT.defaults, "disks": None},
)
#: Keys at the top of ``model.toml``.
MODEL_FILE = Keys({"model": Annotated[_TABLE, _MODEL], "solver": Annotated[_TABLE, _SOLVER]}, {"solver": {}})
#: Keys at the top of ``scenario.toml``, without those of `tdcr_fe.io.user_effects`.
SCENARIO = Keys({"robot": Annotated[str, _PATH]}).with_keys(
    {**MODEL_FILE, "steps": Annotated[_TABLES, _STEPS]}, model={}, solver={}
)


def _effects_schema() -> dict[str, Any]:
    """Of the table ``[effects]``: by name of the effect, a table of its parameters."""
    properties: dict[str, dict[str, Any]] = {}
    for effect in EFFECTS:
        properties[effect.name] = {
            "type": "object",
            "description": effect.description,
            "properties": {p.name: _number_schema(p) for p in effect.parameters},
            "additionalProperties": False,
        }
        # Numbers of single tendons or markers, whose names the schema does not know.
        further = {name: _number_schema(p) for name, p in effect.further_parameters.items()}
        if further:
            properties[effect.name]["patternProperties"] = further
    description = "effects that the model includes, by name"
    return {
        "type": "object",
        "description": description,
        "properties": properties,
        "additionalProperties": False,
    }


def _number_schema(p: Parameter) -> dict[str, Any]:
    """Of one parameter."""
    bounds = {"minimum": p.lower, "maximum": p.upper}
    finite = {k: v for k, v in bounds.items() if abs(v) != float("inf")}
    text = {"type": ["number", "string"], "unit": p.unit, "pattern": PATTERN}
    kind = text if has_unit(p.unit) else {"type": "number"}
    return {**kind, "description": f"{p.meaning} [{p.unit}]", **finite}


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
    schema = {**keys[file].json_schema, "$schema": _DIALECT, "title": f"{file}.toml of tdcr_fe"}
    if file in ("scenario", "model"):
        schema["properties"] = {**schema["properties"], "effects": _effects_schema()}
    return schema
