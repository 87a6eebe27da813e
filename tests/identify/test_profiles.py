"""Profiles of fitted parameters: normal where the model is linear, and the interval where it is not."""

import numpy as np
import pytest

from tdcr_fe.identify.result import Profile

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
