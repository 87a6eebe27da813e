"""The command ``tdcr-fe demo``: solves a packaged scenario and leaves its input beside the results."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from tdcr_fe.commands.run import add_options, solve_and_write


def add_demo_parser(commands: Any) -> None:
    """Add ``tdcr-fe demo``."""
    parser = commands.add_parser(
        "demo",
        help="solve the paper's single-segment robot, input included",
        description="Pull the paper's single-segment robot to 2.5 N in five steps, load its tip, release it; "
        "write the input, tables, a summary and pictures.",
    )
    parser.add_argument(
        "-o", "--out", metavar="OUT", default="tdcr-fe-demo", help="directory for the results [%(default)s]"
    )
    add_options(parser)
    parser.set_defaults(handler=demo)


def demo(args: argparse.Namespace) -> int:
    """Solve the packaged scenario; leave its input beside the results."""
    from importlib.resources import as_file, files
    from shutil import copyfile

    from tdcr_fe.io.atomic import check_output_folder, write_folder
    from tdcr_fe.io.toml import read_scenario

    out = check_output_folder(args.out)
    with as_file(files("tdcr_fe") / "data" / "demo") as folder:
        names = ("robot.toml", "scenario.toml")

        def write(place: Path) -> None:
            for name in names:
                copyfile(folder / name, place / name)

        write_folder(out, write)
    if not args.quiet:
        print(
            f"The input is {out / 'scenario.toml'} with {out / 'robot.toml'}; change it and solve it anew by"
        )
        print(f"    tdcr-fe run {out / 'scenario.toml'} -o {out}\n")
    return solve_and_write(read_scenario(out / "scenario.toml"), out, args)
