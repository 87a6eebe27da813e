"""Every command: what it does, its arguments, two examples, and its function, as ``data/commands.toml`` has them."""

from __future__ import annotations

import argparse
import math
import re
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any


def whole(least: int, most: float = math.inf) -> Callable[[str], int]:
    """A whole number between bounds, as a type for `argparse`."""
    upper = f"from {least} to {most}" if math.isfinite(most) else f"at least {least}"

    def read(text: str) -> int:
        if not (text.isascii() and text.isdecimal() and least <= int(text) <= most):
            raise argparse.ArgumentTypeError(f"{text!r}; must be a whole number, {upper}")
        return int(text)

    return read


def minutes(text: str) -> float:
    """A positive number, as a type for `argparse`."""
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r}; must be a number of minutes above zero")
    return number


#: Types of arguments by their names in the file.
TYPES: dict[str, Callable[[str], float]] = {"number": float, "minutes": minutes}
_FILE = tomllib.loads((files("tdcr_fe") / "data" / "commands.toml").read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Command:
    """A subcommand; the file says what its fields are."""

    handler: str
    help: str
    examples: list[str]
    more: str = ""
    arguments: str = ""
    shared: list[str] = field(default_factory=list)
    failure: str = ""
    options: dict[str, dict[str, Any]] = field(default_factory=dict)

    @property
    def description(self) -> str:
        """What it does, at the top of its own help."""
        return f"{self.help[0].upper()}{self.help[1:]}. {self.more}"

    def parsed_arguments(self) -> Iterator[tuple[list[str], dict[str, Any]]]:
        """Flags or the name of every argument, and the options of `add_argument`."""
        lines = re.sub(r"\n\s+", " ", self.arguments).splitlines()
        for line in [*lines, *(_FILE["shared"][name] for name in self.shared)]:
            names, _, text = line.partition("  ")
            *flags, value = names.split()
            options: dict[str, Any] = {"help": text.strip()}
            if value.endswith("..."):
                options["nargs"], value = "+", value.removesuffix("...")
            if value.startswith("{"):
                options["choices"] = tuple(value.strip("{}").split(","))
                options["default"] = options["choices"][0]
            elif value.isupper() or "." in value:
                options["metavar"] = value
            else:
                flags.append(value)
            name = flags[-1].lstrip("-")
            options |= self.options.get(name, _FILE["options"].get(name, {}))
            if "whole" in options:
                options["type"] = whole(*options.pop("whole"))
            elif "type" in options:
                options["type"] = TYPES[options["type"]]
            elif flags[0].startswith("-") and not options.keys() & {"metavar", "choices"}:
                options["action"] = "store_true"
            yield flags, options


#: Every command, by name.
COMMANDS = {name: Command(**table) for name, table in _FILE["commands"].items()}
