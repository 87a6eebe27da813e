"""Exudyn's residual and Jacobian in body-frame increments of the beam nodes.

A beam node has seven coordinates (position and Euler parameters) and one norm constraint in Exudyn; here it has the
six components ``[v, w]`` of a twist in its own frame. Everything else in the scene keeps its coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.poses import euler_rate_matrix

Array = NDArray[np.float64]
Index = NDArray[np.int_]


@dataclass(frozen=True, eq=False)
class BlockPattern:
    """Which beam nodes are coupled, and where their blocks lie.

    Attributes
    ----------
    pairs : ndarray of bool, shape (N, N)
        Which nodes are coupled.
    first, second : ndarray of int, shape (P,)
        The coupled pairs.
    source : ndarray of int, shape (P, 7, 7)
        Of their blocks in Exudyn's matrix, flat.
    target : ndarray of int
        Of their blocks in the reduced matrix, flat.
    outside : ndarray of int
        Entries of Exudyn's matrix between nodes that are not coupled, flat.
    """

    pairs: NDArray[np.bool_]
    first: Index
    second: Index
    source: Index
    target: Index
    outside: Index


class BodyFrameReduction:
    """Map from Exudyn's unknowns to those of the strain-space solver.

    Parameters
    ----------
    mbs
        An assembled system.
    beam
        ODE2 coordinate numbers of all beam nodes, shape (N, 7).
    dropped
        Numbers of the algebraic equations that are satisfied by construction: the nodes' norm constraints, and joints
        of clamped bases.
    switched_off
        Numbers of the objects that are switched off while the solver works.
    """

    def __init__(
        self, mbs: exu.MainSystem, beam: Index, dropped: Sequence[int], switched_off: Sequence[int] = ()
    ) -> None:
        data = mbs.systemData
        self.n2, self.na = data.ODE2Size(), data.AEsize()
        self.size = self.n2 + self.na
        self.beam = beam
        self.nodes = len(beam)
        taken = np.zeros(self.size, dtype=bool)
        taken[beam.ravel()] = True
        taken[[self.n2 + i for i in dropped]] = True
        #: Exudyn's numbers of what is not a beam node, coordinates first, multipliers behind them.
        self.other = np.flatnonzero(~taken)
        self.other_coordinates = self.other[self.other < self.n2]
        self.other_multipliers = self.other[self.other >= self.n2] - self.n2
        #: Number of unknowns after the reduction.
        self.count = 6 * self.nodes + len(self.other)
        self._beams = np.zeros(self.size, dtype=bool)
        self._beams[beam.ravel()] = True
        self._pattern = self._block_pattern(self._connected(mbs, frozenset(switched_off)))
        flat = beam.ravel()
        self._right = flat[:, None] * self.size + self.other[None, :]
        self._below = self.other[:, None] * self.size + flat[None, :]
        self._corner = self.other[:, None] * self.size + self.other[None, :]

    def _connected(self, mbs: exu.MainSystem, without: frozenset[int]) -> NDArray[np.bool_]:
        """Which pairs of beam nodes any object of the scene couples, shape (N, N)."""
        data = mbs.systemData
        node_of = np.full(self.n2, -1)
        node_of[self.beam] = np.arange(self.nodes)[:, None]
        pairs = np.eye(self.nodes, dtype=bool)
        for k in set(range(data.NumberOfObjects())) - without:
            touched = np.asarray(data.GetObjectLTGODE2(k), dtype=int)
            nodes = np.unique(node_of[touched]) if touched.size else touched
            nodes = nodes[nodes >= 0]
            pairs[np.ix_(nodes, nodes)] = True
        return pairs

    def _block_pattern(self, pairs: NDArray[np.bool_]) -> BlockPattern:
        """Where the 7 x 7 blocks of coupled nodes lie in Exudyn's matrix, and the 6 x 6 blocks in the reduced one."""
        first, second = np.nonzero(pairs)
        rows, cols = self.beam[first][:, :, None], self.beam[second][:, None, :]
        source = rows * self.size + cols
        six = np.arange(6)
        to_rows = (6 * first[:, None] + six)[:, :, None]
        to_cols = (6 * second[:, None] + six)[:, None, :]
        target = (to_rows * self.count + to_cols).ravel()
        outside = np.ones((self.size, self.size), dtype=bool)
        outside.reshape(-1)[source.ravel()] = False
        beams = self._beams
        return BlockPattern(
            pairs, first, second, source, target, np.flatnonzero(outside & beams[:, None] & beams[None, :])
        )

    def frames(self, rotations: Array, parameters: Array) -> Array:
        """From body-frame increments of the beam nodes to their coordinates, shape (N, 7, 6).

        Parameters
        ----------
        rotations
            Shape (N, 3, 3).
        parameters
            Euler parameters, shape (N, 4).
        """
        frames = np.zeros((self.nodes, 7, 6))
        frames[:, :3, :3] = rotations
        frames[:, 3:, 3:] = euler_rate_matrix(parameters)
        return frames

    def residual(self, r: Array, frames: Array) -> Array:
        """Wrenches ``[f, m]`` of the nodes in their own frames, then the rest, shape (count,)."""
        at_nodes = (r.take(self.beam)[:, None, :] @ frames).reshape(-1)
        return np.concatenate((at_nodes, r[self.other])) if self.other.size else at_nodes

    def node_rows(self, j: Array, frames: Array, node: int, multipliers: Index) -> Array:
        """Derivative of the wrench on one node, in its own frame, by algebraic unknowns, shape (6, k)."""
        return np.asarray(frames[node].T @ j[np.ix_(self.beam[node], self.n2 + multipliers)])

    def jacobian(self, j: Array, frames: Array, search_couplings: bool) -> Array:
        """Exudyn's Jacobian in the same terms, shape (count, count).

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
                self._pattern = self._with_couplings(self._pattern.outside[outside != 0.0])
        pattern = self._pattern
        k = np.zeros((self.count, self.count))
        left = frames.take(pattern.first, axis=0).swapaxes(1, 2)
        blocks = left @ flat.take(pattern.source) @ frames.take(pattern.second, axis=0)
        k.reshape(-1)[pattern.target] = blocks.ravel()
        rest = len(self.other)
        if rest:
            n, six = self.nodes, 6 * self.nodes
            k[:six, six:] = (frames.swapaxes(1, 2) @ flat[self._right].reshape(n, 7, rest)).reshape(six, rest)
            below = flat[self._below].reshape(rest, n, 7).transpose(1, 0, 2) @ frames
            k[six:, :six] = below.transpose(1, 0, 2).reshape(rest, six)
            k[six:, six:] = flat[self._corner]
        return k

    def _with_couplings(self, entries: Index) -> BlockPattern:
        """The pattern with the pairs of nodes to which further entries of Exudyn's matrix belong."""
        node_of = np.full(self.size, -1)
        node_of[self.beam] = np.arange(self.nodes)[:, None]
        pairs = self._pattern.pairs.copy()
        pairs[node_of[entries // self.size], node_of[entries % self.size]] = True
        return self._block_pattern(pairs)
