"""Sobol indices against closed forms and SciPy's; what pictures show."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from tdcr_fe.sweeps.description import Sampling, Sweep, Variation
from tdcr_fe.sweeps.report import _findings
from tdcr_fe.sweeps.result import SweepResult
from tdcr_fe.sweeps.sampling import Uniform, unit_points
from tdcr_fe.sweeps.statistics import sobol_indices, varies

A, B = 7.0, 0.1
#: Indices of Ishigami's function (Ishigami and Homma 1990; Saltelli et al., Sensitivity Analysis, 2000, section 2.9.3).
_V1 = 0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2
_V2 = A**2 / 8.0
_V13 = B**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
FIRST = np.array([_V1, _V2, 0.0]) / (_V1 + _V2 + _V13)
TOTAL = np.array([_V1 + _V13, _V2, _V13]) / (_V1 + _V2 + _V13)


def ishigami(x):
    return np.sin(x[:, 0]) + A * np.sin(x[:, 1]) ** 2 + B * x[:, 2] ** 4 * np.sin(x[:, 0])


def ishigami_sample(n, seed=1):
    return ishigami(np.pi * (2.0 * unit_points("saltelli", n, 3, seed) - 1.0))


def test_sobol_indices_of_ishigamis_function():
    found = sobol_indices(ishigami_sample(4096), 3)
    assert found.samples == 4096
    assert np.allclose(found.first, FIRST, atol=0.015)
    assert np.allclose(found.total, TOTAL, atol=0.015)
    for interval, exact in ((found.first_interval, FIRST), (found.total_interval, TOTAL)):
        assert (interval[:, 0] < exact + 0.005).all() and (exact < interval[:, 1] + 0.005).all()
        assert (np.ptp(interval, axis=1) < 0.12).all()


def test_indices_are_those_of_scipy():
    rows = ishigami_sample(256).reshape(-1, 5)
    theirs = stats.sobol_indices(
        func={"f_A": rows[:, 0][None], "f_B": rows[:, 1][None], "f_AB": rows[:, 2:].T[:, None, :]}, n=256
    )
    mine = sobol_indices(rows.ravel(), 3)
    assert np.allclose(mine.first, theirs.first_order, atol=1e-9)
    assert np.allclose(mine.total, theirs.total_order, atol=1e-9)


def findings(samples):
    """First sentences of the report on Ishigami's function."""
    names = ("x1", "x2", "x3")
    variations = tuple(Variation("tip_mass", name=n, uniform=Uniform(-np.pi, np.pi)) for n in names)
    about = {"case": 0, "status": "converged", "reason": "", "warnings": 0}
    cases = pd.DataFrame({"y": ishigami_sample(samples)}).assign(**about, **dict.fromkeys(names, 0.0))
    sweep = Sweep(None, variations, Sampling("saltelli", samples, 1))
    return _findings(SweepResult(sweep, cases[[*about, *names, "y"]]))


def test_the_report_asks_for_more_samples_where_an_index_is_open():
    """With 16 base samples it printed shares of the variance up to 1.14."""
    assert findings(16)[1].startswith("Too few samples for Sobol indices: ")
    assert findings(16)[1].endswith("Use samples = 256.")
    text = findings(4096)[1]
    assert re.match(
        r"Total-order Sobol index of x1 for y: 0\.5[56] \(95 % interval 0\.\d\d to", text
    )  # 0.558 is exact


def test_base_samples_with_a_case_missing_are_left_out():
    values = ishigami_sample(512)
    without = values.copy()
    without[7 * 5 + 2] = np.nan
    expected = sobol_indices(np.delete(values.reshape(-1, 5), 7, axis=0).ravel(), 3)
    found = sobol_indices(without, 3)
    assert found.samples == 511
    assert np.array_equal(found.first, expected.first) and np.array_equal(found.total, expected.total)


def test_a_constant_has_no_indices():
    assert sobol_indices(np.full(50, 3.0), 3) is None
    assert sobol_indices(np.full(50, np.nan), 3) is None


@pytest.mark.parametrize(
    ("values", "answer"),
    [([1.0, 1.0 + 1e-12], False), ([1e-17, -3e-16], False), ([0.0, 1e-6], True), ([np.nan, 1.0], False)],
)
def test_rounding_is_no_variation(values, answer):
    assert varies(np.array(values)) is answer
