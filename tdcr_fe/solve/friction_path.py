"""Which slips reverse within a substep: the friction states followed through the linearised equilibrium.

A mobilisation is an elastic-plastic function of the slip at its hole. A substep solved as a whole is exact where every
slip is monotone: changes from stick to slip cost nothing. Only a slip that reverses within the substep makes the result
depend on how it was reached: the mobilisation then counts from the slip where it turned, not from that at the start.

With the configuration eliminated, the slips are a smooth function of load factor and mobilisations. Its derivatives
are known at both ends of a substep (a few right sides with factors that are at hand), so it is interpolated between
them, and the friction states are followed through the interpolant from event to event. This gives every turning point.
Derivation: documentation, page "Theory".
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgesv, dgetrs

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: Largest part of a substep over which slip rates are taken as linear in the load factor [1].
LONGEST = 0.2
#: Shortest part, which resolves events that follow each other [1].
SHORTEST = 1e-5
#: Slip rates below this fraction of the presliding distance per substep are zero [1].
RATE_TOLERANCE = 1e-4


class SlipRates(NamedTuple):
    """Derivatives of the slips at one end of a substep.

    Attributes
    ----------
    by_load : ndarray, shape (k,)
        By the load factor at fixed mobilisations, times the length of the substep [m].
    matrix : ndarray, shape (k, k)
        Presliding distance times identity, minus the derivative by the mobilisations [m].
    """

    by_load: Array
    matrix: Array


class FollowedPath(NamedTuple):
    """Friction states at the end of a substep, and where slips reversed.

    Attributes
    ----------
    slip : ndarray, shape (k,)
        Change of the slips within the substep [m].
    mobilisation : ndarray, shape (k,)
        At its end [1].
    turning_slip : ndarray, shape (k,)
        Change of the slip up to the last reversal; zero where there is none [m].
    turning_mobilisation : ndarray, shape (k,)
        Mobilisation there: 1 or -1; that at the start where there is none [1].
    turning_factor : ndarray, shape (k,)
        Fraction of the substep at the last reversal; zero where there is none [1].
    complete : bool
        Whether the end of the substep was reached.
    margin : ndarray, shape (k,)
        Smallest slip rate in the direction of slipping over ``6 x (1 - x)``, with the fraction ``x`` of the substep
        [m]; minus infinity where any hole sticks at any time.
    """

    slip: Array
    mobilisation: Array
    turning_slip: Array
    turning_mobilisation: Array
    turning_factor: Array
    complete: bool
    margin: Array

    @property
    def reversed(self) -> Flags:
        """Which slips reversed, shape (k,)."""
        return self.turning_factor > 0.0


class _Motion(NamedTuple):
    """Rates from a load factor on, linear in it.

    Attributes
    ----------
    side : ndarray, shape (k,)
        1 or -1 where a hole slips, 0 where it sticks.
    mobilisation, mobilisation_change : ndarray, shape (k,)
        Rates of the mobilisations and their derivatives; zero where holes slip.
    slip, slip_change : ndarray, shape (k,)
        Slip rates where holes slip, and their derivatives; elsewhere meaningless.
    """

    side: Array
    mobilisation: Array
    mobilisation_change: Array
    slip: Array
    slip_change: Array


def follow(
    start: SlipRates, end: SlipRates, mobilisation: Array, presliding: float, bulge: Array | None = None
) -> FollowedPath:
    """Follow the friction states through a substep.

    Parameters
    ----------
    start, end
        Derivatives at its ends.
    mobilisation
        At its start, shape (k,).
    presliding
        Presliding distance [m].
    bulge
        Change of the slips within the substep beyond that of derivatives that are linear in the load factor, at fixed
        mobilisations [m], shape (k,). Its rate is a parabola that vanishes at both ends.
    """
    count = len(mobilisation)
    s, side, u, now = mobilisation, np.trunc(mobilisation), np.zeros(count), 0.0
    turning_slip, turning_factor, turning_mobilisation = np.zeros(count), np.zeros(count), s.copy()
    change = SlipRates(end.by_load - start.by_load, end.matrix - start.matrix)
    pieces: list[tuple[float, float, _Motion]] = []
    complete, tolerance = False, RATE_TOLERANCE * presliding
    for _ in range(50 + 4 * count):
        here = SlipRates(start.by_load + now * change.by_load, start.matrix + now * change.matrix)
        slope = change
        if bulge is not None:
            middle = min(1.0, now + 0.5 * LONGEST)
            here = here._replace(by_load=here.by_load + (6.0 * now * (1.0 - now)) * bulge)
            slope = change._replace(by_load=change.by_load + (6.0 - 12.0 * middle) * bulge)
        motion = _motion(here, slope, side, tolerance)
        if motion is None:
            break
        sticks = motion.side == 0.0
        turned = sticks & (side != 0.0)
        if turned.any():
            turning_slip[turned], turning_factor[turned] = u[turned], now
            turning_mobilisation[turned] = side[turned]
        part = min(1.0 - now, LONGEST, max(SHORTEST, _next_event(motion, s, sticks, tolerance)))
        pieces.append((now, part, motion))
        half = 0.5 * part * part
        moved = part * motion.mobilisation + half * motion.mobilisation_change
        s = np.where(sticks, np.minimum(np.maximum(s + moved, -1.0), 1.0), motion.side)
        u = u + np.where(sticks, presliding * moved, part * motion.slip + half * motion.slip_change)
        side = np.where(np.abs(s) > 1.0 - 1e-12, np.rint(s), 0.0)
        now += part
        if now >= 1.0 - 1e-12:
            complete = True
            break
    throughout = all(bool(np.all(motion.side != 0.0)) for _, _, motion in pieces)
    margin = _margin(pieces) if throughout else np.full(count, -np.inf)
    return FollowedPath(u, s, turning_slip, turning_mobilisation, turning_factor, complete, margin)


def _margin(pieces: list[tuple[float, float, _Motion]]) -> Array:
    """See `FollowedPath.margin`."""
    now, part = np.array([p[:2] for p in pieces]).T
    side = np.array([p[2].side for p in pieces])
    slip, change = np.array([p[2].slip for p in pieces]), np.array([p[2].slip_change for p in pieces])
    # Between the ends of a piece the parabola may be nearer to the rate than at them.
    within = np.linspace(0.0, 1.0, 6)
    at = now[:, None] + part[:, None] * within
    rate = side[:, None] * (slip[:, None] + (part[:, None] * within)[..., None] * change[:, None])
    rate /= (6.0 * at * (1.0 - at) + 1e-2)[..., None]
    least: Array = rate.min(axis=(0, 1))
    return least


def _motion(here: SlipRates, change: SlipRates, side: Array, tolerance: float) -> _Motion | None:
    """Rates from a given load factor on; None where no consistent ones were found.

    A complementarity problem of the rates: a hole at its bound keeps slipping in its direction, or begins to stick with
    its mobilisation leaving the bound. Block principal pivoting as in `tdcr_fe.elements.complementarity.solve_box`.
    """
    matrix, load, count = here.matrix, here.by_load, len(side)
    active = side
    best, patience = count + 1, 3
    for _ in range(30 + 10 * count):
        inside = np.flatnonzero(active == 0.0)
        rate, slip = np.zeros(count), load
        if inside.size:
            lu, pivots, found, singular = dgesv(
                matrix[inside[:, None], inside], load[inside], overwrite_a=True
            )
            if singular:
                return None
            rate[inside] = found
            slip = load - matrix.take(inside, axis=1) @ found
        outward = (side * rate * np.diagonal(matrix) > tolerance) & (active == 0.0)
        broken = outward | (active * slip < -tolerance)
        number = int(np.count_nonzero(broken))
        if number == 0:
            break
        if number < best:
            best, patience = number, 3
        elif patience > 0:
            patience -= 1
        else:
            first = np.flatnonzero(broken)[0]
            broken = np.zeros(count, dtype=bool)
            broken[first] = True
        active = np.where(broken, np.where(outward, side, 0.0), active)
    else:
        return None
    rate_change, slip_change = np.zeros(count), change.by_load
    if inside.size:
        slip_change = slip_change - change.matrix.take(inside, axis=1) @ found
        rate_change[inside] = more = dgetrs(lu, pivots, slip_change[inside])[0]
        slip_change = slip_change - matrix.take(inside, axis=1) @ more
    return _Motion(active, rate, rate_change, slip, slip_change)


def _next_event(motion: _Motion, mobilisation: Array, sticks: Flags, tolerance: float) -> float:
    """Distance to where a sticking hole begins to slip, or the slip at another one reverses."""
    first = np.inf
    held = np.flatnonzero(sticks)
    if held.size:
        s, a, b = mobilisation[held], motion.mobilisation[held], 2.0 * motion.mobilisation_change[held]
        # s + a h + b h^2 / 4 = 1 or -1, the root at which the bound is crossed outward.
        for gap, pace, bend in ((1.0 - s, a, b), (1.0 + s, -a, -b)):
            inner = pace * pace + bend * gap
            speed = pace + np.sqrt(np.maximum(inner, 0.0))
            ahead = (inner >= 0.0) & (speed > 0.0)
            if ahead.any():
                first = min(first, float((2.0 * gap[ahead] / speed[ahead]).min()))
    if held.size < len(sticks):
        rate, fall = motion.side * motion.slip, -motion.side * motion.slip_change
        falls = fall > 0.0
        if falls.any():
            first = min(first, float((np.maximum(rate[falls] + tolerance, 0.0) / fall[falls]).min()))
    return first
