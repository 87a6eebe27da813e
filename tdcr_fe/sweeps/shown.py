"""Which results a report shows, and how columns are labelled."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tdcr_fe.sweeps.columns import ESTIMATES
from tdcr_fe.sweeps.result import SweepResult

_LENGTH = re.compile(r"(tip_[xyz]|tip_offset|displacement_.*|discretisation_error)(_step\d+)?")
_TENSION = re.compile(r"tension_.*")
_ANGLE = re.compile(r"(bending|chord)_angle_deg(_step\d+)?")
#: Results that are shown first.
_FIRST = ("bending_angle_deg", "tip_x", "tip_y", "tip_z", "tip_offset")


class Shown(NamedTuple):
    """How a column is shown.

    Attributes
    ----------
    label : str
    unit : str
        Empty where it is not known.
    factor : float
        From the table to this unit.
    """

    label: str
    unit: str
    factor: float

    @property
    def axis(self) -> str:
        """Label with the unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label


def shown(column: str) -> Shown:
    """Label, unit and factor of a column."""
    text = re.sub(r"_step(\d+)$", r", step \1", column).replace("_", " ")
    if _LENGTH.fullmatch(column):
        return Shown(text, "mm", 1e3)
    if _ANGLE.fullmatch(column):
        return Shown(text.replace(" deg", ""), "deg", 1.0)
    return Shown(text, "N" if _TENSION.fullmatch(column) else "", 1.0)


def shown_outputs(result: SweepResult) -> list[str]:
    """Results that vary: first those of the user's own function, then angle and tip, then the others.

    Directions and estimates come last; a column that repeats an input, or the size of a result before it, is left out.
    """
    built_in = _built_in(result)

    def rank(name: str) -> tuple[int, int]:
        stem = re.sub(r"_step\d+$", "", name)
        if name not in built_in:
            return 0, 0
        if stem in _FIRST:
            return 1, _FIRST.index(stem)
        return (3 if stem in ESTIMATES or stem.startswith("tangent") else 2), 0

    kept: list[str] = []
    for name in sorted(result.varying_outputs, key=rank):
        if not _repeats(result, name, (*result.inputs, *kept)):
            kept.append(name)
    return kept


def _built_in(result: SweepResult) -> set[str]:
    stems = "tip_|tangent_|bending_angle|chord_angle|tension_|displacement_|" + "|".join(ESTIMATES)
    return {n for n in result.outputs if re.match(stems, n)}


def _repeats(result: SweepResult, name: str, others: Sequence[str]) -> bool:
    values = result.cases[name].to_numpy(dtype=float)
    sound = np.isfinite(values)
    for other in others:
        column = result.cases[other]
        if column.dtype.kind in "fi":
            size = np.abs(column.to_numpy(dtype=float)[sound])
            if np.allclose(np.abs(values[sound]), size, rtol=1e-6, atol=0.0):
                return True
    return False
