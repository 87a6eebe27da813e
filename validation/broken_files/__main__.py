"""The command ``python -m tdcr_fe.validation.broken_files``: runs the commands on broken input files."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from tdcr_fe.commands.common import FAILURE, SUCCESS, at_least_one
from tdcr_fe.io.atomic import write_text
from tdcr_fe.io.store import Folder, solve_all
from tdcr_fe.validation.broken_files.campaign import Outcome, cases, run_case
from tdcr_fe.validation.broken_files.report import summary, to_frame, to_markdown
from tdcr_fe.validation.collecting import collect
from tdcr_fe.validation.crosscheck.campaign import silence_exudyn


def main(argv: Sequence[str] | None = None) -> int:
    """Break good files, run the commands, write a table, print a summary.

    Parameters
    ----------
    argv
        Arguments without the program's name; None takes those of the process.

    Returns
    -------
    int
        Exit status: 0 every input is refused by name or valid, 1 one is not, 130 interrupted, 143 by SIGTERM (start it
        again to resume).
    """
    parser = argparse.ArgumentParser(
        prog="python -m tdcr_fe.validation.broken_files",
        description="Break good input files in one place each, run the commands on them, and judge: a named error and "
        "nothing written, or a valid run; no traceback, no command that hangs.",
    )
    parser.add_argument(
        "-n", type=at_least_one, default=2000, metavar="COUNT", help="number of inputs (2000)"
    )
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="first seed (0)")
    parser.add_argument("-o", required=True, metavar="OUT", help="folder; inputs in it are not run again")
    parser.add_argument(
        "--own-processes",
        type=int,
        default=50,
        metavar="N",
        help="inputs that get a process of their own (50)",
    )
    parser.add_argument("--processes", type=at_least_one, default=1, help="number of inputs at a time (1)")
    parser.add_argument("--again", action="store_true", help="run those again that were not judged right")
    args = parser.parse_args(argv)
    if args.first < 0 or args.own_processes < 0:
        parser.error("--first and --own-processes must be at least 0")

    out = Path(args.o)
    tasks = {str(case.number): case for case in cases(args.n, args.first, args.own_processes)}

    def wrong(record: dict[str, object]) -> bool:
        return not Outcome(**record).passed  # type: ignore[arg-type]

    records = solve_all(
        tasks,
        run_case,
        Folder(out / "cases"),
        args.processes,
        silence_exudyn,
        own_process=args.processes > 1,
        again=wrong if args.again else None,
    )
    found, interrupted = collect(records, len(tasks), "input")
    if interrupted is not None:
        return interrupted
    outcomes = sorted((Outcome(**record) for _, record, _ in found), key=lambda o: o.number)
    to_frame(outcomes).to_csv(out / "broken_files.csv", index=False)
    write_text(to_markdown(outcomes), out / "broken_files.md")
    print("\n".join(summary(outcomes)))
    return SUCCESS if all(o.passed for o in outcomes) else FAILURE


if __name__ == "__main__":
    raise SystemExit(main())
