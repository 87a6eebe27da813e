"""Maps and tangent of a backbone, element by element, for numba to compile (extra ``fast``).

The same as `ElementChain` has them with numpy for all elements at once, which plain Python takes. Twists ``[v, w]``
have upper block triangular powers of ``ad``, with equal blocks on the diagonal: half of the products fall away here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.compiled import compilable
from tdcr_fe.elements.pose_loops import add_product, put_skew

Array = NDArray[np.float64]


@compilable
def chain_maps(twists: Array, coefficients: Array) -> tuple[Array, Array]:
    """See `ElementChain._maps`.

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
def backbone_blocks(
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
) -> tuple[Array, Array]:
    """Tangent of a backbone, see `ElementChain.tangent`: blocks of every node by itself, and by the next one.

    Parameters
    ----------
    twists, steps, powers, maps
        Of the elements, see `ElementChain`.
    stiffness, reference
        `BackboneMesh.twist_stiffness` and `reference_twists`, shapes (E, 6).
    unbalanced
        Wrenches on the nodes, in their own frames, shape (6 N,).
    positions, rotations
        Of the nodes, shapes (N, 3) and (N, 3, 3).
    series
        `poses.SECOND_SERIES`.
    """
    nodes = len(positions)
    itself, after = np.zeros((nodes, 6, 6)), np.zeros((nodes - 1, 6, 6))
    wrenches = unbalanced.copy().reshape(nodes, 6)
    beyond = _distal_sum(wrenches, positions, rotations)
    half = np.zeros((3, 3))
    for e in range(nodes - 1):
        block = _element_block(
            twists[e], steps[e], powers[e], maps[e], stiffness[e], reference[e], wrenches[e : e + 2],
            beyond[e + 1], series,
        )  # fmt: skip
        itself[e] += block[:6, :6]
        itself[e + 1] += block[6:, 6:]
        after[e] = block[:6, 6:]
    # What the elements transmit acts on the nodes, too.
    for n in range(nodes):
        put_skew(half, wrenches[n, :3], 0.5)
        itself[n, :3, 3:] += half
        itself[n, 3:, :3] -= half
    put_skew(half, beyond[0, :3], 0.5)
    itself[0, :3, 3:] += half
    itself[0, 3:, :3] += half
    put_skew(half, beyond[0, 3:], 0.5)
    itself[0, 3:, 3:] += half
    return itself, after


@compilable
def add_blocks(k: Array, rows: NDArray[np.int_], itself: Array, after: Array) -> None:
    """Add the blocks of nodes in a row to a dense matrix, see `NodeStiffness`.

    Parameters
    ----------
    k
        Changed in place, shape (unknowns, unknowns).
    rows
        Numbers of the first unknowns of the nodes, shape (N,).
    itself, after
        The blocks, shapes (N, 6, 6) and (N-1, 6, 6).
    """
    for n in range(len(rows)):
        row = rows[n]
        k[row : row + 6, row : row + 6] += itself[n]
        if n + 1 < len(rows):
            then = rows[n + 1]
            k[row : row + 6, then : then + 6] += after[n]
            k[then : then + 6, row : row + 6] += after[n].T


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
def _element_block(
    twist: Array,
    step: Array,
    powers: Array,
    b: Array,
    stiffness: Array,
    reference: Array,
    wrenches: Array,
    beyond: Array,
    series: Array,
) -> Array:
    """Block of one element; what it transmits is added to the wrenches on its nodes, (2, 6), and beyond it, (6,)."""
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
    block[:6, 6:] -= _outer(step, beyond)
    return block


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
