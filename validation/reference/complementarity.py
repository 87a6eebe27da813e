"""Stick and slip as a complementarity problem: which share of its friction acts at each hole.

At a hole the mobilisation s lies in -1..1, and the tendon that passes follows from the linearised robot,
``F(s) = presliding (s - s_before) - moved(s)``: between the bounds F is zero (stick), at +1 it is not
positive (pull: more has passed than sticking allows), at -1 not negative (release).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def natural_residual(value: Array, s: Array) -> Array:
    """``s - clip(s - F, -1, 1)``, zero exactly where s solves the problem with the values F, shape (n,)."""
    return s - np.clip(s - value, -1.0, 1.0)


def solve_box(matrix: Array, offset: Array, start: Array) -> Array:
    """Solve the complementarity problem on the box -1..1 for ``F(s) = matrix @ s + offset``.

    Whole active sets are exchanged as long as that makes progress; then one index at a time, the least
    first, which ends for every matrix with positive principal minors (Murty's method).

    Parameters
    ----------
    matrix
        [m], shape (n, n).
    offset
        [m], shape (n,).
    start
        First guess of s, shape (n,).

    Returns
    -------
    numpy.ndarray
        s, shape (n,).
    """
    n = len(offset)
    scale = 1.0 / np.maximum(np.abs(np.diag(matrix)), 1e-30)
    s = np.clip(start, -1.0, 1.0)
    trial = s - scale * (matrix @ s + offset)
    bound = np.where(trial > 1.0, 1, np.where(trial < -1.0, -1, 0))
    best, least = s, np.inf
    for sweep in range(20 + 40 * n):
        s = bound.astype(float)
        free = np.flatnonzero(bound == 0)
        if len(free):
            rest = offset[free] + matrix[np.ix_(free, np.flatnonzero(bound))] @ s[bound != 0]
            try:
                s[free] = np.linalg.solve(matrix[np.ix_(free, free)], -rest)
            except np.linalg.LinAlgError:
                s[free] = np.linalg.lstsq(matrix[np.ix_(free, free)], -rest, rcond=None)[0]
        value = matrix @ s + offset
        value[free] = 0.0
        wanted = np.where(bound == 0, np.where(s > 1.0, 1, np.where(s < -1.0, -1, 0)), bound)
        wanted = np.where((bound == 1) & (value > 0.0), 0, wanted)
        wanted = np.where((bound == -1) & (value < 0.0), 0, wanted)
        wrong = np.flatnonzero(wanted != bound)
        if not len(wrong):
            return s
        inside = np.clip(s, -1.0, 1.0)
        error = float(np.max(np.abs(natural_residual(scale * (matrix @ inside + offset), inside))))
        if error < least:
            best, least = inside, error
        if sweep < 20:
            bound = wanted
        else:
            bound[wrong[0]] = wanted[wrong[0]]
    return best
