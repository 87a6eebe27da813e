"""The command ``tdcr-fe sweep``: many cases of a scenario with other values."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from tdcr_fe.commands import common
from tdcr_fe.commands.common import FAILURE, INTERRUPTED, SUCCESS, complain

if TYPE_CHECKING:
    from tdcr_fe.sweeps.description import Sweep
    from tdcr_fe.sweeps.result import SweepResult


def add_sweep_parser(commands: Any) -> None:
    """Add ``tdcr-fe sweep``."""
    parser = commands.add_parser(
        "sweep",
        help="solve many cases: grids, samples of uncertain values, the workspace of a robot",
        description="Solve a scenario with other values of its keys: a grid, a list, or a sample of uncertain values; "
        "write one table with a row per case, statistics and a report. Finished cases are kept in OUT/cases.jsonl: "
        "the same command continues a sweep that was interrupted.",
        epilog="Exit status: 0 all cases converged; 1 a case did not (the table says why); 2 the input is wrong; "
        "130 interrupted (143 by SIGTERM), finished cases are written.",
    )
    option = parser.add_argument
    option("sweep", help="path of a sweep.toml")
    option("-o", "--out", metavar="OUT", help="directory for the results")
    option("--check", action="store_true", help="check the files, print the first cases, and solve nothing")
    option(
        "--dask",
        metavar="ADDRESS",
        help="address of the scheduler of a dask.distributed cluster that solves the cases",
    )
    option(
        "--table",
        choices=("csv", "parquet"),
        default="csv",
        help="format of the table of cases [%(default)s]",
    )
    option("--fresh", action="store_true", help="start over where OUT has a journal")
    option("--retry", action="store_true", help="solve cases in the journal that did not converge again")
    common.add_options(parser, "--processes", "--effects", "--no-pictures")
    parser.set_defaults(handler=run_sweep, parser=parser)


def run_sweep(args: argparse.Namespace) -> int:
    """Solve the cases of a sweep, write them, and print what came out."""
    from tdcr_fe.io.atomic import check_output_folder
    from tdcr_fe.io.problems import read_all
    from tdcr_fe.sweeps.read import read_sweep

    if args.out is None and not args.check:
        args.parser.error("the following arguments are required: -o/--out")
    described, _ = read_all(
        lambda: read_sweep(args.sweep, args.effects), lambda: args.out and check_output_folder(args.out)
    )
    if args.check:
        print(format_cases(described))
        return SUCCESS
    if not args.no_pictures:
        importlib.import_module("tdcr_fe.sweeps.report")  # slow; an interruption must not hit it
    return _report(_solve(described, args), args)


def _solve(described: Sweep, args: argparse.Namespace) -> SweepResult:
    """Run the sweep with a progress bar."""
    from tdcr_fe.sweeps.run import SweepInterrupted, sweep

    with _dask(args.dask) as (executor, in_flight), common.progress_bar(args, unit="case") as bar:

        def progress(finished: int, total: int) -> None:
            if bar.total is None:  # cases of an earlier run are no measure of the speed
                bar.total, bar.initial = total, finished
            bar.update(finished - bar.n)

        try:
            return sweep(
                described,
                args.out,
                executor=executor,
                processes=args.processes,
                in_flight=in_flight,
                fresh=args.fresh,
                retry=args.retry,
                table=args.table,
                report=not args.no_pictures,
                progress=progress,
            )
        except SweepInterrupted as stop:
            return stop.result


@contextmanager
def _dask(address: str | None) -> Iterator[tuple[Executor | None, int | None]]:
    """Executor of a cluster, and how many batches it is given at a time; None, None without an address.

    Raises
    ------
    InputError
        dask.distributed is not installed, or no scheduler answers.
    """
    if address is None:
        yield None, None
        return
    from tdcr_fe.io.problems import InputError, Problem

    try:
        from distributed import Client
    except ImportError as error:
        text = "needs dask.distributed, which is not installed: pip install 'tdcr-fe[dask]'"
        raise InputError([Problem("--dask", "", address, text)]) from error
    try:
        client = Client(address, timeout="20s")
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError([Problem("--dask", "", address, f"no scheduler answers there: {error}")]) from error
    with client:
        yield client.get_executor(), max(8, 4 * sum(client.nthreads().values()))


def _report(result: SweepResult, args: argparse.Namespace) -> int:
    """Print what came out; the exit status."""
    if not args.quiet:
        print(f"{result!r}\nWritten to {args.out}")
    for status, messages in result.failures.items():
        for m in messages[:5]:
            complain(f"{common.count(m.count, 'case')} {status}, case {m.case} the first: {m.example}")
    if result.interrupted:
        left = common.count(result.counts.get("not run", 0), "case")
        complain(f"interrupted; {left} of {len(result.cases)} not run, the same command continues from there")
        return INTERRUPTED
    return SUCCESS if result.converged else FAILURE


def format_cases(described: Sweep, most: int = 8) -> str:
    """Number of cases, and the values of the first ones, as a table for people."""
    import pandas as pd

    design = described.design()
    shown = range(min(most, design.count))
    rows = [[k + 1, *(f"{x:.6g}" if isinstance(x, float) else x for x in design.case(k))] for k in shown]
    table = pd.DataFrame(rows, columns=["case", *(v.column for v in described.variations)])
    more = f"\n... {design.count - most} more" if design.count > most else ""
    head = f"{common.count(design.count, 'case')}, method {described.sampling.method}"
    return f"{head}\n\n{table.to_string(index=False)}{more}"
