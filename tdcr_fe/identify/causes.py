"""Causes without a name, also those that no description of a robot can have.

A cause perturbs something, depends on something, and acts somewhere (`Kind`). The listed effects are named causes.
Loads that depend on the solved state, and shifts of the readings, are causes without a name.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Effect, Experiment, Parameter
from tdcr_fe.effects.base import Bounds, ExcitationRange, Kind, Points, Values
from tdcr_fe.identify.bay_state import COMPONENTS, BayState

if TYPE_CHECKING:
    from tdcr_fe.identify.problem import FitProblem

Array = NDArray[np.float64]


def is_named(effect: Effect) -> bool:
    """Whether a cause has a name: a listed effect, or one of the user's own."""
    return not isinstance(effect, Cause)


class Cause(Effect):
    """A cause on no list.

    Attributes
    ----------
    sentence : str
        What acts, in words, without numbers.
    price : float
        What its choice among all of the same kind costs, in natural units of the logarithm of its prior probability.
    """

    sentence: str = ""
    price: float = 0.0

    def probe_points(self, experiment: Experiment, excitation: ExcitationRange) -> Points:
        """One direction for each parameter."""
        null = self.null_values(experiment)
        return [[{**null, p.name: null[p.name] + p.scale} for p in self.parameters]]


#: From the experiment and the values of a cause to the experiment with it.
Change = Callable[[Experiment, Values], Experiment]


class ChangedDescription(Cause):
    """A cause that changes robot, model or loading.

    Parameters
    ----------
    name, kind, sentence
        Of the cause.
    parameters
        Its numbers.
    change
        From the experiment and values other than the null values to the experiment with the cause.
    price
        See `Cause`.
    """

    def __init__(
        self,
        name: str,
        kind: Kind,
        parameters: tuple[Parameter, ...],
        change: Change,
        sentence: str = "",
        price: float = 0.0,
    ) -> None:
        self.name, self.kind, self.parameters, self.change = name, kind, parameters, change
        self.sentence, self.price = sentence, price

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        if values == self.null_values(experiment):
            return experiment
        return self.change(experiment, values)


class StateLoad(Cause):
    """Moments on the bays, or forces on the disks, that depend on the solved state; linear in its parameters.

    Parameters
    ----------
    name, kind, sentence
        Of the cause.
    parameters
        Coefficients, zero where nothing acts.
    terms
        One for each parameter: from the state of the bays to the action of a coefficient of one, shape (K, n_bays, 5).
    """

    def __init__(
        self,
        name: str,
        kind: Kind,
        parameters: tuple[Parameter, ...],
        terms: tuple[Callable[[BayState], Array], ...],
        sentence: str = "",
    ) -> None:
        self.name, self.kind, self.parameters, self.terms = name, kind, parameters, terms
        self.sentence = sentence

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """The description stays as it is."""
        return experiment

    def action(self, state: BayState, values: Values) -> Array:
        """What acts, shape (K, n_bays, 5)."""
        total = np.zeros((*state.shape, COMPONENTS))
        for p, term in zip(self.parameters, self.terms, strict=True):
            if values[p.name] != 0.0:
                total += values[p.name] * term(state)
        return total

    def by_value(self, state: BayState, values: Values, name: str) -> Array:
        """Derivative of the action by a parameter, shape (K, n_bays, 5)."""
        return self.terms[[p.name for p in self.parameters].index(name)](state)

    def slope(self, state: BayState, values: Values) -> Array:
        """Derivative of the action by curvatures and displacements of the same bay, shape (K, n_bays, 5, 5)."""
        here, length = self.action(state, values), float(state.edges[-1])
        columns = []
        for c in range(COMPONENTS):
            h = 1e-6 / length if c < 2 else 1e-6 * length
            change = np.zeros(here.shape)
            change[..., c] = h
            columns.append((self.action(state.corrected(change), values) - here) / h)
        return np.stack(columns, axis=-1)


