"""Write the parts of the pages that follow from the program, when the pages are built.

Keys of the files, effects, commands and public names go to ``docs/_generated``; pages include them from there.
``python docs/generate.py`` writes them without building the pages.
"""

from __future__ import annotations

import importlib
import io
import os
import re
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout, suppress
from pathlib import Path
from typing import Any

import tdcr_fe
from tdcr_fe import cli
from tdcr_fe.effects import EFFECTS

#: Where the page "API" shows the public names, by the beginning of their module's name.
SECTIONS = {
    "tdcr_fe.model": "Descriptions and results",
    "tdcr_fe.solve": "Solving",
    "tdcr_fe.scene": "In a scene",
    "tdcr_fe.native": "In a scene",
    "tdcr_fe.effects": "Effects",
    "tdcr_fe.identify": "Identification",
    "tdcr_fe.live": "Live",
    "tdcr_fe.estimate": "Estimation",
    "tdcr_fe.sweeps": "Sweeps",
    "tdcr_fe.io": "Files",
    "tdcr_fe.report": "Pictures",
}
#: Public names beside those of ``tdcr_fe``: what these give, and the interfaces of user-defined parts.
FURTHER = (
    "tdcr_fe.model.routing.Routing",
    "tdcr_fe.effects.base.Effect",
    "tdcr_fe.effects.base.Parameter",
    "tdcr_fe.report.plots.shapes",
    "tdcr_fe.report.plots.tensions",
    "tdcr_fe.report.plots.hysteresis",
    "tdcr_fe.report.scene_picture.scene_picture",
)


def write_generated(folder: Path) -> None:
    """Write every part into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    parts = {
        "robot": keys_of("robot"),
        "scenario": keys_of("scenario"),
        "sweep": keys_of("sweep"),
        "effects": effects(),
        "commands": commands(),
        "limits": physical_limits(),
        "api": api(),
    }
    for name, text in parts.items():
        (folder / f"{name}.md").write_text(text, encoding="utf-8")


def physical_limits() -> str:
    """Table of all physical limits."""
    from tdcr_fe.model.limits import limits

    lines = ["| quantity | from | to | beyond it | source |", "| --- | --- | --- | --- | --- |"]
    for row in limits().values():
        low, high = (f"{x:g}" if abs(x) < float("inf") else "" for x in (row.low, row.high))
        level = "remark" if row.remark else "warning"
        lines.append(f"| {row.quantity} | {low} | {high} | {level} | {row.source} |")
    return "\n".join(lines) + "\n"


def schema(file: str) -> dict[str, Any]:
    """JSON schema of an input file; for the scenario without the effects, which have a table of their own."""
    if file == "sweep":
        from tdcr_fe.sweeps.read import sweep_schema

        found = sweep_schema()
    else:
        found = tdcr_fe.json_schema(file)
    return {**found, "properties": {k: v for k, v in found["properties"].items() if k != "effects"}}


def keys_of(file: str) -> str:
    """Tables of all keys of an input file, one for each of its tables."""
    top = schema(file)
    text = "".join(_table(name, part, top) for name, part in _tables("", top, top))
    return text


def _resolved(part: dict[str, Any], top: dict[str, Any]) -> dict[str, Any]:
    """A part of a schema without references; of a value or null, the value."""
    if "$ref" in part:
        part = {
            **top["$defs"][part["$ref"].rsplit("/", 1)[-1]],
            **{k: v for k, v in part.items() if k != "$ref"},
        }
    choices = [c for c in part.get("anyOf", ()) if c.get("type") != "null"]
    if len(choices) == 1:
        part = {**_resolved(choices[0], top), **{k: v for k, v in part.items() if k != "anyOf"}}
    return part


def _objects(part: dict[str, Any], top: dict[str, Any]) -> list[dict[str, Any]]:
    """The tables that a value may be: itself, its items, its values by name, or several by a kind."""
    part = _resolved(part, top)
    if "properties" in part:
        return [part]
    if isinstance(part.get("items"), dict):
        return _objects(part["items"], top)
    if isinstance(part.get("additionalProperties"), dict):
        return _objects(part["additionalProperties"], top)
    return [o for c in (*part.get("oneOf", ()), *part.get("anyOf", ())) for o in _objects(c, top)]


def _tables(name: str, part: dict[str, Any], top: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every table of a file once, by its name, from the top down."""
    variants = _objects(part, top)
    merged: dict[str, dict[str, Any]] = {}
    for variant in variants:
        for key, value in variant["properties"].items():
            row = merged.setdefault(
                key, {**_resolved(value, top), "of": [], "given": key in variant.get("required", ())}
            )
            row["of"].append(_kind(variant, top))
            if _choices(row):
                row["enum"] = list(dict.fromkeys([*_choices(row), *_choices(_resolved(value, top))]))
    for row in merged.values():
        row["of"] = [] if len(row["of"]) == len(variants) else row["of"]
    yield name, merged
    for key, row in merged.items():
        if _objects(row, top):
            inner = f"{name}.{key}" if name else key
            yield from _tables(inner, row, top)


def _choices(row: dict[str, Any]) -> list[Any]:
    """The few values that a key takes; none where it takes others."""
    return row.get("enum") or ([row["const"]] if "const" in row else [])


def _kind(variant: dict[str, Any], top: dict[str, Any]) -> str:
    """What tells a variant of a table from the others: its routing, or its kind."""
    for key in ("routing", "kind"):
        value = _resolved(variant["properties"].get(key, {}), top)
        if _choices(value):
            return str(_choices(value)[0])
    return ""


