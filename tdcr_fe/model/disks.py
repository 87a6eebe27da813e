"""The rigid disks as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from tdcr_fe.model.schema import Quantity, check_fields

DiskCount = Annotated[int, Quantity("disks at equal distances, the last at the tip", ge=1, le=10_000)]


@dataclass(frozen=True)
class Disks:
    """Rigid disks on the backbone; the base plate at s = 0 is not one of them.

    Attributes
    ----------
    positions : tuple of float
        Arc lengths, ascending [m]. Empty: a robot without disks, whose tendons follow the backbone.
    mass : float
        Of each disk [kg].
    thickness : float
        Length of backbone that each disk makes rigid, centred on it [m].
    radius : float
        [m].
    """

    positions: Annotated[
        tuple[float, ...],
        Quantity(
            "arc lengths of the disks",
            unit="m",
            gt=0.0,
            allowed="arc lengths of the disks [m], at least one, ascending from above 0 to at most the length",
        ),
    ] = ()
    mass: Annotated[float, Quantity("of each disk", unit="kg", ge=0.0)] = 0.0
    thickness: Annotated[
        float, Quantity("length of backbone made rigid, centred on the disk", unit="m", ge=0.0)
    ] = 0.0
    radius: Annotated[float, Quantity("of the disks and of the base plate", unit="m", gt=0.0, le=1000.0)] = (
        5e-3
    )

    def __post_init__(self) -> None:
        check_fields(self)

    @classmethod
    def equally_spaced(cls, count: DiskCount, length: float, **rest: float) -> Disks:
        """``count`` disks at equal distances, the last at the tip."""
        positions = tuple(float(x) for x in length * np.arange(1, count + 1) / count)
        return cls(positions=positions, **rest)
