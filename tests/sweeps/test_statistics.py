"""Designs and samples follow their distributions, with quantiles of SciPy; Sobol indices against closed forms."""

from collections import Counter
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from tdcr_fe.report.style import panels
from tdcr_fe.sweeps import description
from tdcr_fe.sweeps.cases import ABOUT_CASE
from tdcr_fe.sweeps.description import LogNormal, Normal, Output, Range, Sampling, Sweep, Uniform, Variation
from tdcr_fe.sweeps.report import sobol
from tdcr_fe.sweeps.result import SweepResult, sobol_indices

A, B = 7.0, 0.1
#: Indices of Ishigami's function (Ishigami and Homma 1990; Saltelli et al., Sensitivity Analysis, 2000, section 2.9.3).
_V1 = 0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2
_V2 = A**2 / 8.0
_V13 = B**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
FIRST = np.array([_V1, _V2, 0.0]) / (_V1 + _V2 + _V13)
TOTAL = np.array([_V1 + _V13, _V2, _V13]) / (_V1 + _V2 + _V13)


def ishigami_sample(n):
    x, y, z = np.pi * (2.0 * description.unit_points("saltelli", n, 3, 1).T - 1.0)
    return np.sin(x) + A * np.sin(y) ** 2 + B * z**4 * np.sin(x)


def test_sobol_indices_of_ishigamis_function():
    found = sobol_indices(ishigami_sample(4096), 3)
    assert found.samples == 4096
    assert np.allclose(found.first, FIRST, atol=0.015)
    assert np.allclose(found.total, TOTAL, atol=0.015)
    for interval, exact in ((found.first_interval, FIRST), (found.total_interval, TOTAL)):
        assert (interval[:, 0] < exact + 0.005).all() and (exact < interval[:, 1] + 0.005).all()
        assert (np.ptp(interval, axis=1) < 0.12).all()


def test_base_samples_with_a_case_missing_are_left_out_and_a_constant_has_no_indices():
    values = ishigami_sample(512)
    without = values.copy()
    without[7 * 5 + 2] = np.nan
    expected = sobol_indices(np.delete(values.reshape(-1, 5), 7, axis=0).ravel(), 3)
    found = sobol_indices(without, 3)
    assert found.samples == 511
    assert np.array_equal(found.first, expected.first) and np.array_equal(found.total, expected.total)
    assert sobol_indices(np.full(50, 3.0), 3) is None
    assert sobol_indices(np.full(50, np.nan), 3) is None


def test_what_the_solver_does_not_resolve_is_left_out_and_pictures_of_six_results_have_room():
    """A robot at rest had statistics of 1e-8 degrees; titles lay on each other, and labels left the axes no width."""
    names = ["bending_angle_deg", *(f"bending_angle_deg_step{k}" for k in range(1, 7))]
    varied = tuple(Variation(f"tendons.t{k}.friction_coefficient", values=(0.1,)) for k in range(3))
    table = pd.DataFrame(np.random.default_rng(1).random((40, len(ABOUT_CASE) + 10)))
    table.columns = [*ABOUT_CASE, *(v.key for v in varied), *names]
    table["bending_angle_deg"] *= 1e-7
    result = SweepResult(Sweep(None, varied, Sampling("saltelli", 8), Output("all", tuple(names))), table)
    assert list(result.statistics()) == names[1:]
    figure = sobol(result)
    figure.draw_without_rendering()
    titles = [ax._left_title.get_window_extent() for ax in figure.axes]
    assert all(left.x1 < right.x0 for left, right in pairwise(titles))
    panels(figure)  # warned that the axes have no width


# ------------------------------------------------------------ sampling


def design(method, *options, **sampling):
    """Values of all cases, by variation."""
    variations = [Variation(key="tip_mass", name=f"v{k}", values=tuple(x)) for k, x in enumerate(options)]
    return list(Sweep(None, tuple(variations), Sampling(method, **sampling)).design().values())


def test_the_last_variation_of_a_grid_changes_fastest_and_lists_are_taken_together():
    numbers, letters = [1.0, 2.0, 3.0], ["a", "b", "c"]
    cases = list(zip(*design("grid", numbers[:2], letters), strict=True))
    assert cases == [(x, y) for x in numbers[:2] for y in letters]
    assert design("list", numbers, letters) == [numbers, letters]
    # A range has equal distances or ratios.
    assert Range(0.0, 3.0, 4).values() == (0, 1, 2, 3)
    assert all(isinstance(x, int) for x in Range(2.0, 8.0, 4).values())
    assert Range(1e-3, 1.0, 4, "logarithmic").values() == pytest.approx((1e-3, 1e-2, 1e-1, 1.0))


@pytest.mark.parametrize("method", ["latin-hypercube", "sobol", "saltelli"])
def test_the_seed_decides_the_sample(method):
    a, b, c = (description.unit_points(method, 16, 2, seed) for seed in (1, 1, 2))
    assert np.array_equal(a, b) and not np.array_equal(a, c)


@pytest.mark.parametrize(
    ("mine", "theirs"),
    [
        (Uniform(-1.0, 3.0), stats.uniform(-1.0, 4.0)),
        (Normal(2.0, 0.5), stats.norm(2.0, 0.5)),
        (Normal(2.0, 0.5, lower=1.8, upper=3.0), stats.truncnorm(-0.4, 2.0, 2.0, 0.5)),
        (LogNormal(3.0, 0.2), stats.lognorm(0.2, scale=3.0)),
    ],
    ids=lambda x: type(x).__name__,
)
def test_quantiles_are_those_of_scipy(mine, theirs):
    p = np.linspace(0.001, 0.999, 101)
    assert np.allclose(mine.quantile(p), theirs.ppf(p), rtol=1e-12, atol=1e-12)


def test_quantiles_at_zero_and_one_are_within_the_bounds_and_options_equally_likely():
    edges = np.array([0.0, 1.0])
    assert np.isfinite(Normal(0.0, 1.0).quantile(edges)).all()
    assert Normal(0.0, 1.0, lower=-1.0, upper=2.0).quantile(edges) == pytest.approx([-1.0, 2.0])
    assert LogNormal(1.0, 0.5, lower=0.9).quantile(edges)[0] >= 0.9
    (values,) = design("sobol", "abcd", samples=1024, seed=3)
    assert Counter(values) == dict.fromkeys("abcd", 256)
