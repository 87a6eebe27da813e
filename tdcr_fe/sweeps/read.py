"""Read `sweep.toml`: all mistakes in it, and in the files that it names, are found before anything is solved."""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from tdcr_fe.io.keys import json_schema
from tdcr_fe.io.problems import InputError, Problem, Reporter
from tdcr_fe.io.toml import (
    Scenario,
    ScenarioTables,
    TableReader,
    build_scenario,
    digest,
    read_scenario_tables,
    read_toml,
    with_robot_table,
)
from tdcr_fe.io.user_effects import effects_reader, read_own_effects
from tdcr_fe.io.write_toml import model_to_toml, robot_to_toml, scenario_to_toml
from tdcr_fe.model.loading import LoadStep, Model, SolverSettings
from tdcr_fe.model.messages import join, meant, quoted, shown
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.schema import Keys, Mistake, Quantity, keys_of
from tdcr_fe.model.units import number_or_none, with_units
from tdcr_fe.sweeps.cases import ABOUT_CASE, columns_of_steps, tables_with
from tdcr_fe.sweeps.description import MOST_CASES, Mode, Output, Range, Sampling, Sweep, Variation
from tdcr_fe.sweeps.keys import IN_SCENARIO, KeyProblem, parse_key, unit_of
from tdcr_fe.sweeps.sampling import DISTRIBUTIONS, SAMPLED, Column, Uniform

#: Most values of one variation that are checked (of more, as many at equal distances), most cases that are tried with
#: a value that is wrong alone, and most values of one variation that are reported.
MOST_CHECKED, MOST_TRIED, MOST_REPORTED = 200, 30, 10
#: What stands in the scenario for a robot that has no file.
OBJECT = "(robot given in Python)"

#: Keys of ``[[vary]]`` that give its values; exactly one is given.
VALUES = ("values", "range", *DISTRIBUTIONS)
_TEXTS = "a list of keys in quotes, at least one"
_LIST = "a list of values, at least one"
#: Keys of ``[[vary]]``.
VARY = Keys(
    {
        "key": Annotated[str, Quantity("what varies", allowed="the key of a value, in quotes")],
        "keys": Annotated[tuple[str, ...], Quantity("what varies together", allowed=_TEXTS, min_items=1)],
        "name": Annotated[str, Quantity("name of the column", name=True)],
        "mode": Annotated[Mode, Quantity("how the value acts on the declared one")],
        "values": Annotated[list[Any], Quantity("values of a list or grid", allowed=_LIST, min_items=1)],
        "range": Annotated[Range, Quantity("values at equal distances")],
        **{n: Annotated[cls, Quantity(n)] for n, cls in DISTRIBUTIONS.items()},
    },
    {**dict.fromkeys(("key", "keys", "name", *VALUES)), "mode": "value"},
)

_TENSION = "a tension [N], zero or more, or a table of tensions by tendon"
_Tension = float | dict[str, float]
#: Keys of ``[workspace]``.
WORKSPACE = Keys(
    {
        "largest": Annotated[_Tension, Quantity("largest tension", unit="N", ge=0.0, allowed=_TENSION)],
        "smallest": Annotated[_Tension, Quantity("smallest tension", unit="N", ge=0.0, allowed=_TENSION)],
        "count": Annotated[int, Quantity("values per tendon", ge=2, le=1000)],
    },
    {"smallest": 0.0, "count": None},
)

_STEPS = 'one of "last", "all", or a list of the numbers of load steps, from 1'
_COLUMNS = "a list of columns of steps.csv, in quotes"
_Steps = Literal["last", "all"] | tuple[int, ...]
#: Keys of ``[output]``.
OUTPUT = Keys(
    {
        "steps": Annotated[_Steps, Quantity("load steps whose results are kept", ge=1, allowed=_STEPS)],
        "quantities": Annotated[tuple[str, ...], Quantity("columns", allowed=_COLUMNS)],
    },
    {"steps": "last", "quantities": ()},
)


def _vary_schema() -> dict[str, Any]:
    one_key = [{"required": ["key"]}, {"required": ["keys"]}]
    return {**VARY.json_schema, "oneOf": one_key, "anyOf": [{"required": [name]} for name in VALUES]}


def _table(keys: Mapping[str, Any], allowed: str) -> Quantity:
    """A table with these keys, which a function of its own reads."""
    return Quantity(allowed, allowed=allowed, contents=lambda: keys.json_schema)  # type: ignore[attr-defined]


