"""Linear complementarity problems: which holes stick or slip, and which tendons are slack, in one linearised step."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dgesv

from tdcr_fe.compiled import compilable, compiled_as
from tdcr_fe.elements import Array, Flags

#: Smallest eigenvalue of `positive_definite_near` over the largest magnitude of those it began with [1].
LEAST_EIGENVALUE = 0.05
#: Block pivots that may leave as many violated indices as before until single pivots follow. With more of them a
#: problem in which block pivots cycle takes longer; with fewer, others are given to single pivots, which are slow.
MOST_IDLE_BLOCKS = 3
#: What is smaller than this is round-off, over the size of what it belongs to [1]: here violations, of the bounds of
#: `solve_box` and of ``w`` over the diagonal of the matrix.
ROUND_OFF = 1e-12


@compiled_as(lambda values: values.max())
def largest(values: Array) -> float:
    """The largest of some numbers; a fifth of the time of numpy's ``max`` for a few of them."""
    return values.item(values.argmax())


@compiled_as(lambda values: values.min())
def smallest(values: Array) -> float:
    """The smallest of some numbers, see `largest`."""
    return values.item(values.argmin())


@compilable
def largest_magnitude(values: Array) -> float:
    """The largest magnitude of some numbers, see `largest`."""
    return largest(np.abs(values))


@compilable
def exchanged(violated: Flags, count: int, fewest: int, idle_left: int) -> tuple[Flags, int, int]:
    """Which violated indices a principal pivoting method exchanges next.

    All of them (a block pivot), until their number has not fallen for `MOST_IDLE_BLOCKS` times; from then on the lowest
    alone, which terminates for every P-matrix, until their number falls again.

    Parameters
    ----------
    violated
        Violated indices, shape (k,).
    count
        Their number.
    fewest
        Fewest so far; at first more than there are indices.
    idle_left
        Block pivots that may still leave as many; at first `MOST_IDLE_BLOCKS`.

    Returns
    -------
    exchanged : ndarray of bool, shape (k,)
    fewest, idle_left : int
        For the next time.
    """
    if count < fewest:
        return violated, count, MOST_IDLE_BLOCKS
    if idle_left > 0:
        return violated, fewest, idle_left - 1
    lowest = np.zeros_like(violated)
    lowest[violated.argmax()] = True
    return lowest, fewest, 0


def solve_box(
    matrix: Array, right: Array, start: Array, lower: float = -1.0, upper: float = 1.0
) -> tuple[Array, bool]:
    """Find ``lower <= z <= upper`` with ``w = right - matrix z`` zero inside, ``>= 0`` at upper, ``<= 0`` at lower.

    Block principal pivoting: all indices that violate a condition are exchanged at once. When their number no
    longer falls, one index is exchanged at a time, the lowest first, which terminates for every P-matrix.

    Parameters
    ----------
    matrix
        Shape (k, k).
    right
        Shape (k,).
    start
        Initial guess; it sets the first partition of the indices, shape (k,).
    lower, upper
        Bounds; they may be infinite.

    Returns
    -------
    solution : ndarray, shape (k,)
    solved : bool
        False where the pivots ran out or met a singular block (the matrix is then not a P-matrix).

    References
    ----------
    J. J. Judice, F. M. Pires, A block principal pivoting algorithm for large-scale strictly monotone linear
    complementarity problems, Computers & Operations Research 21 (1994) 587-596; K. G. Murty, Note on a
    Bard-type scheme for solving the complementarity problem, Opsearch 11 (1974) 123-130.
    """
    k = len(right)
    side = (start >= upper).astype(float) - (start <= lower)
    scale = np.maximum(np.abs(np.diagonal(matrix)), 1e-300)
    fewest, idle_left = k + 1, MOST_IDLE_BLOCKS
    # Besides one pivot for each index: 67 random robots needed at most 20 where there was a solution, and
    # where there is none, all of them are in vain.
    for _ in range(30 + k):
        free = side == 0.0
        z = np.where(side > 0.0, upper, np.where(free, 0.0, lower))
        inside = np.flatnonzero(free)
        if inside.size:
            rest = (right - matrix @ z)[inside]
            _, _, z[inside], singular = dgesv(matrix[inside[:, None], inside], rest, overwrite_a=True)
            if singular:
                return np.clip(start, lower, upper), False
        w = (right - matrix @ z) / scale
        up, down = free & (z > upper + ROUND_OFF), free & (z < lower - ROUND_OFF)
        back = side * w < -ROUND_OFF
        violated = up | down | back
        count = int(np.count_nonzero(violated))
        if count == 0:
            return np.clip(z, lower, upper), True
        violated, fewest, idle_left = exchanged(violated, count, fewest, idle_left)
        side[violated & back] = 0.0
        side[violated & up] = 1.0
        side[violated & down] = -1.0
    return np.clip(z, lower, upper), False


def positive_definite_near(matrix: Array) -> Array:
    """A symmetric positive definite matrix near a given one, with which `solve_box` always has one solution.

    The symmetric part, scaled to diagonal entries of 1 or -1; where any of its eigenvalues is below `LEAST_EIGENVALUE`
    times the largest magnitude, what it lacks is added to all of them.

    Parameters
    ----------
    matrix
        Shape (k, k); no zeros on its diagonal.
    """
    root = np.sqrt(np.maximum(np.abs(np.diagonal(matrix)), 1e-300))
    scaled = 0.5 * (matrix + matrix.T) / root / root[:, None]
    values = np.linalg.eigvalsh(scaled)
    lifted = scaled + max(0.0, LEAST_EIGENVALUE * np.abs(values).max() - values[0]) * np.eye(len(root))
    return np.asarray(lifted * root * root[:, None])
