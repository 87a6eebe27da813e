"""Correction of the drift along a followed path: inside the bounds of an unknown its complement stays what it was.

Rates are integrated, so that complements that should be constant drift by the errors of the pieces. Wherever the slips
are evaluated anew, one Newton step on the free unknowns takes the drift away (the projection of a constrained
integration; E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (1996), sec. VII.2).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgesv

from tdcr_fe.elements.numbers import smallest
from tdcr_fe.solve.friction_path.path import Piece
from tdcr_fe.solve.friction_path.slip_rates import rows_of
from tdcr_fe.solve.friction_path.slip_state import SlipState
from tdcr_fe.solve.friction_path.unknowns import Bounds, PathUnknowns

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Index = NDArray[np.int_]


class Unclipped(NamedTuple):
    """Unknowns inside their bounds at the end of a piece, as they would be without the bounds.

    Attributes
    ----------
    which : ndarray of int, shape (f,)
        Their numbers.
    values : ndarray, shape (f,)
        [1, N].
    """

    which: Index
    values: Array

    def fraction_inside(self, piece: Piece, bounds: Bounds) -> float:
        """Fraction of the piece over which all of them are inside their bounds [1]."""
        start = piece.unknowns[self.which]
        moved = self.values - start
        room = np.where(moved > 0.0, bounds.upper[self.which] - start, bounds.lower[self.which] - start)
        fraction = np.divide(room, moved, out=np.ones(len(start)), where=np.abs(moved) > np.abs(room))
        return smallest(fraction)


class DriftCorrection:
    """The complements that stay constant along a path, and the unknowns corrected so that they do.

    Parameters
    ----------
    unknowns
        Of the path.
    """

    def __init__(self, unknowns: PathUnknowns) -> None:
        count = len(unknowns.scale)
        self._unknowns, self._complement = unknowns, np.zeros(count)
        self._free: Flags = np.zeros(count, dtype=bool)
        #: Which free unknowns were at a bound before the last correction.
        self._at_bound: Flags = np.zeros(count, dtype=bool)

    def set_free(self, free: Flags, z: Array, state: SlipState) -> None:
        """From a state on, the complements of these unknowns are constant: those newly free keep the present value."""
        new = (free > self._free).nonzero()[0]
        if new.size:
            self._complement[new] = state.slip[new] - self._unknowns.elastic_slip[new] * z[new]
            # A tendon under tension has no slack.
            self._complement[self._unknowns.holes :] = 0.0
        self._free = free

    def corrected(self, z: Array, state: SlipState) -> tuple[Array, SlipState, Unclipped | None]:
        """Unknowns without drift.

        A free unknown that came to its bound too early is moved back once only: else its way there might never end.

        Parameters
        ----------
        z
            Unknowns, shape (n,).
        state
            Slips there, newly evaluated.

        Returns
        -------
        unknowns : ndarray, shape (n,)
        state : SlipState
            Slips there.
        unclipped : Unclipped or None
            What the free unknowns would be without bounds; None where none is free.
        """
        free, unknowns = self._free.nonzero()[0], self._unknowns
        if not free.size:
            return z, state, None
        drift = state.slip[free] - unknowns.elastic_slip[free] * z[free] - self._complement[free]
        change = np.asarray(dgesv(rows_of(state.columns(free), free), drift, overwrite_a=True)[2])
        unclipped = Unclipped(free, z[free] + change)
        at_bound = unknowns.bounds.side(z)[free] != 0.0
        change[at_bound & self._at_bound[free]] = 0.0
        self._at_bound[free] = at_bound
        lower, upper = unknowns.bounds.lower[free], unknowns.bounds.upper[free]
        new = z.copy()
        new[free] = np.minimum(np.maximum(z[free] + change, lower), upper)
        return new, state.with_changed(free, new[free] - z[free]), unclipped
