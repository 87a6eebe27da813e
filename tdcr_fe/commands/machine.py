"""What ``--json`` prints: one JSON object on stdout, for programs that call the commands."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tdcr_fe.commands.status import FAILURE, INTERRUPTED, SUCCESS, WRONG_INPUT

if TYPE_CHECKING:
    from tdcr_fe.io.problems import Problem

#: Exit statuses in words.
STATUSES = {
    SUCCESS: "done",
    FAILURE: "failed",
    WRONG_INPUT: "wrong input",
    INTERRUPTED: "interrupted",
    143: "terminated",
}


def add_json_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--json``."""
    parser.add_argument(
        "--json",
        action="store_true",
        help="print one JSON object with status, files written, main figures and errors, and nothing else on stdout",
    )


def note(
    args: argparse.Namespace,
    *,
    files: Iterable[str | Path] = (),
    figures: Mapping[str, Any] | None = None,
    warnings: Iterable[str] = (),
    message: str = "",
) -> None:
    """Keep what ``--json`` prints at the end; several calls add up.

    Parameters
    ----------
    args
        Of the command.
    files
        That were written.
    figures
        Main results; units are in the names.
    warnings
        Sentences.
    message
        Why the command failed.
    """
    known: dict[str, Any] = vars(args).setdefault(
        "noted", {"files": [], "figures": {}, "warnings": [], "message": ""}
    )
    known["files"] += [Path(f).as_posix() for f in files]
    known["figures"].update(figures or {})
    known["warnings"] += list(warnings)
    known["message"] = message or known["message"]


@contextmanager
def stdout_kept_free(args: argparse.Namespace) -> Iterator[None]:
    """With ``--json``, the command is quiet, and what it prints all the same goes to stderr."""
    if not getattr(args, "json", False):
        yield
        return
    args.quiet = True
    with redirect_stdout(sys.stderr):
        yield


def document(
    command: str, status: int, args: argparse.Namespace | None, problems: Iterable[Problem], message: str = ""
) -> dict[str, Any]:
    """The object that ``--json`` prints.

    Parameters
    ----------
    command
        Its name; empty where the arguments named none.
    status
        Exit status.
    args
        With what `note` kept; None where the arguments were wrong.
    problems
        Mistakes in the input.
    message
        Why the command failed, where `note` has no message.
    """
    noted = {} if args is None else getattr(args, "noted", {})
    return {
        "command": command,
        "status": STATUSES.get(status, "failed"),
        "exit_status": status,
        "files": noted.get("files", []),
        "figures": noted.get("figures", {}),
        "warnings": noted.get("warnings", []),
        "errors": [{"file": p.file, "key": p.key, "value": p.value, "allowed": p.allowed} for p in problems],
        "message": noted.get("message", "") or message,
    }
