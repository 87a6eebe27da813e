"""Run cases and studies in parallel processes, and keep finished records, so that a run can be resumed."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from tdcr_fe.io.atomic import plain
from tdcr_fe.io.result_files import versions as package_versions
from tdcr_fe.io.store import Folder, solve_all
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
    record = dict(_store(folder, [task]).recall([task.id])).get(task.id)
    return None if record is None or _failed(record) else record


def _store(folder: Path, tasks: Sequence[Task]) -> Folder:
    """Where the records of tasks are kept: under a digest of task and versions."""
    by_id = {task.id: task for task in tasks}
    return Folder(folder, lambda key: digest_of(by_id[key]), {"versions": versions()})


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
    by_id, store = {task.id: task for task in tasks}, _store(folder, tasks)
    # closed explicitly: on an interruption the workers end before this function does
    with closing(solve_all(by_id, _plain, store, processes, silence_exudyn, again=_failed)) as solved:
        records: dict[str, Record] = {}
        for key, record, known in solved:
            records[key] = record
            progress(record, known)
    return {task.id: records[task.id] for task in tasks}


def _plain(task: Task) -> Record:
    """The record of a case or study as JSON has it."""
    record: Record = plain(solve(task))
    return record


def _failed(record: Record) -> bool:
    return bool(record.get("error"))
