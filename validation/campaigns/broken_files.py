"""Good input files, each broken in one place: refused by name with nothing written, or a valid run.

The commands are run on them and judged: no traceback, no warning of Python, no command that hangs, no certainly wrong
input that is taken.
"""

from __future__ import annotations

import importlib
import io
import re
import signal
import threading
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import ClassVar

import numpy as np
import pandas as pd

from tdcr_fe.model.messages import count
from tdcr_fe.validation.broken_files.inputs import INPUTS, Inputs, files_of, is_required
from tdcr_fe.validation.broken_files.mutations import Change, change
from tdcr_fe.validation.runner import Campaign

#: Processor time after which a command is interrupted, and that in which it then has to end [s].
TIME_LIMIT, GRACE = 10.0, 30.0
#: Longest message [characters]: one mistake in a long list must not fill the terminal.
LONGEST_MESSAGE = 20_000

#: Outcomes that are right.
RIGHT = ("refused", "refused by another key", "valid", "not converged", "valid, long")
#: Packages in which a command solves; one that is interrupted there has read its input.
_SOLVING = (
    "tdcr_fe.solve",
    "tdcr_fe.identify",
    "tdcr_fe.sweeps.execution",
    "tdcr_fe.sweeps.cases",
    "tdcr_fe.io.result_files",
    "tdcr_fe.report",
)


@dataclass(frozen=True)
class Case:
    """One broken input."""

    number: int  # seed
    inputs: Inputs  # the good files and their command
    change: Change


@dataclass(frozen=True)
class Outcome:
    """What the command does with a broken input.

    Right outcomes are "refused" (by file and key), "refused by another key" (which contradicts the change), "valid"
    (solved), "not converged" (with a message) and "valid, long" (interrupted while it solved). Wrong are "traceback",
    "hang", "refused without a name", "refused, but files were written", "endless message", "warning of Python" and "not
    refused".
    """

    number: int  # seed
    inputs: str
    file: str
    mutation: str
    key: str
    value: str
    outcome: str
    status: int  # exit status
    seconds: float  # processor time
    text: str  # first words of what it says on stderr

    @property
    def passed(self) -> bool:
        """Whether that is right."""
        return self.outcome in RIGHT


def draw(number: int) -> Case:
    """The broken input of a seed."""
    rng = np.random.default_rng([23, number])
    weights = np.array([i.weight for i in INPUTS], dtype=float)
    inputs = INPUTS[int(rng.choice(len(INPUTS), p=weights / weights.sum()))]
    good = files_of(inputs)
    return Case(number, inputs, change(rng, good, tuple(f for f in good if is_required(inputs, f))))


def run_case(case: Case) -> Outcome:
    """Write the files, run the command, judge it."""
    with TemporaryDirectory() as place:
        folder, out = Path(place) / "in", Path(place) / "out"
        write(case, folder)
        arguments = case.inputs.command.replace("{}", str(folder)).split()
        if "--check" not in arguments:
            arguments += ["-o", str(out / "view.html" if arguments[0] == "view" else out)]
        begun = time.process_time()
        ran = _in_this_process(arguments)
        seconds = time.process_time() - begun
        outcome = judge(case, ran, seconds, list(out.rglob("*")) if out.exists() else [])
        text = ran.errors.replace(str(folder) + "/", "")
    made = case.change
    broken = (made.file, made.mutation, made.key[:60], made.value[:60])
    return Outcome(case.number, case.inputs.name, *broken, outcome, ran.status, round(seconds, 3), text[:600])


def write(case: Case, folder: Path) -> None:
    """Write the files of a case."""
    folder.mkdir(parents=True)
    for name, contents in files_of(case.inputs).items():
        (folder / name).write_bytes(contents)
    path = folder / case.change.file
    path.unlink()
    if case.change.kind == "directory":
        path.mkdir()
    elif case.change.kind == "link to itself":
        try:
            path.symlink_to(path)
        except OSError:  # Windows may not allow links; there is no file then
            return
    elif case.change.contents is not None:
        path.write_bytes(case.change.contents)


@dataclass(frozen=True)
class Ran:
    """A command that has run."""

    status: int  # exit status; -1 where it ended by an exception or was killed
    errors: str  # what it wrote to stderr, and the traceback of an exception
    # where it was at the time limit: "solving", "reading"; empty where it ended before
    interrupted_in: str = ""


