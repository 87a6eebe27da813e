"""Which slips reverse within a substep: the friction states followed through the linearised equilibrium.

A mobilisation is an elastic-plastic function of the slip at its hole. A substep solved as a whole is exact where every
slip is monotone: changes from stick to slip cost nothing. Only a slip that reverses within the substep makes the result
depend on how it was reached: the mobilisation then counts from the slip where it turned, not from that at the start.

With the configuration eliminated, the slips are a smooth function of load factor, mobilisations and tensions at the
base, known from both ends of a substep (`tdcr_fe.solve.friction_path.slip_model`). The friction states are followed
through it from event to event, which gives every turning point. Tendons driven by displacement that become slack or
taut are events of the same kind: their tensions are unknowns too. Derivation: documentation, page "Theory".
"""

from __future__ import annotations

from bisect import bisect_right
from math import isfinite
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgesv

from tdcr_fe.solve.friction_path.slip_model import SlipState
from tdcr_fe.solve.friction_path.slip_rates import (
    Bounds,
    Motion,
    Rates,
    distance_to_bound,
    distance_to_closing,
    distance_to_curved_bound,
    distance_to_reversal,
    solve_rates,
)

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Index = NDArray[np.int_]

#: Largest part of a substep over which slip rates are taken as linear in the load factor; and where that changes slips
#: by less than `LATE` [1].
LONGEST, LONGEST_SMOOTH = 0.12, 0.5
#: Over shorter parts slip rates are taken as constant [1].
STRAIGHT = 0.02
#: Change of the tensions, over the largest, up to which derivatives of the slips are used again [1].
KEPT = 0.02
#: Part of these two with which derivatives still show that a slip reverses [1].
DECISIVE = 0.25
#: Shortest part, which resolves events that follow each other [1].
SHORTEST = 1e-5
#: Over how much of the longest part, and over which largest change of a mobilisation, slopes of rates are taken [1].
SLOPE_PART, SLOPE_CHANGE = 0.5, 0.5
#: Slip beyond a reversal that was not foreseen, as a fraction of the presliding distance, which is left as it is [1].
LATE = 1e-4
#: By which fraction of itself a part is shortened at most where a reversal was not foreseen [1], and how often.
MOST_SHORTENED, MOST_SHORTENINGS = 0.75, 4
#: Slip rates below this fraction of the presliding distance per substep are zero [1].
RATE_TOLERANCE = 1e-4
#: Distance from a bound that counts as none, over the size of the unknown [1].
NEAR_BOUND = 1e-12
#: Upper bound of tensions, beyond all that occur [N].
UNBOUNDED = 1e100
_NONE: Index = np.zeros(0, dtype=int)


class Slips(Protocol):
    """Slips as functions of load factor, mobilisations and tensions, as in `slip_model.SlipModel`."""

    @property
    def presliding(self) -> float:
        """Presliding distance [m]."""
        ...

    @property
    def ends(self) -> tuple[float, ...]:
        """Load factors up to which the slips are smooth, ascending; the last one is 1 [1]."""
        ...

    @property
    def cubic(self) -> float:
        """Largest coefficient of the cube of the load factor in the slips [m]."""
        ...

    def at(self, factor: float, z: Array, tension: Array) -> SlipState:
        """Slips and derivatives at a load factor."""
        ...

    def branches(self, z: Array, tension: Array) -> Flags | None:
        """Flags that change where the derivatives of the tensions jump; None where they never do."""
        ...

    def distance_to_jump(self, z: Array, rate: Array, tension: Array, tension_rate: Array) -> float:
        """Part of the substep to where they change, at constant rates [1]."""
        ...

    def rates(self, factor: float, z: Array, tension: Array, rate: Array, near: SlipState) -> Array | None:
        """Rates of the excess of the slips, and of minus the slack, at given rates of ``z``; None where they jump."""
        ...


