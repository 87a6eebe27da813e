"""What the commands share: exit statuses, messages on stderr, progress bars, what ``--json`` prints; and every command.

What a command does, its arguments, two examples, and its function are in ``data/commands.toml``.
"""

from __future__ import annotations

import _thread
import argparse
import math
import shlex
import signal
import sys
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import asdict, dataclass, field
from enum import IntEnum
from importlib.resources import files
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from tdcr_fe.io.files import Problem
from tdcr_fe.model.messages import PlausibilityRemark, TDCRWarning, count

if TYPE_CHECKING:
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
    return tqdm(total=total, leave=False, file=sys.stderr, disable=True if args.quiet else None, **options)


#: Every so often it is looked whether anything was solved, and whether what is left will take so long [s].
LOOK, LONG_RUN = 5.0, 60.0


class Clock:
    """Announces long work after some seconds, and interrupts it at its time limit.

    As SIGTERM does, which the commands handle like Ctrl-C. Jobs in the background ignore the signal of Ctrl-C.
    """

    def __init__(self, total: int, noun: str, minutes: float | None) -> None:
        self.total, self.noun, self.minutes = total, noun, minutes
        self.solved, self.reason = 0, "interrupted"  # how many, and why the work ended

    @contextmanager
    def running(self) -> Iterator[None]:
        """Until the block ends."""
        done = Event()
        Thread(target=self._watch, args=(done,), daemon=True).start()
        try:
            yield
        finally:
            done.set()

    def _watch(self, done: Event) -> None:
        limit = math.inf if self.minutes is None else 60.0 * self.minutes
        begun, wait, before, announced = time.perf_counter(), min(LOOK, limit), 0, False
        while not done.wait(wait):
            elapsed = time.perf_counter() - begun
            if elapsed > limit:
                self.reason = f"stopped at the time limit of {count(limit / 60.0, 'minute')}"
                wait = LOOK  # and again, until the work has ended: a callback of Exudyn may lose it
                _thread.interrupt_main(signal.SIGTERM)
                continue
            # The first ones may each take long, on every mesh that is tried.
            some = self.solved > max(before, self.total // 20)
            left = elapsed * (self.total / self.solved - 1.0) if some else math.inf
            if left > LONG_RUN and not announced:
                announced = True
                about = f"about {left / 60.0:.0f} minutes more" if some else "this may take minutes"
                solved = f"{self.solved} of {count(self.total, self.noun)} solved in {elapsed:.0f} s"
                complain(f"{solved}: {about}; Ctrl-C or --minutes keeps what is solved")
            before = self.solved


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


# ----------------------------------------------------------------------------------------------------- every command


def whole(least: int, most: float = math.inf) -> Callable[[str], int]:
    """A whole number between bounds, as a type for `argparse`."""
    upper = f"from {least} to {most}" if math.isfinite(most) else f"at least {least}"

    def read(text: str) -> int:
        if not (text.isascii() and text.isdecimal() and least <= int(text) <= most):
            raise argparse.ArgumentTypeError(f"{text!r}; must be a whole number, {upper}")
        return int(text)

    return read


def positive(text: str) -> float:
    """A positive number, as a type for `argparse`."""
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r}; must be a number above zero, without a unit")
    return number


_FILE = tomllib.loads((files("tdcr_fe") / "data" / "commands.toml").read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Command:
    """A subcommand; the file says what its fields are."""

    handler: str
    help: str
    examples: list[str]
    more: str = ""
    arguments: dict[str, dict[str, Any]] = field(default_factory=dict)
    shared: list[str] = field(default_factory=list)
    failure: str = ""

    @property
    def description(self) -> str:
        """What it does, at the top of its own help."""
        return f"{self.help[0].upper()}{self.help[1:]}. {self.more}"

    def parsed_arguments(self) -> Iterator[tuple[list[str], dict[str, Any]]]:
        """Flags or the name of every argument, and the options of `add_argument`."""
        shared = {flags: _FILE["shared"][flags] for flags in self.shared}
        for flags, given in (self.arguments | shared).items():
            options = dict(given)
            if "whole" in options:
                options["type"] = whole(*options.pop("whole"))
            elif options.pop("positive", False):
                options["type"] = positive
            yield flags.split(), options


#: Every command, by name.
COMMANDS = {name: Command(**table) for name, table in _FILE["commands"].items()}
