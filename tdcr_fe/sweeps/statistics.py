"""Statistics of a sweep: moments and quantiles of the results, main effects, and Sobol indices with their intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Resamples of a bootstrap interval, and its level.
RESAMPLES, LEVEL = 500, 0.95


@dataclass(frozen=True)
class Summary:
    """Statistics of one result over the cases that converged.

    Attributes
    ----------
    count : int
    mean, std : float
        Standard deviation with ``count - 1``.
    smallest, largest : float
    quantiles : tuple of float
        At 2.5 %, 50 % and 97.5 %.
    """

    count: int
    mean: float
    std: float
    smallest: float
    largest: float
    quantiles: tuple[float, float, float]


def summarise(values: Array) -> Summary:
    """Statistics of a column; numbers that are not finite are left out."""
    values = values[np.isfinite(values)]
    if not len(values):
        nan = float("nan")
        return Summary(0, nan, nan, nan, nan, (nan, nan, nan))
    std = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    low, middle, high = (float(x) for x in np.quantile(values, [0.025, 0.5, 0.975]))
    return Summary(
        len(values), float(values.mean()), std, float(values.min()), float(values.max()), (low, middle, high)
    )


def varies(values: Array) -> bool:
    """Whether a column has at least two different finite numbers, beyond rounding (a part in 10^9, or 10^-12)."""
    values = values[np.isfinite(values)]
    if len(values) < 2:
        return False
    return bool(np.ptp(values) > 1e-9 * max(float(np.abs(values).max()), 1e-3))


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
    """Sobol indices of the first and the total order.

    First order by Saltelli et al. (2010, Computer Physics Communications 181, Table 2 b), total order by Jansen (1999;
    ibid. Table 2 f); intervals are percentiles of a bootstrap.

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
    first, total = _indices(rows[None])
    random = np.random.default_rng(seed)
    samples = [_indices(rows[random.integers(0, len(rows), len(rows))][None]) for _ in range(RESAMPLES)]
    tail = 0.5 * (1.0 - LEVEL)
    low_high = [
        np.nanquantile(np.concatenate([s[k] for s in samples]), [tail, 1.0 - tail], axis=0).T for k in (0, 1)
    ]
    return SobolIndices(first[0], total[0], low_high[0], low_high[1], len(rows))


def _indices(rows: Array) -> tuple[Array, Array]:
    """First and total indices of tables of results A, B, AB_1 ... AB_d, shape (tables, n, d + 2)."""
    a, b, mixed = rows[..., 0], rows[..., 1], rows[..., 2:]
    both = np.concatenate((a, b), axis=-1)
    mean, variance = both.mean(axis=-1), both.var(axis=-1)
    variance = np.where(variance > 0.0, variance, np.nan)[:, None]
    change = mixed - a[..., None]
    first = np.mean((b - mean[:, None])[..., None] * change, axis=1) / variance
    total = 0.5 * np.mean(change**2, axis=1) / variance
    return first, total


def main_effect(inputs: NDArray[np.int64], values: Array, levels: int) -> tuple[Array, Array]:
    """Mean of a result at each level of an input, and its standard error, each of shape (levels,).

    Parameters
    ----------
    inputs
        Level of each case.
    values
        Result of each case; NaN where there is none.
    levels
        Number of levels.
    """
    sound = np.isfinite(values)
    at, y = inputs[sound], values[sound]
    count = np.bincount(at, minlength=levels).astype(float)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(at, y, minlength=levels) / count
        square = np.bincount(at, (y - mean[at]) ** 2, minlength=levels)
        error = np.sqrt(square / np.maximum(count - 1.0, 1.0) / count)
    return mean, error


def bins(values: Array, most: int = 12) -> tuple[NDArray[np.int64], Array]:
    """Bins with about as many cases each, for main effects of a continuous input.

    Returns
    -------
    ndarray of int, shape (n,)
        Bin of each case.
    ndarray, shape (bins,)
        Mean of the values in each bin.
    """
    count = max(2, min(most, len(values) // 10))
    order = np.argsort(values, kind="stable")
    number = np.empty(len(values), dtype=np.int64)
    number[order] = np.arange(len(values)) * count // len(values)
    means = np.bincount(number, values, minlength=count) / np.bincount(number, minlength=count)
    return number, means
