"""Run a sweep: `sweep`, one call over any `concurrent.futures.Executor`."""

from __future__ import annotations

import os
import pickle
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from pathlib import Path
from typing import Any, Literal

from tdcr_fe.io.atomic import check_output_folder
from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.model.arguments import check_callable, check_instance
from tdcr_fe.sweeps import journal
from tdcr_fe.sweeps.cases import Evaluate, Job, Outcome
from tdcr_fe.sweeps.collected import Collected
from tdcr_fe.sweeps.columns import columns_of_steps
from tdcr_fe.sweeps.description import Sweep
from tdcr_fe.sweeps.execution import Case, ExecutorBroken, local_outcomes, outcomes
from tdcr_fe.sweeps.files import check_format, digest_of_design, head_of, write_sweep
from tdcr_fe.sweeps.read import read_sweep
from tdcr_fe.sweeps.result import SweepResult
from tdcr_fe.sweeps.sampling import Design

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
        Number of processes where no executor is given; None: one a core.
    in_flight
        Most batches of cases that an executor is given at a time; None: four a core of this machine, at least 32.
    evaluate
        Function of a module, from a `SequenceResult` to further numbers by name, which become columns.
    effects
        Python files with effects of one's own.
    fresh
        Begin anew where ``out`` has the journal of any sweep.
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
    head = head_of(described, digest_of_design(design), evaluate)
    if folder is not None:
        _recall(folder / journal.NAME, head, collected, fresh, retry)
    before = int(collected.done.sum())
    interrupted = False
    try:
        _solve(job, design, collected, folder, executor, processes, in_flight, progress)
    except KeyboardInterrupt:
        interrupted = True
    solved = int(collected.done.sum()) - before
    result = _result(described, design, collected, interrupted, time.perf_counter() - begun, solved)
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


def _recall(path: Path, head: Mapping[str, Any], collected: Collected, fresh: bool, retry: bool) -> None:
    """Take the outcomes of a journal that is there; begin one where there is none."""
    if path.exists() and not fresh:
        for outcome in journal.recall(path, head):
            if outcome.case > len(collected.seconds):
                raise InputError([Problem("-o", "", str(path), f"there is no case {outcome.case}")])
            if not retry or outcome.status == "converged":
                collected.add(outcome)
    else:
        journal.begin(path, head)


def _solve(
    job: Job,
    design: Design,
    collected: Collected,
    folder: Path | None,
    executor: Executor | None,
    processes: int | None,
    in_flight: int | None,
    progress: Progress | None,
) -> None:
    """Solve the cases that are left, and note them as they come."""
    done = collected.done.copy()
    left = [k for k in range(design.count) if not done[k]]
    finished = design.count - len(left)
    if progress is not None:
        progress(finished, design.count)
    if not left:
        return
    cases: Iterator[Case] = ((k + 1, design.case(k)) for k in left)
    if executor is None:
        cores = min(processes or os.cpu_count() or 1, len(left))
        stream = local_outcomes(job, cases, cores)
    else:
        stream = outcomes(job, cases, executor, in_flight or max(32, 4 * (os.cpu_count() or 1)))
    # Both are closed explicitly: on an interruption workers end before this function does.
    with closing(stream):
        for batch in stream:
            if folder is not None:
                journal.write(folder / journal.NAME, batch)
            for outcome in batch:
                collected.add(outcome)
            finished += len(batch)
            if progress is not None:
                progress(finished, design.count)


def _result(
    described: Sweep,
    design: Design,
    collected: Collected,
    interrupted: bool,
    wall_time: float,
    solved: int,
) -> SweepResult:
    suffixes = [f"_step{k}" for k in described.output.steps] or [""]
    tendons = _tendons(described)
    order = [f"{name}{suffix}" for suffix in suffixes for name in columns_of_steps(tendons)]
    cases = collected.frame(described, design, order)
    inputs = tuple(v.name for v in described.variations)
    first = 4 + len(inputs)
    return SweepResult(
        sweep=described,
        design=design,
        cases=cases,
        inputs=inputs,
        outputs=tuple(cases.columns[first:]),
        counts=collected.counts(),
        failures={
            s: tuple(collected.messages(s))
            for s in ("not converged", "invalid", "error")
            if collected.messages(s)
        },
        warnings=tuple(collected.messages("warning")),
        interrupted=interrupted,
        wall_time=wall_time,
        case_seconds=float(collected.seconds[collected.done].sum()),
        solved_now=solved,
    )


def _tendons(described: Sweep) -> list[str]:
    """Names of the tendons of all robots, in order."""
    robots = [described.tables.robot, *(tables.robot for _, tables in described.robots)]
    names = [str(t["name"]) for robot in robots if robot for t in robot.get("tendons", ())]
    return list(dict.fromkeys(names))


__all__ = ["ExecutorBroken", "Outcome", "sweep"]
