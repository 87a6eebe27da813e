"""A fitted number."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """One fitted number.

    Attributes
    ----------
    value : float
    std_error : float or None
        None where the data do not determine it (it keeps its null value) or it sits at a bound.
    unit : str
    note : str
        Such as "at its bound".
    """

    value: float
    std_error: float | None
    unit: str
    note: str = ""
