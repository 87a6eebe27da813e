"""Factors of a tangent: dense, and bordered by the tensions of tendons with prescribed displacement."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Factors(Protocol):
    """What a factorised matrix can do."""

    def solve(self, right: Array) -> Array:
        """Solution for one or several right sides, shape (n,) or (n, k)."""
        ...

    @property
    def sign(self) -> int:
        """Sign of the determinant; it changes where an equilibrium loses its stability."""
        ...


class DenseFactors(NamedTuple):
    """LU factors of a full matrix.

    Attributes
    ----------
    lu : ndarray
        Of the transposed matrix.
    pivots : ndarray of int
    """

    lu: Array
    pivots: NDArray[np.int_]

    @classmethod
    def of(cls, matrix: Array) -> DenseFactors:
        """Factorise, overwriting the matrix.

        Raises
        ------
        numpy.linalg.LinAlgError
            The matrix is singular.
        """
        lu, pivots, info = dgetrf(matrix.T, overwrite_a=True)
        if info != 0 or not isfinite(lu[-1, -1]):
            raise np.linalg.LinAlgError("singular matrix")
        return cls(lu, pivots)

    def solve(self, right: Array) -> Array:
        """See `Factors.solve`."""
        solution: Array = dgetrs(self.lu, self.pivots, right, trans=1)[0]
        return solution

    @property
    def sign(self) -> int:
        """See `Factors.sign`."""
        # The parity of row exchanges and negative pivots.
        turned = np.count_nonzero((self.pivots != np.arange(len(self.pivots))) ^ (self.lu.diagonal() < 0.0))
        return 1 if turned % 2 == 0 else -1


class BorderedFactors(NamedTuple):
    """Factors of a tangent with the tensions of tendons with prescribed displacement as further unknowns.

    The matrix is ``[[K, C], [R, D]]``. The rows of slack tendons are those of the identity, so another set of slack
    tendons takes the factors of a small matrix only.

    Attributes
    ----------
    inner : Factors
        Of ``K``, at fixed tensions.
    columns : ndarray, shape (n, k)
        ``K^-1 C``.
    rows : ndarray, shape (k, n)
        ``R``: change of the displacements at the base [m].
    schur : ndarray, shape (k, k)
        ``D - R K^-1 C``: change of these displacements by the tensions, with the robot in equilibrium [m/N].
    slack : ndarray of bool, shape (k,)
    border : DenseFactors
        Of ``schur`` with the rows of slack tendons replaced.
    """

    inner: Factors
    columns: Array
    rows: Array
    schur: Array
    slack: Flags
    border: DenseFactors

    @classmethod
    def of(cls, inner: Factors, columns: Array, rows: Array, own: Array, slack: Flags) -> BorderedFactors:
        """From the factors of ``K``, and from ``C``, ``R``, the diagonal of ``D``, and which tendons are slack.

        Raises
        ------
        numpy.linalg.LinAlgError
            The matrix is singular.
        """
        response = inner.solve(columns)
        schur = np.diag(own) - rows @ response
        return cls(inner, response, rows, schur, slack, _border(schur, slack))

    def with_slack(self, slack: Flags) -> BorderedFactors:
        """The factors with another set of slack tendons; raises as `of`."""
        if np.array_equal(slack, self.slack):
            return self
        return self._replace(slack=slack, border=_border(self.schur, slack))

    def solve(self, right: Array) -> Array:
        """See `Factors.solve`."""
        n = self.rows.shape[1]
        start = self.inner.solve(right[:n])
        given = right[n:][self.slack]
        rest = right[n:] - self.rows @ start
        rest[self.slack] = given
        change = self.border.solve(rest)
        # Without round-off: a tendon with any tension counts as taut.
        change[self.slack] = given
        return self.at_tensions(start, change)

    def at_tensions(self, start: Array, change: Array) -> Array:
        """The solution from that at fixed tensions, and the change of the tensions."""
        n = len(start)
        solution = np.empty((n + len(change), *start.shape[1:]), order="F")
        np.subtract(start, self.columns @ change, out=solution[:n])
        solution[n:] = change
        return solution

    @property
    def sign(self) -> int:
        """See `Factors.sign`."""
        return self.inner.sign * self.border.sign


def _border(schur: Array, slack: Flags) -> DenseFactors:
    """Factors of a small matrix with rows of the identity for slack tendons."""
    return DenseFactors.of(np.where(slack[:, None], np.eye(len(slack)), schur))
