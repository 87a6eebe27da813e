"""Tendons as cables, straight from hole to hole: their lengths and turning angles, and how these vary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.poses import skew

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CableShape:
    """Lengths and angles of all tendons of a robot, with derivatives.

    Derivatives are with respect to the body-frame twists ``[v, w]`` of the nodes that carry holes, laid out as
    ``6 * node + component``.

    Attributes
    ----------
    lengths : ndarray, shape (m, n)
        Of the segments, zero where padded [m].
    angles : ndarray, shape (m, n-1)
        By which each tendon turns at its holes 1 .. n-1, zero where padded [rad].
    d_lengths : ndarray, shape (m, n, 6 N)
    d_angles : ndarray, shape (m, n-1, 6 N)
    """

    lengths: Array
    angles: Array
    d_lengths: Array
    d_angles: Array


class CableGeometry:
    """Straight segments between the holes of all tendons.

    Parameters
    ----------
    nodes
        For every hole, the number of the node that carries it (counted among the ``node_count`` nodes with
        holes); base plate first, anchor last, padded by repeating the anchor; shape (m, n+1).
    offsets
        Position of every hole in the frame of its node [m], shape (m, n+1, 3).
    mask
        Which segments exist, shape (m, n).
    node_count
        Number of nodes that carry holes.
    clearance
        How far each tendon can shift sideways in its holes [m], shape (m,); None is not at all.
    """

    #: Turn of a tendon at which it has shifted by 0.7 of its clearance [rad].
    CLEARANCE_ANGLE = 0.01

    def __init__(
        self,
        nodes: NDArray[np.int_],
        offsets: Array,
        mask: NDArray[np.bool_],
        node_count: int,
        clearance: Array | None = None,
    ) -> None:
        self.nodes = nodes
        self.nominal = offsets
        self.offsets = offsets
        self.clearance = clearance if clearance is not None and np.any(clearance > 0.0) else None
        self.mask = mask
        self.node_count = node_count
        m, n = mask.shape
        turns = mask[:, 1:]
        self._exists = mask.astype(float)
        self._turns = turns.astype(float)
        self._padded = not bool(np.all(mask))
        # Every derivative is a force on a hole: both ends of the segments, then the three holes of the turns.
        # The row of the derivative and the hole it acts on never change, so they are found once.
        hole = np.arange(m * (n + 1)).reshape(m, n + 1)
        segment = np.arange(m * n).reshape(m, n)
        turn = m * n + np.arange(m * (n - 1)).reshape(m, n - 1)
        rows = np.concatenate((segment, segment, turn, turn, turn), axis=1).ravel()
        holes = np.concatenate(
            (hole[:, :-1], hole[:, 1:], hole[:, :-2], hole[:, 1:-1], hole[:, 2:]), axis=1
        ).ravel()
        # Padded entries would write zeros over the anchor's; they are left out.
        real = np.flatnonzero(np.concatenate((mask, mask, turns, turns, turns), axis=1).ravel())
        self._entry = real if self._padded else None
        row, self._hole = rows[real], holes[real]
        self._carrier = nodes.ravel()[self._hole]
        width = 6 * node_count
        self._target = ((row * width + 6 * self._carrier)[:, None] + np.arange(6)).ravel()
        self._derivatives = np.zeros((m * (2 * n - 1), width))
        self._lever = self._levers()

    def _levers(self) -> Array:
        """From a force on a hole, in its node's frame, to the wrench on the node, by entry, shape (K, 6, 3)."""
        lever = np.zeros((len(self._hole), 6, 3))
        lever[:, :3] = np.eye(3)
        lever[:, 3:] = skew(self.offsets.reshape(-1, 3)[self._hole])
        return lever

    def settle(self, positions: Array, rotations: Array) -> None:
        """Shift the tendons inside oversized holes to where they are pulled.

        At a hole the tendon pulls along ``b = d_before + d_after``, the unit vectors from the middle of the hole to
        those of its neighbours (below the base plate: straight down). In the plane of the disk it is shifted by
        ``clearance b / sqrt(|b|^2 + CLEARANCE_ANGLE^2)``. The anchor holds it.
        """
        if self.clearance is None:
            return
        frames = rotations[self.nodes]
        middle = positions[self.nodes] + (frames @ self.nominal[..., None])[..., 0]
        d = np.diff(middle, axis=1)
        length = np.linalg.norm(d, axis=2, keepdims=True)
        d = d / np.where(length > 0.0, length, 1.0)
        pull = np.zeros_like(middle)
        pull[:, :-1] += d
        pull[:, 1:] -= d
        pull[:, 0] -= frames[:, 0, :, 0]
        local = (pull[:, :, None, :] @ frames)[:, :, 0, :]
        local[..., 0] = 0.0
        size = np.sqrt(np.einsum("mki,mki->mk", local, local) + self.CLEARANCE_ANGLE**2)
        inner = np.ones(self.nodes.shape, dtype=bool)
        inner[:, 1:] = np.concatenate((self.mask[:, 1:], np.zeros((len(self.mask), 1), dtype=bool)), axis=1)
        share = np.where(inner, self.clearance[:, None] / size, 0.0)
        self.offsets = self.nominal + local * share[..., None]
        self._lever = self._levers()

    def holes(self, positions: Array, rotations: Array) -> Array:
        """World positions of all holes [m], shape (m, n+1, 3)."""
        return positions[self.nodes] + (rotations[self.nodes] @ self.offsets[..., None])[..., 0]

    def lengths(self, positions: Array, rotations: Array) -> Array:
        """Lengths of the segments only [m], shape (m, n)."""
        return np.linalg.norm(np.diff(self.holes(positions, rotations), axis=1), axis=2) * self.mask

    def directions(self, positions: Array, rotations: Array) -> Array:
        """Unit vectors of the segments from base to anchor, zero where padded, shape (m, n, 3)."""
        d = np.diff(self.holes(positions, rotations), axis=1)
        length = np.linalg.norm(d, axis=2, keepdims=True)
        return d / np.where(length > 0.0, length, 1.0)

    def evaluate(self, positions: Array, rotations: Array) -> CableShape:
        """Lengths and angles with their derivatives.

        Parameters
        ----------
        positions, rotations
            Of the nodes that carry holes [m], shapes (N, 3) and (N, 3, 3).

        Returns
        -------
        CableShape
            Its derivatives are overwritten by the next call.
        """
        m, n = self.mask.shape
        holes = positions[self.nodes]
        holes += (rotations[self.nodes] @ self.offsets[..., None])[..., 0]
        d = holes[:, 1:] - holes[:, :-1]
        lengths = np.sqrt(np.einsum("mki,mki->mk", d, d))
        if self._padded:
            inverse = self._exists / (lengths + (1.0 - self._exists))
            lengths *= self._exists
        else:
            inverse = 1.0 / lengths
        e = d * inverse[..., None]

        before, after = e[:, :-1], e[:, 1:]
        # Half the chord between unit vectors is the sine of half the angle: exact down to the smallest turn.
        bend = after - before
        half = 0.5 * np.sqrt(np.einsum("mki,mki->mk", bend, bend))
        if self._padded:
            half *= self._turns
        half = np.minimum(half, 1.0)
        angles = 2.0 * np.arcsin(half)
        square = half * half
        sine = 2.0 * half * np.sqrt(1.0 - square)
        # A tendon that does not turn has no preferred direction to turn into: the derivative is taken as zero.
        weight = np.divide(-1.0, sine, out=np.zeros_like(sine), where=sine > 1e-12)
        c = (1.0 - 2.0 * square)[..., None]
        g1 = (after - c * before) * (weight * inverse[:, :-1])[..., None]
        g2 = (before - c * after) * (weight * inverse[:, 1:])[..., None]
        gradient = np.concatenate((-e, e, -g1, g1 - g2, g2), axis=1).reshape(-1, 3)
        if self._entry is not None:
            gradient = gradient[self._entry]
        local = gradient[:, None, :] @ rotations[self._carrier]
        twist = self._lever @ local.reshape(-1, 3, 1)
        self._derivatives.reshape(-1)[self._target] = twist.ravel()
        width = 6 * self.node_count
        return CableShape(
            lengths,
            angles,
            self._derivatives[: m * n].reshape(m, n, width),
            self._derivatives[m * n :].reshape(m, n - 1, width),
        )
