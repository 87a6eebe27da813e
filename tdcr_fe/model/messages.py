"""Keys, values and load steps as text, what a key allows in words, the option that was probably meant, and warnings."""

from __future__ import annotations

import difflib
import json
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any


class TDCRWarning(UserWarning):
    """A result that should not be trusted blindly: its mesh, its friction path, its stability."""


class PlausibilityWarning(TDCRWarning):
    """A value that hardly any robot has, known before solving."""


class PlausibilityRemark(TDCRWarning):
    """Quantities of a description that hardly fit together, a level below a warning."""


#: Takes a text and its category.
Receiver = Callable[[str, type[TDCRWarning]], object]
#: Takes the warnings of the program; None: `warnings.warn`.
_receiver: ContextVar[Receiver | None] = ContextVar("receiver", default=None)


def issue(texts: Iterable[str], category: type[TDCRWarning] = TDCRWarning, depth: int = 3) -> None:
    """Warn the caller of the function that calls this one, or of one ``depth`` calls above the warning."""
    receive = _receiver.get()
    for text in texts:
        if receive is None:
            warnings.warn(text, category, stacklevel=depth)
        else:
            receive(text, category)


def _drop(text: str, category: type[TDCRWarning]) -> None:
    """Make nothing of a warning."""


@contextmanager
def warnings_to(receive: Receiver = _drop) -> Iterator[None]:
    """Hand the warnings that are issued inside over to a function; by default nothing becomes of them."""
    before = _receiver.set(receive)
    try:
        yield
    finally:
        _receiver.reset(before)


def ignore_warnings() -> None:
    """Issue no warnings in this process: its parent has them in the results."""
    _receiver.set(_drop)


#: Longest value in a message [characters].
LONGEST = 60
_COUNTS = {1: "one", 2: "two", 3: "three"}
#: By type in a JSON schema; numbers with a unit may be texts.
_NOUNS = {"number": "number", "['number', 'string']": "number", "integer": "whole number"}
_BOUNDS = {"exclusiveMinimum": "above {:g}", "minimum": "at least {:g}", "maximum": "at most {:g}"}


def quoted(text: str) -> str:
    """A text as TOML has it."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def count(number: float, noun: str, plural: str = "") -> str:
    """A number with its noun, in the singular or the plural."""
    return f"{number:.15g} {noun if number == 1 else plural or noun + 's'}"


def steps_named(numbers: Sequence[int]) -> str:
    """Load steps by their numbers, shortened where there are several."""
    if len(numbers) == 1:
        return f"step {numbers[0]}"
    return f"{len(numbers)} steps ({numbers[0]} to {numbers[-1]})"


def bare(name: str) -> str:
    """A bare key, or a quoted one where TOML requires it."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else quoted(name)


def join(key: str, *parts: str | int) -> str:
    """A dotted key with further parts: names, or indices of a list."""
    for part in parts:
        key += f"[{part}]" if isinstance(part, int) else f".{bare(part)}" if key else bare(part)
    return key


def as_toml(value: Any, of_object: Callable[[Any], str] = str) -> str:
    """A number, text, list or flat mapping as TOML; other objects as a function has them."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, Mapping):
        pairs = ", ".join(f"{bare(str(k))} = {as_toml(v, of_object)}" for k, v in value.items())
        return f"{{ {pairs} }}" if pairs else "{}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(as_toml(v, of_object) for v in value) + "]"
    return of_object(value)


def shown(value: Any) -> str:
    """A value as written in a TOML file, its middle left out where it is long."""
    try:
        text = as_toml(value)
    except ValueError:
        text = "a number of thousands of digits"
    return text if len(text) <= LONGEST else text[: LONGEST - 10] + " ... " + text[-5:]


def meant(given: Any, options: Iterable[str]) -> str:
    """A question that names the option most like what was given, or nothing."""
    names = {option.lower(): option for option in options}
    near = difflib.get_close_matches(str(given).lower(), names, n=1, cutoff=0.6)
    return f"; did you mean {names[near[0]]}?" if near else ""


def options(node: Mapping[str, Any]) -> list[str]:
    """Texts that a key takes, where there are few; from its JSON schema."""
    found = [*node.get("enum", ()), *([node["const"]] if "const" in node else [])]
    return found + [text for part in node.get("anyOf", ()) for text in options(part)]


def allowed(node: Mapping[str, Any]) -> str:
    """What a key allows, in words and without "must be"; from its JSON schema."""
    if "allowed" in node:
        return str(node["allowed"])
    rest = {k: node[k] for k in ("unit", "note") if k in node}
    if "anyOf" in node:
        parts = sorted(node["anyOf"], key=lambda part: not options(part))
        return " or ".join(allowed({**part, **rest}) for part in parts)
    if "oneOf" in node:
        names = ", ".join(quoted(part["properties"]["kind"]["const"]) for part in node["oneOf"])
        return f"a table with kind (one of {names}) and the keys of that kind"
    if options(node):
        *first, last = (quoted(o) for o in options(node))
        return f"{', '.join(first)} or {last}" if first else last
    if noun := _NOUNS.get(str(node.get("type"))):
        return numbers(node, "a ", noun, rest)
    if node.get("type") == "array":
        return _list(node, rest)
    if "properties" in node:
        return f"a table with {', '.join(node['properties'])}"
    if isinstance(item := node.get("additionalProperties"), Mapping):
        if "properties" in item:
            return f"a table of tables by name, each with {', '.join(item['properties'])}"
        return f"a table of values by name, each {allowed({**item, **rest})}"
    return {"string": "a text in quotes", "object": "a table"}.get(str(node.get("type")), "another value")


def numbers(node: Mapping[str, Any], article: str, noun: str, rest: Mapping[str, Any]) -> str:
    """Numbers of a JSON schema with unit, bounds and note, such as "a positive number [m], at most 10"."""
    words = [text.format(node[name]) for name, text in _BOUNDS.items() if name in node]
    adjective = "" if words else "finite "
    if node.get("exclusiveMinimum") == 0:
        adjective, words = "positive ", words[1:]
    elif node.get("minimum") == 0:
        words[0] = "zero or more"
    unit = f" [{rest['unit']}]" if "unit" in rest else ""
    if len(words) == 2 and "minimum" in node and "maximum" in node and node["minimum"] != 0:
        unit, words = f"{unit} from {node['minimum']:g} to {node['maximum']:g}", []
    bounds = ", " + ", ".join(words) if words else ""
    return f"{article}{adjective}{noun}{unit}{bounds}" + (f", {rest['note']}" if "note" in rest else "")


def _list(node: Mapping[str, Any], rest: Mapping[str, Any]) -> str:
    item = node.get("items") or node["prefixItems"][0]
    if "properties" in item or "oneOf" in item:
        return f"a list of tables with {', '.join(item.get('properties', ()))}"
    if item.get("type") == "array":
        return f"a list of lists, each {allowed({**item, **rest})}"
    noun = _NOUNS.get(str(item.get("type")))
    if noun is None:
        return "a list of texts in quotes"
    count = len(node.get("prefixItems", ()))
    return numbers(item, f"{_COUNTS.get(count, str(count))} " if count else "a list of ", f"{noun}s", rest)
