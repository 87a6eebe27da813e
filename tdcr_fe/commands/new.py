"""The commands ``tdcr-fe new`` and ``schema``: commented input files to start from, and what files may say."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pandas as pd

from tdcr_fe.commands.common import Exit, say, typed
from tdcr_fe.io.files import InputError, Problem, check_output_folder, write_folder, write_text
from tdcr_fe.io.keys import json_schema
from tdcr_fe.io.readings import Reading, observations_table
from tdcr_fe.io.tables import loading_table
from tdcr_fe.io.toml import read_model_file, read_robot
from tdcr_fe.io.write_toml import template
from tdcr_fe.model.channels import channel
from tdcr_fe.model.loading import LoadStep
from tdcr_fe.model.observed_step import Observation, ObservedStep
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.sweeps.read import sweep_schema

#: Files of a scenario, and of an experiment: templates, and tables that are simulated.
SCENARIO = ("robot.toml", "scenario.toml")
EXPERIMENT, TABLES = ("robot.toml", "model.toml", "NOTES.md"), ("loading.csv", "observations.csv")


def new(args: argparse.Namespace) -> int:
    """Write the files, and print what to do with them."""
    out = check_output_folder(args.out or f"tdcr-fe-{args.kind}")
    tendons, results = [f"t{k + 1}" for k in range(args.tendons)], out / "results"
    names, next_step = {
        "robot": (SCENARIO, typed("run", out / "scenario.toml", "-o", results)),
        "experiment": (
            EXPERIMENT,
            typed("identify", out, "-o", f"{out}-report") + f"   (see {out / 'NOTES.md'})",
        ),
        "sweep": ((*SCENARIO, "sweep.toml"), typed("sweep", out / "sweep.toml", "-o", results)),
    }[args.kind]
    tables = TABLES if args.kind == "experiment" else ()
    if there := [str(out / name) for name in (*names, *tables) if (out / name).exists()]:
        text = "is there already; give another directory"
        raise InputError([Problem("-o", "", path, text) for path in there])

    def write(folder: Path) -> None:
        for name in names:
            write_text(template(name, tendons), folder / name)
        if tables:
            for name, table in zip(tables, _simulated(folder), strict=True):
                write_text(table.to_csv(index=False, lineterminator="\n"), folder / name)

    written = write_folder(out, write)
    say(args, f"Written to {out}: {', '.join(p.name for p in written)}\nNext: {next_step}")
    return Exit.DONE


def schema(args: argparse.Namespace) -> int:
    """Print the JSON schema of an input file."""
    found = sweep_schema() if args.file == "sweep" else json_schema(args.file)
    print(json.dumps(found, indent=2, ensure_ascii=False))
    return Exit.DONE


def _simulated(folder: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Loading sequence and readings of a simulation, in which each tendon is pulled and released.

    Readings are positions at half the length and at the tip, and tendon displacements, with random errors and rounded.
    """
    robot = read_robot(folder / "robot.toml")
    model, settings = read_model_file(folder / "model.toml")
    none = dict.fromkeys(robot.tendon_names, 0.0)
    pulls = (("pull", 0.5), ("pull", 1.0), ("release", 0.5), ("release", 0.0))
    steps = [LoadStep(tensions={**none, name: x}) for name in none for _, x in pulls]
    branches = [f"{name} {branch}" for name in none for branch, _ in pulls]
    result = simulate(robot, model, steps, settings).raise_if_failed()
    length, random = robot.backbone.length, np.random.default_rng(1)
    read: list[tuple[str, float | str, float]] = []
    read += [(f"position_{axis}", s, 0.5e-3) for s in (0.5 * length, length) for axis in "xyz"]
    read += [("tendon_displacement", name, 0.1e-3) for name in none]
    readings = []
    for step in result.steps:
        seen = ObservedStep.of(step, robot.tendon_names, Observation())
        for quantity, location, sigma in read:
            value = channel(quantity).predict(seen, [location])[0] + random.normal(0.0, sigma)
            readings.append(Reading(step.step, quantity, location, round(float(value), 5), sigma))
    return loading_table(robot, range(1, len(steps) + 1), steps, branches), observations_table(readings)
