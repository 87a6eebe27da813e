"""Write the report, the documentation's page, and the data sets of the identification."""

from __future__ import annotations

from pathlib import Path

from tdcr_fe.io.atomic import write_json, write_text
from tdcr_fe.io.measured import write_measured
from tdcr_fe.report.environment import environment
from tdcr_fe.validation.paper.report.document import to_json
from tdcr_fe.validation.paper.report.figures import drawings
from tdcr_fe.validation.paper.report.page import PACKAGE, context, html
from tdcr_fe.validation.paper.run import PaperRun


def write_report(run: PaperRun, out: Path, wall_time: float) -> list[Path]:
    """Write ``report.html`` and ``report.json``.

    Parameters
    ----------
    run
        Results.
    out
        An existing directory.
    wall_time
        Of the run [s].
    """
    data = to_json(run, wall_time)
    html_file, numbers = out / "report.html", out / "report.json"
    write_json(data, numbers)
    write_text(html(run, data), html_file)
    return [html_file, numbers]


def write_datasets(run: PaperRun, folder: Path) -> list[Path]:
    """Write the data sets of the identification, one folder each, as far as files can express them."""
    written = []
    for name, study in run.missing.items():
        if study.table.in_files and study.result is not None:
            write_measured(study.result.data, folder / name)
            written.append(folder / name)
    return written


def write_docs(run: PaperRun, folder: Path, wall_time: float) -> list[Path]:
    """Write the documentation's page, ``paper.md``, and its pictures.

    Parameters
    ----------
    run
        Results.
    folder
        The ``docs`` folder.
    wall_time
        Of the run [s].
    """
    data = to_json(run, wall_time)
    pictures = folder / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    written = []
    for name, text in drawings(run).items():
        path = pictures / f"paper_{name}.svg"
        write_text(text, path)
        written.append(path)
    markdown = folder / "paper.md"
    write_text(environment(PACKAGE).get_template("paper.md.j2").render(**context(data)), markdown)
    return [markdown, *written]
