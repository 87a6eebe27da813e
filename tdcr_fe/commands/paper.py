"""The command ``tdcr-fe paper``; imports what is heavy only when it runs."""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from tdcr_fe.commands.common import INTERRUPTED, SUCCESS, complain


def add_paper_parser(commands: Any) -> None:
    """Add ``tdcr-fe paper``."""
    parser = commands.add_parser(
        "paper",
        help="reproduce the paper's figures and tables, and test its claims",
        description="Solve every figure and table of the paper, test its claims, and write one page "
        "(report.html), the numbers (report.json), the cases as input for 'tdcr-fe run' (cases/) and the tables as "
        "input for 'tdcr-fe identify' (datasets/).",
        epilog="Exit status: 0 done, whatever the verdicts; 2 the input is wrong; 130 interrupted (143 by SIGTERM), "
        "the report has what was finished.",
    )
    parser.add_argument("-o", "--out", metavar="OUT", required=True, help="directory for the report")
    parser.add_argument(
        "--no-effects", action="store_true", help="leave out the identification on the tables"
    )
    parser.add_argument(
        "--docs", metavar="DOCS", help="also write paper.md and its pictures into this folder"
    )
    parser.add_argument("-q", "--quiet", action="store_true", help="print nothing but what went wrong")
    parser.set_defaults(handler=paper)


@contextmanager
def remembered_interruption() -> Iterator[Callable[[], bool]]:
    """Whether SIGINT or SIGTERM arrived, even if the exception that it raised has been handled since.

    In another thread than the main one, where Python allows no signal handlers, it is always False.

    Yields
    ------
    callable
    """
    arrived = False
    before: dict[signal.Signals, Any] = {}
    if threading.current_thread() is threading.main_thread():
        before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def handle(number: int, frame: FrameType | None) -> None:
        nonlocal arrived
        arrived = True
        handler = before[signal.Signals(number)]
        if callable(handler):
            handler(number, frame)
        raise KeyboardInterrupt

    for number in before:
        signal.signal(number, handle)
    try:
        yield lambda: arrived
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def paper(args: argparse.Namespace) -> int:
    """Run everything and write the report."""
    import time
    from pathlib import Path

    from tqdm import tqdm

    from tdcr_fe.io.atomic import check_output_folder
    from tdcr_fe.validation.paper.cases import write_cases
    from tdcr_fe.validation.paper.claims import verdicts
    from tdcr_fe.validation.paper.report import write_datasets, write_docs, write_report
    from tdcr_fe.validation.paper.run import PARTS, run_paper, tasks

    out = check_output_folder(args.out)
    out.mkdir(parents=True, exist_ok=True)
    parts = [p for p in PARTS if not (args.no_effects and p == "effects")]
    begun = time.perf_counter()
    hidden = True if args.quiet else None
    with tqdm(total=tasks(parts), unit="task", leave=False, file=sys.stderr, disable=hidden) as bar:

        def progress(text: str) -> None:
            bar.set_postfix_str(text, refresh=False)
            bar.update(1)

        with remembered_interruption() as interrupted:
            run = run_paper(parts, progress, interrupted)
    seconds = time.perf_counter() - begun
    written = [p.name for p in write_report(run, out, seconds)] + ["cases/"]
    write_cases(out / "cases")
    if write_datasets(run, out / "datasets"):
        written.append("datasets/")
    if args.docs and not run.interrupted:
        write_docs(run, Path(args.docs), seconds)
    if not args.quiet:
        found = verdicts(run)
        width = max((len(v.verdict) for v in found), default=0)
        for v in found:
            print(f"{v.verdict.ljust(width)}  {v.claim}")
        print(f"\n{seconds:.0f} s. Written to {out}: {', '.join(written)}")
    if run.interrupted:
        unwritten = "; the documentation is left as it is" if args.docs else ""
        complain(
            f"unfinished: interrupted in {run.interrupted!r}; the report has what was finished before{unwritten}"
        )
        return INTERRUPTED
    return SUCCESS
