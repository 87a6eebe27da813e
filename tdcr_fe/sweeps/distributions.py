"""Distributions of uncertain numbers, each given by its quantile function."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from tdcr_fe.model.schema import Quantity, check_fields

Array = NDArray[np.float64]

#: Largest distance of a probability from zero or one at which quantiles are still computed: they stay finite.
_EDGE = 2.0**-53


class Distribution(Protocol):
    """A random number."""

    def quantile(self, probability: Array) -> Array:
        """Values below which the number lies with these probabilities, shape ``probability.shape``."""
        ...


def _check_order(lower: float | None, upper: float | None) -> None:
    if lower is not None and upper is not None and not lower < upper:
        raise ValueError(f"lower = {lower:g} and upper = {upper:g}; lower must be below upper")


@dataclass(frozen=True)
class Uniform:
    """Every value between two bounds is equally likely.

    Attributes
    ----------
    lower, upper : float
    """

    lower: Annotated[float, Quantity("smallest value")]
    upper: Annotated[float, Quantity("largest value")]

    def __post_init__(self) -> None:
        check_fields(self)
        _check_order(self.lower, self.upper)

    def quantile(self, probability: Array) -> Array:
        """See `Distribution.quantile`."""
        return self.lower + probability * (self.upper - self.lower)


@dataclass(frozen=True)
class LogUniform:
    """The logarithm is uniform.

    Attributes
    ----------
    lower, upper : float
        Of the value itself, above zero.
    """

    lower: Annotated[float, Quantity("smallest value", gt=0.0)]
    upper: Annotated[float, Quantity("largest value", gt=0.0)]

    def __post_init__(self) -> None:
        check_fields(self)
        _check_order(self.lower, self.upper)

    def quantile(self, probability: Array) -> Array:
        """See `Distribution.quantile`."""
        return self.lower * (self.upper / self.lower) ** probability


@dataclass(frozen=True)
class Normal:
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

    def __post_init__(self) -> None:
        check_fields(self)
        _check_order(self.lower, self.upper)
        _probabilities(self.lower, self.upper, self.mean, self.std)

    def quantile(self, probability: Array) -> Array:
        """See `Distribution.quantile`."""
        low, high = _probabilities(self.lower, self.upper, self.mean, self.std)
        inside = np.clip(low + probability * (high - low), _EDGE, 1.0 - _EDGE)
        found = np.asarray(self.mean + self.std * ndtri(inside), dtype=float)
        return np.clip(found, self.lower, self.upper) if (self.lower, self.upper) != (None, None) else found


def _probabilities(lower: float | None, upper: float | None, mean: float, std: float) -> tuple[float, float]:
    """Probabilities of a Gaussian below its two bounds.

    Raises
    ------
    ValueError
        Hardly anything lies between them.
    """
    low = 0.0 if lower is None else float(ndtr((lower - mean) / std))
    high = 1.0 if upper is None else float(ndtr((upper - mean) / std))
    if high - low < 1e-9:
        raise ValueError("the bounds lower and upper leave out the whole distribution")
    return low, high


@dataclass(frozen=True)
class LogNormal:
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

    def __post_init__(self) -> None:
        check_fields(self)
        _check_order(self.lower, self.upper)
        self._logarithm()

    def _logarithm(self) -> Normal:
        lower, upper = (None if x is None else math.log(x) for x in (self.lower, self.upper))
        return Normal(math.log(self.median), self.sigma, lower, upper)

    def quantile(self, probability: Array) -> Array:
        """See `Distribution.quantile`."""
        return np.exp(self._logarithm().quantile(probability))


@dataclass(frozen=True)
class Triangular:
    """Density that rises linearly to the mode and falls linearly from there.

    Attributes
    ----------
    lower, mode, upper : float
    """

    lower: Annotated[float, Quantity("smallest value")]
    mode: Annotated[float, Quantity("most likely value")]
    upper: Annotated[float, Quantity("largest value")]

    def __post_init__(self) -> None:
        check_fields(self)
        _check_order(self.lower, self.upper)
        if not self.lower <= self.mode <= self.upper:
            raise ValueError(f"mode = {self.mode:g}; must lie between lower and upper")

    def quantile(self, probability: Array) -> Array:
        """See `Distribution.quantile`."""
        width = self.upper - self.lower
        left, right = self.mode - self.lower, self.upper - self.mode
        rising = self.lower + np.sqrt(probability * width * left)
        falling = self.upper - np.sqrt((1.0 - probability) * width * right)
        return np.where(probability * width <= left, rising, falling)


#: Every distribution, by the key that gives it in ``[[vary]]``.
DISTRIBUTIONS: dict[str, type[Distribution]] = {
    "uniform": Uniform,
    "loguniform": LogUniform,
    "normal": Normal,
    "lognormal": LogNormal,
    "triangular": Triangular,
}
