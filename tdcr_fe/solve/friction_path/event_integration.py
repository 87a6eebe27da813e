"""The friction states followed through a substep, from event to event, which shows where slips reverse.

A mobilisation is an elastic-plastic function of the slip at its hole. A substep solved as a whole is exact where every
slip is monotone: changes from stick to slip cost nothing. Only a slip that reverses within the substep makes the result
depend on how it was reached: the mobilisation then counts from the slip where it reversed, not from that at the start.

The slips are known as functions of load factor, mobilisations and tensions at the base (`slip_model`). Their rates are
integrated piece by piece. A piece ends at an event: a hole begins to slip, its slip reverses, a tendon driven by
displacement becomes slack or taut; or where the rates are no longer linear. Documentation: page "Theory", section
"Finding reversals", which also has a table of what the constants below change.
"""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgesv

from tdcr_fe.elements.numbers import largest, largest_magnitude
from tdcr_fe.solve.friction_path.drift_correction import DriftCorrection, Unclipped
from tdcr_fe.solve.friction_path.path import FrictionPath, Piece
from tdcr_fe.solve.friction_path.slip_rates import (
    Rates,
    distance_to_bound,
    distance_to_curved_bound,
    distance_to_reversal,
    distance_to_tautness,
    rows_of,
    solve_rates,
)
from tdcr_fe.solve.friction_path.slip_state import SlipState
from tdcr_fe.solve.friction_path.unknowns import PathUnknowns

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Index = NDArray[np.int_]

#: Longest piece, over which rates are taken as linear in the load factor; and the longest where the cubes of the load
#: factor in the slips are below `OVERSHOOT` of the presliding distance [1].
LONGEST_PIECE, LONGEST_SMOOTH_PIECE = 0.12, 0.5
#: Where the next event is nearer than this, rates are taken as constant up to it [1].
CONSTANT_RATES_PIECE = 0.02
#: Derivatives of the slips are used again up to this change of the tensions, over the largest [1], and up to a change
#: of the load factor of `CONSTANT_RATES_PIECE`.
REUSED_TENSION_CHANGE = 0.02
#: Fraction of these two limits within which derivatives may still show that a slip reverses [1]. With all of them, the
#: largest error of twenty random robots was twice as large (documentation, page "Theory").
REUSED_FOR_REVERSAL = 0.25
#: Shortest piece: events nearer to each other are taken one after the other over it [1].
SHORTEST_PIECE = 1e-5
#: Derivatives of the rates are differences over this fraction of the longest piece, or over the piece in which a
#: mobilisation changes by so much, if that is shorter [1].
SLOPE_PIECE, SLOPE_CHANGE = 0.5, 0.5
#: Slip beyond a reversal that was not foreseen, over the presliding distance, which is left as it is; where it is more,
#: the piece is shortened [1].
OVERSHOOT = 1e-4
#: By which fraction of itself a piece is shortened at most at once [1], and how often in succession.
MOST_SHORTENED, MOST_SHORTENINGS = 0.75, 4
#: Round-off of load factors [1].
ROUND_OFF = 1e-12
_NONE: Index = np.zeros(0, dtype=int)


