"""How far a model is from the readings, the noise of these, and tests of what is left."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Misfit:
    """How far a model is from the readings.

    Attributes
    ----------
    rms_position, max_position : float or None
        Distance between measured and predicted markers in space, over all markers and steps [m]; of a marker of
        which not all three coordinates were measured, those that were. None where there are none.
    rms_coordinate : float or None
        Of single position coordinates, over all markers, axes and steps [m]; `rms_position` over the square root of
        three where all three coordinates were measured.
    rms_angle : float or None
        [rad].
    rms_by_quantity : mapping of str to float
        Root mean square by measured quantity, in the unit of the quantity, such as "position_x" [m].
    chi2_per_dof : float
        Sum of squares in units of sigma over the number of readings less fitted parameters [1].
    count : int
        Readings.
    """

    rms_position: float | None
    rms_angle: float | None
    max_position: float | None
    chi2_per_dof: float
    count: int = 0
    rms_coordinate: float | None = None
    rms_by_quantity: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, float | None]:
        """As in ``result.json``."""
        return {
            "rms_position": self.rms_position,
            "rms_angle": self.rms_angle,
            "max_position": self.max_position,
            "chi2_per_dof": self.chi2_per_dof,
        }


#: Of a model that was not evaluated, for want of time.
NOT_EVALUATED = Misfit(None, None, None, math.nan)


@dataclass(frozen=True)
class Noise:
    """Noise of the measurement that misfits are compared with; from sigma, given or estimated.

    Attributes
    ----------
    rms_position, rms_coordinate, rms_angle : float or None
        What the noise alone gives for the measures of `Misfit` of the same names [m, m, rad].
    rms_by_quantity : mapping of str to float
        Root mean square of sigma by measured quantity, in its unit.
    estimated : bool
        Whether any sigma was not given, and so estimated.
    """

    rms_position: float | None
    rms_coordinate: float | None
    rms_angle: float | None
    rms_by_quantity: Mapping[str, float]
    estimated: bool


@dataclass(frozen=True)
class Structure:
    """One test of whether a residual is noise.

    Attributes
    ----------
    group : str
        Which readings, or which kind of pattern.
    statistic : float
        In standard deviations of what noise would give [1].
    p_value : float
        Chance of as much from noise alone [1].
    """

    group: str
    statistic: float
    p_value: float
