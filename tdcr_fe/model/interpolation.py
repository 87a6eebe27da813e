"""Poses between backbone nodes: constant strain from node to node (interpolation on SE(3))."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def _skew(rotvec: Array) -> Array:
    """Skew matrices: (..., 3) to (..., 3, 3)."""
    w = np.zeros((*rotvec.shape[:-1], 3, 3))
    w[..., 0, 1], w[..., 0, 2], w[..., 1, 2] = -rotvec[..., 2], rotvec[..., 1], -rotvec[..., 0]
    return np.asarray(w - np.swapaxes(w, -1, -2))


def _left_jacobian(rotvec: Array, scale: Array) -> Array:
    """Integral of ``exp(x scale W)`` over x in 0..1, times scale; W the skew matrix of ``rotvec``; (m, 3, 3)."""
    angle = np.linalg.norm(rotvec, axis=-1) * scale
    w = _skew(rotvec) * scale[..., None, None]
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
        Positions [m], shape (m, 3), and rotations, shape (m, 3, 3), at both ends of each element.
    share
        Arc length from the start over that of the element [1], shape (m,).

    Returns
    -------
    numpy.ndarray
        [m], shape (m, 3).
    """
    relative = Rotation.from_matrix(np.swapaxes(turn, -1, -2) @ end_turn).as_rotvec()
    chord = np.einsum("mji,mj->mi", turn, end - start)
    translation = np.linalg.solve(_left_jacobian(relative, np.ones_like(share)), chord[..., None])
    part = (_left_jacobian(relative, share) @ translation)[..., 0]
    return np.asarray(start + np.einsum("mij,mj->mi", turn, part))


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

    The position is ``start + turn x J(x v) J(v)^-1 chord`` with the relative rotation vector ``v``, the share ``x``,
    and the left Jacobian ``J`` of SO(3), which is differentiated in closed form.
    """
    one, back = np.ones_like(share), np.swapaxes(turn, -1, -2)
    relative = Rotation.from_matrix(back @ end_turn).as_rotvec()
    jacobian, part = _left_jacobian(relative, one), _left_jacobian(relative, share)
    chord = back @ (end - start)[..., None]
    translation = np.asarray(np.linalg.solve(jacobian, chord)[..., 0], dtype=float)
    rotated = rotation_vector_rate(relative) @ (np.swapaxes(end_turn, -1, -2) @ (by.end_turn - by.turn))
    lever = np.cross(by.turn, (end - start)[..., None], axis=1)
    stretched = back @ (by.end - by.start - lever) - _left_jacobian_rate(relative, translation, one) @ rotated
    inside = part @ np.linalg.solve(jacobian, stretched)
    inside = inside + _left_jacobian_rate(relative, translation, share) @ rotated
    along = Rotation.from_rotvec(relative * share[:, None]).apply(translation)
    inside = inside + along[..., None] * by.share[:, None]
    arm = (turn @ (part @ translation[..., None]))[..., 0]
    return np.asarray(by.start + np.cross(by.turn, arm[..., None], axis=1) + turn @ inside)


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


def _left_jacobian_rate(rotvec: Array, vector: Array, scale: Array) -> Array:
    """Derivative of ``_left_jacobian(rotvec, scale) vector`` by ``rotvec``, (m, 3, 3)."""
    v = rotvec * scale[..., None]
    angle = np.linalg.norm(v, axis=-1)
    small = angle < 1e-2
    a = np.where(small, 1.0, angle)
    sine, cosine = np.sin(a), np.cos(a)
    c1 = np.where(small, 0.5 - angle**2 / 24.0, (1.0 - cosine) / a**2)
    c2 = np.where(small, 1.0 / 6.0 - angle**2 / 120.0, (a - sine) / a**3)
    # Derivatives of c1 and c2 by the angle, over the angle.
    d1 = np.where(small, -1.0 / 12.0 + angle**2 / 180.0, (a * sine - 2.0 * (1.0 - cosine)) / a**4)
    d2 = np.where(small, -1.0 / 60.0 + angle**2 / 1260.0, (3.0 * sine - 2.0 * a - a * cosine) / a**5)
    w, across = _skew(v), np.cross(v, vector)
    slope = -c1[..., None, None] * _skew(vector) - c2[..., None, None] * (_skew(across) + w @ _skew(vector))
    radial = d1[..., None] * across + d2[..., None] * np.cross(v, across)
    return np.asarray(scale[..., None, None] ** 2 * (slope + radial[..., :, None] * v[..., None, :]))


def rotation_vector_rate(rotvec: Array) -> Array:
    """Matrix from a rotation of the far section about its own axes to the change of the relative rotation vector.

    The inverse of the right Jacobian of SO(3) (Chirikjian, Stochastic Models, Information Theory, and Lie Groups 2,
    Sec. 10.6): (m, 3) to (m, 3, 3).
    """
    angle = np.linalg.norm(rotvec, axis=-1)[..., None, None]
    w = _skew(rotvec)
    small = angle < 1e-3
    a = np.where(small, 1.0, angle)
    closed = 1.0 / a**2 - 1.0 / (2.0 * a * np.tan(0.5 * a))
    return np.asarray(np.eye(3) + 0.5 * w + np.where(small, 1.0 / 12.0 + angle**2 / 720.0, closed) * (w @ w))
