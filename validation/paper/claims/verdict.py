"""Verdict on one claim of the paper."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Verdict:
    """Verdict on one claim.

    Attributes
    ----------
    claim : str
        As the paper has it.
    verdict : str
        "holds", "holds in part", "does not hold", "not found", "matters", "matters little".
    evidence : str
        The numbers.
    reason : str
        Explanation.
    """

    claim: str
    verdict: str
    evidence: str
    reason: str


def word(hits: int, count: int) -> str:
    """Verdict on a claim that is true in some of the states."""
    if hits == count:
        return "holds"
    return "does not hold" if 3 * hits < count else "holds in part"
