"""Slips at one load factor, and their derivatives by the unknowns of the friction path."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrs

from tdcr_fe.solve.friction_path.tension_transfer import Transfer

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Index = NDArray[np.int_]


class SlipDerivatives:
    """Derivatives of the slips at a load factor; those by an unknown are computed when first used.

    Parameters
    ----------
    transfer
        How tension passes along the tendons, with its derivatives.
    rate
        Derivatives of the slips, and of minus the slack, by the load factor at fixed tensions [m], shape (n,).
    by_tension
        Those by the tensions of the segments [m/N], shape (n, q).
    factors
        LU factors and pivots of the identity less the derivatives of the tensions by themselves through the turning
        angles, transposed, shape (q, q).
    angle_rate
        Derivatives of the turning angles by the load factor at fixed tensions [rad], shape (r,).
    elastic_slip
        Elastic slip by each unknown: the presliding distance at holes [m], zero for tensions, shape (n,).
    regimes
        See `tdcr_fe.solve.friction_path.tension_transfer.LawTransfer.regimes`.

    Attributes
    ----------
    by_load : ndarray, shape (n,)
        Derivatives of the slips, and of minus the slack, by the load factor at fixed unknowns [m].
    """

    __slots__ = ("_by_tension", "_columns", "_diagonal", "_factors", "_missing", "_requested", "_requested_columns",
                 "_tension_by_load", "_tensions", "_transfer", "by_load", "elastic_slip", "regimes")  # fmt: skip

    def __init__(
        self,
        transfer: Transfer,
        rate: Array,
        by_tension: Array,
        factors: tuple[Array, Index],
        angle_rate: Array,
        elastic_slip: Array,
        regimes: Flags | None,
    ) -> None:
        self._transfer, self._by_tension, self._factors = transfer, by_tension, factors
        self.elastic_slip, self.regimes = elastic_slip, regimes
        self._tension_by_load = self.with_turning(transfer.by_angles(angle_rate) + transfer.by_load)
        self.by_load: Array = rate + by_tension.dot(self._tension_by_load)
        n, q = by_tension.shape
        self._missing: Flags = np.ones(n, dtype=bool)
        # Column by column, each in one piece.
        self._columns, self._tensions = np.empty((n, n)), np.empty((n, q))
        self._diagonal = self._columns.reshape(-1)[:: n + 1]
        #: Unknowns asked for last: mostly the same ones again.
        self._requested: Index | None = None
        self._requested_columns = self._columns

    def with_turning(self, changes: Array) -> Array:
        """Changes of the tensions with those caused by the turning of the tendons under them.

        Parameters
        ----------
        changes
            Of the tensions at fixed turning angles [N], shape (q,) or (q, i).
        """
        found: Array = dgetrs(*self._factors, changes, trans=1)[0]
        return found

    def columns(self, which: Index) -> Array:
        """See `SlipState.columns`."""
        if which is self._requested:
            return self._requested_columns
        new = which[self._missing[which]]
        if new.size:
            tensions = self.with_turning(self._transfer.rows(new).T).T
            self._columns[new] = -tensions.dot(self._by_tension.T)
            self._diagonal[new] += self.elastic_slip[new]
            self._tensions[new] = tensions
            self._missing[new] = False
        self._requested, self._requested_columns = which, self._columns.take(which, axis=0).T
        return self._requested_columns

    def tension_columns(self, which: Index) -> Array:
        """See `SlipState.tension_columns`."""
        self.columns(which)
        return self._tensions.take(which, axis=0).T

    def tension_rates(self, free: Index, rate: Array) -> Array:
        """See `SlipState.tension_rates`."""
        return self._tension_by_load + self.tension_columns(free).dot(rate[free])


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
        """Derivatives of the slips, and of minus the slack, by the load factor at fixed unknowns [m], shape (n,)."""
        return self.derivatives.by_load

    def left_regimes(self, regimes: Flags | None) -> bool:
        """Whether the derivatives jump between where they were evaluated and a state with these regimes."""
        here = self.derivatives.regimes
        return here is not None and regimes is not None and not np.array_equal(here, regimes)

    def columns(self, which: Index) -> Array:
        """Minus the derivatives of the complements by some of the unknowns, in ascending order, shape (n, i).

        For a hole presliding distance times identity, minus the derivatives of the slips by its mobilisation [m]; for a
        tendon minus those by its tension [m/N].
        """
        return self.derivatives.columns(which)

    def tension_columns(self, which: Index) -> Array:
        """Derivatives of the tensions of the segments by some of the unknowns [N, 1], shape (q, i)."""
        return self.derivatives.tension_columns(which)

    def tension_rates(self, free: Index, rate: Array) -> Array:
        """Derivatives of the tensions of the segments by the load factor [N], shape (q,).

        Parameters
        ----------
        free
            Unknowns that change.
        rate
            Rates of all unknowns [1, N], shape (n,).
        """
        return self.derivatives.tension_rates(free, rate)

    def extrapolated(self, length: float, tension: Array, rate: Array, complement: Array) -> SlipState:
        """The state a little further on, with the same derivatives.

        Parameters
        ----------
        length
            By how much the load factor is larger [1].
        tension
            Of the segments there [N], shape (q,).
        rate
            Rates of all unknowns [1, N], shape (n,).
        complement
            Rates of their complements [m], shape (n,).
        """
        moved = self.slip + length * (complement + self.derivatives.elastic_slip * rate)
        return SlipState(tension, moved, self.derivatives)

    def with_changed(self, which: Index, change: Array) -> SlipState:
        """The state at the same load factor with some of the unknowns changed a little, with the same derivatives.

        Parameters
        ----------
        which
            Numbers of the unknowns.
        change
            Their changes [1, N], shape (i,).
        """
        by = self.derivatives
        slip = self.slip - by.columns(which).dot(change)
        slip[which] += by.elastic_slip[which] * change
        return SlipState(self.tension + by.tension_columns(which).dot(change), slip, by)
