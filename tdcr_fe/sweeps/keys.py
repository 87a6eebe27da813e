"""Keys of a sweep: which value of a robot, a scenario or an effect they name, and tables with another value there."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

from tdcr_fe.io.keys import ROBOT, SCENARIO, json_schema
from tdcr_fe.io.toml import ScenarioTables
from tdcr_fe.model.messages import join, meant, quoted

#: Tables and keys at the top of the two files.
IN_SCENARIO, IN_ROBOT = [name for name in SCENARIO if name != "robot"], list(ROBOT)

_PART = re.compile(r'\.(?:"((?:[^"\\]|\\.)*)"|([A-Za-z0-9_-]+))|\[(-?\d+)\]')

#: Where a value stands: names of tables and keys, and numbers of list items, from the top of a file.
Key = tuple[str | int, ...]
#: From the value that stands in a file, None where there is none, to the one that replaces it.
Change = Callable[[Any], Any]


class KeyProblem(ValueError):
    """A key that names nothing, or whose value cannot be changed as asked; the message is what is allowed."""


def parse_key(text: str) -> Key:
    """A key such as ``backbone.radius``, ``tendons.t1.offset``, ``steps[0].tensions.t1`` or ``effects.gravity.g_z``.

    Raises
    ------
    KeyProblem
        It is not a dotted key, or begins with no table of the files.
    """
    path: list[str | int] = []
    rest = "." + text if not text.startswith("[") else ""  # no list has a number without a name
    while match := _PART.match(rest):
        quoted_name, name, number = match.groups()
        path.append(int(number) if number else name or re.sub(r"\\(.)", r"\1", quoted_name))
        rest = rest[match.end() :]
    if rest or not path:
        example = "backbone.radius, tendons.t1.offset or steps[0].tensions.t1"
        raise KeyProblem(f"must be a dotted key, such as {example}")
    options = [*IN_ROBOT, *IN_SCENARIO]
    if path[0] not in options:
        raise KeyProblem(f"unknown key{meant(path[0], options)}; must begin with one of {', '.join(options)}")
    return tuple(path)


@cache
def unit_of(key: Key) -> str:
    """Unit of the numbers at a key; empty where they have none."""
    return next((unit for _, unit in _schemas(key) if unit), "")


def _schemas(key: Key) -> list[tuple[dict[str, Any], str]]:
    """JSON schemas of what may stand at a key, each with its unit."""
    nodes = [(json_schema("robot" if key[0] in IN_ROBOT else "scenario"), "")]
    for part in key:
        nodes = [(n, n.get("unit", unit)) for node, unit in nodes for n in _below(node, part)]
    return nodes


def _below(node: Any, part: str | int) -> list[dict[str, Any]]:
    """JSON schemas of what may stand at one part of a key: of a list also in each of its tables."""
    alternatives = [n for word in ("oneOf", "anyOf") for x in node.get(word, ()) for n in _below(x, part)]
    items = [x for x in (*node.get("prefixItems", ()), node.get("items")) if x]
    in_items = [*items, *(n for x in items if isinstance(part, str) for n in _below(x, part))]
    named = node.get("properties", {}).get(part, node.get("additionalProperties"))
    return [*in_items, *([named] if isinstance(named, dict) else []), *alternatives]


def set_value(tables: ScenarioTables, key: Key, change: Change) -> ScenarioTables:
    """Tables in which the value at a key is changed; the given ones stay as they are.

    Parameters
    ----------
    tables
        Tables of scenario and robot.
    key
        Key of the value.
    change
        From the present value to the new one.

    Raises
    ------
    KeyProblem
        There is no such place.
    """
    if key[0] in IN_ROBOT:
        return replace(tables, robot=_changed(tables.robot or {}, key, change, ""))
    return replace(tables, scenario=_changed(tables.scenario, key, change, ""))


def _changed(node: Any, path: Key, change: Change, where: str) -> Any:
    """A copy of ``node`` with the value at ``path`` below it changed."""
    if not path:
        return change(node)
    head, rest = path[0], path[1:]
    if isinstance(head, int):
        items = _default_list(where) if node is None else node
        if not isinstance(items, list):
            raise KeyProblem(f"{where} is not a list in the file; there is no {where}[{head}]")
        if not -len(items) <= head < len(items):
            most = f"{where}[{len(items) - 1}]"
            raise KeyProblem(f"there are {len(items)} {where}; must be from {where}[0] to {most}")
        return _with_items(items, {head % len(items): rest}, change, where)
    if isinstance(node, list) and node and all(isinstance(x, Mapping) for x in node):
        return _with_items(node, _meant_tables(node, head, path, where), change, where)
    if node is not None and not isinstance(node, Mapping):
        raise KeyProblem(f"{where} is not a table; there is nothing named {quoted(head)} in it")
    table = dict(node or {})
    table[head] = _changed(table.get(head), rest, change, join(where, head))
    return table


def _with_items(items: list[Any], paths: Mapping[int, Key], change: Change, where: str) -> list[Any]:
    """A list with the values at paths below some of its items changed."""
    return [_changed(x, paths[k], change, join(where, k)) if k in paths else x for k, x in enumerate(items)]


def _meant_tables(node: list[Any], head: str, path: Key, where: str) -> dict[int, Key]:
    """Tables of a list that a key means: the one of that name; else all of them, or all load steps that have it."""
    names = [x.get("name") for x in node]
    if head in names:
        return {names.index(head): path[1:]}
    if where == "steps":
        paths = {k: path for k, x in enumerate(node) if _has(x, path)}
        if not paths:
            key = join("", *path)
            raise KeyProblem(f"no load step has {key}; steps[0].{key} sets it in the first one")
        return paths
    if len(path) > 1 and where == "tendons" and not any(head in x for x in node):
        known = [n for n in names if isinstance(n, str)]
        text = f"there is no tendon {quoted(head)}{meant(head, known)}; there are {', '.join(known)}"
        raise KeyProblem(text)
    return {k: path for k in range(len(node))}


def _has(node: Any, path: Key) -> bool:
    """Whether a value stands at a path."""
    for part in path:
        try:
            node = node[part]
        except (IndexError, KeyError, TypeError):
            return False
    return True


def _default_list(where: str) -> list[Any] | None:
    """Default of a list that a file may leave out, such as gravity; None where there is none."""
    defaults = (node.get("default") for node, _ in _schemas(parse_key(where)))
    return next((list(x) for x in defaults if isinstance(x, list | tuple) and x), None)
