"""Where slips reverse within a substep: the friction path, whose rates are integrated from event to event.

A mobilisation is an elastic-plastic function of the slip at its hole. A substep solved as a whole is exact where every
slip is monotone: changes from stick to slip cost nothing. Only a slip that reverses within the substep makes the result
depend on how it was reached: the mobilisation then counts from the slip where it reversed, not from that at the start.

The slips are known as functions of load factor, mobilisations and tensions at the base (`InterpolatedSlips`). Their
rates are integrated segment by segment, over which they are constant. A path segment ends at an event: a hole begins
to slip, or a tendon driven by displacement becomes slack or taut. Complements should be constant, but they drift,
because the rates do change. Wherever the slips are evaluated anew, one Newton step on the free unknowns takes the
drift away (the projection of a constrained integration; E. Hairer, G. Wanner, Solving Ordinary Differential Equations
II (1996), sec. VII.2). Documentation: docs/algorithms.md, section "Slip reversals within a substep".
"""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

import numpy as np

from tdcr_fe.compiled import compilable, compiled_as, is_compiled, run_compiled
from tdcr_fe.elements import Array, Flags, Index
from tdcr_fe.elements.complementarity import ROUND_OFF, largest, largest_magnitude, smallest
from tdcr_fe.solve.friction_path.rates import (
    PathUnknowns,
    Rates,
    SlipState,
    distance_to_event,
    sides,
    solve_rates,
    solved_transposed,
    some_columns,
    some_rows,
    with_changed,
)
from tdcr_fe.solve.friction_path.slips import InterpolatedSlips, slips_at
from tdcr_fe.solve.friction_path.transfer import branches_at, distance_to_branch_change

#: Longest path segment, over which rates are taken as constant, behind one over which they were not [1]. With 0.12, one
#: of 200 random robots ended 2.8e-3 of the length off.
LONGEST_SEGMENT = 0.06
#: Change of the slip rates along a path segment, over the largest, up to which the next one may be twice as long [1].
#: With 0.1, the same robot ended as far off.
STEADY = 0.03
#: Derivatives of the slips are used again up to this change of the load factor, and of the tensions, over the
#: largest [1].
REUSED_CHANGE = 0.02
#: Fraction of this limit within which derivatives may still show that a slip reverses [1]. With all of it, three of 200
#: random robots ended up to 3.5e-5 of the length off.
REUSED_FOR_REVERSAL = 0.5
#: Shortest path segment [1]: a pull with 13 disks whose release turns all holes at once would be divided without it.
SHORTEST_SEGMENT = 1e-5
#: By which fraction of itself a path segment is shortened at most at once [1]: with all of it, the way to a reversal
#: right behind its beginning takes so many steps that a path may not reach its end.
MOST_SHORTENED = 0.75


class PathSegments(NamedTuple):
    """Parts of the substep over which the rates of all unknowns are constant; the arrays have one row a path segment.

    Unknowns are those of `tdcr_fe.solve.friction_path.rates`; load factors are those within the substep, 0 to 1.
    """

    start: Array  # (p,): Load factor where a path segment begins [1]
    length: Array  # (p,): By how much the load factor grows in it [1]
    unknowns: Array  # (p, n): Unknowns where it begins [1, N]
    side: Array  # (p, n): 1 or -1 where an unknown stays at its bound, 0 where it is free
    rate: Array  # (p, n): Rates of the unknowns [1, N]
    complement: Array  # (p, n): Rates of their complements [m]
    tension: Array  # (p, q): Tensions of the segments of the tendons where it begins [N]
    tension_rate: Array  # (p, q): Their derivatives by the load factor [N]

    def first(self, count: int) -> PathSegments:
        """The first ones of them."""
        return PathSegments._make(own[:count] for own in self)


@compilable
def empty_path(count: int, unknowns: int, segments: int) -> PathSegments:
    """Arrays for so many path segments."""
    n, q = (count, unknowns), (count, segments)
    of_unknowns = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    return PathSegments(np.empty(count), np.empty(count), *of_unknowns, np.empty(q), np.empty(q))


