"""Result files of a simulation: `steps.csv`, `shape.csv`, `tensions.csv`, `summary.json`, sensitivities, pictures.

Their columns are in `tdcr_fe.model.dataframes`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from tdcr_fe.io.atomic import write_folder, write_json, write_text
from tdcr_fe.io.summary import summary
from tdcr_fe.model.arguments import check_instance
from tdcr_fe.model.results import SequenceResult

#: Every table and summary that `write_results` writes.
RESULT_FILES = ("steps.csv", "shape.csv", "tensions.csv", "summary.json")
#: Table of derivatives, written where they were asked for.
SENSITIVITIES = "sensitivities.csv"
#: Every picture that it may write.
PICTURE_FILES = ("shapes.png", "tensions.png", "hysteresis.png")
#: Page with the robot in 3D, written with the pictures.
VIEW_PAGE = "view.html"


def write_results(
    result: SequenceResult,
    out: str | os.PathLike[str],
    digests: Mapping[str, str] | None = None,
    steps_asked: int | None = None,
    pictures: bool = True,
) -> list[Path]:
    """Write tables, summary, pictures and the 3D page of a simulation.

    Parameters
    ----------
    result
        The result; of a sequence that did not converge the solved steps are written.
    out
        Directory; created if it does not exist. Result files of an earlier run are replaced.
    digests
        SHA-256 of the input files, by name.
    steps_asked
        Length of the loading sequence.
    pictures
        Whether to draw pictures and the 3D page.

    Returns
    -------
    list of pathlib.Path
        Every file written.

    Raises
    ------
    InputError
        ``out`` cannot be a directory.
    OSError
        A file cannot be written.
    """
    hint = "simulate(robot, model, steps) makes one."
    check_instance("write_results", "result", result, SequenceResult, "a SequenceResult", hint)

    def write_tables(folder: Path) -> None:
        result.to_frame().to_csv(folder / "steps.csv", index=False)
        result.shape_frame().to_csv(folder / "shape.csv", index=False)
        result.tensions_frame().to_csv(folder / "tensions.csv", index=False)
        if result.sensitivities:
            result.sensitivities_frame().to_csv(folder / SENSITIVITIES, index=False)
        write_json(summary(result, digests, steps_asked), folder / "summary.json")

    def draw(folder: Path) -> None:
        from tdcr_fe.report.motion import motion_of
        from tdcr_fe.report.plots import save_pictures
        from tdcr_fe.report.viewer import view_page

        save_pictures(result, folder)
        if result.steps:
            write_text(view_page(motion_of(result)), folder / VIEW_PAGE)

    written = write_folder(out, write_tables, ours=(*RESULT_FILES, SENSITIVITIES, *PICTURE_FILES, VIEW_PAGE))
    return (
        written + write_folder(out, draw) if pictures else written
    )  # an interruption while drawing leaves the tables
