"""Keys, values and load steps as text, and the option that was probably meant."""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any


def quoted(text: str) -> str:
    """A text as TOML has it."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


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


def shown(value: Any, limit: int = 60) -> str:
    """A value as written in a TOML file, its middle left out where it is long."""
    if isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, str):
        text = json.dumps(value, ensure_ascii=False)
    elif isinstance(value, Mapping):
        text = "{" + ", ".join(f"{bare(str(k))} = {shown(v)}" for k, v in value.items()) + "}"
    elif isinstance(value, list | tuple):
        text = "[" + ", ".join(shown(v) for v in value) + "]"
    else:
        try:
            text = str(value)
        except ValueError:
            text = "a number of thousands of digits"
    return text if len(text) <= limit else text[: limit - 10] + " ... " + text[-5:]


def meant(given: Any, options: Iterable[str]) -> str:
    """A question that names the option most like what was given, or nothing."""
    near = difflib.get_close_matches(str(given), list(options), n=1, cutoff=0.6)
    return f"; did you mean {near[0]}?" if near else ""