class FollowedPath(NamedTuple):
    """Friction states at the end of a substep, and where slips reversed.

    Attributes
    ----------
    mobilisation : ndarray, shape (k + c,)
        At its end [1], and the unknown tensions at the base [N].
    turning_slip : ndarray, shape (k,)
        Change of the slip up to the last reversal; zero where there is none [m].
    turning_mobilisation : ndarray, shape (k,)
        Mobilisation there: 1 or -1; that at the start where there is none [1].
    turning_factor : ndarray, shape (k,)
        Fraction of the substep at the last reversal; zero where there is none [1].
    complete : bool
        Whether the end of the substep was reached.
    pieces : tuple of Piece
        The path, part by part.
    bounds : Bounds
        Of the unknowns.
    """

    mobilisation: Array
    turning_slip: Array
    turning_mobilisation: Array
    turning_factor: Array
    complete: bool
    pieces: tuple[Piece, ...]
    bounds: Bounds

    @property
    def reversed(self) -> Flags:
        """Which slips reversed, shape (k,)."""
        return self.turning_factor > 0.0

    def at(self, factor: float) -> tuple[Array, Array]:
        """Mobilisations and unknown tensions at the base, and tensions of the segments, at a load factor."""
        piece = self.pieces[bisect_right(self.pieces, factor, key=lambda p: p.now) - 1]
        _, z, tension = piece.end(factor - piece.now, self.bounds)
        return z, tension

    def certain(self, error: Array, presliding: float) -> Flags:
        """Holes whose mobilisation at the end is the same with other slips, shape (k,).

        They slip up to the end in one direction, faster than the error changes, all the time or over a distance that
        leaves nothing of their history.

        Parameters
        ----------
        error
            Error of the change of the slips; its rate is that times ``6 x (1 - x)``, with the fraction ``x`` of the
            substep [m], shape (k,).
        presliding
            Presliding distance [m].
        """
        k = len(error)
        now, part = np.array([(p.now, p.part) for p in self.pieces]).T
        side = np.array([p.motion.side[:k] for p in self.pieces])
        rate = np.array([p.motion.excess[:k] for p in self.pieces])
        change = np.array([p.motion.excess_change[:k] for p in self.pieces])
        last = side[-1]
        final = np.logical_and.accumulate((side == last)[::-1])[::-1]
        slip = part[:, None] * (rate + (0.5 * part)[:, None] * change)
        distance = last * np.where(final, slip, 0.0).sum(axis=0)
        # Between the ends of a piece the parabola may be nearer to the rate than at them.
        within = part[:, None] * np.linspace(0.0, 1.0, 6)
        at = now[:, None] + within
        pace = last * (rate[:, None] + within[..., None] * change[:, None])
        pace /= (6.0 * at * (1.0 - at) + 1e-2)[..., None]
        slowest = np.where(final[:, None], pace, np.inf).min(axis=(0, 1))
        forgotten = final[0] | (distance >= 2.0 * presliding + error)
        return np.asarray((last != 0.0) & (slowest >= error) & forgotten)


class _Evaluated(NamedTuple):
    """Where the derivatives of the slips were evaluated.

    Attributes
    ----------
    factor : float
        Load factor [1].
    tension : ndarray, shape (q,)
        Of the segments [N].
    largest : float
        Tension [N].
    """

    factor: float
    tension: Array
    largest: float

    @classmethod
    def at(cls, factor: float, tension: Array) -> _Evaluated:
        """At a load factor and tensions."""
        return cls(factor, tension, float(tension.max()))

    def serves(self, factor: float, tension: Array, share: float = 1.0) -> bool:
        """Whether the derivatives serve at another load factor and other tensions, within a part of the limits."""
        if factor - self.factor > share * STRAIGHT:
            return False
        return float(np.abs(tension - self.tension).max()) <= share * KEPT * self.largest


class _Trial(NamedTuple):
    """Unknowns inside their bounds at the end of a piece as they would be without bounds, shapes (i,)."""

    free: Index
    z: Array


