"""Run a sweep: `sweep`, one call over any `concurrent.futures.Executor`."""

from __future__ import annotations

import os
import pickle
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from typing import Any, Literal

from tdcr_fe.io.atomic import check_output_folder
from tdcr_fe.model.arguments import check_callable, check_instance
from tdcr_fe.sweeps.cases import Evaluate, Job
from tdcr_fe.sweeps.description import Sweep
from tdcr_fe.sweeps.execution import local_outcomes, outcomes
from tdcr_fe.sweeps.files import Journal, check_format, head_of, write_sweep
from tdcr_fe.sweeps.read import read_sweep
from tdcr_fe.sweeps.result import Collected, SweepResult

#: Called with the number of cases that are finished, and the number of all.
Progress = Callable[[int, int], None]


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
        Where the user interrupts, what was finished; the other cases have the status "not run".

    Raises
    ------
    InputError
        The sweep, or a file that it names, is wrong; or ``out`` cannot be used. Nothing was solved.
    ExecutorBroken
        The executor given does not go on; finished cases are in the journal.
    """
    hint = (
        "client.get_executor() of dask.distributed is one; without one, processes of this machine are used."
    )
    check_instance("sweep", "executor", executor, (Executor, type(None)), "an Executor", hint)
    check_callable("sweep", "evaluate", evaluate, "It is called with every SequenceResult.")
    check_callable(
        "sweep", "progress", progress, "It is called with the numbers of finished and of all cases."
    )
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
    solved = 0
    try:
        with closing(stream):  # explicitly: on an interruption workers end before this function does
            for batch in stream:
                if journal is not None:
                    journal.write(batch)
                for outcome in batch:
                    collected.add(outcome)
                solved += len(batch)
                report_progress(design.count - len(left) + solved, design.count)
    except KeyboardInterrupt:
        pass  # the result says which cases were not run
    result = collected.result(described, design, time.perf_counter() - begun, solved)
    if folder is not None:
        write_sweep(result, folder, head, table, report)
    return result


def _check_pickle(job: Job) -> None:
    try:
        pickle.dumps(job)
    except Exception as error:
        raise TypeError(
            f"sweep: evaluate is {job.evaluate!r}, which cannot be sent to another process ({error}); expected a "
            "function of a module"
        ) from error
