"""Which slips reverse within a substep: the friction states followed through the linearised equilibrium.

A mobilisation is an elastic-plastic function of the slip at its hole. A substep solved as a whole is exact where every
slip is monotone: changes from stick to slip cost nothing. Only a slip that reverses within the substep makes the result
depend on how it was reached: the mobilisation then counts from the slip where it turned, not from that at the start.

With the configuration eliminated, the slips are a smooth function of load factor and mobilisations. Its derivatives
are known at both ends of a substep (a few right sides with factors that are at hand), so it is interpolated between
them, and the friction states are followed through the interpolant from event to event. This gives every turning point.
Tendons driven by displacement that become slack or taut are events of the same kind: their tensions join the unknowns.
Derivation: documentation, page "Theory".
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.solve.slip_rates import (
    Bounds,
    Motion,
    distance_to_bound,
    distance_to_closing,
    distance_to_reversal,
    solve_rates,
)

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: Largest part of a substep over which slip rates are taken as linear in the load factor [1].
LONGEST = 0.2
#: Shortest part, which resolves events that follow each other [1].
SHORTEST = 1e-5
#: Slip rates below this fraction of the presliding distance per substep are zero [1].
RATE_TOLERANCE = 1e-4
#: Distance from a bound that counts as none, over the size of the unknown [1].
NEAR_BOUND = 1e-12
#: Upper bound of tensions, beyond all that occur [N].
UNBOUNDED = 1e100


class SlipRates(NamedTuple):
    """Derivatives of the slips at one end of a substep; with tendons that become slack or taut, of their slack too.

    Attributes
    ----------
    by_load : ndarray, shape (k + c,)
        Slips, and minus the slack of the tendons, by the load factor at fixed mobilisations and tensions of these
        tendons, times the length of the substep [m].
    matrix : ndarray, shape (k + c, k + c)
        Presliding distance times identity for the slips, minus the derivatives by the mobilisations [m] and tensions
        [m/N].
    """

    by_load: Array
    matrix: Array


class ChangingTendons(NamedTuple):
    """Tendons with prescribed displacement that are taut at one end of a substep and slack at the other.

    Attributes
    ----------
    owner : ndarray of int, shape (k,)
        By hole, the number of its tendon among them; -1 where it is none of them.
    tension : ndarray, shape (2, c)
        At the base, at both ends of the substep [N].
    mobilisation : ndarray, shape (2, k)
        At both ends [1].
    slack : ndarray, shape (c,)
        Length that is let out beyond what the tendon needs, at the start [m].
    """

    owner: NDArray[np.int_]
    tension: Array
    mobilisation: Array
    slack: Array


class FollowedPath(NamedTuple):
    """Friction states at the end of a substep, and where slips reversed.

    Attributes
    ----------
    slip : ndarray, shape (k + c,)
        Change of the slips, and minus that of the slack, within the substep [m].
    mobilisation : ndarray, shape (k + c,)
        At its end [1], and the tensions [N].
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


class _Interpolant:
    """Derivatives between the ends of a substep: linear in the load factor, and bilinear in tensions and mobilisations.

    The derivatives by the mobilisations of a tendon's holes are proportional to its tension. Arguments as in `follow`.
    """

    def __init__(
        self,
        start: SlipRates,
        end: SlipRates,
        presliding: float,
        bulge: Array | None,
        tendons: ChangingTendons | None,
    ) -> None:
        self.load, self.matrix = start.by_load, start.matrix
        self.load_change, self.bulge, self.holes = end.by_load - start.by_load, bulge, len(start.by_load)
        if tendons is None or not tendons.slack.size:
            self.per_tension = None
            self.matrix_change = end.matrix - start.matrix
            return
        self.holes = len(tendons.owner)
        self.coupled = np.flatnonzero(tendons.owner >= 0)
        self.own = tendons.owner[self.coupled]
        self.belongs = (self.own[:, None] == np.arange(tendons.slack.size)).astype(float)
        ends = []
        for rates in (start, end):
            matrix = rates.matrix.copy()
            matrix[:, self.coupled] = 0.0
            matrix[self.coupled, self.coupled] = presliding
            ends.append(matrix)
        per_tension = []
        for rates, fixed, tension in zip((start, end), ends, tendons.tension[:, self.own], strict=True):
            by_mobilisation = rates.matrix[:, self.coupled] - fixed[:, self.coupled]
            per_tension.append(by_mobilisation / np.where(tension > 0.0, tension, np.inf))
        first, last = tendons.tension[:, self.own] > 0.0
        # Derivatives by the mobilisations of the holes of these tendons, per tension; known at an end where it is taut.
        self.per_tension = np.where(first, *per_tension)
        self.per_tension_change = np.where(last, per_tension[1], per_tension[0]) - self.per_tension
        self.mobilisation = tendons.mobilisation[0, self.coupled]
        self.mobilisation_change = tendons.mobilisation[1, self.coupled] - self.mobilisation
        self.matrix, self.matrix_change = ends[0], ends[1] - ends[0]

    def at(self, factor: float, z: Array) -> tuple[Array, Array]:
        """Derivatives by the load factor and by the unknowns, as in `SlipRates`."""
        load = self.load + factor * self.load_change
        matrix = self.matrix + factor * self.matrix_change
        if self.bulge is not None:
            load += (6.0 * factor * (1.0 - factor)) * self.bulge
        if self.per_tension is not None:
            per_tension = self.per_tension + factor * self.per_tension_change
            beyond = z[self.coupled] - self.mobilisation - factor * self.mobilisation_change
            matrix[:, self.coupled] += per_tension * z[self.holes + self.own]
            matrix[:, self.holes :] += (per_tension * beyond) @ self.belongs
        return load, matrix

    def slope(self, factor: float, z: Array, rate: Array) -> Array:
        """Derivative of the rates of slips and slack at constant rates of the unknowns."""
        slope = self.load_change - self.matrix_change @ rate
        if self.bulge is not None:
            middle = min(1.0, factor + 0.5 * LONGEST)
            slope += (6.0 - 12.0 * middle) * self.bulge
        if self.per_tension is not None:
            tension, pulled = z[self.holes + self.own], rate[self.holes + self.own]
            slipped, change = rate[self.coupled], self.mobilisation_change
            beyond = z[self.coupled] - self.mobilisation - factor * change
            slope -= self.per_tension_change @ (tension * slipped + beyond * pulled)
            per_tension = self.per_tension + factor * self.per_tension_change
            slope -= per_tension @ (pulled * (2.0 * slipped - change))
        return slope


