"""Rigid-body poses, vectorised: rotations, Euler parameters, exponential and logarithm on SE(3).

Conventions. A twist is ``[v, w]``: translation first, rotation second, in the moving frame. Euler parameters
are ``[e0, e1, e2, e3]`` with the scalar first, as in Exudyn. All functions take stacks along leading axes.
Formulas: R. M. Murray, Z. Li, S. S. Sastry, A Mathematical Introduction to Robotic Manipulation (1994),
ch. 2 and App. A; the inverse tangent map with Bernoulli numbers: A. Iserles et al., Lie-group methods, Acta
Numerica 9 (2000), eq. 2.46, its series summed by ``ad^5 = -2 a^2 ad^3 - a^4 ad`` with the angle ``a``.
"""

from __future__ import annotations

from math import factorial

import numpy as np
from scipy.special import bernoulli

from tdcr_fe.elements import Array

#: ``v @ _SKEW`` is the matrix of the cross product with ``v``, row by row.
_SKEW = np.array(
    [[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]], dtype=float
)
#: Unit matrices; the first one also row by row.
EYE3, EYE4, EYE6 = np.eye(3), np.eye(4), np.eye(6)
EYE9 = EYE3.reshape(9)
#: ``v @ ONES3`` is the sum of the components, faster than numpy's ``sum`` for a few vectors.
ONES3, ONES4 = np.ones(3), np.ones(4)


def skew(v: Array) -> Array:
    """Matrix of the cross product with ``v``: (..., 3) to (..., 3, 3)."""
    return v.reshape(-1, 3).dot(_SKEW).reshape(*v.shape, 3)


def cross(a: Array, b: Array) -> Array:
    """Cross product along the last axis; several times faster than numpy's on small stacks."""
    return (skew(a) @ b[..., None])[..., 0]


def _euler_rotation() -> Array:
    """See `EULER_ROTATION`: it is ``1 + 2 (e0 s + s s)``, with ``s`` the cross product with e1, e2, e3."""
    table = np.zeros((4, 4, 3, 3))
    units = _SKEW.reshape(3, 3, 3)
    table[0, 1:] = 2.0 * units
    table[1:, 1:] = 2.0 * units[:, None] @ units[None]
    return table.reshape(16, 9)


#: ``(e e^T).ravel() @ EULER_ROTATION`` is the rotation matrix of Euler parameters minus 1, row by row.
EULER_ROTATION: Array = _euler_rotation()


def rotation_of_euler_parameters(e: Array) -> Array:
    """Rotation matrices of unit Euler parameters: (..., 4) to (..., 3, 3)."""
    products = e[..., :, None] * e[..., None, :]
    r = products.reshape(-1, 16).dot(EULER_ROTATION)
    r += EYE9
    return r.reshape(*e.shape[:-1], 3, 3)


def _euler_products() -> tuple[Array, Array]:
    """What takes a rotation matrix, row by row, to ``4 e e^T`` of its Euler parameters, and what is added to that.

    It is the inverse of `EULER_ROTATION`, where ``e e^T`` is symmetric and has the trace 1.
    """
    table = EULER_ROTATION.reshape(4, 4, 9)
    symmetric = 0.5 * (table + table.swapaxes(0, 1)).reshape(16, 9)
    inverse = np.round(4.0 * np.linalg.pinv(np.column_stack((symmetric, np.eye(4).ravel()))))
    return inverse[:9], inverse[9] - EYE9 @ inverse[:9]


_SHEPPERD_LINEAR, _SHEPPERD_CONSTANT = _euler_products()


def euler_parameters_of_rotation(r: Array) -> Array:
    """Unit Euler parameters of rotation matrices: (..., 3, 3) to (..., 4); Shepperd's choice of the pivot.

    S. W. Shepperd, Quaternion from rotation matrix, J. Guidance and Control 1 (1978) 223-224.
    """
    flat = r.reshape(-1, 9)
    products = (flat @ _SHEPPERD_LINEAR + _SHEPPERD_CONSTANT).reshape(-1, 4, 4)
    pivot = products[:, (0, 1, 2, 3), (0, 1, 2, 3)].argmax(axis=1)
    e = products[np.arange(len(flat)), pivot]
    e = e / np.sqrt(np.einsum("ni,ni->n", e, e))[:, None]
    return e.reshape(*r.shape[:-2], 4)


def euler_parameters_near(r: Array, near: Array) -> Array:
    """Euler parameters of rotation matrices (n, 3, 3), with the sign that is nearer to given ones (n, 4)."""
    # The symmetric matrix 4 e e^T takes any vector that is not across e to a multiple of e, with the nearer sign.
    products = r.reshape(-1, 9).dot(_SHEPPERD_LINEAR)
    products += _SHEPPERD_CONSTANT
    e = (products.reshape(-1, 4, 4) @ near[:, :, None])[..., 0]
    size = np.sqrt((e * e).dot(ONES4))
    if size.min() < 0.1:
        e = euler_parameters_of_rotation(r)
        return e * np.where((e * near) @ ONES4 < 0.0, -1.0, 1.0)[:, None]
    e /= size[:, None]
    return np.asarray(e)


