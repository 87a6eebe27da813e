"""Exudyn's residual and Jacobian in body-frame increments of the beam nodes.

A beam node has seven coordinates (position and Euler parameters) and one norm constraint in Exudyn; here it has the
six components ``[v, w]`` of a twist in its own frame. Everything else in the scene keeps its coordinates.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import NodeStiffness
from tdcr_fe.elements.complementarity import as_slice
from tdcr_fe.elements.native.items import SystemReference

Array = NDArray[np.float64]
Index = NDArray[np.int_]


class RowBlocks(NamedTuple):
    """Where the blocks of nodes one after the other lie among all blocks."""

    itself: slice | Index  # Of every node by itself
    after: slice | Index  # Of every node by the next one in the row, of the next one by it
    before: slice | Index  # as `after`

    @classmethod
    def of(cls, number: Index, nodes: Index) -> RowBlocks:
        """For nodes in a row, from the number of the block of every pair of nodes."""
        near, far = nodes[:-1], nodes[1:]
        return cls(*map(as_slice, (number[nodes, nodes], number[near, far], number[far, near])))


def _add(blocks: Array, which: slice | Index, change: Array) -> None:
    """``blocks[which] += change``, without copying where a view will do."""
    if isinstance(which, slice):
        part = blocks[which]
        part += change
    else:
        blocks[which] += change


class RobotNodes(NamedTuple):
    """Numbers of one robot's nodes among all beam nodes."""

    backbone: Index  # All, base first
    holes: Index  # Those with holes through which tendons run


class RobotBlocks(NamedTuple):
    """Blocks of one robot."""

    backbone: RowBlocks  # Of all its nodes
    holes: RowBlocks  # Of those with holes


@dataclass(frozen=True, eq=False)
class BlockPattern:
    """Which beam nodes are coupled, and where their blocks lie."""

    pairs: NDArray[np.bool_]  # (N, N): Which nodes are coupled
    first: Index  # (P,): The coupled pairs
    second: Index  # as `first`
    source: Index  # (P, 7, 7): Of their blocks in Exudyn's matrix, flat
    row: Index  # Of the entries of their blocks in the reduced matrix
    column: Index  # as `row`
    outside: Index  # Entries of Exudyn's matrix between nodes that are not coupled, flat
    robots: tuple[RobotBlocks, ...]


class SceneTangent(NamedTuple):
    """Exudyn's Jacobian by body-frame increments of the beam nodes, the coupled blocks only."""

    pattern: BlockPattern
    blocks: Array  # (P, 6, 6): By coupled pair of beam nodes
    # Beam nodes by the rest, the rest by beam nodes, the rest by itself; None where there is nothing else
    others: tuple[Array, Array, Array] | None

    def add(self, row: RowBlocks, stiffness: NodeStiffness) -> None:
        """Add to the blocks of neighbours in a row of nodes; changes `blocks`."""
        _add(self.blocks, row.itself, stiffness.itself)
        _add(self.blocks, row.after, stiffness.after)
        _add(self.blocks, row.before, stiffness.after.swapaxes(1, 2))

    def dense(self, size: int) -> Array:
        """As a matrix of at least the reduced size, shape (size, size), filled up with zeros."""
        pattern = self.pattern
        k = np.zeros((size, size))
        k.reshape(-1)[pattern.row * size + pattern.column] = self.blocks.ravel()
        if self.others is not None:
            right, below, corner = self.others
            six, end = len(right), len(right) + len(corner)
            k[:six, six:end] = right
            k[six:end, :six] = below
            k[six:end, six:end] = corner
        return k


