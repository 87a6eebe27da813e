"""The commands ``tdcr-fe new`` and ``schema``: commented input files to start from, and what files may say."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_fe.commands.common import Exit
from tdcr_fe.io.atomic import check_output_folder, write_folder, write_text
from tdcr_fe.io.keys import json_schema
from tdcr_fe.io.loading_table import loading_table
from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.io.readings import Reading, observations_table
from tdcr_fe.io.templates import template
from tdcr_fe.io.toml import read_model_file, read_robot
from tdcr_fe.model.loading import LoadStep
from tdcr_fe.model.robot import Robot
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.sweeps.read import sweep_schema


def new(args: argparse.Namespace) -> int:
    """Write the files, and print what to do with them."""
    out = check_output_folder(args.out or f"tdcr-fe-{args.kind}")
    names = [f"t{k + 1}" for k in range(args.tendons)]
    kinds = ["robot.toml", "scenario.toml"]
    next_step = f"tdcr-fe run {out / 'scenario.toml'} -o {out / 'results'}"
    if args.kind == "experiment":
        kinds = ["robot.toml", "model.toml", "NOTES.md"]
        next_step = f"tdcr-fe identify {out} -o {out}-report   (see {out / 'NOTES.md'})"
    elif args.kind == "sweep":
        kinds.append("sweep.toml")
        next_step = f"tdcr-fe sweep {out / 'sweep.toml'} -o {out / 'results'}"
    files = {name: template(name, names) for name in kinds}
    _refuse_existing(
        out, [*files, *(["loading.csv", "observations.csv"] if args.kind == "experiment" else [])]
    )

    def write(folder: Path) -> None:
        for name, text in files.items():
            write_text(text, folder / name)
        if args.kind == "experiment":
            for name, text in _simulated_tables(folder).items():
                write_text(text, folder / name)

    written = write_folder(out, write)
    if not args.quiet:
        print(f"Written to {out}: {', '.join(p.name for p in written)}\nNext: {next_step}")
    return Exit.DONE


def schema(args: argparse.Namespace) -> int:
    """Print the JSON schema of an input file."""
    found = sweep_schema() if args.file == "sweep" else json_schema(args.file)
    print(json.dumps(found, indent=2, ensure_ascii=False))
    return Exit.DONE


def _refuse_existing(out: Path, names: list[str]) -> None:
    """Refuse to write over files.

    Raises
    ------
    InputError
        One of the files is there already.
    """
    there = [name for name in names if (out / name).exists()]
    if there:
        raise InputError(
            [Problem("-o", "", str(out / name), "is there already; give another directory") for name in there]
        )


def _simulated_tables(folder: Path) -> Mapping[str, str]:
    """`loading.csv` and `observations.csv` of a simulation: each tendon is pulled and released."""
    robot = read_robot(folder / "robot.toml")
    model, settings = read_model_file(folder / "model.toml")
    none = dict.fromkeys(robot.tendon_names, 0.0)
    pulls = (("pull", 0.5), ("pull", 1.0), ("release", 0.5), ("release", 0.0))
    steps = [LoadStep(tensions={**none, name: x}) for name in none for _, x in pulls]
    branches = [f"{name} {branch}" for name in none for branch, _ in pulls]
    result = simulate(robot, model, steps, settings).raise_if_failed()
    tables = {
        "loading.csv": loading_table(robot, range(1, len(steps) + 1), steps, branches),
        "observations.csv": observations_table(_readings(robot, result)),
    }
    return {name: table.to_csv(index=False, lineterminator="\n") for name, table in tables.items()}


def _readings(robot: Robot, result: Any) -> list[Any]:
    """Markers at half the length and at the tip, and tendon displacements, with random errors and rounded."""
    rng = np.random.default_rng(1)
    marker, encoder = 0.5e-3, 0.1e-3  # standard uncertainties [m]

    def read(true: float, sigma: float) -> float:
        return round(float(true + rng.normal(0.0, sigma)), 5)

    readings = []
    for step in result.steps:
        for s in (0.5 * robot.backbone.length, robot.backbone.length):
            for axis, value in zip("xyz", step.position_at(s), strict=True):
                readings.append(Reading(step.step, f"position_{axis}", s, read(value, marker), marker))
        for name, value in zip(robot.tendon_names, step.displacements, strict=True):
            readings.append(Reading(step.step, "tendon_displacement", name, read(value, encoder), encoder))
    return readings
