"""What the commands share: exit statuses, messages on stderr, progress bars, and what ``--json`` prints."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import asdict, dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tdcr_fe.model.messages import PlausibilityRemark, TDCRWarning, count

if TYPE_CHECKING:
    from tdcr_fe.io.problems import Problem
    from tdcr_fe.model.loading import LoadStep, Model
    from tdcr_fe.model.robot import Robot


class Exit(IntEnum):
    """Exit statuses."""

    DONE = 0
    FAILED = 1
    WRONG_INPUT = 2
    INTERRUPTED = 130
    TERMINATED = 143


def complain(text: str) -> None:
    """Print one line on stderr, with the program's name."""
    print(f"tdcr-fe: {text}", file=sys.stderr)


def say(args: argparse.Namespace, text: str) -> None:
    """Print a text at once, unless the command is quiet."""
    if not args.quiet:
        print(text, flush=True)


def typed(*words: object) -> str:
    """A command of the program as it is typed, names with blanks in quotes."""
    return shlex.join(["tdcr-fe", *map(str, words)])


def complain_of_left_out(args: argparse.Namespace, rows: Sequence[object], most: int = 10) -> None:
    """Print the first rows of measured data that were left out; all of them are noted."""
    texts = [f"left out: {row}" for row in rows]
    args.noted.warnings += texts
    for text in texts[:most]:
        complain(text)
    if len(texts) > most:
        complain(f"left out: {count(len(texts) - most, 'more row')}")


def print_understood(args: argparse.Namespace, robot: Robot, model: Model, steps: Sequence[LoadStep]) -> None:
    """Print what was understood of a description, so that a wrong unit is seen before anything is solved."""
    from tdcr_fe.model.plausibility import understood

    say(args, f"{robot.name}: " + "\n  ".join(understood(robot, model, steps)))


def progress_bar(args: argparse.Namespace, total: int | None = None, **options: Any) -> Any:
    """A bar of tqdm on stderr, where that is a terminal and the command is not quiet."""
    from tqdm import tqdm

    return tqdm(total=total, leave=False, file=sys.stderr, disable=True if args.quiet else None, **options)


@dataclass
class Noted:
    """What ``--json`` prints beside command and status."""

    files: list[str | Path] = field(default_factory=list)  # that were written
    figures: dict[str, Any] = field(default_factory=dict)  # main results; units are in the names
    warnings: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    errors: Sequence[Problem] = ()  # mistakes in the input
    message: str = ""  # why the command failed
    quiet: bool = False  # Whether remarks are not printed

    def warn(self, text: str, category: type[TDCRWarning]) -> None:
        """Print a warning or a remark, above the progress bar, and note it; once where it is issued again."""
        from tqdm import tqdm

        is_remark = issubclass(category, PlausibilityRemark)
        noted = self.remarks if is_remark else self.warnings
        if text in noted:
            return
        noted.append(text)
        with tqdm.external_write_mode(file=sys.stderr):
            if not is_remark:
                complain(f"warning: {text}")
            elif not self.quiet:
                print(f"remark: {text}", flush=True)

    def document(self, command: str, status: int) -> dict[str, Any]:
        """The object that is printed; the name of the command is empty where the arguments named none."""
        return {
            "command": command,
            "status": Exit(status).name.lower().replace("_", " "),
            "exit_status": int(status),
            "files": [Path(f).as_posix() for f in self.files],
            "figures": self.figures,
            "warnings": self.warnings,
            "remarks": self.remarks,
            "errors": [asdict(p) for p in self.errors],
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
