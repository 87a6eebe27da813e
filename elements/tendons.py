"""Tendons as cables, straight from hole to hole: lengths, turning angles, derivatives, and forces on the nodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tdcr_fe.elements import Array, Flags
from tdcr_fe.elements.backbone import NodeStiffness
from tdcr_fe.elements.poses import EYE3, EYE9, ONES3, skew

#: ``p @ _TURNED`` is, row by row, ``(p + p^T) / 2 - tr(p) 1``.
_TURNED = 0.5 * (np.eye(9) + np.eye(9)[np.arange(9).reshape(3, 3).T.ravel()]) - np.outer(EYE9, EYE9)
#: Signs of the rows of `CableLines.stiffness`: minus a projector across the segment.
_ACROSS = np.array([-1.0, -1.0, -1.0, 1.0])


@dataclass(eq=False)
class CableShape:
    """Lengths and angles of all tendons of a robot, with derivatives, and the forces of given tensions.

    Derivatives are with respect to the body-frame twists ``[v, w]`` of the nodes that carry holes, laid out as
    ``6 * node + component``; they are computed at the first access. Each has entries of two or three nodes only:
    `CableLines.segments` and `CableLines.turns` have these.
    """

    lengths: Array  # (m, n): Of the segments, zero where padded [m]
    angles: Array  # (m, n-1): By which each tendon turns at its holes 1 .. n-1, zero where padded [rad]
    # The straight segments; None of tendons that follow the backbone, with the derivatives of their lengths, (m, 1, W)
    straight: CableLines | None = None
    along: Array | None = None
    width: int = 0  # Number W of body-frame components of the nodes that carry straight segments

    @cached_property
    def by_nodes(self) -> Array:
        """Derivatives of the lengths, then of the angles, shape (m, 2n-1, W)."""
        if self.along is not None:
            return self.along
        (m, n), lines = self.lengths.shape, self.lines
        found = np.zeros((m, 2 * n - 1, self.width))
        along_nodes(found, 0, n, 12)[...] = lines.segments[:, :, 3].transpose(1, 0, 2)
        along_nodes(found, n, n - 1, 18)[...] = lines.turns.transpose(1, 0, 2)
        return found

    @property
    def d_lengths(self) -> Array:
        """Derivatives of the lengths, shape (m, n, W)."""
        return self.by_nodes[:, : self.lengths.shape[1]]

    @property
    def d_angles(self) -> Array:
        """Derivatives of the angles, shape (m, n-1, W)."""
        return self.by_nodes[:, self.lengths.shape[1] :]

    def length_change(self, moved: Array) -> Array:
        """Linear change of the lengths [m], shape (m, n), with twists of the nodes that carry holes, shape (W,)."""
        if self.along is not None:
            return self.along @ moved
        nodes, n = moved.reshape(-1, 6), self.lengths.shape[1]
        both = np.concatenate((nodes[:n], nodes[1 : n + 1]), axis=1)
        return np.asarray((self.lines.segments[:, :, 3] @ both[:, :, None])[:, :, 0].T)

    def pull_of_each(self, tension: Array) -> Array:
        """Wrenches on the nodes that carry holes, of tensions (m, n) of many tendons, each by itself: (m, W)."""
        if self.along is not None:
            return np.asarray(-tension * self.along[:, 0])
        found = np.zeros((len(tension), self.width // 6, 6))
        found[:, : tension.shape[1] + 1] = self.lines.wrenches_of_each(tension).swapaxes(0, 1)
        return found.reshape(len(tension), self.width)

    @property
    def lines(self) -> CableLines:
        """The straight segments; `ValueError` for tendons that follow the backbone."""
        if self.straight is None:
            raise ValueError("these tendons follow the backbone and have no straight segments")
        return self.straight


@dataclass(eq=False)
class CableLines:
    """Straight segments of all tendons in one configuration."""

    frames: Array  # (n+1, 3, 3): Rotations of the nodes that carry the holes
    offsets: Array  # (n+1, m, 3): Of the holes, in the frames of their nodes [m]
    levers: Array  # (n+1, m, 3, 6): See `levers`
    inverse: Array  # (n, m): One over the lengths of the segments [1/m], zero where padded
    directions: Array  # (n, m, 3): Unit vectors along the segments from base to anchor, zero where padded
    bend: Array  # (n-1, m, 3): Differences of neighbouring directions
    chord: Array  # (n-1, m): Squared lengths of these differences

    def softening(self, change: Array) -> Array:
        """Pull on the nodes of changes of the tensions, of shape (m, n, W): shape (n+1, 6, W)."""
        n, width = change.shape[1:]
        each = self.segments[:, :, 3].swapaxes(1, 2) @ change.transpose(1, 0, 2)
        pull = np.zeros((n + 1, 6, width))
        np.negative(each[:, :6], out=pull[:-1])
        pull[1:] -= each[:, 6:]
        return pull

    def pulls(self, tension: Array) -> Array:
        """Forces on the holes in the frames of their nodes [N], shape (n+1, m, 3), of tensions (m, n)."""
        along = self.directions * tension.T[:, :, None]
        n, m, _ = along.shape
        force = np.zeros((n + 1, m, 3))
        force[:-1] = along
        force[1:] -= along
        return force @ self.frames

    def wrenches_of_each(self, tension: Array) -> Array:
        """As `wrenches`, of tensions (m, n) of many tendons, each by itself: shape (n+1, m, 6)."""
        return np.asarray((self.pulls(tension)[:, :, None] @ self.levers)[:, :, 0])

    def wrenches(self, pulls: Array) -> Array:
        """Wrench ``[f, m]`` of `pulls` on every node with holes, in its own frame [N, N m], shape (n+1, 6)."""
        count = len(pulls)
        return np.asarray((pulls.reshape(count, 1, -1) @ self.levers.reshape(count, -1, 6))[:, 0])

    @cached_property
    def segments(self) -> Array:
        """Motion of the far hole of each segment relative to its near one, by those of both nodes: (n, m, 4, 12).

        By segment and tendon three rows in world axes, and a fourth along the segment: the change of its length.
        """
        motions, along = self.frames[:, None] @ self.levers, self.directions
        rows: Array = np.empty((*along.shape[:2], 4, 12))
        np.negative(motions[:-1], out=rows[:, :, :3, :6])
        rows[:, :, :3, 6:] = motions[1:]
        np.matmul(along[:, :, None], rows[:, :, :3], out=rows[:, :, 3:])
        return rows

    @cached_property
    def turns(self) -> Array:
        """Derivatives of the angles at holes 1 .. n-1 by the nodes before, at and behind the hole, (n-1, m, 18)."""
        square, motions = self.chord * (1.0 - 0.25 * self.chord), self.segments[:, :, :3]
        # One over the sine; a straight tendon turns in no defined direction, so its derivative is set to zero.
        weight = np.sqrt(np.abs(square)) / (square + 1e-24)
        versed = (0.5 * self.chord)[:, :, None]
        before = -(weight * self.inverse[:-1])[:, :, None] * (self.bend + versed * self.directions[:-1])
        after = (weight * self.inverse[1:])[:, :, None] * (self.bend - versed * self.directions[1:])
        turns = np.zeros((*before.shape[:2], 18))
        turns[:, :, :12] = (before[:, :, None] @ motions[:-1])[:, :, 0]
        turns[:, :, 6:] += (after[:, :, None] @ motions[1:])[:, :, 0]
        return turns

    def stiffness(self, tension: Array, pulls: Array) -> NodeStiffness:
        """Geometric stiffness: derivative of `wrenches` at fixed tensions (m, n), in Exudyn's sign; with their `pulls`.

        A segment of length ``l`` and direction ``e`` resists with ``T / l`` across ``e``. At a hole with offset ``o``
        the lever turns with the node, which adds ``(f o^T + o f^T) / 2 - (f . o) 1`` by the rotation, with the force
        ``f`` in the frame of the node; the half is that of increments of Euler parameters, as in Exudyn's Jacobian
        (derivation: docs/algorithms.md, section "Tendons in the tangent").
        """
        m, n = tension.shape
        weight = (tension.T * self.inverse)[:, :, None] * _ACROSS
        rows = self.segments.reshape(n, 4 * m, 12)
        block = rows.swapaxes(1, 2) @ (rows * weight.reshape(n, 4 * m, 1))
        itself = np.zeros((n + 1, 6, 6))
        itself[:-1] = block[:, :6, :6]
        itself[1:] += block[:, 6:, 6:]
        # f o^T summed over the holes of a node.
        outer = pulls.swapaxes(1, 2) @ self.offsets
        itself[:, 3:, 3:] += outer.reshape(-1, 9).dot(_TURNED).reshape(-1, 3, 3)
        return NodeStiffness(itself, block[:, :6, 6:])


def levers(offsets: Array) -> Array:
    """From a force, as a row, on holes with offsets (..., 3) in the frame of a node to its wrench, (..., 3, 6)."""
    return np.concatenate((np.broadcast_to(EYE3, (*offsets.shape, 3)), -skew(offsets)), axis=-1)


class CableGeometry:
    """Straight segments between the holes of all tendons.

    Hole ``k`` of a tendon is on the ``k``-th node that carries holes, base plate first, its anchor last.

    Parameters
    ----------
    offsets
        Position of every hole in the frame of its node [m], shape (m, n+1, 3), padded by repeating the anchor.
    mask
        Which segments exist, shape (m, n).
    clearance
        How far each tendon can shift sideways in its holes [m], shape (m,); None is not at all.
    """

    #: Turn of a tendon at which it has shifted by 0.7 of its clearance [rad].
    CLEARANCE_ANGLE = 0.01

    def __init__(self, offsets: Array, mask: Flags, clearance: Array | None = None) -> None:
        self.nominal = offsets
        self.clearance = np.zeros(len(mask)) if clearance is None else clearance
        self._loose = np.flatnonzero(self.clearance > 0.0)
        #: Whether any tendon can shift in its holes.
        self.shifts = self._loose.size > 0
        self.mask = mask
        self._exists = mask.T.astype(float)
        # By hole and tendon.
        self._offsets = np.ascontiguousarray(offsets.swapaxes(0, 1))
        self._levers = levers(self._offsets)

    def shifted(self, positions: Array, rotations: Array) -> Array:
        """Where the tendons lie in oversized holes, shifted sideways in the direction of their pull [m].

        At a hole the tendon pulls along ``b = d_before + d_after``, the unit vectors from the middle of the hole to
        those of its neighbours (below the base plate: across it). In the plane of the disk it is shifted by
        ``clearance b / sqrt(|b|^2 + CLEARANCE_ANGLE^2)``. At the anchor it cannot shift.

        Parameters
        ----------
        positions, rotations
            Positions and rotations of the nodes that carry holes [m], shapes (..., N, 3) and (..., N, 3, 3).

        Returns
        -------
        ndarray, shape (..., m, n+1, 3)
        """
        mask, nominal = self.mask[self._loose], self.nominal[self._loose]
        nodes = np.minimum(np.arange(mask.shape[1] + 1), mask.sum(axis=1)[:, None])
        frames = rotations[..., nodes, :, :]
        middle = positions[..., nodes, :] + (frames @ nominal[..., None])[..., 0]
        d = np.diff(middle, axis=-2)
        length = np.linalg.norm(d, axis=-1, keepdims=True)
        d = d / np.where(length > 0.0, length, 1.0)
        pull = np.diff(d, axis=-2, prepend=0.0, append=0.0)
        local = (pull[..., None, :] @ frames)[..., 0, :]
        local[..., 0] = 0.0
        size = np.sqrt(np.einsum("...i,...i->...", local, local) + self.CLEARANCE_ANGLE**2)
        inner = np.ones(nodes.shape, dtype=bool)
        inner[:, 1:-1], inner[:, -1] = mask[:, 1:], False
        shift = np.where(inner, self.clearance[self._loose, None] / size, 0.0)
        found = np.tile(self.nominal, (*positions.shape[:-2], 1, 1, 1))
        found[..., self._loose, :, :] += local * shift[..., None]
        return found

    def evaluate(self, positions: Array, rotations: Array) -> CableShape:
        """Lengths and angles, with tendons shifted in oversized holes.

        Parameters
        ----------
        positions, rotations
            Positions and rotations of the nodes that carry holes [m], shapes (N, 3) and (N, 3, 3).
        """
        count, offsets, arms = self.mask.shape[1] + 1, self._offsets, self._levers
        if self.shifts:
            offsets = np.ascontiguousarray(self.shifted(positions, rotations).swapaxes(0, 1))
            arms = levers(offsets)
        frames = rotations[:count]
        holes = offsets @ frames.swapaxes(1, 2)
        holes += positions[:count, None]
        d = holes[1:] - holes[:-1]
        lengths = np.sqrt((d * d).dot(ONES3))
        inverse = self._exists / lengths
        lengths *= self._exists
        d *= inverse[:, :, None]
        # Half the chord between unit vectors is the sine of half the angle: exact down to the smallest turn.
        bend = d[1:] - d[:-1]
        chord = (bend * bend).dot(ONES3) * self._exists[1:]
        angles = 2.0 * np.arcsin(np.minimum(0.5 * np.sqrt(chord), 1.0))
        lines = CableLines(frames, offsets, arms, inverse, d, bend, chord)
        return CableShape(lengths.T, angles.T, lines, width=6 * len(positions))


def along_nodes(table: Array, first: int, count: int, width: int) -> Array:
    """View of contiguous (m, r, 6 N): of row ``first + k`` the ``width`` entries from node ``k`` on."""
    per_tendon, per_row, one = table.strides
    strides = per_tendon, per_row + 6 * one, one
    return np.ndarray((len(table), count, width), table.dtype, table, first * per_row, strides)