class Piece(NamedTuple):
    """A part of the substep over which the rates of all unknowns are linear in the load factor.

    Attributes
    ----------
    now, part : float
        Where it begins, and how long it is [1].
    z : ndarray, shape (k + c,)
        Unknowns where it begins.
    motion : Motion
        Their rates.
    tension, tension_rate : ndarray, shape (q,)
        Of the segments [N].
    """

    now: float
    part: float
    z: Array
    motion: Motion
    tension: Array
    tension_rate: Array

    def shortened(self, share: float) -> Piece:
        """A fraction of it, from its beginning on."""
        return self._replace(part=share * self.part)

    def end(self, part: float, bounds: Bounds) -> tuple[float, Array, Array]:
        """Load factor, unknowns, and tensions of the segments after a part of it."""
        moved = part * self.motion.rate + (0.5 * part * part) * self.motion.rate_change
        z = np.minimum(np.maximum(self.z + moved, bounds.lower), bounds.upper)
        return self.now + part, z, self.tension + part * self.tension_rate


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def follow(slips: Slips, mobilisation: Array, base_tension: Array, tension: Array) -> FollowedPath:
    """Follow the friction states through a substep.

    Parameters
    ----------
    slips
        In the substep.
    mobilisation
        At its start, shape (k,).
    base_tension
        Those unknown tensions at the base there [N], shape (c,).
    tension
        Of the segments there [N], shape (q,).
    """
    path = _Unknowns.of(slips, mobilisation, base_tension, tension)
    k, z, bounds = path.holes, np.append(mobilisation, base_tension), path.bounds
    now, pieces, shortened = 0.0, list[Piece](), 0
    stuck = _Stuck(path)
    turning = _Turning(np.zeros(k), mobilisation.copy(), np.zeros(k))
    ends, longest = [*slips.ends], _longest(slips)
    start, state = np.zeros(0), None
    evaluated, trial = _Evaluated.at(now, tension), None
    for _ in range(50 + 6 * len(z)):
        if state is None:
            state = slips.at(now, z, tension)
            tension, start = state.tension, start if start.size else state.slip
            evaluated = _Evaluated.at(now, tension)
            z, state, trial = stuck.corrected(z, state)
        side = bounds.side(z)
        slack = np.maximum(-state.slip[k:], 0.0)
        rates = solve_rates(
            state.columns, state.by_load, side, path.held_by(slack), path.scale, path.tolerance
        )
        # Where the interpolation leads far from both ends, numbers may overflow: the path is then not complete.
        if rates is None or not isfinite(rates.excess @ rates.excess):
            break
        free = rates.side == 0.0
        turned = _NONE if rates.side is side else (free & (side != 0.0))[:k].nonzero()[0]
        if turned.size and not evaluated.serves(now, tension, DECISIVE):
            state = None
            continue
        if turned.size and pieces and shortened < MOST_SHORTENINGS:
            share = _reached(pieces[-1], turned, side, state, trial, bounds, LATE * path.presliding)
            if share < 1.0:
                pieces[-1] = pieces[-1].shortened(share)
                now, z, tension = pieces[-1].end(pieces[-1].part, bounds)
                state, shortened = None, shortened + 1
                continue
        shortened = 0
        stuck.hold(free, z, state)
        if turned.size:
            turning.set(turned, state.slip[turned] - start[turned], side[turned], now)
        if now >= ends[0] - 1e-12:
            del ends[0]
        if not ends:
            break
        piece, curved = _next_piece(slips, path, now, ends[0], longest, z, state, rates, slack)
        if piece is None:
            break
        pieces.append(piece)
        now, z, tension = piece.end(piece.part, bounds)
        ended = curved or now >= ends[0] - 1e-12
        if ended or not evaluated.serves(now, tension) or state.jumps_to(slips.branches(z, tension)):
            state = None
        else:
            state, trial = state.ahead(piece.part, tension, rates.rate, rates.excess), None
    return FollowedPath(z, *turning, not ends, tuple(pieces), bounds)


class _Unknowns(NamedTuple):
    """What is the same all along a path.

    Attributes
    ----------
    holes : int
        Number of mobilisations; tensions at the base follow.
    presliding : float
        Presliding distance [m].
    tolerance : float
        Slip rates below it are zero [m].
    bounds : Bounds
    stiffness : ndarray, shape (n,)
        Presliding distance at holes, zero for tensions [m].
    scale : ndarray, shape (n,)
        From the unknowns to lengths [m, m/N].
    """

    holes: int
    presliding: float
    tolerance: float
    bounds: Bounds
    stiffness: Array
    scale: Array

    @classmethod
    def of(cls, slips: Slips, mobilisation: Array, base_tension: Array, tension: Array) -> _Unknowns:
        """Of a substep; arguments as of `follow`."""
        k, presliding = len(mobilisation), slips.presliding
        own = np.full(k, presliding)
        tensions = np.full(len(base_tension), presliding / max(1e-3, float(tension.max())))
        return cls(
            k,
            presliding,
            RATE_TOLERANCE * presliding,
            _bounds(k, base_tension),
            np.append(own, np.zeros(len(base_tension))),
            np.append(own, tensions),
        )

    def held_by(self, slack: Array) -> Flags | None:
        """Which unknowns cannot leave their bounds because their tendon has slack, see `solve_rates`."""
        if not slack.size:
            return None
        return np.append(np.zeros(self.holes, dtype=bool), slack > self.tolerance)


