"""Small systems of linear equations that are solved with the same factors more than once.

By LAPACK; compiled functions (`tdcr_fe.compiled`), which cannot call it one part at a time, take the inverse.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from tdcr_fe.compiled import compiled_as

Array = NDArray[np.float64]
Index = NDArray[np.int_]


class Factors(NamedTuple):
    """A factorised matrix.

    Attributes
    ----------
    lu : ndarray, shape (n, n)
        LU factors of the transposed matrix; the inverse in compiled functions.
    pivots : ndarray of int, shape (n,)
        Rows exchanged; not used with the inverse.
    singular : bool
    """

    lu: Array
    pivots: NDArray[np.int32]
    singular: bool


def _inverse(matrix: Array) -> Factors:
    inverse: Any = np.linalg.inv(matrix.T).T
    return Factors(inverse, np.zeros(0, dtype=np.int32), False)


@compiled_as(_inverse)
def factorised(matrix: Array) -> Factors:
    """Factors of a matrix whose rows lie in memory one after the other; it is overwritten."""
    # LAPACK has matrices column by column: it takes the transposed one without a copy.
    lu, pivots, singular = dgetrf(matrix.T, overwrite_a=True)
    return Factors(lu, pivots, singular != 0)


@compiled_as(lambda: Factors(np.zeros((0, 0)), np.zeros(0, dtype=np.int32), False))
def no_factors() -> Factors:
    """Of a matrix without rows."""
    return _NO_FACTORS


@compiled_as(lambda factors, right: factors.lu.dot(right))
def solved(factors: Factors, right: Array) -> Array:
    """Solution ``x`` of ``matrix x = right``, shape (n,)."""
    found: Array = dgetrs(factors.lu, factors.pivots, right, trans=1)[0]
    return found


@compiled_as(lambda factors, rows: rows.dot(factors.lu.T))
def solved_rows(factors: Factors, rows: Array) -> Array:
    """The same for every row of an array, shape (i, n)."""
    found: Array = dgetrs(factors.lu, factors.pivots, rows.T, trans=1)[0].T
    return found


@compiled_as(lambda factors, right: right.dot(factors.lu))
def solved_transposed(factors: Factors, right: Array) -> Array:
    """Solution ``x`` of ``x matrix = right``, shape (n,)."""
    found: Array = dgetrs(factors.lu, factors.pivots, right)[0]
    return found


@compiled_as(lambda matrix, which: matrix[which])
def some_rows(matrix: Array, which: Index) -> Array:
    """Some rows of a matrix."""
    return matrix.take(which, axis=0)


@compiled_as(lambda matrix, which: np.ascontiguousarray(matrix[:, which]))
def some_columns(matrix: Array, which: Index) -> Array:
    """Some columns of a matrix, as a matrix whose rows lie in memory one after the other."""
    return matrix.take(which, axis=1)


_NO_FACTORS = Factors(np.zeros((0, 0)), np.zeros(0, dtype=np.int32), False)
