"""The command ``python -m tdcr_fe.validation.random_robots``: compares both solvers on random robots."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from tdcr_fe.commands.common import FAILURE, SUCCESS, at_least_one
from tdcr_fe.validation.collecting import collect
from tdcr_fe.validation.random_robots.campaign import solve_all
from tdcr_fe.validation.random_robots.report import summary, to_frame


def main(argv: Sequence[str] | None = None) -> int:
    """Compare, write a table, print a summary.

    Parameters
    ----------
    argv
        Arguments without the program's name; None takes those of the process.

    Returns
    -------
    int
        Exit status: 0 every difference is announced, 1 one is not or a solver failed, 130 interrupted, 143 by
        SIGTERM (start it again to resume).
    """
    parser = argparse.ArgumentParser(
        prog="python -m tdcr_fe.validation.random_robots",
        description="Solve random robots of one to six tendons with the finite elements and with the reference, both "
        "with default settings, and compare the positions of the disks.",
    )
    parser.add_argument("-n", type=at_least_one, default=500, metavar="COUNT", help="number of robots (500)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="first seed (0)")
    parser.add_argument("-o", required=True, metavar="OUT", help="folder; cases in it are not solved again")
    parser.add_argument(
        "--keep-reference",
        action="store_true",
        help="take the reference's answers that are in OUT, even if its code or the model's has changed since",
    )
    parser.add_argument("--processes", type=at_least_one, default=1, help="number of cases at a time (1)")
    args = parser.parse_args(argv)
    if args.first < 0:
        parser.error("--first must be at least 0")

    folder = Path(args.o)
    numbers = range(args.first, args.first + args.n)
    solved = solve_all(numbers, folder, args.processes, keep_reference=args.keep_reference)
    records, interrupted = collect(solved, args.n, "robot")
    if interrupted is not None:
        return interrupted
    records.sort(key=lambda record: record.number)
    to_frame(records).to_csv(folder / "random_robots.csv", index=False)
    print("\n".join(summary(records)))
    return SUCCESS if all(record.passed for record in records) else FAILURE


if __name__ == "__main__":
    raise SystemExit(main())