_PATH = "the path of a scenario.toml, in quotes, relative to this file"
_TABLES = "tables [[vary]], one for each variation"
#: Keys at the top of ``sweep.toml``; without ``scenario`` also those of a scenario.
TOP = Keys(
    {
        "scenario": Annotated[str, Quantity("path of the scenario", allowed=_PATH)],
        "sampling": Annotated[
            dict[str, Any], _table(keys_of(Sampling), "a table [sampling] with method, samples, seed")
        ],
        "vary": Annotated[list[Any], Quantity(_TABLES, allowed=_TABLES, contents=_vary_schema)],
        "workspace": Annotated[dict[str, Any], _table(WORKSPACE, "a table [workspace] with largest")],
        "output": Annotated[dict[str, Any], _table(OUTPUT, "a table [output] with steps, quantities")],
    },
    {"scenario": None, "sampling": {}, "vary": (), "workspace": None, "output": {}},
)


def sweep_schema() -> dict[str, Any]:
    """JSON schema (draft 2020-12) of ``sweep.toml``; `json_schema` has those of the other files."""
    scenario = json_schema("scenario")
    return {
        "$schema": scenario["$schema"],
        "title": "sweep.toml of tdcr_fe",
        "type": "object",
        "properties": {**TOP.json_schema["properties"], **scenario["properties"]},
        "additionalProperties": False,
        "anyOf": [{"required": ["scenario"]}, {"required": ["robot"]}],
    }


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
        Python files with effects of your own.

    Raises
    ------
    InputError
        With every mistake in the sweep and the files that it names.
    """
    if isinstance(source, Mapping):
        (data, robot), path, sha256 = _as_tables(source), Path("sweep"), ""
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
    sampling = _sampling(top.get("sampling"), report)
    tables = _base_tables(data, robot, path, "scenario" in top, report)
    scenario = _scenario(tables, further, report)
    found = [_variation(i, table, report) for i, table in enumerate(top.get("vary", ()))]
    workspace, output = top.get("workspace"), Output()
    if scenario is not None:
        if workspace is not None:
            found += _workspace(workspace, scenario, sampling, report)
        output = _output(top.get("output", {}), scenario, report)
    variations = tuple(v for v in found if v is not None)
    robots = {} if tables is None else _robots(variations, tables, report)
    if sampling is not None and scenario is not None and not report.problems:
        _check_together(sampling, variations, scenario, report)
    if report.problems or sampling is None or tables is None:
        raise InputError(report.problems)
    digests = {str(path): sha256, **tables.digests, **{str(p): digest(p) for p in effects}}
    for other in robots.values():
        digests |= other.digests
    sweep = Sweep(
        tables,
        variations,
        sampling,
        output,
        tuple(robots.items()),
        workspace is not None,
        tuple(sorted((k, v) for k, v in digests.items() if v)),
        str(path),
        tuple(str(p) for p in effects),
    )
    problems = _value_problems(sweep, further)
    if problems:
        raise InputError(problems)
    return sweep


def _as_tables(source: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Contents given in Python as `sweep.toml` would have them, and the tables of the robot where it is an object.

    Raises
    ------
    ValueError
        The robot has what the file format cannot express.
    """
    data, robot = dict(source), None
    if isinstance(data.get("robot"), Robot):
        robot = tomllib.loads(robot_to_toml(data["robot"]))
        data["robot"] = OBJECT
    if isinstance(data.get("model"), Model):
        data["model"] = tomllib.loads(model_to_toml(data["model"])).get("model", {})
    if isinstance(data.get("solver"), SolverSettings):
        data["solver"] = tomllib.loads(model_to_toml(Model(), data["solver"])).get("solver", {})
    for k, step in enumerate(steps := list(data.get("steps", ()))):
        if isinstance(step, LoadStep):
            (steps[k],) = tomllib.loads(scenario_to_toml(Model(), [step]))["steps"]
            data["steps"] = steps
    return data, robot


