"""Slips and turning angles between two solved states, interpolated by load factor and tensions of the segments.

With the configuration eliminated they are smooth functions of the load factor and of the tensions of all segments.
Along the straight line between the tensions of both states they are cubic (Hermite's polynomial through values and
rates), and beside it linear in the tensions, with derivatives that change linearly from one state to the other.
Documentation: page "Theory", section "Slips as functions of the tensions".
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.compiled import compilable

Array = NDArray[np.float64]


class SlipData(NamedTuple):
    """Slips and turning angles in one solved state, with their derivatives.

    Attributes
    ----------
    factor : float
        Load factor within the substep [1].
    tension : ndarray, shape (q,)
        Of the segments [N].
    values : ndarray, shape (k + c + r,)
        Slips at the frictional holes [m], minus the slack of tendons whose tension at the base is unknown [m], turning
        angles [rad].
    by_tension : ndarray, shape (k + c + r, q)
        Their derivatives by the tensions of the segments [m/N, rad/N].
    by_load : ndarray, shape (k + c + r,)
        Those by the load factor at fixed tensions [m, rad].
    """

    factor: float
    tension: Array
    values: Array
    by_tension: Array
    by_load: Array


class LinePoint(NamedTuple):
    """Values on the straight line between the tensions of two states, at one load factor.

    Attributes
    ----------
    tension : ndarray, shape (q,)
        Of the segments, on the line [N].
    values : ndarray, shape (k + c + r,)
        As in `SlipData` [m, rad].
    by_tension : ndarray, shape (k + c + r, q)
        Their derivatives by the tensions [m/N, rad/N].
    fixed_rates : ndarray, shape (k + c + r,)
        Their derivatives by the load factor where the tensions stay as they are, on the line [m, rad].
    rate_by_tension : ndarray, shape (k + c + r, q)
        Derivatives of these by tensions off the line, times the length of the interval [m/N, rad/N].
    length : float
        Of the interval between both states [1].
    """

    tension: Array
    values: Array
    by_tension: Array
    fixed_rates: Array
    rate_by_tension: Array
    length: float


class Intervals(NamedTuple):
    """Values between solved states as polynomials of the load factor, in each of the ``s`` intervals between them.

    Attributes
    ----------
    start, length : ndarray, shape (s,)
        Load factor where each begins, and by how much it grows in it [1].
    tension, tension_rate : ndarray, shape (s, q)
        Tensions of the segments at its start, and their derivative by the load factor along the straight line [N].
    coefficients : ndarray, shape (s, 4, k + c + r)
        Of the values along this line: cubic polynomials of the fraction of the interval, lowest power first [m, rad].
    by_tension, by_tension_change : ndarray, shape (s, k + c + r, q)
        Derivatives by the tensions at its start, and their change up to its end [m/N, rad/N].
    along, along_change : ndarray, shape (s, k + c + r)
        Rates of the values by these derivatives and the rates of the tensions along the straight line [m, rad].
    parabola : float
        Part ``p`` of that change by which the derivatives leave their straight line: ``x + p x (1 - x)`` in place of
        the fraction ``x`` of the interval [1].
    """

    start: Array
    length: Array
    tension: Array
    tension_rate: Array
    coefficients: Array
    by_tension: Array
    by_tension_change: Array
    along: Array
    along_change: Array
    parabola: float

    @classmethod
    def between(cls, states: Sequence[SlipData], defect_factor: float) -> Intervals:
        """Between states, by load factor; see `tdcr_fe.solve.friction_path.slip_model.SlipModel` for the factor."""
        every = [_interval(first, last, defect_factor) for first, last in pairwise(states)]
        arrays = [np.array(own) for own in zip(*every, strict=True)]
        return cls._make([*arrays, defect_factor - 1.0])

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
            Of the segments there [N], shape (p, q).
        count
            Number of values.
        """
        x = (factors - self.start[0]) / self.length[0]
        off = tensions - self.tension[0] - (factors - self.start[0])[:, None] * self.tension_rate[0]
        change = (x * (1.0 - x))[:, None] * (off @ self.by_tension_change[0, :count].T)
        return np.asarray(np.abs(change).max(axis=0))


def _interval(first: SlipData, last: SlipData, defect_factor: float) -> tuple[float | Array, ...]:
    """What `Intervals` has of one interval."""
    length, change = last.factor - first.factor, last.tension - first.tension
    slopes = [length * at.by_load + at.by_tension @ change for at in (first, last)]
    # What the trapezoidal rule leaves out: the integral of the parabola in the rates.
    defect = defect_factor * (last.values - first.values - 0.5 * (slopes[0] + slopes[1]))
    square = 0.5 * (slopes[1] - slopes[0]) + 3.0 * defect
    rate, by_tension_change = change / length, last.by_tension - first.by_tension
    coefficients = np.array((first.values, slopes[0], square, -2.0 * defect))
    along, along_change = first.by_tension @ rate, by_tension_change @ rate
    start = first.factor, length, first.tension, rate
    return *start, coefficients, first.by_tension, by_tension_change, along, along_change


@compilable
def point_on_line(intervals: Intervals, factor: float) -> LinePoint:
    """Tensions on the straight line at a load factor, the values there, their rates and derivatives."""
    i, last = 0, len(intervals.start) - 1
    while i < last and intervals.start[i + 1] <= factor:
        i += 1
    length, moved = intervals.length[i], factor - intervals.start[i]
    x = moved / length
    powers = np.array([[1.0, x, x * x, x * x * x], [0.0, 1.0, 2.0 * x, 3.0 * x * x]])
    polynomials = powers.dot(intervals.coefficients[i])
    weight = x + intervals.parabola * x * (1.0 - x)
    change = intervals.by_tension_change[i]
    by_tension = weight * change
    by_tension += intervals.by_tension[i]
    line = intervals.tension[i] + moved * intervals.tension_rate[i]
    rates = polynomials[1] / length - intervals.along[i] - weight * intervals.along_change[i]
    return LinePoint(line, polynomials[0], by_tension, rates, change, length)


@compilable
def rates_at_fixed_tensions(at: LinePoint, off: Array) -> Array:
    """Rates of the values where the tensions stay as they are, at tensions off the straight line [m, rad].

    Parameters
    ----------
    at
        The point on the line at this load factor.
    off
        By how much the tensions exceed those on the line [N], shape (q,).
    """
    return at.fixed_rates + at.rate_by_tension.dot(off) / at.length
