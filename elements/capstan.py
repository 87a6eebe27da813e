"""Capstan's equation hole by hole, and the tensions along all tendons with their derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array


class HoleSlopes(NamedTuple):
    """Derivatives of the tension ``T_k+1`` behind each hole, at fixed arguments of the other holes."""

    by_tension: Array  # (m, n-1): By the tension ``T_k`` before the hole [1]
    by_mobilisation: Array  # (m, n-1): By ``s_k`` [N]
    by_angle: Array  # (m, n-1): By ``theta_k`` [N/rad]
    by_coefficient: Array  # (m, n-1): By ``mu_k`` [N]

    @property
    def by_base(self) -> Array:
        """Derivatives of all tensions by that at the base [1], shape (m, n)."""
        m, h = self.by_tension.shape
        found: Array = np.ones((m, h + 1))
        self.by_tension.cumprod(axis=1, out=found[:, 1:])
        return found

    def chain(self) -> Array:
        """``dT_k / dT_j`` of all pairs of segments, shape (m, n, n)."""
        m, h = self.by_tension.shape
        number = np.arange(h + 1)
        behind = number[:, None] >= number
        found = np.ones((m, h + 1, h + 1))
        # Factors of the holes from segment j on, one before it; their products reach from j to k.
        factors = np.where(behind[:-1], self.by_tension[:, :, None], 1.0)
        factors.cumprod(axis=1, out=found[:, 1:])
        found *= behind
        return found

    def derivatives(self, incidence: Array) -> TensionDerivatives:
        """Derivatives of the tensions along the tendons, at fixed lengths of the segments.

        ``incidence``: from the mobilisations to the holes, shape (n-1, g).
        """
        chain = self.chain()
        n, beyond = chain.shape[1], chain[:, :, 1:]
        by_mobilisation = (beyond * self.by_mobilisation[:, None, :]) @ incidence
        by_shape = np.zeros((len(chain), n, 2 * n - 1))
        np.multiply(beyond, self.by_angle[:, None, :], out=by_shape[:, :, n:])
        return TensionDerivatives(by_shape, chain[:, :, 0], by_mobilisation)


#: Gives the derivatives, which are formed on demand.
Slopes = Callable[[], HoleSlopes]


def capstan(
    base_tension: Array, angles: Array, mobilisation: Array, coefficient: Array, adhesion: Array | None = None
) -> tuple[Array, Slopes]:
    """Tensions of all segments by ``T_k+1 = T_k exp(-s_k mu_k theta_k)`` (paper, Eqs. 28-31).

    Where holes also take an adhesion ``a_k``, ``T_k+1 = max(0, T_k exp(-s_k mu_k theta_k) - s_k a_k)`` where the tendon
    is pulled, ``s_k >= 0``, and ``T_k+1 = (T_k + |s_k| a_k) exp(|s_k| mu_k theta_k)`` where it is released.

    Parameters
    ----------
    base_tension
        [N], shape (m,).
    angles
        Turning angles ``theta_k`` at the holes [rad], shape (m, n-1).
    mobilisation
        ``s_k`` of the holes, shape (m, n-1).
    coefficient
        ``mu_k`` of the holes [1], shape (m, n-1).
    adhesion
        ``a_k`` of the holes [N], shape (m, n-1); None where there is none.

    Returns
    -------
    tension : ndarray, shape (m, n)
        [N].
    slopes : callable
        Gives the `HoleSlopes`.
    """
    m, h = angles.shape
    turned = -coefficient * angles
    exponent = mobilisation * turned
    tension: Array = np.empty((m, h + 1))
    tension[:, 0] = base_tension
    if adhesion is None:
        np.exp(exponent.cumsum(axis=1), out=tension[:, 1:])
        tension[:, 1:] *= base_tension[:, None]
    else:
        _with_adhesion(tension, mobilisation, np.exp(exponent), adhesion)

    def slopes() -> HoleSlopes:
        factor, before, behind = np.exp(exponent), tension[:, :-1], tension[:, 1:]
        # What Capstan's factor multiplies: the tension before the hole, and the adhesion too where it is released.
        slope, multiplied, by_mobilisation = factor, behind, turned * behind
        if adhesion is not None:
            pulling = mobilisation >= 0.0
            taut = ~pulling | (behind > 0.0)
            slope = np.where(taut, factor, 0.0)
            multiplied = np.where(pulling, before * slope, behind)
            held = adhesion * np.where(pulling, 1.0, factor)
            by_mobilisation = np.where(taut, turned * multiplied - held, 0.0)
        acting = -mobilisation * multiplied
        return HoleSlopes(slope, by_mobilisation, coefficient * acting, angles * acting)

    return tension, slopes


def _with_adhesion(tension: Array, mobilisation: Array, factor: Array, adhesion: Array) -> None:
    """Fill the tensions behind the first segments, hole by hole; ``factor`` is Capstan's."""
    pulling = mobilisation >= 0.0
    gained = np.where(pulling, -mobilisation * adhesion, -mobilisation * adhesion * factor)
    least = np.where(pulling, 0.0, -np.inf)
    for k in range(factor.shape[1]):
        tension[:, k + 1] = np.maximum(tension[:, k] * factor[:, k] + gained[:, k], least[:, k])


