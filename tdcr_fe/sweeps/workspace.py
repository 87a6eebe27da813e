"""The table ``[workspace]`` of `sweep.toml`: every tendon's tension varies in the last load step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from tdcr_fe.io.problems import Reporter
from tdcr_fe.io.toml import Scenario
from tdcr_fe.model.messages import join, meant, quoted, shown
from tdcr_fe.model.schema import Keys, Quantity
from tdcr_fe.sweeps.description import Range, Sampling, Variation
from tdcr_fe.sweeps.keys import parse_key
from tdcr_fe.sweeps.sampling import SAMPLED, Uniform
from tdcr_fe.sweeps.tables import is_number

_TENSION = "a tension [N], zero or more, or a table of tensions by tendon"
#: Keys of ``[workspace]``.
WORKSPACE = Keys(
    {
        "largest": Annotated[Any, Quantity("largest tension", allowed=_TENSION)],
        "smallest": Annotated[Any, Quantity("smallest tension", allowed=_TENSION)],
        "count": Annotated[int, Quantity("values a tendon", ge=2, le=1000)],
    },
    {"smallest": 0.0, "count": None},
)


def read_workspace(
    table: Any, scenario: Scenario, sampling: Sampling | None, report: Reporter
) -> list[Variation | None]:
    """One variation a tendon: its tension in the last load step."""
    names = scenario.robot.tendon_names
    values, bad = WORKSPACE.read(table, "workspace", report.mistake)
    if bad or not isinstance(table, dict):
        return []
    if not names:
        report("workspace", "", "the robot has no tendons")
    bounds = {}
    for which in ("largest", "smallest"):
        bounds[which] = _tensions(f"workspace.{which}", values[which], names, report)
    is_grid = sampling is not None and sampling.method not in SAMPLED
    if sampling is not None and is_grid != (values["count"] is not None):
        text = (
            'only for method = "grid"'
            if values["count"]
            else 'missing; method = "grid" needs values a tendon'
        )
        report("workspace.count", "" if values["count"] is None else str(values["count"]), text)
    found: list[Variation | None] = []
    for name in names:
        low, high = bounds["smallest"].get(name), bounds["largest"].get(name)
        if low is None or high is None:
            continue
        if not low < high:
            report(
                "workspace.largest",
                f"{high:g}",
                f"must be above smallest, {low:g} N, for tendon {quoted(name)}",
            )
            continue
        key = parse_key(join("steps[-1].tensions", name))
        if is_grid and values["count"]:
            found.append(
                Variation(f"pull_{name}", (key,), options=Range(low, high, values["count"]).values())
            )
        else:
            found.append(Variation(f"pull_{name}", (key,), distribution=Uniform(low, high)))
    return found


def _tensions(key: str, value: Any, names: Sequence[str], report: Reporter) -> dict[str, float]:
    """Tension of every tendon; those that are wrong are reported and left out."""
    by_name = value if isinstance(value, Mapping) else dict.fromkeys(names, value)
    found = {}
    for name, tension in by_name.items():
        where = join(key, name) if isinstance(value, Mapping) else key
        if name not in names:
            report(where, shown(tension), f"unknown tendon{meant(name, names)}; there are {', '.join(names)}")
        elif not is_number(tension) or not 0.0 <= tension < float("inf"):
            report(where, shown(tension), f"must be {_TENSION}")
            if not isinstance(value, Mapping):
                break
        else:
            found[name] = float(tension)
    for name in names if isinstance(value, Mapping) else ():
        if name not in by_name:
            report(key, shown(value), f"tendon {quoted(name)} is missing")
    return found
