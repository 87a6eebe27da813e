"""The keys of every table in the files, made from the annotated fields of the description."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.disks import DiskCount, Disks
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.quantity import Quantity
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.routing import ROUTINGS, Routing
from tdcr_fe.model.schema import (
    REQUIRED,
    Choice,
    Field,
    Kind,
    Note,
    Text,
    all_fields_of,
    field_from,
    fields_of,
    table_schema,
)
from tdcr_fe.model.settings import SolverSettings
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.model.wording import quoted


@dataclass(frozen=True)
class Raw(Kind):
    """A table, or a list of tables, whose contents a function of its own reads."""

    type_: type[dict[str, Any]] | type[list[Any]]
    schema: Mapping[str, Any] = field(hash=False)

    def take(self, value: Any, key: str, q: Quantity, note: Note, from_file: bool) -> Any:
        """See `Kind.take`."""
        if not isinstance(value, self.type_):
            return self.refuse(value, key, q, note, True)
        return value if len(value) >= q.min_items else self.refuse(value, key, q, note, False)

    def json_schema(self, q: Quantity) -> dict[str, Any]:
        """See `Kind.json_schema`."""
        return {**self.schema, **({"minItems": q.min_items} if q.min_items else {})}


def _table(
    name: str, schema: Mapping[str, Any], description: str, keys: str = "", default: Any = REQUIRED
) -> Field:
    """A table ``[name]``; ``keys`` names its required keys."""
    return Field(name, Raw(dict, schema), Quantity(description, allowed=f"a table [{name}]{keys}"), default)


def _tables(name: str, schema: Mapping[str, Any], description: str, least: int = 0) -> Field:
    """A list of tables ``[[name]]``."""
    allowed = f"tables [[{name}]]" + (f", at least {'one' if least == 1 else least}" if least else "")
    q = Quantity(description, min_items=least, allowed=allowed)
    return Field(name, Raw(list, {"type": "array", "items": schema}), q, REQUIRED if least else ())


def _routing_key(options: tuple[str, ...]) -> Field:
    texts = [quoted(r) for r in options]
    q = Quantity("where the tendon's holes lie", allowed="one of " + ", ".join(texts))
    return Field("routing", Choice(options), q)


def tendon_keys(routing: type[Routing] | None) -> dict[str, Field]:
    """Keys of ``[[tendons]]`` with a routing; if the routing is unknown, those of all routings, none required."""
    own = dict(fields_of(Tendon))
    name = own.pop("name")
    if routing is not None:
        return {"name": name, "routing": _routing_key((*ROUTINGS,)), **fields_of(routing), **own}
    every = {
        n: replace(f, default=None if f.required else f.default)
        for r in ROUTINGS.values()
        for n, f in fields_of(r).items()
    }
    return {"name": name, "routing": _routing_key((*ROUTINGS,)), **every, **own}


def routings_with(key: str) -> list[str]:
    """Names of the routings that have a key."""
    return [name for name, r in ROUTINGS.items() if key in fields_of(r)]


def _tendon_schema() -> dict[str, Any]:
    """One alternative a routing."""
    return {
        "type": "object",
        "oneOf": [
            table_schema({**tendon_keys(cls), "routing": _routing_key((name,))})
            for name, cls in ROUTINGS.items()
        ],
    }


#: Keys of ``[disks]``, of which exactly one of ``count`` and ``positions`` is given.
DISKS: dict[str, Field] = {
    "count": field_from("count", DiskCount, None),
    **fields_of(Disks),
    "positions": replace(
        fields_of(Disks)["positions"],
        default=None,
        quantity=replace(fields_of(Disks)["positions"].quantity, min_items=1),
    ),
}

_BACKBONE_SCHEMA = table_schema(fields_of(Backbone))
_PAIR = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
_BACKBONE_SCHEMA["properties"]["radius"] = {
    "description": "of the round section, or pairs of arc length and radius from base to tip [m]",
    "oneOf": [
        {"type": "number", "exclusiveMinimum": 0.0},
        {"type": "array", "items": _PAIR, "minItems": 2},
    ],
}

_DISKS_SCHEMA = {**table_schema(DISKS), "oneOf": [{"required": ["count"]}, {"required": ["positions"]}]}

#: Keys at the top of ``robot.toml``.
ROBOT: dict[str, Field] = {
    "name": all_fields_of(Robot)["name"],
    "backbone": _table(
        "backbone",
        _BACKBONE_SCHEMA,
        "the elastic rod",
        " with length, radius, youngs_modulus, poisson_ratio",
    ),
    "disks": _table(
        "disks",
        _DISKS_SCHEMA,
        "the rigid disks on it; without it tendons follow the backbone",
        " with count or positions",
        default=None,
    ),
    "tip_mass": all_fields_of(Robot)["tip_mass"],
    "tendons": _tables("tendons", _tendon_schema(), "one table a tendon"),
    "springs": all_fields_of(Robot)["springs"],
    "base_stiffness": all_fields_of(Robot)["base_stiffness"],
}

_MODEL = _table("model", table_schema(fields_of(Model)), "how the robot is modelled")
_SOLVER = _table(
    "solver", table_schema(fields_of(SolverSettings)), "numerics of the quasi-static solver", default={}
)

#: Keys at the top of ``model.toml``.
MODEL_FILE: dict[str, Field] = {"model": _MODEL, "solver": _SOLVER}

#: Keys at the top of ``scenario.toml``, without those of `tdcr_fe.io.effects`.
SCENARIO: dict[str, Field] = {
    "robot": Field(
        "robot",
        Text(),
        Quantity(
            "path of the robot.toml",
            allowed="the path of a robot.toml, in quotes, relative to this file",
        ),
    ),
    "model": replace(_MODEL, default={}),
    "solver": _SOLVER,
    "steps": _tables("steps", table_schema(fields_of(LoadStep)), "the loading sequence", least=1),
}
