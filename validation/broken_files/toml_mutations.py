"""Mutations of TOML files: of their keys and values (from their data), and of their text."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from tdcr_fe.io.write_toml import value_to_toml
from tdcr_fe.model.messages import bare

Path = tuple[str | int, ...]
Random = np.random.Generator
#: A mutated text, the path of what was changed, its value as text, and whether it must be refused.
Mutated = tuple[str, Path, str, bool]
Mutation = Callable[[Random, Any], Mutated]

#: Tables whose keys are names of the user's choice.
_FREE_NAMES = ("loads",)

#: Mutations by their names: from the data of a file, and from its text.
DATA_MUTATIONS: dict[str, Mutation] = {}
TEXT_MUTATIONS: dict[str, Mutation] = {}


def register(table: dict[str, Mutation]) -> Callable[[Mutation], Mutation]:
    """Enter a mutation in a table."""

    def enter(mutation: Mutation) -> Mutation:
        table[mutation.__name__] = mutation
        return mutation

    return enter


def pick(rng: Random, found: Sequence[Any]) -> Any:
    """One of several; `LookupError` where there are none."""
    if not found:
        raise LookupError("there is nothing to change")
    return found[int(rng.integers(len(found)))]


class Raw(str):
    """A value that is written as it is."""

    def __new__(cls, text: str) -> Raw:
        """With a mark, by which `to_toml` knows it."""
        return super().__new__(cls, f"as it is: {text}")

    def __str__(self) -> str:
        """Without the mark."""
        return self.partition(": ")[2]


def to_toml(data: Mapping[str, Any]) -> str:
    """A TOML text with these contents; tables are inline."""
    text = "".join(f"{bare(k)} = {value_to_toml(v)}\n" for k, v in data.items())
    return re.sub(r'"as it is: (\S+)"', r"\1", text)


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


def _of_type(data: Any, *types: type) -> list[Path]:
    """Paths of all values of certain types."""
    return [p for p in paths(data) if type(at(data, p)) in types]


def _tables(data: Any) -> list[Path]:
    return [(), *_of_type(data, dict)]


def _with(data: Any, path: Path, value: Any) -> Any:
    if not path:
        return value
    changed = copy.deepcopy(data)
    at(changed, path[:-1])[path[-1]] = value
    return changed


# -------------------------------------------------------------------------------------------- keys and values


_NUMBER = (int, float)
Judge = Callable[[Any], bool]


def _never(new: Any) -> bool:
    return False


def _replaced(types: tuple[type, ...], values: Callable[[Any], list[Any]], wrong: Judge = _never) -> Mutation:
    """A value of some type (any, where there are none) becomes another one, which may certainly be wrong."""

    def mutate(rng: Random, data: Any) -> Mutated:
        path = pick(rng, _of_type(data, *types) if types else list(paths(data)))
        value = pick(rng, values(at(data, path)))
        return to_toml(_with(data, path, value)), path, str(value)[:40], wrong(value)

    return mutate


_ENDLESS = Raw("1" + 400 * "0")
_LARGE_AND_SMALL = [10**6, 10**30, _ENDLESS, 5e-324, 3.7, 2**63]
_NOT_FINITE = [*map(Raw, ("nan", "inf", "-inf", "-nan"))]
_NO_NUMBERS = ["abc", "0.25", "1,5", "5 mn", "", "nan", "none"]
_ODD_TEXTS = [
    "nonsense",
    "",
    " ",
    100_000 * "x",
    "a\nb\tc",
    "ü\u0000\u202e\U0001f916",
    "../..",
    "<b>&amp;</b>",
    "=1+1",
]
_OF_ALL_TYPES = [{}, {"a": 1}, [], [1, 2], [[1.0, 2.0]], "text", 3, 0.5, True, Raw("1979-05-27"), [{"a": 1}]]


@register(DATA_MUTATIONS)
def delete_key(rng: Random, data: Any) -> Mutated:
    """A key, table or item is not there."""
    path = pick(rng, list(paths(data)))
    changed = copy.deepcopy(data)
    del at(changed, path[:-1])[path[-1]]
    return to_toml(changed), path, "", False


@register(DATA_MUTATIONS)
def rename_key(rng: Random, data: Any) -> Mutated:
    """A key is misspelt."""
    path = pick(rng, [p for p in paths(data) if isinstance(p[-1], str)])
    old = str(path[-1])
    k = int(rng.integers(len(old)))
    new = pick(rng, [old[:k] + old[k:][::-1] + "x", old + old[-1], old[:k] + old[k + 1 :] + "q", old.upper()])
    table = {(new if key == old else key): value for key, value in at(data, path[:-1]).items()}
    free = len(path) > 1 and path[-2] in _FREE_NAMES
    return to_toml(_with(data, path[:-1], table)), (*path[:-1], new), "", new != old and not free


@register(DATA_MUTATIONS)
def add_key(rng: Random, data: Any) -> Mutated:
    """A table has a key that is unknown."""
    path = pick(rng, _tables(data))
    free = bool(path) and path[-1] in _FREE_NAMES
    table = {**at(data, path), "colour": "red"}
    return to_toml(_with(data, path, table)), (*path, "colour"), "red", not free


DATA_MUTATIONS |= {
    "text_for_number": _replaced(_NUMBER, lambda old: _NO_NUMBERS, lambda new: True),
    "boolean_for_number": _replaced(_NUMBER, lambda old: [False, True], lambda new: True),
    "other_type": _replaced((), lambda old: _OF_ALL_TYPES),
    "number": _replaced(
        _NUMBER, lambda old: [0, -1, -old, 1e-300, -1e-12, 1e6 * old, 1e300, *_LARGE_AND_SMALL]
    ),
    "not_finite": _replaced(_NUMBER, lambda old: _NOT_FINITE, lambda new: "nan" in new),
    "other_text": _replaced((str,), lambda old: _ODD_TEXTS),
}


@register(DATA_MUTATIONS)
def unknown_tendon(rng: Random, data: Any) -> Mutated:
    """A step, spring or variation names a tendon that is not there."""
    path = pick(rng, [p for p in _of_type(data, dict) if p[-1] in ("tensions", "displacements")])
    return to_toml(_with(data, path, {**at(data, path), "nobody": 0.1})), (*path, "nobody"), "nobody", True


@register(DATA_MUTATIONS)
def long_list(rng: Random, data: Any) -> Mutated:
    """A list that is very long."""
    path = pick(rng, _of_type(data, list))
    old = at(data, path)
    times = pick(rng, [300, 20_000] if old and isinstance(old[0], dict) else [1000, 100_000])
    return to_toml(_with(data, path, (old * times)[:times])), path, f"{times} items", False


@register(DATA_MUTATIONS)
def deep(rng: Random, data: Any) -> Mutated:
    """A value nested very deep."""
    path = pick(rng, list(paths(data)))
    depth = pick(rng, [30, 5000])
    text = to_toml(_with(data, path, Raw(depth * "[" + depth * "]")))
    return text, path if depth < 100 else (), "[[[", False


@register(DATA_MUTATIONS)
def exchange_values(rng: Random, data: Any) -> Mutated:
    """Two values of one table change places."""
    path = pick(rng, [p for p in _tables(data) if len(at(data, p)) > 1])
    table = dict(at(data, path))
    a, b = (str(k) for k in rng.choice(list(table), 2, replace=False))
    table[a], table[b] = table[b], table[a]
    return to_toml(_with(data, path, table)), (*path, a), "", False


@register(DATA_MUTATIONS)
def duplicate_item(rng: Random, data: Any) -> Mutated:
    """An item of a list, such as a tendon, is there twice."""
    path = pick(rng, [p for p in paths(data) if isinstance(p[-1], int)])
    changed = copy.deepcopy(data)
    above = at(changed, path[:-1])
    above.insert(int(path[-1]), copy.deepcopy(above[int(path[-1])]))
    return to_toml(changed), path, "", False


# -------------------------------------------------------------------------------------------------- the text


def _substituted(pattern: str, new: Callable[[str], str]) -> Mutation:
    """What one match of a pattern becomes."""

    def mutate(rng: Random, text: str) -> Mutated:
        found: re.Match[str] = pick(rng, list(re.finditer(pattern, text)))
        changed = text[: found.start()] + new(found.group()) + text[found.end() :]
        return changed, ("line",), found.group(), True

    return mutate


TEXT_MUTATIONS["duplicate_key"] = _substituted(r"(?m)^[A-Za-z_]+ = .*$", lambda line: f"{line}\n{line}")


@register(TEXT_MUTATIONS)
def duplicate_table(rng: Random, text: str) -> Mutated:
    """A table is there twice."""
    header: re.Match[str] = pick(rng, list(re.finditer(r"(?m)^\[[a-z]+\]$", text)))
    return text + "\n" + header.group() + "\n", ("line",), header.group(), True


_DECIMAL = r"(?m)(?<== )\d+\.\d+(?=[e\d\s-])"
TEXT_MUTATIONS["decimal_comma"] = _substituted(_DECIMAL, lambda x: x.replace(".", ","))


@register(TEXT_MUTATIONS)
def semicolons(rng: Random, text: str) -> Mutated:
    """Lines end in semicolons."""
    return re.sub(r"(?m)^([a-z_]+ = [^#\n]*)$", r"\1;", text), ("line",), ";", True


TEXT_MUTATIONS["without_quotes"] = _substituted(r'= "[a-z][^"]*"', lambda x: x.replace('"', ""))


@register(TEXT_MUTATIONS)
def truncated(rng: Random, text: str) -> Mutated:
    """The end is missing."""
    return text[: int(rng.integers(1, len(text)))], (), "", False


@register(TEXT_MUTATIONS)
def without_character(rng: Random, text: str) -> Mutated:
    """One character is missing."""
    k = int(rng.integers(len(text)))
    return text[:k] + text[k + 1 :], (), text[k], False


@register(TEXT_MUTATIONS)
def with_character(rng: Random, text: str) -> Mutated:
    """One more character."""
    k = int(rng.integers(len(text)))
    more = pick(rng, "\"[]{}=#'\x00\x07,.-e9")
    return text[:k] + more + text[k:], (), more, False


@register(TEXT_MUTATIONS)
def other_line_ends(rng: Random, text: str) -> Mutated:
    """Lines end as on Windows or old Macs."""
    return text.replace("\n", pick(rng, ["\r\n", "\r"])), (), "", False
