"""Slips between solved states, as functions of load factor, mobilisations and tensions at the base.

With the configuration eliminated, slips and turning angles are smooth functions of the load factor and of the tensions
of all segments. Their derivatives change little within a substep and are interpolated between its ends, or between
states solved within it. How tensions
follow from mobilisations and angles is not interpolated: it is the law of friction itself (`tension_transfer`).
Derivation: documentation, page "Theory".
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from tdcr_fe.solve.friction_path.tension_transfer import CapstanTransfer, LawTransfer, Transfer

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Index = NDArray[np.int_]

#: Corrections of the tensions above this fraction of the largest are followed by another; and their largest number [1].
NEAR_TENSION, MOST_ROUNDS = 3e-3, 6


class End(NamedTuple):
    """An end of a substep, or a state within it.

    Attributes
    ----------
    factor : float
        Load factor within the substep [1].
    tension : ndarray, shape (q,)
        Of the segments [N].
    values : ndarray, shape (k + c + r,)
        Slips at the frictional holes, minus the slack of tendons whose tension at the base is unknown [m], turning
        angles [rad].
    by_tension : ndarray, shape (k + c + r, q)
        Their derivatives by the tensions of the segments.
    by_load : ndarray, shape (k + c + r,)
        Those by the load factor at fixed tensions.
    """

    factor: float
    tension: Array
    values: Array
    by_tension: Array
    by_load: Array


class _Interval(NamedTuple):
    """Values between two solved states, and their derivatives, as polynomials of the load factor.

    Attributes
    ----------
    start, length : float
        Of the interval [1].
    tension, tension_rate : ndarray, shape (q,)
        Along a straight line between those of the states [N].
    cubic : ndarray, shape (k + c + r, 4)
        Coefficients of the values along this line, by the fraction of the interval.
    response, response_change : ndarray, shape (k + c + r, q)
        Derivatives by the tensions at its start, and their change.
    shift : float
        Factor on a parabola in that change [1].
    """

    start: float
    length: float
    tension: Array
    tension_rate: Array
    cubic: Array
    response: Array
    response_change: Array
    shift: float

    @classmethod
    def between(cls, first: End, last: End, bulge: float) -> _Interval:
        """Between two states; see `SlipModel` for the factor on the parabola."""
        length, change = last.factor - first.factor, last.tension - first.tension
        slopes = [length * at.by_load + at.by_tension @ change for at in (first, last)]
        beyond = bulge * (last.values - first.values - 0.5 * (slopes[0] + slopes[1]))
        square = 0.5 * (slopes[1] - slopes[0]) + 3.0 * beyond
        return cls(
            first.factor,
            length,
            first.tension,
            change / length,
            np.stack((first.values, slopes[0], square, -2.0 * beyond), axis=1),
            first.by_tension,
            last.by_tension - first.by_tension,
            bulge - 1.0,
        )

    def at(self, factor: float) -> tuple[Array, Array, Array, Array]:
        """Tensions on the straight line, values there and their rates, and their derivatives by the tensions."""
        x = (factor - self.start) / self.length
        both = self.cubic @ np.array(((1.0, 0.0), (x, 1.0), (x * x, 2.0 * x), (x * x * x, 3.0 * x * x)))
        response = self.response + (x + self.shift * x * (1.0 - x)) * self.response_change
        line = self.tension + (factor - self.start) * self.tension_rate
        return line, both[:, 0], both[:, 1] / self.length, response

    def paced(self, rate: Array, response: Array, more: Array) -> Array:
        """Rates of the values at fixed tensions, which are ``more`` than those on the straight line."""
        return np.asarray(rate + self.response_change @ more / self.length - response @ self.tension_rate)


class SlipDerivatives:
    """Derivatives of the slips at a load factor; columns of the matrix are computed when first used.

    Parameters
    ----------
    transfer
        Of the tension.
    rate
        Derivatives of the slips by the load factor at fixed tensions, shape (n,).
    by_tension
        Those by the tensions, shape (n, q).
    factors
        Of the derivatives of the tensions by what is put on each segment.
    angle_rate
        Derivatives of the angles by the load factor at fixed tensions, shape (r,).
    stiffness
        Presliding distance at holes, zero for tensions [m], shape (n,).
    branches
        See `SlipModel.branches`.

    Attributes
    ----------
    by_load : ndarray, shape (n,)
        Derivatives of the slips by the load factor at fixed mobilisations and unknown tensions at the base [m].
    """

    __slots__ = ("_by_tension", "_chosen", "_columns", "_factors", "_missing", "_segments", "_tension_by_load",
                 "_transfer", "_which", "branches", "by_load", "stiffness")  # fmt: skip

    def __init__(
        self,
        transfer: Transfer,
        rate: Array,
        by_tension: Array,
        factors: tuple[Array, Index],
        angle_rate: Array,
        stiffness: Array,
        branches: Flags | None,
    ) -> None:
        self._transfer, self._by_tension, self._factors = transfer, by_tension, factors
        self.stiffness, self.branches = stiffness, branches
        self._tension_by_load = self.put_on(transfer.by_angles(angle_rate) + transfer.by_load)
        self.by_load: Array = rate + by_tension @ self._tension_by_load
        n, q = by_tension.shape
        self._missing: Flags = np.ones(n, dtype=bool)
        # Column by column, each in one piece.
        self._columns, self._segments = np.empty((n, n)), np.empty((n, q))
        #: Those asked for last.
        self._which: Index | None = None
        self._chosen = self._columns

    def put_on(self, tensions: Array) -> Array:
        """Changes of the tensions, the turning of the tendons included, by those put on, shape (q,) or (q, i)."""
        found: Array = dgetrs(*self._factors, tensions)[0]
        return found

    def columns(self, which: Index) -> Array:
        """As of `SlipState`."""
        if which is self._which:
            return self._chosen
        new = which[self._missing[which]]
        if new.size:
            segments = self.put_on(self._transfer.columns(new))
            columns = -(self._by_tension @ segments)
            columns[new, np.arange(len(new))] += self.stiffness[new]
            self._columns[new], self._segments[new] = columns.T, segments.T
            self._missing[new] = False
        self._which, self._chosen = which, self._columns[which].T
        return self._chosen

    def segments(self, which: Index) -> Array:
        """As of `SlipState`."""
        self.columns(which)
        return self._segments[which].T

    def tension_rates(self, free: Index, rate: Array) -> Array:
        """As of `SlipState`."""
        return self._tension_by_load + self.segments(free) @ rate[free]


class SlipState(NamedTuple):
    """Slips at a load factor, and their derivatives there or nearby.

    Attributes
    ----------
    tension : ndarray, shape (q,)
        Of the segments [N].
    slip : ndarray, shape (n,)
        At the frictional holes, then minus the slack [m].
    derivatives : SlipDerivatives
    """

    tension: Array
    slip: Array
    derivatives: SlipDerivatives

    @property
    def by_load(self) -> Array:
        """Derivatives by the load factor at fixed mobilisations and unknown tensions at the base [m], shape (n,)."""
        return self.derivatives.by_load

    def jumps_to(self, branches: Flags | None) -> bool:
        """Whether the derivatives have jumped since they were evaluated, see `SlipModel.branches`."""
        here = self.derivatives.branches
        return here is not None and branches is not None and not np.array_equal(here, branches)

    def columns(self, which: Index) -> Array:
        """Derivatives by some of the unknowns, in ascending order, shape (n, i).

        Presliding distance times identity for the holes, minus the derivatives by mobilisations [m] and tensions [m/N].
        """
        return self.derivatives.columns(which)

    def segments(self, which: Index) -> Array:
        """Derivatives of the tensions of the segments by some of the unknowns, shape (q, i)."""
        return self.derivatives.segments(which)

    def tension_rates(self, free: Index, rate: Array) -> Array:
        """Rates of the tensions of the segments, by those of the unknowns, of which some are free, shape (q,)."""
        return self.derivatives.tension_rates(free, rate)

    def ahead(self, part: float, tension: Array, rate: Array, excess: Array) -> SlipState:
        """The state a little further on, with the same derivatives.

        Parameters
        ----------
        part
            By how much the load factor is larger [1].
        tension
            Of the segments there [N], shape (q,).
        rate
            Rates of all unknowns, shape (n,).
        excess
            Rates of the slips less the presliding part, and of minus the slack [m], shape (n,).
        """
        moved = self.slip + part * (excess + self.derivatives.stiffness * rate)
        return SlipState(tension, moved, self.derivatives)

    def beside(self, which: Index, change: Array) -> SlipState:
        """The state at the same load factor with some of the unknowns changed a little, with the same derivatives."""
        by = self.derivatives
        slip = self.slip - by.columns(which) @ change
        slip[which] += by.stiffness[which] * change
        return SlipState(self.tension + by.segments(which) @ change, slip, by)


class SlipModel:
    """Slips as functions of load factor, mobilisations, and unknown tensions at the base.

    Parameters
    ----------
    transfer
        Of the tension.
    ends
        Both ends of the substep, and states within it, by load factor.
    holes, unknown
        Numbers of frictional holes and of unknown tensions at the base.
    presliding
        Presliding distance [m].
    bulge
        Factor on the parabola in the rates at fixed tensions that leads from the values at the start to those at the
        end, for what is uncertain in it [1].
    """

    def __init__(
        self,
        transfer: CapstanTransfer | LawTransfer,
        ends: Sequence[End],
        holes: int,
        unknown: int,
        presliding: float,
        bulge: float = 1.0,
    ) -> None:
        self._given = transfer, ends, holes, unknown, presliding
        self._transfer, self.presliding, self.holes = transfer, presliding, holes
        self._count = holes + unknown
        self._stiffness = np.append(np.full(holes, presliding), np.zeros(unknown))
        self._identity = np.eye(len(ends[0].tension))
        self._intervals = [_Interval.between(a, b, bulge) for a, b in pairwise(ends)]
        #: Load factors of all states but the first.
        self.ends: tuple[float, ...] = tuple(at.factor for at in ends[1:])

    @property
    def bulge(self) -> Array:
        """Change of the slips beyond that of rates linear in the load factor at fixed tensions [m], shape (k,)."""
        return np.asarray(-0.5 * self._intervals[0].cubic[: self.holes, 3])

    def beside_line(self, factors: Array, tensions: Array) -> Array:
        """Largest change of the slips by a parabola in their derivatives, by tensions off the straight line [m].

        Parameters
        ----------
        factors
            Load factors within the first interval [1], shape (p,).
        tensions
            Of the segments there [N], shape (p, q).
        """
        part = self._intervals[0]
        x = (factors - part.start) / part.length
        more = tensions - part.tension - (factors - part.start)[:, None] * part.tension_rate
        change = (x * (1.0 - x))[:, None] * (more @ part.response_change[: self.holes].T)
        return np.asarray(np.abs(change).max(axis=0))

    @property
    def cubic(self) -> float:
        """Largest coefficient of the cube of the load factor in the slips [m]."""
        return max(float(np.abs(own.cubic[: self.holes, 3]).max()) / own.length**3 for own in self._intervals)

    def with_bulge(self, bulge: float) -> SlipModel:
        """The same with another factor on the parabola."""
        return SlipModel(*self._given, bulge)

    def through_every_other_state(self) -> SlipModel:
        """The same without every other state within the substep, of which there is an odd number."""
        transfer, ends, holes, unknown, presliding = self._given
        return SlipModel(transfer, ends[::2], holes, unknown, presliding)

    def _interval(self, factor: float) -> _Interval:
        return self._intervals[min(bisect_right(self.ends, factor), len(self.ends) - 1)]

    def branches(self, z: Array, tension: Array) -> Flags | None:
        """Flags that change where the derivatives of the tensions jump; None where they never do."""
        return self._transfer.branches(z, tension)

    def distance_to_jump(self, z: Array, rate: Array, tension: Array, tension_rate: Array) -> float:
        """Part of the substep to where they change, at constant rates [1]."""
        return self._transfer.distance_to_jump(z, rate, tension, tension_rate)

    def at(self, factor: float, z: Array, tension: Array) -> SlipState:
        """Slips and their derivatives.

        Parameters
        ----------
        factor
            Load factor within the substep [1].
        z
            Mobilisations, then unknown tensions at the base [N], shape (n,).
        tension
            Of the segments, about [N], shape (q,).
        """
        n, part = self._count, self._interval(factor)
        straight, values, rate, response = part.at(factor)
        by_tension, turning = response[:n], response[n:]
        for _ in range(MOST_ROUNDS):
            angles = np.maximum(values[n:] + turning @ (tension - straight), 0.0)
            transfer = self._transfer.at(factor, z, angles)
            matrix = transfer.by_angles(turning)
            np.subtract(self._identity, matrix, out=matrix)
            lu, pivots, _ = dgetrf(matrix)
            # Newton's method for tensions and angles that agree: one step, unless they are far apart.
            off = transfer.tension - tension
            tension = tension + dgetrs(lu, pivots, off)[0]
            if float(np.abs(off).max()) <= NEAR_TENSION * float(tension.max()):
                break
        more = tension - straight
        rate = part.paced(rate, response, more)
        slip = values[:n] + by_tension @ more
        branches = self._transfer.branches(z, transfer.tension)
        by = SlipDerivatives(
            transfer, rate[:n], by_tension, (lu, pivots), rate[n:], self._stiffness, branches
        )
        return SlipState(tension, slip, by)

    def rates(self, factor: float, z: Array, tension: Array, rate: Array, near: SlipState) -> Array | None:
        """Rates of the slips, less the presliding part, and of minus the slack, at given rates of the unknowns, (n,).

        None where they have jumped since the load factor nearby, see `branches`.

        Parameters
        ----------
        factor, z, tension
            As of `at`.
        rate
            Of the unknowns, shape (n,).
        near
            Slips at a load factor nearby.
        """
        n, part = self._count, self._interval(factor)
        straight, values, pace, response = part.at(factor)
        turning, solve = response[n:], near.derivatives.put_on
        angles = np.maximum(values[n:] + turning @ (tension - straight), 0.0)
        transfer = self._transfer.at(factor, z, angles)
        if near.jumps_to(self._transfer.branches(z, transfer.tension)):
            return None
        more = tension + solve(transfer.tension - tension) - straight
        pace = part.paced(pace, response, more)
        put_on = transfer.by_angles(pace[n:]) + transfer.by_load + transfer.by_unknowns(rate)
        pulled = solve(put_on)
        pulled += solve(put_on - pulled + transfer.by_angles(turning @ pulled))
        return np.asarray(pace[:n] + response[:n] @ pulled - self._stiffness * rate)
