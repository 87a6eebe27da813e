"""Derivatives of tendons as cables, segment by segment, for numba to compile (extra ``fast``).

The same as `CableLines` and `TendonForces` have them with numpy for all segments at once, which plain Python takes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.compiled import compilable

Array = NDArray[np.float64]


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
def add_cable_tangent(
    k: Array,
    rows: NDArray[np.int_],
    frames: Array,
    offsets: Array,
    directions: Array,
    inverse: Array,
    segments: Array,
    turns: Array,
    tension: Array,
    by_angle: Array,
) -> None:
    """Add the tangent of the pull of all tendons to that of a scene.

    It is that of `CableLines.stiffness` and of `CableLines.softening`.

    Parameters
    ----------
    k
        Changed in place, shape (unknowns, unknowns).
    rows
        Numbers of the first unknowns of the nodes with holes, shape (n+1,).
    frames, offsets, directions, inverse
        See `CableLines`.
    segments, turns
        See `cable_segments` and `cable_turns`.
    tension
        Of the segments [N], shape (m, n).
    by_angle
        Derivatives of the tensions by the turning angles [N/rad], shape (m, n, n-1).
    """
    m, n = tension.shape
    width = 6 * (n + 1)
    change, pull, block = np.zeros(width), np.zeros((12, width)), np.zeros((12, 12))
    for s in range(n):
        pull[:] = 0.0
        block[:] = 0.0
        for t in range(m):
            _add_geometric(block, segments[s, t], tension[t, s] * inverse[t, s])
            change[:] = 0.0
            for h in range(n - 1):
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
            for j in range(12):
                k[row, rows[s + j // 6] + j % 6] += block[i, j]
            for node in range(n + 1):
                for j in range(6):
                    k[row, rows[node] + j] += pull[i, 6 * node + j]
    for node in range(n + 1):
        _add_levers(k, rows[node], node, frames[node], offsets, directions, tension)


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
    k: Array, row: int, node: int, frame: Array, offsets: Array, directions: Array, tension: Array
) -> None:
    """Add the turn of the levers of all holes of a node, see `CableLines.stiffness`."""
    m, n = tension.shape
    outer, pull = np.zeros((3, 3)), np.zeros(3)
    for t in range(m):
        pull[:] = 0.0
        if node < n:
            pull += tension[t, node] * directions[t, node]
        if node > 0:
            pull -= tension[t, node - 1] * directions[t, node - 1]
        for i in range(3):
            local = pull[0] * frame[0, i] + pull[1] * frame[1, i] + pull[2] * frame[2, i]
            for j in range(3):
                outer[i, j] += local * offsets[t, node, j]
    trace = outer[0, 0] + outer[1, 1] + outer[2, 2]
    for i in range(3):
        for j in range(3):
            k[row + 3 + i, row + 3 + j] += 0.5 * (outer[i, j] + outer[j, i])
        k[row + 3 + i, row + 3 + i] -= trace
