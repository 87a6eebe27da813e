"""Many cases: their records, a line of JSON each, kept whatever happens, and their futures as they end."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from tdcr_fe.io.atomic import to_json, write_text

Task = TypeVar("Task")
Key = TypeVar("Key")


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


def as_completed(
    executor: Executor, solve: Callable[[Task], Any], tasks: Iterable[tuple[Key, Task]], most: int
) -> Generator[tuple[Key, Future[Any]], None, None]:
    """Futures of tasks, given by key, as they end; ``most`` are handed over at a time, so that many cost no memory.

    Raises
    ------
    concurrent.futures.BrokenExecutor
        The executor takes no more tasks.
    """
    running: dict[Future[Any], Key] = {}
    try:
        for key, task in tasks:
            running[executor.submit(solve, task)] = key
            if len(running) >= most:
                yield from _finished(running)
        while running:
            yield from _finished(running)
    finally:
        for future in running:
            future.cancel()


def _finished(running: dict[Future[Any], Key]) -> Iterator[tuple[Key, Future[Any]]]:
    done, _ = wait(running, return_when=FIRST_COMPLETED)
    for future in done:
        yield running.pop(future), future
