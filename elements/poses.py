"""Rigid-body poses, vectorised: rotations, Euler parameters, exponential and logarithm on SE(3).

Conventions. A twist is ``[v, w]``: translation first, rotation second, in the moving frame. Euler parameters
are ``[e0, e1, e2, e3]`` with the scalar first, as in Exudyn. All functions take stacks along leading axes.
Formulas: R. M. Murray, Z. Li, S. S. Sastry, A Mathematical Introduction to Robotic Manipulation (1994),
ch. 2 and App. A; the series of the inverse tangent map with Bernoulli numbers: A. Iserles et al., Lie-group
methods, Acta Numerica 9 (2000), eq. 2.46.
"""

from __future__ import annotations

from math import factorial

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


#: ``v @ _SKEW`` is the matrix of the cross product with ``v``, row by row.
_SKEW = np.array(
    [[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]], dtype=float
)
_EYE3 = np.eye(3)
_EYE6 = np.eye(6)


def skew(v: Array) -> Array:
    """Matrix of the cross product with ``v``: (..., 3) to (..., 3, 3)."""
    return (v @ _SKEW).reshape(*v.shape, 3)


def cross(a: Array, b: Array) -> Array:
    """Cross product along the last axis; several times faster than numpy's on small stacks."""
    return (skew(a) @ b[..., None])[..., 0]


def rotation_of_euler_parameters(e: Array) -> Array:
    """Rotation matrices of unit Euler parameters: (..., 4) to (..., 3, 3)."""
    s = skew(e[..., 1:])
    return _EYE3 + 2.0 * (e[..., 0, None, None] * s + s @ s)


#: Row ``i`` of the symmetric 4 x 4 matrix ``4 e_i e`` of Euler parameters, from ``[1, r00, r01, ... r22]``.
_SHEPPERD: Array = np.zeros((10, 4, 4))
for _i, _signs in enumerate(
    ((1.0, 1.0, 1.0, 1.0), (1.0, 1.0, -1.0, -1.0), (1.0, -1.0, 1.0, -1.0), (1.0, -1.0, -1.0, 1.0))
):
    for _column, _sign in zip((0, 1, 5, 9), _signs, strict=True):
        _SHEPPERD[_column, _i, _i] = _sign
for _i, _j, _plus, _minus in (
    (0, 1, (2, 1), (1, 2)), (0, 2, (0, 2), (2, 0)), (0, 3, (1, 0), (0, 1)),
):  # fmt: skip
    for _index, _sign in ((_plus, 1.0), (_minus, -1.0)):
        _entry = 1 + 3 * _index[0] + _index[1]
        _SHEPPERD[_entry, _i, _j] = _SHEPPERD[_entry, _j, _i] = _sign
for _i, _j in ((1, 2), (1, 3), (2, 3)):
    for _index in ((_i - 1, _j - 1), (_j - 1, _i - 1)):
        _entry = 1 + 3 * _index[0] + _index[1]
        _SHEPPERD[_entry, _i, _j] = _SHEPPERD[_entry, _j, _i] = 1.0
_SHEPPERD = _SHEPPERD.reshape(10, 16)


def euler_parameters_of_rotation(r: Array) -> Array:
    """Unit Euler parameters of rotation matrices: (..., 3, 3) to (..., 4); Shepperd's choice of the pivot.

    S. W. Shepperd, Quaternion from rotation matrix, J. Guidance and Control 1 (1978) 223-224.
    """
    flat = r.reshape(-1, 9)
    products = (flat @ _SHEPPERD[1:] + _SHEPPERD[0]).reshape(-1, 4, 4)
    pivot = products[:, (0, 1, 2, 3), (0, 1, 2, 3)].argmax(axis=1)
    e = products[np.arange(len(flat)), pivot]
    e = e / np.sqrt(np.einsum("ni,ni->n", e, e))[:, None]
    return e.reshape(*r.shape[:-2], 4)


#: ``e @ _RATE`` is the matrix of `euler_rate_matrix`, row by row.
_RATE: Array = np.zeros((4, 4, 3))
for _e, _row, _col, _way in (
    (1, 0, 0, -1), (2, 0, 1, -1), (3, 0, 2, -1), (0, 1, 0, 1), (3, 1, 1, -1), (2, 1, 2, 1),
    (3, 2, 0, 1), (0, 2, 1, 1), (1, 2, 2, -1), (2, 3, 0, -1), (1, 3, 1, 1), (0, 3, 2, 1),
):  # fmt: skip
    _RATE[_e, _row, _col] = 0.5 * _way
