"""Slips within a substep as functions of load factor, mobilisations, and unknown tensions at the base.

Slips and turning angles are interpolated by load factor and tensions of the segments, between the ends of the substep
or states solved within it (`slip_interpolation`). How the tensions follow from mobilisations and angles is not
interpolated: it is the law of friction itself (`tension_transfer`). Documentation: page "Theory", section "Slips as
functions of the tensions".
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from tdcr_fe.elements.numbers import largest, largest_magnitude
from tdcr_fe.solve.friction_path.slip_interpolation import Interval, SlipData
from tdcr_fe.solve.friction_path.slip_state import SlipDerivatives, SlipState
from tdcr_fe.solve.friction_path.tension_transfer import CapstanTransfer, LawTransfer

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: Newton's method for tensions and turning angles that agree ends with the correction of an error below this fraction
#: of the largest tension: what it leaves is about the square of that [1].
NEAR_TENSION = 3e-3
#: And after so many corrections, with tensions that do not agree; it is then far from any solved state.
MOST_CORRECTIONS = 6


class SlipModel:
    """Slips as functions of load factor, mobilisations, and unknown tensions at the base.

    Parameters
    ----------
    transfer
        How tension passes along the tendons.
    states
        Slips in both ends of the substep, and in states within it, by load factor.
    holes, unknown
        Numbers of frictional holes and of unknown tensions at the base.
    presliding
        Presliding distance [m].
    defect_factor
        Factor on the parabola in the rates of the slips along the line between the tensions of two states, which leads
        from the values in the first to those in the second; other than 1 to see what is uncertain in it [1].

    Attributes
    ----------
    breakpoints : tuple of float
        Load factors within the substep up to which the slips are smooth, ascending; the last one is 1 [1].
    """

    def __init__(
        self,
        transfer: CapstanTransfer | LawTransfer,
        states: Sequence[SlipData],
        holes: int,
        unknown: int,
        presliding: float,
        defect_factor: float = 1.0,
    ) -> None:
        self._states, self._transfer, self._unknown = states, transfer, unknown
        self.presliding, self.holes = presliding, holes
        self._count = holes + unknown
        self._elastic_slip = np.append(np.full(holes, presliding), np.zeros(unknown))
        self._identity = np.eye(len(states[0].tension))
        self._intervals = [Interval.between(a, b, defect_factor) for a, b in pairwise(states)]
        self.breakpoints: tuple[float, ...] = tuple(at.factor for at in states[1:])

    @property
    def defect(self) -> Array:
        """Change of the slips beyond that by the mean of their rates at both ends of the first interval [m], (k,)."""
        return self._intervals[0].defect[: self.holes]

    @property
    def cubic_coefficient(self) -> float:
        """Largest coefficient of the cube of the load factor in the slips [m]."""
        return max(
            float(np.abs(own.coefficients[: self.holes, 3]).max()) / own.length**3 for own in self._intervals
        )

    def error_off_line(self, factors: Array, tensions: Array) -> Array:
        """Largest error of the slips by tensions off the straight line [m], shape (k,).

        Parameters
        ----------
        factors
            Load factors within the first interval [1], shape (p,).
        tensions
            Of the segments there [N], shape (p, q).
        """
        return self._intervals[0].error_off_line(factors, tensions, self.holes)

    def with_defect_factor(self, factor: float) -> SlipModel:
        """The same with another factor on the parabola in the rates."""
        return SlipModel(self._transfer, self._states, self.holes, self._unknown, self.presliding, factor)

    def through_every_other_state(self) -> SlipModel:
        """The same without every other state within the substep, of which there is an odd number."""
        return SlipModel(self._transfer, self._states[::2], self.holes, self._unknown, self.presliding)

    def regimes(self, z: Array, tension: Array) -> Flags | None:
        """Flags that change where the derivatives of the tensions jump; None where they never do."""
        return self._transfer.regimes(z, tension)

    def distance_to_regime_change(self, z: Array, rate: Array, tension: Array, tension_rate: Array) -> float:
        """Load factor from here to where these flags change at constant rates [1]; see `LawTransfer`."""
        return self._transfer.distance_to_regime_change(z, rate, tension, tension_rate)

    def at(self, factor: float, z: Array, tension: Array) -> SlipState:
        """Slips and their derivatives.

        Parameters
        ----------
        factor
            Load factor within the substep [1].
        z
            Mobilisations [1], then unknown tensions at the base [N], shape (n,).
        tension
            Of the segments, about [N], shape (q,).
        """
        n, interval = self._count, self._interval(factor)
        line = interval.at(factor)
        by_tension, turning = line.by_tension[:n], line.by_tension[n:]
        for _ in range(MOST_CORRECTIONS):
            angles = np.maximum(line.values[n:] + turning.dot(tension - line.tension), 0.0)
            transfer = self._transfer.at(factor, z, angles)
            matrix = transfer.by_angles(turning)
            np.subtract(self._identity, matrix, out=matrix)
            # LAPACK has matrices column by column: it takes the transposed one without a copy.
            lu, pivots, _ = dgetrf(matrix.T, overwrite_a=True)
            excess = transfer.tension - tension
            tension = tension + dgetrs(lu, pivots, excess, trans=1)[0]
            if largest_magnitude(excess) <= NEAR_TENSION * largest(tension):
                break
        off = tension - line.tension
        rate = interval.rates_at_fixed_tensions(line, off)
        slip = line.values[:n] + by_tension.dot(off)
        regimes = self._transfer.regimes(z, transfer.tension)
        derivatives = SlipDerivatives(
            transfer, rate[:n], by_tension, (lu, pivots), rate[n:], self._elastic_slip, regimes
        )
        return SlipState(tension, slip, derivatives)

    def complement_rates(
        self, factor: float, z: Array, tension: Array, rate: Array, near: SlipState
    ) -> Array | None:
        """Rates of the complements at given rates of the unknowns [m], shape (n,).

        None where derivatives have jumped since the load factor nearby, see `regimes`.

        Parameters
        ----------
        factor, z, tension
            As of `at`.
        rate
            Of the unknowns [1, N], shape (n,).
        near
            Slips at a load factor nearby, whose factorised derivatives of the tensions are used.
        """
        n, interval = self._count, self._interval(factor)
        line = interval.at(factor)
        turning, with_turning = line.by_tension[n:], near.derivatives.with_turning
        angles = np.maximum(line.values[n:] + turning.dot(tension - line.tension), 0.0)
        transfer = self._transfer.at(factor, z, angles)
        if near.left_regimes(self._transfer.regimes(z, transfer.tension)):
            return None
        off = tension + with_turning(transfer.tension - tension) - line.tension
        own = interval.rates_at_fixed_tensions(line, off)
        direct = transfer.by_angles(own[n:]) + transfer.by_load + transfer.by_unknowns(rate)
        tension_rate = with_turning(direct)
        # The factors are those of the state nearby: one correction with the turning here.
        tension_rate += with_turning(direct - tension_rate + transfer.by_angles(turning.dot(tension_rate)))
        return own[:n] + line.by_tension[:n].dot(tension_rate) - self._elastic_slip * rate

    def _interval(self, factor: float) -> Interval:
        return self._intervals[min(bisect_right(self.breakpoints, factor), len(self._intervals) - 1)]
