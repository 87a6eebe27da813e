"""Result files of a simulation: `steps.csv`, `shape.csv`, `tensions.csv`, `summary.json`.

Files are written into a directory of their own and moved into place together, so that nothing half-written
remains where something goes wrong.
"""

from __future__ import annotations

import importlib.metadata
import json
import math
import os
import platform
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tdcr_fe import __version__
from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.model.results import SequenceResult

Array = NDArray[np.float64]

#: Every table and summary that `write_results` leaves behind.
RESULT_FILES = ("steps.csv", "shape.csv", "tensions.csv", "summary.json")
#: Every picture that may come with them.
PICTURE_FILES = ("shapes.png", "tensions.png", "hysteresis.png")


def versions() -> dict[str, str]:
    """Versions of this package and of what computes its results."""
    found = {"tdcr_fe": __version__}
    for name in ("exudyn", "numpy", "scipy"):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "not installed"
    return {**found, "python": platform.python_version()}


def summary(
    result: SequenceResult, digests: Mapping[str, str] | None = None, steps_asked: int | None = None
) -> dict[str, Any]:
    """What `summary.json` holds.

    Parameters
    ----------
    result
        What was solved.
    digests
        SHA-256 of the input files, by name.
    steps_asked
        Length of the loading sequence; None takes it that all of it was solved.
    """
    model = result.model
    return {
        "versions": versions(),
        "input": {name: {"sha256": sha256} for name, sha256 in (digests or {}).items()},
        "robot": {"name": result.robot.name, "tendons": list(result.robot.tendon_names)},
        "model": {
            "tendon_path": model.tendon_path,
            "friction": model.friction,
            "elements_per_bay": model.elements_per_bay,
            "gravity": list(model.gravity),
        },
        "mesh": {"elements_per_bay": list(result.elements_per_bay)},
        "settings": dict(result.settings),
        "wall_time": result.wall_time,
        "converged": result.converged,
        "steps_asked": len(result.steps) if steps_asked is None else steps_asked,
        "steps_solved": sum(s.converged for s in result.steps),
        "failed_step": result.failed_step,
        "message": result.message,
        "warnings": list(result.warnings),
        "steps": [
            {
                "step": s.step,
                "label": s.label,
                "converged": s.converged,
                "iterations": s.iterations,
                "substeps": s.substeps,
                "residual": s.residual,
                "discretisation_error": s.discretisation_error,
                "buckling_load_fraction": s.buckling_load_fraction,
            }
            for s in result.steps
        ],
    }


def plain(value: Any) -> Any:
    """A value as JSON can hold it: arrays as lists, numbers that are not finite as null."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, Sequence | set | frozenset) and not isinstance(value, str | bytes):
        return [plain(v) for v in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def write_json(value: Any, path: Path) -> None:
    """Write a value as JSON that any reader takes (no NaN)."""
    text = json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    path.write_bytes(text.encode("utf-8", errors="backslashreplace"))  # names of files may hold any byte


def check_place(out: str | os.PathLike[str]) -> Path:
    """The directory that results are to go to, refused where it cannot be one.

    Raises
    ------
    InputError
        It, or something above it, is a file, or may not be written to.
    """
    out = Path(out)
    try:
        if out.exists() and not out.is_dir():
            raise InputError(
                [Problem("-o", "", str(out), "is a file; must be a directory, or not be there yet")]
            )
        above = out.absolute()
        while not above.exists():
            above = above.parent
        if not above.is_dir():
            raise InputError([Problem("-o", "", str(out), f"{above} is a file; must be a directory")])
        if not os.access(above, os.W_OK | os.X_OK):
            raise InputError([Problem("-o", "", str(out), f"no permission to write in {above}")])
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError([Problem("-o", "", str(out), f"cannot be a directory: {reason}")]) from error
    return out


def write_together(
    out: str | os.PathLike[str], write: Callable[[Path], None], ours: Iterable[str] = ()
) -> list[Path]:
    """Let ``write`` fill an empty directory, then move the files from there into ``out``.

    Parameters
    ----------
    out
        Made where it does not exist; other files in it stay.
    write
        Called with the empty directory. If it raises, ``out`` stays as it was.
    ours
        Names of files that an earlier run may have left; removed from ``out`` if not written anew.

    Returns
    -------
    list of pathlib.Path
        The files, in ``out``.
    """
    out = check_place(out)
    existed = out.is_dir()
    out.parent.mkdir(parents=True, exist_ok=True)
    staging = (out if existed else out.parent) / f".{out.name or 'out'}-{os.getpid()}.partial"
    shutil.rmtree(staging, ignore_errors=True)
    staging.mkdir()
    try:
        write(staging)
        names = sorted(p.name for p in staging.iterdir())
        if not existed and not out.exists():
            staging.rename(out)
        else:
            for name in names:
                (staging / name).replace(out / name)
            for name in set(ours) - set(names):
                (out / name).unlink(missing_ok=True)
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    return [out / name for name in names]


def write_results(
    result: SequenceResult,
    out: str | os.PathLike[str],
    digests: Mapping[str, str] | None = None,
    steps_asked: int | None = None,
    pictures: bool = True,
) -> list[Path]:
    """Write tables, summary and pictures of a simulation.

    Parameters
    ----------
    result
        What was solved; a sequence that did not converge is written as far as it came.
    out
        Directory; made where it does not exist. Files of ours that are there are replaced.
    digests
        SHA-256 of the input files, by name.
    steps_asked
        Length of the loading sequence.
    pictures
        Whether to draw.

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

    def write_tables(folder: Path) -> None:
        result.to_frame().to_csv(folder / "steps.csv", index=False)
        result.shape_frame().to_csv(folder / "shape.csv", index=False)
        result.tensions_frame().to_csv(folder / "tensions.csv", index=False)
        write_json(summary(result, digests, steps_asked), folder / "summary.json")

    def draw(folder: Path) -> None:
        from tdcr_fe.report.plots import save_pictures

        save_pictures(result, folder)

    written = write_together(out, write_tables, ours=(*RESULT_FILES, *PICTURE_FILES))
    return written + write_together(out, draw) if pictures else written  # who loses patience has the tables
