"""Distributions of uncertain numbers, and points of samples: which values each case of a sweep has."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from scipy import stats
from scipy.stats import qmc

from tdcr_fe.elements import Array
from tdcr_fe.model.schema import Checked, Quantity

#: Probabilities stay this far from zero and one, so that quantiles are finite.
_EDGE = 2.0**-53
#: Least probability between the bounds of a truncated distribution.
_LEAST = 1e-9


class Distribution(Checked):
    """A random number: fields with their meaning, and the distribution of `scipy.stats` that they give."""

    def __post_init__(self) -> None:
        super().__post_init__()
        lower, upper = getattr(self, "lower", None), getattr(self, "upper", None)
        if lower is not None and upper is not None and not lower < upper:
            raise ValueError(f"lower = {lower:g} and upper = {upper:g}; lower must be below upper")
        self.frozen()  # refuses what does not fit together

    def frozen(self) -> Any:
        """The distribution of `scipy.stats`."""
        raise NotImplementedError

    @property
    def numbers(self) -> dict[str, float]:
        """Its numbers, by their keys in the file."""
        return {k: v for k, v in vars(self).items() if v is not None}

    def quantile(self, probability: Array) -> Array:
        """Values below which the number lies with these probabilities, shape ``probability.shape``."""
        return np.asarray(self.frozen().ppf(np.clip(probability, _EDGE, 1.0 - _EDGE)))


@dataclass(frozen=True)
class Uniform(Distribution):
    """Every value between two bounds is equally likely.

    Attributes
    ----------
    lower, upper : float
    """

    lower: Annotated[float, Quantity("smallest value")]
    upper: Annotated[float, Quantity("largest value")]

    def frozen(self) -> Any:
        """See `Distribution.frozen`."""
        return stats.uniform(self.lower, self.upper - self.lower)


@dataclass(frozen=True)
class Normal(Distribution):
    """Gaussian, truncated where bounds are given.

    Attributes
    ----------
    mean, std : float
        Of the distribution before truncation.
    lower, upper : float or None
        Values beyond them do not occur.
    """

    mean: Annotated[float, Quantity("mean")]
    std: Annotated[float, Quantity("standard deviation", gt=0.0)]
    lower: Annotated[float | None, Quantity("smallest value")] = None
    upper: Annotated[float | None, Quantity("largest value")] = None

    def frozen(self) -> Any:
        """See `Distribution.frozen`."""
        return _truncated(self.mean, self.std, self.lower, self.upper)


@dataclass(frozen=True)
class LogNormal(Distribution):
    """The logarithm is Gaussian.

    Attributes
    ----------
    median : float
    sigma : float
        Standard deviation of the natural logarithm; about the relative standard deviation where it is small [1].
    lower, upper : float or None
        Values beyond them do not occur.
    """

    median: Annotated[float, Quantity("median", gt=0.0)]
    sigma: Annotated[float, Quantity("standard deviation of the natural logarithm", gt=0.0)]
    lower: Annotated[float | None, Quantity("smallest value", gt=0.0)] = None
    upper: Annotated[float | None, Quantity("largest value", gt=0.0)] = None

    def frozen(self) -> Any:
        """The distribution of the logarithm."""
        lower, upper = (None if x is None else math.log(x) for x in (self.lower, self.upper))
        return _truncated(math.log(self.median), self.sigma, lower, upper)

    def quantile(self, probability: Array) -> Array:
        """See `Distribution.quantile`."""
        return np.exp(super().quantile(probability))


def _truncated(mean: float, std: float, lower: float | None, upper: float | None) -> Any:
    """A Gaussian between bounds.

    Raises
    ------
    ValueError
        Hardly anything lies between them.
    """
    whole = stats.norm(mean, std)
    if lower is None and upper is None:
        return whole
    low, high = (-math.inf if lower is None else lower), (math.inf if upper is None else upper)
    if whole.cdf(high) - whole.cdf(low) < _LEAST:
        raise ValueError("the bounds lower and upper leave out the whole distribution")
    return stats.truncnorm((low - mean) / std, (high - mean) / std, mean, std)


def unit_points(method: str, samples: int, dimensions: int, seed: int) -> Array:
    """Points of the unit cube, shape (n, dimensions).

    Parameters
    ----------
    method
        "latin-hypercube"; "sobol": scrambled Sobol points; "saltelli": for every one of ``samples`` pairs A, B of Sobol
        points the rows A, B, and d copies of A with one coordinate from B, in this order.
    samples
        A power of two for "sobol" and "saltelli".
    seed
        Of the random numbers.
    """
    random = np.random.default_rng(seed)
    if method == "latin-hypercube":
        return np.asarray(qmc.LatinHypercube(dimensions, seed=random).random(samples))
    if method == "sobol":
        return np.asarray(qmc.Sobol(dimensions, seed=random).random(samples))
    both = qmc.Sobol(2 * dimensions, seed=random).random(samples)
    a, b = both[:, :dimensions], both[:, dimensions:]
    rows = np.repeat(a[:, None, :], dimensions + 2, axis=1)
    rows[:, 1, :] = b
    for k in range(dimensions):
        rows[:, 2 + k, k] = b[:, k]
    return rows.reshape(-1, dimensions)