@compilable
def along_segment(
    path: PathSegments, i: int, length: float, bounds: PathUnknowns
) -> tuple[float, Array, Array]:
    """What is reached on a path segment after a change of the load factor.

    Parameters
    ----------
    path, i
        The path segments, and the number of the one.
    length
        Change of the load factor from its beginning on [1].
    bounds
        Bounds of the unknowns.

    Returns
    -------
    factor : float
        Load factor there [1].
    unknowns : ndarray, shape (n,)
    tension : ndarray, shape (q,)
        Tension of the segments [N].
    """
    moved = path.unknowns[i] + length * path.rate[i]
    unknowns = np.minimum(np.maximum(moved, bounds.lower), bounds.upper)
    return path.start[i] + length, unknowns, path.tension[i] + length * path.tension_rate[i]


class PathReversal(NamedTuple):
    """A place on a path where slips reverse."""

    factor: float  # Load factor within the substep [1]
    reverses: Flags  # (k,): Whose slips reverse here
    side: Array  # (n,): Up to here, 1 or -1 where an unknown was at its bound, 0 where it was free
    # (n,): Which unknown comes to a bound here, or leaves that at which its tendon was slack, so that rates jump; at
    # most one. None: rates reverse through zero
    arrives: Flags


class FrictionPath(NamedTuple):
    """Friction states all through a substep, and where slips reversed last."""

    unknowns: Array  # (k + c,): Mobilisations at its end [1], and the unknown tensions at the base there [N]
    # (k,): Change of the slip from the start of the substep to its last reversal; zero where there is none [m]
    reversal_slip: Array
    # (k,): Mobilisation at the last reversal, 1 or -1; that at the start where there is none [1]
    reversal_mobilisation: Array
    # (k,): Load factor of the last reversal within the substep; zero where there is none [1]
    reversal_factor: Array
    complete: bool  # Whether the end of the substep was reached
    segments: PathSegments
    bounds: PathUnknowns  # Bounds of the unknowns

    @property
    def reversed(self) -> Flags:
        """Which slips reversed, shape (k,)."""
        return self.reversal_factor > 0.0

    def at(self, factor: float) -> tuple[Array, Array]:
        """Unknowns, shape (k + c,), and tensions of the segments [N], shape (q,), at a load factor [1]."""
        i = int(np.searchsorted(self.segments.start, factor, side="right")) - 1
        _, unknowns, tension = along_segment(self.segments, i, factor - self.segments.start[i], self.bounds)
        return unknowns, tension

    def reversals(self, sticks: Flags) -> list[PathReversal]:
        """Reversals on which the end of the substep depends, by load factor.

        The mobilisation of a hole that sticks counts from its last reversal; that of one that slips does not depend on
        where it reversed. At a reversal the slip depends on the holes that stick there in the same way.

        Parameters
        ----------
        sticks
            Which holes stick at the end, shape (k,).
        """
        k, segments = len(self.reversal_factor), self.segments
        side = segments.side
        turned = ((sides(self.bounds, segments.unknowns) != 0.0) & (side == 0.0))[:, :k] & self.reversed
        counts, found = sticks, []
        for i in range(len(side) - 1, 0, -1):
            here = turned[i] & counts
            if here.any():
                before, after = side[i - 1], side[i]
                changed = (before == 0.0) & (after != 0.0)
                changed[k:] |= (before[k:] != 0.0) & (after[k:] == 0.0)
                first = changed & (changed.cumsum() == 1)
                found.append(PathReversal(float(segments.start[i]), here, before, first))
                counts = (counts & ~here) | (before[:k] == 0.0)
        return found[::-1]

    def may_touch_bound(self, error: Array) -> Flags:
        """Holes that stick at the end, and come so near to a bound before that they may slip there, shape (k,).

        They come nearer to it than at both ends, and the mobilisations may be wrong by an error [1].
        """
        k = len(self.reversal_factor)
        peak = np.abs(self.segments.unknowns[:, :k]).max(axis=0)
        ends = np.abs([self.segments.unknowns[0, :k], self.unknowns[:k]]).max(axis=0)
        return np.asarray((peak > ends) & (peak + error >= 1.0))

    def insensitive_holes(self, error: Array, presliding: Array) -> Flags:
        """Holes whose mobilisation at the end does not depend on an error of the slips, shape (k,).

        They slip in one direction until the end, faster than the error changes, either throughout or far enough to
        leave nothing of their history.

        Parameters
        ----------
        error
            Error of the change of the slips in the substep [m], shape (k,). It is taken to grow like that of a parabola
            in the rates: at the rate ``6 x (1 - x)`` times the error, with the load factor ``x``.
        presliding
            Presliding distances [m], shape (k,).
        """
        k = len(error)
        start, length = self.segments.start, self.segments.length
        side, rate = self.segments.side[:, :k], self.segments.complement[:, :k]
        last = side[-1]
        # From which path segment on the hole slips in its last direction up to the end.
        final = np.logical_and.accumulate((side == last)[::-1])[::-1]
        distance = last * np.where(final, length[:, None] * rate, 0.0).sum(axis=0)
        # Where in each path segment the parabola is largest; that is at no end of the substep.
        at = np.clip(0.5, start, start + length)
        relative_rate = last * rate / (6.0 * at * (1.0 - at))[:, None]
        slowest = np.where(final, relative_rate, np.inf).min(axis=0)
        # From one bound of the mobilisation to the other nothing is left of what it was.
        forgotten = final[0] | (distance >= 2.0 * presliding + error)
        return np.asarray((last != 0.0) & (slowest >= error) & forgotten)


