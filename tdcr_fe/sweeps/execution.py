"""Run a sweep: `sweep` hands cases to a `concurrent.futures.Executor` a few at a time, and keeps what comes back.

Its files: the journal that it continues from, the table of cases, `summary.json`, and the report.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import os
import pickle
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

from tdcr_fe.io import files
from tdcr_fe.io.files import Lines, OtherHead, StrPath, refusal
from tdcr_fe.io.processes import as_completed, worker_pool
from tdcr_fe.io.result_files import versions
from tdcr_fe.model.results import Interrupted
from tdcr_fe.sweeps.cases import Evaluate, Job, Outcome, solve_case
from tdcr_fe.sweeps.description import Change, Sweep
from tdcr_fe.sweeps.read import read_sweep
from tdcr_fe.sweeps.result import Collected, Message, SweepResult

JOURNAL = "cases.jsonl"
LOCK = ".cases.lock"
TABLE, SUMMARY, REPORT = "cases.csv", "summary.json", "report.html"
#: Every picture that a sweep may have.
PICTURE_FILES = ("workspace.png", "sobol_indices.png", "distributions.png", "main_effects.png")


def head_of(sweep: Sweep, evaluate: Evaluate | None) -> dict[str, Any]:
    """First line of the journal: all that the outcomes depend on."""
    tables = files.to_json([sweep.tables.scenario, sweep.tables.robot])
    variations = []
    for v in sweep.variations:
        kind, values = v.described()
        variations.append({"name": v.column, "key": v.key, "mode": v.mode, kind: values})
    return {
        "input": {name: sha256 for name, sha256 in sweep.digests.items() if name in sweep.effects},
        "tables": hashlib.sha256(tables.encode()).hexdigest(),
        "variations": variations,
        "sampling": asdict(sweep.sampling),
        "output": asdict(sweep.output),
        "evaluate": f"{evaluate.__module__}.{getattr(evaluate, '__qualname__', '')}" if evaluate else "",
        "versions": versions(),
    }


@contextmanager
def journal(folder: Path, head: Mapping[str, Any], fresh: bool) -> Iterator[Lines]:
    """The journal of a folder, which no other sweep writes to meanwhile; a new one where asked for or none is there.

    The operating system frees the lock when this process ends in whatever way.

    Raises
    ------
    InputError
        Another sweep writes to the folder, or the journal there is that of another sweep, or none.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / LOCK).open("w") as file:
        try:
            if importlib.util.find_spec("fcntl"):
                fcntl = importlib.import_module("fcntl")
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            else:  # Windows
                msvcrt = importlib.import_module("msvcrt")
                msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except (BlockingIOError, PermissionError) as error:
            text = "another sweep is writing there; wait until it has ended, or give another directory"
            raise refusal("-o", text, value=str(folder)) from error
        lines = Lines(folder / JOURNAL, head)
        try:
            lines.begin(fresh)
        except OtherHead as error:
            text = f"{error}; give another directory, or --fresh to replace what is there"
            raise refusal("-o", text, value=str(lines.path)) from error
        yield lines


def _message(message: Message, count: str, text: str) -> dict[str, Any]:
    return {count: message.count, "first_case": message.case, text: message.example}


def summary_of(result: SweepResult, head: Mapping[str, Any]) -> dict[str, Any]:
    """Contents of `summary.json`."""
    names = ("first", "first_interval", "total", "total_interval")
    indices = {
        output: {name: {n: getattr(s, n)[k] for n in names} for k, name in enumerate(result.inputs)}
        for output, s in result.sobol_indices().items()
    }
    return {
        "versions": head["versions"],
        "input": {name: {"sha256": sha256} for name, sha256 in result.sweep.digests.items()},
        "sampling": head["sampling"],
        "variations": head["variations"],
        "cases": len(result.cases),
        "status": result.counts,
        "interrupted": result.interrupted,
        "failures": {
            status: [_message(m, "cases", "reason") for m in messages]
            for status, messages in result.failures.items()
        },
        "warnings": [_message(m, "times", "text") for m in result.warnings],
        "statistics": result.statistics().to_dict(),
        **({"sobol_indices": indices} if indices else {}),
        "wall_time": result.wall_time,
        "solved_in_this_run": result.solved_now,
    }


def write_sweep(result: SweepResult, out: Path, head: Mapping[str, Any], report: bool = True) -> None:
    """Write the table of cases, the summary, and the report with its pictures.

    Parameters
    ----------
    result
        What was solved.
    out
        Directory, which has the journal.
    head
        First line of the journal.
    report
        Whether to write pictures and report.
    """

    def write_tables(folder: Path) -> None:
        result.cases.to_csv(folder / TABLE, index=False)
        files.write_json(summary_of(result, head), folder / SUMMARY)

    files.write_folder(out, write_tables, ours=(TABLE, SUMMARY, REPORT, *PICTURE_FILES))
    if report:
        from tdcr_fe.sweeps.report import write_report

        files.write_folder(out, lambda folder: write_report(result, folder))


# ----------------------------------------------------------------------------------------------------------- running

