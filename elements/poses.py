"""Rigid-body poses, vectorised: rotations, Euler parameters, exponential and logarithm on SE(3).

Conventions. A twist is ``[v, w]``: translation first, rotation second, in the moving frame. Euler parameters
are ``[e0, e1, e2, e3]`` with the scalar first, as in Exudyn. All functions take stacks along leading axes.
Formulas: R. M. Murray, Z. Li, S. S. Sastry, A Mathematical Introduction to Robotic Manipulation (1994),
ch. 2 and App. A; the series of the inverse tangent map with Bernoulli numbers: A. Iserles et al., Lie-group
methods, Acta Numerica 9 (2000), eq. 2.46.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def skew(v: Array) -> Array:
    """Matrix of the cross product with ``v``: (..., 3) to (..., 3, 3)."""
    m = np.zeros((*v.shape[:-1], 3, 3))
    m[..., 0, 1], m[..., 0, 2], m[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    m[..., 1, 0], m[..., 2, 0], m[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return m


def cross(a: Array, b: Array) -> Array:
    """Cross product along the last axis; several times faster than numpy's on small stacks."""
    a0, a1, a2 = a[..., 0], a[..., 1], a[..., 2]
    b0, b1, b2 = b[..., 0], b[..., 1], b[..., 2]
    return np.stack((a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0), axis=-1)


def rotation_of_euler_parameters(e: Array) -> Array:
    """Rotation matrices of unit Euler parameters: (..., 4) to (..., 3, 3)."""
    e0, v = e[..., 0, None, None], e[..., 1:]
    s = skew(v)
    return np.eye(3) + 2.0 * (e0 * s + s @ s)


def euler_parameters_of_rotation(r: Array) -> Array:
    """Unit Euler parameters of rotation matrices: (..., 3, 3) to (..., 4); Shepperd's choice of the pivot."""
    t = np.trace(r, axis1=-2, axis2=-1)
    d = np.diagonal(r, axis1=-2, axis2=-1)
    a = np.concatenate((t[..., None], d), axis=-1)
    pivot = np.argmax(a, axis=-1)
    r21, r02, r10 = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    p10, p02, p21 = r[..., 1, 0] + r[..., 0, 1], r[..., 0, 2] + r[..., 2, 0], r[..., 2, 1] + r[..., 1, 2]
    candidates = np.stack(
        (
            np.stack((1.0 + t, r21, r02, r10), -1),
            np.stack((r21, 1.0 + 2.0 * d[..., 0] - t, p10, p02), -1),
            np.stack((r02, p10, 1.0 + 2.0 * d[..., 1] - t, p21), -1),
            np.stack((r10, p02, p21, 1.0 + 2.0 * d[..., 2] - t), -1),
        ),
        axis=-2,
    )
    e = np.take_along_axis(candidates, pivot[..., None, None], axis=-2)[..., 0, :]
    return e / np.linalg.norm(e, axis=-1, keepdims=True)


def euler_rate_matrix(e: Array) -> Array:
    """``H`` with ``de/dt = H w`` for a local angular velocity ``w``: (..., 4) to (..., 4, 3)."""
    h = np.empty((*e.shape[:-1], 4, 3))
    e = 0.5 * e
    e0, e1, e2, e3 = e[..., 0], e[..., 1], e[..., 2], e[..., 3]
    h[..., 0, 0], h[..., 0, 1], h[..., 0, 2] = -e1, -e2, -e3
    h[..., 1, 0], h[..., 1, 1], h[..., 1, 2] = e0, -e3, e2
    h[..., 2, 0], h[..., 2, 1], h[..., 2, 2] = e3, e0, -e1
    h[..., 3, 0], h[..., 3, 1], h[..., 3, 2] = -e2, e1, e0
    return h