class Constraints(NamedTuple):
    """The complements that stay constant along a path; the arrays are changed on the way."""

    free: Flags  # (n,): Unknowns inside their bounds
    complement: Array  # (n,): What their complements are to be [m]


@compilable
def fraction_inside(unclipped: Array, start: Array, bounds: PathUnknowns) -> float:
    """Fraction of a path segment over which unknowns that begin it at given values are inside their bounds [1]."""
    moved = unclipped - start
    room = np.where(moved > 0.0, bounds.upper, bounds.lower) - start
    # Unknowns that begin at a bound cannot come to it.
    return smallest(np.where((np.abs(moved) > np.abs(room)) & (room != 0.0), room / moved, 1.0))


@compilable
def set_free(
    constraints: Constraints, free: Flags, z: Array, state: SlipState, unknowns: PathUnknowns
) -> None:
    """From a state on, the complements of these unknowns are constant: those newly free keep the present value."""
    new = (free & ~constraints.free).nonzero()[0]
    if new.size:
        constraints.complement[new] = state.slip[new] - state.derivatives.elastic_slip[new] * z[new]
        # A tendon under tension has no slack.
        constraints.complement[unknowns.holes :] = 0.0
    constraints.free[:] = free


@compilable
def projected(
    constraints: Constraints, z: Array, state: SlipState, unknowns: PathUnknowns
) -> tuple[Array, SlipState, Array]:
    """Unknowns without drift.

    Free unknowns that would leave their bounds end there, and the others are corrected once more. One that came to its
    bound too early is moved back, unless what it slipped there is negligible.

    Parameters
    ----------
    constraints
        Which unknowns are free, with the complements that are constant.
    z
        Unknowns, shape (n,).
    state
        Slips there, newly evaluated.
    unknowns
        Unknowns of the path.

    Returns
    -------
    unknowns : ndarray, shape (n,)
    state : SlipState
        Slips there.
    unclipped : ndarray, shape (n,)
        What they would be without bounds.
    """
    new, unclipped = z.copy(), z.copy()
    free, again = constraints.free.nonzero()[0], False
    while free.size:
        here = new[free]
        drift = state.slip[free] - state.derivatives.elastic_slip[free] * here - constraints.complement[free]
        columns = some_rows(state.derivatives.columns, free)
        moved = here + solved_transposed(some_columns(columns, free), drift)
        inside = np.minimum(np.maximum(moved, unknowns.lower[free]), unknowns.upper[free])
        if not again:
            unclipped[free] = moved
            little = np.abs(moved - here) * unknowns.scale[free] <= unknowns.tolerance
            inside = np.where(little & (sides(unknowns, z)[free] != 0.0), here, inside)
        new[free] = inside
        state = with_changed(state, free, columns, inside - here)
        left = np.abs(moved - inside) * unknowns.scale[free] > unknowns.tolerance
        if again or np.count_nonzero(left) == 0:
            break
        free, again = free[~left], True
    return new, state, unclipped


class _Evaluation(NamedTuple):
    """Where the derivatives of the slips were evaluated."""

    factor: float  # Load factor [1]
    tension: Array  # (q,): Of the segments [N]
    largest: float  # Largest tension [N]


