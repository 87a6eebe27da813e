"""Slips between two solved states, as functions of load factor, mobilisations and tensions at the base.

With the configuration eliminated, slips and turning angles are smooth functions of the load factor and of the tensions
of all segments. Their derivatives change little within a substep and are interpolated between its ends. How tensions
follow from mobilisations and angles is not interpolated: it is the law of friction itself (`tension_transfer`).
Derivation: documentation, page "Theory".
"""

from __future__ import annotations

from copy import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from tdcr_fe.solve.tension_transfer import CapstanTransfer, LawTransfer, Transfer

Array = NDArray[np.float64]
Index = NDArray[np.int_]

#: Corrections of the tensions above this fraction of the largest are followed by another; and their largest number [1].
NEAR_TENSION, MOST_ROUNDS = 3e-3, 6


class End(NamedTuple):
    """One end of a substep.

    Attributes
    ----------
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

    tension: Array
    values: Array
    by_tension: Array
    by_load: Array


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

    def tension_rates(self, free: Index, rate: Array) -> Array:
        """Rates of the tensions of the segments, by those of the unknowns, shape (q,)."""
        return np.asarray(self._tension_by_load + self.segments(free) @ rate[free])


class SlipModel:
    """Slips as functions of load factor, mobilisations, and unknown tensions at the base.

    Parameters
    ----------
    transfer
        Of the tension.
    start, end
        Both ends of the substep.
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
        start: End,
        end: End,
        holes: int,
        unknown: int,
        presliding: float,
        bulge: float = 1.0,
    ) -> None:
        self._given = transfer, start, end, holes, unknown, presliding
        self._transfer, self.presliding, self.holes = transfer, presliding, holes
        self._count = holes + unknown
        self._stiffness = np.append(np.full(holes, presliding), np.zeros(unknown))
        self._tension, self._tension_change = start.tension, end.tension - start.tension
        self._response, self._response_change = start.by_tension, end.by_tension - start.by_tension
        first, last = (at.by_load + at.by_tension @ self._tension_change for at in (start, end))
        beyond = end.values - start.values - 0.5 * (first + last)
        #: Change of the slips beyond that of rates linear in the load factor at fixed tensions [m], shape (k,).
        self.bulge: Array = beyond[:holes]
        beyond, self._shift = bulge * beyond, bulge - 1.0
        # Values and their rates are cubics of the load factor.
        self._cubic = np.stack(
            (start.values, first, 0.5 * (last - first) + 3.0 * beyond, -2.0 * beyond), axis=1
        )

    def with_bulge(self, bulge: float) -> SlipModel:
        """The same with another factor on the parabola."""
        return SlipModel(*self._given, bulge)

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
        n = self._count
        values, rate = self._values(factor)
        response = self._responses(factor)
        straight = self._tension + factor * self._tension_change
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
        rate = rate + self._response_change @ more - response @ self._tension_change
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
        n = self._count
        values, pace = self._values(factor)
        response = self._responses(factor)
        straight = self._tension + factor * self._tension_change
        angles = np.maximum(values[n:] + response[n:] @ (tension - straight), 0.0)
        transfer = self._transfer.derivatives(factor, z, angles)
        more = tension + near.put_on(transfer.tension - tension) - straight
        pace = pace + self._response_change @ more - response @ self._tension_change
        put_on = transfer.by_angle @ pace[n:] + transfer.by_load + transfer.by_unknown @ rate
        pulled = near.put_on(put_on)
        pulled += near.put_on(put_on - pulled + transfer.by_angle @ (response[n:] @ pulled))
        return np.asarray(pace[:n] + response[:n] @ pulled - self._stiffness * rate)

    def _responses(self, x: float) -> Array:
        """Derivatives by the tensions."""
        return np.asarray(self._response + (x + self._shift * x * (1.0 - x)) * self._response_change)

    def _values(self, x: float) -> tuple[Array, Array]:
        """Values along the straight line of tensions between the ends, and their rates."""
        both = self._cubic @ np.array(((1.0, 0.0), (x, 1.0), (x * x, 2.0 * x), (x * x * x, 3.0 * x * x)))
        return both[:, 0], both[:, 1]
