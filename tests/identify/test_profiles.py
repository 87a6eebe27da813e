"""Profiles of fitted parameters: normal where the model is linear, and the interval where it is not."""

from dataclasses import replace

import numpy as np
import pytest
from identify_result import GRAVITY, result

from tdcr_fe.identify import figures
from tdcr_fe.identify.result import Parameters, Profile

DISTANCES = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])


def test_a_linear_parameter_has_a_normal_profile_and_its_interval():
    """Value 3, standard error 0.5."""
    profile = Profile("a.b", 3.0 + 0.5 * DISTANCES, DISTANCES)
    assert profile.is_normal
    assert profile.interval == pytest.approx((3.0 - 0.98, 3.0 + 0.98))


def test_the_interval_of_a_parameter_that_is_not_normal_is_that_of_its_profile():
    """A misfit that grows by the logarithm of the value: the interval is not symmetric about the estimate of one."""
    profile = Profile("a.b", np.exp(0.5 * DISTANCES), 1.3 * DISTANCES)
    assert not profile.is_normal
    low, high = profile.interval
    assert high - 1.0 > 1.5 * (1.0 - low)


def test_pairs_that_the_data_hardly_separate_are_drawn_by_their_region():
    """Points of the region are at a distance of 5.99, the 95 % quantile of chi-square, by the covariance."""
    correlation = np.array([[1.0, 0.9, 0.1], [0.9, 1.0, 0.2], [0.1, 0.2, 1.0]])
    names = ("gravity (a form of it).g_x", "gravity (a form of it).g_y", "gravity (a form of it).g_z")
    found = tuple(Profile(name, 0.1 * DISTANCES, DISTANCES) for name in names)
    drawn = figures.parameters(
        result(
            replace(GRAVITY, form="gravity (a form of it)"),
            parameters=Parameters(names, correlation, found),
        )
    )
    region = [ax for ax in drawn.axes if ax.get_visible()][3:]
    assert len(region) == 1
    x, y = region[0].lines[0].get_data()
    apart = np.array([x / 0.01, (y - 6.95) / 0.007])
    distance = np.einsum("in,ij,jn->n", apart, np.linalg.inv(correlation[:2, :2]), apart)
    assert distance == pytest.approx(np.full(len(x), 5.99))
