"""Exit statuses, whole-number arguments and messages on stderr, shared by all commands."""

from __future__ import annotations

import argparse
import sys

SUCCESS, FAILURE, WRONG_INPUT, INTERRUPTED = 0, 1, 2, 130


def complain(text: str) -> None:
    """Print one line on stderr, with the program's name."""
    print(f"tdcr-fe: {text}", file=sys.stderr)


def at_least_one(text: str) -> int:
    """A whole number from 1, as a type for `argparse`.

    Raises
    ------
    argparse.ArgumentTypeError
    """
    try:
        number = int(text)
    except ValueError:
        number = 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text!r}; must be a whole number, at least 1")
    return number


def count(n: int, noun: str) -> str:
    """A number with its noun, in the singular or the plural."""
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"
