"""Poses between backbone nodes: constant strain from node to node (interpolation on SE(3))."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.poses import exp_se3, inverse_tangent_se3, log_se3

Array = NDArray[np.float64]


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


def elements_at(nodes: Array, s: Array) -> NDArray[np.int_]:
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
    twist = _twists(start, turn, end, end_turn)
    return np.asarray(start + _times(turn, exp_se3(share[..., None] * twist)[1]))


def _twists(start: Array, turn: Array, end: Array, end_turn: Array) -> Array:
    """Relative twists of the ends of elements, shape (m, 6)."""
    back = np.swapaxes(turn, -1, -2)
    return log_se3(back @ end_turn, _times(back, end - start))


def _times(matrices: Array, vectors: Array) -> Array:
    """Matrices (m, n, n) times vectors (m, n)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])


class ElementChange(NamedTuple):
    """Derivatives of the ends of elements by parameters, which are the last axis.

    Attributes
    ----------
    start, end : ndarray, shape (m, 3, P)
        Of the positions [m].
    turn, end_turn : ndarray, shape (m, 3, P)
        Of the rotations, as world rotation vectors.
    share : ndarray, shape (m, P)
        Of the arc length from the start over that of the element [1].
    """

    start: Array
    turn: Array
    end: Array
    end_turn: Array
    share: Array


def within_elements_change(
    start: Array, turn: Array, end: Array, end_turn: Array, share: Array, by: ElementChange
) -> Array:
    """Derivatives of `within_elements`, shape (m, 3, P).

    With the twist ``xi`` of an element and the share ``x``, the pose is that of the start times ``exp(x xi)``.
    """
    twist = _twists(start, turn, end, end_turn)
    near, far = np.swapaxes(turn, -1, -2), np.swapaxes(end_turn, -1, -2)
    near_change = np.concatenate((near @ by.start, near @ by.turn), axis=1)
    far_change = np.concatenate((far @ by.end, far @ by.end_turn), axis=1)
    twist_change = inverse_tangent_se3(twist) @ far_change - inverse_tangent_se3(-twist) @ near_change
    part = share[:, None] * twist
    along = share[:, None, None] * twist_change + twist[..., None] * by.share[:, None]
    rotation, arm = exp_se3(part)
    moved = np.linalg.solve(inverse_tangent_se3(part), along)[:, :3]
    lever = np.cross(by.turn, _times(turn, arm)[..., None], axis=1)
    return np.asarray(by.start + lever + turn @ (rotation @ moved))


def share_change(start: Array, end: Array, share: Array, length: Array) -> Array:
    """Derivatives of the share of an arc length within an element whose ends move along the backbone, shape (m, P).

    Parameters
    ----------
    start, end
        Derivatives of the arc lengths of the ends, shape (m, P).
    share
        Arc length from the start over that of the element [1], shape (m,).
    length
        Of the element [m], shape (m,).
    """
    return np.asarray(-(start + share[:, None] * (end - start)) / length[:, None])
