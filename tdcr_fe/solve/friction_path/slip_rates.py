"""Rates of mobilisations, slips and tensions at one load factor, and the distance to the next event.

The unknowns ``z`` are the mobilisations of holes, in [-1, 1], and the tensions of tendons driven by displacement, from
0 on. To each belongs an excess that is constant while the unknown is inside its bounds: of the slip over that of the
mobilisation, and minus the slack of the tendon. Its rate is ``load - matrix z'``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgesv, dgetrs

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Index = NDArray[np.int_]
_BOTH = np.array([[1.0], [-1.0]])
_NO_COLUMNS: Array = np.zeros((0, 0))


class Bounds(NamedTuple):
    """Bounds of the unknowns.

    Attributes
    ----------
    lower, upper : ndarray, shape (n,)
        Bounds.
    near_lower, near_upper : ndarray, shape (n,)
        Values beyond which an unknown counts as at its bound.
    """

    lower: Array
    upper: Array
    near_lower: Array
    near_upper: Array

    @classmethod
    def of(cls, lower: Array, upper: Array, near: Array) -> Bounds:
        """With the distance from a bound that counts as none."""
        return cls(lower, upper, lower + near, upper - near)

    def side(self, z: Array) -> Array:
        """1 at the upper bounds, -1 at the lower ones, 0 inside, shape (n,)."""
        at_upper: Array = (z >= self.near_upper).astype(float)
        at_upper -= z <= self.near_lower
        return at_upper


class Motion(NamedTuple):
    """Rates from a load factor on, linear in it.

    Attributes
    ----------
    side : ndarray, shape (n,)
        1 or -1 where an unknown stays at its bound, 0 where it is free.
    rate, rate_change : ndarray, shape (n,)
        Rates of the unknowns and their derivatives; zero at bounds.
    excess, excess_change : ndarray, shape (n,)
        Rates of the excess, and their derivatives; zero up to round-off where unknowns are free.
    """

    side: Array
    rate: Array
    rate_change: Array
    excess: Array
    excess_change: Array


class Rates(NamedTuple):
    """Rates that satisfy the conditions of complementarity.

    Attributes
    ----------
    side, rate, excess
        As in `Motion`.
    free : ndarray of int
        Unknowns inside their bounds.
    columns : ndarray, shape (n, free)
        Of the matrix.
    factors : tuple, or None
        LU factors of its free part, and pivots; None where no unknown is free.
    """

    side: Array
    rate: Array
    excess: Array
    free: NDArray[np.int_]
    columns: Array
    factors: tuple[Array, NDArray[np.int_]] | None

    def motion(self, slope: Array | None) -> Motion:
        """With their derivatives, from that of ``load - matrix z'`` at constant rates, shape (n,); None is zero."""
        if slope is None:
            still = np.zeros(len(self.rate))
            return Motion(self.side, self.rate, still, self.excess, still)
        if self.factors is None:
            return Motion(self.side, self.rate, self.rate, self.excess, slope)
        more = dgetrs(*self.factors, slope[self.free])[0]
        change = np.zeros(len(slope))
        change[self.free] = more
        return Motion(self.side, self.rate, change, self.excess, slope - self.columns @ more)


def solve_rates(
    columns: Callable[[Index], Array],
    load: Array,
    side: Array,
    open_: Flags | None,
    scale: Array,
    tolerance: float,
) -> Rates | None:
    """Rates at a load factor; None where no consistent ones were found.

    A complementarity problem: an unknown at its bound stays there, its excess growing in the direction of the bound, or
    leaves it. Block principal pivoting as in `tdcr_fe.elements.complementarity.solve_box`.

    Parameters
    ----------
    columns
        Gives columns of the matrix, shape (n, i).
    load
        Shape (n,).
    side
        At which bounds the unknowns are, see `Bounds.side`.
    open_
        Which unknowns cannot leave their bounds now, because the tendon has slack; None where there are none.
    scale
        From the unknowns to lengths, shape (n,).
    tolerance
        Rates of the excess, and of the unknowns as lengths, below it are zero.
    """
    count, active = len(side), side
    best, patience = count + 1, 3
    for _ in range(30 + 10 * count):
        free = (active == 0.0).nonzero()[0]
        rate = np.zeros(count)
        factors: tuple[Array, NDArray[np.int_]] | None = None
        excess, own = load, _NO_COLUMNS
        if free.size:
            own = columns(free)
            lu, pivots, found, singular = dgesv(own[free], load[free], overwrite_a=True)
            if singular:
                return None
            rate[free], factors = found, (lu, pivots)
            excess = load - own @ found
        broken = active * excess < -tolerance
        if open_ is not None:
            broken &= ~open_
        outward = None
        if active is not side:
            # Those that left their bounds must move inward.
            outward = side * scale * rate > tolerance
            broken |= outward
        number = int(np.count_nonzero(broken))
        if number == 0:
            return Rates(active, rate, excess, free, own, factors)
        if number < best:
            best, patience = number, 3
        elif patience > 0:
            patience -= 1
        else:
            first = broken.argmax()
            broken = np.zeros(count, dtype=bool)
            broken[first] = True
        back = 0.0 if outward is None else np.where(outward, side, 0.0)
        active = np.where(broken, back, active)
    return None


def distance_to_bound(rates: Rates, z: Array, bounds: Bounds) -> float:
    """Distance to where a free unknown reaches a bound at constant rates; infinite where none does."""
    free = rates.free
    if not free.size:
        return np.inf
    pace = rates.rate[free]
    bound = np.where(pace > 0.0, bounds.upper[free], bounds.lower[free])
    return float(np.abs((bound - z[free]) / pace).min())


def distance_to_curved_bound(motion: Motion, free: Index, z: Array, bounds: Bounds) -> float:
    """The same at rates that are linear in the load factor."""
    if not free.size:
        return np.inf
    # z + a h + b h^2 / 2 meets a bound: the root at which it is crossed outward.
    here = z[free]
    gap = np.array((bounds.upper[free] - here, here - bounds.lower[free]))
    pace = motion.rate[free] * _BOTH
    inner = pace * pace + (2.0 * gap) * (motion.rate_change[free] * _BOTH)
    speed = pace + np.sqrt(np.maximum(inner, 0.0))
    ahead = (inner >= 0.0) & (speed > 0.0)
    return 2.0 * float(np.divide(gap, speed, out=np.full(gap.shape, np.inf), where=ahead).min())


def distance_to_reversal(motion: Motion, tolerance: float, holes: int) -> float:
    """Distance to where the slip at a hole at its bound reverses; infinite where none does."""
    side = motion.side[:holes]
    fall = -side * motion.excess_change[:holes]
    rate = np.maximum(side * motion.excess[:holes] + tolerance, 0.0)
    return float(np.divide(rate, fall, out=np.full(holes, np.inf), where=fall > 0.0).min(initial=np.inf))


def distance_to_closing(motion: Motion, slack: Array, holes: int) -> float:
    """Distance to where the slack of a tendon vanishes; infinite where none does.

    Parameters
    ----------
    motion
        The rates.
    slack
        Of the tendons [m], shape (n - holes,).
    holes
        Number of holes among the unknowns.
    """
    pace, bend = motion.excess[holes:], 2.0 * motion.excess_change[holes:]
    inner = pace * pace + bend * slack
    speed = pace + np.sqrt(np.maximum(inner, 0.0))
    ahead = (inner >= 0.0) & (speed > 0.0) & (slack > 0.0)
    return 2.0 * float(
        np.divide(slack, speed, out=np.full(slack.shape, np.inf), where=ahead).min(initial=np.inf)
    )
