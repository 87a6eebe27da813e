"""Commands that help to begin: commented input files, schemas for editors, completion for shells."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tdcr_fe.commands.common import SUCCESS, add_options

if TYPE_CHECKING:
    from tdcr_fe.model.robot import Robot

#: Most tendons of a template.
MOST_TENDONS = 24


def add_new_parser(commands: Any) -> None:
    """Add ``tdcr-fe new``."""
    parser = commands.add_parser(
        "new",
        help="write commented input files to start from",
        description="Write input files with every key, its unit and its default as comments. robot: robot.toml and "
        "scenario.toml for `tdcr-fe run`; experiment: a folder of measured data for `tdcr-fe identify`, filled with "
        "numbers of a simulation; sweep: the files of robot and a sweep.toml for `tdcr-fe sweep`.",
    )
    option = parser.add_argument
    option("kind", choices=("robot", "experiment", "sweep"), help="what to begin")
    option("-o", "--out", metavar="OUT", required=True, help="directory for the files; none is overwritten")
    option("--tendons", type=_tendons, default=3, metavar="N", help="number of tendons [%(default)s]")
    add_options(parser)
    parser.set_defaults(handler=new)


def _tendons(text: str) -> int:
    """A number of tendons, as a type for `argparse`."""
    number = int(text) if text.isdecimal() else 0
    if not 1 <= number <= MOST_TENDONS:
        raise argparse.ArgumentTypeError(f"{text!r}; must be a whole number from 1 to {MOST_TENDONS}")
    return number


def new(args: argparse.Namespace) -> int:
    """Write the files, and print what to do with them."""
    from tdcr_fe.io.atomic import check_output_folder, write_folder, write_text
    from tdcr_fe.io.templates import template

    out = check_output_folder(args.out)
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
    return SUCCESS


def _refuse_existing(out: Path, names: list[str]) -> None:
    """Refuse to write over files.

    Raises
    ------
    InputError
        One of the files is there already.
    """
    from tdcr_fe.io.problems import InputError, Problem

    there = [name for name in names if (out / name).exists()]
    if there:
        raise InputError(
            [Problem("-o", "", str(out / name), "is there already; give another directory") for name in there]
        )


def _simulated_tables(folder: Path) -> Mapping[str, str]:
    """`loading.csv` and `observations.csv` of a simulation: each tendon is pulled and released."""
    from tdcr_fe.io.loading_table import loading_table
    from tdcr_fe.io.readings import observations_table
    from tdcr_fe.io.toml import read_model_file, read_robot
    from tdcr_fe.model.loading import LoadStep
    from tdcr_fe.solve.simulate import simulate

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
    import numpy as np

    from tdcr_fe.io.readings import Reading

    rng = np.random.default_rng(1)
    marker, encoder = 0.5e-3, 0.1e-3  # standard uncertainties [m]

    def read(true: float, sigma: float) -> float:
        return round(float(true + rng.normal(0.0, sigma)), 5)

    found = []
    for step in result.steps:
        for s in (0.5 * robot.backbone.length, robot.backbone.length):
            for axis, value in zip("xyz", step.position_at(s), strict=True):
                found.append(Reading(step.step, f"position_{axis}", s, read(value, marker), marker))
        for name, value in zip(robot.tendon_names, step.displacements, strict=True):
            found.append(Reading(step.step, "tendon_displacement", name, read(value, encoder), encoder))
    return found


def add_schema_parser(commands: Any) -> None:
    """Add ``tdcr-fe schema``."""
    parser = commands.add_parser(
        "schema",
        help="print the JSON schema of an input file, for editors",
        description="Print the JSON schema of one of the .toml files, with which editors check and complete it.",
    )
    parser.add_argument("file", choices=("robot", "scenario", "model", "sweep"), help="the file")
    parser.set_defaults(handler=schema)


def schema(args: argparse.Namespace) -> int:
    """Print the schema."""
    from tdcr_fe.io.keys import json_schema
    from tdcr_fe.sweeps.read import sweep_schema

    found = sweep_schema() if args.file == "sweep" else json_schema(args.file)
    print(json.dumps(found, indent=2, ensure_ascii=False))
    return SUCCESS


def add_completion_parser(commands: Any) -> None:
    """Add ``tdcr-fe completion``."""
    parser = commands.add_parser(
        "completion",
        help="print a script for the shell that completes commands and options",
        description="Print a script that completes commands, options, their values and file names. Put "
        'eval "$(tdcr-fe completion bash)" into ~/.bashrc, or the same with zsh into ~/.zshrc.',
    )
    parser.add_argument("shell", choices=("bash", "zsh"), help="the shell")
    parser.set_defaults(handler=completion)


def completion(args: argparse.Namespace) -> int:
    """Print the script that shtab makes of the parsers.

    Raises
    ------
    InputError
        shtab is not installed.
    """
    try:
        import shtab
    except ImportError as error:
        from tdcr_fe.io.problems import InputError, Problem

        text = "needs shtab, which is not installed: pip install 'tdcr-fe[completion]'"
        raise InputError([Problem("completion", "", args.shell, text)]) from error
    for parser in args.commands.values():
        for action in parser._actions:
            if action.choices is None and action.nargs != 0:
                action.complete = shtab.FILE
    print(shtab.complete(args.program, args.shell))
    return SUCCESS
