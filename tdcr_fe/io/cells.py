"""Numbers in the cells of a table of texts."""

from __future__ import annotations

import math


def number(text: str) -> float:
    """A finite number, or NaN."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def whole_number(text: str) -> int | None:
    """A whole number, or None."""
    value = number(text)
    return int(value) if math.isfinite(value) and value == int(value) else None


def millimetres_hint(value: float, limit: float) -> str:
    """End of a message on a length [m] that would be within a limit [m] if it were in mm; empty if it would not."""
    return f"; {value / 1000.0:g} would fit, are these mm?" if abs(value) / 1000.0 <= limit else ""
