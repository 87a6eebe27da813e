"""Routings as functions of arc length: derivatives, limits, and lengths of unloaded tendons against quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from robots import LENGTH

from tdcr_fe.model.routing import (
    ConvergingRouting,
    HelicalRouting,
    MisplacedRouting,
    ParallelRouting,
    PointsRouting,
    TwistedRouting,
    VaryingHelicalRouting,
)

S = np.linspace(0.0, LENGTH, 14)
HOLES = tuple((1e-3 * np.cos(k), 1e-3 * np.sin(k)) for k in range(14))
SAMPLES = [
    ParallelRouting(4e-3, 20.0),
    HelicalRouting(4e-3, 1.5, 20.0),
    VaryingHelicalRouting(4e-3, -1.0, 2.0, 20.0),
    ConvergingRouting(4e-3, 1e-3, 20.0),
    PointsRouting(tuple(S), HOLES),
    TwistedRouting(VaryingHelicalRouting(4e-3, 0.5, 2.0), 3.0),
    MisplacedRouting(VaryingHelicalRouting(4e-3, 0.5, 2.0), 1.2, 0.6, 0.3, -0.5),
]
turns = st.floats(-5.0, 5.0)


@pytest.mark.parametrize("routing", SAMPLES, ids=lambda r: r.kind)
def test_derivatives_are_those_of_the_position(routing):
    """Central differences of order two: the error falls by four where the step halves."""
    s = np.linspace(0.03, 0.21, 7) + 1e-4
    errors = []
    for h in (2e-4, 1e-4):
        up, down = routing.position(s + h, LENGTH), routing.position(s - h, LENGTH)
        first = (up - down) / (2.0 * h) - routing.position(s, LENGTH, 1)
        second = (up - 2.0 * routing.position(s, LENGTH) + down) / h**2 - routing.position(s, LENGTH, 2)
        errors.append((np.abs(first).max(), np.abs(second).max()))
    (first, second), (first_half, second_half) = errors
    assert first_half <= 0.26 * first + 1e-9
    assert second_half <= 0.26 * second + 1e-5 or routing.kind == "points"  # whose third derivative jumps
    with pytest.raises(ValueError, match="orders 0, 1 and 2"):
        routing.position(s, LENGTH, 3)


@given(turns, st.floats(-360.0, 360.0), st.sampled_from([0, 1, 2]))
def test_varying_helix_with_equal_rates_is_the_helix(rate, angle, derivative):
    varying = VaryingHelicalRouting(4e-3, rate, rate, angle).position(S, LENGTH, derivative)
    np.testing.assert_allclose(
        varying, HelicalRouting(4e-3, rate, angle).position(S, LENGTH, derivative), atol=1e-11
    )
