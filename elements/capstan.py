"""Transfer of tension at the holes of tendons: the Capstan equation with adhesion, and its derivatives."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Gives ``dT_k / dT_j``, shape (m, n, n), and ``dT_k+1`` by ``s_k``, by ``theta_k`` and by ``mu_k``, shape (m, n-1).
Slopes = Callable[[], tuple[Array, Array, Array, Callable[[], Array]]]


@cache
def _lower(n: int) -> Array:
    """Ones on and below the diagonal, shape (n, n)."""
    return np.tri(n)


def capstan(
    base_tension: Array, angles: Array, mobilisation: Array, coefficient: Array
) -> tuple[Array, Slopes]:
    """Tensions of all segments by ``T_k+1 = T_k exp(-s_k mu_k theta_k)`` (paper, Eqs. 28-31).

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

    Returns
    -------
    tension : ndarray, shape (m, n)
        [N].
    slopes : callable
        See `Slopes`; the derivative by the coefficients is again formed on demand.
    """
    m, h = angles.shape
    turned = -coefficient * angles
    ratio = np.empty((m, h + 1))
    ratio[:, 0] = 1.0
    np.exp((mobilisation * turned).cumsum(axis=1), out=ratio[:, 1:])
    tension = base_tension[:, None] * ratio

    def slopes() -> tuple[Array, Array, Array, Callable[[], Array]]:
        chain = ratio[:, :, None] / ratio[:, None, :]
        chain *= _lower(h + 1)
        after = tension[:, 1:]
        return (
            chain,
            turned * after,
            -coefficient * mobilisation * after,
            lambda: -angles * mobilisation * after,
        )

    return tension, slopes


def capstan_with_adhesion(
    base_tension: Array, angles: Array, mobilisation: Array, coefficient: Array, adhesion: Array
) -> tuple[Array, Slopes]:
    """Tensions of all segments where holes also take an adhesion ``a_k`` [N], shape (m, n-1).

    ``T_k+1 = max(0, T_k exp(-s_k mu_k theta_k) - s_k a_k)`` where the tendon is pulled, ``s_k >= 0``, and
    ``T_k+1 = (T_k + |s_k| a_k) exp(|s_k| mu_k theta_k)`` where it is released. Otherwise as `capstan`.
    """
    s, a, mu = mobilisation, adhesion, coefficient
    m, h = angles.shape
    tension = np.empty((m, h + 1))
    slope, d_s, after = np.empty((m, h)), np.empty((m, h)), np.empty((m, h))
    tension[:, 0] = base_tension
    factor = np.exp(s * (-mu * angles))
    for k in range(h):
        t, f, sk, ak = tension[:, k], factor[:, k], s[:, k], a[:, k]
        pulling = sk >= 0.0
        pulled = t * f - sk * ak
        released = (t - sk * ak) * f
        taut = pulled > 0.0
        tension[:, k + 1] = np.where(pulling, np.maximum(pulled, 0.0), released)
        open_ = ~pulling | taut
        slope[:, k] = np.where(open_, f, 0.0)
        mt = mu[:, k] * angles[:, k]
        d_s[:, k] = np.where(pulling, np.where(taut, -mt * t * f - ak, 0.0), -mt * released - ak * f)
        after[:, k] = np.where(open_, np.where(pulling, t * f, released), 0.0)
    chain = np.zeros((m, h + 1, h + 1))
    chain[:, 0, 0] = 1.0
    for k in range(1, h + 1):
        chain[:, k, :k] = slope[:, k - 1, None] * chain[:, k - 1, :k]
        chain[:, k, k] = 1.0
    return tension, lambda: (chain, d_s, -mu * s * after, lambda: -angles * s * after)
