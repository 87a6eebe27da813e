"""Records of the cases of a campaign, kept as they are found, so that an interrupted run goes on where it stopped."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import closing
from functools import partial
from typing import Any, TypeVar

from tdcr_fe.io.processes import worker_pool
from tdcr_fe.io.store import Lines, as_completed
from tdcr_fe.model.messages import warnings_to

Record = dict[str, Any]
#: Keys, records, and whether they were kept before.
Found = Generator[tuple[str, Record, bool], None, None]
Task = TypeVar("Task")


class Records(Lines):
    """Records by key, a line each."""

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
        self.append({"key": key, **record})


def solve_all(
    tasks: Mapping[str, Task],
    solve: Callable[[Task], Record],
    store: Records,
    processes: int = 1,
    *,
    again: Callable[[Record], bool] | None = None,
) -> Found:
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
        Number of tasks at a time; a single one is solved in this process.
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
    quiet = partial(_quietly, solve)
    if processes <= 1:
        for key, task in left:
            record = quiet(task)
            store.keep(key, record)
            yield key, record, False
        return
    with (
        worker_pool(min(processes, len(left))) as pool,
        closing(as_completed(pool, quiet, left, 2 * processes)) as found,
    ):
        for key, future in found:
            record = future.result()
            store.keep(key, record)
            yield key, record, False


def _quietly(solve: Callable[[Task], Record], task: Task) -> Record:
    """A record found with one thread for linear algebra, no warnings, and no messages of Exudyn on the terminal."""
    import exudyn
    from threadpoolctl import threadpool_limits

    exudyn.config.printToConsole = False
    with threadpool_limits(1), warnings_to():
        return solve(task)
