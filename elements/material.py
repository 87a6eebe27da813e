"""Nonlinear materials of the backbone: what superelastic bending and nonlinear fibres add to a linear section."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.special import spence

from tdcr_fe.elements import Array
from tdcr_fe.elements.backbone import POINTS, WEIGHTS


class Material(ABC):
    """What a nonlinear material adds to the forces of a linear elastic section."""

    precurvature: Array  # (E, 3): Of the elements in the unloaded state, in beam axes [1/m]

    @abstractmethod
    def wrench(self, n: Array, bend: Array) -> Array:
        """Axial force and bending moments beyond linear elasticity, shape (..., 3) [N, N m, N m].

        Parameters
        ----------
        n, bend
            Stretch [1] and curvature [1/m], see `strain`.
        """

    @abstractmethod
    def stiffness(self, n: Array, bend: Array) -> Array:
        """Derivative of `wrench` by stretch and curvatures, shape (..., 3, 3)."""

    def strain(self, twists: Array, lengths: Array) -> tuple[Array, Array]:
        """Stretch of the axis, shape (..., E) [1], and curvature beyond the unloaded one, (..., E, 2) [1/m]."""
        return twists[..., 0] / lengths - 1.0, twists[..., 4:] / lengths[:, None] - self.precurvature[:, 1:]

    def gradient(self, twists: Array, lengths: Array) -> Array:
        """Gradient of the energy beyond linear elasticity with respect to the twists, shape (..., E, 6)."""
        found = self.wrench(*self.strain(twists, lengths))
        gradient = np.zeros_like(twists)
        gradient[..., 0], gradient[..., 4:] = found[..., 0], found[..., 1:]
        return gradient

    def energy(self, twists: Array, lengths: Array) -> float:
        """Energy of all elements beyond linear elasticity [J].

        Work on the straight way from the unloaded state, exact for wrenches up to the seventh degree.
        """
        n, bend = self.strain(twists, lengths)
        mean = WEIGHTS @ np.array([self.wrench(x * n, x * bend).ravel() for x in POINTS])
        return float(mean @ (lengths[:, None] * np.column_stack((n, bend))).ravel())

    def at_points(self) -> Self:
        """The same for strains at several points of every element, shapes (..., E, points)."""
        arrays = {k: v[:, None] for k, v in vars(self).items() if isinstance(v, np.ndarray)}
        return replace(self, **arrays)  # type: ignore[type-var]


@dataclass(frozen=True)
class SuperelasticSection(Material):
    """Bending moment that softens with curvature.

    ``M(k) = EI [r k + (1 - r) (k - w (softplus((k - kc)/w) - softplus(-kc/w)))]`` with ``w = kc / 40``; the
    slope falls from EI to r EI over about a tenth of ``kc``.
    """

    bending_stiffness: Array  # (E,): EI of every element [N m^2]
    threshold: Array  # (E,): Curvature kc where the plateau begins [1/m]
    ratio: float  # Slope beyond it over the slope before it [1]
    precurvature: Array  # (E, 3): As of `Material`

    def _moment(self, bend: Array) -> tuple[Array, Array, Array]:
        """Curvature, moment over it beyond linear elasticity, and the derivative of the moment, shape (...)."""
        k = np.sqrt(np.einsum("...i,...i->...", bend, bend))
        w, kc = self.threshold / 40.0, self.threshold
        missing = np.logaddexp(0.0, (k - kc) / w) - np.logaddexp(0.0, -kc / w)
        moment = -(1.0 - self.ratio) * w * missing * self.bending_stiffness
        slope = -(1.0 - self.ratio) * self.bending_stiffness * 0.5 * (1.0 + np.tanh(0.5 * (k - kc) / w))
        return k, moment / np.where(k > 0.0, k, 1.0), slope

    def wrench(self, n: Array, bend: Array) -> Array:
        """See `Material.wrench`."""
        found = np.zeros((*n.shape, 3))
        found[..., 1:] = bend * self._moment(bend)[1][..., None]
        return found

    def stiffness(self, n: Array, bend: Array) -> Array:
        """See `Material.stiffness`."""
        k, secant, slope = self._moment(bend)
        along = bend / np.where(k > 0.0, k, 1.0)[..., None]
        found = np.zeros((*n.shape, 3, 3))
        found[..., 1:, 1:] = secant[..., None, None] * np.eye(2)
        found[..., 1:, 1:] += (slope - secant)[..., None, None] * along[..., :, None] * along[..., None, :]
        return found

    def energy(self, twists: Array, lengths: Array) -> float:
        """See `Material.energy`: the integral of the moment."""
        k = np.linalg.norm(self.strain(twists, lengths)[1], axis=-1)
        w, kc = self.threshold / 40.0, self.threshold
        area = w * (_softplus_integral((k - kc) / w) - _softplus_integral(-kc / w))
        area -= np.logaddexp(0.0, -kc / w) * k
        return -float(np.sum((1.0 - self.ratio) * w * self.bending_stiffness * lengths * area))


def _softplus_integral(x: Array) -> Array:
    """Integral of ``log(1 + exp(x))`` from minus infinity: ``-Li2(-exp(x))``."""
    low = -spence(1.0 + np.exp(np.minimum(x, 0.0)))
    high = np.pi**2 / 6.0 + 0.5 * x**2 + spence(1.0 + np.exp(-np.maximum(x, 0.0)))
    return np.where(x > 0.0, high, low)


@dataclass(frozen=True)
class NonlinearSection(Material):
    """Fibres along the backbone with the stress ``E (e + b e^2 + c e^3)`` at the strain ``e``.

    A fibre at the distance ``x`` from the axis of bending has the strain ``e = n - k x`` with the stretch ``n`` of the
    axis and the curvature ``k``. Integrated over a round section of radius ``R``, the energy per length is
    ``EA (n^2/2 + b n^3/3 + c n^4/4) + EI k^2 (1/2 + b n + 3/2 c n^2 + c R^2 k^2 / 8)``, with
    ``int x^4 dA = I R^2 / 2``. The parts with 1/2 are those of the linear section.
    """

    axial_stiffness: Array  # (E,): EA of every element, zero in rigid inserts [N]
    bending_stiffness: Array  # (E,): EI of every element, zero in rigid inserts [N m^2]
    radius: Array  # (E,): R of the round section with these stiffnesses, ``2 sqrt(EI / EA)`` [m]
    quadratic: Array  # (E,): b [1]
    cubic: Array  # (E,): c [1]
    precurvature: Array  # (E, 3): Strain of the unloaded backbone, see `Material`

    def wrench(self, n: Array, bend: Array) -> Array:
        """See `Material.wrench`."""
        b, c, squared = self.quadratic, self.cubic, np.einsum("...i,...i->...", bend, bend)
        found = np.empty((*n.shape, 3))
        found[..., 0] = self.axial_stiffness * (b + c * n) * n**2
        found[..., 0] += self.bending_stiffness * (b + 3.0 * c * n) * squared
        found[..., 1:] = bend * (self.bending_stiffness * self._factor(n, squared))[..., None]
        return found

    def _factor(self, n: Array, squared: Array) -> Array:
        """Secant bending stiffness beyond the linear one, over EI [1]."""
        return (2.0 * self.quadratic + 3.0 * self.cubic * n) * n + 0.5 * self.cubic * self.radius**2 * squared

    def stiffness(self, n: Array, bend: Array) -> Array:
        """See `Material.stiffness`."""
        b, c, squared = self.quadratic, self.cubic, np.einsum("...i,...i->...", bend, bend)
        found = np.empty((*n.shape, 3, 3))
        found[..., 0, 0] = self.axial_stiffness * (2.0 * b + 3.0 * c * n) * n
        found[..., 0, 0] += 3.0 * self.bending_stiffness * c * squared
        found[..., 0, 1:] = bend * (2.0 * self.bending_stiffness * (b + 3.0 * c * n))[..., None]
        found[..., 1:, 0] = found[..., 0, 1:]
        outer = self.bending_stiffness * c * self.radius**2
        found[..., 1:, 1:] = outer[..., None, None] * bend[..., :, None] * bend[..., None, :]
        found[..., 1:, 1:] += (self.bending_stiffness * self._factor(n, squared))[..., None, None] * np.eye(2)
        return found