class _Turning(NamedTuple):
    """Where slips reversed last, see `FollowedPath`; the arrays are filled on the way."""

    slip: Array
    mobilisation: Array
    factor: Array

    def set(self, which: Index, slip: Array, mobilisation: Array, factor: float) -> None:
        """Slips of some holes reverse at a load factor; changes the arrays."""
        self.slip[which], self.mobilisation[which], self.factor[which] = slip, mobilisation, factor


class _Stuck:
    """Unknowns inside their bounds along a path; the excess of their slips stays what it was where they came there.

    Parameters
    ----------
    path
        What is the same all along it.
    """

    def __init__(self, path: _Unknowns) -> None:
        count = len(path.scale)
        self._path, self._excess = path, np.zeros(count)
        self._free: Flags = np.zeros(count, dtype=bool)
        #: What came to its bound too early the last time.
        self._returned: Flags = np.zeros(count, dtype=bool)

    def hold(self, free: Flags, z: Array, state: SlipState) -> None:
        """Which unknowns are inside their bounds from a state on."""
        new = (free > self._free).nonzero()[0]
        if new.size:
            self._excess[new] = state.slip[new] - self._path.stiffness[new] * z[new]
            self._excess[self._path.holes :] = 0.0
        self._free = free

    def corrected(self, z: Array, state: SlipState) -> tuple[Array, SlipState, _Trial | None]:
        """Unknowns with which the excess is kept, the state there, and the unknowns as they would be without bounds.

        What has come to its bound too early is moved back once: else its way there might never end.
        """
        inside, path = self._free.nonzero()[0], self._path
        if not inside.size:
            return z, state, None
        change = _correction(z, state, inside, self._excess, path.stiffness)
        trial = _Trial(inside, z[inside] + change)
        at_bound = path.bounds.side(z)[inside] != 0.0
        change[at_bound & self._returned[inside]] = 0.0
        self._returned[inside] = at_bound
        z, state = _changed(z, state, inside, change, path.bounds)
        return z, state, trial


def _next_piece(
    slips: Slips,
    path: _Unknowns,
    now: float,
    stop: float,
    longest: float,
    z: Array,
    state: SlipState,
    rates: Rates,
    slack: Array,
) -> tuple[Piece | None, bool]:
    """The path up to the next event, None where numbers overflow; and whether rates change within it.

    Parameters
    ----------
    slips, path
        In the substep.
    now, stop
        Load factor, and the one up to which the slips are smooth [1].
    longest
        See `_longest`.
    z
        Unknowns, shape (n,).
    state
        Slips there.
    rates
        Of the unknowns.
    slack
        Of tendons [m], shape (c,).
    """
    event = distance_to_bound(rates, z, path.bounds)
    curved, most = event > STRAIGHT, longest
    tension_rate = state.tension_rates(rates.free, rates.rate)
    slope = _slope(slips, now, stop, z, state, rates, tension_rate, path.holes) if curved else None
    if curved and slope is None:
        curved, most = False, STRAIGHT
    motion = rates.motion(slope)
    if slope is not None:
        if not isfinite(slope @ slope):
            return None, curved
        event = min(
            distance_to_curved_bound(motion, rates.free, z, path.bounds),
            distance_to_reversal(motion, path.tolerance, path.holes),
        )
    if slack.size:
        event = min(event, distance_to_closing(motion, slack, path.holes))
    event = min(event, slips.distance_to_jump(z, motion.rate, state.tension, tension_rate))
    part = min(stop - now, most, max(SHORTEST, event))
    return Piece(now, part, z, motion, state.tension, tension_rate), curved


