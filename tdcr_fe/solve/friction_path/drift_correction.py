"""Correction of the drift along a followed path: inside the bounds of an unknown its complement stays what it was.

Rates are integrated, so that complements that should be constant drift by the errors of the pieces. Wherever the slips
are evaluated anew, one Newton step on the free unknowns takes the drift away (the projection of a constrained
integration; E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (1996), sec. VII.2).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.compiled import compilable
from tdcr_fe.elements.numbers import smallest
from tdcr_fe.solve.friction_path.slip_state import SlipState, columns_of, with_changed
from tdcr_fe.solve.friction_path.small_systems import factorised, solved_transposed, some_columns
from tdcr_fe.solve.friction_path.unknowns import Bounds, PathUnknowns, sides

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


class Constancy(NamedTuple):
    """The complements that stay constant along a path; the arrays are changed on the way.

    Attributes
    ----------
    free : ndarray of bool, shape (n,)
        Unknowns inside their bounds.
    complement : ndarray, shape (n,)
        What their complements are to be [m].
    at_bound : ndarray of bool, shape (n,)
        Which of them were at a bound before the last correction.
    """

    free: Flags
    complement: Array
    at_bound: Flags


@compilable
def none_unclipped() -> Unclipped:
    """No unknowns inside their bounds."""
    return Unclipped(np.zeros(0, dtype=np.int64), np.zeros(0))


@compilable
def nothing_constant(count: int) -> Constancy:
    """At the start of a path with so many unknowns."""
    return Constancy(np.zeros(count, dtype=np.bool_), np.zeros(count), np.zeros(count, dtype=np.bool_))


@compilable
def fraction_inside(unclipped: Unclipped, start: Array, bounds: Bounds) -> float:
    """Fraction of a piece over which unknowns that begin it at given values are inside their bounds [1]."""
    which = unclipped.which
    if not which.size:
        return 1.0
    moved = unclipped.values - start[which]
    room = np.where(moved > 0.0, bounds.upper[which], bounds.lower[which]) - start[which]
    return smallest(np.where(np.abs(moved) > np.abs(room), room / moved, 1.0))


@compilable
def set_free(kept: Constancy, free: Flags, z: Array, state: SlipState, unknowns: PathUnknowns) -> None:
    """From a state on, the complements of these unknowns are constant: those newly free keep the present value."""
    new = (free & ~kept.free).nonzero()[0]
    if new.size:
        kept.complement[new] = state.slip[new] - state.derivatives.elastic_slip[new] * z[new]
        # A tendon under tension has no slack.
        kept.complement[unknowns.holes :] = 0.0
    kept.free[:] = free


@compilable
def drift_corrected(
    kept: Constancy, z: Array, state: SlipState, unknowns: PathUnknowns
) -> tuple[Array, SlipState, Unclipped]:
    """Unknowns without drift.

    A free unknown that came to its bound too early is moved back once only: else its way there might never end.

    Parameters
    ----------
    kept
        The complements that are constant.
    z
        Unknowns, shape (n,).
    state
        Slips there, newly evaluated.
    unknowns
        Of the path.

    Returns
    -------
    unknowns : ndarray, shape (n,)
    state : SlipState
        Slips there.
    unclipped : Unclipped
        What the free unknowns would be without bounds.
    """
    free = kept.free.nonzero()[0]
    if not free.size:
        return z, state, none_unclipped()
    here, bounds = z[free], unknowns.bounds
    drift = state.slip[free] - state.derivatives.elastic_slip[free] * here - kept.complement[free]
    columns = columns_of(state.derivatives, free)
    change = solved_transposed(factorised(some_columns(columns, free)), drift)
    unclipped = Unclipped(free, here + change)
    at_bound = sides(bounds, z)[free] != 0.0
    change = np.where(at_bound & kept.at_bound[free], 0.0, change)
    kept.at_bound[free] = at_bound
    moved = np.minimum(np.maximum(here + change, bounds.lower[free]), bounds.upper[free])
    new = z.copy()
    new[free] = moved
    return new, with_changed(state, free, columns, moved - here), unclipped
