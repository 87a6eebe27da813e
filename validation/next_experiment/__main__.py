"""The command ``python -m tdcr_fe.validation.next_experiment``: whether it separates two explanations."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence

from tdcr_fe.commands.common import FAILURE, SUCCESS, at_least_one


def main(argv: Sequence[str] | None = None) -> int:
    """Run sets until so many ambiguous ones were found, and print what became of each.

    Parameters
    ----------
    argv
        Arguments without the program's name; None takes those of the process.

    Returns
    -------
    int
        Exit status: 0 nine tenths of the ambiguous sets were separated, 1 fewer were.
    """
    parser = argparse.ArgumentParser(
        prog="python -m tdcr_fe.validation.next_experiment",
        description="Simulate readings that two effects explain alike, choose the next experiment, simulate it, add "
        "it, and see whether one effect is left.",
    )
    parser.add_argument(
        "-n", type=at_least_one, default=10, metavar="COUNT", help="sets with two explanations (10)"
    )
    args = parser.parse_args(argv)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

    from tdcr_fe.validation.next_experiment.sets import AMBIGUITIES, Outcome, run_set

    outcomes: list[Outcome] = []
    for which in AMBIGUITIES:
        if len(outcomes) == args.n:
            break
        name = f"{which.truth} or {which.rival}, {which.robot}"
        outcome = run_set(which)
        if not outcome.ambiguous:
            print(f"{name}: the first readings decide", flush=True)
            continue
        outcomes.append(outcome)
        said = "separated" if outcome.separated else "not separated"
        print(
            f"{name}: {said}; {outcome.expected:.1f} sigma expected, difference of BIC {outcome.difference:.0f}",
            flush=True,
        )
    separated = sum(o.separated for o in outcomes)
    print(f"{separated} of {len(outcomes)} sets with two explanations are separated")
    return SUCCESS if outcomes and separated >= 0.9 * len(outcomes) else FAILURE


if __name__ == "__main__":
    raise SystemExit(main())