def _table(name: str, rows: dict[str, dict[str, Any]], top: dict[str, Any]) -> str:
    lines = [f"\n**`[{name}]`**\n" if name else "\n**At the top of the file**\n"]
    lines += ["| key | what it is | allowed | default |", "| --- | --- | --- | --- |"]
    for key, row in rows.items():
        what = row.get("description", "the law, by name" if key == "kind" else "")
        unit = f" [{row['unit']}]" if row.get("unit") and f"[{row['unit']}]" not in what else ""
        only = f" (`{'`, `'.join(row['of'])}` only)" if row["of"] and key != "kind" else ""
        cells = (f"`{key}`", what + unit + only, _allowed(row, top), _default(row))
        lines.append("| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |")
    return "\n".join(lines) + "\n"


def _allowed(row: dict[str, Any], top: dict[str, Any]) -> str:
    """What a key takes, in a few words."""
    row = _resolved(row, top)
    if _choices(row):
        return ", ".join(f"`{_toml(v)}`" for v in _choices(row))
    choices = [*row.get("anyOf", ()), *row.get("oneOf", ())]
    if _objects(row, top):
        return "tables" if row.get("type") == "array" else "a table"
    if choices:
        return ", or ".join(dict.fromkeys(filter(None, (_allowed(c, top) for c in choices))))
    kind = row.get("type")
    kind = kind[0] if isinstance(kind, list) else kind  # a number, or a text with its unit
    if kind in ("number", "integer"):
        words = [] if kind == "number" else ["whole"]
        for bound, word in (
            ("exclusiveMinimum", "above"),
            ("minimum", "at least"),
            ("exclusiveMaximum", "below"),
            ("maximum", "at most"),
        ):
            if bound in row:
                words.append(f"{word} {row[bound]:g}")
        return ", ".join(words) or "any number"
    if kind == "array":
        count = row.get("minItems") if row.get("minItems") == row.get("maxItems") else None
        inner = _allowed(row["items"], top) if isinstance(row.get("items"), dict) else ""
        return f"list of {count or 'values'}" + (f": {inner}" if inner and inner != "any number" else "")
    if isinstance(row.get("additionalProperties"), dict):
        return f"by name: {_allowed(row['additionalProperties'], top)}"
    return {"string": "text", "boolean": "true or false", "object": "a table"}.get(str(kind), "")


def _default(row: dict[str, Any]) -> str:
    if row.get("default") is not None and "const" not in row:
        return f"`{_toml(row['default'])}`"
    return "must be given" if row["given"] or "const" in row else ""


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def effects() -> str:
    """Table of the effects, in the order in which they are applied."""
    lines = ["| effect | what it is | parameters | null values |", "| --- | --- | --- | --- |"]
    for effect in EFFECTS:
        parameters = ", ".join(f"`{p.name}` [{p.unit}] {p.meaning}".strip() for p in effect.parameters)
        null = ", ".join(f"{p.null_value:g}" for p in effect.parameters)
        lines.append(f"| `{effect.name}` | {effect.description} | {parameters} | {null} |".replace("\n", " "))
    return "\n".join(lines) + "\n"


def commands() -> str:
    """``--help`` of every command."""
    os.environ["COLUMNS"] = "100"
    text = []
    for name in cli.COMMANDS:
        printed = io.StringIO()
        with redirect_stdout(printed), suppress(SystemExit):
            cli.main([name, "--help"])
        text.append(f"### `tdcr-fe {name}`\n\n```text\n{printed.getvalue().strip()}\n```\n")
    return "\n".join(text)


def public_names() -> list[str]:
    """Every public name with its module, and the classes that these take and give."""
    public = {name: getattr(tdcr_fe, name) for name in tdcr_fe.__all__ if not name.startswith("__")}
    loaded = [
        m
        for m in sys.modules.values()
        if re.match(r"tdcr_fe\.(model|effects|scene|identify|estimate|io|sweeps)\b", m.__name__)
    ]
    classes = {
        name: value
        for module in loaded
        for name, value in vars(module).items()
        if isinstance(value, type) and value.__module__ == module.__name__
    }
    words = re.findall(
        r"[A-Z]\w+", " ".join(str(a) for value in public.values() for a in _annotations(value))
    )
    found = public | {w: classes[w] for w in words if w in classes and not w.startswith("_")}
    return list(dict.fromkeys([*(f"{v.__module__}.{name}" for name, v in found.items()), *FURTHER]))


def _annotations(value: Any) -> Iterator[Any]:
    """Of a function or of a class with its methods, but for private fields."""
    yield from (a for name, a in getattr(value, "__annotations__", {}).items() if not name.startswith("_"))
    if isinstance(value, type):
        for name, member in vars(value).items():
            function = member.fget if isinstance(member, property) else member
            if not name.startswith("_") and hasattr(function, "__annotations__"):
                yield function.__annotations__.get("return", "")


def api() -> str:
    """Directives of autodoc for every public name, in sections."""
    text = []
    for title in dict.fromkeys(SECTIONS.values()):
        text.append(f"### {title}\n\n```{{eval-rst}}")
        for path in public_names():
            if SECTIONS[re.match(r"tdcr_fe\.\w+", path)[0]] == title:  # type: ignore[index]
                module, _, name = path.rpartition(".")
                value = getattr(importlib.import_module(module), name)
                error = isinstance(value, type) and issubclass(value, BaseException)
                kind = "exception" if error else "class" if isinstance(value, type) else "function"
                text.append(f".. auto{kind}:: {path}\n")
        text.append("```\n")
    return "\n".join(text)


if __name__ == "__main__":
    write_generated(Path(__file__).parent / "_generated")
