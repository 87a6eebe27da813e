"""The command ``tdcr-fe``: parses arguments, prints, and turns outcomes into exit statuses. No physics.

A subcommand is a function that takes argparse's subparsers, adds its parser and sets the default ``handler``
(arguments in, exit status out). It is named in `COMMANDS`, and imports what is heavy only in its handler.
"""

from __future__ import annotations

import argparse
import importlib
import io
import os
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from tdcr_fe import __version__
from tdcr_fe.status import FAILURE, INTERRUPTED, SUCCESS, WRONG_INPUT, complain

if TYPE_CHECKING:
    from pathlib import Path

    from tdcr_fe.files import Scenario
    from tdcr_fe.results import SequenceResult, StepResult


#: Every subcommand, as ``module:function``.
COMMANDS = (
    "tdcr_fe.cli:add_run_parser",
    "tdcr_fe.cli:add_demo_parser",
    "tdcr_fe.validation.identify_command:add_identify_parser",
    "tdcr_fe.validation.crosscheck.command:add_validate_parser",
    "tdcr_fe.validation.paper.command:add_paper_parser",
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command.

    Parameters
    ----------
    argv
        Arguments without the program's name; None takes those of the process.

    Returns
    -------
    int
        Exit status: 0 done, 1 the model did not converge, 2 the input is wrong, 130 interrupted.
    """
    # Threads cost more than they gain on matrices of this size, four times on a busy machine. Numpy reads this
    # when it is first imported, which the commands do only after this line; what the user has set stands.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(
            errors="backslashreplace"
        )  # a label must not stop a terminal of another encoding
    try:
        args = _parser().parse_args(argv)
        status = int(args.handler(args))
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        complain("interrupted; no results were written")
        return INTERRUPTED
    except BrokenPipeError:  # whoever read our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return SUCCESS
    except OSError as error:  # a disk that is full, a directory that is read-only
        complain(f"cannot go on: {error}")
        return WRONG_INPUT
    except Exception as error:
        from tdcr_fe.files import InputError

        if not isinstance(error, InputError):
            raise
        complain(f"{_count(len(error.problems), 'mistake')} in the input; nothing was written")
        for problem in error.problems:
            print(f"  {problem}", file=sys.stderr)
        return WRONG_INPUT


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tdcr-fe",
        description="Tendon-driven continuum robots in Exudyn: finite elements with Capstan friction.",
        epilog="Exit status: 0 done, 1 the model did not converge, 2 the input is wrong, 130 interrupted.",
    )
    parser.add_argument("--version", action="version", version=f"tdcr-fe {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for place in COMMANDS:
        module, _, function = place.partition(":")
        getattr(importlib.import_module(module), function)(commands)
    return parser


# ------------------------------------------------------------------------------------------------ run, demo


def add_run_parser(commands: Any) -> None:
    """Add ``tdcr-fe run``."""
    parser = commands.add_parser(
        "run",
        help="solve a scenario; write tables and pictures",
        description="Solve the loading sequence of a scenario.toml; write tables, a summary and pictures.",
    )
    parser.add_argument("scenario", help="path of a scenario.toml")
    parser.add_argument("-o", "--out", metavar="OUT", required=True, help="directory for the results")
    _add_options(parser)
    parser.set_defaults(handler=run)


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
    _add_options(parser)
    parser.set_defaults(handler=demo)


def _add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--no-pictures", action="store_true", help="write tables and summary only")
    parser.add_argument("-q", "--quiet", action="store_true", help="print nothing but what went wrong")


def run(args: argparse.Namespace) -> int:
    """Solve a scenario and write what came out."""
    from tdcr_fe.files import read_scenario
    from tdcr_fe.output import check_place
    from tdcr_fe.validation.effects.table import register

    register()
    problems: list[Any] = []
    scenario = _or_note(problems, lambda: read_scenario(args.scenario))
    out = _or_note(problems, lambda: check_place(args.out))
    _refuse(problems)
    return _solve_and_write(scenario, out, args)


def demo(args: argparse.Namespace) -> int:
    """Solve the packaged scenario; leave its input beside the results."""
    from importlib.resources import as_file, files
    from shutil import copyfile

    from tdcr_fe.files import read_scenario
    from tdcr_fe.output import check_place, write_together

    out = check_place(args.out)
    with as_file(files("tdcr_fe") / "data" / "demo") as folder:
        names = ("robot.toml", "scenario.toml")

        def write(place: Path) -> None:
            for name in names:
                copyfile(folder / name, place / name)

        write_together(out, write)
    if not args.quiet:
        print(
            f"The input is {out / 'scenario.toml'} with {out / 'robot.toml'}; change it and solve it anew by"
        )
        print(f"    tdcr-fe run {out / 'scenario.toml'} -o {out}\n")
    return _solve_and_write(read_scenario(out / "scenario.toml"), out, args)


def _or_note(problems: list[Any], read: Callable[[], Any]) -> Any:
    """What ``read`` returns; where the input is wrong, its problems are noted instead."""
    from tdcr_fe.files import InputError

    try:
        return read()
    except InputError as error:
        problems.extend(error.problems)
        return None


def _refuse(problems: list[Any]) -> None:
    from tdcr_fe.files import InputError

    if problems:
        raise InputError(problems)


def _solve_and_write(scenario: Scenario, out: Path, args: argparse.Namespace) -> int:
    from tdcr_fe.files import InputError, Problem
    from tdcr_fe.output import write_results

    if not args.no_pictures:
        importlib.import_module("tdcr_fe.plots")  # slow; an interruption after solving must not hit it
    try:
        result = _solve(scenario, args.quiet)
    except ValueError as error:  # a contradiction that only the solver knows
        raise InputError([Problem(str(scenario.path), "", "", str(error))]) from error
    try:
        written = write_results(result, out, scenario.digests, len(scenario.steps), not args.no_pictures)
    except KeyboardInterrupt:  # while drawing, most likely; what was solved is kept
        write_results(result, out, scenario.digests, len(scenario.steps), pictures=False)
        complain(f"interrupted while writing; the tables are in {out}, without pictures")
        return INTERRUPTED
    if not args.quiet:
        if result.steps:
            print(format_table(result) + "\n")
        print(f"{_count(len(result.steps), 'step')} in {result.wall_time:.2f} s. Written to {out}:")
        print("    " + ", ".join(p.name for p in written))
    for warning in result.warnings:
        complain(f"warning: {warning}")
    if result.converged:
        return SUCCESS
    return _tell_failure(result, scenario, out)


def _tell_failure(result: SequenceResult, scenario: Scenario, out: Path) -> int:
    interrupted = result.message.startswith("interrupted")
    number = result.failed_step
    if number is not None and 1 <= number <= len(scenario.steps):
        label = scenario.steps[number - 1].label
        place = f"step {number} of {len(scenario.steps)}" + (f' ("{label}")' if label else "")
    else:
        place = "the sequence"
    solved = sum(s.converged for s in result.steps)
    what = f"interrupted in {place}" if interrupted else f"{place} did not converge"
    complain(f"{what}; {_count(solved, 'step')} solved before it {'is' if solved == 1 else 'are'} in {out}")
    if result.message and not interrupted:
        complain(result.message)
    return INTERRUPTED if interrupted else FAILURE


def _solve(scenario: Scenario, quiet: bool) -> SequenceResult:
    """Simulate with a bar on stderr, where that is a terminal."""
    from tqdm import tqdm

    from tdcr_fe.simulate import simulate

    with tqdm(
        total=len(scenario.steps), unit="step", leave=False, file=sys.stderr, disable=True if quiet else None
    ) as bar:

        def progress(step: StepResult) -> None:
            bar.set_postfix_str(step.label, refresh=False)
            bar.update(1)

        return simulate(scenario.robot, scenario.model, scenario.steps, progress=progress)


# ---------------------------------------------------------------------------------------------------- tables


def format_table(result: SequenceResult) -> str:
    """The steps of a result as a table for people, in mm and degrees."""
    names = result.robot.tendon_names
    head = ["step", "label", *(f"{n} [N]" for n in names), *(f"{n} [mm]" for n in names)]
    head += ["tip x", "y", "z [mm]", "bending [deg]", "iterations"]
    rows = [
        [
            str(s.step),
            s.label if len(s.label) <= 24 else s.label[:21] + "...",
            *(f"{t:.4g}" for t in s.base_tensions),
            *(f"{1e3 * d + 0.0:.3f}" for d in s.displacements.round(9)),
            *(f"{1e3 * x + 0.0:.2f}" for x in s.tip.round(9)),
            f"{s.bending_angle * 57.29577951308232:.3f}",
            str(s.iterations) if s.converged else f"{s.iterations} (failed)",
        ]
        for s in result.steps
    ]
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    return "\n".join(
        "  ".join(
            text.ljust(w) if i == 1 else text.rjust(w)
            for i, (text, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in [head, ["-" * w for w in widths], *rows]
    )


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"
