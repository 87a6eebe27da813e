"""Result files of a simulation and of a followed path: tables, `summary.json`, pictures and the 3D page.

The columns of the tables are in `tdcr_fe.model.columns`.
"""

from __future__ import annotations

import html
import importlib.metadata
import platform
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tdcr_fe import __version__
from tdcr_fe.compiled import numba_version
from tdcr_fe.io.files import StrPath, write_folder, write_json, write_text
from tdcr_fe.io.write_toml import robot_to_toml, scenario_to_toml
from tdcr_fe.model.loading import SolverSettings
from tdcr_fe.model.plausibility import understood
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.model.targets import FollowResult
from tdcr_fe.report.motion import geometry, motion_of
from tdcr_fe.report.viewer import view_page


def versions() -> dict[str, str]:
    """Versions of this package and of the libraries that its results depend on."""
    return {
        "tdcr_fe": __version__,
        **{name: importlib.metadata.version(name) for name in ("exudyn", "numpy", "scipy")},
        "numba": numba_version(),
        "python": platform.python_version(),
    }


def _responses(step: StepResult) -> dict[str, Any]:
    """Responses of the tip to small changes, matrices as lists of rows; without what there is not."""
    matrices = ("compliance", "by_tension", "by_displacement", "motor_stiffness")
    found = [
        {"holes": "reversal" if r.reversal else "as they are", "s": r.s}
        | {name: getattr(r, name).tolist() for name in matrices}
        for r in step.responses
    ]
    return {"tip_response": found} if found else {}


def _inputs(result: SequenceResult, step: StepResult) -> dict[str, Any]:
    """Loads that act at the end of a step, and tendons driven by displacement; without what there is not."""
    state = step.actuation
    if state is None:
        return {}
    loads = {name: asdict(x) for name, x in state.loads.items() if any(x.force) or any(x.moment)}
    driven = [n for n, driven in zip(result.robot.tendon_names, state.by_displacement, strict=True) if driven]
    return {**({"loads": loads} if loads else {}), **({"displacement_controlled": driven} if driven else {})}


def summary(
    result: SequenceResult, digests: Mapping[str, str] | None = None, steps_asked: int | None = None
) -> dict[str, Any]:
    """The contents of `summary.json`.

    Parameters
    ----------
    result
        What was solved.
    digests
        SHA-256 of the input files, by name.
    steps_asked
        Number of steps in the loading sequence; None means that all of it was solved.
    """
    model = result.model
    fields = ("step", "label", "converged", "iterations", "substeps", "residual")
    estimates = ("discretisation_error", "buckling_load_fraction")
    steps = [
        {**{name: getattr(s, name) for name in (*fields, *estimates)}, **_inputs(result, s), **_responses(s)}
        for s in result.steps
    ]
    return {
        "versions": versions(),
        "input": {name: {"sha256": sha256} for name, sha256 in (digests or {}).items()},
        "robot": {"name": result.robot.name, "tendons": list(result.robot.tendon_names)},
        "model": asdict(model),
        "geometry": geometry(result),
        "mesh": {"elements_per_bay": list(result.elements_per_bay)},
        "settings": dict(result.settings),
        "wall_time": result.wall_time,
        "converged": result.converged,
        "steps_asked": len(result.steps) if steps_asked is None else steps_asked,
        "steps_solved": sum(s.converged for s in result.steps),
        "failed_step": result.failed_step,
        "message": result.message,
        "understood": understood(result.robot, model),
        "warnings": list(result.warnings),
        "remarks": list(result.remarks),
        "steps": steps,
    }


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
    out: StrPath,
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

    def write_tables(folder: Path) -> None:
        result.to_frame().to_csv(folder / "steps.csv", index=False)
        result.shape_frame().to_csv(folder / "shape.csv", index=False)
        result.tensions_frame().to_csv(folder / "tensions.csv", index=False)
        if result.sensitivities:
            result.sensitivities_frame().to_csv(folder / SENSITIVITIES, index=False)
        write_json(summary(result, digests, steps_asked), folder / "summary.json")

    def draw(folder: Path) -> None:
        from tdcr_fe.report.plots import save_pictures

        save_pictures(result, folder)
        if result.steps:
            write_text(view_page(motion_of(result)), folder / VIEW_PAGE)

    written = write_folder(out, write_tables, ours=(*RESULT_FILES, SENSITIVITIES, *PICTURE_FILES, VIEW_PAGE))
    if pictures:  # an interruption while drawing leaves the tables
        written += write_folder(out, draw)
    return written


class View:
    """The robot in 3D, which a notebook shows where it is the last value of a cell."""

    def __init__(self, page: str) -> None:
        self.page = page  # HTML

    def _repr_html_(self) -> str:
        frame = 'width="100%" height="900" style="border: 0"'
        return f'<iframe srcdoc="{html.escape(self.page)}" {frame}></iframe>'


def view(result: SequenceResult | FollowResult) -> View:
    """The 3D page of a result for a notebook: the page ``view.html`` of `write_results`.

    Parameters
    ----------
    result
        With at least one solved step.
    """
    sequence = result.simulation if isinstance(result, FollowResult) else result
    return View(view_page(motion_of(sequence)))


#: Folder with the loading sequence, and the table of targets.
SCENARIO, TARGETS = "scenario", "targets.csv"


def write_follow(
    result: FollowResult,
    out: Path,
    settings: SolverSettings,
    digests: Mapping[str, str],
    asked: int,
    options: Mapping[str, object],
    pictures: bool,
) -> list[Path]:
    """Write a followed path; `tdcr-fe run` solves ``scenario/scenario.toml`` again.

    Parameters
    ----------
    result
        The path.
    out
        Directory; created if it does not exist.
    settings
        Numerics that it was solved with.
    digests
        SHA-256 of the input files, by name.
    asked
        Number of targets; there is a result of each that was tried.
    options
        Bounds and choices, for the summary.
    pictures
        Whether to draw.

    Returns
    -------
    list of pathlib.Path
        Every file written.
    """
    sequence = result.simulation

    def write_scenario(folder: Path) -> None:
        scenario = scenario_to_toml(sequence.model, result.steps, settings=settings)
        (folder / "robot.toml").write_text(robot_to_toml(result.robot), encoding="utf-8")
        (folder / "scenario.toml").write_text(scenario, encoding="utf-8")

    steps_asked = len(result.steps) - len(result.targets) + asked
    targets = {
        "asked": asked,
        "reached": sum(x.reached for x in result.targets),
        "out_of_reach": result.out_of_reach,
        "not_converged": result.not_converged,
        "largest_error": float(result.errors.max()) if result.targets else None,
        "load_steps_tried": sum(x.trials for x in result.targets),
        **options,
    }

    def write_targets(folder: Path) -> None:
        result.to_frame().to_csv(folder / TARGETS, index=False)
        write_json({**summary(sequence, digests, steps_asked), "targets": targets}, folder / "summary.json")

    # A scenario needs a step; without one there is nothing to solve again.
    written = write_folder(out / SCENARIO, write_scenario) if result.steps else []
    written += write_results(sequence, out, digests, steps_asked, pictures and bool(sequence.steps))
    return list(dict.fromkeys([*written, *write_folder(out, write_targets)]))
