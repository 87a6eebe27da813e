"""Read `sweep.toml`: all mistakes in it, and in the files that it names, are found before anything is solved."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from tdcr_fe.io.effects import effects_reader
from tdcr_fe.io.own_effects import read_own_effects
from tdcr_fe.io.problems import InputError, Reporter
from tdcr_fe.io.toml import (
    Scenario,
    ScenarioTables,
    build_scenario,
    digest,
    read_scenario_tables,
    read_toml,
    with_robot_table,
)
from tdcr_fe.model.messages import quoted, shown
from tdcr_fe.model.schema import Keys, Quantity
from tdcr_fe.sweeps.cases import ABOUT_CASE, columns_of_steps
from tdcr_fe.sweeps.check import value_problems
from tdcr_fe.sweeps.description import MOST_CASES, Sampling, Sweep, Variation
from tdcr_fe.sweeps.keys import IN_SCENARIO
from tdcr_fe.sweeps.objects import as_tables
from tdcr_fe.sweeps.sampling import SAMPLED
from tdcr_fe.sweeps.tables import read_output, read_sampling, read_variation
from tdcr_fe.sweeps.workspace import read_workspace

_PATH = "the path of a scenario.toml, in quotes, relative to this file"
#: Keys at the top of ``sweep.toml``; without ``scenario`` also those of a scenario.
TOP = Keys(
    {
        "scenario": Annotated[str, Quantity("scenario", allowed=_PATH)],
        "sampling": Annotated[
            dict[str, Any], Quantity("sampling", allowed="a table [sampling] with method, samples, seed")
        ],
        "vary": Annotated[list[Any], Quantity("vary", allowed="tables [[vary]], one a variation")],
        "workspace": Annotated[
            dict[str, Any], Quantity("workspace", allowed="a table [workspace] with largest")
        ],
        "output": Annotated[
            dict[str, Any], Quantity("output", allowed="a table [output] with steps, quantities")
        ],
    },
    {"scenario": None, "sampling": {}, "vary": (), "workspace": None, "output": {}},
)


@dataclass(frozen=True)
class _Base:
    """What is varied.

    Attributes
    ----------
    tables : ScenarioTables
    scenario : Scenario or None
        None where the tables have mistakes.
    """

    tables: ScenarioTables
    scenario: Scenario | None


def read_sweep(
    source: str | os.PathLike[str] | Mapping[str, Any], effects: Sequence[str | os.PathLike[str]] = ()
) -> Sweep:
    """Read and check a sweep.

    Parameters
    ----------
    source
        Path of a `sweep.toml`, or its contents. There ``robot``, ``model`` and ``steps`` may be objects, and paths are
        relative to the working directory.
    effects
        Python files with effects of one's own.

    Raises
    ------
    InputError
        With every mistake in the sweep and the files that it names.
    """
    if isinstance(source, Mapping):
        (data, robot), path, sha256 = as_tables(source), Path("sweep"), ""
    else:
        path = Path(source)
        (data, sha256), robot = read_toml(path), None
    report = Reporter(str(path))
    further = {}
    try:
        further = {"effects": effects_reader(read_own_effects(effects))}
    except InputError as error:
        report.problems.extend(error.problems)
    top, _ = TOP.read(data, "", report.mistake, [k for k in IN_SCENARIO if "scenario" not in data])
    sampling = read_sampling(top.get("sampling"), report)
    base = _base(data, robot, top, path, further, report)
    variations = [read_variation(i, table, report) for i, table in enumerate(top.get("vary", ()))]
    workspace = top.get("workspace")
    if workspace is not None and base.scenario is not None:
        variations += read_workspace(workspace, base.scenario, sampling, report)
    output = read_output(top.get("output", {}), base.scenario, report)
    sound = tuple(v for v in variations if v is not None)
    robots = _robots(sound, base.tables, report)
    if sampling is not None and not report.problems:
        tendons = base.scenario.robot.tendon_names if base.scenario is not None else ()
        taken = (*ABOUT_CASE, *columns_of_steps(tendons))
        _check_together(sampling, sound, taken, report)
    if report.problems or sampling is None:
        raise InputError(report.problems)
    digests = {**({str(path): sha256} if sha256 else {}), **base.tables.digests}
    for _, other in robots:
        digests.update(other.digests)
    digests.update({str(p): digest(p) for p in effects})
    sweep = Sweep(
        base.tables,
        sound,
        sampling,
        output,
        robots,
        workspace is not None,
        tuple(sorted((k, v) for k, v in digests.items() if v)),
        str(path),
        tuple(str(p) for p in effects),
    )
    problems = value_problems(sweep, further)
    if problems:
        raise InputError(problems)
    return sweep


def _base(
    data: Mapping[str, Any],
    robot: dict[str, Any] | None,
    top: Mapping[str, Any],
    path: Path,
    further: Any,
    report: Reporter,
) -> _Base:
    """Scenario and robot, from the file that the sweep names or from the sweep itself."""
    nothing = _Base(ScenarioTables({}, None, path, path), None)
    named = top.get("scenario")
    if "scenario" in data:
        if not isinstance(named, str):
            return nothing
        where = path.parent / named
        if not where.is_file():
            report("scenario", shown(named), f"there is no file {where}")
            return nothing
        try:
            tables = read_scenario_tables(where)
        except InputError as error:
            report.problems.extend(error.problems)
            return nothing
    elif "robot" not in data:
        report("scenario", "", "missing; must be the path of a scenario.toml, or robot that of a robot.toml")
        return nothing
    else:
        own = {k: data[k] for k in IN_SCENARIO if k in data}
        if "workspace" in data:
            own.setdefault("steps", [{"label": "workspace"}])
        tables = with_robot_table(own, path) if robot is None else ScenarioTables(own, robot, path, path)
    try:
        return _Base(tables, build_scenario(tables, further))
    except InputError as error:
        report.problems.extend(error.problems)
        return _Base(tables, None)


def _robots(
    variations: Sequence[Variation], tables: ScenarioTables, report: Reporter
) -> tuple[tuple[str, ScenarioTables], ...]:
    """Tables with every robot that a variation names."""
    found: dict[str, ScenarioTables] = {}
    for v in variations:
        for name in v.options if any(k.names_robot for k in v.keys) else ():
            other = with_robot_table({**tables.scenario, "robot": name}, tables.path)
            problems = [replace(p, file=report.file, key=v.name) for p in other.problems if p.key == "robot"]
            report.problems.extend(problems or other.problems)
            found[name] = other
    return tuple(found.items())


def _check_together(
    sampling: Sampling, variations: Sequence[Variation], taken: Collection[str], report: Reporter
) -> None:
    """Contradictions between the variations; ``taken`` are the names of the other columns."""
    if not variations:
        report("vary", "", "nothing is varied; must have a table [[vary]], or [workspace]")
        return
    names = [v.name for v in variations]
    for name in sorted({n for n in names if names.count(n) > 1}):
        report("vary", quoted(name), "is varied twice, or the name of two columns")
    for name in names:
        if name in taken:
            report("vary", quoted(name), "is the name of another column of the table; give another name")
    if sampling.method not in SAMPLED:
        for i, v in enumerate(variations):
            if v.distribution is not None:
                text = f"needs sampling.method = {' or '.join(map(quoted, SAMPLED))}, or give values or range instead"
                report(f"vary[{i}]", shown(v.name), f"a distribution {text}")
    if report.problems:
        return
    lengths = [len(v.options) for v in variations]
    if sampling.method == "list" and len(set(lengths)) > 1:
        text = ", ".join(f"{n} of {v.name}" for n, v in zip(lengths, variations, strict=True))
        report("vary", "", f'method = "list" needs as many values of each; there are {text}')
    count = 1
    for n in lengths if sampling.method == "grid" else ():
        count *= n
    if sampling.method == "saltelli":
        count = (sampling.samples or 0) * (len(variations) + 2)
    if count > MOST_CASES:
        report(
            "sampling.method", quoted(sampling.method), f"gives {count} cases; must be at most {MOST_CASES}"
        )
