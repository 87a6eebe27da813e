"""The command ``python -m tdcr_fe.validation.cut_steps``: load steps of random robots as a whole and cut in parts."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import numpy as np

from tdcr_fe.commands.common import FAILURE, SUCCESS, at_least_one
from tdcr_fe.validation.cut_steps import ALLOWED, Difference, differences
from tdcr_fe.validation.random_robots.drawing import MOST_TENDONS, draw


def main(argv: Sequence[str] | None = None) -> int:
    """Compare and print; 0 where no difference beyond `ALLOWED` goes unsaid, else 1."""
    parser = argparse.ArgumentParser(
        prog="python -m tdcr_fe.validation.cut_steps",
        description="Solve histories of random robots with their load steps as a whole and cut in parts, at one "
        "element a bay, and compare the positions of all nodes.",
    )
    parser.add_argument("-n", type=at_least_one, default=200, metavar="COUNT", help="number of robots (200)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="first seed looked at (0)")
    parser.add_argument("--parts", type=at_least_one, default=64, help="parts of each step (64)")
    counts = range(1, MOST_TENDONS + 1)
    parser.add_argument(
        "--tendons", type=int, nargs="+", default=[3, 6], choices=counts, help="numbers of tendons (3 6)"
    )
    args = parser.parse_args(argv)
    found: list[Difference] = []
    number = args.first
    for _ in range(args.n):
        while 1 + number % MOST_TENDONS not in args.tendons:
            number += 1
        new = differences(draw(number), args.parts)
        worst = max(new, key=lambda d: d.moved)
        print(f"robot {number}: {len(new)} steps, at most {worst.moved:.1e} of the length", flush=True)
        found, number = found + new, number + 1
    moved = np.array([d.moved for d in found])
    unsaid = [d for d in found if d.moved > ALLOWED and not d.reported]
    print(
        f"{args.n} robots, {len(found)} load steps cut in {args.parts}: median {np.median(moved):.1e}, largest "
        f"{moved.max():.1e} of the length; beyond {ALLOWED:g} and unsaid: {len(unsaid)}"
    )
    for each in unsaid:
        print(f"  robot {each.number}, step {each.step}: {each.moved:.1e}")
    return FAILURE if unsaid else SUCCESS


if __name__ == "__main__":
    sys.exit(main())
