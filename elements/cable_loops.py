"""Shape, forces and derivatives of tendons as cables, by segment, for numba to compile (extra ``fast``).

The same as `CableGeometry` and `CableLines` have them with numpy for all segments at once, which plain Python takes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.compiled import compilable

Array = NDArray[np.float64]


@compilable
def cable_shape(
    frames: Array, positions: Array, offsets: Array, exists: Array
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Lengths, their inverses, unit vectors, differences of neighbouring ones and their squared lengths, and angles.

    See `CableGeometry.evaluate`.

    Parameters
    ----------
    frames, positions
        Of the nodes with holes, shapes (n+1, 3, 3) and (n+1, 3).
    offsets
        Of the holes, in the frames of their nodes [m], shape (m, n+1, 3).
    exists
        1 where there is a segment, else 0, shape (m, n).
    """
    m, n = exists.shape
    lengths, inverse, directions = np.zeros((m, n)), np.zeros((m, n)), np.zeros((m, n, 3))
    bend, chord, angles = np.zeros((m, n - 1, 3)), np.zeros((m, n - 1)), np.zeros((m, n - 1))
    before, hole = np.zeros(3), np.zeros(3)
    for t in range(m):
        for k in range(n + 1):
            o, square = offsets[t, k], 0.0
            for i in range(3):
                turned = frames[k, i, 0] * o[0] + frames[k, i, 1] * o[1] + frames[k, i, 2] * o[2]
                hole[i] = positions[k, i] + turned
                square += (hole[i] - before[i]) ** 2
            if k > 0 and exists[t, k - 1] > 0.0:
                lengths[t, k - 1] = np.sqrt(square)
                inverse[t, k - 1] = 1.0 / lengths[t, k - 1]
                for i in range(3):
                    directions[t, k - 1, i] = (hole[i] - before[i]) * inverse[t, k - 1]
            before[:] = hole
        for k in range(n - 1):
            for i in range(3):
                bend[t, k, i] = directions[t, k + 1, i] - directions[t, k, i]
                chord[t, k] += bend[t, k, i] ** 2
            chord[t, k] *= exists[t, k + 1]
            angles[t, k] = 2.0 * np.arcsin(min(0.5 * np.sqrt(chord[t, k]), 1.0))
    return lengths, inverse, directions, bend, chord, angles


@compilable
def cable_segments(frames: Array, offsets: Array, directions: Array) -> Array:
    """See `CableLines.segments`; arguments as of `CableLines`."""
    m, n, _ = directions.shape
    segments = np.empty((n, m, 4, 12))
    for k in range(n):
        for t in range(m):
            rows, e = segments[k, t], directions[t, k]
            _put_motion(rows[:3, :6], frames[k], offsets[t, k], -1.0)
            _put_motion(rows[:3, 6:], frames[k + 1], offsets[t, k + 1], 1.0)
            for j in range(12):
                rows[3, j] = e[0] * rows[0, j] + e[1] * rows[1, j] + e[2] * rows[2, j]
    return segments


@compilable
def cable_turns(segments: Array, directions: Array, inverse: Array, bend: Array, chord: Array) -> Array:
    """See `CableShape.turns`; arguments as of `CableLines` and of ``_turns`` in `tdcr_fe.elements.tendons`."""
    n, m, _, _ = segments.shape
    turns = np.zeros((n - 1, m, 18))
    for k in range(n - 1):
        for t in range(m):
            square, versed = chord[t, k] * (1.0 - 0.25 * chord[t, k]), 0.5 * chord[t, k]
            # One over the sine, zero where a tendon is straight.
            weight = np.sqrt(abs(square)) / (square + 1e-24)
            before, after = -weight * inverse[t, k], weight * inverse[t, k + 1]
            for i in range(3):
                first = before * (bend[t, k, i] + versed * directions[t, k, i])
                then = after * (bend[t, k, i] - versed * directions[t, k + 1, i])
                for j in range(12):
                    turns[k, t, j] += first * segments[k, t, i, j]
                    turns[k, t, 6 + j] += then * segments[k + 1, t, i, j]
    return turns


@compilable
def _put_motion(to: Array, frame: Array, offset: Array, sign: float) -> None:
    """Write the motion of a hole in world axes by the increments of its node, times a sign, shape (3, 6)."""
    x, y, z = offset[0], offset[1], offset[2]
    for i in range(3):
        a, b, c = sign * frame[i, 0], sign * frame[i, 1], sign * frame[i, 2]
        to[i, 0], to[i, 1], to[i, 2] = a, b, c
        to[i, 3], to[i, 4], to[i, 5] = c * y - b * z, a * z - c * x, b * x - a * y


