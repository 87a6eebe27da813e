"""JSON schema of `sweep.toml`, for editors that check and complete it."""

from __future__ import annotations

import copy
from typing import Any

from tdcr_fe.io.keys import json_schema
from tdcr_fe.model.schema import keys_of
from tdcr_fe.sweeps.description import Sampling
from tdcr_fe.sweeps.tables import OUTPUT, VALUES, VARY
from tdcr_fe.sweeps.workspace import WORKSPACE

_STEPS = {
    "description": "load steps whose results are kept",
    "oneOf": [{"enum": ["last", "all"]}, {"type": "array", "items": {"type": "integer", "minimum": 1}}],
}
_VALUE = {"anyOf": [{"type": "number"}, {"type": "string"}, {"type": "array"}]}
_VALUES = {"description": "values of a list or grid", "type": "array", "items": _VALUE, "minItems": 1}
_TENSION = {
    "description": "in N, one number or numbers by tendon",
    "oneOf": [
        {"type": "number", "minimum": 0.0},
        {"type": "object", "additionalProperties": {"type": "number", "minimum": 0.0}},
    ],
}


def sweep_schema() -> dict[str, Any]:
    """JSON schema (draft 2020-12) of ``sweep.toml``; `json_schema` has those of the other files."""
    scenario = json_schema("scenario")
    vary, output, workspace = (copy.deepcopy(keys.json_schema) for keys in (VARY, OUTPUT, WORKSPACE))
    vary["properties"]["values"] = _VALUES
    vary["oneOf"] = [{"required": ["key"]}, {"required": ["keys"]}]
    vary["anyOf"] = [{"required": [name]} for name in VALUES]
    output["properties"]["steps"] = _STEPS
    workspace["properties"] |= {"largest": _TENSION, "smallest": _TENSION}
    own = {
        "scenario": {"description": "path of the scenario.toml, relative to this file", "type": "string"},
        "sampling": keys_of(Sampling).json_schema,
        "vary": {"description": "one table a variation", "type": "array", "items": vary},
        "workspace": workspace,
        "output": output,
    }
    return {
        "$schema": scenario["$schema"],
        "title": "sweep.toml of tdcr_fe",
        "type": "object",
        "properties": {**own, **scenario["properties"]},
        "additionalProperties": False,
        "anyOf": [{"required": ["scenario"]}, {"required": ["robot"]}],
    }
