"""The keys of every table in the files, made from the annotated fields of the description; their JSON schema."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, Any, Literal

from tdcr_fe.effects import EFFECTS, Parameter
from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import LoadStep, Model, SolverSettings
from tdcr_fe.model.messages import quoted
from tdcr_fe.model.robot import Disks, Robot, Tendon
from tdcr_fe.model.routing import ROUTINGS
from tdcr_fe.model.schema import Checked, Keys, Quantity, all_keys_of, keys_of

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


@cache
def tendon_keys(routing: str | None) -> Keys:
    """Keys of ``[[tendons]]`` with that routing; if it is unknown, those of all routings, none of them required."""
    own, name = keys_of(Tendon), Literal[tuple(ROUTINGS)]
    kind = Quantity("where the holes lie", allowed="one of " + ", ".join(map(quoted, ROUTINGS)))
    of_routing: dict[str, Any] = {"routing": Annotated[name, kind]}
    defaults: dict[str, Any] = {}
    for keys in [keys_of(cls) for known, cls in ROUTINGS.items() if routing in (known, None)]:
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
(_OF_DISKS,) = keys_of(Disks)["positions"].__metadata__
_POSITIONS = replace(_OF_DISKS, description="arc lengths of the disks, in place of count", min_items=1)
_PLACES = {"count": Annotated[int, _COUNT], "positions": Annotated[tuple[float, ...], _POSITIONS]}
#: Keys of ``[disks]``, of which exactly one of ``count`` and ``positions`` is given.
DISKS = Keys({**keys_of(Disks), **_PLACES}, {**keys_of(Disks).defaults, **dict.fromkeys(_PLACES)})
_RADIUS = Quantity(
    "radius of the (round) cross-section, or pairs of arc length and radius from base to tip, linear in between",
    "m",
    allowed="a positive number [m] up to 1000, or pairs of arc length and such a radius [m]",
)
_ONE = Annotated[float, Quantity(ge=1e-9, le=1000.0)]
_RADII = _ONE | Annotated[tuple[tuple[float, _ONE], ...], Quantity(min_items=1)]
#: Keys of ``[backbone]``; its radius may change along it.
BACKBONE = Keys({**keys_of(Backbone), "radius": Annotated[_RADII, _RADIUS]}, keys_of(Backbone).defaults)


@dataclass(frozen=True)
class _Contents:
    """JSON schema of a table, or of the tables of a list, that is read by keys of its own."""

    schema: Callable[[], dict[str, Any]]

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        found, inner = handler(schema), self.schema()
        return {**found, **(inner if found["type"] == "object" else {"items": inner})}


def _disks_schema() -> dict[str, Any]:
    return {**DISKS.json_schema, "oneOf": [{"required": ["count"]}, {"required": ["positions"]}]}


def _tendons_schema() -> dict[str, Any]:
    """Schema of a table ``[[tendons]]``: one for every routing."""
    tendons = []
    for name in ROUTINGS:
        table = tendon_keys(name).json_schema
        kind = {"description": table["properties"]["routing"]["description"], "enum": [name]}
        tendons.append({**table, "properties": {**table["properties"], "routing": kind}})
    return {"type": "object", "oneOf": tendons}


def _effects_schema() -> dict[str, Any]:
    """Schema of the table ``[effects]``: by name of the effect, a table of its parameters."""
    properties: dict[str, dict[str, Any]] = {}
    for effect in EFFECTS:
        table = parameter_keys((*effect.parameters, *effect.more)).json_schema
        if effect.part_names:  # numbers of single tendons or markers, whose names the schema does not know
            named = {f"^{name}_{effect.part_names}$": x for name, x in table["properties"].items()}
            table = {**table, "patternProperties": named}
        properties[effect.name] = {**table, "description": effect.description}
    return {"type": "object", "properties": properties, "additionalProperties": False}


_ROBOT, _Table = all_keys_of(Robot), dict[str, Any]
_ROD = "a table [backbone] with length, radius, youngs_modulus, poisson_ratio"
_BACKBONE = Quantity("the elastic rod", allowed=_ROD)
_DISKS = Quantity(
    "the rigid disks on it; without it tendons follow the backbone",
    allowed="a table [disks] with count or positions",
)
_TENDONS = Quantity("one table per tendon", allowed="tables [[tendons]]")
#: Keys at the top of ``robot.toml``.
ROBOT = Keys(
    {
        "name": _ROBOT["name"],
        **_ROBOT,
        "backbone": Annotated[_Table, _Contents(lambda: BACKBONE.json_schema), _BACKBONE],
        "disks": Annotated[_Table, _Contents(_disks_schema), _DISKS],
        "tendons": Annotated[list[Any], _Contents(_tendons_schema), _TENDONS],
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
_EFFECTS = Quantity("effects that the model includes, by name", allowed="a table [effects]")
_SHARED = {
    "model": Annotated[Model, Quantity("how the robot is modelled", allowed="a table [model]")],
    "solver": Annotated[SolverSettings, Quantity(_SOLVER, allowed="a table [solver]")],
    "effects": Annotated[_Table, _Contents(_effects_schema), _EFFECTS],
}
_INPUTS = Annotated[InputErrors, Quantity("errors of the inputs", allowed="a table [inputs]")]
#: Keys at the top of ``model.toml``; ``effects`` and ``inputs`` are those of measured data.
MODEL_FILE = Keys({**_SHARED, "inputs": _INPUTS}, {"solver": SolverSettings(), "effects": {}, "inputs": None})
_PATH = "the path of a robot.toml, in quotes, relative to this file"
_STEPS = Quantity("the loading sequence", min_items=1, allowed="tables [[steps]], at least one")
#: Keys at the top of ``scenario.toml``.
SCENARIO = Keys(
    {
        "robot": Annotated[str, Quantity("path of the robot.toml", allowed=_PATH)],
        **_SHARED,
        "steps": Annotated[list[Any], _Contents(lambda: keys_of(LoadStep).json_schema), _STEPS],
    },
    {"model": Model(), "solver": SolverSettings(), "effects": {}},
)


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
    return {**keys[file].json_schema, "$schema": _DIALECT, "title": f"{file}.toml of tdcr_fe"}
