"""Solve cases and studies in parallel processes; finished records are kept, so that a run can be resumed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tdcr_fe.io.files import OtherHead, plain
from tdcr_fe.io.result_files import versions as package_versions
from tdcr_fe.validation.crosscheck.cases import Case
from tdcr_fe.validation.crosscheck.compare import TIP_TOLERANCE, compare
from tdcr_fe.validation.crosscheck.studies import Study
from tdcr_fe.validation.records import Progress, Record, Records
from tdcr_fe.validation.runner import source_digest

Task = Case | Study

#: Packages that the records depend on.
_PACKAGES = ("elements", "model", "scene", "solve", "validation.reference", "validation.crosscheck")


def versions() -> dict[str, str]:
    """Versions that the records depend on: packages, and a digest of the source."""
    return {**package_versions(), "source": source_digest(*_PACKAGES)}


def solve(task: Task) -> Record:
    """Solve one case or study; an error becomes part of the record instead of ending the run."""
    if isinstance(task, Study):
        record: Record = {"id": task.id, "kind": task.kind}
    else:
        record = {"id": task.id, "group": task.group, "routing": task.routing, "load": task.load}
        record |= {"tendon_path": task.model.tendon_path, "friction": task.model.friction}
        record |= {"disks": task.disks, "quick": task.quick, "tolerance_percent": TIP_TOLERANCE}
        record |= dict.fromkeys(("tip_finite_element", "tip_reference", "deviation_percent"))
        record["passed"] = False
    try:
        record |= task.run() if isinstance(task, Study) else compare(task)
        record["error"] = ""
    except Exception as error:
        record["error"] = f"{type(error).__name__}: {error}"
        record["reasons"] = [record["error"]]
    return plain(record)


def run(tasks: Sequence[Task], file: Path, processes: int, progress: Progress) -> dict[str, Record]:
    """Solve tasks, or load the records of those finished before.

    Parameters
    ----------
    tasks
        Cases and studies.
    file
        Where the records are kept; those of other code are discarded.
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
        Interrupted; finished records are kept.
    """
    store = Records(file, versions(), lambda record: bool(record["error"]))
    try:
        store.begin()
    except OtherHead:
        store.begin(fresh=True)
    return store.of_all({task.id: task for task in tasks}, solve, processes, progress)