#: ``e @ EULER_RATE`` is the matrix of `euler_rate_matrix`, row by row.
EULER_RATE: Array = np.zeros((4, 4, 3))
EULER_RATE[0, 1:], EULER_RATE[1:, 0] = 0.5 * EYE3, -0.5 * EYE3
EULER_RATE[1:, 1:] = 0.5 * _SKEW.reshape(3, 3, 3)
EULER_RATE = EULER_RATE.reshape(4, 12)


def euler_rate_matrix(e: Array) -> Array:
    """``H`` with ``de/dt = H w`` for a local angular velocity ``w``: (..., 4) to (..., 4, 3)."""
    return e.reshape(-1, 4).dot(EULER_RATE).reshape(*e.shape, 3)


#: Terms of the Taylor series in the squared angle: more than enough for 16 digits below 0.5 of the `coefficients`.
_TERMS = 12
_POWERS = np.arange(float(_TERMS))


def _series() -> Array:
    """Taylor coefficients, by power of the squared angle, of the five functions of `coefficients`."""
    table = np.zeros((_TERMS, 5))
    for k in range(_TERMS):
        table[k, :3] = [(-1.0) ** k / factorial(2 * k + j) for j in (1, 2, 3)]
    # Even powers of ad beyond the fourth fall back on the second and fourth: ad^6 = -2 a^2 ad^4 - a^4 ad^2, so
    # ad^2k = (-1)^k ((k - 2) a^(2k-2) ad^2 + (k - 1) a^(2k-4) ad^4).
    even = bernoulli(2 * _TERMS + 4)[2::2]
    for k in range(1, _TERMS + 2):
        share = (-1.0) ** k * even[k - 1] / factorial(2 * k)
        if k <= _TERMS:
            table[k - 1, 3] = share * (k - 2)
        if k >= 2:
            table[k - 2, 4] = share * (k - 1)
    return table


#: Coefficients of `coefficients`, see `_series`, shape (terms, 5).
SERIES: Array = _series()


def coefficients(w: Array) -> Array:
    """Coefficients of the exponential and the inverse tangent for rotation vectors (..., 3) of angle ``a``: (..., 5).

    ``sin a / a``, ``(1 - cos a) / a^2``, ``(a - sin a) / a^3`` for the exponential; for the inverse of its tangent,
    ``1 + ad / 2 + c ad^2 + d ad^4``, the factors ``c`` and ``d``.
    """
    angle2 = (w * w).dot(ONES3)
    if angle2.size == 0 or angle2.max() < 0.5:
        # Near zero the closed form suffers from cancellation; the series does not.
        return np.asarray((angle2[..., None] ** _POWERS).dot(SERIES))
    small = angle2 < 0.5
    series = np.where(small, angle2, 0.0)[..., None] ** _POWERS @ SERIES
    a = np.sqrt(np.where(small, 1.0, angle2))
    sine, versed = np.sin(a), 1.0 - np.cos(a)
    closed = (
        sine / a,
        versed / a**2,
        (a - sine) / a**3,
        2.0 / a**2 - (a + 3.0 * sine) / (4.0 * a * versed),
        1.0 / a**4 - (a + sine) / (4.0 * a**3 * versed),
    )
    return np.where(small[..., None], series, np.stack(closed, axis=-1))


#: ``xi @ TWIST_MATRIX`` is the 4 x 4 matrix of a twist, row by row: the rate of a pose in its own frame.
TWIST_MATRIX: Array = np.zeros((6, 4, 4))
TWIST_MATRIX[3:, :3, :3] = _SKEW.reshape(3, 3, 3)
TWIST_MATRIX[:3, :3, 3] = np.eye(3)
TWIST_MATRIX = TWIST_MATRIX.reshape(6, 16)


def exp_matrix(xi: Array, c: Array) -> Array:
    """Exponential of twists (..., 6) as 4 x 4 matrices, with the `coefficients` of their rotations."""
    x = xi.reshape(-1, 6).dot(TWIST_MATRIX).reshape(*xi.shape[:-1], 4, 4)
    square = x @ x
    return np.asarray(EYE4 + x + c[..., 1, None, None] * square + c[..., 2, None, None] * (square @ x))


def pose_matrix(position: Array, rotation: Array) -> Array:
    """Pose as a 4 x 4 matrix, from a position (3,) and a rotation (3, 3)."""
    h = np.eye(4)
    h[:3, :3], h[:3, 3] = rotation, position
    return h


def exp_se3(xi: Array) -> tuple[Array, Array]:
    """Exponential of twists: (..., 6) to rotations (..., 3, 3) and translations (..., 3)."""
    h = exp_matrix(xi, coefficients(xi[..., 3:]))
    return h[..., :3, :3], h[..., :3, 3]


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
    c = coefficients(w)
    k = skew(w)
    tangent = EYE3 + c[..., 1, None, None] * k + c[..., 2, None, None] * (k @ k)
    v = np.linalg.solve(tangent, p[..., None])[..., 0]
    return np.concatenate((v, w), axis=-1)