#: Called with the number of cases that are finished, and the number of all.
Progress = Callable[[int, int], None]
#: A case: its number from 1, twice (the second one is for the worker), and what changes in it.
Case = tuple[int, tuple[int, list[Change]]]
Outcomes = Generator[Outcome, None, None]


def sweep(
    source: StrPath | Mapping[str, Any] | Sweep,
    out: StrPath | None = None,
    *,
    executor: Executor | None = None,
    processes: int | None = None,
    in_flight: int | None = None,
    evaluate: Evaluate | None = None,
    effects: Sequence[StrPath] = (),
    fresh: bool = False,
    retry: bool = False,
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
        Most cases that an executor is given at a time; None: four per core of this machine, at least 32.
    evaluate
        Function of a module, from a `SequenceResult` to further numbers by name, which become columns.
    effects
        Python files with effects of your own.
    fresh
        Start over where ``out`` has the journal of any sweep.
    retry
        Solve again the cases in the journal that did not converge.
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
        The sweep, or a file that it names, is wrong; or ``out`` cannot be used, as while another sweep writes there.
        Nothing was solved.
    concurrent.futures.BrokenExecutor
        The executor given does not go on; finished cases are in the journal.
    Interrupted
        The user pressed Ctrl-C; its attribute ``result`` has what was finished.
    """
    begun = time.perf_counter()
    described = source if isinstance(source, Sweep) else read_sweep(source, effects)
    job = Job(replace(described, variations=()), evaluate, tuple(v.column for v in described.variations))
    _check_pickle(job)
    design = described.design()
    collected = Collected(described.count)
    head = head_of(described, evaluate)
    with ExitStack() as stack:
        folder = lines = None
        if out is not None:
            folder = files.check_output_folder(out)
            lines = stack.enter_context(journal(folder, head, fresh))
            for outcome in map(Outcome.from_record, lines.records()):
                if not retry or outcome.status == "converged":
                    collected.add(outcome)
        left = collected.left
        report_progress = progress or (lambda finished, total: None)
        report_progress(described.count - len(left), described.count)
        cases = ((case, (case, described.changes(design, case - 1))) for case in left)
        cores = os.cpu_count() or 1
        if executor is None:
            stream = local_outcomes(job, cases, min(processes or cores, len(left)))
        else:
            stream = outcomes(job, cases, executor, in_flight or max(32, 4 * cores))
        solved, stop = 0, None
        try:
            with closing(stream):  # explicitly: on an interruption workers end before this function does
                for solved, outcome in enumerate(stream, start=1):
                    # First: what the journal has is in the table, wherever it is interrupted.
                    collected.add(outcome)
                    if lines is not None:
                        lines.append(vars(outcome))
                    report_progress(described.count - len(left) + solved, described.count)
        except KeyboardInterrupt as interruption:
            stop = interruption
        result = collected.result(described, design, time.perf_counter() - begun, solved)
        if folder is not None:
            write_sweep(result, folder, head, report)
    if stop is not None:
        raise Interrupted(result) from stop
    return result


def _check_pickle(job: Job) -> None:
    try:
        pickle.dumps(job)
    except Exception as error:
        text = f"sweep: evaluate is {job.evaluate!r}, which cannot be sent to another process ({error})"
        raise TypeError(f"{text}; expected a function of a module") from error


def outcomes(job: Job, cases: Iterator[Case], executor: Executor, in_flight: int) -> Outcomes:
    """Solve cases by an executor, in the order of completion; a case whose future fails has the status "error".

    Raises
    ------
    concurrent.futures.BrokenExecutor
        The executor cannot go on.
    """
    with closing(as_completed(executor, partial(solve_case, job), cases, in_flight)) as futures:
        for number, future in futures:
            yield _outcome(number, future)


def _outcome(number: int, future: Future[Outcome]) -> Outcome:
    error = CancelledError("by the executor") if future.cancelled() else future.exception()
    if isinstance(error, BrokenExecutor):
        raise error
    return Outcome(number, "error", f"{type(error).__name__}: {error}") if error else future.result()


def local_outcomes(job: Job, cases: Iterator[Case], processes: int) -> Outcomes:
    """Solve cases in processes of this machine, which end with this one.

    Where a worker dies, as for want of memory, every case that was under way is solved again in a process of its own;
    the one that ends its process again has the status "error".
    """
    under_way: dict[int, Case] = {}

    def handed_over() -> Iterator[Case]:
        for case in cases:
            under_way[case[0]] = case
            yield case

    while True:
        try:
            with (
                worker_pool(processes) as pool,
                closing(outcomes(job, handed_over(), pool, 2 * processes)) as stream,
            ):
                for outcome in stream:
                    del under_way[outcome.case]
                    yield outcome
            return
        except BrokenExecutor:
            for number in list(under_way):
                yield _alone(job, under_way.pop(number))


def _alone(job: Job, case: Case) -> Outcome:
    """The outcome of a case in a process of its own."""
    try:
        with worker_pool(1) as pool:
            return pool.submit(solve_case, job, case[1]).result()
    except BrokenExecutor:
        reason = "the process that solved it ended without a result (out of memory, or killed)"
        return Outcome(case[0], "error", reason)
