"""Poses of a chain of elements, node by node, for numba to compile (extra ``fast``).

The same as `tdcr_fe.elements.poses` has them with numpy for all elements or nodes at once, which plain Python takes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.compiled import compilable

Array = NDArray[np.float64]


@compilable
def chain_poses(
    twists: Array, base: Array, near: Array, series: Array
) -> tuple[bool, Array, Array, Array, Array, Array, Array]:
    """Poses of all nodes of a backbone.

    Parameters
    ----------
    twists
        Of the elements, shape (E, 6).
    base
        Pose of the base, shape (4, 4).
    near
        Euler parameters whose signs are taken, shape (N, 4).
    series
        `poses.SERIES`.

    Returns
    -------
    complete : bool
        False where Euler parameters are too far from those given, and not found.
    coefficients : ndarray, shape (E, 5)
        See `poses.coefficients`.
    steps : ndarray, shape (E, 4, 4)
        See `ElementChain`.
    positions, rotations : ndarray, shapes (N, 3) and (N, 3, 3)
    parameters : ndarray, shape (N, 4)
        Euler parameters.
    frames : ndarray, shape (N, 7, 6)
        From body-frame increments to coordinates of the nodes.
    """
    count = len(twists)
    coefficients, steps = np.empty((count, 5)), np.zeros((count, 4, 4))
    positions, rotations = np.empty((count + 1, 3)), np.zeros((count + 1, 3, 3))
    parameters, frames = np.empty((count + 1, 4)), np.zeros((count + 1, 7, 6))
    positions[0], rotations[0] = base[:3, 3], base[:3, :3]
    complete = True
    for n in range(count + 1):
        r = rotations[n]
        if n > 0:
            step, before = steps[n - 1], rotations[n - 1]
            _put_coefficients(coefficients[n - 1], twists[n - 1, 3:], series)
            _put_exponential(step, twists[n - 1], coefficients[n - 1])
            add_product(r, before, step[:3, :3])
            for i in range(3):
                way = before[i, 0] * step[0, 3] + before[i, 1] * step[1, 3] + before[i, 2] * step[2, 3]
                positions[n, i] = positions[n - 1, i] + way
        if not _put_euler_parameters(parameters[n], r, near[n]):
            complete = False
        frames[n, :3, :3] = r
        _put_euler_rates(frames[n, 3:, 3:], parameters[n])
    return complete, coefficients, steps, positions, rotations, parameters, frames


@compilable
def _put_coefficients(to: Array, rotation: Array, series: Array) -> None:
    """See `poses.coefficients`, for one element."""
    angle2 = rotation[0] ** 2 + rotation[1] ** 2 + rotation[2] ** 2
    if angle2 < 0.5:
        to[:] = series[-1]
        for term in series[-2::-1]:
            for i in range(5):
                to[i] = to[i] * angle2 + term[i]
        return
    a = np.sqrt(angle2)
    sine, versed = np.sin(a), 1.0 - np.cos(a)
    to[0] = sine / a
    to[1] = versed / a**2
    to[2] = (a - sine) / a**3
    to[3] = 2.0 / a**2 - (a + 3.0 * sine) / (4.0 * a * versed)
    to[4] = 1.0 / a**4 - (a + sine) / (4.0 * a**3 * versed)


@compilable
def _put_exponential(to: Array, twist: Array, c: Array) -> None:
    """See `poses.exp_matrix`, for one element."""
    v, w = twist[:3], twist[3:]
    angle2 = w[0] ** 2 + w[1] ** 2 + w[2] ** 2
    for i in range(3):
        for j in range(3):
            to[i, j] = c[1] * w[i] * w[j]
        to[i, i] += 1.0 - c[1] * angle2
        # The cube of the cross product with the rotation is minus its square times the cross product itself.
        a, b = (i + 1) % 3, (i + 2) % 3
        turn = 1.0 - c[2] * angle2
        to[i, b] += turn * w[a]
        to[i, a] -= turn * w[b]
    along = w[0] * v[0] + w[1] * v[1] + w[2] * v[2]
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        turned = w[a] * v[b] - w[b] * v[a]
        to[i, 3] = v[i] + c[1] * turned + c[2] * (along * w[i] - angle2 * v[i])
    to[3, 3] = 1.0


@compilable
def _put_euler_parameters(to: Array, r: Array, near: Array) -> bool:
    """See `poses.euler_parameters_near`, for one node; False where they are too far from those given."""
    x, y, z = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    p, q, s = r[1, 0] + r[0, 1], r[0, 2] + r[2, 0], r[2, 1] + r[1, 2]
    a, b, c, d = near[0], near[1], near[2], near[3]
    to[0] = (1.0 + r[0, 0] + r[1, 1] + r[2, 2]) * a + x * b + y * c + z * d
    to[1] = x * a + (1.0 + r[0, 0] - r[1, 1] - r[2, 2]) * b + p * c + q * d
    to[2] = y * a + p * b + (1.0 - r[0, 0] + r[1, 1] - r[2, 2]) * c + s * d
    to[3] = z * a + q * b + s * c + (1.0 - r[0, 0] - r[1, 1] + r[2, 2]) * d
    size = np.sqrt(to[0] ** 2 + to[1] ** 2 + to[2] ** 2 + to[3] ** 2)
    if not size >= 0.1:
        return False
    to /= size
    return True


@compilable
def _put_euler_rates(to: Array, e: Array) -> None:
    """See `poses.euler_rate_matrix`, for one node."""
    to[0, 0], to[0, 1], to[0, 2] = -0.5 * e[1], -0.5 * e[2], -0.5 * e[3]
    to[1, 0], to[1, 1], to[1, 2] = 0.5 * e[0], -0.5 * e[3], 0.5 * e[2]
    to[2, 0], to[2, 1], to[2, 2] = 0.5 * e[3], 0.5 * e[0], -0.5 * e[1]
    to[3, 0], to[3, 1], to[3, 2] = -0.5 * e[2], 0.5 * e[1], 0.5 * e[0]


@compilable
def put_skew(to: Array, v: Array, factor: float) -> None:
    """Write a factor times the matrix of the cross product with ``v``, shape (3, 3)."""
    to[0, 0] = to[1, 1] = to[2, 2] = 0.0
    to[0, 1], to[1, 0] = -factor * v[2], factor * v[2]
    to[0, 2], to[2, 0] = factor * v[1], -factor * v[1]
    to[1, 2], to[2, 1] = -factor * v[0], factor * v[0]


@compilable
def add_product(to: Array, a: Array, b: Array) -> None:
    """Add the product of two matrices, shapes (3, 3)."""
    for i in range(3):
        for m in range(3):
            for j in range(3):
                to[i, j] += a[i, m] * b[m, j]
