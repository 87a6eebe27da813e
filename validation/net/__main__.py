"""The command ``python -m tdcr_fe.validation.net``: compares the program with the stored net, or stores it anew."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from tdcr_fe.validation.net.comparison import compare
from tdcr_fe.validation.net.parts import PARTS
from tdcr_fe.validation.net.storage import store


def main(argv: Sequence[str] | None = None) -> int:
    """Compare or store.

    Parameters
    ----------
    argv
        Arguments without the program's name; None takes those of the process.

    Returns
    -------
    int
        Exit status: 0 nothing moved beyond its tolerance, 1 something did.
    """
    parser = argparse.ArgumentParser(
        prog="python -m tdcr_fe.validation.net",
        description="Compare what the program computes with what is stored; say what moved, by how much, and where.",
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)} (all)")
    parser.add_argument("--folder", default="tests/net", help="of the stored files (tests/net)")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="only every N-th case (1)")
    parser.add_argument("--quick", action="store_true", help="a few cases of every part, within 90 s")
    parser.add_argument("--largest", type=int, default=10, metavar="N", help="movements to print (10)")
    parser.add_argument("--processes", type=int, default=1, help="number of cases at a time (1)")
    parser.add_argument("--store", action="store_true", help="store the parts instead of comparing them")
    args = parser.parse_args(argv)
    parts = args.parts or list(PARTS)
    unknown = [part for part in parts if part not in PARTS]
    if unknown:
        parser.error(f"no part {unknown[0]!r}; there are {', '.join(PARTS)}")
    if args.store:
        store(parts, Path(args.folder), args.processes)
        return 0
    every = None if args.quick else args.every
    found = compare(parts, Path(args.folder), every=every, processes=args.processes)
    print("\n".join(found.lines(args.largest)))
    return 0 if found.passed else 1


if __name__ == "__main__":
    raise SystemExit(main())
