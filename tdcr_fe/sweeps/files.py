"""Files of a sweep: the journal that it continues from, the table of cases, `summary.json`, and the report."""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tdcr_fe.io.atomic import to_json, write_folder, write_json
from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.io.result_files import versions
from tdcr_fe.io.store import Lines, OtherHead
from tdcr_fe.sweeps.cases import Evaluate, Outcome
from tdcr_fe.sweeps.description import Sweep, Variation
from tdcr_fe.sweeps.result import Message, SweepResult
from tdcr_fe.sweeps.sampling import Design
from tdcr_fe.sweeps.statistics import Summary

JOURNAL = "cases.jsonl"
TABLES = {"csv": "cases.csv", "parquet": "cases.parquet"}
SUMMARY, REPORT = "summary.json", "report.html"
#: Every picture that a sweep may have.
PICTURE_FILES = ("workspace.png", "sobol_indices.png", "distributions.png", "main_effects.png")


def check_format(table: str) -> None:
    """Refuse a format of the table that cannot be written.

    Raises
    ------
    InputError
        There is no such format, or the package that it needs is not installed.
    """
    if table not in TABLES:
        raise InputError([Problem("--table", "", table, f"must be one of {', '.join(TABLES)}")])
    if table == "parquet" and importlib.util.find_spec("pyarrow") is None:
        text = "needs pyarrow, which is not installed: pip install 'tdcr-fe[parquet]'"
        raise InputError([Problem("--table", "", table, text)])


def head_of(sweep: Sweep, design: Design, evaluate: Evaluate | None) -> dict[str, Any]:
    """First line of the journal: all that the outcomes depend on."""
    values = hashlib.sha256()
    for column in design.columns:
        values.update(repr(column.options).encode())
        values.update(column.numbers.tobytes())
    tables = [sweep.tables, *(tables for _, tables in sweep.robots)]
    contents = to_json([[t.scenario, t.robot] for t in tables])
    function = evaluate and f"{evaluate.__module__}.{getattr(evaluate, '__qualname__', '')}"
    return {
        "input": {name: sha256 for name, sha256 in sweep.digests if name in sweep.effects},
        "tables": hashlib.sha256(contents.encode()).hexdigest(),
        "variations": [_described(v) for v in sweep.variations],
        "design": values.hexdigest(),
        "output": asdict(sweep.output),
        "evaluate": function or "",
        "versions": versions(),
    }


def _described(variation: Variation) -> dict[str, Any]:
    """A variation for the summary."""
    keys = [key.text for key in variation.keys]
    found: dict[str, Any] = {"name": variation.name, "keys": keys, "mode": variation.mode}
    if variation.distribution is None:
        return {**found, "values": list(variation.options)}
    return {**found, "distribution": dict([variation.distribution.described()])}


class Journal:
    """One line for every finished case, from which a sweep continues.

    Parameters
    ----------
    folder
        Of the files of the sweep.
    head
        First line: all that the outcomes depend on.
    """

    def __init__(self, folder: Path, head: Mapping[str, Any]) -> None:
        self._path = folder / JOURNAL
        self._lines = Lines(self._path, head)

    def recall(self, fresh: bool, count: int) -> Iterator[Outcome]:
        """Outcomes that are there; a new journal begins where there is none, or where it is asked for.

        The end of a line that a kill cut off is removed.

        Raises
        ------
        InputError
            The journal is that of another sweep, or none, or has more than ``count`` cases.
        """
        if fresh or not self._path.exists():
            self._lines.begin()
            return
        try:
            for outcome in self._lines.records(Outcome.from_record):
                if outcome.case > count:
                    raise InputError([Problem("-o", "", str(self._path), f"there is no case {outcome.case}")])
                yield outcome
        except OtherHead as error:
            what = "is no journal of a sweep"
            if error.there:
                what = f"is of another sweep: {', '.join(error.differing) or 'keys'} differ"
            text = f"{what}; give another directory, or --fresh to replace what is there"
            raise InputError([Problem("-o", "", str(self._path), text)]) from error

    def write(self, outcomes: Iterable[Outcome]) -> None:
        """Append outcomes, and hand them to the operating system."""
        self._lines.append(outcome.record() for outcome in outcomes)


def _statistics(found: Summary) -> dict[str, Any]:
    names = ("count", "mean", "std", "min", "max", "quantile_2.5", "median", "quantile_97.5")
    numbers = (found.count, found.mean, found.std, found.smallest, found.largest, *found.quantiles)
    return dict(zip(names, numbers, strict=True))


def _message(found: Message, count: str, text: str) -> dict[str, Any]:
    return {count: found.count, "first_case": found.case, text: found.example}


def summary_of(result: SweepResult, head: Mapping[str, Any]) -> dict[str, Any]:
    """Contents of `summary.json`."""
    names = ("first", "first_interval", "total", "total_interval")
    indices = {
        output: {i: {n: getattr(s, n)[k] for n in names} for k, i in enumerate(result.inputs)}
        for output, s in result.sobol_indices().items()
    }
    return {
        "versions": head["versions"],
        "input": {name: {"sha256": sha256} for name, sha256 in result.sweep.digests},
        "sampling": asdict(result.sweep.sampling),
        "variations": head["variations"],
        "design": head["design"],
        "cases": len(result.cases),
        "status": result.counts,
        "interrupted": result.interrupted,
        "failures": {
            status: [_message(m, "cases", "reason") for m in found]
            for status, found in result.failures.items()
        },
        "warnings": [_message(m, "times", "text") for m in result.warnings],
        "statistics": {name: _statistics(s) for name, s in result.statistics().items()},
        **({"sobol_indices": indices} if indices else {}),
        "wall_time": result.wall_time,
        "case_seconds": result.case_seconds,
        "solved_in_this_run": result.solved_now,
    }


def write_sweep(
    result: SweepResult, out: Path, head: Mapping[str, Any], table: str = "csv", report: bool = True
) -> list[Path]:
    """Write the table of cases, the summary, and the report with its pictures.

    Parameters
    ----------
    result
        What was solved.
    out
        Directory, which has the journal.
    head
        First line of the journal.
    table
        A key of `TABLES`.
    report
        Whether to write pictures and report.

    Returns
    -------
    list of pathlib.Path
        The files written.
    """

    def write_tables(folder: Path) -> None:
        if table == "parquet":
            result.cases.to_parquet(folder / TABLES[table], index=False)
        else:
            result.cases.to_csv(folder / TABLES[table], index=False)
        write_json(summary_of(result, head), folder / SUMMARY)

    def write_report(folder: Path) -> None:
        from tdcr_fe.sweeps.report import write_report

        write_report(result, folder)

    written = write_folder(out, write_tables, ours=(*TABLES.values(), SUMMARY, REPORT, *PICTURE_FILES))
    return written + write_folder(out, write_report) if report else written
