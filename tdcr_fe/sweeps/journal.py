"""The journal of a sweep, `cases.jsonl`: one line for every finished case, from which a sweep continues."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from tdcr_fe.io.atomic import to_json, write_text
from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.sweeps.cases import Outcome, from_record, to_record

NAME = "cases.jsonl"


class Journal:
    """Appends outcomes to the journal; each line is written whole, so that a kill loses no finished line.

    Parameters
    ----------
    path
        Of the journal, whose first line is there.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("ab", buffering=0)

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._file.close()

    def write(self, outcomes: Iterable[Outcome]) -> None:
        """Append outcomes, and hand them to the operating system."""
        lines = "".join(to_json(to_record(o), indent=None) for o in outcomes)
        self._file.write(lines.encode())


def begin(path: Path, head: Mapping[str, Any]) -> None:
    """A new journal, which replaces one that is there.

    Parameters
    ----------
    path
        Of the journal.
    head
        What the sweep is: digests of its files, seed, versions.
    """
    write_text(to_json(head, indent=None), path)


def recall(path: Path, head: Mapping[str, Any]) -> Iterator[Outcome]:
    """Outcomes in a journal of the same sweep; the end of a line that a kill cut off is removed.

    Raises
    ------
    InputError
        The journal is that of another sweep, or none.
    """
    with path.open("rb") as file:
        _check_head(path, file.readline(), head)
        end = file.tell()
        for line in file:
            try:
                found = from_record(json.loads(line)) if line.endswith(b"\n") else None
            except (ValueError, KeyError, TypeError, AttributeError):
                found = None
            if found is None:
                break
            end += len(line)
            yield found
    os.truncate(path, end)


def _check_head(path: Path, line: bytes, head: Mapping[str, Any]) -> None:
    try:
        there = json.loads(line)
    except ValueError:
        there = None
    expected = json.loads(to_json(head))
    if there == expected:
        return
    what = "is no journal of a sweep"
    if isinstance(there, dict):
        other = [k for k in expected if there.get(k) != expected[k]]
        what = f"is of another sweep: {', '.join(other) or 'keys'} differ"
    text = f"{what}; give another directory, or --fresh to replace what is there"
    raise InputError([Problem("-o", "", str(path), text)])
