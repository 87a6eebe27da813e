"""The command ``tdcr-fe sweep``: many cases of a scenario with other values."""

from __future__ import annotations

import argparse
import importlib

import pandas as pd

from tdcr_fe.commands.common import Exit, complain, print_understood, progress_bar, say
from tdcr_fe.io.files import check_output_folder, read_all
from tdcr_fe.model.messages import count
from tdcr_fe.model.results import Interrupted
from tdcr_fe.sweeps.cases import scenario_of
from tdcr_fe.sweeps.description import Sweep
from tdcr_fe.sweeps.execution import sweep
from tdcr_fe.sweeps.read import read_sweep
from tdcr_fe.sweeps.result import SweepResult


def run_sweep(args: argparse.Namespace) -> int:
    """Solve the cases of a sweep, write them, and print what came out."""
    if args.out is None and not args.check:
        args.parser.error("the following arguments are required: -o/--out")
    described, _ = read_all(
        lambda: read_sweep(args.sweep, args.effects), lambda: args.out and check_output_folder(args.out)
    )
    scenario = scenario_of(described)
    print_understood(args, scenario.robot, scenario.model, scenario.steps)
    if args.check:
        print(format_cases(described))
        return Exit.DONE
    if not args.no_pictures:
        importlib.import_module("tdcr_fe.sweeps.report")  # slow; an interruption must not hit it
    return _report(_solve(described, args), args)


def _solve(described: Sweep, args: argparse.Namespace) -> SweepResult:
    """Run the sweep with a progress bar."""
    with progress_bar(args, unit="case") as bar:

        def progress(finished: int, total: int) -> None:
            if bar.total is None:  # cases of an earlier run are no measure of the speed
                bar.total, bar.initial = total, finished
            bar.update(finished - bar.n)
            if finished == total and not args.no_pictures:
                bar.set_postfix_str("drawing the report")

        try:
            return sweep(
                described,
                args.out,
                processes=args.processes,
                fresh=args.fresh,
                retry=args.retry,
                report=not args.no_pictures,
                progress=progress,
            )
        except Interrupted as stop:
            return stop.result


def _report(result: SweepResult, args: argparse.Namespace) -> int:
    """Print what came out; the exit status."""
    say(args, f"{result!r}\nWritten to {args.out}")
    for status, messages in result.failures.items():
        for m in messages[:5]:
            complain(f"{count(m.count, 'case')} {status}, case {m.case} the first: {m.example}")
    for m in result.warnings[:5]:
        complain(f"warning: {count(m.count, 'time')}, in case {m.case} first: {m.example}")
    if result.interrupted:
        left = count(result.counts.get("not run", 0), "case")
        complain(f"interrupted; {left} of {len(result.cases)} not run, the same command continues from there")
        return Exit.INTERRUPTED
    return Exit.DONE if result.converged else Exit.FAILED


def format_cases(described: Sweep, most: int = 8) -> str:
    """Number of cases, and the values of the first ones, as a table for people."""
    first = {name: values[:most] for name, values in described.design().items()}
    table = pd.DataFrame({"case": range(1, min(most, described.count) + 1), **first})
    more = f"\n... {described.count - most} more" if described.count > most else ""
    head = f"{count(described.count, 'case')}, method {described.sampling.method}"
    return f"{head}\n\n{table.to_string(index=False, float_format='{:.6g}'.format)}{more}"