class Slips(Protocol):
    """Slips as functions of load factor, mobilisations and tensions, as in `slip_model.SlipModel`."""

    @property
    def presliding(self) -> float:
        """Presliding distance [m]."""
        ...

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Load factors up to which the slips are smooth, ascending; the last one is 1 [1]."""
        ...

    @property
    def cubic_coefficient(self) -> float:
        """Largest coefficient of the cube of the load factor in the slips [m]."""
        ...

    def at(self, factor: float, z: Array, tension: Array) -> SlipState:
        """Slips and derivatives at a load factor, unknowns, and about these tensions of the segments."""
        ...

    def regimes(self, z: Array, tension: Array) -> Flags | None:
        """Flags that change where the derivatives of the tensions jump; None where they never do."""
        ...

    def distance_to_regime_change(self, z: Array, rate: Array, tension: Array, tension_rate: Array) -> float:
        """Load factor from here to where these flags change at constant rates [1]."""
        ...

    def complement_rates(
        self, factor: float, z: Array, tension: Array, rate: Array, near: SlipState
    ) -> Array | None:
        """Rates of the complements at given rates of the unknowns [m]; None where derivatives have jumped."""
        ...


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def follow_friction(slips: Slips, mobilisation: Array, base_tension: Array, tension: Array) -> FrictionPath:
    """Follow the friction states through a substep.

    Parameters
    ----------
    slips
        In the substep.
    mobilisation
        Of the frictional holes at its start [1], shape (k,).
    base_tension
        Tensions at the base there of tendons driven by displacement [N], shape (c,).
    tension
        Of the segments there [N], shape (q,).
    """
    run = _Integration(slips, mobilisation, base_tension, tension)
    for _ in range(50 + 6 * len(run.z)):
        rates = run.rates()
        if rates is None:
            break
        if run.is_moved_back(rates):
            continue
        run.take_events(rates)
        if run.at_end or not run.advance(rates):
            break
    return run.path()


class _Evaluation(NamedTuple):
    """Where the derivatives of the slips were evaluated.

    Attributes
    ----------
    factor : float
        Load factor [1].
    tension : ndarray, shape (q,)
        Of the segments [N].
    largest : float
        Largest tension [N].
    """

    factor: float
    tension: Array
    largest: float

    @classmethod
    def at(cls, factor: float, tension: Array) -> _Evaluation:
        """At a load factor and tensions."""
        return cls(factor, tension, largest(tension))

    def is_near(self, factor: float, tension: Array, fraction: float = 1.0) -> bool:
        """Whether another load factor and other tensions are within a fraction of the limits of reuse."""
        if factor - self.factor > fraction * CONSTANT_RATES_PIECE:
            return False
        return largest_magnitude(tension - self.tension) <= fraction * REUSED_TENSION_CHANGE * self.largest


class _LastReversals(NamedTuple):
    """Where slips reversed last, see `FrictionPath`; the arrays are filled on the way."""

    slip: Array
    mobilisation: Array
    factor: Array

    def set(self, which: Index, slip: Array, mobilisation: Array, factor: float) -> None:
        """Slips of some holes reverse at a load factor; changes the arrays."""
        self.slip[which], self.mobilisation[which], self.factor[which] = slip, mobilisation, factor


class _Integration:
    """The integration of the friction states, up to the load factor that it has reached.

    Parameters are those of `follow_friction`.

    Attributes
    ----------
    factor : float
        Load factor reached [1].
    z : ndarray, shape (k + c,)
        Unknowns there.
    tension : ndarray, shape (q,)
        Tensions of the segments there [N].
    """

    def __init__(self, slips: Slips, mobilisation: Array, base_tension: Array, tension: Array) -> None:
        holes = len(mobilisation)
        self._slips = slips
        self._unknowns = PathUnknowns.of(slips.presliding, holes, base_tension, tension)
        self.factor, self.z, self.tension = 0.0, np.append(mobilisation, base_tension), tension
        self._pieces: list[Piece] = []
        self._reversals = _LastReversals(np.zeros(holes), mobilisation.copy(), np.zeros(holes))
        self._breakpoints, self._longest = [*slips.breakpoints], _longest_piece(slips)
        self._drift = DriftCorrection(self._unknowns)
        self._start_slip: Array = np.zeros(0)
        #: Slips here; None where they have to be evaluated anew.
        self._state: SlipState | None = None
        self._evaluation = _Evaluation.at(0.0, tension)
        #: The unknowns here as they would be without bounds; None where the state was not evaluated here.
        self._unclipped: Unclipped | None = None
        #: At which bounds the unknowns are here, and the slack of tendons [m].
        self._side, self._slack = self._unknowns.bounds.side(self.z), np.zeros(len(base_tension))
        #: Holes whose slips reverse here.
        self._turned = _NONE
        #: How often the last piece has been shortened.
        self._shortenings = 0

    @property
    def at_end(self) -> bool:
        """Whether the end of the substep is reached."""
        return not self._breakpoints

    def path(self) -> FrictionPath:
        """The path so far."""
        return FrictionPath(self.z, *self._reversals, self.at_end, tuple(self._pieces), self._unknowns.bounds)

    def rates(self) -> Rates | None:
        """Rates here; None where there are none, or where numbers overflow far from both ends of the substep."""
        state, unknowns = self._evaluated(), self._unknowns
        self._side = unknowns.bounds.side(self.z)
        self._slack = np.maximum(-state.slip[unknowns.holes :], 0.0)
        fixed = unknowns.fixed_by_slack(self._slack)
        found = solve_rates(
            state.columns, state.by_load, self._side, fixed, unknowns.scale, unknowns.tolerance
        )
        return found if found is not None and isfinite(found.complement @ found.complement) else None

    def is_moved_back(self, rates: Rates) -> bool:
        """Whether rates have to be found again: with new derivatives here, or where a reversal was passed.

        Slips that reverse here may have done so before. The last piece is then shortened to where they did.
        """
        side, holes = self._side, self._unknowns.holes
        self._turned = (
            _NONE if rates.side is side else ((rates.side == 0.0) & (side != 0.0))[:holes].nonzero()[0]
        )
        if not self._turned.size:
            return False
        if not self._evaluation.is_near(self.factor, self.tension, REUSED_FOR_REVERSAL):
            self._state = None
            return True
        if not self._pieces or self._shortenings >= MOST_SHORTENINGS:
            return False
        fraction = self._fraction_before_reversal()
        if fraction >= 1.0:
            return False
        last = self._pieces[-1] = self._pieces[-1].shortened(fraction)
        self.factor, self.z, self.tension = last.after(last.length, self._unknowns.bounds)
        self._state, self._shortenings = None, self._shortenings + 1
        return True

    def take_events(self, rates: Rates) -> None:
        """Note which unknowns are free from here on, which slips reverse here, and which breakpoints are passed."""
        state, turned = self._evaluated(), self._turned
        self._shortenings = 0
        self._drift.set_free(rates.side == 0.0, self.z, state)
        if turned.size:
            slip = state.slip[turned] - self._start_slip[turned]
            self._reversals.set(turned, slip, self._side[turned], self.factor)
        if self._at_breakpoint():
            del self._breakpoints[0]

    def advance(self, rates: Rates) -> bool:
        """Add the piece up to the next event; whether that was possible: not where numbers overflow."""
        state = self._evaluated()
        piece, curved = self._next_piece(state, rates)
        if piece is None:
            return False
        self._pieces.append(piece)
        self.factor, self.z, self.tension = piece.after(piece.length, self._unknowns.bounds)
        reused = not (curved or self._at_breakpoint()) and self._evaluation.is_near(self.factor, self.tension)
        if reused and not state.left_regimes(self._slips.regimes(self.z, self.tension)):
            self._state = state.extrapolated(piece.length, self.tension, rates.rate, rates.complement)
            self._unclipped = None
        else:
            self._state = None
        return True

    def _at_breakpoint(self) -> bool:
        return self.factor >= self._breakpoints[0] - ROUND_OFF

    def _evaluated(self) -> SlipState:
        """Slips here, evaluated and corrected for the drift if they are not known."""
        if self._state is None:
            state = self._slips.at(self.factor, self.z, self.tension)
            self.tension = state.tension
            if not self._start_slip.size:
                self._start_slip = state.slip
            self._evaluation = _Evaluation.at(self.factor, self.tension)
            self.z, self._state, self._unclipped = self._drift.corrected(self.z, state)
        return self._state

    def _next_piece(self, state: SlipState, rates: Rates) -> tuple[Piece | None, bool]:
        """The path up to the next event, None where numbers overflow; and whether rates change within it."""
        slips, unknowns, z = self._slips, self._unknowns, self.z
        event = distance_to_bound(rates, z, unknowns.bounds)
        curved, longest = event > CONSTANT_RATES_PIECE, self._longest
        tension_rate = state.tension_rates(rates.free, rates.rate)
        slope = self._slope(state, rates, tension_rate) if curved else None
        if curved and slope is None:
            curved, longest = False, CONSTANT_RATES_PIECE
        linear = rates.linear(slope)
        if slope is not None:
            if not isfinite(slope @ slope):
                return None, curved
            event = min(
                distance_to_curved_bound(linear, rates.free, z, unknowns.bounds),
                distance_to_reversal(linear, unknowns.tolerance, unknowns.holes),
            )
        if self._slack.size:
            event = min(event, distance_to_tautness(linear, self._slack, unknowns.holes))
        event = min(event, slips.distance_to_regime_change(z, linear.rate, state.tension, tension_rate))
        length = min(self._breakpoints[0] - self.factor, longest, max(SHORTEST_PIECE, event))
        return Piece(self.factor, length, z, linear, state.tension, tension_rate), curved

    def _slope(self, state: SlipState, rates: Rates, tension_rate: Array) -> Array | None:
        """Derivative by the load factor of the rates of the complements at constant rates of the unknowns [m].

        None where they jump.
        """
        fastest = largest_magnitude(rates.rate[: self._unknowns.holes])
        length = min(
            SLOPE_PIECE * LONGEST_PIECE,
            self._breakpoints[0] - self.factor,
            SLOPE_CHANGE / max(fastest, SLOPE_CHANGE),
        )
        z, tension = self.z + length * rates.rate, state.tension + length * tension_rate
        ahead = self._slips.complement_rates(self.factor + length, z, tension, rates.rate, state)
        return None if ahead is None else (ahead - rates.complement) / length

    def _fraction_before_reversal(self) -> float:
        """Fraction of the last piece over which slips kept their direction [1].

        1 where the slip after their reversals makes no difference. Rates are taken as linear between those at both ends
        of the piece. Slips also reverse where a free unknown of another hole comes to its bound within the piece.
        """
        state, piece, turned, side = self._evaluated(), self._pieces[-1], self._turned, self._side
        negligible = OVERSHOOT * self._unknowns.presliding
        # The rates just before its end, where nothing had turned or come to a bound.
        free, rate = (piece.rates.side == 0.0).nonzero()[0], state.by_load
        if free.size:
            columns = state.columns(free)
            rate = rate - columns.dot(dgesv(rows_of(columns, free), rate[free], overwrite_a=True)[2])
        complement = piece.rates.complement[turned]
        before = np.maximum(side[turned] * complement, 0.0)
        after = np.maximum(-side[turned] * rate[turned], 0.0)
        passed = after / np.maximum(before + after, 1e-300)
        matters = 0.5 * after * passed * piece.length > negligible
        # Unknowns that only came to their bound at the end have no rate before it.
        matters &= piece.rates.side[turned] != 0.0
        fraction = 1.0 - float(passed[matters].max(initial=0.0))
        inside = (
            1.0 if self._unclipped is None else self._unclipped.fraction_inside(piece, self._unknowns.bounds)
        )
        if (1.0 - inside) * piece.length * largest_magnitude(complement) > negligible:
            fraction = min(fraction, inside)
        return max(fraction, 1.0 - MOST_SHORTENED)


def _longest_piece(slips: Slips) -> float:
    """Largest part of a substep over which slip rates are taken as linear in the load factor [1]."""
    smooth = float(np.cbrt(OVERSHOOT * slips.presliding / max(slips.cubic_coefficient, 1e-300)))
    return min(LONGEST_SMOOTH_PIECE, max(LONGEST_PIECE, smooth))
