"""Prints the table: ``python -m tdcr_fe.validation.public_codes [--cases 40]``."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from tdcr_fe.validation.public_codes.comparison import HEAD, compare_all, format_row


def main() -> int:
    """Print one row a robot, then the largest deviation by tendon path."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=40, help="number of robots (default 40)")
    parser.add_argument("--first", type=int, default=0, help="first seed (default 0)")
    arguments = parser.parse_args()
    print(HEAD, flush=True)
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for c in compare_all(range(arguments.first, arguments.first + arguments.cases), Path(folder)):
            found.append(c)
            print(format_row(c), flush=True)
    for path in ("straight", "continuous"):
        worst = max((c.deviation for c in found if c.case.path == path), default=0.0)
        print(f"{path}: at most {100.0 * worst:.5f} % of the length")
    failed = [c.case.number for c in found if not c.passed]
    print(
        f"{len(found) - len(failed)} of {len(found)} passed" + (f"; failed: seeds {failed}" if failed else "")
    )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
