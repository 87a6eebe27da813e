"""The command ``python -m tdcr_fe.validation.blind``: runs the blind benchmark with a progress bar."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from typing import Any

from tdcr_fe.commands.common import FAILURE, SUCCESS, at_least_one
from tdcr_fe.io.processes import sigterm_as_interrupt


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark.

    Parameters
    ----------
    argv
        Arguments without the program's name; None takes those of the process.

    Returns
    -------
    int
        Exit status: 0 done, 1 a set failed, 130 interrupted, 143 by SIGTERM (start it again to resume).
    """
    parser = argparse.ArgumentParser(
        prog="python -m tdcr_fe.validation.blind",
        description="Simulate blind data with the reference, run the identification on them, and score it.",
    )
    parser.add_argument("-n", type=at_least_one, default=60, metavar="COUNT", help="number of sets (60)")
    parser.add_argument(
        "-o", required=True, metavar="OUT", help="folder; finished sets in it are not repeated"
    )
    parser.add_argument("--processes", type=at_least_one, default=1, help="number of sets at a time (1)")
    parser.add_argument("--seed", type=int, default=0, help="of the plan (0)")
    parser.add_argument("--effects", nargs="+", metavar="NAME", help="one of these in each set, in turn")
    parser.add_argument("--only", type=int, nargs="+", metavar="SET", help="seeds of the sets to do")
    parser.add_argument("--page", metavar="FILE", help="page of the documentation that gets the tables")
    args = parser.parse_args(argv)
    if args.seed < 0:
        parser.error("--seed must be at least 0")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

    from tqdm import tqdm

    from tdcr_fe.validation.blind.benchmark import run_benchmark
    from tdcr_fe.validation.blind.recipes import plan, plan_of
    from tdcr_fe.validation.blind.report import to_markdown, write_into_page, write_report

    try:
        planned = plan_of(args.effects, args.n, args.seed) if args.effects else plan(args.n, args.seed)
    except ValueError as error:
        parser.error(f"--effects: {error}")
    recipes = [r for r in planned if args.only is None or r.seed in args.only]
    if not recipes:
        parser.error("--only names no set of this plan")
    with tqdm(total=len(recipes), unit="set") as bar:

        def progress(done: int, total: int, score: dict[str, Any]) -> None:
            bar.set_postfix_str(f"{score['seed']}: {score['outcome']}")
            bar.update()

        with sigterm_as_interrupt() as termination:
            try:
                scores = run_benchmark(recipes, args.o, args.processes, progress)
            except KeyboardInterrupt:
                print("interrupted; start it again to resume", file=sys.stderr)
                return termination.status
    summary = write_report(scores, args.o)
    if args.page:
        write_into_page(to_markdown(summary, scores), args.page)
    print(f"{len(scores)} sets; tables in {os.path.join(args.o, 'benchmark.md')}")
    return FAILURE if any(s["outcome"] == "failed" for s in scores) else SUCCESS


if __name__ == "__main__":
    raise SystemExit(main())
