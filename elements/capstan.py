"""How tension passes the holes of a tendon: Capstan's equation and adhesion, the one place for law and derivatives.

With the mobilisation ``s`` of a hole, its coefficient of friction ``mu``, its adhesion ``a`` and the turning angle
``theta``, the tension ``T`` before the hole leads to the tension ``T'`` behind it (paper, Eqs. 28-31):

    T' + |s| a h(T')  =  T exp(-s mu theta)              where the tendon is pulled, s >= 0,
    T'  =  (T + |s| a h(T)) exp(-s mu theta)             where it is released, s < 0.

The lower of both tensions decides about the adhesion: ``h`` grows from zero to 1 at `FULL_ADHESION`, and both ways are
inverse to each other. So a tension is never negative, grows with the one before it, and is zero where that is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.compiled import compilable, compiled_as

Array = NDArray[np.float64]

#: Tension from which on a hole's adhesion acts in full [N].
FULL_ADHESION = 0.1


class TensionTransfer(NamedTuple):
    """Tensions of all segments of m tendons, and their derivatives."""

    tension: Array  # (m, n): [N]
    by_base: (
        Array  # (m, n): By the tension at the base; by that of segment j it is ``by_base / by_base_j`` [1]
    )
    by_exponent: (
        Array  # (m, n-1): Of the tension behind a hole by Capstan's exponent there ``-s mu theta`` [N]
    )
    by_drop: Array  # (m, n-1): And by ``-s a`` [1]; shape (m, 0) without adhesion


@compiled_as(lambda x: x.dot(np.triu(np.ones((x.shape[1], x.shape[1])))))
def _running_sums(x: Array) -> Array:
    """Sums of the first columns, shape (m, n-1)."""
    return x.cumsum(axis=1)


@compilable
def transfer_tension(base: Array, exponent: Array, drop: Array) -> TensionTransfer:
    """Tensions along tendons.

    Parameters
    ----------
    base
        At the base [N], shape (m,).
    exponent
        Capstan's exponents ``-s mu theta`` of the holes, shape (m, n-1).
    drop
        ``s a`` of the holes [N], of the same shape, or (m, 0) without adhesion.
    """
    m, holes = exponent.shape
    ratio = np.ones((m, holes + 1))
    if drop.shape[1] == 0:
        ratio[:, 1:] = np.exp(_running_sums(exponent))
        tension = base.reshape(-1, 1) * ratio
        return TensionTransfer(tension, ratio, tension[:, 1:].copy(), drop)
    tension, lower = np.empty((m, holes + 1)), np.empty((m, holes))
    tension[:, 0] = base
    size, factor = np.abs(drop), np.exp(exponent)
    for k in range(holes):
        pulls, c, f = drop[:, k] >= 0.0, size[:, k], factor[:, k]
        here = tension[:, k]
        # The lower tension where it follows from the higher one: the root of a parabola, and a straight line beyond.
        high = np.minimum(here * f, FULL_ADHESION + c)
        root = FULL_ADHESION + 2.0 * c
        low = 2.0 * FULL_ADHESION * high / (root + np.sqrt(root * root - 4.0 * c * high)) + (here * f - high)
        lower[:, k] = np.where(pulls, low, here)
        part = np.minimum(np.maximum(here / FULL_ADHESION, 0.0), 1.0)
        tension[:, k + 1] = np.where(pulls, low, (here + c * part * (2.0 - part)) * f)
    part = np.minimum(np.maximum(lower / FULL_ADHESION, 0.0), 1.0)
    # Slope of the higher tension by the lower one.
    steepness = 1.0 + size * (2.0 / FULL_ADHESION) * (1.0 - part)
    behind, pulled = tension[:, 1:], drop >= 0.0
    slope = np.where(pulled, 1.0 / steepness, steepness)
    for k in range(holes):
        ratio[:, k + 1] = ratio[:, k] * (factor[:, k] * slope[:, k])
    by_exponent = np.where(pulled, tension[:, :-1] * factor * slope, behind)
    return TensionTransfer(tension, ratio, by_exponent, part * (2.0 - part) * np.where(pulled, slope, factor))


class HoleSlopes(NamedTuple):
    """Derivatives of the tension ``T_k+1`` behind each hole, at fixed arguments of the other holes."""

    by_tension: Array  # (m, n-1): By the tension ``T_k`` before the hole [1]
    by_mobilisation: Array  # (m, n-1): By ``s_k`` [N]
    by_angle: Array  # (m, n-1): By ``theta_k`` [N/rad]
    by_coefficient: Array  # (m, n-1): By ``mu_k`` [N]
    by_base: Array  # (m, n): By the tension at the base: the first column of `chain` [1]

    @property
    def chain(self) -> Array:
        """``dT_k / dT_j`` of all pairs of segments, shape (m, n, n)."""
        lower = _lower(self.by_base.shape[1])
        return np.asarray(self.by_base[:, :, None] / self.by_base[:, None, :] * lower)


#: Gives the derivatives, which are formed on demand.
Slopes = Callable[[], HoleSlopes]


@cache
def _lower(n: int) -> Array:
    """Ones on and below the diagonal, shape (n, n)."""
    return np.tri(n)


def capstan(
    base_tension: Array, angles: Array, mobilisation: Array, coefficient: Array, adhesion: Array | None = None
) -> tuple[Array, Slopes]:
    """Tensions of all segments, see `transfer_tension`.

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
        ``a_k`` of the holes [N], shape (m, n-1); None is none.

    Returns
    -------
    tension : ndarray, shape (m, n)
        [N].
    slopes : callable
        Gives the `HoleSlopes`.
    """
    turned = -coefficient * angles
    drop = turned[:, :0] if adhesion is None else mobilisation * adhesion
    found = transfer_tension(base_tension, mobilisation * turned, drop)

    def slopes() -> HoleSlopes:
        by_mobilisation = turned * found.by_exponent
        if adhesion is not None:
            by_mobilisation = by_mobilisation - adhesion * found.by_drop
        sliding = -mobilisation * found.by_exponent
        by_tension = found.by_base[:, 1:] / found.by_base[:, :-1]
        return HoleSlopes(by_tension, by_mobilisation, coefficient * sliding, angles * sliding, found.by_base)

    return found.tension, slopes


class TensionDerivatives(NamedTuple):
    """Derivatives of the tensions along all tendons."""

    d_length: Array  # (m, n, n): By the segments' lengths [N/m]
    d_angle: Array  # (m, n, n-1): By the turning angles [N/rad]
    d_base: Array  # (m, n): By the tension at the base [1]
    by_mobilisation: Array  # (m, n, g): By the mobilisations, where these are independent unknowns [N]


@dataclass(slots=True, eq=False)
class TensionField:
    """Tensions along all tendons, and their derivatives, which are computed when first used."""

    tension: Array  # (m, n): [N]
    # (m, n): Released length of each segment, ``L / (1 + T0/EA) - l / (1 + T/EA)`` with the pretension ``T0``
    # [m]
    released_length: Array
    slip: Array  # (m, g): As they would be committed
    mobilisation: Array  # as `slip`
    # (m, n): Of the released lengths, with respect to its own length [1] and its own tension [m/N]
    released_d_length: Array
    released_d_tension: Array  # as `released_d_length`
    slip_rate: Array | None  # (m, g): Rate of the slips [m/s]; None where no friction law depends on it
    time: float  # [s]
    # Whether the tensions change with the segments' lengths; where not, `d_length` is zero
    depends_on_length: bool
    derive: Callable[[], TensionDerivatives]  # Gives `derivatives`
    # Gives the derivatives hole by hole, see `tdcr_fe.elements.capstan.HoleSlopes`; None where the tension
    # behind a hole depends on more than that before it, its angle and its mobilisation
    at_holes: Slopes | None = None
    _derivatives: TensionDerivatives | None = field(default=None, init=False)
    _hole_slopes: HoleSlopes | None = field(default=None, init=False)

    @property
    def base_slip(self) -> Array:
        """Tendon pulled in at the base plate, ``u_0`` [m], shape (m,)."""
        return np.asarray(self.released_length.sum(axis=1))

    @property
    def derivatives(self) -> TensionDerivatives:
        """Of the tensions."""
        if self._derivatives is None:
            self._derivatives = self.derive()
        return self._derivatives

    @property
    def hole_slopes(self) -> HoleSlopes | None:
        """Of the tensions hole by hole; None where `at_holes` is."""
        if self._hole_slopes is None and self.at_holes is not None:
            self._hole_slopes = self.at_holes()
        return self._hole_slopes

    @property
    def d_length(self) -> Array:
        """Of the tensions with respect to the segments' lengths [N/m], shape (m, n, n)."""
        return self.derivatives.d_length

    @property
    def d_angle(self) -> Array:
        """Of the tensions with respect to the turning angles [N/rad], shape (m, n, n-1)."""
        return self.derivatives.d_angle

    @property
    def d_base(self) -> Array:
        """Of the tensions with respect to the tension at the base [1], shape (m, n)."""
        slopes = self.hole_slopes
        return self.derivatives.d_base if slopes is None else slopes.by_base

    @property
    def by_mobilisation(self) -> Array:
        """Of the tensions with respect to the mobilisations, where these are unknowns [N], shape (m, n, g)."""
        return self.derivatives.by_mobilisation