class BodyFrameReduction:
    """Map from Exudyn's unknowns to those of the strain-space solver.

    Parameters
    ----------
    mbs
        An assembled system.
    beam
        ODE2 coordinate numbers of all beam nodes, shape (N, 7).
    dropped
        Numbers of what is neither solved nor kept in equilibrium, multipliers behind all coordinates: the nodes' norm
        constraints and joints of clamped bases, which are satisfied by construction, and what does not change.
    robots
        Nodes of every robot. Neighbours among all of them, and among those with holes, are coupled.
    idle
        Numbers of objects that couple no nodes while this solver works.
    """

    def __init__(
        self,
        mbs: exu.MainSystem,
        beam: Index,
        dropped: NDArray[np.int_],
        robots: Sequence[RobotNodes],
        idle: Collection[int] = (),
    ) -> None:
        data = mbs.systemData
        self.n2, self.na = data.ODE2Size(), data.AEsize()
        self.size = self.n2 + self.na
        self.beam = beam
        self.nodes = len(beam)
        taken = np.zeros(self.size, dtype=bool)
        taken[beam.ravel()] = True
        taken[dropped] = True
        #: Exudyn's numbers of what is not a beam node, coordinates first, multipliers behind them.
        self.other = np.flatnonzero(~taken)
        self.other_coordinates = self.other[self.other < self.n2]
        self.other_multipliers = self.other[self.other >= self.n2] - self.n2
        #: Number of unknowns after the reduction.
        self.count = 6 * self.nodes + len(self.other)
        self._robots = tuple(robots)
        self._beams = np.zeros(self.size, dtype=bool)
        self._beams[beam.ravel()] = True
        # The scene must not be kept alive by what is computed from it.
        self._system, self._idle = SystemReference(mbs), idle
        self._present: BlockPattern | None = None
        flat = beam.ravel()
        self._right = flat[:, None] * self.size + self.other[None, :]
        self._below = self.other[:, None] * self.size + flat[None, :]
        self._corner = self.other[:, None] * self.size + self.other[None, :]

    @property
    def _pattern(self) -> BlockPattern:
        """Which nodes are coupled; computed where Exudyn's Jacobian is first needed, for it is as large as that."""
        if self._present is None:
            self._present = self._block_pattern(self._connected(self._system.mbs, self._idle))
        return self._present

    def _connected(self, mbs: exu.MainSystem, idle: Collection[int]) -> NDArray[np.bool_]:
        """Which pairs of beam nodes any object of the scene couples, shape (N, N)."""
        data = mbs.systemData
        node_of = np.full(self.n2, -1)
        node_of[self.beam] = np.arange(self.nodes)[:, None]
        pairs = np.eye(self.nodes, dtype=bool)
        for k in set(range(data.NumberOfObjects())).difference(idle):
            touched = np.asarray(data.GetObjectLTGODE2(k), dtype=int)
            nodes = sorted(set(node_of[touched].tolist()) - {-1})
            if len(nodes) > 1:
                pairs[np.ix_(nodes, nodes)] = True
        for robot in self._robots:
            for row in robot:
                pairs[row[:-1], row[1:]] = pairs[row[1:], row[:-1]] = True
        return pairs

    def _block_pattern(self, pairs: NDArray[np.bool_]) -> BlockPattern:
        """Where the 7 x 7 blocks of coupled nodes lie in Exudyn's matrix, and the 6 x 6 blocks in the reduced one."""
        first, second = np.nonzero(pairs)
        rows, cols = self.beam[first][:, :, None], self.beam[second][:, None, :]
        source = rows * self.size + cols
        six, shape = np.arange(6), (len(first), 6, 6)
        row = np.broadcast_to((6 * first[:, None] + six)[:, :, None], shape).ravel()
        column = np.broadcast_to((6 * second[:, None] + six)[:, None, :], shape).ravel()
        outside = np.ones((self.size, self.size), dtype=bool)
        outside.reshape(-1)[source.ravel()] = False
        beams = self._beams
        number = np.zeros((self.nodes, self.nodes), dtype=int)
        number[first, second] = np.arange(len(first))
        return BlockPattern(
            pairs,
            first,
            second,
            source,
            row,
            column,
            np.flatnonzero(outside & beams[:, None] & beams[None, :]),
            tuple(
                RobotBlocks(RowBlocks.of(number, r.backbone), RowBlocks.of(number, r.holes))
                for r in self._robots
            ),
        )

    def residual(self, r: Array, frames: Array) -> Array:
        """Wrenches ``[f, m]`` of the nodes in their own frames, then the rest, shape (count,)."""
        at_nodes = (r.take(self.beam)[:, None, :] @ frames).reshape(-1)
        return np.concatenate((at_nodes, r[self.other])) if self.other.size else at_nodes

    def tangent(self, j: Array, frames: Array, search_couplings: bool) -> SceneTangent:
        """Exudyn's Jacobian in the same terms.

        Parameters
        ----------
        j
            Shape (size, size).
        frames
            See `frames`.
        search_couplings
            Search for couplings between beam nodes that do not follow from the objects' node lists (contact, for
            example); those found are included from then on.
        """
        flat = j.reshape(-1)
        if search_couplings:
            outside = flat.take(self._pattern.outside)
            if outside.any():
                self._present = self._with_couplings(self._pattern.outside[outside != 0.0])
        pattern = self._pattern
        left = frames.take(pattern.first, axis=0).swapaxes(1, 2)
        blocks = left @ flat.take(pattern.source) @ frames.take(pattern.second, axis=0)
        rest, n = len(self.other), self.nodes
        if not rest:
            return SceneTangent(pattern, blocks, None)
        right = (frames.swapaxes(1, 2) @ flat[self._right].reshape(n, 7, rest)).reshape(6 * n, rest)
        below = flat[self._below].reshape(rest, n, 7).transpose(1, 0, 2) @ frames
        others = right, below.transpose(1, 0, 2).reshape(rest, 6 * n), flat[self._corner]
        return SceneTangent(pattern, blocks, others)

    def _with_couplings(self, entries: Index) -> BlockPattern:
        """The pattern with the pairs of nodes to which further entries of Exudyn's matrix belong."""
        node_of = np.full(self.size, -1)
        node_of[self.beam] = np.arange(self.nodes)[:, None]
        pairs = self._pattern.pairs.copy()
        pairs[node_of[entries // self.size], node_of[entries % self.size]] = True
        return self._block_pattern(pairs)