_RATE = _RATE.reshape(4, 12)


def euler_rate_matrix(e: Array) -> Array:
    """``H`` with ``de/dt = H w`` for a local angular velocity ``w``: (..., 4) to (..., 4, 3)."""
    return (e @ _RATE).reshape(*e.shape, 3)


#: Taylor coefficients in the squared angle of ``sin a / a``, ``(1 - cos a) / a^2``, ``(a - sin a) / a^3``.
_SERIES = np.array([[(-1.0) ** k / factorial(2 * k + j) for j in (1, 2, 3)] for k in range(9)])
_POWERS = np.arange(9)


def _coefficients(angle2: Array) -> tuple[Array, Array, Array]:
    """``sin a / a``, ``(1 - cos a) / a^2``, ``(a - sin a) / a^3`` of the squared angle."""
    if angle2.size == 0 or angle2.max() < 0.5:
        # Digits are lost to cancellation near zero in the closed form; the series has none to lose.
        c = angle2[..., None] ** _POWERS @ _SERIES
        return c[..., 0], c[..., 1], c[..., 2]
    a = np.sqrt(angle2)
    small = a < 0.3
    safe = np.where(small, 1.0, a)
    c = np.where(small, angle2, 0.0)[..., None] ** _POWERS @ _SERIES
    s = np.where(small, c[..., 0], np.sin(safe) / safe)
    return (
        s,
        np.where(small, c[..., 1], (1.0 - np.cos(safe)) / safe**2),
        np.where(small, c[..., 2], (safe - np.sin(safe)) / safe**3),
    )


def exp_se3(xi: Array) -> tuple[Array, Array]:
    """Exponential of twists: (..., 6) to rotations (..., 3, 3) and translations (..., 3)."""
    v, w = xi[..., :3], xi[..., 3:]
    s, c, d = _coefficients(np.einsum("...i,...i->...", w, w))
    k = skew(w)
    kk = k @ k
    c = c[..., None, None]
    rotation = _EYE3 + s[..., None, None] * k + c * kk
    translation = v + ((c * k + d[..., None, None] * kk) @ v[..., None])[..., 0]
    return rotation, translation


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


#: ``xi @ _AD`` is the matrix of the adjoint map of a twist, row by row.
_AD: Array = np.zeros((6, 6, 6))
_AD[3:, :3, :3] = _AD[3:, 3:, 3:] = _AD[:3, :3, 3:] = _SKEW.reshape(3, 3, 3)
_AD = _AD.reshape(6, 36)


def adjoint_map(xi: Array) -> Array:
    """``ad`` of twists, with ``ad(x) y`` the Lie bracket: (..., 6) to (..., 6, 6)."""
    return (xi @ _AD).reshape(*xi.shape, 6)


def inverse_tangent_se3(xi: Array) -> Array:
    """``T`` with ``d(xi) = T (h^-1 dh)`` for ``h = exp(xi)``: (..., 6) to (..., 6, 6).

    The Bernoulli series up to the eighth power, good to 1e-12 for rotations below half a radian and to
    1e-7 at one and a half; elements of a robot stay far below.
    """
    ad = adjoint_map(xi)
    a2 = ad @ ad
    a4 = a2 @ a2
    inner = a2 / 12.0 - a4 / 720.0
    if np.max(np.abs(xi[..., 3:]), initial=0.0) > 0.05:
        inner = inner + a4 @ (a2 / 30240.0 - a4 / 1209600.0)
    return _EYE6 + 0.5 * ad + inner


def twist_change(xi: Array, moved: Array) -> Array:
    """`inverse_tangent_se3` of ``xi`` times ``moved``, without forming the matrix: (..., 6)."""
    ad = adjoint_map(xi)
    x = moved[..., None]
    y1 = ad @ x
    y2 = ad @ y1
    result = x + 0.5 * y1 + y2 / 12.0
    turn = np.max(np.abs(xi[..., 3:]), initial=0.0)
    if turn > 0.01:
        a2 = ad @ ad
        y4 = a2 @ y2
        result -= y4 / 720.0
        if turn > 0.1:
            y6 = a2 @ y4
            result += y6 / 30240.0 - (a2 @ y6) / 1209600.0
    return result[..., 0]
