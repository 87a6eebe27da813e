"""Result files of a followed path: the loading sequence as a scenario, the table of targets, and those of `run`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from tdcr_fe.io.atomic import write_folder, write_json
from tdcr_fe.io.loading_table import loading_table, without_columns
from tdcr_fe.io.summary import summary
from tdcr_fe.io.tables import write_results
from tdcr_fe.io.write_toml import robot_to_toml, scenario_to_toml
from tdcr_fe.model.loading import SolverSettings, resolve
from tdcr_fe.model.targets import FollowResult

#: Folder with the loading sequence, and the table of targets.
SCENARIO, TARGETS = "scenario", "targets.csv"


def write_follow(
    result: FollowResult,
    out: str | os.PathLike[str],
    settings: SolverSettings | None = None,
    digests: Mapping[str, str] | None = None,
    targets_asked: int | None = None,
    options: Mapping[str, object] | None = None,
    pictures: bool = True,
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
    targets_asked
        Number of targets; None means that there is a result for each.
    options
        Bounds and choices, for the summary.
    pictures
        Whether to draw.

    Returns
    -------
    list of pathlib.Path
        Every file written.
    """
    out, sequence = Path(out), result.simulation

    def write_scenario(folder: Path) -> None:
        scenario = scenario_to_toml(sequence.model, result.steps, settings=settings)
        (folder / "robot.toml").write_text(robot_to_toml(result.robot), encoding="utf-8")
        (folder / "scenario.toml").write_text(scenario, encoding="utf-8")
        numbers = range(1, len(result.steps) + 1)
        if not without_columns(result.robot, resolve(result.robot, result.steps)):
            table = loading_table(result.robot, list(numbers), result.steps, [""] * len(result.steps))
            table.to_csv(folder / "loading.csv", index=False)

    asked = len(result.targets) if targets_asked is None else targets_asked
    steps_asked = len(result.steps) - len(result.targets) + asked
    targets = {
        "asked": asked,
        "reached": sum(x.reached for x in result.targets),
        "out_of_reach": result.out_of_reach,
        "not_converged": result.not_converged,
        "largest_error": float(result.errors.max()) if result.targets else None,
        "load_steps_tried": sum(x.trials for x in result.targets),
        **(options or {}),
    }

    def write_targets(folder: Path) -> None:
        result.to_frame().to_csv(folder / TARGETS, index=False)
        write_json({**summary(sequence, digests, steps_asked), "targets": targets}, folder / "summary.json")

    # A scenario needs a step; without one there is nothing to solve again.
    written = write_folder(out / SCENARIO, write_scenario) if result.steps else []
    written += write_results(sequence, out, digests, steps_asked, pictures and bool(sequence.steps))
    return list(dict.fromkeys([*written, *write_folder(out, write_targets)]))
