"""Complementarity problems on a box: which holes stick or slip, and which pulled-in tendons are slack.

Each unknown v has bounds and a value F(v): F is zero between the bounds, not negative at the lower bound and
not positive at the upper. For the mobilisation s in -1..1 of friction at a hole
``F = presliding (s - s_before) - slip``: stick between the bounds, pull at +1 (the slip exceeds the presliding
range), release at -1. For the tension T >= 0 of a tendon driven by displacement ``F = take-up - displacement``:
zero where it is taut; where it is slack its path is shorter than the remaining tendon.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Scaled values below this do not move an unknown off its bound.
_TOLERANCE = 1e-11


def natural_residual(value: Array, v: Array, lower: Array, upper: Array) -> Array:
    """``v - clip(v - F)``, zero exactly where v solves the problem with the values F, shape (n,)."""
    return v - np.clip(v - value, lower, upper)


def solve_box(matrix: Array, offset: Array, start: Array, lower: Array, upper: Array) -> Array:
    """Solve the complementarity problem for ``F(v) = matrix @ v + offset``.

    Whole active sets are exchanged as long as that makes progress; then one index at a time, the least
    first, which ends for every matrix with positive principal minors (Murty's method).

    Parameters
    ----------
    matrix
        Shape (n, n).
    offset
        Shape (n,).
    start
        First guess of v, shape (n,).
    lower, upper
        Bounds; the upper may be infinite, shape (n,).

    Returns
    -------
    numpy.ndarray
        v, shape (n,); the best found where none solves the problem.
    """
    n = len(offset)
    scale = 1.0 / np.maximum(np.abs(np.diag(matrix)), 1e-30)
    v = np.clip(start, lower, upper)
    trial = v - scale * (matrix @ v + offset)
    bound = np.where(trial > upper, 1, np.where(trial < lower, -1, 0))
    best, least = v, np.inf
    for sweep in range(20 + 40 * n):
        v = np.where(bound > 0, upper, np.where(bound < 0, lower, 0.0))
        free, fixed = np.flatnonzero(bound == 0), np.flatnonzero(bound)
        if len(free):
            rest = offset[free] + matrix[np.ix_(free, fixed)] @ v[fixed]
            try:
                v[free] = np.linalg.solve(matrix[np.ix_(free, free)], -rest)
            except np.linalg.LinAlgError:
                v[free] = np.linalg.lstsq(matrix[np.ix_(free, free)], -rest, rcond=None)[0]
        value = scale * (matrix @ v + offset)
        value[free] = 0.0
        wanted = np.where(bound == 0, np.where(v > upper, 1, np.where(v < lower, -1, 0)), bound)
        wanted = np.where((bound == 1) & (value > _TOLERANCE), 0, wanted)
        wanted = np.where((bound == -1) & (value < -_TOLERANCE), 0, wanted)
        wrong = np.flatnonzero(wanted != bound)
        if not len(wrong):
            return v
        inside = np.clip(v, lower, upper)
        value = scale * (matrix @ inside + offset)
        error = float(np.max(np.abs(natural_residual(value, inside, lower, upper))))
        if error < least:
            best, least = inside, error
        if sweep < 20:
            bound = wanted
        else:
            bound[wrong[0]] = wanted[wrong[0]]
    return best
