"""Run a sweep: `sweep` hands cases to a `concurrent.futures.Executor` in small batches, and keeps what comes back."""

from __future__ import annotations

import os
import pickle
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import closing
from itertools import islice
from typing import Any, Literal

from tdcr_fe.io.atomic import check_output_folder
from tdcr_fe.io.processes import worker_pool
from tdcr_fe.sweeps.cases import Evaluate, Job, Outcome, solve_cases
from tdcr_fe.sweeps.description import Sweep
from tdcr_fe.sweeps.files import Journal, check_format, head_of, write_sweep
from tdcr_fe.sweeps.read import read_sweep
from tdcr_fe.sweeps.result import Collected, SweepResult

#: Called with the number of cases that are finished, and the number of all.
Progress = Callable[[int, int], None]
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


class SweepInterrupted(KeyboardInterrupt):
    """Ctrl-C ended `tdcr_fe.sweep`; what was finished before is kept, and written where there is a directory.

    Attributes
    ----------
    result : SweepResult
        The other cases have the status "not run".
    """

    def __init__(self, result: SweepResult) -> None:
        super().__init__("interrupted; the attribute `result` has the cases that were finished")
        self.result = result


def sweep(
    source: str | os.PathLike[str] | Mapping[str, Any] | Sweep,
    out: str | os.PathLike[str] | None = None,
    *,
    executor: Executor | None = None,
    processes: int | None = None,
    in_flight: int | None = None,
    evaluate: Evaluate | None = None,
    effects: Sequence[str | os.PathLike[str]] = (),
    fresh: bool = False,
    retry: bool = False,
    table: Literal["csv", "parquet"] = "csv",
    report: bool = True,
    progress: Progress | None = None,
) -> SweepResult:
    """Solve all cases of a sweep.

    Parameters
    ----------
    source
        Path of a `sweep.toml`, its contents as a mapping, or what `read_sweep` returned (see there).
    out
        Directory for the journal, the table, the summary and the report; None writes nothing. A journal of the same
        sweep that is there is continued.
    executor
        Where cases are solved: any `concurrent.futures.Executor`, such as that of a `dask.distributed` client
        (``client.get_executor()``). None: processes of this machine.
    processes
        Number of processes where no executor is given; None: one per core.
    in_flight
        Most batches of cases that an executor is given at a time; None: four per core of this machine, at least 32.
    evaluate
        Function of a module, from a `SequenceResult` to further numbers by name, which become columns.
    effects
        Python files with effects of your own.
    fresh
        Start over where ``out`` has the journal of any sweep.
    retry
        Solve again the cases in the journal that did not converge.
    table
        "csv", or "parquet" where pyarrow is installed.
    report
        Whether to write pictures and `report.html`.
    progress
        Called with the number of finished cases and of all.

    Returns
    -------
    SweepResult

    Raises
    ------
    InputError
        The sweep, or a file that it names, is wrong; or ``out`` cannot be used. Nothing was solved.
    ExecutorBroken
        The executor given does not go on; finished cases are in the journal.
    SweepInterrupted
        The user pressed Ctrl-C; its attribute ``result`` has what was finished.
    """
    check_format(table)
    begun = time.perf_counter()
    described = source if isinstance(source, Sweep) else read_sweep(source, effects)
    job = Job(described, evaluate)
    _check_pickle(job)
    design = described.design()
    collected = Collected(design.count)
    folder = None if out is None else check_output_folder(out)
    head = head_of(described, design, evaluate)
    journal = None if folder is None else Journal(folder, head)
    for outcome in () if journal is None else journal.recall(fresh, design.count):
        if not retry or outcome.status == "converged":
            collected.add(outcome)
    left = collected.left
    report_progress = progress or (lambda finished, total: None)
    report_progress(design.count - len(left), design.count)
    cases = ((k + 1, design.case(k)) for k in left)
    cores = os.cpu_count() or 1
    if executor is None:
        stream = local_outcomes(job, cases, min(processes or cores, len(left)))
    else:
        stream = outcomes(job, cases, executor, in_flight or max(32, 4 * cores))
    solved, stop = 0, None
    try:
        with closing(stream):  # explicitly: on an interruption workers end before this function does
            for batch in stream:
                if journal is not None:
                    journal.write(batch)
                for outcome in batch:
                    collected.add(outcome)
                solved += len(batch)
                report_progress(design.count - len(left) + solved, design.count)
    except KeyboardInterrupt as interruption:
        stop = interruption
    result = collected.result(described, design, time.perf_counter() - begun, solved)
    if folder is not None:
        write_sweep(result, folder, head, table, report)
    if stop is not None:
        raise SweepInterrupted(result) from stop
    return result


def _check_pickle(job: Job) -> None:
    try:
        pickle.dumps(job)
    except Exception as error:
        text = f"sweep: evaluate is {job.evaluate!r}, which cannot be sent to another process ({error})"
        raise TypeError(f"{text}; expected a function of a module") from error


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
