"""Every command as its help shows it: what it does, its arguments, two examples, and the function that carries it out.

An argument is a line: its flags and what stands for the value, or its name; then what it is. ``{a,b}`` are choices, of
which the first is the default, and ``VALUE...`` may be several. The last line may be "and", with the names of arguments
that several commands share. What `argparse` has to know besides is given by the name of the argument.
"""

from __future__ import annotations

import argparse
import math
import re
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from tdcr_fe.commands.common import cores


@dataclass(frozen=True)
class Command:
    """A subcommand.

    Attributes
    ----------
    handler : str
        Function from the arguments to the exit status, as ``module:function`` of a module that is imported for it.
    text : str
        What it does, in a line; perhaps more about it; after an empty line its arguments, in the order of its help.
    examples : tuple of str
        What follows the program's name.
    failure : str
        Meaning of exit status 1, where it differs from that of `tdcr-fe --help`.
    options : mapping of str to dict
        Further arguments of `add_argument`, by name of the argument.
    """

    handler: str
    text: str
    examples: tuple[str, str]
    failure: str = ""
    options: dict[str, dict[str, Any]] = field(default_factory=dict)

    @property
    def help(self) -> str:
        """What it does, in a line."""
        return self.text.partition("\n")[0]

    @property
    def description(self) -> str:
        """What it does, at the top of its own help."""
        more = self.text.partition("\n\n")[0].partition("\n")[2]
        return f"{self.help[0].upper()}{self.help[1:]}. {' '.join(more.split())}"

    def arguments(self) -> Iterator[tuple[list[str], dict[str, Any]]]:
        """Flags or the name of every argument, and the options of `add_argument`."""
        *lines, last = _lines(self.text.partition("\n\n")[2])
        shared = (
            [SHARED[name] for name in last.removeprefix("and ").split(", ")] if "  " not in last else [last]
        )
        for line in [*lines, *shared]:
            names, _, text = line.partition("  ")
            *flags, value = names.split()
            options: dict[str, Any] = {"help": text.strip()}
            if value.endswith("..."):
                options["nargs"], value = "+", value.removesuffix("...")
            if value.startswith("{"):
                options["choices"] = tuple(value.strip("{}").split(","))
                options["default"] = options["choices"][0]
            elif value.isupper() or "." in value:
                options["metavar"] = value
            else:
                flags.append(value)
            name = flags[-1].lstrip("-")
            options |= self.options.get(name, OPTIONS.get(name, {}))
            if flags[0].startswith("-") and not options.keys() & {"metavar", "choices", "type"}:
                options["action"] = "store_true"
            yield flags, options


def _lines(text: str) -> list[str]:
    """Lines of a block, each with the indented ones that follow it."""
    return re.sub(r"\n\s+", " ", textwrap.dedent(text).strip()).split("\n")


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


#: Arguments that several commands have, by name.
SHARED = {
    re.split(" +", line.partition("--")[2])[0]: line
    for line in _lines("""
        -o --out OUT                  directory for the results
        --effects FILE.py             effects of your own, classes in a Python file; may be repeated
        --processes N                 processes to use [number of cores]
        --no-pictures                 write tables and summary only, no pictures and no pages
        -q --quiet                    print nothing but errors and warnings
        --json                        print one JSON object with status, files written, main figures and
                                      errors, and nothing else on stdout
        --sensitivities PARAMETER...  differentiate the results by parameters such as backbone.youngs_modulus;
                                      writes sensitivities.csv
        --compliance                  write compliance and tendon Jacobians of the tip, and the stiffness seen
                                      by the motors, to summary.json
        --minutes                     time limit; what is solved until then is written [none]
    """)
}
#: What argparse has to know of arguments, by name, where a command says nothing else.
OPTIONS: dict[str, dict[str, Any]] = {
    "out": {"required": True},
    "effects": {"action": "append", "default": []},
    "processes": {"type": whole(1)},
    "sensitivities": {"default": []},
    "minutes": {"type": minutes},
}