def _longest(slips: Slips) -> float:
    """Largest part of a substep over which slip rates are taken as linear in the load factor [1]."""
    smooth = float(np.cbrt(LATE * slips.presliding / max(slips.cubic, 1e-300)))
    return min(LONGEST_SMOOTH, max(LONGEST, smooth))


def _reached(
    piece: Piece,
    turned: Index,
    side: Array,
    state: SlipState,
    trial: _Trial | None,
    bounds: Bounds,
    loss: float,
) -> float:
    """Up to which fraction of a part the slips have kept their direction; 1 where less slip than ``loss`` is lost.

    Parameters
    ----------
    piece
        The part.
    turned
        Holes that have turned at its end.
    side
        At which bounds the unknowns are.
    state
        Slips at its end.
    trial
        Unknowns there; None where their derivatives are not new. Slips turn where one comes to its bound.
    bounds
        Of the unknowns.
    loss
        Slip after the reversal that makes no difference [m].
    """
    # The rates just before its end, where nothing had turned or come to a bound.
    free, rate = (piece.motion.side == 0.0).nonzero()[0], state.by_load
    if free.size:
        own = state.columns(free)
        rate = rate - own @ dgesv(own[free], rate[free])[2]
    excess = piece.motion.excess[turned]
    before = np.maximum(side[turned] * excess, 0.0)
    after = np.maximum(-side[turned] * rate[turned], 0.0)
    beyond = after / np.maximum(before + after, 1e-300)
    late = 0.5 * after * beyond * piece.part > loss
    # Unknowns that only came to their bound at the end have no rate before it.
    late &= piece.motion.side[turned] != 0.0
    share = 1.0 - float(beyond[late].max(initial=0.0))
    within = 1.0 if trial is None else _inside(piece, trial, bounds)
    if (1.0 - within) * piece.part * float(np.abs(excess).max()) > loss:
        share = min(share, within)
    return max(share, 1.0 - MOST_SHORTENED)


def _slope(
    slips: Slips,
    now: float,
    stop: float,
    z: Array,
    state: SlipState,
    rates: Rates,
    tension_rate: Array,
    holes: int,
) -> Array | None:
    """Derivative of the rates of slips and slack at constant rates of the unknowns; None where they jump."""
    fastest = float(np.abs(rates.rate[:holes]).max(initial=0.0))
    part = min(SLOPE_PART * LONGEST, stop - now, SLOPE_CHANGE / max(fastest, SLOPE_CHANGE))
    tension = state.tension + part * tension_rate
    ahead = slips.rates(now + part, z + part * rates.rate, tension, rates.rate, state)
    return None if ahead is None else np.asarray((ahead - rates.excess) / part)


def _correction(z: Array, state: SlipState, free: Index, excess: Array, stiffness: Array) -> Array:
    """Change of free unknowns that takes away what has accumulated of errors: they keep the excess of their slips."""
    off = state.slip[free] - stiffness[free] * z[free] - excess[free]
    return np.asarray(dgesv(state.columns(free)[free], off)[2])


def _inside(piece: Piece, trial: _Trial, bounds: Bounds) -> float:
    """Up to which fraction of a part all unknowns were inside their bounds that are so at its end, or were."""
    free, start = trial.free, piece.z[trial.free]
    moved = trial.z - start
    room = np.where(moved > 0.0, bounds.upper[free] - start, bounds.lower[free] - start)
    share = np.divide(room, moved, out=np.ones(len(free)), where=np.abs(moved) > np.abs(room))
    return float(share.min())


def _changed(
    z: Array, state: SlipState, which: Index, change: Array, bounds: Bounds
) -> tuple[Array, SlipState]:
    """Some of the unknowns changed within their bounds, and the state there."""
    new = z.copy()
    new[which] = np.minimum(np.maximum(z[which] + change, bounds.lower[which]), bounds.upper[which])
    return new, state.beside(which, new[which] - z[which])


def _bounds(holes: int, base_tension: Array) -> Bounds:
    """Bounds of the mobilisations, then those of the tensions."""
    one, count = np.ones(holes), len(base_tension)
    near = np.full(count, NEAR_BOUND * max(1.0, float(base_tension.max(initial=0.0))))
    return Bounds.of(
        np.append(-one, np.zeros(count)),
        np.append(one, np.full(count, UNBOUNDED)),
        np.append(np.full(holes, NEAR_BOUND), near),
    )
