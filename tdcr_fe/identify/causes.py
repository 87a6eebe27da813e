"""Unlisted causes, also those that no description of a robot can have.

A cause perturbs something, depends on something, and acts somewhere (`Kind`). The listed effects are causes, too; code
calls them, and effects of the user's own, `named`. Unlisted are, for example, loads that depend on the solved state,
and shifts of the readings.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from tdcr_fe.effects import Effect, Experiment, Parameter
from tdcr_fe.effects.base import ExcitationRange, Kind, Points, Values
from tdcr_fe.elements import Array
from tdcr_fe.identify.bay_state import COMPONENTS, FORCE, MOMENT, BayState, end_of_bay

if TYPE_CHECKING:
    from tdcr_fe.identify.problem import FitProblem
    from tdcr_fe.identify.run import Run


def is_named(effect: Effect) -> bool:
    """Whether a cause is a listed effect or one of the user's own, and not an unlisted cause."""
    return not isinstance(effect, Cause)


#: Numbers of a cause.
Numbers = tuple[Parameter, ...]
#: Values at which some of them are tried, see `Cause.held`.
Held = Mapping[str, Sequence[float]]


class Cause(Effect):
    """An unlisted cause.

    Parameters
    ----------
    name, kind, parameters
        See `Effect`.
    acts
        How it acts: see `ChangedDescription` and `BesideDescription`.
    sentence
        What acts, in words, without its place.
    price
        What its choice among all of the same kind costs, in natural units of the logarithm of its prior probability.
    held
        Parameters that change nothing where the others have their null values, and values at which these are tried.

    Attributes
    ----------
    parts : tuple of Cause
        Unlisted causes that add up to it near the null values, each with its numbers; none: it is of one piece.
    """

    held: Held = MappingProxyType({})
    parts: tuple[Cause, ...] = ()

    def __init__(
        self,
        name: str,
        kind: Kind,
        parameters: Numbers,
        acts: Any,
        sentence: str,
        price: float = 0.0,
        held: Held = held,
    ) -> None:
        self.name, self.kind, self.parameters, self.acts = name, kind, parameters, acts
        self.sentence, self.price, self.held = sentence, price, held

    @property
    def everywhere(self) -> str:
        """Its name without tendon, place and rows, which stand in brackets."""
        return self.name.partition(" (")[0]

    @property
    def law(self) -> str:
        """See `Effect.law`; everywhere it is another law than somewhere."""
        return self.name if self.name == self.everywhere else f"{self.everywhere} somewhere"

    def probe_points(self, experiment: Experiment, excitation: ExcitationRange) -> Points:
        """One direction for each parameter that is not held."""
        null = self.null_values(experiment)
        alternatives = [dict(zip(self.held, x, strict=True)) for x in itertools.product(*self.held.values())]
        moved = [(p.name, null[p.name] + p.scale) for p in self.parameters if p.name not in self.held]
        return [[{**null, **held, name: value} for name, value in moved] for held in alternatives]

    def unidentifiable_at_null(self, experiment: Experiment) -> tuple[str, ...]:
        """Parameters that are held, see `held`."""
        return tuple(self.held)


def number(name: str, unit: str, span: tuple[float, float], null: float, scale: float) -> Parameter:
    """A number of a cause: its name with its unit, the span of its values, the null value and a typical change."""
    return Parameter(name, unit, span[0], span[1], null, scale, name.replace("_", " "))


def settling_span(unit: str, duration: float) -> tuple[Parameter, dict[str, list[float]]]:
    """The span in which something settles that lasts so long in all, and values at which it is tried."""
    span = number("span", unit, (1e-3 * duration, 10.0 * duration), 0.2 * duration, 0.02 * duration)
    return span, {"span": [x * duration for x in (0.05, 0.2, 0.6)]}


#: From the experiment and the values of a cause to the experiment with it.
Change = Callable[[Experiment, Values], Experiment]


class ChangedDescription(Cause):
    """A cause that changes robot, model or loading.

    Attributes
    ----------
    acts : callable
        From the experiment and values other than the null values to the experiment with the cause, see `Change`.
    """

    acts: Callable[..., Any]

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        if values == self.null_values(experiment):
            return experiment
        changed: Experiment = self.acts(experiment, values)
        return changed


