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
from copy import copy
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from tdcr_fe.solve.friction_path.tension_transfer import CapstanTransfer, LawTransfer, Transfer

Array = NDArray[np.float64]
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


class SlipState:
    """Slips at a load factor, and their derivatives; columns of the matrix are computed when first used.

    Parameters
    ----------
    transfer
        Of the tension.
    tension
        Of the segments [N], shape (q,).
    slip, rate
        Slips, and their derivatives by the load factor at fixed tensions, shape (n,).
    by_tension
        Their derivatives by the tensions, shape (n, q).
    factors
        Of the derivatives of the tensions by what is put on each segment.
    angle_rate
        Derivatives of the angles by the load factor at fixed tensions, shape (r,).
    stiffness
        Presliding distance at holes, zero for tensions [m], shape (n,).

    Attributes
    ----------
    tension : ndarray, shape (q,)
        Of the segments [N].
    slip : ndarray, shape (n,)
        At the frictional holes, then minus the slack [m].
    by_load : ndarray, shape (n,)
        Their derivatives by the load factor at fixed mobilisations and unknown tensions at the base [m].
    """

    def __init__(
        self,
        transfer: Transfer,
        tension: Array,
        slip: Array,
        rate: Array,
        by_tension: Array,
        factors: tuple[Array, Index],
        angle_rate: Array,
        stiffness: Array,
    ) -> None:
        self.tension, self.slip = tension, slip
        self._by_tension, self._stiffness = by_tension, stiffness
        self._factors, self._by_unknown = factors, transfer.by_unknown
        self._tension_by_load = self.put_on(transfer.by_angle @ angle_rate + transfer.by_load)
        self.by_load: Array = rate + by_tension @ self._tension_by_load
        n = len(slip)
        self._known = np.zeros(n, dtype=bool)
        self._matrix, self._segments = np.empty((n, n)), np.empty((len(self.tension), n))

    def put_on(self, tensions: Array) -> Array:
        """Changes of the tensions, the turning of the tendons included, by those put on, shape (q,) or (q, i)."""
        found: Array = dgetrs(*self._factors, tensions)[0]
        return found

    def columns(self, which: Index) -> Array:
        """Derivatives by some of the unknowns, shape (n, i).

        Presliding distance times identity for the holes, minus the derivatives by mobilisations [m] and tensions [m/N].
        """
        new = which[~self._known[which]]
        if new.size:
            segments = self.put_on(self._by_unknown[:, new])
            columns = -(self._by_tension @ segments)
            columns[new, np.arange(len(new))] += self._stiffness[new]
            self._matrix[:, new], self._segments[:, new] = columns, segments
            self._known[new] = True
        return self._matrix[:, which]

    def segments(self, which: Index) -> Array:
        """Derivatives of the tensions of the segments by some of the unknowns, shape (q, i)."""
        self.columns(which)
        return self._segments[:, which]

    def ahead(self, part: float, free: Index, rate: Array, excess: Array) -> SlipState:
        """The state a little further on, with the same derivatives.

        Parameters
        ----------
        part
            By how much the load factor is larger [1].
        free, rate
            Unknowns inside their bounds, and the rates of all of them, shape (n,).
        excess
            Rates of the slips less the presliding part, and of minus the slack [m], shape (n,).
        """
        there = copy(self)
        there.slip = self.slip + part * (excess + self._stiffness * rate)
        there.tension = self.tension + part * self.tension_rates(free, rate)
        return there

    def beside(self, which: Index, change: Array) -> SlipState:
        """The state at the same load factor with some of the unknowns changed a little, with the same derivatives."""
        there = copy(self)
        there.slip = self.slip - self.columns(which) @ change
        there.slip[which] += self._stiffness[which] * change
        there.tension = self.tension + self.segments(which) @ change
        return there

    def tension_rates(self, free: Index, rate: Array) -> Array:
        """Rates of the tensions of the segments, by those of the unknowns, shape (q,)."""
        return np.asarray(self._tension_by_load + self.segments(free) @ rate[free])


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

    def _interval(self, factor: float) -> _Interval:
        return self._intervals[min(bisect_right(self.ends, factor), len(self.ends) - 1)]

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
        for _ in range(MOST_ROUNDS):
            angles = np.maximum(values[n:] + response[n:] @ (tension - straight), 0.0)
            transfer = self._transfer.derivatives(factor, z, angles)
            matrix = transfer.by_angle @ response[n:]
            np.negative(matrix, out=matrix)
            matrix.reshape(-1)[:: len(tension) + 1] += 1.0
            lu, pivots, _ = dgetrf(matrix, overwrite_a=False)
            # Newton's method for tensions and angles that agree: one step, unless they are far apart.
            off = transfer.tension - tension
            tension = tension + dgetrs(lu, pivots, off)[0]
            if float(np.abs(off).max()) <= NEAR_TENSION * float(tension.max()):
                break
        more = tension - straight
        rate = part.paced(rate, response, more)
        slip = values[:n] + response[:n] @ more
        factors = lu, pivots
        return SlipState(transfer, tension, slip, rate[:n], response[:n], factors, rate[n:], self._stiffness)

    def rates(self, factor: float, z: Array, tension: Array, rate: Array, near: SlipState) -> Array:
        """Rates of the slips, less the presliding part, and of minus the slack, at given rates of the unknowns, (n,).

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
        angles = np.maximum(values[n:] + response[n:] @ (tension - straight), 0.0)
        transfer = self._transfer.derivatives(factor, z, angles)
        more = tension + near.put_on(transfer.tension - tension) - straight
        pace = part.paced(pace, response, more)
        put_on = transfer.by_angle @ pace[n:] + transfer.by_load + transfer.by_unknown @ rate
        pulled = near.put_on(put_on)
        pulled += near.put_on(put_on - pulled + transfer.by_angle @ (response[n:] @ pulled))
        return np.asarray(pace[:n] + response[:n] @ pulled - self._stiffness * rate)