def _base_tables(
    data: Mapping[str, Any], robot: dict[str, Any] | None, path: Path, is_named: bool, report: Reporter
) -> ScenarioTables | None:
    """Tables that are varied, from the file that the sweep names or from the sweep itself; None where none are."""
    if "scenario" in data:
        where = path.parent / str(data["scenario"])
        if is_named and not where.is_file():
            report("scenario", shown(data["scenario"]), f"there is no file {where}")
        elif is_named:
            try:
                return read_scenario_tables(where)
            except InputError as error:
                report.problems.extend(error.problems)
        return None
    if "robot" not in data:
        report("scenario", "", "missing; must be the path of a scenario.toml, or robot that of a robot.toml")
        return None
    own = {k: data[k] for k in IN_SCENARIO if k in data}
    if "workspace" in data:
        own.setdefault("steps", [{"label": "workspace"}])
    return with_robot_table(own, path) if robot is None else ScenarioTables(own, robot, path, path)


def _scenario(
    tables: ScenarioTables | None, further: Mapping[str, TableReader], report: Reporter
) -> Scenario | None:
    try:
        return None if tables is None else build_scenario(tables, further)
    except InputError as error:
        report.problems.extend(error.problems)
        return None


def _sampling(table: Any, report: Reporter) -> Sampling | None:
    """The table ``[sampling]``; None where it has mistakes."""
    values, bad = keys_of(Sampling).read(table, "sampling", report.mistake)
    if bad:
        return None
    sampling = Sampling(**values)
    method, samples, text = quoted(sampling.method), sampling.samples, ""
    if sampling.is_sample and samples is None:
        text = f"missing; method = {method} needs a number of points"
    elif not sampling.is_sample and samples is not None:
        text = f"only for method = {', '.join(map(quoted, SAMPLED))}; {method} takes all values given"
    elif sampling.method in ("sobol", "saltelli") and samples and samples.bit_count() != 1:
        text = f"must be a power of two for method = {method}, such as 256, 512 or 1024"
    if text:
        report("sampling.samples", "" if samples is None else str(samples), text)
    return sampling


def _variation(i: int, table: Any, report: Reporter) -> Variation | None:
    """One table ``[[vary]]``; None where it has mistakes."""
    before, where = len(report.problems), f"vary[{i}]"
    unit = _unit(table) if isinstance(table, dict) else ""

    def note(found: Mistake) -> None:
        is_number = isinstance(found.value, str) and "number" in found.allowed
        said = with_units(found.allowed, found.value, unit) if is_number else found.allowed
        report.mistake(found._replace(allowed=said))

    values, _ = VARY.read(_with_numbers(table, unit), where, note)
    if not isinstance(table, dict):
        return None
    if "key" in table and "keys" in table:
        report(f"{where}.key", shown(table["key"]), "key and keys are both given; exactly one is allowed")
    elif "key" not in table and "keys" not in table:
        report(f"{where}.key", "", "missing; must be the key of a value")
    keys = []
    for text in [values["key"]] if values.get("key") is not None else values.get("keys") or ():
        try:
            keys.append(parse_key(text))
        except KeyProblem as error:
            report(f"{where}.key", shown(text), str(error))
    given = [name for name in VALUES if name in table]
    if len(given) != 1:
        text = f"must have exactly one of {', '.join(VALUES)}"
        report(where, "", text + (f"; it has {' and '.join(given)}" if given else ""))
    if len(report.problems) > before:
        return None
    (kind,), found = given, values[given[0]]
    options = tuple(found) if kind == "values" else found.values() if kind == "range" else ()
    name, mode = values["name"] or keys[0].text, values["mode"]
    variation = Variation(name, tuple(keys), mode, options, None if options else found)
    if mode != "value" and not all(isinstance(x, int | float) and not isinstance(x, bool) for x in options):
        report(f"{where}.mode", quoted(mode), "only for values that are numbers")
    if variation.names_robot and not (options and all(isinstance(x, str) for x in options)):
        report(f"{where}.values", "", 'must be paths of robot.toml files, in quotes, for key = "robot"')
    return variation if len(report.problems) == before else None


def _unit(table: Mapping[str, Any]) -> str:
    """Unit of the values of a variation; empty for factors, and where its key is wrong."""
    keys = table.get("keys")
    key = table.get("key", keys[0] if isinstance(keys, list) and keys else None)
    if not isinstance(key, str) or table.get("mode") == "factor":
        return ""
    try:
        return unit_of(parse_key(key))
    except KeyProblem:
        return ""


