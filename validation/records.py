"""Records of the cases of a campaign, kept as they are found, so that an interrupted run goes on where it stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from tdcr_fe.io.files import Lines
from tdcr_fe.io.processes import as_completed, worker_pool
from tdcr_fe.model.messages import warnings_to

Record = dict[str, Any]
#: Called with every record, and whether it was kept before.
Progress = Callable[[Record, bool], object]
Task = TypeVar("Task")


@dataclass(frozen=True)
class Records(Lines):
    """Records by key, a line each.

    Attributes
    ----------
    again : callable
        Whether a record that is kept does not count.
    """

    again: Callable[[Record], bool] = lambda record: False

    def recall(self, keys: Iterable[str]) -> Iterator[tuple[str, Record]]:
        """Records that are kept of some keys; of several records of a key the last counts."""
        wanted, found = set(keys), {}
        for record in self.records():
            key = record.pop("key", None) if isinstance(record, dict) else None
            if key in wanted:
                found[key] = record
        yield from ((key, record) for key, record in found.items() if not self.again(record))

    def keep(self, key: str, record: Mapping[str, Any]) -> None:
        """Keep a record, so that a kill does not lose it."""
        self.append({"key": key, **record})

    def of_all(
        self, tasks: Mapping[str, Task], solve: Callable[[Task], Record], processes: int, progress: Progress
    ) -> dict[str, Record]:
        """Records of all tasks by key: those that are kept, and the others, which are kept as they are found.

        Parameters
        ----------
        tasks
            By key.
        solve
            Function of a module, from a task to its record. An exception of it ends the run.
        processes
            Number of tasks at a time; a single one is solved in this process.
        progress
            Called with every record, in the order in which they are found.

        Raises
        ------
        KeyboardInterrupt
            Interrupted; the workers have ended, and finished records are kept.
        """
        found = dict(self.recall(tasks))
        for record in found.values():
            progress(record, True)
        left = [(key, task) for key, task in tasks.items() if key not in found]
        quiet = partial(_quietly, solve)

        def add(key: str, record: Record) -> None:
            self.keep(key, record)
            found[key] = record
            progress(record, False)

        if processes > 1 and left:
            with (
                worker_pool(min(processes, len(left))) as pool,
                closing(as_completed(pool, quiet, left, 2 * processes)) as solved,
            ):
                for key, future in solved:
                    add(key, future.result())
        else:
            for key, task in left:
                add(key, quiet(task))
        return {key: found[key] for key in tasks}


def _quietly(solve: Callable[[Task], Record], task: Task) -> Record:
    """A record found with one thread for linear algebra, no warnings, and no messages of Exudyn on the terminal."""
    import exudyn
    from threadpoolctl import threadpool_limits

    exudyn.config.printToConsole = False
    with threadpool_limits(1), warnings_to():
        return solve(task)
