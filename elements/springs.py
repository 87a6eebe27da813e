"""Springs from single nodes of a backbone to ground: forces on the nodes, and their stiffness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GroundSprings:
    """Linear springs from nodes to ground.

    Attributes
    ----------
    nodes : ndarray of int, shape (q,)
        Of the backbone; a node may occur several times.
    stiffness : ndarray, shape (q, 3, 3)
        In world axes [N/m].
    rest : ndarray, shape (q, 3)
        Positions without force [m].
    """

    nodes: NDArray[np.int_]
    stiffness: Array
    rest: Array

    def forces(self, positions: Array, rotations: Array) -> Array:
        """Forces on the nodes in their own frames [N], shape (q, 3), from the poses of all nodes."""
        pull = self.stiffness @ (self.rest - positions[self.nodes])[:, :, None]
        return np.asarray((rotations[self.nodes].swapaxes(1, 2) @ pull)[:, :, 0])

    def blocks(self, rotations: Array) -> Array:
        """Stiffness by increments of the positions in the nodes' own frames [N/m], shape (q, 3, 3)."""
        turn = rotations[self.nodes]
        return np.asarray(turn.swapaxes(1, 2) @ self.stiffness @ turn)