def _with_numbers(values: Any, unit: str) -> Any:
    """A table of `sweep.toml` with numbers in place of texts such as "250 mm"."""
    if isinstance(values, dict):
        return {name: _with_numbers(x, unit) for name, x in values.items()}
    if isinstance(values, list):
        return [_with_numbers(x, unit) for x in values]
    number = number_or_none(values, unit) if isinstance(values, str) else None
    return values if number is None else number


def _workspace(
    table: Any, scenario: Scenario, sampling: Sampling | None, report: Reporter
) -> list[Variation | None]:
    """One variation per tendon: its tension in the last load step."""
    names = scenario.robot.tendon_names
    values, bad = WORKSPACE.read(table, "workspace", report.mistake)
    if bad or sampling is None:
        return []
    if not names:
        report("workspace", "", "the robot has no tendons")
    low, high = (
        _by_tendon(f"workspace.{which}", values[which], names, report) for which in ("smallest", "largest")
    )
    count = values["count"]
    if count is not None and sampling.is_sample:
        report("workspace.count", str(count), 'only for method = "grid"')
    if count is None and not sampling.is_sample:
        report("workspace.count", "", 'missing; method = "grid" needs values per tendon')
    found: list[Variation | None] = []
    for name in [n for n in names if n in low and n in high]:
        least, most = low[name], high[name]
        keys = (parse_key(join("steps[-1].tensions", name)),)
        if not least < most:
            text = f"must be above smallest, {least:g} N, for tendon {quoted(name)}"
            report("workspace.largest", f"{most:g}", text)
        elif count is None:
            found.append(Variation(f"pull_{name}", keys, distribution=Uniform(least, most)))
        else:
            found.append(Variation(f"pull_{name}", keys, options=Range(least, most, count).values()))
    return found


def _by_tendon(
    key: str, value: float | dict[str, float], names: Sequence[str], report: Reporter
) -> dict[str, float]:
    """Tension of every tendon; wrong names are reported."""
    if not isinstance(value, dict):
        return dict.fromkeys(names, value)
    for name in value:
        if name not in names:
            text = f"unknown tendon{meant(name, names)}; there are {', '.join(names)}"
            report(join(key, name), shown(value[name]), text)
    for name in names:
        if name not in value:
            report(key, shown(value), f"tendon {quoted(name)} is missing")
    return value


def _output(table: Any, scenario: Scenario, report: Reporter) -> Output:
    """The table ``[output]``, checked against the load steps and the tendons of the scenario."""
    values, bad = OUTPUT.read(table, "output", report.mistake)
    if bad:
        return Output()
    count, steps = len(scenario.steps), values["steps"]
    if isinstance(steps, tuple) and not (steps and max(steps) <= count):
        report("output.steps", shown(list(steps)), f"must be {_STEPS} to {count}")
    known = columns_of_steps(scenario.robot.tendon_names)
    for i, name in enumerate(values["quantities"]):
        if name not in known:
            text = f"unknown{meant(name, known)}; there are {', '.join(known)}"
            report(f"output.quantities[{i}]", shown(name), text)
    chosen = {"last": (), "all": tuple(range(1, count + 1))}.get(steps) if isinstance(steps, str) else steps
    return Output(tuple(dict.fromkeys(chosen or ())), tuple(dict.fromkeys(values["quantities"])))


def _robots(
    variations: Sequence[Variation], tables: ScenarioTables, report: Reporter
) -> dict[str, ScenarioTables]:
    """Tables with every robot that a variation names, by its path."""
    found: dict[str, ScenarioTables] = {}
    for v in variations:
        for name in v.options if v.names_robot else ():
            other = with_robot_table({**tables.scenario, "robot": name}, tables.path)
            problems = [replace(p, file=report.file, key=v.name) for p in other.problems if p.key == "robot"]
            report.problems.extend(problems or other.problems)
            found[name] = other
    return found


