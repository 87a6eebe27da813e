"""Exudyn's residual and Jacobian in body-frame increments of the beam nodes.

A beam node has seven coordinates (position and Euler parameters) and one norm constraint in Exudyn; here it has the
six components ``[v, w]`` of a twist in its own frame. Everything else in the scene keeps its coordinates.
"""

from __future__ import annotations

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
    """

    def __init__(self, mbs: exu.MainSystem, beam: NDArray[np.int_], dropped: NDArray[np.int_]) -> None:
        data = mbs.systemData
        self.n2 = data.ODE2Size()
        self.size = self.n2 + data.AEsize()
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

    def residual(self, r: Array, frames: Array) -> Array:
        """Wrenches ``[f, m]`` of the nodes in their own frames, then the rest, shape (count,)."""
        at_nodes = (r.take(self.beam)[:, None, :] @ frames).reshape(-1)
        return np.concatenate((at_nodes, r[self.other])) if self.other.size else at_nodes

    def tangent(self, j: Array, frames: Array) -> Array:
        """Exudyn's Jacobian in the same terms, shape (count, count).

        Parameters
        ----------
        j
            Shape (size, size).
        frames
            See `tdcr_fe.elements.backbone.NodePoses`.
        """
        order = np.concatenate((self.beam.ravel(), self.other))
        rows = j[np.ix_(order, order)]
        for _ in range(2):
            # By node, its seven rows become six; then the same of the columns.
            at_nodes = frames.swapaxes(1, 2) @ rows[: self.beam.size].reshape(self.nodes, 7, -1)
            rows = np.concatenate((at_nodes.reshape(6 * self.nodes, -1), rows[self.beam.size :])).T
        return np.ascontiguousarray(rows)