#: Every command, by name.
COMMANDS = {
    "run": Command(
        "tdcr_fe.commands.run:run",
        """solve a scenario; write tables and pictures

        scenario  path of a scenario.toml
        and out, sensitivities, compliance, minutes, no-pictures, effects, json, quiet""",
        (
            "run scenario.toml -o results",
            "run scenario.toml -o results --sensitivities backbone.youngs_modulus tendons.t1.offset",
        ),
    ),
    "follow": Command(
        "tdcr_fe.commands.follow:follow",
        """find the tensions that take the tip along a path
        Tensions stay within bounds; a target that is out of reach is approached as far as possible.

        robot                      path of a robot.toml
        path                       path of a path.csv with the columns step,x,y,z[,dx,dy,dz], in m; empty: any
        --largest T...             largest tension in N: one number for all tendons, or NAME=T for each
        --pretension T...          smallest tension in N, above zero to keep tendons from becoming slack: one
                                   number, or NAME=T [0]
        --model MODEL              path of a model.toml with the tables [model] and [solver]
        --displacements            find prescribed displacements instead of tensions
        --effort {tension,change}  what has the smallest sum of squares where several tensions come as near:
                                   the tensions, or their change from the target before [%(default)s]
        --tolerance D              error in m with which a target counts as reached [0.1 %% of the length]
        and out, no-pictures, quiet""",
        (
            "follow robot.toml path.csv --largest 5 -o results",
            "follow robot.toml path.csv --largest t1=5 t2=4 t3=4 --pretension 0.1 -o results",
        ),
        "a load step or a search did not converge",
        {"largest": {"required": True}, "pretension": {"default": ["0"]}, "tolerance": {"type": float}},
    ),
    "sweep": Command(
        "tdcr_fe.commands.sweep:run_sweep",
        """solve many cases: grids, samples of uncertain values, the workspace of a robot
        Writes one table with a row per case, statistics and a report. Finished cases are kept in OUT/cases.jsonl: the
        same command continues a sweep that was interrupted.

        sweep    path of a sweep.toml
        --check  check the files, print the first cases, and solve nothing
        --fresh  start over where OUT has a journal
        --retry  solve cases in the journal that did not converge again
        and out, processes, effects, no-pictures, quiet""",
        ("sweep sweep.toml --check", "sweep sweep.toml -o results --processes 4"),
        "a case did not converge (the table says why)",
        {"out": {}},
    ),
    "view": Command(
        "tdcr_fe.commands.view:view",
        """draw results in 3D, as one HTML file
        A slider over the load steps and plots that follow it; no server and no network are needed.

        result              folder that tdcr-fe run, follow or identify wrote
        -o --out FILE.html  the page [RESULT/view.html]
        --video FILE        also a video, FILE.gif or FILE.mp4 (the latter needs the program ffmpeg)
        --vtk FOLDER        also files for ParaView: FOLDER/robot.pvd and one .vtp for each load step
        and quiet""",
        ("view results", "view results -o robot.html --video robot.gif"),
        options={"out": {}},
    ),
    "demo": Command(
        "tdcr_fe.commands.run:demo",
        """solve the paper's single-segment robot, input included
        It is pulled to 2.5 N in five steps, loaded at its tip, and released.

        -o --out OUT  directory for the results [%(default)s]
        and sensitivities, compliance, minutes, no-pictures, quiet""",
        ("demo", "demo -o results --compliance"),
        options={"out": {"default": "tdcr-fe-demo"}},
    ),
    "new": Command(
        "tdcr_fe.commands.new:new",
        """write commented input files to start from
        Every key is there with its unit and default. robot: robot.toml and scenario.toml for `tdcr-fe run`;
        experiment: a folder of measured data for `tdcr-fe identify`, filled with numbers of a simulation; sweep: the
        files of robot and a sweep.toml for `tdcr-fe sweep`.

        kind {robot,experiment,sweep}  what to begin
        -o --out OUT                   directory for the files, none of which is overwritten [tdcr-fe-KIND]
        --tendons N                    number of tendons [%(default)s]
        and quiet""",
        ("new robot", "new experiment -o measured --tendons 4"),
        options={"out": {}, "tendons": {"type": whole(1, 24), "default": 3}},
    ),
    "identify": Command(
        "tdcr_fe.commands.identify:run",
        """find from measured data which effects a model is missing
        Effects that are found are added to the model; the report shows the error before and after.

        folder...           contains robot.toml, loading.csv, observations.csv and, optionally, model.toml;
                            several folders of one robot share the effects
        --robots            the folders are of several robots of one design: what their effects have in common,
                            and the scatter between the robots, in OUT/robots.json; a report of each in OUT/NAME
        -o --out OUT        directory for result.json and report.html
        --processes N       worker processes, at most as many as there are cores [%(default)s]
        --hold-out PATTERN  hold out the branches of loading.csv that match a shell pattern, such as 'pair*';
                            may be repeated [about a third of the branches, chosen automatically]
        --minutes           limit of the processor time of the whole identification, all processes together;
                            the report says what was left out [%(default)s]
        and effects, json, quiet""",
        ("identify measured -o report", "identify monday tuesday -o report --minutes 5"),
        "the declared model did not converge",
        {
            "processes": {"type": whole(1), "default": min(2, cores())},
            "hold-out": {"action": "append", "default": []},
            "minutes": {"type": minutes, "default": 15.0},
        },
    ),
    "estimate": Command(
        "tdcr_fe.commands.estimate:run",
        """estimate shape, tensions and external force from inputs and readings, frame by frame
        With their covariance, and with the history of friction. Writes estimates.csv, shape.csv and report.html.

        folder  contains robot.toml, loading.csv with times, observations.csv and estimate.toml
        and out, quiet""",
        ("estimate measured -o estimated", "estimate measured -o estimated --quiet"),
        "a frame was not solved (it keeps the state before, and the run goes on)",
    ),
    "live": Command(
        "tdcr_fe.commands.live:live",
        """open a page on which a robot answers sliders and the mouse
        Every change is a load step with its history; the sequence can be saved as scenario.toml. The page is
        served on this computer only and ends with Ctrl-C or when it is closed.

        robot          path of a robot.toml
        --model MODEL  path of a model.toml with the tables [model] and [solver]
        --port N       port on this computer [a free one]
        --no-browser   print the address and open no browser
        and quiet""",
        ("live robot.toml", "live robot.toml --port 8000 --no-browser"),
        options={"port": {"type": whole(0, 65535), "default": 0}},
    ),
    "validate": Command(
        "tdcr_fe.commands.validate:validate",
        """finite elements against the independent shooting reference; write the report
        Finished cases are kept in OUT/cases.jsonl: the same command continues a run that was interrupted.

        -o --out OUT  directory for the report
        --full        every case; without it a quick set
        and processes, quiet""",
        ("validate -o validation", "validate -o validation --full --processes 4"),
        "a case or a requirement fails",
    ),
    "schema": Command(
        "tdcr_fe.commands.new:schema",
        """print the JSON schema of an input file, for editors

        file {robot,scenario,model,sweep}  the file""",
        ("schema robot", "schema sweep > sweep.schema.json"),
    ),
}