class BesideDescription(Cause):
    """A cause that no description has: what it adds is linear in its parameters.

    Attributes
    ----------
    parameters : tuple of Parameter
        Coefficients, zero where nothing is added.
    acts : sequence of callable
        A term for each parameter: what a coefficient of one adds.
    """

    acts: Sequence[Callable[..., Array]]

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """The description stays as it is."""
        return experiment

    def added(self, values: Values, shape: tuple[int, ...], *of: Any) -> Array:
        """The sum of all terms, of what these depend on."""
        total = np.zeros(shape)
        for p, term in zip(self.parameters, self.acts, strict=True):
            if values[p.name] != 0.0:
                total += values[p.name] * term(*of)
        return total


class StateLoad(BesideDescription):
    """Moments on the bays, or forces on the disks, that depend on the solved state.

    Its terms are actions of the state of the bays, shape (K, n_bays, 6).
    """

    def action(self, state: BayState, values: Values) -> Array:
        """What acts, shape (K, n_bays, 6)."""
        return self.added(values, (*state.shape, COMPONENTS), state)

    def settling(self, clock: Callable[[BayState], Array], last: Parameter, held: Held) -> LawLoad:
        """The load that grows from the first row on, ever more slowly: with ``1 - exp(-t / span)``.

        Parameters
        ----------
        clock
            From the state to the time, or the number of the row, of every load step, shape (K, 1, 1).
        last, held
            See `settling_span`.
        """

        def acts(state: BayState, values: Values) -> Array:
            passed = clock(state) - clock(state)[0]
            return self.action(state, values) * (1.0 - np.exp(-passed / values["span"]))

        place = self.name.removeprefix(self.everywhere)
        name, sentence = f"{self.everywhere}, settling{place}", f"{self.sentence}, which settles"
        return LawLoad(name, self.kind, (*self.parameters, last), acts, sentence, self.price, held)

    def by_value(self, state: BayState, values: Values, name: str) -> Array:
        """Derivative of the action by a parameter, shape (K, n_bays, 6)."""
        h = 1e-7 * max(abs(values[name]), *(p.scale for p in self.parameters if p.name == name))
        more = self.action(state, {**values, name: values[name] + h})
        return (more - self.action(state, values)) / h

    def slope(self, state: BayState, values: Values) -> Array:
        """Derivative of the action by curvatures and displacements of the same bay and row, shape (K, n_bays, 6, 6).

        Every other row is changed at a time. A law may depend on the change since the row before, which would not show
        if both rows were changed by the same amount.
        """
        here, length = self.action(state, values), float(state.edges[-1])
        found = np.zeros((*here.shape, COMPONENTS))
        for c, first in itertools.product(range(COMPONENTS), (0, 1)):
            h = 1e-6 / length if c < MOMENT.stop else 1e-6 * length
            change = np.zeros(here.shape)
            change[first::2, :, c] = h
            found[first::2, ..., c] = (self.action(state.corrected(change), values) - here)[first::2] / h
        return found


class LawLoad(StateLoad):
    """A load that is no sum of terms: it acts by a function of the state and of all its values."""

    acts: Callable[[BayState, Values], Array]  # type: ignore[assignment]

    def action(self, state: BayState, values: Values) -> Array:
        """See `StateLoad.action`."""
        return np.asarray(self.acts(state, values))