class TensionDerivatives(NamedTuple):
    """Derivatives of the tensions along all tendons."""

    by_shape: Array  # (m, n, 2n-1): By the segments' lengths [N/m], then by the turning angles [N/rad]
    d_base: Array  # (m, n): By the tension at the base [1]
    by_mobilisation: Array  # (m, n, g): By the mobilisations, where these are independent unknowns [N]


@dataclass(eq=False)
class TensionField:
    """Tensions along all tendons, and their derivatives, which are computed when first used."""

    tension: Array  # (m, n): [N]
    # (m, n): Released length of each segment, ``L / (1 + T0/EA) - l / (1 + T/EA)`` with the pretension ``T0``
    # [m]
    released_length: Array
    slip: Array  # (m, g): As they would be committed
    mobilisation: Array  # (m, g): As it would be committed
    # (m, n): Derivative of each released length by the length of the same segment [1], and by its tension [m/N]
    released_d_length: Array
    released_d_tension: Array
    slip_rate: Array | None  # (m, g): Rate of the slips [m/s]; None where no friction law depends on it
    time: float  # [s]
    # Whether the tensions change with the segments' lengths; where not, `d_length` is zero
    depends_on_length: bool
    derive: Callable[[], TensionDerivatives]  # Gives `derivatives`
    # Gives the derivatives hole by hole, see `tdcr_fe.elements.capstan.HoleSlopes`; None where the tension
    # behind a hole depends on more than that before it, its angle and its mobilisation
    at_holes: Slopes | None = None

    @property
    def base_slip(self) -> Array:
        """Tendon pulled in at the base plate, ``u_0`` [m], shape (m,)."""
        return np.asarray(self.released_length.sum(axis=1))

    @cached_property
    def derivatives(self) -> TensionDerivatives:
        """Derivatives of the tensions."""
        return self.derive()

    @cached_property
    def hole_slopes(self) -> HoleSlopes | None:
        """Derivatives of the tensions hole by hole; None where `at_holes` is None."""
        return None if self.at_holes is None else self.at_holes()

    @property
    def d_length(self) -> Array:
        """Derivatives of the tensions by the segments' lengths [N/m], shape (m, n, n)."""
        return self.derivatives.by_shape[:, :, : self.tension.shape[1]]

    @property
    def d_angle(self) -> Array:
        """Derivatives of the tensions by the turning angles [N/rad], shape (m, n, n-1)."""
        return self.derivatives.by_shape[:, :, self.tension.shape[1] :]

    @property
    def d_base(self) -> Array:
        """Derivatives of the tensions by the tension at the base [1], shape (m, n)."""
        slopes = self.hole_slopes
        return self.derivatives.d_base if slopes is None else slopes.by_base

    @property
    def by_mobilisation(self) -> Array:
        """Derivatives of the tensions by the mobilisations, where these are unknowns [N], shape (m, n, g)."""
        return self.derivatives.by_mobilisation
