"""Poses between backbone nodes: constant strain from node to node (interpolation on SE(3))."""

from __future__ import annotations

import numpy as np

from tdcr_fe.elements import Array, Index
from tdcr_fe.elements.poses import exp_se3, log_se3


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
    k = elements_at(nodes, flat)
    x = (flat - nodes[k]) / (nodes[k + 1] - nodes[k])
    result = within_elements(positions[k], rotations[k], positions[k + 1], rotations[k + 1], x)
    return result.reshape((*np.shape(s), 3))


def elements_at(nodes: Array, s: Array) -> Index:
    """Numbers of the elements that hold arc lengths; at a node, of the one that begins there, the last one at the tip.

    Parameters
    ----------
    nodes
        Arc lengths of the nodes, ascending [m], shape (n,).
    s
        Arc lengths [m], any shape.
    """
    return np.clip(np.searchsorted(nodes, s, side="right") - 1, 0, len(nodes) - 2)


def within_elements(start: Array, turn: Array, end: Array, end_turn: Array, share: Array) -> Array:
    """World positions inside elements of constant strain.

    Parameters
    ----------
    start, turn, end, end_turn
        Positions [m], shape (..., m, 3), and rotations, shape (..., m, 3, 3), at both ends of each element.
    share
        Arc length from the start over that of the element [1], shape (..., m).

    Returns
    -------
    numpy.ndarray
        [m], shape (..., m, 3).
    """
    back = np.swapaxes(turn, -1, -2)
    twist = log_se3(back @ end_turn, _times(back, end - start))
    return np.asarray(start + _times(turn, exp_se3(share[..., None] * twist)[1]))


def _times(matrices: Array, vectors: Array) -> Array:
    """Matrices (m, n, n) times vectors (m, n)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])
