"""Files of an identification: result, report, the corrected robot with its tables, and the next experiment."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from tdcr_fe.identify.corrected import corrected_files
from tdcr_fe.identify.outcome import IdentificationResult
from tdcr_fe.identify.replay import corrected_motion
from tdcr_fe.identify.report import write_report
from tdcr_fe.identify.time_limit import TABLES, OutOfTime
from tdcr_fe.io.atomic import write_json, write_text


class Written(NamedTuple):
    """What was written.

    Attributes
    ----------
    result : IdentificationResult
        With the tables among what was not tried, if the time did not suffice for them.
    names : list of str
        Files and folders, relative to the output folder.
    interrupted : bool
        Whether the identification, or the simulation for the tables, was interrupted.
    """

    result: IdentificationResult
    names: list[str]
    interrupted: bool


def write_result(
    result: IdentificationResult, out: str | os.PathLike[str], deadline: float = math.inf
) -> Written:
    """Write all files of an identification into a folder.

    Parameters
    ----------
    result
        What was found.
    out
        The folder; it is made where there is none.
    deadline
        Reading of `tdcr_fe.identify.time_limit.clock` at which the simulation of the corrected robot ends; everything
        else is written [s].
    """
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    texts = corrected_files(result)
    next_loading = result.next_loading()
    if next_loading is not None:
        texts = {**texts, "next/loading.csv": next_loading}
    write_json(result.to_json(), folder / "result.json")
    for name, text in texts.items():
        (folder / name).parent.mkdir(exist_ok=True)
        write_text(text, folder / name)
    motion, interrupted = None, result.interrupted
    try:
        several = bool(result.data.parts)  # the panel shows one loading sequence
        if not (interrupted or several):
            motion = corrected_motion(result, folder, deadline)
    except KeyboardInterrupt:  # the report is written without the 3D panel
        interrupted = True
    except OutOfTime:
        result = replace(result, not_tried=(*result.not_tried, TABLES))
        write_json(result.to_json(), folder / "result.json")
    write_report(result, folder / "report.html", motion)
    names = ["result.json", "report.html", *texts, *([] if motion is None else ["corrected"])]
    return Written(result, names, interrupted)
