"""Mistakes in the input: file, key, value and what is allowed."""

from __future__ import annotations

import difflib
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from tdcr_fe.model.checks import Contradiction
from tdcr_fe.model.messages import quoted

#: A path, as a text or an object.
StrPath = str | os.PathLike[str]


@dataclass(frozen=True)
class Problem:
    """One mistake in the input.

    Attributes
    ----------
    file : str
        As the user named it.
    key : str
        Dotted path in the file, such as ``tendons[0].offset``; empty where the whole file is meant.
    value : str
        What was found there, as text; empty where nothing was.
    allowed : str
        What is allowed there.
    """

    file: str
    key: str
    value: str
    allowed: str

    def __str__(self) -> str:
        """One line: file, key, value, what is allowed; the middle of a very long one is left out."""
        where = f"{self.file}: {_short(self.key)}" if self.key else self.file
        allowed = _short(self.allowed)
        return f"{where} = {_short(self.value)}: {allowed}" if self.value else f"{where}: {allowed}"


#: Longest key, value or sentence of a message [characters].
LONGEST = 1500


def _short(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 200]} ... {text[-150:]}"


class InputError(Exception):
    """The input is wrong.

    Attributes
    ----------
    problems : tuple of Problem
        Every mistake found, at least one.
    """

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(str(p) for p in self.problems))


def refusal(file: StrPath, allowed: str, key: str = "", value: str = "") -> InputError:
    """An error with one mistake; see `Problem`."""
    return InputError([Problem(str(file), key, value, allowed)])


@dataclass(frozen=True)
class Reporter:
    """Collects the mistakes of one file.

    Attributes
    ----------
    file : str
        As the user named it.
    problems : list of Problem
        Where they go; several files may share it.
    """

    file: str
    problems: list[Problem] = field(default_factory=list)

    def __call__(self, key: str, value: str, allowed: str) -> None:
        """Take one mistake."""
        self.problems.append(Problem(self.file, key, value, allowed))

    def refuse(self) -> None:
        """Raise an `InputError` where there are mistakes."""
        if self.problems:
            raise InputError(self.problems)

    def contradictions(self, found: Iterable[Contradiction]) -> None:
        """Take values that do not fit together."""
        for c in found:
            self(c.key, c.value, c.allowed)

    def sound(self, read: Callable[[], Any]) -> Any:
        """What a function returns; None where it raises an `InputError`, whose mistakes are taken."""
        try:
            return read()
        except InputError as error:
            self.problems.extend(error.problems)


def read_all(*readers: Callable[[], Any]) -> list[Any]:
    """What each of some functions returns.

    Raises
    ------
    InputError
        With the mistakes that all of them found.
    """
    reporter = Reporter("")
    found = [reporter.sound(read) for read in readers]
    reporter.refuse()
    return found


def read_bytes(path: Path, named: Problem | None = None) -> bytes:
    """Contents of a file.

    Parameters
    ----------
    path
        Of the file.
    named
        The key of another file that names this one, where what is wrong is reported.

    Raises
    ------
    InputError
        It is not there, or cannot be read; the nearest name is proposed.
    """
    name = quoted(str(path))[1:-1]  # without line breaks, so that a mistake stays in its line
    file = f"{name} " if named else ""
    try:
        if path.is_file():
            return path.read_bytes()
        if path.is_dir():
            reason = f"{file}is a directory, not a file"
        elif path.is_symlink() and not path.exists():
            reason = f"{file}is a link to {path.readlink()}, which is not there"
        elif path.exists():
            reason = f"{file}is not a regular file"
        else:
            there = sorted(path.parent.glob(f"*{path.suffix}")) if path.parent.is_dir() else []
            near = difflib.get_close_matches(path.stem, [p.stem for p in there if p.is_file()], n=1)
            hint = f"; did you mean {near[0]}{path.suffix}?" if near else ""
            reason = (f"there is no file {name}" if named else "no such file") + hint
    except (OSError, ValueError) as error:
        reason = f"cannot be read: {getattr(error, 'strerror', None) or error}"
    raise InputError([replace(named, allowed=reason) if named else Problem(str(path), "", "", reason)])
