"""The command ``python -m tdcr_fe.validation.fuzz``: solves random robots, and checks every state from outside."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tdcr_fe.commands.common import FAILURE, SUCCESS, WRONG_INPUT, at_least_one
from tdcr_fe.io.records import Lines, OtherHead, solve_all
from tdcr_fe.validation.collecting import collect
from tdcr_fe.validation.crosscheck.campaign import silence_exudyn
from tdcr_fe.validation.fuzz.campaign import head, outcome_of, solve_case
from tdcr_fe.validation.fuzz.report import summary, to_frame


def main(argv: Sequence[str] | None = None) -> int:
    """Solve and check random robots, write a table, print a summary.

    Parameters
    ----------
    argv
        Arguments without the program's name; None takes those of the process.

    Returns
    -------
    int
        Exit status: 0 all converge and every check holds, 1 one does not, 2 OUT holds records of other code, 130
        interrupted, 143 by SIGTERM (start it again to resume).
    """
    parser = argparse.ArgumentParser(
        prog="python -m tdcr_fe.validation.fuzz",
        description="Solve random robots with any options that robot.toml has, and random histories; check every state "
        "that is called converged by its positions, rotations and tensions alone: equilibrium of every free body, "
        "Capstan bounds, prescribed inputs; on a sample energy and the reference.",
    )
    parser.add_argument(
        "-n", type=at_least_one, default=10_000, metavar="COUNT", help="number of robots (10000)"
    )
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="first seed (0)")
    parser.add_argument("-o", required=True, metavar="OUT", help="folder; robots in it are not solved again")
    parser.add_argument("--processes", type=at_least_one, default=1, help="number of robots at a time (1)")
    parser.add_argument("--again", action="store_true", help="solve those again that did not pass")
    parser.add_argument("--any-version", action="store_true", help="take records of other code in OUT, too")
    args = parser.parse_args(argv)
    if args.first < 0:
        parser.error("--first must be at least 0")

    out = Path(args.o)
    store = Lines(out / "fuzz.jsonl", head())
    if args.any_version:
        store = store.with_head_of_file()
    try:
        store.begin_or_check()
    except OtherHead as error:
        print(f"{error}; give another folder, or --any-version", file=sys.stderr)
        return WRONG_INPUT
    tasks = {str(n): n for n in range(args.first, args.first + args.n)}
    again = (lambda record: not outcome_of(record).passed) if args.again else None
    records = solve_all(
        tasks, solve_case, store, args.processes, silence_exudyn, own_process=False, again=again
    )
    found, interrupted = collect(records, len(tasks), "robot")
    if interrupted is not None:
        return interrupted
    outcomes = sorted((outcome_of(record) for _, record, _ in found), key=lambda o: o.number)
    to_frame(outcomes).to_csv(out / "fuzz.csv", index=False)
    print("\n".join(summary(outcomes)))
    return SUCCESS if all(o.passed for o in outcomes) else FAILURE


if __name__ == "__main__":
    raise SystemExit(main())
