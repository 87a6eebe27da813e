"""Compare what the program computes now with what is stored, and say what moved, by how much, and where."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from tdcr_fe.validation.net.parts import Record

#: Quantities in metres and newtons.
LARGE = ("positions", "displacements", "slips", "estimates", "tip_position", "tensions", "forces")
#: Their size below which they do not become the measure of their movements [m, N], and that of other quantities.
LARGE_SIZE, OTHER_SIZE = 0.1, 1e-3


class Difference(NamedTuple):
    """One quantity of one case that is not the stored one."""

    part: str
    case: str
    quantity: str
    step: int | None  # from 1, where the movement is largest
    place: str
    size: float  # of the movement over that of the quantity; infinite where a text or a shape has changed
    text: str
    tolerance: float

    @property
    def beyond(self) -> bool:
        """Whether it is more than the tolerance of its part."""
        return not self.size <= self.tolerance

    def __str__(self) -> str:
        at = "" if self.step is None else f", step {self.step}"
        place = f" {self.place}" if self.place else ""
        return f"{self.part} | {self.case}{at} | {self.quantity}{place} | {self.text}"


def differences(part: str, case: str, stored: Record, found: Record, tolerance: float) -> list[Difference]:
    """What differs between two records of a case, one difference a quantity."""
    moved = []
    for quantity in sorted({*stored, *found}):
        a, b = stored.get(quantity, "nothing"), found.get(quantity, "nothing")
        if isinstance(a, str) or isinstance(b, str):
            difference = _text(a, b)
        else:
            difference = _numbers(a, b, _size(quantity, a))
        if difference is not None:
            moved.append(Difference(part, case, quantity, *difference, tolerance))
    return moved


def _text(a: object, b: object) -> tuple[int | None, str, float, str] | None:
    """Difference of two texts, or of a text and numbers."""
    was, now = ((x if isinstance(x, str) else "numbers") for x in (a, b))
    if was == now and isinstance(a, str) and isinstance(b, str):
        return None
    steps = zip(was.split("/"), now.split("/"), strict=False)
    step = next((k for k, (x, y) in enumerate(steps, start=1) if x != y), None) if "/" in was else None
    if step is not None:
        was, now = was.split("/")[step - 1], now.split("/")[step - 1]
    return step, "", float("inf"), f"{was[:80]!r} is now {now[:80]!r}"


def _size(quantity: str, a: np.ndarray) -> float:
    """Of a quantity, to which its movements are compared."""
    least = LARGE_SIZE if quantity in LARGE else OTHER_SIZE
    return max(float(np.nanmax(np.abs(a), initial=0.0)), least)


def _numbers(a: np.ndarray, b: np.ndarray, size: float) -> tuple[int | None, str, float, str] | None:
    """Largest movement of numbers, and where it is."""
    if a.shape != b.shape:
        return None, "", float("inf"), f"shape {a.shape} is now {b.shape}"
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    if same.all():
        return None
    gap = np.where(same, 0.0, np.abs(a - b))
    gap[np.isnan(gap)] = np.inf
    at = np.unravel_index(int(gap.argmax()), gap.shape)
    step, place = int(at[0]) + 1, str([int(k) for k in at[1:]]) if len(at) > 1 else ""
    text = f"{a[at]:.12g} is now {b[at]:.12g}: moved by {gap[at] / size:.1e} of its size"
    return step, place, float(gap[at] / size), text


def report(cases: Mapping[str, int], moved: Sequence[Difference]) -> list[str]:
    """Counts by part, and the ten largest movements, in lines.

    Parameters
    ----------
    cases
        Number of cases that were compared, by part.
    moved
        All differences.
    """
    lines = [f"{'part':12} {'cases':>6} {'identical':>10} {'within tolerance':>17} {'beyond':>7}"]
    for part, count in cases.items():
        off = {d.case for d in moved if d.part == part and d.beyond}
        within = {d.case for d in moved if d.part == part} - off
        lines.append(f"{part:12} {count:6} {count - len(within) - len(off):10} {len(within):17} {len(off):7}")
    largest = sorted(moved, key=lambda d: -d.size / d.tolerance)
    shown = largest[:10]
    lines += map(str, shown)
    if len(largest) > len(shown):
        kinds = Counter(f"{d.part} {d.quantity}" for d in largest)
        lines.append(f"{len(largest)} in all: " + ", ".join(f"{n} {k}" for k, n in kinds.most_common(12)))
    return lines
