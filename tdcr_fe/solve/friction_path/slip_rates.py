"""Rates of mobilisations, slips and tensions at one load factor, and the distance to the next event.

Unknowns ``z`` and their complements ``w`` are those of `tdcr_fe.solve.friction_path.unknowns`. Inside the bounds of
``z`` the complement is constant, at the upper bound it can only grow, at the lower one only fall. Its derivative by the
load factor is ``load - matrix z'``. Documentation: page "Theory", section "Finding reversals".
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.compiled import compilable
from tdcr_fe.elements.complementarity import MOST_IDLE_BLOCKS, exchanged
from tdcr_fe.elements.numbers import smallest
from tdcr_fe.solve.friction_path.slip_state import SlipDerivatives, columns_of
from tdcr_fe.solve.friction_path.small_systems import (
    Factors,
    factorised,
    no_factors,
    solved_transposed,
    some_columns,
)
from tdcr_fe.solve.friction_path.unknowns import Bounds

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Index = NDArray[np.int_]


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
    found : bool
        Whether there are such; the rest means nothing where not.
    side, rate, complement
        As in `LinearRates`.
    free : ndarray of int, shape (f,)
        Unknowns inside their bounds.
    columns : ndarray, shape (f, n)
        Of the matrix, for these, one a row.
    factors : Factors
        Of the matrix of the free unknowns, transposed.
    """

    found: bool
    side: Array
    rate: Array
    complement: Array
    free: Index
    columns: Array
    factors: Factors


@compilable
def constant_rates(rates: Rates) -> LinearRates:
    """The rates with derivatives that are zero."""
    still = np.zeros(len(rates.rate))
    return LinearRates(rates.side, rates.rate, still, rates.complement, still)


@compilable
def linear_rates(rates: Rates, slope: Array) -> LinearRates:
    """The rates with their derivatives.

    Parameters
    ----------
    rates
        The rates.
    slope
        Derivative of ``load - matrix z'`` by the load factor at constant ``z'`` [m], shape (n,).
    """
    change, complement_change = np.zeros(len(slope)), slope
    if rates.free.size:
        of_free = solved_transposed(rates.factors, slope[rates.free])
        change[rates.free] = of_free
        complement_change = slope - of_free.dot(rates.columns)
    return LinearRates(rates.side, rates.rate, change, rates.complement, complement_change)


@compilable
def solve_rates(
    derivatives: SlipDerivatives, side: Array, fixed: Flags, scale: Array, tolerance: float
) -> Rates:
    """Rates at a load factor.

    A complementarity problem: an unknown at its bound stays there while its complement moves in the direction of the
    bound, or leaves it. Block principal pivoting as in `tdcr_fe.elements.complementarity.solve_box`.

    Parameters
    ----------
    derivatives
        Of the slips at this load factor.
    side
        At which bounds the unknowns are, see `sides`, shape (n,).
    fixed
        Which unknowns stay at their bounds in any case, because the tendon has slack, shape (n,), or (0,) for none.
    scale
        From the unknowns to lengths [m, m/N], shape (n,).
    tolerance
        Rates of the complements, and of the unknowns as lengths, below it are zero [m].
    """
    count, load = len(side), derivatives.by_load
    active, back, pivoted = side, np.zeros(count), False
    fewest, idle_left = count + 1, MOST_IDLE_BLOCKS
    for _ in range(30 + 10 * count):
        free = (active == 0.0).nonzero()[0]
        rate, complement = np.zeros(count), load
        columns, factors = derivatives.columns[:0], no_factors()
        if free.size:
            columns = columns_of(derivatives, free)
            factors = factorised(some_columns(columns, free))
            if factors.singular:
                return Rates(False, active, rate, complement, free, columns, factors)
            of_free = solved_transposed(factors, load[free])
            rate[free] = of_free
            complement = load - of_free.dot(columns)
        violated = active * complement < -tolerance
        if fixed.size:
            violated &= ~fixed
        if pivoted:
            # Those that left their bounds must move inward.
            outward = side * scale * rate > tolerance
            violated |= outward
            back = np.where(outward, side, 0.0)
        number = int(np.count_nonzero(violated))
        if number == 0:
            return Rates(True, active, rate, complement, free, columns, factors)
        violated, fewest, idle_left = exchanged(violated, number, fewest, idle_left)
        active, pivoted = np.where(violated, back, active), True
    return Rates(False, active, rate, complement, free, columns, factors)


@compilable
def distance_to_bound(rates: Rates, z: Array, bounds: Bounds) -> float:
    """Load factor from here to where a free unknown reaches a bound, at constant rates [1]; infinite if none does."""
    free = rates.free
    if not free.size:
        return np.inf
    rate = rates.rate[free]
    bound = np.where(rate > 0.0, bounds.upper[free], bounds.lower[free])
    return smallest(np.abs((bound - z[free]) / rate))


@compilable
def distance_to_curved_bound(rates: LinearRates, free: Index, z: Array, bounds: Bounds) -> float:
    """As `distance_to_bound`, at rates that are linear in the load factor [1]."""
    if not free.size:
        return np.inf
    # z + a h + b h^2 / 2 meets a bound: the root at which it is crossed outward.
    here, outward, gap = z[free], np.empty((2, free.size)), np.empty((2, free.size))
    gap[0], gap[1] = bounds.upper[free] - here, here - bounds.lower[free]
    outward[0] = rates.rate[free]
    outward[1] = -outward[0]
    change = 2.0 * rates.rate_change[free] * gap
    change[1] *= -1.0
    discriminant = outward * outward + change
    speed = outward + np.sqrt(np.maximum(discriminant, 0.0))
    ahead = (discriminant >= 0.0) & (speed > 0.0)
    return 2.0 * smallest(np.where(ahead, gap / speed, np.inf))


@compilable
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
    return smallest(np.where(fall > 0.0, rate / fall, np.inf)) if holes else np.inf


@compilable
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
    return 2.0 * smallest(np.where(ahead, slack / speed, np.inf))
