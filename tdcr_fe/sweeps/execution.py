"""Hand cases to a `concurrent.futures.Executor` in small batches, and yield their outcomes as they come."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from itertools import islice
from typing import Any

from tdcr_fe.io.processes import worker_pool
from tdcr_fe.sweeps.cases import Job, Outcome, solve_cases

#: A case: its number from 1, and its values.
Case = tuple[int, tuple[Any, ...]]
Outcomes = Generator[list[Outcome], None, None]

#: A batch is as many cases as take about this long [s], so that handing over costs little and a kill loses little.
BATCH_SECONDS = 0.5
#: Most cases of a batch.
LARGEST_BATCH = 64


class ExecutorBroken(RuntimeError):
    """Workers of an executor died and it takes no more cases.

    Attributes
    ----------
    cases : tuple of Case
        Those that were handed over and gave nothing.
    """

    def __init__(self, cases: list[Case], reason: str) -> None:
        self.cases = tuple(cases)
        super().__init__(reason)


def outcomes(job: Job, cases: Iterator[Case], executor: Executor, in_flight: int) -> Outcomes:
    """Solve cases by an executor.

    Only a few batches are handed over at a time, so that memory does not grow with the number of cases. A batch whose
    future fails is handed over again case by case; a case whose future fails has the status "error".

    Parameters
    ----------
    job, cases
        What to solve.
    executor
        Of processes, threads or machines.
    in_flight
        Most batches handed over at a time.

    Yields
    ------
    list of Outcome
        In the order of completion.

    Raises
    ------
    ExecutorBroken
        The executor cannot go on.
    """
    running: dict[Future[list[Outcome]], list[Case]] = {}
    again: deque[Case] = deque()
    size, seconds, count = 1, 0.0, 0
    try:
        while True:
            while len(running) < in_flight:
                batch = [again.popleft()] if again else list(islice(cases, size))
                if not batch:
                    break
                try:
                    running[executor.submit(solve_cases, job, batch)] = batch
                except BrokenExecutor as broken:
                    raise ExecutorBroken(_lost(running, [*batch, *again]), str(broken)) from broken
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                error = CancelledError("by the executor") if future.cancelled() else future.exception()
                if isinstance(error, BrokenExecutor):
                    raise ExecutorBroken(_lost(running, again), str(error))
                batch = running.pop(future)
                if error is None:
                    found = future.result()
                    seconds, count = seconds + sum(o.seconds for o in found), count + len(found)
                    size = max(1, min(LARGEST_BATCH, int(BATCH_SECONDS * count / max(seconds, 1e-9))))
                    yield found
                elif len(batch) > 1:
                    again.extend(batch)
                else:
                    yield [Outcome(batch[0][0], "error", f"{type(error).__name__}: {error}")]
    finally:
        for future in running:
            future.cancel()


def _lost(running: dict[Future[list[Outcome]], list[Case]], others: Iterable[Case]) -> list[Case]:
    """Cases that an executor gave nothing for, in order; those of futures that are done come in their batches, too."""
    lost = [*(case for batch in running.values() for case in batch), *others]
    return sorted(lost, key=lambda case: case[0])


def local_outcomes(job: Job, cases: Iterator[Case], processes: int | None = None) -> Outcomes:
    """Solve cases in processes of this machine, which end with this one.

    Where a worker dies, as for want of memory, the cases that were under way are solved one at a time; the one that
    ends its process again has the status "error".
    """
    count = processes or os.cpu_count() or 1
    while True:
        try:
            with worker_pool(count) as pool:
                yield from outcomes(job, cases, pool, 2 * count)
            return
        except ExecutorBroken as error:
            yield from _one_by_one(job, error.cases)


def _one_by_one(job: Job, cases: Iterable[Case]) -> Outcomes:
    """Solve cases one at a time in a single process, which is replaced where a case ends it."""
    left = deque(cases)
    while left:
        try:
            with worker_pool(1) as pool:
                while left:
                    yield pool.submit(solve_cases, job, [left[0]]).result()
                    left.popleft()
        except BrokenExecutor:
            reason = "the process that solved it ended without a result (out of memory, or killed)"
            yield [Outcome(left.popleft()[0], "error", reason)]
