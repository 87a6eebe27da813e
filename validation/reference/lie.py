"""Matrices of the group SE(3) for stacks of twists [rotation, translation] and wrenches [moment, force]."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def _structure() -> tuple[Array, Array, Array]:
    hat = np.zeros((3, 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        hat[i, k, j], hat[i, j, k] = 1.0, -1.0
    ad = np.zeros((6, 6, 6))
    ad[:3, :3, :3] = ad[:3, 3:, 3:] = ad[3:, 3:, :3] = hat
    coad = np.zeros((6, 6, 6))
    coad[:3, :3, :3] = coad[3:, :3, 3:] = coad[3:, 3:, :3] = hat
    return hat.reshape(3, 9), ad.reshape(6, 36), coad.reshape(6, 36)


_HAT, _AD, _COAD = _structure()


def hat(v: Array) -> Array:
    """Skew matrix: ``hat(v) @ w = v x w``; shapes (..., 3) to (..., 3, 3)."""
    return (v @ _HAT).reshape((*v.shape[:-1], 3, 3))


def ad(strain: Array) -> Array:
    """Matrix of the bracket of twists, [[k^, 0], [g^, k^]]; shapes (..., 6) to (..., 6, 6)."""
    return (strain @ _AD).reshape((*strain.shape[:-1], 6, 6))


def wrench_matrix(wrench: Array) -> Array:
    """Derivative of ``ad(x).T @ wrench`` with respect to x, [[m^, n^], [n^, 0]]; (..., 6) to (..., 6, 6)."""
    return (wrench @ _COAD).reshape((*wrench.shape[:-1], 6, 6))


def adjoint(rotation: Array, position: Array) -> Array:
    """Body twist to spatial twist (about the world's origin); (..., 3, 3) and (..., 3) to (..., 6, 6)."""
    result = np.zeros((*position.shape[:-1], 6, 6))
    result[..., :3, :3] = result[..., 3:, 3:] = rotation
    result[..., 3:, :3] = hat(position) @ rotation
    return result
