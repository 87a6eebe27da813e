"""Files read and written: mistakes in them with file, key, value and what is allowed; texts, JSON, records and folders.

What is written is written atomically: all of a file, or the old one stays.
"""

from __future__ import annotations

import difflib
import json
import math
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

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

    def contradictions(self, found: Iterable[tuple[str, str, str]]) -> None:
        """Take values that do not fit together: key, value and what is allowed of each."""
        for contradiction in found:
            self(*contradiction)

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
        Path of the file.
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


def decoded(raw: bytes, file: StrPath, reason: str) -> str:
    """The text of a file in UTF-8; where it is none, line and byte are named with a reason."""
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise refusal(file, reason, f"line {line}", f"byte 0x{raw[error.start]:02x}") from error


# ----------------------------------------------------------------------------------------------------------- writing


def plain(value: Any) -> Any:
    """A value as JSON can represent it: arrays as lists, numbers that are not finite as null.

    What has a method ``to_json`` is what that gives.
    """
    if hasattr(value, "to_json"):
        return plain(value.to_json())
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if hasattr(value, "tolist"):  # an array or a number of numpy
        return plain(value.tolist())
    if isinstance(value, Sequence | set | frozenset) and not isinstance(value, str | bytes):
        return [plain(v) for v in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def to_json(value: Any, indent: int | None = 2) -> str:
    """A value as JSON that any reader takes: no NaN, one line feed at the end."""
    return json.dumps(plain(value), indent=indent, ensure_ascii=False, allow_nan=False) + "\n"


def write_text(text: str, path: StrPath) -> None:
    """Write a text file in UTF-8; its folder is made where it does not exist.

    An existing file is replaced only when the new one is complete.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    try:
        # names of files may contain any byte
        partial.write_text(text, encoding="utf-8", errors="backslashreplace", newline="")
        partial.replace(path)
    except OSError as error:  # of a full disk it names no file
        error.filename = str(path)
        raise
    finally:
        partial.unlink(missing_ok=True)


def write_json(value: Any, path: StrPath, indent: int | None = 2) -> None:
    """Write a value as JSON that any reader takes (no NaN)."""
    write_text(to_json(value, indent), path)


def check_output_folder(out: StrPath, option: str = "-o") -> Path:
    """The directory that results are to go to, by the option that gives it, refused where it cannot be one.

    Raises
    ------
    InputError
        It, or something above it, is a file, or may not be written to.
    """
    out, wrong = Path(out), ""
    try:
        above = out.absolute()
        while not above.exists():
            above = above.parent
        if os.path.lexists(out) and not out.is_dir():
            what = "a link to nowhere" if out.is_symlink() else "a file"
            wrong = f"is {what}; must be a directory or not exist yet"
        elif not above.is_dir():
            wrong = f"{above} is a file; must be a directory"
        elif not os.access(above, os.W_OK | os.X_OK):
            wrong = f"no permission to write in {above}"
    except (OSError, ValueError) as error:
        wrong = f"cannot be a directory: {getattr(error, 'strerror', None) or error}"
    if wrong:
        raise refusal(option, wrong, value=str(out))
    return out


def write_folder(out: StrPath, write: Callable[[Path], object], ours: Iterable[str] = ()) -> list[Path]:
    """Let ``write`` fill an empty directory, then move the files from there into ``out``.

    Parameters
    ----------
    out
        Made where it does not exist; other files in it stay.
    write
        Called with the empty directory. If it raises, ``out`` stays as it was.
    ours
        Names of files that an earlier run may have left; removed from ``out`` if not written anew.

    Returns
    -------
    list of pathlib.Path
        The files, in ``out``.
    """
    out = check_output_folder(out)
    existed = out.is_dir()
    out.parent.mkdir(parents=True, exist_ok=True)
    staging = (out if existed else out.parent) / f".{out.name or 'out'}.partial"
    shutil.rmtree(staging, ignore_errors=True)  # of a run that was killed
    staging.mkdir()
    try:
        write(staging)
        names = sorted(p.name for p in staging.iterdir())
        if not existed and not out.exists():
            staging.rename(out)
        else:
            for name in names:
                (staging / name).replace(out / name)
            for name in set(ours) - set(names):
                (out / name).unlink(missing_ok=True)
    except OSError as error:
        error.filename = str(out) if error.filename is None else error.filename
        raise
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    return [out / name for name in names]


class OtherHead(ValueError):
    """A file of lines begins with another head, or with none; the message names the keys that differ."""


@dataclass(frozen=True)
class Lines:
    """One file: a head, then a line of JSON for each record.

    Each line is handed to the operating system whole, so that a kill loses no finished line; what it cut off is removed
    when the file is read.

    Attributes
    ----------
    path : pathlib.Path
    head : mapping
        First line: all that the records depend on.
    """

    path: Path
    head: Mapping[str, Any]

    def begin(self, fresh: bool = False) -> None:
        """A new file without records where there is none, or where a ``fresh`` one is asked for.

        Raises
        ------
        OtherHead
            The file that stays has another head.
        """
        if fresh or not self.path.exists():
            write_text(to_json(self.head, indent=None), self.path)
            return
        expected, there = json.loads(to_json(self.head)), None
        with self.path.open("rb") as file, suppress(ValueError):
            there = json.loads(file.readline())
        if there != expected:
            differing = [k for k in expected if isinstance(there, dict) and there.get(k) != expected[k]]
            what = f"{', '.join(differing)} differ" if differing else "it does not begin with a head"
            raise OtherHead(f"holds the records of another run: {what}")

    def records(self) -> Iterator[Any]:
        """What all lines but the head hold; from a line on that is cut off they are removed."""
        with self.path.open("rb") as file:
            file.readline()  # the head
            end = file.tell()
            for line in file:
                if not line.endswith(b"\n"):
                    break
                end += len(line)
                yield json.loads(line)
        os.truncate(self.path, end)

    def append(self, record: Mapping[str, Any]) -> None:
        """Append a record, and hand it to the operating system."""
        with self.path.open("ab", buffering=0) as file:
            file.write(to_json(record, indent=None).encode())