class Attraction(StateLoad):
    """A force on one point of the backbone towards a point of the world, which falls with a power of the distance.

    Parameters
    ----------
    at
        Arc length where it acts [m], and the number of the bay that ends there.
    bay
        See ``at``.
    power
        Of the distance.
    reach
        A typical distance [m].
    strength
        A typical force [N].
    """

    def __init__(self, at: float, bay: int, power: int, reach: float, strength: float) -> None:
        where = "tip" if bay < 0 else f"s = {at:.4g} m"
        self.name = f"attraction to a point ({where}, power {power})"
        self.kind = Kind("force", ("position",), where)
        self.sentence = "a force towards a fixed point that falls with the distance"
        self.at, self.bay, self.power, self.reach = at, bay, power, reach
        far = 20.0 * reach
        places = tuple(
            Parameter(a, "m", -far, far, 0.0, 0.05 * reach, f"{a} of the point") for a in ("x", "y", "z")
        )
        scale = strength * reach**power
        most = 1e3 * scale
        self.parameters = (
            *places,
            Parameter(
                "k", f"N m^{power}", -most, most, 0.0, 0.1 * scale, "force times distance to that power"
            ),
        )

    def action(self, state: BayState, values: Values) -> Array:
        """See `StateLoad.action`."""
        point = np.array([values[a] for a in ("x", "y", "z")])
        found = np.zeros((*state.shape, COMPONENTS))
        at = np.array([0.0, 0.0, self.at]) + state.moved[:, self.bay]
        apart = point - at
        distance = np.sqrt(np.sum(apart**2, axis=1) + (1e-3 * self.reach) ** 2)
        found[:, self.bay, 2:] = values["k"] * apart / (distance ** (self.power + 1))[:, None]
        return found

    def by_value(self, state: BayState, values: Values, name: str) -> Array:
        """See `StateLoad.by_value`."""
        if name == "k":
            return self.action(state, {**values, "k": 1.0})
        h = 1e-6 * self.reach
        moved = {**values, name: values[name] + h}
        return (self.action(state, moved) - self.action(state, values)) / h

    def unidentifiable_at_null(self, experiment: Experiment) -> tuple[str, ...]:
        """The point."""
        return ("x", "y", "z")

    def probe_points(self, experiment: Experiment, excitation: ExcitationRange) -> Points:
        """Points around the robot, at several distances from its middle."""
        length = experiment.robot.backbone.length
        middle = np.array([0.0, 0.0, 0.6 * length])
        found = []
        for distance in (0.5, 0.9, 1.5):
            for direction in _DIRECTIONS:
                x, y, z = (float(c) for c in middle + distance * length * direction)
                found.append([{"x": x, "y": y, "z": z, "k": self.parameters[3].scale}])
        return found

    def bounds(self, experiment: Experiment) -> Bounds:
        """Of the parameters."""
        return {p.name: (p.lower, p.upper) for p in self.parameters}


def _sphere() -> Array:
    """Directions that cover a sphere, shape (n, 3)."""
    found = []
    for polar in np.radians([15.0, 50.0, 80.0, 110.0, 140.0]):
        count = max(4, round(10 * np.sin(polar)))
        for turn in np.arange(count) * 2.0 * np.pi / count:
            found.append((np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)))
    return np.array(found)


_DIRECTIONS = _sphere()


class ReadingCause(Cause):
    """A shift of the readings themselves, linear in its parameters.

    Parameters
    ----------
    name, kind, sentence
        Of the cause.
    parameters
        Coefficients, zero where nothing is shifted.
    shapes
        One for each parameter: from the problem to the shift of a coefficient of one, in the readings' units, (n,).
    """

    def __init__(
        self,
        name: str,
        kind: Kind,
        parameters: tuple[Parameter, ...],
        shapes: tuple[Callable[[FitProblem], Array], ...],
        sentence: str = "",
    ) -> None:
        self.name, self.kind, self.parameters, self.shapes = name, kind, parameters, shapes
        self.sentence = sentence

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """The robot stays as it is."""
        return experiment

    def shift(self, problem: FitProblem, values: Values) -> Array:
        """Of the readings, in their units, shape (n,)."""
        total = np.zeros(problem.count)
        for p, shape in zip(self.parameters, self.shapes, strict=True):
            if values[p.name] != 0.0:
                total += values[p.name] * shape(problem)
        return total