#: ``xi @ _AD`` is the matrix of the adjoint map of a twist, row by row.
_AD: Array = np.zeros((6, 6, 6))
_AD[3:, :3, :3] = _AD[3:, 3:, 3:] = _AD[:3, :3, 3:] = _SKEW.reshape(3, 3, 3)
_AD = _AD.reshape(6, 36)


def adjoint_powers(xi: Array) -> Array:
    """``ad``, ``ad^2``, ``ad^3``, ``ad^4`` of twists: (..., 6) to (..., 4, 6, 6)."""
    ad = xi.reshape(-1, 6).dot(_AD).reshape(*xi.shape, 6)
    square = ad @ ad
    return np.stack((ad, square, square @ ad, square @ square), axis=-3)


def even_inverse_tangent(powers: Array, c: Array) -> Array:
    """``1 + c ad^2 + d ad^4``: `inverse_tangent_se3` without ``ad / 2``, from `adjoint_powers` and `coefficients`."""
    shape = powers.shape[:-3]
    even = c[..., None, 3:5] @ powers[..., 1::2, :, :].reshape(*shape, 2, 36)
    return np.asarray(even.reshape(*shape, 6, 6) + EYE6)


def inverse_tangent_se3(xi: Array) -> Array:
    """``T`` with ``d(xi) = T (h^-1 dh)`` for ``h = exp(xi)``: (..., 6) to (..., 6, 6); rotations below a full turn."""
    powers = adjoint_powers(xi)
    return even_inverse_tangent(powers, coefficients(xi[..., 3:])) + 0.5 * powers[..., 0, :, :]


#: ``w @ _COADJOINT`` is, row by row, the matrix ``M`` with ``a^T M b = w^T ad(a) b``.
_COADJOINT = np.ascontiguousarray(_AD.reshape(6, 6, 6).transpose(1, 0, 2)).reshape(6, 36)


def _second_series() -> Array:
    """Coefficients of `exponential_curvature`, by power of the squared angle: ``w ad^j``, then ``ad^p``, (terms, 5, 4).

    The tangent of the exponential is ``sum (-1)^k ad^k / (k+1)!``. Its derivative has the products ``ad^j ad(a) ad^p``
    with ``j + p = k - 1``. Powers beyond the fourth fall back by ``ad^5 = -2 a^2 ad^3 - a^4 ad``.
    """

    def powers(n: int) -> dict[int, Array]:
        """``ad^n`` by powers 0 .. 4, each with a polynomial in the squared angle."""
        if n <= 4:
            return {n: np.eye(1, _TERMS)[0]}
        found: dict[int, Array] = {}
        for lower, shift, factor in ((n - 2, 1, -2.0), (n - 4, 2, -1.0)):
            for m, polynomial in powers(lower).items():
                moved = factor * np.concatenate((np.zeros(shift), polynomial[:-shift]))
                found[m] = found.get(m, np.zeros(_TERMS)) + moved
        return found

    every = [powers(n) for n in range(2 * _TERMS)]
    table = np.zeros((_TERMS, 5, 4))
    for k in range(2, 2 * _TERMS):
        for j in range(k - 1):
            for m, left in every[j].items():
                for p, right in every[k - 1 - j].items():
                    table[:, m, p - 1] += (-1.0) ** k / factorial(k + 1) * np.convolve(left, right)[:_TERMS]
    return table


#: Coefficients of `exponential_curvature`, see `_second_series`, shape (terms, 20).
SECOND_SERIES: Array = _second_series().reshape(-1, 20)


def exponential_curvature(xi: Array, powers: Array, wrench: Array) -> Array:
    """Second derivative of the exponential, times a wrench: (n, 6, 6).

    The symmetric matrix ``H`` with ``a^T H a = w^T (dT(xi)[a]) a``, where ``T(xi) a`` is ``exp(-xi) d exp(xi)``.
    It is what a wrench at the far end adds to the second derivative of an energy by a twist.

    Parameters
    ----------
    xi
        Twists, rotations below half a turn, shape (n, 6).
    powers
        Their ``ad``, ``ad^2``, ``ad^3``, ``ad^4``, shape (n, 4, 6, 6).
    wrench
        In the far frame, shape (n, 6).
    """
    n = len(xi)
    rotation = xi[:, 3:]
    angle2 = (rotation * rotation).dot(ONES3)
    weights = (angle2[:, None] ** _POWERS).dot(SECOND_SERIES).reshape(n, 5, 4)
    moved = np.empty((n, 5, 6))
    moved[:, 0] = wrench
    np.matmul(wrench[:, None, None], powers, out=moved[:, 1:, None])
    left = moved.reshape(-1, 6).dot(_COADJOINT).reshape(n, 5, 6, 6).swapaxes(1, 2).reshape(n, 6, 30)
    h = left @ (weights @ powers.reshape(n, 4, 36)).reshape(n, 30, 6)
    return np.asarray(0.5 * (h + h.swapaxes(1, 2)))
