"""Read `sweep.toml`: all mistakes in it, and in the files that it names, are found before anything is solved."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from tdcr_fe.effects import Effect
from tdcr_fe.elements.drives import TENSION
from tdcr_fe.io.files import InputError, Problem, Reporter, StrPath, refusal
from tdcr_fe.io.keys import json_schema
from tdcr_fe.io.toml import Scenario, ScenarioTables, build_scenario, digest, read_scenario_tables, read_toml
from tdcr_fe.io.user_effects import read_own_effects
from tdcr_fe.io.write_toml import robot_to_toml, scenario_to_toml
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.messages import join, meant, quoted, shown
from tdcr_fe.model.plausibility import plausibility
from tdcr_fe.model.robot import by_tendon
from tdcr_fe.model.schema import FieldError, Keys, Quantity
from tdcr_fe.model.units import PATTERN, number_or_none, with_units
from tdcr_fe.sweeps.cases import ABOUT_CASE, columns_of_steps, tables_with
from tdcr_fe.sweeps.description import (
    MOST_CASES,
    SAMPLED,
    VALUES,
    Change,
    Output,
    Range,
    Sampling,
    Sweep,
    Uniform,
    Variation,
    Workspace,
)
from tdcr_fe.sweeps.keys import KeyProblem, parse_key, unit_of

#: Most values of one variation that are checked (of more, as many at equal distances), and most cases that are tried
#: with a value that is wrong alone.
MOST_CHECKED, MOST_TRIED = 200, 30

_PATH = "the path of a scenario.toml, in quotes, relative to this file"
_TABLES = "tables [[vary]], one for each variation"
#: Keys at the top of ``sweep.toml``.
TOP = Keys(
    {
        "scenario": Annotated[str, Quantity("path of the scenario", allowed=_PATH)],
        "sampling": Annotated[Sampling, Quantity("a table [sampling] with method, samples, seed")],
        "vary": Annotated[tuple[Variation, ...], Quantity(_TABLES, allowed=_TABLES)],
        "workspace": Annotated[Workspace, Quantity("a table [workspace] with largest")],
        "output": Annotated[Output, Quantity("a table [output] with steps, quantities")],
    },
    {"sampling": Sampling(), "vary": (), "workspace": None, "output": Output()},
)
#: Objects that a sweep in Python may have in place of the path of a scenario.
OBJECTS = ("robot", "model", "steps", "solver")


def sweep_schema() -> dict[str, Any]:
    """JSON schema (draft 2020-12) of ``sweep.toml``; `json_schema` has those of the other files."""
    schema = TOP.json_schema
    vary = schema["properties"]["vary"]
    table = {**_or_texts(vary["items"]), "anyOf": [{"required": [name]} for name in VALUES]}
    head = {"$schema": json_schema("scenario")["$schema"], "title": "sweep.toml of tdcr_fe"}
    return {**schema, **head, "properties": {**schema["properties"], "vary": {**vary, "items": table}}}


def _or_texts(node: Any) -> Any:
    """A JSON schema in which numbers may also be texts with the unit of the key that varies."""
    if isinstance(node, list):
        return [_or_texts(x) for x in node]
    if not isinstance(node, dict):
        return node
    text = {"type": ["number", "string"], "pattern": PATTERN} if node.get("type") == "number" else {}
    return {name: _or_texts(x) for name, x in node.items()} | text


def read_sweep(source: StrPath | Mapping[str, Any], effects: Sequence[StrPath] = ()) -> Sweep:
    """Read and check a sweep.

    Parameters
    ----------
    source
        Path of a `sweep.toml`, or its contents. There ``robot``, ``model``, ``steps`` and ``solver`` may be objects in
        place of the path of a scenario, and paths are relative to the working directory.
    effects
        Python files with effects of your own.

    Raises
    ------
    InputError
        With every mistake in the sweep and the files that it names.
    """
    if isinstance(source, Mapping):
        path, digests = Path("sweep"), {}
        objects = {name: x for name, x in source.items() if name in OBJECTS}
        data = {name: x for name, x in source.items() if name not in OBJECTS}
        data |= {"scenario": "(objects)"} if objects else {}
    else:
        path, objects = Path(source), {}
        data, sha256 = read_toml(path)
        digests = {str(path): sha256}
        if {"robot", "steps"} & data.keys():
            raise refusal(path, "is the file of a scenario; give the sweep.toml that names it")
    report = Reporter(str(path))
    user_effects: Sequence[Effect] = report.sound(lambda: read_own_effects(effects)) or ()
    top = _top(data, report)
    tables: Any = None
    if objects:
        tables = _tables_of(objects, path)
    elif "scenario" in top:
        name = top["scenario"]
        named = Problem(str(path), "scenario", shown(name), "")
        tables = report.sound(lambda: read_scenario_tables(path.parent / name, named))
    scenario: Any = tables and report.sound(lambda: build_scenario(tables, user_effects))
    wrong = bool(report.problems)
    if scenario and "output" in top:
        _check_output(top["output"], scenario, report)
    if wrong and scenario and top.get("vary"):  # what is wrong with keys is told, too: of one case
        _check_values(Sweep(tables, top["vary"], Sampling("sobol", 1)), user_effects, report)
    if wrong:
        report.refuse()
    sampling, output, workspace = top["sampling"], top["output"], top["workspace"]
    variations = (*top["vary"], *(_workspace(workspace, scenario, sampling, report) if workspace else ()))
    digests |= {**tables.digests, **{str(p): digest(p) for p in effects}}
    sweep = Sweep(tables, variations, sampling, output, workspace is not None, digests, (*map(str, effects),))
    if _check_together(sweep, scenario, report):
        _check_values(sweep, user_effects, report)
    report.refuse()
    with suppress(ValueError):  # of a case that is refused the reason is in the table
        plausibility(scenario.robot, scenario.model, scenario.steps).issued()
    return sweep


def _top(data: dict[str, Any], report: Reporter) -> dict[str, Any]:
    """Tables of the sweep but those that are wrong; values of variations may be texts with a unit."""
    given = data.get("vary")
    units = [_unit(table) for table in given] if isinstance(given, list) else []
    if units:
        data = {**data, "vary": [_with_numbers(x, u) for x, u in zip(given or (), units, strict=True)]}

    def note(key: str, value: str, allowed: str) -> None:
        place = re.match(r"vary\[(\d+)\]", key)
        if place and value.startswith('"') and "number" in allowed:
            allowed = with_units(allowed, value.strip('"'), units[int(place[1])])
        report(key, value, allowed)

    return TOP.read(data, "", note)[0]


def _unit(table: Any) -> str:
    """Unit of the values of a variation; empty for factors, and where its key is wrong."""
    try:
        return "" if table.get("mode") == "factor" else unit_of(parse_key(table["key"]))
    except (AttributeError, KeyError, TypeError, KeyProblem):
        return ""


def _with_numbers(values: Any, unit: str) -> Any:
    """A table of `sweep.toml` with numbers in place of texts such as "250 mm"."""
    if isinstance(values, dict):
        return {name: _with_numbers(x, unit) for name, x in values.items()}
    if isinstance(values, list):
        return [_with_numbers(x, unit) for x in values]
    number = number_or_none(values, unit) if isinstance(values, str) else None
    return values if number is None else number


def _tables_of(objects: Mapping[str, Any], path: Path) -> ScenarioTables:
    """Tables of a scenario that is given by objects.

    Raises
    ------
    ValueError
        The robot has what the file format cannot express.
    """
    model, steps = objects.get("model", Model()), objects.get("steps", [LoadStep("workspace")])
    scenario = scenario_to_toml(model, steps, settings=objects.get("solver"))
    robot = robot_to_toml(objects["robot"])
    return ScenarioTables(tomllib.loads(scenario), tomllib.loads(robot), path, path)


def _workspace(table: Workspace, scenario: Scenario, sampling: Sampling, report: Reporter) -> list[Variation]:
    """One variation per tendon: its tension in the last load step."""
    names = scenario.robot.tendon_names
    if not names:
        report("workspace", "", "the robot has no tendons")
    for drive, given in scenario.steps[-1].inputs():
        if given and drive is not TENSION:
            text = f"varies tensions; the last load step gives the {drive.label} of {', '.join(given)}: use [[vary]]"
            report("workspace", "", text)
    if table.count and sampling.is_sample:
        report("workspace.count", str(table.count), 'only for method = "grid"')
    if not table.count and not sampling.is_sample:
        report("workspace.count", "", 'missing; method = "grid" needs values per tendon')
    try:
        low = by_tendon("workspace.smallest", table.smallest, names, 0.0)
        high = by_tendon("workspace.largest", table.largest, names)
    except FieldError as error:
        report(error.field, error.value, error.allowed)
        return []
    if not (low < high).all():
        report("workspace.largest", shown(table.largest), "must be above smallest")
    variations: list[Variation] = []
    for name, least, most in zip(names, low.tolist(), high.tolist(), strict=True):
        if not report.problems:
            values: Any = {"uniform": Uniform(least, most)}
            if table.count:
                values = {"range": Range(least, most, table.count)}
            variations.append(Variation(join("steps[-1].tensions", name), name=f"pull_{name}", **values))
    return variations


def _check_output(output: Output, scenario: Scenario, report: Reporter) -> None:
    """The table ``[output]`` against the load steps and the tendons of the scenario."""
    count, steps = len(scenario.steps), output.steps
    if isinstance(steps, tuple) and not (steps and max(steps) <= count):
        text = f'must be "last", "all", or a list of the numbers of load steps, from 1 to {count}'
        report("output.steps", shown(list(steps)), text)
    known = columns_of_steps(scenario.robot.tendon_names)
    for i, name in enumerate(output.quantities):
        if name not in known:
            text = f"unknown{meant(name, known)}; there are {', '.join(known)}"
            report(f"output.quantities[{i}]", shown(name), text)


def _check_together(sweep: Sweep, scenario: Scenario, report: Reporter) -> bool:
    """Contradictions between the variations; whether there are cases all the same."""
    variations, sampling = sweep.variations, sweep.sampling
    if not variations and not report.problems:
        report("vary", "", "nothing is varied; must have a table [[vary]], or [workspace]")
    names = [v.column for v in variations]
    for name in dict.fromkeys(names):
        if names.count(name) > 1:
            report("vary", quoted(name), "is varied twice, or the name of two columns")
        if name in (*ABOUT_CASE, *columns_of_steps(scenario.robot.tendon_names)):
            report("vary", quoted(name), "is the name of another column of the table; give another name")
    before = len(report.problems)
    for i, v in enumerate(variations):
        if v.distribution is not None and not sampling.is_sample:
            text = f"needs sampling.method = {' or '.join(map(quoted, SAMPLED))}, or give values or range instead"
            report(f"vary[{i}]", shown(v.column), f"a distribution {text}")
    if len(report.problems) > before or not variations:
        return False
    lengths = [len(v.options) for v in variations]
    if sampling.method == "list" and len(set(lengths)) > 1:
        text = ", ".join(f"{n} of {v.column}" for n, v in zip(lengths, variations, strict=True))
        report("vary", "", f'method = "list" needs as many values of each; there are {text}')
    elif sweep.count > MOST_CASES:
        text = f"gives {sweep.count} cases; must be at most {MOST_CASES}"
        report("sampling.method", quoted(sampling.method), text)
    return len(report.problems) == before


def _check_values(sweep: Sweep, effects: Sequence[Effect], report: Reporter) -> None:
    """Report values that the files do not allow.

    A value is refused where it is wrong alone, all others as declared, and in every case tried that has it as well.
    Other contradictions, which only some combinations have, become the status of their cases.
    """
    design, found = sweep.design(), dict[tuple[str, str, str], None]()

    def problems_of(changes: Sequence[Change]) -> Sequence[Problem]:
        """Mistakes of the scenario with some changes; a key that names nothing is one without a key."""
        try:
            build_scenario(tables_with(sweep, changes), effects)
        except KeyProblem as error:
            return [Problem("", "", "", str(error))]
        except InputError as error:
            return error.problems
        return ()

    for i, v in enumerate(sweep.variations):
        where = "workspace" if sweep.workspace and v.column.startswith("pull_") else f"vary[{i}]"
        for value, cases in _checked(v, design[v.column]):
            problems = problems_of([(v.place, v.mode, value)])
            if problems and all(problems_of(sweep.changes(design, case)) for case in cases):
                found |= dict.fromkeys(_said(where, v, value, p) for p in problems)
    for mistake in found:
        report(*mistake)


def _checked(v: Variation, values: list[Any]) -> Iterator[tuple[Any, list[int]]]:
    """Values that are checked, options or the smallest and the largest number, and some cases that have them."""
    cases: dict[str, list[int]] = {}
    for case, value in enumerate(values):
        cases.setdefault(repr(value), []).append(case)
    every = v.options or (min(values), max(values))
    for k in np.linspace(0, len(every) - 1, min(len(every), MOST_CHECKED)).astype(int):
        if same := cases.get(repr(every[k])):
            yield every[k], same[:: max(1, len(same) // MOST_TRIED)]


def _said(where: str, v: Variation, value: Any, problem: Problem) -> tuple[str, str, str]:
    """Key, value and what is allowed of a mistake of the files, said of the variation that made it."""
    if not problem.key or problem.allowed.startswith("unknown"):
        return f"{where}.key", quoted(v.key), problem.allowed
    about = problem.allowed if problem.key == v.key else f"{problem.key} = {problem.value}: {problem.allowed}"
    kind, _ = v.described()
    if v.distribution is None:
        return f"{where}.{kind}", shown(value), f"{v.key}: {about}"
    text = f"the sample has this value of {v.key}: {about}; bounds (lower, upper) leave such values out"
    return f"{where}.{kind}", f"{value:.6g}", text
