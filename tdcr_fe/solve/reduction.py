"""Exudyn's residual and Jacobian in body-frame increments of the beam nodes.

A beam node has seven coordinates (position and Euler parameters) and one norm constraint in Exudyn; here it has the
six components ``[v, w]`` of a twist in its own frame. Everything else in the scene keeps its coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.poses import euler_rate_matrix

Array = NDArray[np.float64]
Index = NDArray[np.int_]


class BodyFrameReduction:
    """Which of Exudyn's unknowns are kept, and how they become those of the strain-space solver.

    Parameters
    ----------
    mbs
        An assembled system.
    beam
        ODE2 coordinate numbers of all beam nodes, shape (N, 7).
    dropped
        Numbers of the algebraic equations that are met by themselves: the nodes' norm constraints, and joints that
        hold a node where it is kept anyway.
    """

    def __init__(self, mbs: exu.MainSystem, beam: Index, dropped: Sequence[int]) -> None:
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
        self._maps = np.zeros((self.nodes, 7, 6))
        self._matrix = np.zeros((self.count, self.count))
        self._block_pattern(self._connected(mbs))

    def _connected(self, mbs: exu.MainSystem) -> NDArray[np.bool_]:
        """Which pairs of beam nodes any object of the scene couples, shape (N, N)."""
        data = mbs.systemData
        node_of = np.full(self.n2, -1)
        node_of[self.beam] = np.arange(self.nodes)[:, None]
        pairs = np.eye(self.nodes, dtype=bool)
        for k in range(data.NumberOfObjects()):
            touched = np.asarray(data.GetObjectLTGODE2(k), dtype=int)
            nodes = np.unique(node_of[touched]) if touched.size else touched
            nodes = nodes[nodes >= 0]
            pairs[np.ix_(nodes, nodes)] = True
        return pairs

    def _block_pattern(self, pairs: NDArray[np.bool_]) -> None:
        """Where the 7 x 7 blocks of coupled nodes lie in Exudyn's matrix, and the 6 x 6 blocks in ours."""
        self._pairs = pairs
        self._a, self._b = np.nonzero(pairs)
        rows, cols = self.beam[self._a][:, :, None], self.beam[self._b][:, None, :]
        self._from = rows * self.size + cols
        six = np.arange(6)
        to_rows = (6 * self._a[:, None] + six)[:, :, None]
        to_cols = (6 * self._b[:, None] + six)[:, None, :]
        self._to = (to_rows * self.count + to_cols).ravel()
        outside = np.ones((self.size, self.size), dtype=bool)
        outside.reshape(-1)[self._from.ravel()] = False
        beams = np.zeros(self.size, dtype=bool)
        beams[self.beam.ravel()] = True
        self._outside = np.flatnonzero(outside & beams[:, None] & beams[None, :])
        beam = self.beam.ravel()
        self._right = beam[:, None] * self.size + self.other[None, :]
        self._below = self.other[:, None] * self.size + beam[None, :]
        self._corner = self.other[:, None] * self.size + self.other[None, :]

    def set_poses(self, rotations: Array, parameters: Array) -> None:
        """Tell the frames of the beam nodes: rotations (N, 3, 3) and Euler parameters (N, 4)."""
        self._maps[:, :3, :3] = rotations
        self._maps[:, 3:, 3:] = euler_rate_matrix(parameters)

    def residual(self, r: Array) -> Array:
        """Wrenches ``[f, m]`` of the nodes in their own frames, then the rest, shape (count,)."""
        at_nodes = (r.take(self.beam)[:, None, :] @ self._maps).reshape(-1)
        return np.concatenate((at_nodes, r[self.other])) if self.other.size else at_nodes

    def node_rows(self, j: Array, node: int, multipliers: Index) -> Array:
        """Derivative of the wrench on one node, in its own frame, by algebraic unknowns, shape (6, k)."""
        return np.asarray(self._maps[node].T @ j[np.ix_(self.beam[node], self.n2 + multipliers)])

    def jacobian(self, j: Array, check: bool) -> Array:
        """Exudyn's Jacobian in the same terms, shape (count, count); overwritten by the next call.

        Parameters
        ----------
        j
            Shape (size, size).
        check
            Look for couplings between beam nodes that no object announced (contact, for one); where there
            are any, they are taken along from now on.
        """
        flat = j.reshape(-1)
        if check:
            outside = flat.take(self._outside)
            if outside.any():
                self._widen(self._outside[outside != 0.0])
        maps = self._maps
        k = self._matrix
        k.fill(0.0)
        left, right = maps.take(self._a, axis=0).swapaxes(1, 2), maps.take(self._b, axis=0)
        blocks = left @ flat.take(self._from) @ right
        k.reshape(-1)[self._to] = blocks.ravel()
        rest = len(self.other)
        if rest:
            n, six = self.nodes, 6 * self.nodes
            k[:six, six:] = (maps.swapaxes(1, 2) @ flat[self._right].reshape(n, 7, rest)).reshape(six, rest)
            below = flat[self._below].reshape(rest, n, 7).transpose(1, 0, 2) @ maps
            k[six:, :six] = below.transpose(1, 0, 2).reshape(rest, six)
            k[six:, six:] = flat[self._corner]
        return k

    def _widen(self, stray: Index) -> None:
        node_of = np.full(self.size, -1)
        node_of[self.beam] = np.arange(self.nodes)[:, None]
        pairs = self._pairs.copy()
        pairs[node_of[stray // self.size], node_of[stray % self.size]] = True
        self._block_pattern(pairs)
