"""The friction states within a substep as a path: segments over which all rates are constant."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.compiled import compilable
from tdcr_fe.solve.friction_path.rates import Bounds, bounded, sides

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class PathSegments(NamedTuple):
    """Parts of the substep over which the rates of all unknowns are constant; the arrays have one row a path segment.

    Unknowns are those of `tdcr_fe.solve.friction_path.rates`; load factors are those within the substep, 0 to 1.
    """

    start: Array  # (p,): Load factor where it begins, and by how much it grows in it [1]
    length: Array  # as `start`
    unknowns: Array  # (p, n): Where it begins
    side: Array  # (p, n): 1 or -1 where an unknown stays at its bound, 0 where it is free
    rate: Array  # (p, n): Of the unknowns [1, N]
    complement: Array  # (p, n): Of their complements [m]
    # (p, q): Tensions of the segments where it begins, and their derivative by the load factor [N]
    tension: Array
    tension_rate: Array  # as `tension`

    def first(self, count: int) -> PathSegments:
        """The first ones of them."""
        return PathSegments._make(own[:count] for own in self)


@compilable
def empty_path(count: int, unknowns: int, segments: int) -> PathSegments:
    """Arrays for so many path segments."""
    n, q = (count, unknowns), (count, segments)
    starts, by_unknown = (
        (np.empty(count), np.empty(count)),
        (np.empty(n), np.empty(n), np.empty(n), np.empty(n)),
    )
    return PathSegments(*starts, *by_unknown, np.empty(q), np.empty(q))


@compilable
def along_segment(path: PathSegments, i: int, length: float, bounds: Bounds) -> tuple[float, Array, Array]:
    """What is reached on a path segment after a change of the load factor.

    Parameters
    ----------
    path, i
        The path segments, and the number of the one.
    length
        Change of the load factor from its beginning on [1].
    bounds
        Of the unknowns.

    Returns
    -------
    factor : float
        Load factor there [1].
    unknowns : ndarray, shape (n,)
    tension : ndarray, shape (q,)
        Of the segments [N].
    """
    unknowns = bounded(bounds, path.unknowns[i] + length * path.rate[i])
    return path.start[i] + length, unknowns, path.tension[i] + length * path.tension_rate[i]


class PathReversal(NamedTuple):
    """A place on a path where slips reverse."""

    factor: float  # Load factor within the substep [1]
    reverses: Flags  # (k,): Whose slips reverse here
    side: Array  # (n,): Up to here, 1 or -1 where an unknown was at its bound, 0 where it was free
    # Which unknown comes to a bound here, or leaves that at which its tendon was slack, so that rates jump; -1 where
    # none does, and rates reverse through zero
    arrives: int


class FrictionPath(NamedTuple):
    """Friction states all through a substep, and where slips reversed last."""

    unknowns: Array  # (k + c,): Mobilisations at its end [1], and the unknown tensions at the base there [N]
    # (k,): Change of the slip from the start of the substep to its last reversal; zero where there is none [m]
    reversal_slip: Array
    # (k,): Mobilisation at the last reversal, 1 or -1; that at the start where there is none [1]
    reversal_mobilisation: Array
    # (k,): Load factor of the last reversal within the substep; zero where there is none [1]
    reversal_factor: Array
    complete: bool  # Whether the end of the substep was reached
    segments: PathSegments
    bounds: Bounds  # Of the unknowns

    @property
    def reversed(self) -> Flags:
        """Which slips reversed, shape (k,)."""
        return self.reversal_factor > 0.0

    def at(self, factor: float) -> tuple[Array, Array]:
        """Unknowns, shape (k + c,), and tensions of the segments [N], shape (q,), at a load factor [1]."""
        i = int(np.searchsorted(self.segments.start, factor, side="right")) - 1
        _, unknowns, tension = along_segment(self.segments, i, factor - self.segments.start[i], self.bounds)
        return unknowns, tension

    def reversals(self, sticks: Flags) -> list[PathReversal]:
        """Reversals on which the end of the substep depends, by load factor.

        The mobilisation of a hole that sticks counts from its last reversal; that of one that slips does not depend on
        where it reversed. At a reversal the slip depends on the holes that stick there in the same way.

        Parameters
        ----------
        sticks
            Which holes stick at the end, shape (k,).
        """
        k, segments = len(self.reversal_factor), self.segments
        side = segments.side
        turned = ((sides(self.bounds, segments.unknowns) != 0.0) & (side == 0.0))[:, :k] & self.reversed
        counts, found = sticks, []
        for i in range(len(side) - 1, 0, -1):
            here = turned[i] & counts
            if here.any():
                before, after = side[i - 1], side[i]
                changed = (before == 0.0) & (after != 0.0)
                changed[k:] |= (before[k:] != 0.0) & (after[k:] == 0.0)
                arrives = int(changed.argmax()) if changed.any() else -1
                found.append(PathReversal(float(segments.start[i]), here, before, arrives))
                counts = (counts & ~here) | (before[:k] == 0.0)
        return found[::-1]

    def insensitive_holes(self, error: Array, presliding: Array) -> Flags:
        """Holes whose mobilisation at the end does not depend on an error of the slips, shape (k,).

        They slip in one direction until the end, faster than the error changes, either throughout or far enough to
        leave nothing of their history.

        Parameters
        ----------
        error
            Error of the change of the slips in the substep [m], shape (k,). It is taken to grow like that of a parabola
            in the rates: at the rate ``6 x (1 - x)`` times the error, with the load factor ``x``.
        presliding
            Presliding distances [m], shape (k,).
        """
        k = len(error)
        start, length = self.segments.start, self.segments.length
        side, rate = self.segments.side[:, :k], self.segments.complement[:, :k]
        last = side[-1]
        # From which path segment on the hole slips in its last direction up to the end.
        final = np.logical_and.accumulate((side == last)[::-1])[::-1]
        distance = last * np.where(final, length[:, None] * rate, 0.0).sum(axis=0)
        # Where in each path segment the parabola is largest; that is at no end of the substep.
        at = np.clip(0.5, start, start + length)
        relative_rate = last * rate / (6.0 * at * (1.0 - at))[:, None]
        slowest = np.where(final, relative_rate, np.inf).min(axis=0)
        # From one bound of the mobilisation to the other nothing is left of what it was.
        forgotten = final[0] | (distance >= 2.0 * presliding + error)
        return np.asarray((last != 0.0) & (slowest >= error) & forgotten)