class PointForce(StateLoad):
    """A force on one point of the backbone towards a fixed point of the world, which depends on the distance.

    Parameters
    ----------
    name, sentence
        Name and sentence of the cause.
    bay
        Number of the bay at whose end it acts, from 0.
    state
        State of the declared model.
    law
        Its `strength` first, and for a cord ``slack``, the distance from which on it pulls.
    """

    #: The parameter that is zero where nothing acts.
    strength = "k"

    #: The fixed point in words.
    place = "the point"

    def __init__(self, name: str, sentence: str, bay: int, state: BayState, law: Numbers) -> None:
        self.at, self.bay, self.reach = float(state.edges[bay + 1]), bay, 0.5 * float(state.edges[-1])
        where, far = end_of_bay(state.edges, bay), 20.0 * self.reach
        point = (Parameter(a, "m", -far, far, 0.0, 0.05 * self.reach, f"{a} of {self.place}") for a in "xyz")
        kind, price = Kind("force", ("position",), where), math.log(state.choices(bay))
        super().__init__(f"{name} ({where})", kind, (*point, *law), (), sentence, price)
        self.declared = state.moved[:, bay]

    def position(self, moved: Array) -> Array:
        """Where the point of the backbone is that has moved so far [m], shape (K, 3) both."""
        return np.asarray(np.array([0.0, 0.0, self.at]) + moved)

    def times(self, factor: Array | float, strength: Array) -> Array:
        """The strengths of forces so many times as large."""
        return np.asarray(factor * strength)

    def pull(self, distance: Array, values: Values) -> Array:
        """The force towards the point at a distance [N]."""
        raise NotImplementedError

    def laws(self, distance: Array) -> list[dict[str, float]]:
        """Values of the law at which it is tried, where the declared model has these distances from the point."""
        raise NotImplementedError

    def action(self, state: BayState, values: Values) -> Array:
        """See `StateLoad.action`."""
        found = np.zeros((*state.shape, COMPONENTS))
        found[:, self.bay, FORCE] = self.force(state.moved[:, self.bay], values)
        return found

    def force(self, moved: Array, values: Values) -> Array:
        """On the point of the backbone where that has moved so far [N], shape (K, 3) both."""
        apart = np.array([values[a] for a in ("x", "y", "z")]) - self.position(moved)
        distance = np.sqrt(np.sum(apart**2, axis=1) + (1e-3 * self.reach) ** 2)  # never quite zero
        return np.asarray((self.pull(distance, values) / distance)[:, None] * apart)

    def derivatives(self, moved: Array, values: Values) -> Array:
        """Of the force, by what the point of the backbone has moved and by all parameters, shape (K, 3, 3 + P)."""
        found, h = [], 1e-7 * self.reach
        for axis in np.eye(3):
            sides = (self.force(moved + x * axis, values) for x in (h, -h))
            found.append(np.subtract(*sides) / (2.0 * h))
        for p in self.parameters:
            h = 1e-6 * p.scale
            sides = (self.force(moved, {**values, p.name: values[p.name] + x}) for x in (h, -h))
            found.append(np.subtract(*sides) / (2.0 * h))
        return np.stack(found, axis=-1)

    def unidentifiable_at_null(self, experiment: Experiment) -> tuple[str, ...]:
        """All but the strength."""
        return tuple(p.name for p in self.parameters if p.name != self.strength)

    def probe_points(self, experiment: Experiment, excitation: ExcitationRange) -> Points:
        """The first point of `tries`; `tdcr_fe.identify.screening` tries all."""
        return [[next(self.tries(self.declared))]]

    def tries(self, moved: Array) -> Iterator[dict[str, float]]:
        """Points around the robot, at several distances from its middle; ``moved``: as in `force`."""
        length = 2.0 * self.reach
        middle = np.array([0.0, 0.0, 0.6 * length])
        path = self.position(moved)
        for distance in self.distances:
            for direction in _DIRECTIONS:
                point = middle + distance * length * direction
                x, y, z = point.tolist()
                for law in self.laws(np.linalg.norm(point - path, axis=1)):
                    yield {"x": x, "y": y, "z": z, **law}

    #: Of the points that are tried, over the length [1].
    distances: tuple[float, ...] = (0.5, 0.9, 1.5)


class Attraction(PointForce):
    """A force towards a point, or away from it, which falls with a power of the distance.

    Parameters
    ----------
    bay, state
        See `PointForce`.
    power
        Power of the distance.
    strength
        A typical force [N].
    """

    def __init__(self, bay: int, state: BayState, power: int, strength: float) -> None:
        scale = strength * (0.5 * float(state.edges[-1])) ** power
        most, meaning = 1e3 * scale, "force times distance to that power"
        k = Parameter("k", f"N m^{power}", -most, most, 0.0, 0.1 * scale, meaning)
        sentence = "a force towards a fixed point that falls with the distance"
        super().__init__(f"attraction to a point, power {power}", sentence, bay, state, (k,))
        self.power = power

    def pull(self, distance: Array, values: Values) -> Array:
        """See `PointForce.pull`."""
        return values["k"] / distance**self.power

    def laws(self, distance: Array) -> list[dict[str, float]]:
        """See `PointForce.laws`."""
        return [{"k": self.parameters[-1].scale}]


