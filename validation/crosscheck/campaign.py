"""Run cases and studies in parallel processes, and keep finished records, so that a run can be resumed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import closing
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from tdcr_fe.io.atomic import plain, write_json
from tdcr_fe.io.processes import worker_pool
from tdcr_fe.io.summary import versions as package_versions
from tdcr_fe.validation.crosscheck.case import (
    Case,
)
from tdcr_fe.validation.crosscheck.studies import Study

Record = dict[str, Any]
Task = Case | Study


@cache
def versions() -> dict[str, str]:
    """Versions that a record depends on: packages, and a digest of this package's source."""
    packages = (
        "elements",
        "model",
        "scene",
        "solve",
        "effects",
        "validation.reference",
        "validation.crosscheck",
    )
    return {**package_versions(), "source": source_digest(packages)}


#: Modules that do not affect the numbers.
_NO_NUMBERS = ("campaign", "figures", "page", "report", "requirements")


def source_digest(packages: Iterable[str]) -> str:
    """Digest of the source of some subpackages, without the modules that do not affect the numbers."""
    digest = hashlib.sha256()
    for package in packages:
        source = (item for item in files(f"tdcr_fe.{package}").iterdir() if item.name.endswith(".py"))
        for item in sorted(source, key=lambda item: item.name):
            if item.name.removesuffix(".py") not in _NO_NUMBERS:
                digest.update(item.read_bytes())
    return digest.hexdigest()[:16]


def digest_of(task: Task) -> str:
    """Names a case or study and the versions that it is solved with."""
    return hashlib.sha256(f"{task!r}|{sorted(versions().items())}".encode()).hexdigest()


def solve(task: Task) -> Record:
    """Solve one case or study; an error becomes part of the record instead of ending the run."""
    from tdcr_fe.validation.crosscheck.compare import compare
    from tdcr_fe.validation.crosscheck.studies import run_study

    try:
        record = compare(task) if isinstance(task, Case) else run_study(task)
        record["error"] = ""
    except Exception as error:
        record = {"id": task.id, "error": f"{type(error).__name__}: {error}"}
    return record


def silence_exudyn() -> None:
    """Suppress Exudyn's messages on the terminal."""
    import exudyn

    exudyn.config.printToConsole = False


def recall(folder: Path, task: Task) -> Record | None:
    """The record of a task that was finished before with the same versions; None where there is none."""
    path = folder / f"{task.id}.json"
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if (
        not isinstance(stored, dict)
        or stored.get("digest") != digest_of(task)
        or stored["record"].get("error")
    ):
        return None
    record: Record = stored["record"]
    return record


def run(
    tasks: Sequence[Task], folder: Path, processes: int, progress: Callable[[Record, bool], None]
) -> dict[str, Record]:
    """Solve tasks, or load the records of those finished before.

    Parameters
    ----------
    tasks
        Cases and studies.
    folder
        Where the records are kept, one file each.
    processes
        How many to use.
    progress
        Called with every record, and whether it was recalled.

    Returns
    -------
    dict
        Records by id.

    Raises
    ------
    KeyboardInterrupt
        Interrupted; finished records are kept in ``folder``.
    """
    records: dict[str, Record] = {}
    left: list[Task] = []
    for task in tasks:
        known = recall(folder, task)
        if known is None:
            left.append(task)
        else:
            records[task.id] = known
            progress(known, True)
    if left:
        # closed explicitly: on an interruption the workers end before this function does
        with closing(_solve_all(left, processes)) as solved:
            for task, record in solved:
                record = plain(record)
                document = {"digest": digest_of(task), "versions": versions(), "record": record}
                write_json(document, folder / f"{task.id}.json", indent=None)
                records[task.id] = record
                progress(record, False)
    return {task.id: records[task.id] for task in tasks}


def _solve_all(tasks: Sequence[Task], processes: int) -> Generator[tuple[Task, Record], None, None]:
    with worker_pool(min(processes, len(tasks)), silence_exudyn) as pool:
        waiting = iter(tasks)
        running: dict[Future[Record], Task] = {}
        for task in waiting:
            running[pool.submit(solve, task)] = task
            if len(running) < 2 * processes:
                continue
            yield from _finished(running)
        while running:
            yield from _finished(running)


def _finished(running: dict[Future[Record], Task]) -> Iterable[tuple[Task, Record]]:
    done, _ = wait(running, return_when=FIRST_COMPLETED)
    for future in done:
        yield running.pop(future), future.result()
