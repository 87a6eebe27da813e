"""Straight tendons in the iterations of a solver: what was evaluated last, and which holes are expected to slide."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.friction import FrictionState
from tdcr_fe.elements.straight_tendons import HolePrediction, Pull, StraightTendons

Array = NDArray[np.float64]


class Iterate(NamedTuple):
    """An evaluation in an iteration of a solver, and for what.

    Attributes
    ----------
    coordinates : ndarray, shape (7 N,)
        Of the nodes, without reference values.
    time : float
        At the end of the step [s].
    state : FrictionState
        History at its beginning.
    base_tension : ndarray, shape (m,)
        [N].
    pull : Pull
    """

    coordinates: Array
    time: float
    state: FrictionState
    base_tension: Array
    pull: Pull

    def of_step(self, time: float, state: FrictionState, base_tension: Array) -> bool:
        """Whether it belongs to the same attempt of a step."""
        return (
            self.time == time
            and self.state is state
            and (self.base_tension is base_tension or bool((self.base_tension == base_tension).all()))
        )


class PastStep(NamedTuple):
    """A step that was solved, from which the next one is predicted.

    Attributes
    ----------
    end : FrictionState
        History at its end.
    rate : ndarray, shape (g, m)
        Change of the mobilisations per time, unlimited [1/s].
    expected : ndarray, shape (g, m)
        The same in the step after it: half of the change of the rate since the step before goes on [1/s].
    """

    end: FrictionState
    rate: Array
    expected: Array

    @classmethod
    def of(
        cls, start: FrictionState, pull: Pull, end: FrictionState, before: PastStep | None
    ) -> PastStep | None:
        """Of a step from a history to another, and the step before it if known; None where no time has passed."""
        if end.time <= start.time:
            return None
        rate = (pull.trial - start.mobilisation.T) / (end.time - start.time)
        known = before is not None and before.end is start
        return cls(end, rate, 1.5 * rate - 0.5 * before.rate if before is not None and known else rate)


def predicted_holes(past: PastStep | None, state: FrictionState, time: float) -> HolePrediction | None:
    """Holes at the end of a step from a history to a time [s]; None where no time passes.

    They go on as in the past step, or stay as they are where the history is that of another step.
    """
    if time <= state.time:
        return None
    start = state.mobilisation.T
    if past is None or past.end is not state:
        return HolePrediction.of(start, start)
    return HolePrediction.of(start, start + (time - state.time) * past.expected)


class IteratedTendons:
    """Straight tendons in the iterations of a solver, the last two of which are kept for the tangent.

    Parameters
    ----------
    tendons
        Compute the forces.
    """

    def __init__(self, tendons: StraightTendons) -> None:
        self._tendons = tendons
        self._last: Iterate | None = None
        self._before: Iterate | None = None
        self._past: PastStep | None = None
        #: History at the beginning of the step in which the tangent was last evaluated.
        self._linearised: FrictionState | None = None
        #: Whether the last step was solved with the tangent: numerical derivatives need one law in all evaluations.
        self._by_tangent = True

    def _at(
        self,
        coordinates: Array,
        reference: Array,
        time: float,
        state: FrictionState,
        base_tension: Array,
        *,
        by_law: bool,
    ) -> Pull:
        """The last evaluation if it was for the same, else a new one.

        Parameters
        ----------
        coordinates, reference, time, state, base_tension
            As in `forces`.
        by_law
            Whether an evaluation for predicted holes, which begins an iteration, does not serve.
        """
        last = self._last
        same = last if last is not None and last.of_step(time, state, base_tension) else None
        prediction = None
        if same is not None and bool((same.coordinates == coordinates).all()):
            if not (by_law and same.pull.prediction):
                return same.pull
        elif self._by_tangent and not (last is not None and last.state is state):
            # A step that is tried again with another size was not solved with the prediction.
            prediction = predicted_holes(self._past, state, time)
        there = coordinates.reshape(-1, 7) + reference
        pull = self._tendons.pull(there, base_tension, state, prediction)
        self._last, self._before = Iterate(coordinates, time, state, base_tension, pull), same
        return pull

    def forces(
        self, coordinates: Array, reference: Array, time: float, state: FrictionState, base_tension: Array
    ) -> Array:
        """Generalised forces on the coordinates of all nodes, shape (7 N,).

        The first evaluation of a step is for holes that stick and slide as predicted; see `HolePrediction`.

        Parameters
        ----------
        coordinates
            Of the nodes, without reference values, shape (7 N,).
        reference
            Their reference values, shape (N, 7).
        time
            At the end of the step [s].
        state
            History of friction at its beginning.
        base_tension
            [N], shape (m,).
        """
        pull = self._at(coordinates, reference, time, state, base_tension, by_law=True)
        return self._tendons.forces(pull)

    def tangent(
        self, coordinates: Array, reference: Array, time: float, state: FrictionState, base_tension: Array
    ) -> Array:
        """Tangent of `forces` for Newton's method, shape (7 N, 7 N); arguments as there."""
        self._linearised = state
        pull = self._at(coordinates, reference, time, state, base_tension, by_law=False)
        return self._tendons.tangent(pull, None if self._before is None else self._before.pull)

    def step_end(
        self, coordinates: Array, reference: Array, time: float, state: FrictionState, base_tension: Array
    ) -> tuple[FrictionState, Array, Pull]:
        """History of friction where a solved step ends, and tendon pulled in at the base [m]; arguments as there."""
        pull = self._at(coordinates, reference, time, state, base_tension, by_law=True)
        friction = self._tendons.friction(pull, time)
        self._past = PastStep.of(state, pull, friction, self._past)
        if time > state.time:
            self._by_tangent = self._linearised is state
        return friction, self._tendons.base_slip(pull), pull
