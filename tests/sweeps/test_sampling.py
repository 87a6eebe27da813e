"""Designs: order of a grid, samples that follow their distributions, the same numbers for the same seed."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from scipy import stats

from tdcr_fe.sweeps.description import Range, Sampling, Sweep, Variation
from tdcr_fe.sweeps.sampling import LogNormal, LogUniform, Normal, Triangular, Uniform, unit_points


def design(method, *options, **sampling):
    """Values of all cases, by variation."""
    variations = tuple(
        Variation(key="tip_mass", name=f"v{k}", values=tuple(x)) for k, x in enumerate(options)
    )
    return list(Sweep(None, variations, Sampling(method, **sampling)).design().values())


def test_the_last_variation_of_a_grid_changes_fastest_and_lists_are_taken_together():
    numbers, letters = [1.0, 2.0, 3.0], ["a", "b", "c"]
    cases = list(zip(*design("grid", numbers[:2], letters), strict=True))
    assert cases == [(x, y) for x in numbers[:2] for y in letters]
    assert design("list", numbers, letters) == [numbers, letters]


def test_a_range_has_equal_distances_or_ratios():
    assert Range(0.0, 3.0, 4).values() == (0, 1, 2, 3)
    assert all(isinstance(x, int) for x in Range(2.0, 8.0, 4).values())
    assert Range(1e-3, 1.0, 4, "logarithmic").values() == pytest.approx((1e-3, 1e-2, 1e-1, 1.0))


@pytest.mark.parametrize("method", ["latin-hypercube", "sobol", "saltelli"])
def test_the_seed_decides_the_sample(method):
    a, b, c = (unit_points(method, 16, 2, seed) for seed in (1, 1, 2))
    assert np.array_equal(a, b) and not np.array_equal(a, c)


def test_rows_of_the_saltelli_design():
    """A, B, then A with one coordinate of B, for every base sample: complete where a sweep was interrupted."""
    points = unit_points("saltelli", 8, 3, seed=0).reshape(8, 5, 3)
    for a, b, *mixed in points:
        for k, row in enumerate(mixed):
            expected = a.copy()
            expected[k] = b[k]
            assert np.array_equal(row, expected)


@pytest.mark.parametrize(
    ("mine", "theirs"),
    [
        (Uniform(-1.0, 3.0), stats.uniform(-1.0, 4.0)),
        (LogUniform(0.1, 10.0), stats.loguniform(0.1, 10.0)),
        (Normal(2.0, 0.5), stats.norm(2.0, 0.5)),
        (Normal(2.0, 0.5, lower=1.8, upper=3.0), stats.truncnorm(-0.4, 2.0, 2.0, 0.5)),
        (LogNormal(3.0, 0.2), stats.lognorm(0.2, scale=3.0)),
        (Triangular(1.0, 2.0, 5.0), stats.triang(0.25, 1.0, 4.0)),
        (Triangular(1.0, 5.0, 5.0), stats.triang(1.0, 1.0, 4.0)),
    ],
    ids=lambda x: type(x).__name__,
)
def test_quantiles_are_those_of_scipy(mine, theirs):
    p = np.linspace(0.001, 0.999, 101)
    assert np.allclose(mine.quantile(p), theirs.ppf(p), rtol=1e-12, atol=1e-12)


def test_quantiles_at_zero_and_one_are_finite_and_within_the_bounds():
    edges = np.array([0.0, 1.0])
    assert np.isfinite(Normal(0.0, 1.0).quantile(edges)).all()
    assert Normal(0.0, 1.0, lower=-1.0, upper=2.0).quantile(edges) == pytest.approx([-1.0, 2.0])
    assert LogNormal(1.0, 0.5, lower=0.9).quantile(edges)[0] >= 0.9


@pytest.mark.parametrize(
    "make",
    [
        lambda: Uniform(2.0, 1.0),
        lambda: Normal(0.0, -1.0),
        lambda: Normal(0.0, 1.0, lower=40.0),
        lambda: LogNormal(-1.0, 0.1),
        lambda: Triangular(0.0, 2.0, 1.0),
        lambda: Range(-1.0, 1.0, 3, "logarithmic"),
        lambda: Uniform(0.0, math.nan),
    ],
)
def test_a_distribution_that_cannot_be_is_refused(make):
    with pytest.raises(ValueError):
        make()


def test_options_of_a_sample_are_equally_likely():
    (values,) = design("sobol", "abcd", samples=1024, seed=3)
    assert Counter(values) == dict.fromkeys("abcd", 256)
