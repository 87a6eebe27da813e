"""The command ``tdcr-fe run``: solves a scenario, writes tables and pictures."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tdcr_fe.commands.status import FAILURE, INTERRUPTED, SUCCESS, complain, count

if TYPE_CHECKING:
    from tdcr_fe.io.toml import Scenario
    from tdcr_fe.model.results import SequenceResult, StepResult


def add_run_parser(commands: Any) -> None:
    """Add ``tdcr-fe run``."""
    parser = commands.add_parser(
        "run",
        help="solve a scenario; write tables and pictures",
        description="Solve the loading sequence of a scenario.toml; write tables, a summary and pictures.",
    )
    parser.add_argument("scenario", help="path of a scenario.toml")
    parser.add_argument("-o", "--out", metavar="OUT", required=True, help="directory for the results")
    add_options(parser)
    parser.set_defaults(handler=run)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options that `run` and `demo` share."""
    parser.add_argument("--no-pictures", action="store_true", help="write tables and summary only")
    parser.add_argument("-q", "--quiet", action="store_true", help="print nothing but what went wrong")


def run(args: argparse.Namespace) -> int:
    """Solve a scenario and write what came out."""
    from tdcr_fe.io.tables import check_place
    from tdcr_fe.io.toml import read_scenario

    problems: list[Any] = []
    scenario = _or_note(problems, lambda: read_scenario(args.scenario))
    out = _or_note(problems, lambda: check_place(args.out))
    _refuse(problems)
    return solve_and_write(scenario, out, args)


def _or_note(problems: list[Any], read: Callable[[], Any]) -> Any:
    """What ``read`` returns; where the input is wrong, its problems are noted instead."""
    from tdcr_fe.io.problems import InputError

    try:
        return read()
    except InputError as error:
        problems.extend(error.problems)
        return None


def _refuse(problems: list[Any]) -> None:
    from tdcr_fe.io.problems import InputError

    if problems:
        raise InputError(problems)


def solve_and_write(scenario: Scenario, out: Path, args: argparse.Namespace) -> int:
    """Solve a scenario, write its results, and return the exit status."""
    from tdcr_fe.io.problems import InputError, Problem
    from tdcr_fe.io.tables import write_results

    if not args.no_pictures:
        importlib.import_module("tdcr_fe.report.plots")  # slow; an interruption after solving must not hit it
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
        print(f"{count(len(result.steps), 'step')} in {result.wall_time:.2f} s. Written to {out}:")
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
    complain(f"{what}; {count(solved, 'step')} solved before it {'is' if solved == 1 else 'are'} in {out}")
    if result.message and not interrupted:
        complain(result.message)
    return INTERRUPTED if interrupted else FAILURE


def _solve(scenario: Scenario, quiet: bool) -> SequenceResult:
    """Simulate with a bar on stderr, where that is a terminal."""
    from tqdm import tqdm

    from tdcr_fe.solve.simulate import simulate

    with tqdm(
        total=len(scenario.steps), unit="step", leave=False, file=sys.stderr, disable=True if quiet else None
    ) as bar:

        def progress(step: StepResult) -> None:
            bar.set_postfix_str(step.label, refresh=False)
            bar.update(step.step - bar.n)  # refining the mesh begins again with the first step

        return simulate(scenario.robot, scenario.model, scenario.steps, scenario.settings, progress)


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
