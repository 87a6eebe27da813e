"""The command ``python -m tdcr_fe.validation.faulty_data``: identify on data with one fault each."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from tdcr_fe.commands.common import FAILURE, SUCCESS, at_least_one
from tdcr_fe.validation.collecting import collect
from tdcr_fe.validation.faulty_data.campaign import run_all
from tdcr_fe.validation.faulty_data.faults import FAULTS


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command on every set, write a table, print it.

    Parameters
    ----------
    argv
        Arguments without the program's name; None takes those of the process.

    Returns
    -------
    int
        Exit status: 0 every fault is refused, named or left open, 1 one is not, 130 interrupted, 143 by SIGTERM (start
        it again to resume).
    """
    parser = argparse.ArgumentParser(
        prog="python -m tdcr_fe.validation.faulty_data",
        description=f"Put {len(FAULTS)} faults into clean sets, one each, run identify, and judge what it says.",
    )
    parser.add_argument(
        "-o", required=True, metavar="OUT", help="folder; finished sets in it are not repeated"
    )
    parser.add_argument("--processes", type=at_least_one, default=1, help="number of sets at a time (1)")
    parser.add_argument("--only", type=int, nargs="+", metavar="NUMBER", help="numbers of the faults, from 1")
    args = parser.parse_args(argv)
    chosen = [f for k, f in enumerate(FAULTS, 1) if args.only is None or k in args.only]
    if not chosen:
        parser.error(f"--only: numbers from 1 to {len(FAULTS)}")

    out = Path(args.o)
    outcomes, interrupted = collect(run_all(chosen, out, args.processes), len(chosen), "set")
    if interrupted is not None:
        return interrupted
    order = [f.name for f in FAULTS]
    outcomes.sort(key=lambda o: order.index(o.fault))
    table = pd.DataFrame(
        [(o.fault, o.outcome, o.verdict, ", ".join(o.effects)) for o in outcomes],
        columns=["fault", "outcome", "verdict", "effects"],
    )
    table.to_csv(out / "faulty_data.csv", index=False)
    print(table.to_string(index=False))
    print(", ".join(f"{name}: {count}" for name, count in table["outcome"].value_counts().items()))
    return SUCCESS if all(o.passed for o in outcomes) else FAILURE


if __name__ == "__main__":
    raise SystemExit(main())
