"""Statistics of a sweep: moments and quantiles of the results, and Sobol indices with their intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from tdcr_fe.elements import Array

#: Resamples of a bootstrap interval, and its level.
RESAMPLES, LEVEL = 500, 0.95
_QUANTILES = {"2.5%": "quantile_2.5", "50%": "median", "97.5%": "quantile_97.5"}


def summarise(table: pd.DataFrame) -> pd.DataFrame:
    """Statistics of every column over the rows that have a number; the standard deviation is with ``count - 1``."""
    percentiles = [float(name.rstrip("%")) / 100.0 for name in _QUANTILES]
    return table.describe(percentiles=percentiles).rename(_QUANTILES) if len(table.columns) else table


def varies(values: Array, least: float = 1e-12) -> bool:
    """Whether a column has at least two different finite numbers, beyond rounding (a part in 10^9, or ``least``)."""
    values = values[np.isfinite(values)]
    if len(values) < 2:
        return False
    return bool(np.ptp(values) > max(1e-9 * float(np.abs(values).max()), least))


@dataclass(frozen=True)
class SobolIndices:
    """Shares of the variance of a result.

    Attributes
    ----------
    first : ndarray, shape (d,)
        What a variation explains by itself: ``V(E(y | x_i)) / V(y)``.
    total : ndarray, shape (d,)
        What it explains with all its interactions: ``E(V(y | x_others)) / V(y)``.
    first_interval, total_interval : ndarray, shape (d, 2)
        95 % intervals of a bootstrap over the base samples.
    samples : int
        Base samples with all their cases converged.
    """

    first: Array
    total: Array
    first_interval: Array
    total_interval: Array
    samples: int


def sobol_indices(values: Array, dimensions: int, seed: int = 0) -> SobolIndices | None:
    """Sobol indices of the first and the total order, with percentiles of a bootstrap.

    `scipy.stats.sobol_indices` has the same formulas, but takes no sample from which cases that did not converge are
    left out (their number must be a power of two), and its intervals cannot be repeated.

    Parameters
    ----------
    values
        A result, by case of a design of the method "saltelli", shape (n (d + 2),).
    dimensions
        Number d of variations.
    seed
        Of the bootstrap.

    Returns
    -------
    SobolIndices or None
        None where the result does not vary, or fewer than two base samples have all cases converged.
    """
    rows = values.reshape(-1, dimensions + 2)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if len(rows) < 2 or not varies(rows[:, :2].ravel()):
        return None
    random = np.random.default_rng(seed)
    resampled = [_indices(rows[random.integers(0, len(rows), len(rows))]) for _ in range(RESAMPLES)]
    tail = 0.5 * (1.0 - LEVEL)
    first, total = np.nanquantile(np.array(resampled), [tail, 1.0 - tail], axis=0).transpose(1, 2, 0)
    return SobolIndices(*_indices(rows), first, total, len(rows))


def _indices(rows: Array) -> tuple[Array, Array]:
    """First and total indices of results A, B, AB_1 ... AB_d, shape (n, d + 2).

    First order by Saltelli et al. (2010, Computer Physics Communications 181, Table 2 b), total order by Jansen (1999;
    ibid. Table 2 f).
    """
    a, b = rows[:, :1], rows[:, 1:2]
    both = np.concatenate((a, b))
    variance = both.var() or np.nan
    change = rows[:, 2:] - a
    return ((b - both.mean()) * change).mean(axis=0) / variance, 0.5 * (change**2).mean(axis=0) / variance