@compilable
def cable_wrenches(frames: Array, offsets: Array, directions: Array, tension: Array) -> Array:
    """See `CableLines.wrenches`; arguments as of `cable_stiffness`."""
    m, n = tension.shape
    found, pull = np.zeros((n + 1, 6)), np.zeros(3)
    for k in range(n + 1):
        for t in range(m):
            _put_pull(pull, k, t, frames[k], directions, tension)
            for i in range(3):
                a, b = (i + 1) % 3, (i + 2) % 3
                found[k, i] += pull[i]
                found[k, 3 + i] += offsets[t, k, a] * pull[b] - offsets[t, k, b] * pull[a]
    return found


@compilable
def _put_pull(to: Array, node: int, tendon: int, frame: Array, directions: Array, tension: Array) -> None:
    """Write the force of a tendon on its hole at a node, in the node's frame [N], shape (3,)."""
    world = np.zeros(3)
    if node < tension.shape[1]:
        world += tension[tendon, node] * directions[tendon, node]
    if node > 0:
        world -= tension[tendon, node - 1] * directions[tendon, node - 1]
    for i in range(3):
        to[i] = world[0] * frame[0, i] + world[1] * frame[1, i] + world[2] * frame[2, i]


@compilable
def cable_stiffness(
    frames: Array, offsets: Array, directions: Array, inverse: Array, segments: Array, tension: Array
) -> tuple[Array, Array]:
    """See `CableLines.stiffness`: blocks of every node by itself, and by the next one.

    Parameters
    ----------
    frames, offsets, directions, inverse
        See `CableLines`.
    segments
        See `cable_segments`.
    tension
        Of the segments [N], shape (m, n).
    """
    m, n = tension.shape
    itself, after, block = np.zeros((n + 1, 6, 6)), np.zeros((n, 6, 6)), np.zeros((12, 12))
    for s in range(n):
        block[:] = 0.0
        for t in range(m):
            _add_geometric(block, segments[s, t], tension[t, s] * inverse[t, s])
        itself[s] += block[:6, :6]
        itself[s + 1] += block[6:, 6:]
        after[s] = block[:6, 6:]
    for node in range(n + 1):
        _add_levers(itself[node], node, frames[node], offsets, directions, tension)
    return itself, after


@compilable
def add_cable_softening(
    k: Array, rows: NDArray[np.int_], segments: Array, turns: Array, by_angle: Array
) -> None:
    """Add the pull of tensions that change with the angles to the tangent of a scene, see `CableLines.softening`.

    Parameters
    ----------
    k
        Changed in place, shape (unknowns, unknowns).
    rows
        Numbers of the first unknowns of the nodes with holes, shape (n+1,).
    segments, turns
        See `cable_segments` and `cable_turns`.
    by_angle
        Derivatives of the tensions by the turning angles [N/rad], shape (m, n, n-1).
    """
    m, n, holes = by_angle.shape
    width = 6 * (n + 1)
    change, pull = np.zeros(width), np.zeros((12, width))
    for s in range(n):
        pull[:] = 0.0
        for t in range(m):
            change[:] = 0.0
            for h in range(holes):
                slope = by_angle[t, s, h]
                if slope != 0.0:
                    for j in range(18):
                        change[6 * h + j] += slope * turns[h, t, j]
            for i in range(12):
                along = segments[s, t, 3, i]
                for j in range(width):
                    pull[i, j] -= along * change[j]
        for i in range(12):
            row = rows[s + i // 6] + i % 6
            for node in range(n + 1):
                for j in range(6):
                    k[row, rows[node] + j] += pull[i, 6 * node + j]


@compilable
def _add_geometric(block: Array, motions: Array, weight: float) -> None:
    """Add the pull of a segment that is turned across itself, with its tension over its length [N/m]; (12, 12)."""
    if weight == 0.0:
        return
    for r in range(4):
        factor = weight if r == 3 else -weight
        for i in range(12):
            left = factor * motions[r, i]
            for j in range(12):
                block[i, j] += left * motions[r, j]


@compilable
def _add_levers(
    to: Array, node: int, frame: Array, offsets: Array, directions: Array, tension: Array
) -> None:
    """Add the turn of the levers of all holes of a node to its block, see `CableLines.stiffness`."""
    m = len(tension)
    outer, pull = np.zeros((3, 3)), np.zeros(3)
    for t in range(m):
        _put_pull(pull, node, t, frame, directions, tension)
        for i in range(3):
            for j in range(3):
                outer[i, j] += pull[i] * offsets[t, node, j]
    trace = outer[0, 0] + outer[1, 1] + outer[2, 2]
    for i in range(3):
        for j in range(3):
            to[3 + i, 3 + j] += 0.5 * (outer[i, j] + outer[j, i])
        to[3 + i, 3 + i] -= trace