def _coefficients(angle2: Array) -> tuple[Array, Array, Array]:
    """``sin a / a``, ``(1 - cos a) / a^2``, ``(a - sin a) / a^3`` of the squared angle."""
    if angle2.size and angle2.max() < 0.1:
        # Nine digits are lost to cancellation near zero in the closed form; the series has none to lose.
        x = angle2
        s = 1 - x / 6 * (1 - x / 20 * (1 - x / 42 * (1 - x / 72 * (1 - x / 110 * (1 - x / 156)))))
        c = 0.5 * (1 - x / 12 * (1 - x / 30 * (1 - x / 56 * (1 - x / 90 * (1 - x / 132 * (1 - x / 182))))))
        d = (1 - x / 20 * (1 - x / 42 * (1 - x / 72 * (1 - x / 110 * (1 - x / 156 * (1 - x / 210)))))) / 6
        return s, c, d
    a = np.sqrt(angle2)
    small = a < 1e-2
    safe = np.where(small, 1.0, a)
    s = np.where(small, 1 - angle2 / 6 + angle2**2 / 120, np.sin(safe) / safe)
    c = np.where(small, 0.5 - angle2 / 24 + angle2**2 / 720, (1 - np.cos(safe)) / safe**2)
    d = np.where(small, 1 / 6 - angle2 / 120 + angle2**2 / 5040, (safe - np.sin(safe)) / safe**3)
    return s, c, d


def exp_se3(xi: Array) -> tuple[Array, Array]:
    """Exponential of twists: (..., 6) to rotations (..., 3, 3) and translations (..., 3)."""
    v, w = xi[..., :3], xi[..., 3:]
    s, c, d = _coefficients(np.einsum("...i,...i->...", w, w))
    k = skew(w)
    kk = k @ k
    rotation = np.eye(3) + s[..., None, None] * k + c[..., None, None] * kk
    tangent = np.eye(3) + c[..., None, None] * k + d[..., None, None] * kk
    return rotation, (tangent @ v[..., None])[..., 0]


def log_so3(r: Array) -> Array:
    """Rotation vectors of rotation matrices, angles below pi: (..., 3, 3) to (..., 3)."""
    e = euler_parameters_of_rotation(r)
    e = np.where(e[..., :1] < 0.0, -e, e)
    norm = np.linalg.norm(e[..., 1:], axis=-1)
    angle = 2.0 * np.arctan2(norm, e[..., 0])
    factor = np.where(norm < 1e-12, 2.0, angle / np.where(norm < 1e-12, 1.0, norm))
    return factor[..., None] * e[..., 1:]


def log_se3(r: Array, p: Array) -> Array:
    """Logarithm of poses: rotations (..., 3, 3) and translations (..., 3) to twists (..., 6)."""
    w = log_so3(r)
    _, c, d = _coefficients(np.einsum("...i,...i->...", w, w))
    k = skew(w)
    tangent = np.eye(3) + c[..., None, None] * k + d[..., None, None] * (k @ k)
    v = np.linalg.solve(tangent, p[..., None])[..., 0]
    return np.concatenate((v, w), axis=-1)


def adjoint_inverse(r: Array, p: Array) -> Array:
    """``Ad(h^-1)`` of poses: (..., 6, 6), taking twists of the first frame to the second."""
    rt = np.swapaxes(r, -1, -2)
    a = np.zeros((*p.shape[:-1], 6, 6))
    a[..., :3, :3] = rt
    a[..., 3:, 3:] = rt
    a[..., :3, 3:] = -rt @ skew(p)
    return a


def inverse_tangent_se3(xi: Array) -> Array:
    """``T`` with ``d(xi) = T (h^-1 dh)`` for ``h = exp(xi)``: (..., 6) to (..., 6, 6).

    The Bernoulli series up to the eighth power, good to 1e-12 for rotations below half a radian and to
    1e-7 at one and a half; elements of a robot stay far below.
    """
    ad = np.zeros((*xi.shape[:-1], 6, 6))
    w = skew(xi[..., 3:])
    ad[..., :3, :3] = w
    ad[..., 3:, 3:] = w
    ad[..., :3, 3:] = skew(xi[..., :3])
    a2 = ad @ ad
    a4 = a2 @ a2
    inner = a2 / 12.0 - a4 / 720.0
    if np.max(np.abs(xi[..., 3:]), initial=0.0) > 0.05:
        inner = inner + a4 @ (a2 / 30240.0 - a4 / 1209600.0)
    return np.eye(6) + 0.5 * ad + inner
