"""Slips within a substep as functions of load factor, mobilisations, and unknown tensions at the base.

With the configuration eliminated they are smooth functions of the load factor and of the tensions of all segments.
They are interpolated between the ends of the substep or states solved within it. Along the straight line between the
tensions of two states they are cubic (Hermite's polynomial through values and rates), and beside it linear in the
tensions, with derivatives that change linearly from one state to the other. How the tensions follow from mobilisations
and angles is not interpolated: it is the law of friction itself (`tdcr_fe.solve.friction_path.transfer`).
Documentation: docs/algorithms.md, section "Slip reversals within a substep".
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tdcr_fe.compiled import compilable
from tdcr_fe.elements import Array
from tdcr_fe.elements.coefficients import MAX_ITERATIONS
from tdcr_fe.elements.complementarity import largest, largest_magnitude
from tdcr_fe.solve.friction_path.rates import SlipDerivatives, SlipState, inverse
from tdcr_fe.solve.friction_path.transfer import AdhesiveTransfer, CapstanTransfer, branches_at, tensions_at

#: Newton's method for tensions and turning angles that agree ends with the correction of an error below this fraction
#: of the largest tension: what it leaves is about the square of that [1]. Far from any solved state they may not agree.
NEAR_TENSION = 3e-3


class SlipData(NamedTuple):
    """Slips and turning angles in one solved state, with their derivatives."""

    factor: float  # Load factor within the substep [1]
    tension: Array  # (q,): Of the segments [N]
    # (k + c + r,): Slips at the frictional holes [m], minus the slack of tendons whose tension at the base is
    # unknown [m], turning angles [rad]
    values: Array
    # (k + c + r, q): Derivatives of these values by the tensions of the segments [m/N, rad/N]
    by_tension: Array
    by_load: Array  # (k + c + r,): Derivatives of these values by the load factor at fixed tensions [m, rad]


class Intervals(NamedTuple):
    """Values between solved states as polynomials of the load factor, in each of the ``s`` intervals between them."""

    start: Array  # (s,): Load factor where an interval begins [1]
    length: Array  # (s,): By how much the load factor grows in it [1]
    tension: Array  # (s, q): Tensions of the segments at its start [N]
    # (s, q): Their derivative by the load factor, along the straight line to those at its end [N]
    tension_rate: Array
    # (s, 4, k + c + r): Coefficients of the values along this line, as cubic polynomials of the fraction of the
    # interval, lowest power first [m, rad]
    coefficients: Array
    # (s, k + c + r, q): Derivatives of the values by the tensions, at its start [m/N, rad/N]
    by_tension: Array
    by_tension_change: Array  # (s, k + c + r, q): Change of these derivatives up to its end [m/N, rad/N]
    # The derivatives change along a parabola: by the part ``x + p x (1 - x)`` of their change at the fraction ``x`` of
    # the interval, with this number ``p`` [1]
    parabola: float

    @classmethod
    def between(cls, states: Sequence[SlipData]) -> Intervals:
        """Between states, by load factor."""
        every = [_interval(first, last) for first, last in pairwise(states)]
        arrays = [np.array(own) for own in zip(*every, strict=True)]
        return cls._make([*arrays, 0.0])

    def with_defect_doubled(self) -> Intervals:
        """With twice the parabola in the rates along the line, to see what is uncertain in it."""
        coefficients = self.coefficients.copy()
        coefficients[:, 2] -= 1.5 * self.coefficients[:, 3]
        coefficients[:, 3] *= 2.0
        return self._replace(coefficients=coefficients, parabola=1.0)

    @property
    def defect(self) -> Array:
        """Change of the values beyond that by the mean of their rates at both ends of the first one [m, rad], (m,)."""
        return np.asarray(-0.5 * self.coefficients[0, 3])

    def error_off_line(self, factors: Array, tensions: Array, count: int) -> Array:
        """Largest error of the first values by a parabola in their derivatives, at tensions off the line [m].

        The parabola is taken to be as large as the change of the derivatives in the first interval.

        Parameters
        ----------
        factors
            Load factors within the first interval [1], shape (p,).
        tensions
            Tensions of the segments there [N], shape (p, q).
        count
            Number of values.
        """
        x = (factors - self.start[0]) / self.length[0]
        off = tensions - self.tension[0] - (factors - self.start[0])[:, None] * self.tension_rate[0]
        change = (x * (1.0 - x))[:, None] * (off @ self.by_tension_change[0, :count].T)
        return np.asarray(np.abs(change).max(axis=0))


def cubic(change: Array, start: Array, end: Array) -> tuple[Array, Array]:
    """Coefficients of the square and the cube in Hermite's polynomial of a change, with the slopes at both ends.

    The defect of the trapezoidal rule, the integral of the parabola in the rates, is half of minus the latter.
    """
    defect = change - 0.5 * (start + end)
    return 0.5 * (end - start) + 3.0 * defect, -2.0 * defect


def _interval(first: SlipData, last: SlipData) -> tuple[float | Array, ...]:
    """What `Intervals` has of one interval."""
    length, change = last.factor - first.factor, last.tension - first.tension
    slopes = [length * at.by_load + at.by_tension @ change for at in (first, last)]
    rate, by_tension_change = change / length, last.by_tension - first.by_tension
    polynomial = cubic(last.values - first.values, *slopes)
    coefficients = np.array((first.values, slopes[0], *polynomial))
    return first.factor, length, first.tension, rate, coefficients, first.by_tension, by_tension_change


@compilable
def point_on_line(intervals: Intervals, factor: float) -> tuple[Array, Array, Array, Array, Array, float]:
    """Tensions on the straight line between those of two states at a load factor, and the values there.

    Returns
    -------
    tension : ndarray, shape (q,)
        Tension of the segments, on the line [N].
    values : ndarray, shape (k + c + r,)
        As in `SlipData` [m, rad].
    by_tension : ndarray, shape (k + c + r, q)
        Their derivatives by the tensions [m/N, rad/N].
    fixed_rates : ndarray, shape (k + c + r,)
        Their derivatives by the load factor where the tensions stay as they are, on the line [m, rad].
    change : ndarray, shape (k + c + r, q)
        Derivatives of these by tensions off the line, times the length of the interval [m/N, rad/N].
    length : float
        Length of the interval between both states [1].
    """
    i, last = 0, len(intervals.start) - 1
    while i < last and intervals.start[i + 1] <= factor:
        i += 1
    length, moved = intervals.length[i], factor - intervals.start[i]
    x = moved / length
    powers = np.array([[1.0, x, x * x, x * x * x], [0.0, 1.0, 2.0 * x, 3.0 * x * x]])
    polynomials = powers.dot(intervals.coefficients[i])
    change = intervals.by_tension_change[i]
    by_tension = (x + intervals.parabola * x * (1.0 - x)) * change
    by_tension += intervals.by_tension[i]
    line = intervals.tension[i] + moved * intervals.tension_rate[i]
    rates = polynomials[1] / length - by_tension.dot(intervals.tension_rate[i])
    return line, polynomials[0], by_tension, rates, change, length


class InterpolatedSlips(NamedTuple):
    """Slips as functions of load factor and unknowns, as arrays."""

    transfer: CapstanTransfer | AdhesiveTransfer  # How tension passes along the tendons
    intervals: Intervals  # Slips and turning angles between solved states
    # (n,): Elastic slip by each unknown: the presliding distance at holes [m], zero for tensions
    elastic_slip: Array
    identity: Array  # (q, q)

    @property
    def compilable(self) -> bool:
        """Whether compiled functions take them."""
        return isinstance(self.transfer, CapstanTransfer)

    @property
    def breakpoints(self) -> Array:
        """Load factors up to which the slips are smooth, ascending; the last one is 1 [1]."""
        start = self.intervals.start
        return np.append(start[1:], 1.0)

    def at(self, factor: float, z: Array, tension: Array) -> SlipState:
        """See `slips_at`."""
        return slips_at(self, factor, z, tension)


@compilable
def slips_at(slips: InterpolatedSlips, factor: float, z: Array, tension: Array) -> SlipState:
    """Slips and their derivatives.

    Parameters
    ----------
    slips
        In the substep.
    factor
        Load factor within the substep [1].
    z
        Mobilisations [1], then unknown tensions at the base [N], shape (n,).
    tension
        Tension of the segments, about [N], shape (q,).
    """
    n = len(z)
    line, values, by_every, fixed_rates, change, length = point_on_line(slips.intervals, factor)
    by_tension, turning = by_every[:n], by_every[n:]
    for _ in range(MAX_ITERATIONS):
        angles = np.maximum(values[n:] + turning.dot(tension - line), 0.0)
        passed = tensions_at(slips.transfer, factor, z, angles)
        turned = inverse(slips.identity - passed.by_angle.dot(turning))
        excess = passed.tension - tension
        tension = tension + turned.dot(excess)
        if largest_magnitude(excess) <= NEAR_TENSION * largest(tension):
            break
    off = tension - line
    rate = fixed_rates + change.dot(off) / length
    slip = values[:n] + by_tension.dot(off)
    tension_by_load = turned.dot(passed.by_angle.dot(rate[n:]) + passed.by_load)
    tensions = passed.by_unknown.dot(turned.T)
    columns = -tensions.dot(by_tension.T)
    columns.reshape(-1)[:: n + 1] += slips.elastic_slip
    by_load = rate[:n] + by_tension.dot(tension_by_load)
    branches = branches_at(slips.transfer, z, passed.tension)
    given = by_load, slips.elastic_slip, branches, tension_by_load, tensions, columns
    return SlipState(tension, slip, SlipDerivatives(*given))
