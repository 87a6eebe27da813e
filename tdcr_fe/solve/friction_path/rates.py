"""Rates of mobilisations, slips and tensions at one load factor, and the distance to the next event.

The unknowns ``z`` are the mobilisations of holes [1], in [-1, 1], and the tensions at the base of tendons driven by
displacement [N], from 0 on. To each belongs a complement ``w`` [m]: of a hole its plastic slip, which is the slip less
its elastic part (presliding distance times mobilisation); of a tendon minus its slack. Inside the bounds of ``z`` the
complement is constant, at the upper bound it can only grow, at the lower one only fall. Its derivative by the load
factor is ``load - matrix z'`` (docs/algorithms.md, section "Slip reversals within a substep").

Small systems of equations are solved by LAPACK, which compiled functions (`tdcr_fe.compiled`) cannot call directly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dgesv, dgetrf, dgetri

from tdcr_fe.compiled import compilable, compiled_as
from tdcr_fe.elements import Array, Flags, Index
from tdcr_fe.elements.complementarity import MOST_IDLE_BLOCKS, ROUND_OFF, exchanged, smallest
from tdcr_fe.solve.newton.convergence import FRICTION_TOLERANCE


@compiled_as(lambda matrix: np.linalg.inv(matrix.T).T)
def inverse(matrix: Array) -> Array:
    """Inverse of a matrix whose rows lie one after the other, which is overwritten; nan where there is none."""
    # LAPACK has matrices column by column: it takes the transposed one without a copy.
    lu, pivots, _ = dgetrf(matrix.T, overwrite_a=True)
    found, singular = dgetri(lu, pivots, overwrite_lu=True)
    return np.asarray(np.full_like(found, np.nan) if singular else found.T)


@compiled_as(lambda matrix, right: right.dot(np.linalg.inv(matrix)))
def solved_transposed(matrix: Array, right: Array) -> Array:
    """Solution ``x`` of ``x matrix = right``, shape (n,), nan where there is none; both are overwritten."""
    _, _, found, singular = dgesv(matrix.T, right, overwrite_a=True, overwrite_b=True)
    return np.full(len(right), np.nan) if singular else found


@compiled_as(lambda matrix, which: matrix[which])
def some_rows(matrix: Array, which: Index) -> Array:
    """Some rows of a matrix."""
    return matrix.take(which, axis=0)


@compiled_as(lambda matrix, which: np.ascontiguousarray(matrix[:, which]))
def some_columns(matrix: Array, which: Index) -> Array:
    """Some columns of a matrix, as a matrix whose rows lie in memory one after the other."""
    return matrix.take(which, axis=1)


class PathUnknowns(NamedTuple):
    """The unknowns of a path: mobilisations of holes, then tensions at the base of tendons driven by displacement."""

    holes: int  # Number of mobilisations
    # Slips below it are negligible: rates that lead to less in a substep are zero, and what was slipped beyond a
    # reversal that was not foreseen is left as it is [m]
    tolerance: float
    scale: Array  # (n,): From the unknowns to lengths [m, m/N]
    lower: Array  # (n,): Lower bound: -1 of mobilisations [1], 0 of tensions [N]
    upper: Array  # (n,): Upper bound: 1 of mobilisations [1], infinity of tensions [N]
    near_lower: Array  # (n,): Below this value an unknown counts as at its lower bound: round-off above it
    near_upper: Array  # (n,): Above this value it counts as at its upper bound

    @classmethod
    def of(cls, presliding: Array, base_tension: Array, tension: Array) -> PathUnknowns:
        """The unknowns of a substep.

        Parameters
        ----------
        presliding
            Presliding distances of the frictional holes [m], shape (k,).
        base_tension
            Unknown tensions at the base at its start [N], shape (c,).
        tension
            Tension of the segments there [N], shape (q,).
        """
        one, least = np.ones_like(presliding), float(presliding.min())
        size = np.append(one, np.full_like(base_tension, base_tension.max(initial=1.0)))
        at_base = np.full_like(base_tension, least / max(ROUND_OFF, float(tension.max())))
        lower = np.append(-one, np.zeros_like(base_tension))
        upper = np.append(one, np.full_like(base_tension, np.inf))
        scale, near = np.append(presliding, at_base), (lower + ROUND_OFF * size, upper - ROUND_OFF * size)
        return cls(len(presliding), FRICTION_TOLERANCE * least, scale, lower, upper, *near)


@compilable
def sides(unknowns: PathUnknowns, z: Array) -> Array:
    """1 at the upper bounds, -1 at the lower ones, 0 inside, shape (n,)."""
    at_upper = (z >= unknowns.near_upper).astype(np.float64)
    at_upper -= z <= unknowns.near_lower
    return at_upper


class SlipDerivatives(NamedTuple):
    """Derivatives of the slips at a load factor."""

    # (n,): Derivatives of the slips, and of minus the slack, by the load factor at fixed unknowns [m]
    by_load: Array
    # (n,): Elastic slip by each unknown: the presliding distance at holes [m], zero for tensions
    elastic_slip: Array
    # (i,): Flags that change where the derivatives of the tensions jump; none where they never do
    branches: Flags
    tension_by_load: Array  # (q,): Derivatives of the tensions of the segments by the load factor [N]
    tensions: Array  # (n, q): Derivatives of the tensions by the unknowns [N, 1]
    # (n, n): Row by row, minus the derivatives of the complements by one of the unknowns. For a hole presliding
    # distance times identity, minus the derivatives of the slips by its mobilisation [m]; for a tendon minus those by
    # its tension [m/N]
    columns: Array


class SlipState(NamedTuple):
    """Slips at a load factor, and their derivatives there or nearby."""

    tension: Array  # (q,): Of the segments [N]
    slip: Array  # (n,): At the frictional holes, then minus the slack [m]
    derivatives: SlipDerivatives


@compilable
def with_changed(state: SlipState, which: Index, columns: Array, change: Array) -> SlipState:
    """The state at the same load factor with some of the unknowns changed a little, with the same derivatives.

    Parameters
    ----------
    state
        The state before.
    which
        Numbers of the unknowns.
    columns
        Their rows of `SlipDerivatives.columns`.
    change
        Their changes [1, N], shape (i,).
    """
    by = state.derivatives
    slip = state.slip - change.dot(columns)
    slip[which] += by.elastic_slip[which] * change
    return SlipState(state.tension + change.dot(some_rows(by.tensions, which)), slip, by)


class Rates(NamedTuple):
    """Rates at one load factor that satisfy the conditions of complementarity; nan where there are none."""

    side: Array  # (n,): 1 or -1 where an unknown stays at its bound, 0 where it is free
    rate: Array  # (n,): Of the unknowns [1, N]; zero at bounds
    complement: Array  # (n,): Of the complements [m]; zero up to round-off where unknowns are free
    free: Index  # (f,): Unknowns inside their bounds


@compilable
def solve_rates(derivatives: SlipDerivatives, side: Array, slack: Array, unknowns: PathUnknowns) -> Rates:
    """Rates at a load factor.

    A complementarity problem: an unknown at its bound stays there while its complement moves in the direction of the
    bound, or leaves it. Block principal pivoting as in `tdcr_fe.elements.complementarity.solve_box`.

    Parameters
    ----------
    derivatives
        Derivatives of the slips at this load factor.
    side
        At which bounds the unknowns are, see `sides`, shape (n,).
    slack
        Slack of the tendons driven by displacement [m], shape (c,): those that have any stay at their bounds in any
        case.
    unknowns
        Unknowns of the path.
    """
    count, load = len(side), derivatives.by_load
    active, back, pivoted = side, np.zeros(count), False
    kept = slack <= unknowns.tolerance
    fewest, idle_left = count + 1, MOST_IDLE_BLOCKS
    for _ in range(30 + 10 * count):
        free = (active == 0.0).nonzero()[0]
        rate, complement = np.zeros(count), load
        if free.size:
            columns = some_rows(derivatives.columns, free)
            rate[free] = of_free = solved_transposed(some_columns(columns, free), load[free])
            complement = load - of_free.dot(columns)
        violated = active * complement < -unknowns.tolerance
        if slack.size:
            violated[unknowns.holes :] &= kept
        if pivoted:
            # Unknowns that left their bounds must move inward.
            outward = side * unknowns.scale * rate > unknowns.tolerance
            violated |= outward
            back = np.where(outward, side, 0.0)
        number = int(np.count_nonzero(violated))
        if number == 0:
            return Rates(active, rate, complement, free)
        violated, fewest, idle_left = exchanged(violated, number, fewest, idle_left)
        active, pivoted = np.where(violated, back, active), True
    return Rates(active, rate, np.full(count, np.nan), free)


@compilable
def distance_to_event(rates: Rates, z: Array, slack: Array, unknowns: PathUnknowns) -> float:
    """Load factor from here to where a free unknown reaches a bound, or the slack of a tendon vanishes [1].

    At constant rates; infinite where neither happens.

    Parameters
    ----------
    rates
        From here on.
    z
        Unknowns here, shape (n,).
    slack
        Slack of the tendons driven by displacement [m], shape (c,).
    unknowns
        Unknowns of the path.
    """
    event, free = np.inf, rates.free
    if free.size:
        rate = rates.rate[free]
        bound = np.where(rate > 0.0, unknowns.upper[free], unknowns.lower[free])
        event = smallest(np.abs((bound - z[free]) / rate))
    if slack.size:
        closing = rates.complement[unknowns.holes :]
        ahead = (closing > 0.0) & (slack > 0.0)
        event = min(event, smallest(np.where(ahead, slack / np.where(ahead, closing, 1.0), np.inf)))
    return event
