"""Tables of a result that ``tdcr-fe run`` prints, in mm and degrees."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tdcr_fe.model.messages import count
from tdcr_fe.model.results import SequenceResult

#: Columns of a terminal; wider tables are printed in blocks.
WIDTH = 110
#: Longest label that is printed in full [characters].
LONGEST_LABEL = 24


def print_result(result: SequenceResult, out: Path, written: Sequence[Path]) -> None:
    """Print the tables of a result and the names of the files."""
    if result.steps:
        print(step_table(result), end="\n\n")
        if result.sensitivities:
            print(derivative_table(result), end="\n\n")
    print(f"{count(len(result.steps), 'step')} in {result.wall_time:.2f} s. Written to {out}:")
    print("    " + ", ".join(p.name for p in written))


def step_table(result: SequenceResult) -> str:
    """One row per load step, with tensions and displacements of the tendons, tip, angle and substeps."""
    frame, names = result.to_frame().set_index("step"), result.robot.tendon_names
    labels = [s.label if len(s.label) <= LONGEST_LABEL else f"{s.label[:21]}..." for s in result.steps]
    width = max(map(len, ["label", *labels]))
    columns: dict[str, Any] = {"label".ljust(width): [text.ljust(width) for text in labels]}
    columns |= {f"{n} [N]": frame[f"tension_{n}"].map("{:.4g}".format) for n in names}
    columns |= {f"{n} [mm]": _fixed(1e3 * frame[f"displacement_{n}"], 3) for n in names}
    tip = {"tip x": "x", "y": "y", "z [mm]": "z"}
    columns |= {title: _fixed(1e3 * frame[f"tip_{axis}"], 2) for title, axis in tip.items()}
    columns["bending [deg]"] = _fixed(frame["bending_angle_deg"], 3)
    columns["substeps"] = [f"{s.substeps}" + " (failed)" * (not s.converged) for s in result.steps]
    return _text(pd.DataFrame(columns, frame.index).rename_axis(index=None, columns="step"))


def derivative_table(result: SequenceResult) -> str:
    """Derivatives of the tip after the last step."""
    rows = {n: [*p.positions[-1, -1], *p.rotations[-1, -1]] for n, p in result.sensitivities.items()}
    head = ["tip x", "y", "z [m]", "rotation x", "y", "z [rad]"]
    return "last step, derivative by\n" + _text(pd.DataFrame(rows, head).T)


def _fixed(values: pd.Series, digits: int) -> pd.Series:
    """Numbers with so many digits, without a negative zero."""
    return (values.round(9) + np.float64(0.0)).map(f"{{:.{digits}f}}".format)


def _text(table: pd.DataFrame) -> str:
    return table.to_string(float_format="{:.4g}".format, line_width=WIDTH)
