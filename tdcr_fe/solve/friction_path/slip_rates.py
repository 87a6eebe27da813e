"""Rates of mobilisations, slips and tensions at one load factor, and the distance to the next event.

Unknowns ``z`` and their complements ``w`` are those of `tdcr_fe.solve.friction_path.unknowns`. Inside the bounds of
``z`` the complement is constant, at the upper bound it can only grow, at the lower one only fall. Its derivative by the
load factor is ``load - matrix z'``. Documentation: page "Theory", section "Finding reversals".
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgesv, dgetrs

from tdcr_fe.elements.complementarity import PivotRule
from tdcr_fe.elements.numbers import smallest
from tdcr_fe.solve.friction_path.unknowns import Bounds

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Index = NDArray[np.int_]
_BOTH_SIDES = np.array([[1.0], [-1.0]])
_NO_COLUMNS: Array = np.zeros((0, 0))


class LinearRates(NamedTuple):
    """Derivatives by the load factor that are linear in it, from one load factor on.

    Attributes
    ----------
    side : ndarray, shape (n,)
        1 or -1 where an unknown stays at its bound, 0 where it is free.
    rate, rate_change : ndarray, shape (n,)
        Rates of the unknowns [1, N], and the derivatives of these; zero at bounds.
    complement, complement_change : ndarray, shape (n,)
        Rates of the complements [m], and the derivatives of these; zero up to round-off where unknowns are free.
    """

    side: Array
    rate: Array
    rate_change: Array
    complement: Array
    complement_change: Array


class Rates(NamedTuple):
    """Rates at one load factor that satisfy the conditions of complementarity.

    Attributes
    ----------
    side, rate, complement
        As in `LinearRates`.
    free : ndarray of int, shape (f,)
        Unknowns inside their bounds.
    columns : ndarray, shape (n, f)
        Of the matrix, for these.
    factors : tuple, or None
        LU factors of the free rows of the columns, and pivots; None where no unknown is free.
    """

    side: Array
    rate: Array
    complement: Array
    free: Index
    columns: Array
    factors: tuple[Array, Index] | None

    def linear(self, slope: Array | None) -> LinearRates:
        """The rates with their derivatives.

        Parameters
        ----------
        slope
            Derivative of ``load - matrix z'`` by the load factor at constant ``z'`` [m], shape (n,); None is zero.
        """
        if slope is None:
            still = np.zeros(len(self.rate))
            return LinearRates(self.side, self.rate, still, self.complement, still)
        if self.factors is None:
            return LinearRates(self.side, self.rate, self.rate, self.complement, slope)
        of_free = dgetrs(*self.factors, slope[self.free])[0]
        change = np.zeros(len(slope))
        change[self.free] = of_free
        return LinearRates(self.side, self.rate, change, self.complement, slope - self.columns.dot(of_free))


def solve_rates(
    columns: Callable[[Index], Array],
    load: Array,
    side: Array,
    fixed: Flags | None,
    scale: Array,
    tolerance: float,
) -> Rates | None:
    """Rates at a load factor; None where no consistent ones were found.

    A complementarity problem: an unknown at its bound stays there while its complement moves in the direction of the
    bound, or leaves it. Block principal pivoting as in `tdcr_fe.elements.complementarity.solve_box`.

    Parameters
    ----------
    columns
        Gives columns of the matrix by their numbers, shape (n, f).
    load
        Rates of the complements at constant unknowns [m], shape (n,).
    side
        At which bounds the unknowns are, see `Bounds.side`, shape (n,).
    fixed
        Which unknowns stay at their bounds in any case, because the tendon has slack, shape (n,); None where there are
        none.
    scale
        From the unknowns to lengths [m, m/N], shape (n,).
    tolerance
        Rates of the complements, and of the unknowns as lengths, below it are zero [m].
    """
    count, active = len(side), side
    rule = PivotRule(count)
    for _ in range(30 + 10 * count):
        free = (active == 0.0).nonzero()[0]
        rate = np.zeros(count)
        factors: tuple[Array, Index] | None = None
        complement, own = load, _NO_COLUMNS
        if free.size:
            own = columns(free)
            lu, pivots, found, singular = dgesv(rows_of(own, free), load[free], overwrite_a=True)
            if singular:
                return None
            rate[free], factors = found, (lu, pivots)
            complement = load - own.dot(found)
        violated = active * complement < -tolerance
        if fixed is not None:
            violated &= ~fixed
        outward = None
        if active is not side:
            # Those that left their bounds must move inward.
            outward = side * scale * rate > tolerance
            violated |= outward
        number = int(np.count_nonzero(violated))
        if number == 0:
            return Rates(active, rate, complement, free, own, factors)
        violated = rule.exchanged(violated, number)
        back = 0.0 if outward is None else np.where(outward, side, 0.0)
        active = np.where(violated, back, active)
    return None


def rows_of(columns: Array, which: Index) -> Array:
    """Some rows of columns that lie in memory one after the other, column by column as LAPACK has matrices."""
    return columns.T.take(which, axis=1).T


def distance_to_bound(rates: Rates, z: Array, bounds: Bounds) -> float:
    """Load factor from here to where a free unknown reaches a bound, at constant rates [1]; infinite if none does."""
    free = rates.free
    if not free.size:
        return np.inf
    rate = rates.rate[free]
    bound = np.where(rate > 0.0, bounds.upper[free], bounds.lower[free])
    return smallest(np.abs((bound - z[free]) / rate))


def distance_to_curved_bound(rates: LinearRates, free: Index, z: Array, bounds: Bounds) -> float:
    """As `distance_to_bound`, at rates that are linear in the load factor [1]."""
    if not free.size:
        return np.inf
    # z + a h + b h^2 / 2 meets a bound: the root at which it is crossed outward.
    here = z[free]
    gap = np.array((bounds.upper[free] - here, here - bounds.lower[free]))
    outward = rates.rate[free] * _BOTH_SIDES
    discriminant = outward * outward + (2.0 * gap) * (rates.rate_change[free] * _BOTH_SIDES)
    speed = outward + np.sqrt(np.maximum(discriminant, 0.0))
    ahead = (discriminant >= 0.0) & (speed > 0.0)
    return 2.0 * smallest(np.divide(gap, speed, out=np.full(gap.shape, np.inf), where=ahead))


def distance_to_reversal(rates: LinearRates, tolerance: float, holes: int) -> float:
    """Load factor from here to where the slip of a hole at its bound reverses [1]; infinite if none does.

    Parameters
    ----------
    rates
        From here on.
    tolerance
        Rates of slip below it are zero [m].
    holes
        Number of holes, which are the first unknowns.
    """
    side = rates.side[:holes]
    fall = -side * rates.complement_change[:holes]
    rate = np.maximum(side * rates.complement[:holes] + tolerance, 0.0)
    return float(np.divide(rate, fall, out=np.full(holes, np.inf), where=fall > 0.0).min(initial=np.inf))


def distance_to_tautness(rates: LinearRates, slack: Array, holes: int) -> float:
    """Load factor from here to where the slack of a tendon vanishes [1]; infinite if none does.

    Parameters
    ----------
    rates
        From here on.
    slack
        Of the tendons [m], shape (n - holes,).
    holes
        Number of holes, which are the first unknowns.
    """
    closing, change = rates.complement[holes:], 2.0 * rates.complement_change[holes:]
    discriminant = closing * closing + change * slack
    speed = closing + np.sqrt(np.maximum(discriminant, 0.0))
    ahead = (discriminant >= 0.0) & (speed > 0.0) & (slack > 0.0)
    return 2.0 * float(
        np.divide(slack, speed, out=np.full(slack.shape, np.inf), where=ahead).min(initial=np.inf)
    )
