"""The part of the net that takes hours: what the identification says of blind, faulty and measured data.

It is read from a folder with results of campaigns, and of ``tdcr-fe identify FOLDER -o FOLDER/NAME``:

| folder | campaign |
| --- | --- |
| ``plan7`` | ``blind -n 60 --plan 7`` |
| ``places`` | ``blind -n 21 --effects stuck_hole kink soft_bay side_spring`` |
| ``unlisted``, ``faulty`` | ``unlisted``, ``faulty_data`` |
| ``practice/set1`` to ``set10``, ``helical`` | measured data, ``helical`` with ``--minutes 60`` |
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_fe.validation.net.parts import Record

#: A number with its standard error in a formula.
_NUMBER = re.compile(r"\((\S+) \+- (\S+)\)")


def read_identified(folder: Path) -> dict[str, Record]:
    """What was found for all sets below a folder, by the path of their results in it.

    Parameters
    ----------
    folder
        With one folder a campaign or data set, as in the net.
    """
    found = {}
    for path in sorted([*folder.rglob("*.json"), *folder.rglob("*.jsonl")]):
        for name, document in _documents(path):
            if isinstance(document, dict) and "verdict" in document and "sets" not in path.parts:
                place = path.parent.relative_to(folder)
                parts = [p for p in place.parts if p not in ("results", "reports")]
                if "reports" not in place.parts:  # of faulty data the campaign says more
                    found["/".join([*parts, *([] if name == "result" else [name])])] = record(document)
    return found


def _documents(path: Path) -> Iterator[tuple[str, Any]]:
    """Results in a file, with a name: that of the law or fault, or the seed, or the file's."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.suffix == ".jsonl" else [path.read_text()]
    for line in lines:
        document = json.loads(line)
        if isinstance(document, dict):
            names = (document.get(key) for key in ("law", "fault", "seed", "key"))
            name = next((str(x) for x in names if isinstance(x, str | int)), path.stem)
            yield name, document


def record(document: Mapping[str, Any]) -> Record:
    """Verdict, effects with their values, law and held-out errors of a set."""
    found: Record = {"verdict": document["verdict"]}
    if isinstance(document.get("fault"), str):
        found["outcome"] = document["outcome"]
    effects = document.get("named", document.get("effects", []))
    values = dict(document.get("found", {}))
    for effect in effects:
        if isinstance(effect, dict):
            own = effect["parameters"].items()
            values[effect["effect"]] = {name: (p["value"], p["std_error"]) for name, p in own}
    found["effects"] = ", ".join(sorted(e["effect"] if isinstance(e, dict) else e for e in effects))
    for effect, own in values.items():
        for name, pair in own.items():
            found[f"{effect}.{name}"] = _floats(pair)
    law = document.get("law")
    formula = law["formula"] if isinstance(law, dict) else document.get("formula", "")
    if formula:
        found["formula"] = _NUMBER.sub("#", formula)
        for k, pair in enumerate(_NUMBER.findall(formula), start=1):
            found[f"coefficient {k}"] = _floats(pair)
    for key in ("before", "after"):
        error = document.get(key)
        if isinstance(error, dict):
            error = error["held_out"]
        if isinstance(error, dict):
            error = next(iter(error.values()))
        if error is not None and np.isfinite(error):
            found[f"held-out error {key}"] = _floats([error])
    return found


def _floats(values: Any) -> np.ndarray:
    return np.array([np.nan if x is None else float(x) for x in values])


def measure(values: np.ndarray) -> float:
    """What counts as a movement of 1: a standard error, or a tenth of a held-out error."""
    if len(values) == 2 and np.isfinite(values[1]) and values[1] > 0.0:
        return float(values[1])
    return 0.1 * abs(float(values[0]))
