"""The volume term takes the bias from the most probable state."""

from dataclasses import dataclass

import numpy as np
import pytest

from tdcr_fe.estimate.most_probable import most_probable
from tdcr_fe.estimate.volume import Volume

NOISE, PRIOR, MEAN = 1e-3, np.diag([0.2**2, 0.4**2]), np.array([0.0, 1.0])


@dataclass(frozen=True)
class Product:
    """A frame with one reading, ``exp(a) f``."""

    y: float

    def solved(self, x, near=None):
        return At(self, x)


@dataclass(frozen=True, eq=False)
class At:
    frame: Product
    unknowns: np.ndarray

    @property
    def residual(self):
        a, f = self.unknowns
        return np.array([(self.frame.y - np.exp(a) * f) / NOISE])

    @property
    def jacobian(self):
        a, f = self.unknowns
        return np.exp(a) * np.array([[f, 1.0]]) / NOISE


@pytest.mark.parametrize("y", [0.7, 0.9, 1.2])
def test_the_same_reading_again_and_again_leads_to_the_mean_of_an_unknown_factor(y):
    """By quadrature, where the least misfit alone prefers large factors."""
    frame, volume, factors = Product(y), Volume(), []
    for _ in range(6):
        found = most_probable(frame.solved, MEAN + volume.change_of_mean(PRIOR), PRIOR, np.zeros(2)).point
        factors.append(found.unknowns[0])
        volume = volume.renewed(found, PRIOR)
    a = np.linspace(-2.0, 2.0, 4001)
    density = np.exp(-0.5 * (a / 0.2) ** 2 - 0.5 * ((y * np.exp(-a) - 1.0) / 0.4) ** 2 - a)
    expected = a @ density / density.sum()
    assert abs(factors[-1] - expected) < 0.33 * abs(factors[0] - expected)
