"""Files of a sweep: the table of cases, `summary.json`, and the head of the journal."""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tdcr_fe.io.atomic import to_json, write_folder, write_json
from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.io.summary import versions
from tdcr_fe.sweeps.cases import Evaluate
from tdcr_fe.sweeps.description import Sweep, Variation
from tdcr_fe.sweeps.result import SweepResult
from tdcr_fe.sweeps.sampling import Design
from tdcr_fe.sweeps.statistics import Summary

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


def digest_of_design(design: Design) -> str:
    """SHA-256 of all values, in hexadecimal: the same for the same cases."""
    found = hashlib.sha256()
    for column in design.columns:
        found.update(repr(column.options).encode())
        found.update(column.numbers.tobytes())
    return found.hexdigest()


def head_of(sweep: Sweep, design: str, evaluate: Evaluate | None) -> dict[str, Any]:
    """First line of the journal: all that the outcomes depend on."""
    tables = [sweep.tables, *(tables for _, tables in sweep.robots)]
    contents = to_json([[t.scenario, t.robot] for t in tables])
    return {
        "input": {name: sha256 for name, sha256 in sweep.digests if name in sweep.effects},
        "tables": hashlib.sha256(contents.encode()).hexdigest(),
        "variations": [described(v) for v in sweep.variations],
        "design": design,
        "output": {"steps": sweep.output.steps, "quantities": sweep.output.quantities},
        "evaluate": ""
        if evaluate is None
        else f"{evaluate.__module__}.{getattr(evaluate, '__qualname__', '')}",
        "versions": versions(),
    }


def described(variation: Variation) -> dict[str, Any]:
    """A variation for the summary."""
    found: dict[str, Any] = {
        "name": variation.name,
        "keys": [key.text for key in variation.keys],
        "mode": variation.mode,
    }
    if variation.distribution is None:
        return {**found, "values": list(variation.options)}
    numbers = {k: v for k, v in vars(variation.distribution).items() if v is not None}
    return {**found, "distribution": {type(variation.distribution).__name__.lower(): numbers}}


def _statistics(found: Summary) -> dict[str, Any]:
    low, middle, high = found.quantiles
    return {
        "count": found.count,
        "mean": found.mean,
        "std": found.std,
        "min": found.smallest,
        "max": found.largest,
        "quantile_2.5": low,
        "median": middle,
        "quantile_97.5": high,
    }


def summary_of(result: SweepResult, head: Mapping[str, Any]) -> dict[str, Any]:
    """Contents of `summary.json`."""
    sampling = result.sweep.sampling
    indices = {
        name: {
            i: {
                "first": s.first[k],
                "first_interval": s.first_interval[k],
                "total": s.total[k],
                "total_interval": s.total_interval[k],
            }
            for k, i in enumerate(result.inputs)
        }
        for name, s in result.sobol_indices().items()
    }
    return {
        "versions": head["versions"],
        "input": {name: {"sha256": sha256} for name, sha256 in result.sweep.digests},
        "sampling": {"method": sampling.method, "samples": sampling.samples, "seed": sampling.seed},
        "variations": head["variations"],
        "design": head["design"],
        "cases": len(result.cases),
        "status": dict(result.counts),
        "interrupted": result.interrupted,
        "failures": {
            status: [{"cases": m.count, "first_case": m.case, "reason": m.example} for m in found]
            for status, found in result.failures.items()
        },
        "warnings": [{"times": m.count, "first_case": m.case, "text": m.example} for m in result.warnings],
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
