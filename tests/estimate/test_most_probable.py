"""The most probable unknowns: the Kalman filter where the model is linear, the least misfit where it is not."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import minimize

from tdcr_fe.estimate.frame import Volume
from tdcr_fe.estimate.most_probable import most_probable, posterior_covariance


def at(residual, jacobian, **rest):
    """Residual and derivatives of a solved frame, as its readings see them."""
    return SimpleNamespace(residual=residual, jacobian=jacobian, **rest)


def linear(h, y):
    return lambda x, near: at(y - h @ x, h)


def test_a_linear_problem_has_mean_and_covariance_of_the_kalman_filter_also_with_a_singular_prior():
    rng = np.random.default_rng(1)
    root, h, y, mean = (rng.normal(size=shape) for shape in ((6, 4), (3, 6), 3, 6))
    prior = root @ root.T  # of rank 4
    found = most_probable(linear(h, y), mean, prior, np.zeros(6))
    innovation, spread = y - h @ mean, h @ prior @ h.T + np.eye(3)
    gain = prior @ h.T @ np.linalg.inv(spread)
    expected = mean + gain @ innovation
    np.testing.assert_allclose(found.point.residual, y - h @ expected, atol=1e-9)
    np.testing.assert_allclose(posterior_covariance(prior, h), prior - gain @ h @ prior, atol=1e-9)
    assert found.misfit == pytest.approx(innovation @ np.linalg.solve(spread, innovation))
    assert found.converged


def test_without_readings_the_prior_stays():
    none, prior = np.zeros((0, 2)), np.diag([1.0, 4.0])
    assert most_probable(linear(none, np.zeros(0)), np.ones(2), prior, np.zeros(2)).misfit == 0.0
    np.testing.assert_array_equal(posterior_covariance(prior, none), prior)


def test_a_strongly_curved_problem_ends_at_the_least_misfit():
    """A distance of 3 read to 0.01 from a point far off, where the first Gauss-Newton steps overshoot."""
    prior, mean = np.diag([4.0, 1.0]), np.array([0.1, 0.05])

    def solve(x, near=None):
        r = np.hypot(*x)
        return at(np.array([(3.0 - r) / 0.01]), (x / r / 0.01)[None])

    found = most_probable(solve, mean, prior, np.zeros(2))

    def misfit(x):
        return float((x - mean) ** 2 @ (1.0 / np.diagonal(prior)) + solve(x).residual[0] ** 2)

    best = min(minimize(misfit, 3.0 * np.array([np.cos(a), np.sin(a)])).fun for a in (0.0, 0.2, -0.2))
    assert found.converged
    assert found.misfit == pytest.approx(best, abs=0.02)


def test_steps_without_a_solution_are_shortened():
    def solve(x, near=None):
        if x[0] > 1.0:
            return None
        return at(10.0 * (0.9 - x), 10.0 * (1.0 - 0.6 * x[None]))

    assert abs(most_probable(solve, np.zeros(1), np.eye(1), np.zeros(1)).point.residual[0]) < 1.0
    assert most_probable(lambda x, near: None, np.zeros(1), np.eye(1), np.zeros(1)) is None


# ------------------------------------------------------------ volume


NOISE, PRIOR, MEAN = 1e-3, np.diag([0.2**2, 0.4**2]), np.array([0.0, 1.0])


class Product:
    """A frame with one reading, ``exp(a) f``."""

    def __init__(self, y):
        self.y = y

    def solved(self, x, near=None):
        residual = np.array([(self.y - np.exp(x[0]) * x[1]) / NOISE])
        return at(residual, np.exp(x[0]) * np.array([[x[1], 1.0]]) / NOISE, frame=self, unknowns=x)


@pytest.mark.parametrize("y", [0.7, 0.9, 1.2])
def test_the_same_reading_again_and_again_leads_to_the_mean_of_an_unknown_factor(y):
    """By quadrature, where the least misfit alone prefers large factors."""
    frame, volume, factors = Product(y), Volume(), []
    for _ in range(6):
        found = most_probable(frame.solved, MEAN + PRIOR @ volume.pull(PRIOR), PRIOR, np.zeros(2))
        factors.append(found.unknowns[0])
        volume = volume.renewed(found.point, PRIOR)
    a = np.linspace(-2.0, 2.0, 4001)
    density = np.exp(-0.5 * (a / 0.2) ** 2 - 0.5 * ((y * np.exp(-a) - 1.0) / 0.4) ** 2 - a)
    expected = a @ density / density.sum()
    assert abs(factors[-1] - expected) < 0.33 * abs(factors[0] - expected)


def test_the_volume_moves_the_mean_of_a_longer_frame_by_half_a_standard_deviation_at_most():
    """Slopes of a frame of 30 microseconds misled that after it, 48 ms later: the robot was lost for 9 frames."""
    volume, longer = Volume().renewed(Product(0.9).solved(MEAN), PRIOR), 100.0 * PRIOR
    moved = longer @ volume.pull(longer)
    assert moved @ np.linalg.solve(longer, moved) == pytest.approx(0.25)
