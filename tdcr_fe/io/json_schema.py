"""JSON schema of the input files, for editors that check and complete them."""

from __future__ import annotations

from typing import Any, Literal

from tdcr_fe.effects import EFFECTS, Parameter
from tdcr_fe.io.keys import MODEL_FILE, ROBOT, SCENARIO
from tdcr_fe.model.schema import table_schema

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


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
    return {
        "type": "object",
        "description": "effects that the model includes, by name",
        "properties": properties,
        "additionalProperties": False,
    }


def _number_schema(p: Parameter) -> dict[str, Any]:
    """Of one parameter."""
    bounds = {"minimum": p.lower, "maximum": p.upper}
    finite = {k: v for k, v in bounds.items() if abs(v) != float("inf")}
    return {"type": "number", "description": f"{p.meaning} [{p.unit}]", **finite}


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
    schema = {"$schema": _DIALECT, "title": f"{file}.toml of tdcr_fe", **table_schema(keys[file])}
    if file in ("scenario", "model"):
        schema["properties"]["effects"] = _effects_schema()
    return schema
