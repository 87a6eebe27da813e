"""Designs of a sweep: which values each case has, from grids, lists and samples of the unit cube."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.stats import qmc

Array = NDArray[np.float64]

#: Ways of choosing cases. Those of `SAMPLED` draw from distributions.
METHODS = ("grid", "list", "latin-hypercube", "sobol", "saltelli")
SAMPLED = ("latin-hypercube", "sobol", "saltelli")

#: Name of the argument of SciPy's samplers that takes the random numbers.
_RANDOM = "rng" if tuple(map(int, scipy.__version__.split(".")[:2])) >= (1, 15) else "seed"


@dataclass(frozen=True)
class Column:
    """Values of one variation, by case.

    Attributes
    ----------
    options : tuple
        Values to choose from; empty where `numbers` are the values.
    numbers : ndarray, shape (n_cases,)
        The values, or numbers of options.
    """

    options: tuple[Any, ...]
    numbers: NDArray[Any]

    def __getitem__(self, case: int) -> Any:
        """Value of a case, counted from 0."""
        number = self.numbers[case].item()
        return self.options[number] if self.options else number


@dataclass(frozen=True)
class Design:
    """All cases of a sweep.

    Attributes
    ----------
    method : str
        One of `METHODS`.
    columns : tuple of Column
        One a variation.
    count : int
        Number of cases.
    base_samples : int
        Of the method "saltelli": rows of its two base matrices, N of N (d + 2) cases; else 0.
    """

    method: str
    columns: tuple[Column, ...]
    count: int
    base_samples: int = 0

    def case(self, number: int) -> tuple[Any, ...]:
        """Values of a case, counted from 0, one a variation."""
        return tuple(column[number] for column in self.columns)


def grid(options: Sequence[Sequence[Any]]) -> Design:
    """Every combination; the last variation changes fastest."""
    sizes = [len(o) for o in options]
    count = math.prod(sizes)
    indices = np.unravel_index(np.arange(count), sizes)
    columns = tuple(Column(tuple(o), i.astype(np.int64)) for o, i in zip(options, indices, strict=True))
    return Design("grid", columns, count)


def together(options: Sequence[Sequence[Any]]) -> Design:
    """The first values of all variations, then the second ones, and so on; lists of equal length."""
    count = len(options[0])
    return Design("list", tuple(Column(tuple(o), np.arange(count)) for o in options), count)


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
    random: dict[str, Any] = {_RANDOM: np.random.default_rng(seed)}
    if method == "latin-hypercube":
        return np.asarray(qmc.LatinHypercube(dimensions, **random).random(samples))
    if method == "sobol":
        return np.asarray(qmc.Sobol(dimensions, **random).random(samples))
    both = qmc.Sobol(2 * dimensions, **random).random(samples)
    a, b = both[:, :dimensions], both[:, dimensions:]
    rows = np.repeat(a[:, None, :], dimensions + 2, axis=1)
    rows[:, 1, :] = b
    for k in range(dimensions):
        rows[:, 2 + k, k] = b[:, k]
    return rows.reshape(-1, dimensions)


def numbers_of(options: Sequence[Any], probabilities: Array) -> NDArray[np.int64]:
    """Numbers of equally likely options, from probabilities between 0 and 1."""
    return np.minimum((probabilities * len(options)).astype(np.int64), len(options) - 1)
