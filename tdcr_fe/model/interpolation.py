"""Poses between backbone nodes: constant strain from node to node (interpolation on SE(3))."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def _left_jacobian(rotvec: Array, scale: Array) -> Array:
    """Integral of ``exp(x scale W)`` over x in 0..1, times scale; W the skew matrix of ``rotvec``; (m, 3, 3)."""
    angle = np.linalg.norm(rotvec, axis=-1) * scale
    w = np.zeros((*rotvec.shape[:-1], 3, 3))
    w[..., 0, 1], w[..., 0, 2], w[..., 1, 2] = -rotvec[..., 2], rotvec[..., 1], -rotvec[..., 0]
    w -= np.swapaxes(w, -1, -2).copy()
    w *= scale[..., None, None]
    small = angle < 1e-4
    a = np.where(small, 1.0, angle)
    c1 = np.where(small, 0.5 - angle**2 / 24.0, (1.0 - np.cos(a)) / a**2)
    c2 = np.where(small, 1.0 / 6.0 - angle**2 / 120.0, (a - np.sin(a)) / a**3)
    return scale[..., None, None] * (np.eye(3) + c1[..., None, None] * w + c2[..., None, None] * (w @ w))


def interpolate_positions(nodes: Array, positions: Array, rotations: Array, s: Array) -> Array:
    """World positions at arc lengths between nodes.

    Parameters
    ----------
    nodes
        Arc lengths of the nodes, ascending [m], shape (n,).
    positions
        Of the nodes [m], shape (n, 3).
    rotations
        Of the sections, shape (n, 3, 3).
    s
        Arc lengths, within the range of the nodes [m], any shape.

    Returns
    -------
    numpy.ndarray
        [m], shape ``s.shape + (3,)``.

    Raises
    ------
    ValueError
        An arc length lies outside the backbone.
    """
    flat = np.atleast_1d(s).ravel()
    if np.any(flat < nodes[0] - 1e-6) or np.any(flat > nodes[-1] + 1e-6):
        raise ValueError(f"arc length outside the backbone, which spans {nodes[0]:g} to {nodes[-1]:g} m")
    k = np.clip(np.searchsorted(nodes, flat, side="right") - 1, 0, len(nodes) - 2)
    x = (flat - nodes[k]) / (nodes[k + 1] - nodes[k])
    relative = np.swapaxes(rotations[k], -1, -2) @ rotations[k + 1]
    turn = Rotation.from_matrix(relative).as_rotvec()
    chord = np.einsum("mji,mj->mi", rotations[k], positions[k + 1] - positions[k])
    whole = _left_jacobian(turn, np.ones_like(x))
    translation = np.linalg.solve(whole, chord[..., None])
    part = (_left_jacobian(turn, x) @ translation)[..., 0]
    result = positions[k] + np.einsum("mij,mj->mi", rotations[k], part)
    return result.reshape((*np.shape(s), 3))