class _Here(NamedTuple):
    """Where a path segment begins."""

    factor: float  # Load factor [1]
    z: Array  # (n,): Unknowns
    state: SlipState
    rates: Rates
    slack: Array  # (c,): Of the tendons driven by displacement [m]


def follow_friction(
    slips: InterpolatedSlips, mobilisation: Array, base_tension: Array, tension: Array
) -> FrictionPath:
    """Follow the friction states through a substep.

    Parameters
    ----------
    slips
        In the substep.
    mobilisation
        Mobilisation of the frictional holes at its start [1], shape (k,).
    base_tension
        Tensions at the base there of tendons driven by displacement [N], shape (c,).
    tension
        Tension of the segments there [N], shape (q,).
    """
    unknowns = PathUnknowns.of(slips.elastic_slip[: len(mobilisation)], base_tension, tension)
    z = np.append(mobilisation, base_tension)
    given = slips, unknowns, z, tension, slips.breakpoints
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        fast = slips.compilable and is_compiled()
        path, count = run_compiled(_integrated, *given) if fast else _integrated(*given)
    return path._replace(segments=path.segments.first(count))


def _integrated(
    slips: InterpolatedSlips, unknowns: PathUnknowns, z: Array, tension: Array, breakpoints: Array
) -> tuple[FrictionPath, int]:
    """Integrate the friction states: the path, and how many of its segments are filled."""
    holes, most, factor, count, passed = unknowns.holes, 50 + 6 * len(z), 0.0, 0, 0
    path = empty_path(most, len(z), len(tension))
    constraints = Constraints(np.zeros(len(z), dtype=np.bool_), np.zeros(len(z)))
    reversal_slip, reversal_mobilisation, reversal_factor = np.zeros(holes), z[:holes].copy(), np.zeros(holes)
    state = evaluated(slips, factor, z, tension)
    tension, start_slip, unclipped = state.tension, state.slip, z
    evaluation, current, complete = _Evaluation(factor, tension, largest(tension)), True, False
    longest = LONGEST_SEGMENT
    for _ in range(most):
        if not current:
            state = evaluated(slips, factor, z, tension)
            tension, current = state.tension, True
            evaluation = _Evaluation(factor, tension, largest(tension))
            z, state, unclipped = projected(constraints, z, state, unknowns)
        side, slack = sides(unknowns, z), np.maximum(-state.slip[holes:], 0.0)
        rates = solve_rates(state.derivatives, side, slack, unknowns)
        if not isfinite(rates.complement.dot(rates.complement)):
            break
        reversing = ((rates.side == 0.0) & (side != 0.0))[:holes].nonzero()[0]
        if reversing.size and not _is_near(evaluation, factor, tension, REUSED_FOR_REVERSAL):
            # Derivatives from farther away do not show this; the same place is evaluated anew.
            current = False
            continue
        if reversing.size and count > 0:
            # Slips that reverse here may have done so before.
            fraction = _fraction_before_reversal(state, path, count - 1, reversing, side, unclipped, unknowns)
            if fraction < 1.0:
                # The last path segment ends earlier, and that place is evaluated.
                path.length[count - 1] *= fraction
                factor, z, tension = along_segment(path, count - 1, path.length[count - 1], unknowns)
                current = False
                continue
        if reversing.size:
            reversal_slip[reversing] = (state.slip - start_slip)[reversing]
            reversal_mobilisation[reversing] = side[reversing]
            reversal_factor[reversing] = factor
        set_free(constraints, rates.side == 0.0, z, state, unknowns)
        if factor >= breakpoints[passed] - ROUND_OFF:
            passed += 1
            complete = passed == len(breakpoints)
            if complete:
                break
        here, left = _Here(factor, z, state, rates, slack), breakpoints[passed] - factor
        longest = _longest_next(path, count, rates, longest)
        length = _add_segment(path, count, slips, unknowns, here, min(left, longest))
        factor, z, tension = along_segment(path, count, length, unknowns)
        count += 1
        current = factor < breakpoints[passed] - ROUND_OFF and _is_near(evaluation, factor, tension, 1.0)
        # On another branch of the law the derivatives are others.
        branches = branches_at(slips.transfer, z, tension)
        current = current and np.count_nonzero(state.derivatives.branches != branches) == 0
        if current:
            moved = state.slip + length * (rates.complement + state.derivatives.elastic_slip * rates.rate)
            state, unclipped = SlipState(tension, moved, state.derivatives), z
    reversals = reversal_slip, reversal_mobilisation, reversal_factor
    return FrictionPath(z, *reversals, complete, path, unknowns), count