class Cord(PointForce):
    """A force towards a point that grows in proportion from some distance on, as of a slack cord.

    Parameters
    ----------
    bay, state
        See `PointForce`.
    stiffness
        A typical one [N/m].
    """

    distances = (0.4, 1.5)

    def __init__(self, bay: int, state: BayState, stiffness: float) -> None:
        length = float(state.edges[-1])
        k = Parameter("k", "N/m", 0.0, 1e4 * stiffness, 0.0, stiffness, "force per distance beyond the slack")
        slack = Parameter("slack", "m", 0.0, 20.0 * length, 0.0, 0.02 * length, "distance where it begins")
        sentence = "a force towards a fixed point that begins at some distance from it, as of a slack cord"
        super().__init__("cord", sentence, bay, state, (k, slack))

    def pull(self, distance: Array, values: Values) -> Array:
        """See `PointForce.pull`."""
        return values["k"] * np.maximum(distance - values["slack"], 0.0)

    def laws(self, distance: Array) -> list[dict[str, float]]:
        """Taut in most rows, and in a few."""
        k = self.parameters[3].scale
        return [{"k": k, "slack": float(np.nanquantile(distance, q))} for q in (0.3, 0.8)]


class Wall(PointForce):
    """A plane that pushes back what goes beyond it, seen from the origin, in proportion to the depth.

    Its point is the one nearest to the origin, at the foot of the perpendicular. Its stiffness over the sum of that and
    of the straight backbone, a cantilever, is the share: in proportion to it the readings change, from no wall to a
    rigid one. With the stiffness itself a fit ended at half of 60 N/m, stuck.

    Parameters
    ----------
    bay, state
        See `PointForce`.
    stiffness
        Of the straight backbone, bent by a force on its tip [N/m].
    """

    strength = "share"
    place = "the wall's point nearest to the origin"

    def __init__(self, bay: int, state: BayState, stiffness: float) -> None:
        meaning = "part of the way beyond the wall that it takes back"
        share = Parameter("share", "1", 0.0, 0.9999, 0.0, 0.01, meaning)
        super().__init__("wall", "a force of a flat wall that grows with the depth", bay, state, (share,))
        self.stiffness = stiffness * (2.0 * self.reach / self.at) ** 3

    def force(self, moved: Array, values: Values) -> Array:
        """See `PointForce.force`."""
        foot = np.array([values[a] for a in ("x", "y", "z")])
        distance = max(float(np.linalg.norm(foot)), 1e-6 * self.reach)
        depth = self.position(moved) @ foot / distance - distance
        k = self.stiffness * values["share"] / (1.0 - values["share"])
        return np.asarray(-k * np.outer(np.maximum(depth, 0.0), foot / distance))

    def times(self, factor: Array | float, strength: Array) -> Array:
        """See `PointForce.times`."""
        odds = factor * strength / (1.0 - strength)
        return np.asarray(odds / (1.0 + np.maximum(odds, 0.0)))

    def tries(self, moved: Array) -> Iterator[dict[str, float]]:
        """Walls that are touched in most rows, and in a few; ``moved``: as in `force`."""
        path = self.position(moved)
        for direction in _DIRECTIONS:
            for distance in np.nanquantile(path @ direction, (0.3, 0.8)):
                if distance > 0.05 * self.reach:
                    x, y, z = (distance * direction).tolist()
                    yield {"x": x, "y": y, "z": z, "share": 0.5}


def _sphere() -> Array:
    """Directions that cover a sphere, shape (n, 3)."""
    found = []
    for polar in np.radians([15.0, 50.0, 80.0, 110.0, 140.0]):
        count = max(4, round(10 * np.sin(polar)))
        for turn in np.arange(count) * 2.0 * np.pi / count:
            found.append((np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)))
    return np.array(found)


_DIRECTIONS = _sphere()


class ReadingCause(BesideDescription):
    """A shift of the readings themselves.

    Its terms are shifts by the problem and a run, in the readings' units, shape (n,).
    """

    def shift(self, problem: FitProblem, run: Run, values: Values) -> Array:
        """Shift of the readings, in their units, shape (n,)."""
        return self.added(values, (problem.count,), problem, run)
