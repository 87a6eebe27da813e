"""Maps and tangent of a backbone, element by element, for numba to compile (extra ``fast``).

The same as `ElementChain` has them with numpy for all elements at once, which plain Python takes. Twists ``[v, w]``
have upper block triangular powers of ``ad``, with equal blocks on the diagonal: half of the products fall away here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.compiled import compilable

Array = NDArray[np.float64]


@compilable
def chain_maps(twists: Array, coefficients: Array) -> tuple[Array, Array]:
    """See `ElementChain.maps`.

    Parameters
    ----------
    twists
        Of the elements, shape (E, 6).
    coefficients
        See `poses.coefficients`, shape (E, 5).
    """
    count = len(twists)
    powers, maps = np.zeros((count, 4, 6, 6)), np.empty((count, 6, 12))
    for e in range(count):
        p = powers[e]
        put_skew(p[0, 3:, 3:], twists[e, 3:], 1.0)
        put_skew(p[0, :3, 3:], twists[e, :3], 1.0)
        for k in range(1, 4):
            add_product(p[k, 3:, 3:], p[0, 3:, 3:], p[k - 1, 3:, 3:])
            add_product(p[k, :3, 3:], p[0, 3:, 3:], p[k - 1, :3, 3:])
            add_product(p[k, :3, 3:], p[0, :3, 3:], p[k - 1, 3:, 3:])
        c, d = coefficients[e, 3], coefficients[e, 4]
        for k in range(4):
            p[k, :3, :3] = p[k, 3:, 3:]
        for i in range(6):
            for j in range(6):
                even = c * p[1, i, j] + d * p[3, i, j]
                if i == j:
                    even += 1.0
                odd = 0.5 * p[0, i, j]
                maps[e, i, j], maps[e, i, 6 + j] = odd - even, odd + even
    return powers, maps


@compilable
def add_backbone_tangent(
    k: Array,
    first: int,
    twists: Array,
    steps: Array,
    powers: Array,
    maps: Array,
    stiffness: Array,
    reference: Array,
    unbalanced: Array,
    positions: Array,
    rotations: Array,
    series: Array,
) -> None:
    """Add the tangent of a backbone, see `ElementChain.tangent`, to that of a scene.

    Parameters
    ----------
    k
        Changed in place, shape (unknowns, unknowns).
    first
        Number of the first unknown of the robot.
    twists, steps, powers, maps
        Of the elements, see `ElementChain`.
    stiffness, reference
        `BackboneMesh.twist_stiffness` and `reference_twists`, shapes (E, 6).
    unbalanced
        Wrenches on all nodes of the scene, in their own frames, shape (unknowns,).
    positions, rotations
        Of the nodes, shapes (N, 3) and (N, 3, 3).
    series
        `poses.SECOND_SERIES`.
    """
    nodes = len(positions)
    wrenches = unbalanced[first : first + 6 * nodes].reshape(nodes, 6).copy()
    beyond = _distal_sum(wrenches, positions, rotations)
    half = np.zeros((2, 3, 3))
    for n in range(nodes):
        if n > 0:
            _add_element(
                k, first + 6 * (n - 1), twists[n - 1], steps[n - 1], powers[n - 1], maps[n - 1],
                stiffness[n - 1], reference[n - 1], wrenches[n - 1 : n + 1], beyond[n], series,
            )  # fmt: skip
    # What the elements transmit acts on the nodes, too.
    for n in range(nodes):
        row = first + 6 * n
        put_skew(half[0], wrenches[n, :3], 0.5)
        k[row : row + 3, row + 3 : row + 6] += half[0]
        k[row + 3 : row + 6, row : row + 3] -= half[0]
    put_skew(half[0], beyond[0, :3], 0.5)
    put_skew(half[1], beyond[0, 3:], 0.5)
    k[first : first + 3, first + 3 : first + 6] += half[0]
    k[first + 3 : first + 6, first : first + 3] += half[0]
    k[first + 3 : first + 6, first + 3 : first + 6] += half[1]


@compilable
def _distal_sum(wrenches: Array, positions: Array, rotations: Array) -> Array:
    """Sum of the wrenches on each node and all nodes distal to it, in its own frame: (N, 6) to (N, 6)."""
    found, force, moment = np.zeros_like(wrenches), np.zeros(3), np.zeros(3)
    for n in range(len(wrenches) - 1, -1, -1):
        f, m = np.zeros(3), np.zeros(3)
        p = positions[n]
        for i in range(3):
            for j in range(3):
                f[i] += rotations[n, i, j] * wrenches[n, j]
                m[i] += rotations[n, i, j] * wrenches[n, 3 + j]
        force += f
        # Moments are summed about the origin and then referred back to the nodes.
        for i in range(3):
            a, b = (i + 1) % 3, (i + 2) % 3
            moment[i] += m[i] + p[a] * f[b] - p[b] * f[a]
        for i in range(3):
            a, b = (i + 1) % 3, (i + 2) % 3
            about = moment[i] - (p[a] * force[b] - p[b] * force[a])
            for j in range(3):
                found[n, j] += rotations[n, i, j] * force[i]
                found[n, 3 + j] += rotations[n, i, j] * about
    return found


@compilable
def _add_element(
    k: Array,
    row: int,
    twist: Array,
    step: Array,
    powers: Array,
    b: Array,
    stiffness: Array,
    reference: Array,
    wrenches: Array,
    beyond: Array,
    series: Array,
) -> None:
    """Add one element; what it transmits is added to the wrenches on its nodes, shape (2, 6), and beyond it, (6,)."""
    for j in range(12):
        internal = 0.0
        for i in range(6):
            internal += stiffness[i] * (twist[i] - reference[i]) * b[i, j]
        wrenches[j // 6, j % 6] += internal
        if j >= 6:
            beyond[j - 6] += internal
    inner = _curvature(twist, powers, beyond, series)
    for i in range(6):
        inner[i, i] -= stiffness[i]
    product = np.zeros((6, 12))
    for i in range(6):
        for m in range(6):
            for j in range(12):
                product[i, j] += inner[i, m] * b[m, j]
    block = np.zeros((12, 12))
    for m in range(6):
        for i in range(12):
            for j in range(12):
                block[i, j] += b[m, i] * product[m, j]
    outer = _outer(step, beyond)
    block[:6, 6:] -= outer
    block[6:, :6] -= outer.T
    k[row : row + 12, row : row + 12] += block


@compilable
def _curvature(twist: Array, powers: Array, wrench: Array, series: Array) -> Array:
    """See `poses.exponential_curvature`, for one element."""
    angle2 = twist[3] ** 2 + twist[4] ** 2 + twist[5] ** 2
    weights = np.zeros(20)
    power = 1.0
    for term in series:
        weights += power * term
        power *= angle2
    by_move, by_turn = np.zeros((3, 3)), np.zeros((3, 3))
    cross, alpha, beta = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    moved = np.zeros(6)
    for m in range(5):
        if m == 0:
            moved[:] = wrench
        else:
            moved[:] = 0.0
            for i in range(6):
                for j in range(6):
                    moved[j] += wrench[i] * powers[m - 1, i, j]
        alpha[:] = 0.0
        beta[:] = 0.0
        for p in range(4):
            for i in range(3):
                for j in range(3):
                    alpha[i, j] += weights[4 * m + p] * powers[p, i, j]
                    beta[i, j] += weights[4 * m + p] * powers[p, i, 3 + j]
        put_skew(cross, moved[:3], -1.0)
        add_product(by_move, cross, alpha)
        add_product(by_turn, cross, beta)
        put_skew(cross, moved[3:], -1.0)
        add_product(by_turn, cross, alpha)
    found = np.zeros((6, 6))
    found[:3, 3:] = 0.5 * (by_move + by_move.T)
    found[3:, :3] = found[:3, 3:]
    found[3:, 3:] = 0.5 * (by_turn + by_turn.T)
    return found


@compilable
def _outer(step: Array, beyond: Array) -> Array:
    """What the wrench beyond an element adds to the coupling of its nodes, see `ElementChain.tangent`."""
    half, way, found = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((6, 6))
    put_skew(half, beyond[:3], 0.5)
    add_product(found[:3, 3:], step[:3, :3], half)
    found[3:, :3] = found[:3, 3:]
    put_skew(half, beyond[3:], 0.5)
    add_product(found[3:, 3:], step[:3, :3], half)
    put_skew(way, step[:3, 3], 1.0)
    add_product(found[3:, 3:], way, found[:3, 3:])
    return found


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