def judge(case: Case, ran: Ran, seconds: float, written: list[Path]) -> str:
    """The outcome of a command, see `Outcome`."""
    if "Traceback (most recent call last)" in ran.errors:
        return "traceback"
    if seconds > TIME_LIMIT + GRACE or ran.interrupted_in == "reading":
        return "hang"
    if "Warning: " in ran.errors:
        return "warning of Python"
    if ran.interrupted_in:
        return "hang" if case.change.must_be_refused else "valid, long"
    if ran.status == 2:
        if written:
            return "refused, but files were written"
        if len(ran.errors) > LONGEST_MESSAGE:
            return "endless message"
        if not every_mistake_has_a_name(case, ran.errors):
            return "refused without a name"
        return "refused" if names(case.change, ran.errors) else "refused by another key"
    if case.change.must_be_refused:
        return "not refused"
    return {0: "valid", 1: "not converged"}.get(ran.status, f"exit status {ran.status}")


def every_mistake_has_a_name(case: Case, errors: str) -> bool:
    """Whether there is a list of mistakes, and each names one of the files, with a key or a sentence."""
    head, *problems = errors.strip().splitlines()
    files = (*files_of(case.inputs), "-o")
    listed = [p.strip() for p in problems if not re.fullmatch(r"\s+and \d+ more", p)]
    named = [any(f"{f}: " in p for f in files) or p.split(": ")[0].endswith("/in") for p in listed]
    return "in the input; nothing was written" in head and bool(listed) and all(named)


def names(changed: Change, errors: str) -> bool:
    """Whether an error names the file, and the key or line, that was changed."""
    mine = [p for p in errors.strip().splitlines()[1:] if f"{changed.file}: " in p]
    if not mine or changed.key in ("", "line"):
        return bool(mine)
    parts = [p for p in changed.key.split(".") if not p.isdigit()]
    return any(part in p for part in parts for p in mine)


# ------------------------------------------------------------------------------------------------------ running


class _TimeLimit(KeyboardInterrupt):
    """Interrupts a command as Ctrl-C does."""


@contextmanager
def _limited(where: list[str]) -> Iterator[None]:
    """Interrupt what takes more processor time than the limit, and note where it was; Windows has no such limit.

    It is interrupted again after the time that it has to end in: destructors swallow exceptions.
    """
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        modules = [own.f_globals.get("__name__", "") for own, _ in traceback.walk_stack(frame)]
        where.append("solving" if any(m.startswith(_SOLVING) for m in modules) else "reading")
        raise _TimeLimit

    before = signal.signal(signal.SIGPROF, interrupt)
    signal.setitimer(signal.ITIMER_PROF, TIME_LIMIT, GRACE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def _in_this_process(arguments: list[str]) -> Ran:
    """Call the command's function. It is imported by name, as the layers below it may not know it."""
    main = importlib.import_module("tdcr_fe.cli").main
    output, errors, where = io.StringIO(), io.StringIO(), list[str]()
    with redirect_stdout(output), redirect_stderr(errors), warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.filterwarnings("ignore", category=DeprecationWarning)
        try:
            with _limited(where):
                status = main(arguments)
        except _TimeLimit:
            status = -1
        except SystemExit as stop:
            status = stop.code if isinstance(stop.code, int) else -1
        except Exception:
            traceback.print_exc()
            status = -1
    return Ran(status, errors.getvalue(), where[0] if where else "")


class BrokenFiles(Campaign):
    """See the text of this module."""

    unit = "input"
    count: ClassVar[int | None] = 2000
    outcome = Outcome

    def run(self, case: int, out: Path) -> Outcome:
        """Draw an input and run the command."""
        return run_case(draw(case))

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """Counts by command and by mutation, and the first of the wrong ones."""
        wrong = [o for o in outcomes if not o.passed]
        table = self.table(outcomes)
        return [
            *(pd.crosstab(table[by], table["outcome"]).reset_index() for by in ("inputs", "mutation")),
            *(f"{o.number}: {o.outcome}: {o.inputs}, {o.file}, {o.mutation}, {o.key} = {o.value!r}\n{o.text[-300:]}"
              for o in wrong[:20]),
            f"{count(len(outcomes), 'broken input')}, {len(wrong)} of them not judged right",
        ]  # fmt: skip


CAMPAIGN = BrokenFiles()
