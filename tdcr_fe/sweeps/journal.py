"""The journal of a sweep, `cases.jsonl`: one line for every finished case, from which a sweep continues."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.io.store import Lines, OtherHead
from tdcr_fe.sweeps.cases import Outcome, from_record, to_record

NAME = "cases.jsonl"


def write(path: Path, outcomes: Iterable[Outcome]) -> None:
    """Append outcomes to a journal that is there, and hand them to the operating system."""
    Lines(path, {}).append(to_record(o) for o in outcomes)


def begin(path: Path, head: Mapping[str, Any]) -> None:
    """A new journal, which replaces one that is there.

    Parameters
    ----------
    path
        Of the journal.
    head
        What the sweep is: digests of its files, seed, versions.
    """
    Lines(path, head).begin()


def recall(path: Path, head: Mapping[str, Any]) -> Iterator[Outcome]:
    """Outcomes in a journal of the same sweep; the end of a line that a kill cut off is removed.

    Raises
    ------
    InputError
        The journal is that of another sweep, or none.
    """
    try:
        yield from Lines(path, head).records(_outcome)
    except OtherHead as error:
        what = "is no journal of a sweep"
        if error.there:
            what = f"is of another sweep: {', '.join(error.differing) or 'keys'} differ"
        text = f"{what}; give another directory, or --fresh to replace what is there"
        raise InputError([Problem("-o", "", str(path), text)]) from error


def _outcome(record: Any) -> Outcome | None:
    """The outcome in a line; None where it holds none."""
    try:
        return from_record(record)
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
