"""Files of a sweep: the journal that it continues from, the table of cases, `summary.json`, and the report."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tdcr_fe.io.atomic import to_json, write_folder, write_json
from tdcr_fe.io.problems import refusal
from tdcr_fe.io.result_files import versions
from tdcr_fe.io.store import Lines, OtherHead
from tdcr_fe.sweeps.cases import Evaluate
from tdcr_fe.sweeps.description import Sweep
from tdcr_fe.sweeps.result import Message, SweepResult

JOURNAL = "cases.jsonl"
LOCK = ".cases.lock"
TABLE, SUMMARY, REPORT = "cases.csv", "summary.json", "report.html"
#: Every picture that a sweep may have.
PICTURE_FILES = ("workspace.png", "sobol_indices.png", "distributions.png", "main_effects.png")


def head_of(sweep: Sweep, evaluate: Evaluate | None) -> dict[str, Any]:
    """First line of the journal: all that the outcomes depend on."""
    tables = to_json([sweep.tables.scenario, sweep.tables.robot])
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
        write_json(summary_of(result, head), folder / SUMMARY)

    write_folder(out, write_tables, ours=(TABLE, SUMMARY, REPORT, *PICTURE_FILES))
    if report:
        from tdcr_fe.sweeps.report import write_report

        write_folder(out, lambda folder: write_report(result, folder))