def follow(
    start: SlipRates,
    end: SlipRates,
    mobilisation: Array,
    presliding: float,
    bulge: Array | None = None,
    tendons: ChangingTendons | None = None,
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
        Change of the slips, and minus the slack, within the substep beyond that of derivatives that are linear in the
        load factor, at fixed mobilisations [m], shape (k + c,). Its rate is a parabola that vanishes at both ends.
    tendons
        Those that become slack or taut; None where there are none.
    """
    between = _Interpolant(start, end, presliding, bulge, tendons)
    k, count = len(mobilisation), len(start.by_load)
    z, stiffness, bounds, slack = mobilisation, np.full(count, presliding), _mobilisation_bounds(k), None
    if tendons is not None and tendons.slack.size:
        z, bounds, slack = np.append(z, tendons.tension[0]), _with_tensions(bounds, tendons), tendons.slack
        stiffness[k:] = 0.0
    tolerance = RATE_TOLERANCE * presliding
    side, open_, now, u = bounds.side(z), _open(slack, k, tolerance), 0.0, np.zeros(count)
    turning_slip, turning_factor, turning_mobilisation = np.zeros(k), np.zeros(k), mobilisation.copy()
    pieces: list[tuple[float, float, Motion]] = []
    complete = False
    for _ in range(50 + 4 * count):
        load, matrix = between.at(now, z)
        rates = solve_rates(matrix, load, side, open_, tolerance)
        if rates is None:
            break
        motion = rates.motion(between.slope(now, z, rates.rate))
        sticks = motion.side == 0.0
        turned = (sticks & (side != 0.0))[:k].nonzero()[0]
        if turned.size:
            turning_slip[turned], turning_factor[turned] = u[turned], now
            turning_mobilisation[turned] = side[turned]
        event = min(distance_to_bound(motion, z, bounds), distance_to_reversal(motion, tolerance, k))
        if slack is not None:
            event = min(event, distance_to_closing(motion, slack, k))
        part = min(1.0 - now, LONGEST, max(SHORTEST, event))
        pieces.append((now, part, motion))
        half = 0.5 * part * part
        moved = part * motion.rate + half * motion.rate_change
        slipped = part * motion.excess + half * motion.excess_change
        z = np.minimum(np.maximum(z + moved, bounds.lower), bounds.upper)
        u = u + np.where(sticks, stiffness * moved, slipped)
        side = bounds.side(z)
        if slack is not None and tendons is not None:
            slack = np.maximum(tendons.slack - u[k:], 0.0)
            open_ = _open(slack, k, tolerance)
        now += part
        if now >= 1.0 - 1e-12:
            complete = True
            break
    throughout = all(bool(np.all(motion.side[:k] != 0.0)) for _, _, motion in pieces)
    margin = _margin(pieces, k) if throughout else np.full(k, -np.inf)
    return FollowedPath(u, z, turning_slip, turning_mobilisation, turning_factor, complete, margin)


def _mobilisation_bounds(count: int) -> Bounds:
    one = np.ones(count)
    return Bounds(-one, one, np.full(count, NEAR_BOUND))


def _with_tensions(bounds: Bounds, tendons: ChangingTendons) -> Bounds:
    """Bounds of the mobilisations, then those of the tensions."""
    near = NEAR_BOUND * tendons.tension.max(axis=0)
    return Bounds(
        np.append(bounds.lower, np.zeros(tendons.slack.size)),
        np.append(bounds.upper, np.full(tendons.slack.size, UNBOUNDED)),
        np.append(bounds.near, near),
    )


def _open(slack: Array | None, holes: int, tolerance: float) -> Flags | None:
    """Which unknowns are tensions of tendons with slack, shape (k + c,)."""
    return None if slack is None else np.append(np.zeros(holes, dtype=bool), slack > tolerance)


def _margin(pieces: list[tuple[float, float, Motion]], holes: int) -> Array:
    """See `FollowedPath.margin`."""
    now, part = np.array([p[:2] for p in pieces]).T
    side = np.array([p[2].side[:holes] for p in pieces])
    slip = np.array([p[2].excess[:holes] for p in pieces])
    change = np.array([p[2].excess_change[:holes] for p in pieces])
    # Between the ends of a piece the parabola may be nearer to the rate than at them.
    within = np.linspace(0.0, 1.0, 6)
    at = now[:, None] + part[:, None] * within
    rate = side[:, None] * (slip[:, None] + (part[:, None] * within)[..., None] * change[:, None])
    rate /= (6.0 * at * (1.0 - at) + 1e-2)[..., None]
    least: Array = rate.min(axis=(0, 1))
    return least
