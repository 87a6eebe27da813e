"""The command ``python -m tdcr_fe.validation.blind_laws``: identify on blind sets with laws on no list."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

from tdcr_fe.commands.common import FAILURE, SUCCESS, at_least_one

#: Of twelve sets: in so many the held-out error is halved, and in so many the formula is right.
HALVED, RIGHT = 9, 6


def main(argv: Sequence[str] | None = None) -> int:
    """Run the identification on every set, write a table, print it.

    Parameters
    ----------
    argv
        Arguments without the program's name; None takes those of the process.

    Returns
    -------
    int
        Exit status: 0 the held-out error is halved in three quarters of the sets, and the formula is right in half of
        them; 1 not so, 130 interrupted, 143 by SIGTERM (start it again to resume).
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

    import pandas as pd

    from tdcr_fe.validation.blind.laws import LAWS
    from tdcr_fe.validation.blind_laws.campaign import run_all
    from tdcr_fe.validation.collecting import collect

    parser = argparse.ArgumentParser(
        prog="python -m tdcr_fe.validation.blind_laws",
        description=f"Simulate {len(LAWS)} robots with a law on no list, by the reference, and identify it.",
    )
    parser.add_argument(
        "-o", required=True, metavar="OUT", help="folder; finished sets in it are not repeated"
    )
    parser.add_argument("--processes", type=at_least_one, default=1, help="number of sets at a time (1)")
    parser.add_argument("--only", type=int, nargs="+", metavar="SEED", help="seeds of the sets, from 501")
    args = parser.parse_args(argv)
    chosen = [r for r in LAWS if args.only is None or r.seed in args.only]
    if not chosen:
        parser.error(f"--only: seeds from {LAWS[0].seed} to {LAWS[-1].seed}")

    out = Path(args.o)
    outcomes, interrupted = collect(run_all(chosen, out, args.processes), len(chosen), "set")
    if interrupted is not None:
        return interrupted
    order = [r.name for r in chosen]
    outcomes.sort(key=lambda o: order.index(o.law))
    table = pd.DataFrame(
        {
            "law": [o.law for o in outcomes],
            "verdict": [o.verdict for o in outcomes],
            "effects": [", ".join(o.effects) for o in outcomes],
            "formula": [o.formula for o in outcomes],
            "right": [o.right for o in outcomes],
            "among others": [o.among_others for o in outcomes],
            "before [mm]": [_millimetres(o.before) for o in outcomes],
            "after [mm]": [_millimetres(o.after) for o in outcomes],
            "noise [mm]": [_millimetres(o.noise) for o in outcomes],
            "seconds": [o.seconds for o in outcomes],
        }
    ).round(3)
    table.to_csv(out / "blind_laws.csv", index=False)
    print(table.to_string(index=False))
    halved, right = sum(o.halved for o in outcomes), sum(o.right for o in outcomes)
    listed = sum(bool(o.effects) for o in outcomes)
    print(
        f"of {len(outcomes)} sets: held-out error halved in {halved}, formula right in {right}, "
        f"listed effects named in {listed}"
    )
    enough = halved >= HALVED / len(LAWS) * len(outcomes) and right >= RIGHT / len(LAWS) * len(outcomes)
    return SUCCESS if enough else FAILURE


def _millimetres(length: float | None) -> float:
    return float("nan") if length is None else 1e3 * length


if __name__ == "__main__":
    raise SystemExit(main())
