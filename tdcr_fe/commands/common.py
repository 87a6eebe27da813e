"""What the commands share: exit statuses, messages on stderr, options, progress bars, and what ``--json`` prints."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tdcr_fe.io.problems import Problem

SUCCESS, FAILURE, WRONG_INPUT, INTERRUPTED = 0, 1, 2, 130
#: Exit statuses in words.
STATUSES = {
    SUCCESS: "done",
    FAILURE: "failed",
    WRONG_INPUT: "wrong input",
    INTERRUPTED: "interrupted",
    143: "terminated",
}


def complain(text: str) -> None:
    """Print one line on stderr, with the program's name."""
    print(f"tdcr-fe: {text}", file=sys.stderr)


def count(n: int, noun: str) -> str:
    """A number with its noun, in the singular or the plural."""
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def at_least_one(text: str) -> int:
    """A whole number from 1, as a type for `argparse`.

    Raises
    ------
    argparse.ArgumentTypeError
    """
    number = int(text) if text.isascii() and text.isdecimal() else 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text!r}; must be a whole number, at least 1")
    return number


#: Options that several commands have.
_OPTIONS: dict[str, dict[str, Any]] = {
    "--effects": {
        "action": "append",
        "default": [],
        "metavar": "FILE.py",
        "help": "effects of your own, classes in a Python file; may be repeated",
    },
    "--processes": {"type": at_least_one, "metavar": "N", "help": "processes to use [number of cores]"},
    "--no-pictures": {
        "action": "store_true",
        "help": "write tables and summary only, no pictures and no pages",
    },
    "--quiet": {"action": "store_true", "help": "print nothing but errors and warnings"},
    "--json": {
        "action": "store_true",
        "help": "print one JSON object with status, files written, main figures and errors, and nothing else on stdout",
    },
}


def add_options(parser: argparse.ArgumentParser, *names: str) -> None:
    """Add options that several commands have, by their names, and ``--quiet``."""
    for name in (*names, "--quiet"):
        parser.add_argument(*(["-q"] if name == "--quiet" else []), name, **_OPTIONS[name])


def progress_bar(args: argparse.Namespace, total: int | None = None, **options: Any) -> Any:
    """A bar of tqdm on stderr, where that is a terminal and the command is not quiet."""
    from tqdm import tqdm

    silent = True if args.quiet else None
    return tqdm(total=total, leave=False, file=sys.stderr, disable=silent, **options)


@dataclass
class Noted:
    """What ``--json`` prints beside command and status."""

    files: list[str | Path] = field(default_factory=list)  # that were written
    figures: dict[str, Any] = field(default_factory=dict)  # main results; units are in the names
    warnings: list[str] = field(default_factory=list)
    errors: Sequence[Problem] = ()  # mistakes in the input
    message: str = ""  # why the command failed

    def document(self, command: str, status: int) -> dict[str, Any]:
        """The object that is printed; the name of the command is empty where the arguments named none."""
        errors = [{"file": p.file, "key": p.key, "value": p.value, "allowed": p.allowed} for p in self.errors]
        return {
            "command": command,
            "status": STATUSES.get(status, "failed"),
            "exit_status": status,
            "files": [Path(f).as_posix() for f in self.files],
            "figures": self.figures,
            "warnings": self.warnings,
            "errors": errors,
            "message": self.message,
        }


@contextmanager
def stdout_kept_free(args: argparse.Namespace) -> Iterator[None]:
    """With ``--json``, the command is quiet, and what it prints all the same goes to stderr."""
    if not getattr(args, "json", False):
        yield
        return
    args.quiet = True
    with redirect_stdout(sys.stderr):
        yield
