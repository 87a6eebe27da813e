"""Every command: what it does, its arguments, two examples of its use, and the function that carries it out."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tdcr_fe.commands.common import cores

#: Flags, or the name of a positional argument, and the options of `add_argument`.
Argument = tuple[list[str], dict[str, Any]]


@dataclass(frozen=True)
class Command:
    """A subcommand.

    Attributes
    ----------
    handler : str
        Function from the arguments to the exit status, as ``module:function`` of a module that is imported for it.
    help : str
        In the list of commands, and at the top of its own help.
    description : str
        What follows there.
    arguments : tuple of Argument
    examples : tuple of str
        What follows the program's name.
    status : str
        Meaning of the exit statuses, where it differs from that of `tdcr-fe --help`.
    """

    handler: str
    help: str
    description: str
    arguments: tuple[Argument, ...]
    examples: tuple[str, str]
    status: str = ""


def argument(names: str, text: str, **more: Any) -> Argument:
    """An argument: its flags and what stands for the value, as in "-o --out OUT", or its name; and its help."""
    words = names.split()
    if words[-1].isupper() or "." in words[-1]:
        more["metavar"] = words.pop()
    elif words[0].startswith("-") and not more.keys() & {"choices", "type"}:
        more["action"] = "store_true"
    return words, {"help": text, **more}


def whole(least: int, most: float = math.inf) -> Callable[[str], int]:
    """A whole number between bounds, as a type for `argparse`."""
    upper = f"from {least} to {most}" if math.isfinite(most) else f"at least {least}"

    def read(text: str) -> int:
        if not (text.isascii() and text.isdecimal() and least <= int(text) <= most):
            raise argparse.ArgumentTypeError(f"{text!r}; must be a whole number, {upper}")
        return int(text)

    return read


def minutes(text: str) -> float:
    """A positive number, as a type for `argparse`."""
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r}; must be a number of minutes above zero")
    return number


OUT = argument("-o --out OUT", "directory for the results", required=True)
EFFECTS = argument(
    "--effects FILE.py",
    "effects of your own, classes in a Python file; may be repeated",
    action="append",
    default=[],
)
PROCESSES = argument("--processes N", "processes to use [number of cores]", type=whole(1))
NO_PICTURES = argument("--no-pictures", "write tables and summary only, no pictures and no pages")
QUIET = argument("-q --quiet", "print nothing but errors and warnings")
JSON = argument(
    "--json",
    "print one JSON object with status, files written, main figures and errors, and nothing else on stdout",
)
SENSITIVITIES = argument(
    "--sensitivities PARAMETER",
    "differentiate the results by parameters such as backbone.youngs_modulus; writes sensitivities.csv",
    nargs="+",
    default=[],
)
COMPLIANCE = argument(
    "--compliance",
    "write compliance and tendon Jacobians of the tip, and the stiffness seen by the motors, to summary.json",
)

MINUTES = argument("--minutes", "time limit; what is solved until then is written [none]", type=minutes)

#: Every command, by name.
COMMANDS = {
    "run": Command(
        "tdcr_fe.commands.run:run",
        "solve a scenario; write tables and pictures",
        "",
        (
            argument("scenario", "path of a scenario.toml"),
            *(OUT, SENSITIVITIES, COMPLIANCE, MINUTES, NO_PICTURES, EFFECTS, JSON, QUIET),
        ),
        (
            "run scenario.toml -o results",
            "run scenario.toml -o results --sensitivities backbone.youngs_modulus tendons.t1.offset",
        ),
    ),
    "follow": Command(
        "tdcr_fe.commands.follow:follow",
        "find the tensions that take the tip along a path",
        "Tensions stay within bounds; a target that is out of reach is approached as far as possible.",
        (
            argument("robot", "path of a robot.toml"),
            argument("path", "path of a path.csv with the columns step,x,y,z[,dx,dy,dz], in m; empty: any"),
            OUT,
            argument(
                "--largest T",
                "largest tension in N: one number for all tendons, or NAME=T for each",
                nargs="+",
                required=True,
            ),
            argument(
                "--pretension T",
                "smallest tension in N, above zero to keep tendons from becoming slack: one number, or NAME=T [0]",
                nargs="+",
                default=["0"],
            ),
            argument("--model MODEL", "path of a model.toml with the tables [model] and [solver]"),
            argument("--displacements", "find prescribed displacements instead of tensions"),
            argument(
                "--effort",
                "what has the smallest sum of squares where several tensions come as near: the tensions, or their "
                "change from the target before [%(default)s]",
                choices=("tension", "change"),
                default="tension",
            ),
            argument(
                "--tolerance D",
                "error in m with which a target counts as reached [0.1 %% of the length]",
                type=float,
            ),
            *(NO_PICTURES, QUIET),
        ),
        (
            "follow robot.toml path.csv --largest 5 -o results",
            "follow robot.toml path.csv --largest t1=5 t2=4 t3=4 --pretension 0.1 -o results",
        ),
        "0 every target was reached or is out of reach; 1 a load step or a search did not converge; 2 the input is "
        "wrong; 130 interrupted (143 by SIGTERM), what was found is written.",
    ),
    "sweep": Command(
        "tdcr_fe.commands.sweep:run_sweep",
        "solve many cases: grids, samples of uncertain values, the workspace of a robot",
        "Writes one table with a row per case, statistics and a report. Finished cases are kept in OUT/cases.jsonl: "
        "the same command continues a sweep that was interrupted.",
        (
            argument("sweep", "path of a sweep.toml"),
            argument("-o --out OUT", "directory for the results"),
            argument("--check", "check the files, print the first cases, and solve nothing"),
            argument(
                "--dask ADDRESS",
                "address of the scheduler of a dask.distributed cluster that solves the cases",
            ),
            argument(
                "--table",
                "format of the table of cases [%(default)s]",
                choices=("csv", "parquet"),
                default="csv",
            ),
            argument("--fresh", "start over where OUT has a journal"),
            argument("--retry", "solve cases in the journal that did not converge again"),
            *(PROCESSES, EFFECTS, NO_PICTURES, QUIET),
        ),
        ("sweep sweep.toml --check", "sweep sweep.toml -o results --processes 4"),
        "0 all cases converged; 1 a case did not (the table says why); 2 the input is wrong; 130 interrupted (143 by "
        "SIGTERM), finished cases are written.",
    ),
    "view": Command(
        "tdcr_fe.commands.view:view",
        "draw results in 3D, as one HTML file",
        "A slider over the load steps and plots that follow it; no server and no network are needed.",
        (
            argument("result", "folder that tdcr-fe run, follow or identify wrote"),
            argument("-o --out FILE.html", "the page [RESULT/view.html]"),
            argument(
                "--video FILE",
                "also a video, FILE.gif or FILE.mp4 (the latter needs the program ffmpeg)",
            ),
            argument(
                "--vtk FOLDER", "also files for ParaView: FOLDER/robot.pvd and one .vtp for each load step"
            ),
            QUIET,
        ),
        ("view results", "view results -o robot.html --video robot.gif"),
    ),
    "demo": Command(
        "tdcr_fe.commands.run:demo",
        "solve the paper's single-segment robot, input included",
        "It is pulled to 2.5 N in five steps, loaded at its tip, and released.",
        (
            argument("-o --out OUT", "directory for the results [%(default)s]", default="tdcr-fe-demo"),
            *(SENSITIVITIES, COMPLIANCE, MINUTES, NO_PICTURES, QUIET),
        ),
        ("demo", "demo -o results --compliance"),
    ),
    "new": Command(
        "tdcr_fe.commands.new:new",
        "write commented input files to start from",
        "Every key is there with its unit and default. robot: robot.toml and scenario.toml for `tdcr-fe run`; "
        "experiment: a folder of measured data for `tdcr-fe identify`, filled with numbers of a simulation; sweep: the "
        "files of robot and a sweep.toml for `tdcr-fe sweep`.",
        (
            argument("kind", "what to begin", choices=("robot", "experiment", "sweep")),
            argument("-o --out OUT", "directory for the files, none of which is overwritten [tdcr-fe-KIND]"),
            argument("--tendons N", "number of tendons [%(default)s]", type=whole(1, 24), default=3),
            QUIET,
        ),
        ("new robot", "new experiment -o measured --tendons 4"),
    ),
    "identify": Command(
        "tdcr_fe.commands.identify:run",
        "find from measured data which effects a model is missing",
        "Effects that are found are added to the model; the report shows the error before and after.",
        (
            argument(
                "folder",
                "contains robot.toml, loading.csv, observations.csv and, optionally, model.toml; several folders of "
                "one robot share the effects",
                nargs="+",
            ),
            argument("-o --out OUT", "directory for result.json and report.html", required=True),
            argument(
                "--processes N",
                "worker processes, at most as many as there are cores [%(default)s]",
                type=whole(1),
                default=min(2, cores()),
            ),
            argument(
                "--hold-out PATTERN",
                "hold out the branches of loading.csv that match a shell pattern, such as 'pair*'; may be repeated "
                "[about a third of the branches, chosen automatically]",
                action="append",
                default=[],
            ),
            argument(
                "--minutes",
                "time limit of the whole identification; the report says what was left out [%(default)s]",
                type=minutes,
                default=15.0,
            ),
            argument("--strict", "refuse bad rows (exit status 2) instead of leaving them out by name"),
            *(EFFECTS, JSON, QUIET),
        ),
        ("identify measured -o report", "identify monday tuesday -o report --minutes 5"),
        "0 done, whatever the verdict; 1 the declared model did not converge; 2 the input is wrong; 130 interrupted "
        "(143 by SIGTERM), what was found is written.",
    ),
    "live": Command(
        "tdcr_fe.commands.live:live",
        "open a page on which a robot answers sliders and the mouse",
        "Every change is a load step with its history; the sequence can be saved as scenario.toml. The page is "
        "served on this computer only and ends with Ctrl-C or when it is closed.",
        (
            argument("robot", "path of a robot.toml"),
            argument("--model MODEL", "path of a model.toml with the tables [model] and [solver]"),
            argument("--port N", "port on this computer [a free one]", type=whole(0, 65535), default=0),
            argument("--no-browser", "print the address and open no browser"),
            QUIET,
        ),
        ("live robot.toml", "live robot.toml --port 8000 --no-browser"),
        "0 the page was closed; 2 the input is wrong; 130 interrupted.",
    ),
    "validate": Command(
        "tdcr_fe.commands.validate:validate",
        "finite elements against the independent shooting reference; write the report",
        "Finished cases are kept in OUT/cases.jsonl: the same command continues a run that was interrupted.",
        (
            argument("-o --out OUT", "directory for the report", required=True),
            argument("--full", "every case; without it a quick set"),
            *(PROCESSES, QUIET),
        ),
        ("validate -o validation", "validate -o validation --full --processes 4"),
        "0 all cases and requirements pass, 1 one fails, 2 the input is wrong, 130 interrupted.",
    ),
    "schema": Command(
        "tdcr_fe.commands.editors:schema",
        "print the JSON schema of an input file, for editors",
        "",
        (argument("file", "the file", choices=("robot", "scenario", "model", "sweep")),),
        ("schema robot", "schema sweep > sweep.schema.json"),
    ),
    "completion": Command(
        "tdcr_fe.commands.editors:completion",
        "print a script for the shell that completes commands and options",
        'Put eval "$(tdcr-fe completion bash)" into ~/.bashrc, or the same with zsh into ~/.zshrc.',
        (argument("shell", "the shell", choices=("bash", "zsh")),),
        ("completion bash", "completion zsh"),
    ),
}
