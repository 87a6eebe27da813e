"""What is known of effects: those that `identify` found, with their covariance, and the table ``[uncertain]``."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from scipy.linalg import block_diag

from tdcr_fe.effects import EFFECTS, changed_by, effect
from tdcr_fe.estimate.description import ParameterPrior
from tdcr_fe.io.files import Reporter
from tdcr_fe.io.keys import effect_keys
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.model.messages import issue
from tdcr_fe.model.schema import Keys, Quantity

#: Name of a parameter in ``result.json``: effect, the form of it that was fitted, and parameter.
_NAME = re.compile(r"(\w+)(?: \(.*\))?\.(.*)")


def read_identified(folder: Path, data: MeasuredData, reporter: Reporter) -> tuple[str, ParameterPrior]:
    """Friction of the model in results of identify, and its effects; for a robot as measured data declare it.

    The friction is empty where there are no results. Numbers are known of effects that were found; where more than
    noise is left, none was.
    """
    try:
        result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
        found = {e["effect"]: {n: p["value"] for n, p in e["parameters"].items()} for e in result["effects"]}
        every = found | result["stand_ins"]
        sigma = np.array(result["standard_errors"], dtype=float)
        correlation = np.array(result["correlation"], dtype=float)
        names, digests, friction = result["parameters"], result["input"], result["friction"]
        if not np.all(np.isfinite(correlation * np.outer(sigma, sigma))):
            raise ValueError
    except (OSError, ValueError, KeyError, TypeError):
        allowed = "must be a folder with a result.json of identify (this version), with all standard errors"
        reporter("identified", str(folder), allowed)
        return "", ParameterPrior()
    own = {n: d for n, d in (data.digests or {}).items() if n in ("robot.toml", "model.toml")}
    if any(digests.get(n) != d for n, d in own.items()):
        allowed = "must be found with the robot.toml and model.toml of this folder"
        reporter("identified", str(folder), allowed)
    listed = {e.name for e in EFFECTS}
    issue([f"{folder}: {name}: not a listed effect, left out" for name in every if name not in listed])
    effects = {name: values for name, values in every.items() if name in listed}
    parts = [match.groups() if (match := _NAME.fullmatch(name)) else ("", "") for name in names]
    which = [k for k, (name, _) in enumerate(parts) if name in found and name in listed]
    covariance = (correlation * np.outer(sigma, sigma))[np.ix_(which, which)]
    return friction, ParameterPrior(tuple(".".join(parts[k]) for k in which), covariance, effects)


def prior_of_robot(found: ParameterPrior, data: MeasuredData, sigma: Mapping[str, float]) -> ParameterPrior:
    """Prior of the effects that act on the robot; numbers of those on commands or measurement alone are as found.

    ``sigma``: standard deviations of other parameters.
    """
    changed = changed_by(replace(data.experiment, steps=()), found.effects)
    acting = {name: found.effects[name] for name, own in changed.items() if own & {"robot", "model"}}
    which = [k for k, name in enumerate(found.names) if name.partition(".")[0] in acting]
    others = {name: x for name, x in sigma.items() if name not in found.names}
    independent = ParameterPrior.independent(others).covariance
    covariance = block_diag(found.covariance[np.ix_(which, which)], independent)
    return ParameterPrior((*(found.names[k] for k in which), *others), covariance, acting)


def read_sigma(table: object, data: MeasuredData, reporter: Reporter) -> dict[str, float]:
    """Standard deviations in a table such as ``friction_coefficient = { mu = 0.03 }``."""
    given, _ = effect_keys(tuple(e.name for e in EFFECTS)).read(table, "uncertain", reporter)
    found: dict[str, float] = {}
    for name, own in ((name, own) for name, own in given.items() if own is not None):
        names = [p.name for p in effect(name).parameters_of(data.experiment)]
        keys = Keys(dict.fromkeys(names, Annotated[float, Quantity(gt=0.0)]), dict.fromkeys(names))
        values, _ = keys.read(own, f"uncertain.{name}", reporter)
        found |= {f"{name}.{key}": value for key, value in values.items() if value is not None}
    return found