def _check_together(
    sampling: Sampling, variations: Sequence[Variation], scenario: Scenario, report: Reporter
) -> None:
    """Contradictions between the variations."""
    if not variations:
        report("vary", "", "nothing is varied; must have a table [[vary]], or [workspace]")
    names = [v.name for v in variations]
    for name in sorted({n for n in names if names.count(n) > 1}):
        report("vary", quoted(name), "is varied twice, or the name of two columns")
    for name in names:
        if name in (*ABOUT_CASE, *columns_of_steps(scenario.robot.tendon_names)):
            report("vary", quoted(name), "is the name of another column of the table; give another name")
    for i, v in enumerate(variations):
        if v.distribution is not None and not sampling.is_sample:
            text = f"needs sampling.method = {' or '.join(map(quoted, SAMPLED))}, or give values or range instead"
            report(f"vary[{i}]", shown(v.name), f"a distribution {text}")
    if report.problems:
        return
    lengths = [len(v.options) for v in variations]
    if sampling.method == "list" and len(set(lengths)) > 1:
        text = ", ".join(f"{n} of {v.name}" for n, v in zip(lengths, variations, strict=True))
        report("vary", "", f'method = "list" needs as many values of each; there are {text}')
    count = math.prod(lengths) if sampling.method == "grid" else 0
    if sampling.method == "saltelli":
        count = (sampling.samples or 0) * (len(variations) + 2)
    if count > MOST_CASES:
        text = f"gives {count} cases; must be at most {MOST_CASES}"
        report("sampling.method", quoted(sampling.method), text)


def _value_problems(sweep: Sweep, further_tables: Mapping[str, TableReader]) -> list[Problem]:
    """Values that the files do not allow.

    A value is refused where it is wrong alone, all others as declared, and in every case tried that has it as well.
    Other contradictions, which only some combinations have, become the status of their cases.
    """
    design = sweep.design()

    def mistakes(number: int) -> list[Problem]:
        """Of a case, counted from 0."""
        return _mistakes(sweep, list(zip(sweep.variations, design.case(number), strict=True)), further_tables)

    found: list[Problem] = []
    for i, (variation, column) in enumerate(zip(sweep.variations, design.columns, strict=True)):
        in_workspace = sweep.workspace and variation.name.startswith("pull_")
        where = "workspace" if in_workspace else f"vary[{i}]"
        mine: dict[Problem, None] = {}
        for case in _checked(column):
            problems = _mistakes(sweep, [(variation, column[case])], further_tables)
            if problems and all(mistakes(k) for k in _cases_with(column, case)):
                mine |= dict.fromkeys(_said(sweep.path, where, variation, column[case], p) for p in problems)
        some = list(mine)[:MOST_REPORTED]
        if len(mine) > len(some):
            some[-1] = replace(some[-1], allowed=f"{some[-1].allowed} (and {len(mine) - len(some)} more)")
        found += some
    return found


def _checked(column: Column) -> list[int]:
    """First cases, from 0, with the values that are checked: the options, or the smallest and the largest number."""
    if not column.options:
        return list(dict.fromkeys((int(column.numbers.argmin()), int(column.numbers.argmax()))))
    numbers, first = np.unique(column.numbers, return_index=True)
    if len(numbers) > MOST_CHECKED:
        first = first[np.linspace(0, len(numbers) - 1, MOST_CHECKED).astype(int)]
    return [int(k) for k in first]


def _cases_with(column: Column, case: int) -> list[int]:
    """Cases with the same value, from 0: all of them, or some drawn at random."""
    same = np.flatnonzero(column.numbers == column.numbers[case])
    if len(same) > MOST_TRIED:
        same = np.random.default_rng(0).choice(same, MOST_TRIED, replace=False)
    return [int(k) for k in same]


def _mistakes(
    sweep: Sweep, values: list[tuple[Variation, Any]], further_tables: Mapping[str, TableReader]
) -> list[Problem]:
    """Mistakes of the files with some values, all others as declared; a key that names nothing is one without a key."""
    try:
        build_scenario(tables_with(sweep, values), further_tables)
    except KeyProblem as error:
        return [Problem("", "", "", str(error))]
    except InputError as error:
        return list(error.problems)
    return []


def _said(path: str, where: str, variation: Variation, value: Any, found: Problem) -> Problem:
    """A mistake of the files, said of the sweep that made it."""
    texts = [key.text for key in variation.keys]
    if not found.key or found.allowed.startswith("unknown"):
        return Problem(path, f"{where}.key", ", ".join(map(quoted, texts)), found.allowed)
    about = found.allowed if found.key in texts else f"{found.key} = {found.value}: {found.allowed}"
    if variation.distribution is None:
        return Problem(path, f"{where}.values", shown(value), f"{', '.join(texts)}: {about}")
    name, _ = variation.distribution.described()
    text = f"the sample has this value of {texts[0]}: {about}; bounds (lower, upper) leave such values out"
    return Problem(path, f"{where}.{name}", f"{value:.6g}", text)