@compilable
def _is_near(evaluation: _Evaluation, factor: float, tension: Array, fraction: float) -> bool:
    """Whether another load factor and other tensions are within a fraction of the limit of reuse."""
    limit, moved = fraction * REUSED_CHANGE, largest_magnitude(tension - evaluation.tension)
    return bool(factor - evaluation.factor <= limit and moved <= limit * evaluation.largest)


@compilable
def _longest_next(path: PathSegments, count: int, rates: Rates, longest: float) -> float:
    """How long the next path segment may be, after so many the last of which might be so long [1]."""
    if count > 0:
        changed = largest_magnitude(rates.complement - path.complement[count - 1])
        if changed <= STEADY * largest_magnitude(rates.complement):
            return 2.0 * longest
    return LONGEST_SEGMENT


@compilable
def _add_segment(
    path: PathSegments, i: int, slips: InterpolatedSlips, unknowns: PathUnknowns, here: _Here, longest: float
) -> float:
    """Add the path segment up to the next event, but no longer than given; its length."""
    z, state, rates, free = here.z, here.state, here.rates, here.rates.free
    tension_rate = state.derivatives.tension_by_load
    if free.size:
        tension_rate = tension_rate + rates.rate[free].dot(some_rows(state.derivatives.tensions, free))
    event = distance_to_event(rates, z, here.slack, unknowns)
    branch = distance_to_branch_change(slips.transfer, z, rates.rate, state.tension, tension_rate)
    length = min(longest, max(SHORTEST_SEGMENT, min(event, branch)))
    path.start[i], path.length[i], path.unknowns[i] = here.factor, length, z
    path.side[i], path.rate[i], path.complement[i] = rates.side, rates.rate, rates.complement
    path.tension[i], path.tension_rate[i] = state.tension, tension_rate
    return length


@compilable
def _fraction_before_reversal(
    state: SlipState,
    path: PathSegments,
    i: int,
    turned: Index,
    side: Array,
    unclipped: Array,
    unknowns: PathUnknowns,
) -> float:
    """Fraction of a path segment over which slips kept their direction [1].

    1 where the slip after their reversals makes no difference. Rates are taken as linear between those at both ends
    of the path segment. Slips also reverse where a free unknown of another hole comes to its bound within it.
    """
    length, negligible = path.length[i], unknowns.tolerance
    complement, direction = path.complement[i][turned], side[turned]
    before = np.maximum(direction * complement, 0.0)
    # The rates just before its end, where nothing had turned or come to a bound.
    rates, free = state.derivatives.by_load, (path.side[i] == 0.0).nonzero()[0]
    if free.size:
        columns = some_rows(state.derivatives.columns, free)
        rates = rates - solved_transposed(some_columns(columns, free), rates[free]).dot(columns)
    after = np.maximum(-direction * rates[turned], 0.0)
    # Just beyond the zero of the rate, so that the slip has turned there.
    beyond = np.maximum(after - 2.0 * unknowns.tolerance, 0.0)
    passed = beyond / np.maximum(before + after, 1e-300)
    # Unknowns that only came to their bound at the end have no rate before it.
    matters = (0.5 * after * passed * length > negligible) & (path.side[i][turned] != 0.0)
    fraction = 1.0 - largest(np.where(matters, passed, 0.0))
    inside = fraction_inside(unclipped, path.unknowns[i], unknowns)
    if min(inside, 1.0 - inside) * length > SHORTEST_SEGMENT:
        fraction = min(fraction, inside)
    return max(fraction, 1.0 - MOST_SHORTENED)


# Compiled functions know the interpolated slips, and no others.


@compiled_as(slips_at)
def evaluated(slips: InterpolatedSlips, factor: float, z: Array, tension: Array) -> SlipState:
    """See `InterpolatedSlips.at`."""
    return slips.at(factor, z, tension)
