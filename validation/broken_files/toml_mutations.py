"""Mutations of TOML files: of their keys and values (from their data), and of their text."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

Path = tuple[str | int, ...]
Random = np.random.Generator
#: A mutated text or data, the path of what was changed, its value as text, and whether it must be refused.
Mutated = tuple[str, Path, str, bool]

#: Tables whose keys are names of the user's choice.
_FREE_NAMES = ("loads",)
#: Keys whose value may be anything: texts for people.
_FREE_TEXTS = ("name", "label")


def to_toml(data: Mapping[str, Any]) -> str:
    """A TOML text with these contents; tables are inline."""
    return "".join(f"{_key(k)} = {_value(v)}\n" for k, v in data.items())


class Raw(str):
    """A value that is written as it is."""


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _quoted(key)


def _quoted(text: str) -> str:
    escaped = "".join(
        f"\\u{ord(c):04x}" if ord(c) < 32 or ord(c) == 127 else "\\" + c if c in '"\\' else c for c in text
    )
    return f'"{escaped}"'


def _value(value: Any) -> str:
    if isinstance(value, Raw):
        return str(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    return repr(value)


def paths(data: Any, above: Path = ()) -> Iterator[Path]:
    """Paths of all keys and items, tables and lists included."""
    items = data.items() if isinstance(data, Mapping) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield (*above, key)
        yield from paths(value, (*above, key))


def at(data: Any, path: Path) -> Any:
    """The value at a path."""
    for part in path:
        data = data[part]
    return data


def _numbers(data: Any) -> list[Path]:
    return [
        p for p in paths(data) if isinstance(at(data, p), int | float) and not isinstance(at(data, p), bool)
    ]


def _pick(rng: Random, found: list[Any]) -> Any:
    if not found:
        raise LookupError("there is nothing to change")
    return found[int(rng.integers(len(found)))]


def _with(data: Any, path: Path, value: Any) -> Any:
    changed = copy.deepcopy(data)
    at(changed, path[:-1])[path[-1]] = value
    return changed


# -------------------------------------------------------------------------------------------- keys and values


def delete_key(rng: Random, data: Any) -> Mutated:
    """A key, table or item is not there."""
    path = _pick(rng, list(paths(data)))
    changed = copy.deepcopy(data)
    del at(changed, path[:-1])[path[-1]]
    return to_toml(changed), path, "", False


def rename_key(rng: Random, data: Any) -> Mutated:
    """A key is misspelt."""
    path = _pick(rng, [p for p in paths(data) if isinstance(p[-1], str)])
    old = str(path[-1])
    k = int(rng.integers(len(old)))
    new = str(
        rng.choice([old[:k] + old[k:][::-1] + "x", old + old[-1], old[:k] + old[k + 1 :] + "q", old.upper()])
    )
    above = at(data, path[:-1])
    table = {(new if key == old else key): value for key, value in above.items()}
    changed = table if len(path) == 1 else _with(data, path[:-1], table)
    free = len(path) > 1 and path[-2] in _FREE_NAMES
    return to_toml(changed), (*path[:-1], new), "", new != old and not free


def add_key(rng: Random, data: Any) -> Mutated:
    """A table has a key that is unknown."""
    path = _pick(rng, [(), *(p for p in paths(data) if isinstance(at(data, p), dict))])
    free = bool(path) and path[-1] in _FREE_NAMES
    table = {**at(data, path), "colour": "red"}
    changed = table if not path else _with(data, path, table)
    return to_toml(changed), (*path, "colour"), "red", not free


def text_for_number(rng: Random, data: Any) -> Mutated:
    """A text where a number belongs."""
    path = _pick(rng, _numbers(data))
    text = str(rng.choice(["abc", "0.25", "1,5", "5 mn", "", "nan", "none"]))
    return to_toml(_with(data, path, text)), path, text, True


def boolean_for_number(rng: Random, data: Any) -> Mutated:
    """True or false where a number belongs."""
    path = _pick(rng, _numbers(data))
    value = bool(rng.integers(2))
    return to_toml(_with(data, path, value)), path, str(value).lower(), True


def other_type(rng: Random, data: Any) -> Mutated:
    """A table, list, text, number or date where another type belongs."""
    path = _pick(rng, list(paths(data)))
    date = Raw("1979-05-27")
    value = _pick(rng, [{}, {"a": 1}, [], [1, 2], [[1.0, 2.0]], "text", 3, 0.5, True, date, [{"a": 1}]])
    return to_toml(_with(data, path, value)), path, str(value), False


def number(rng: Random, data: Any) -> Mutated:
    """A number that is negative, zero, tiny or huge."""
    path = _pick(rng, _numbers(data))
    old, endless = at(data, path), Raw("1" + 400 * "0")
    around = [0, -1, -old, 1e-300, -1e-12, 1e6 * old, 1e300]
    value = _pick(rng, [*around, 10**6, 10**30, endless, 5e-324, 3.7, 2**63])
    return to_toml(_with(data, path, value)), path, str(value), False


def not_finite(rng: Random, data: Any) -> Mutated:
    """A number that is not finite."""
    path = _pick(rng, _numbers(data))
    value = str(rng.choice(["nan", "inf", "-inf", "-nan"]))
    return to_toml(_with(data, path, Raw(value))), path, value, "nan" in value


def other_text(rng: Random, data: Any) -> Mutated:
    """Another text: unknown, empty, long, with line feeds or characters of all kinds."""
    path = _pick(rng, [p for p in paths(data) if isinstance(at(data, p), str)])
    odd = ["a\nb\tc", "ü\u0000\u202e\U0001f916", "../..", "<b>&amp;</b>", "=1+1"]
    value = _pick(rng, ["nonsense", "", " ", 100_000 * "x", *odd])
    return to_toml(_with(data, path, value)), path, value[:40], False


def unknown_tendon(rng: Random, data: Any) -> Mutated:
    """A step, spring or variation names a tendon that is not there."""
    tables = [
        p for p in paths(data) if p[-1] in ("tensions", "displacements") and isinstance(at(data, p), dict)
    ]
    path = _pick(rng, tables)
    return to_toml(_with(data, path, {**at(data, path), "nobody": 0.1})), (*path, "nobody"), "nobody", True


def long_list(rng: Random, data: Any) -> Mutated:
    """A list that is very long."""
    path = _pick(rng, [p for p in paths(data) if isinstance(at(data, p), list)])
    old = at(data, path)
    counts = [300, 20_000] if old and isinstance(old[0], dict) else [1000, 100_000]
    times = int(rng.choice(counts))
    return to_toml(_with(data, path, (old * times)[: max(times, 1)])), path, f"{times} items", False


def deep(rng: Random, data: Any) -> Mutated:
    """A value nested very deep."""
    path = _pick(rng, list(paths(data)))
    depth = int(rng.choice([30, 5000]))
    text = to_toml(_with(data, path, Raw(depth * "[" + depth * "]")))
    return text, path if depth < 100 else (), "[[[", False


def exchange_values(rng: Random, data: Any) -> Mutated:
    """Two values of one table change places."""
    tables = [(), *(p for p in paths(data) if isinstance(at(data, p), dict))]
    path = _pick(rng, [p for p in tables if len(at(data, p)) > 1])
    table = dict(at(data, path))
    a, b = (str(k) for k in rng.choice(list(table), 2, replace=False))
    table[a], table[b] = table[b], table[a]
    return to_toml(table if not path else _with(data, path, table)), (*path, a), "", False


def duplicate_item(rng: Random, data: Any) -> Mutated:
    """An item of a list, such as a tendon, is there twice."""
    path = _pick(rng, [p for p in paths(data) if isinstance(p[-1], int)])
    changed = copy.deepcopy(data)
    above = at(changed, path[:-1])
    above.insert(int(path[-1]), copy.deepcopy(above[int(path[-1])]))
    return to_toml(changed), path, "", False


DATA_MUTATIONS: tuple[Callable[[Random, Any], Mutated], ...] = (
    delete_key,
    rename_key,
    add_key,
    text_for_number,
    boolean_for_number,
    other_type,
    number,
    not_finite,
    other_text,
    unknown_tendon,
    long_list,
    deep,
    exchange_values,
    duplicate_item,
)


# -------------------------------------------------------------------------------------------------- the text


def _line_with_key(rng: Random, text: str) -> re.Match[str]:
    found: re.Match[str] = _pick(rng, list(re.finditer(r"(?m)^([A-Za-z_]+) = (.*)$", text)))
    return found


def duplicate_key(rng: Random, text: str) -> Mutated:
    """A key is there twice."""
    line = _line_with_key(rng, text)
    return text[: line.end()] + "\n" + line.group() + text[line.end() :], ("line",), line.group(), True


def duplicate_table(rng: Random, text: str) -> Mutated:
    """A table is there twice."""
    header: re.Match[str] = _pick(rng, list(re.finditer(r"(?m)^\[[a-z]+\]$", text)))
    return text + "\n" + header.group() + "\n", ("line",), header.group(), True


def _replaced(text: str, found: re.Match[str], new: str) -> str:
    return text[: found.start()] + new + text[found.end() :]


def decimal_comma(rng: Random, text: str) -> Mutated:
    """A number with a decimal comma."""
    found: re.Match[str] = _pick(rng, list(re.finditer(r"(?m)(?<== )(\d+)\.(\d+)(?=[e\d\s-])", text)))
    return _replaced(text, found, found.group().replace(".", ",")), ("line",), found.group(), True


def semicolons(rng: Random, text: str) -> Mutated:
    """Lines end in semicolons."""
    return re.sub(r"(?m)^([a-z_]+ = [^#\n]*)$", r"\1;", text), ("line",), ";", True


def without_quotes(rng: Random, text: str) -> Mutated:
    """A text without its quotes."""
    found: re.Match[str] = _pick(rng, list(re.finditer(r'= "([a-z][^"]*)"', text)))
    return _replaced(text, found, "= " + found.group(1)), ("line",), found.group(1), True


def truncated(rng: Random, text: str) -> Mutated:
    """The end is missing."""
    return text[: int(rng.integers(1, len(text)))], (), "", False


def without_character(rng: Random, text: str) -> Mutated:
    """One character is missing."""
    k = int(rng.integers(len(text)))
    return text[:k] + text[k + 1 :], (), text[k], False


def with_character(rng: Random, text: str) -> Mutated:
    """One more character."""
    k = int(rng.integers(len(text)))
    more = str(rng.choice(list("\"[]{}=#'\x00\x07,.-e9")))
    return text[:k] + more + text[k:], (), more, False


def other_line_ends(rng: Random, text: str) -> Mutated:
    """Lines end as on Windows or old Macs."""
    return text.replace("\n", str(rng.choice(["\r\n", "\r"]))), (), "", False


TEXT_MUTATIONS: tuple[Callable[[Random, str], Mutated], ...] = (
    duplicate_key,
    duplicate_table,
    decimal_comma,
    semicolons,
    without_quotes,
    truncated,
    without_character,
    with_character,
    other_line_ends,
)
