"""Exit statuses of the commands, and how they speak on stderr."""

from __future__ import annotations

import sys

SOLVED, NOT_CONVERGED, WRONG_INPUT, INTERRUPTED = 0, 1, 2, 130


def complain(text: str) -> None:
    """Print one line on stderr, with the program's name."""
    print(f"tdcr-fe: {text}", file=sys.stderr)
