"""Records of many cases, kept as they are found, so that a run that was interrupted goes on where it stopped.

`solve_all` is the loop: it yields the records that are kept, then solves the cases that are left, in processes, and
keeps every record at once. `Lines` keeps records in one file, a line of JSON each.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from tdcr_fe.io.atomic import to_json, write_text
from tdcr_fe.io.processes import worker_pool
from tdcr_fe.model.messages import warnings_to

Record = dict[str, Any]
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

    def begin(self) -> None:
        """A new file without records, which replaces one that is there."""
        write_text(to_json(self.head, indent=None), self.path)

    def begin_or_check(self) -> None:
        """A new file where there is none.

        Raises
        ------
        OtherHead
            The file that is there has another head.
        """
        if not self.path.exists():
            self.begin()
            return
        with self.path.open("rb") as file:
            self._check(file.readline())

    def records(self, read: Callable[[Any], Any] = lambda record: record) -> Iterator[Any]:
        """What all lines but the head hold; from a line on that is cut off, or holds nothing, they are removed.

        Parameters
        ----------
        read
            From the contents of a line to what is yielded; None where it holds nothing.

        Raises
        ------
        OtherHead
            The file has another head.
        """
        with self.path.open("rb") as file:
            self._check(file.readline())
            end = file.tell()
            for line in file:
                try:
                    found = read(json.loads(line)) if line.endswith(b"\n") else None
                except ValueError:
                    found = None
                if found is None:
                    break
                end += len(line)
                yield found
        os.truncate(self.path, end)

    def append(self, records: Iterable[Any]) -> None:
        """Append records, and hand them to the operating system."""
        lines = "".join(to_json(r, indent=None) for r in records)
        with self.path.open("ab", buffering=0) as file:
            file.write(lines.encode())

    def recall(self, keys: Iterable[str]) -> Iterator[tuple[str, Record]]:
        """Records that are kept of some keys; of several records of a key the last counts."""
        wanted = set(keys)
        found = {}
        for record in self.records():
            key = record.get("key") if isinstance(record, dict) else None
            if key in wanted:
                found[key] = {k: v for k, v in record.items() if k != "key"}
        yield from found.items()

    def keep(self, key: str, record: Mapping[str, Any]) -> None:
        """Keep a record, so that a kill does not lose it."""
        self.append([{"key": key, **record}])

    def _check(self, line: bytes) -> None:
        try:
            there = json.loads(line)
        except ValueError:
            there = None
        expected = json.loads(to_json(self.head))
        if there == expected:
            return
        differing = [k for k in expected if isinstance(there, dict) and there.get(k) != expected[k]]
        what = f"{', '.join(differing)} differ" if differing else "it does not begin with a head"
        raise OtherHead(f"holds the records of another run: {what}")


def solve_all(
    tasks: Mapping[str, Task],
    solve: Callable[[Task], Record],
    store: Lines,
    processes: int = 1,
    initializer: Callable[[], None] | None = None,
    *,
    own_process: bool = True,
    again: Callable[[Record], bool] | None = None,
) -> Generator[tuple[str, Record, bool], None, None]:
    """Records of all tasks: those that are kept first, the others as they are found.

    Close the generator explicitly (`contextlib.closing`), so that on an interruption its workers end before the caller
    goes on.

    Parameters
    ----------
    tasks
        By key.
    solve
        Function of a module, from a task to its record. An exception of it ends the run.
    store
        Where records are kept.
    processes
        Number of tasks at a time.
    initializer
        Called once in every process.
    own_process
        Whether one process at a time is a worker, too; otherwise it is this one.
    again
        Whether a record that is kept does not count; None: all of them count.

    Yields
    ------
    key : str
    record : dict
    known : bool
        Whether it was kept before.
    """
    known = set()
    for key, record in store.recall(tasks):
        if again is None or not again(record):
            known.add(key)
            yield key, record, True
    left = [(key, task) for key, task in tasks.items() if key not in known]
    if not left:
        return
    if processes <= 1 and not own_process:
        if initializer is not None:
            initializer()
        for key, task in left:
            with warnings_to():
                record = solve(task)
            store.keep(key, record)
            yield key, record, False
        return
    with (
        worker_pool(min(processes, len(left)), initializer) as pool,
        closing(as_completed(pool, solve, left, 2 * processes)) as found,
    ):
        for key, future in found:
            record = future.result()
            store.keep(key, record)
            yield key, record, False


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
