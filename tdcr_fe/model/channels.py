"""Measured channels: every quantity that a data set may contain, each an object in the list `CHANNELS`.

Adding a channel takes one object in that list: its name, unit and kind of location, and how it is predicted from a
solved step; and where no other has its unit, a row of `PLAUSIBLE`; and a row in docs/files.md. Reading, prediction,
fitting, reports and the maker of blind data all go through the list.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.model.observed_step import ObservedStep
from tdcr_fe.model.results import angle_from_z, off_axis

#: Arc length [m], tendon name, or None where a quantity has no location.
Location = float | str | None


class Plausible(NamedTuple):
    """What values of a channel may be."""

    low: float  # lowest and highest value
    high: float
    sigma: float  # largest standard deviation
    resolution: float  # smallest standard deviation that may be estimated from scatter


#: By unit, a power of the backbone's length and what values may be over it. Positions lie within one and a half
#: lengths, and sections turn by 100 rad along the backbone at most.
PLAUSIBLE = {
    "m": (1, Plausible(-1.5, 1.5, 0.5, 2e-5)),
    "rad": (0, Plausible(-0.2, math.pi + 0.2, 1.6, 2e-5)),
    "1/m": (-1, Plausible(-100.0, 100.0, 50.0, 2e-5)),
    "N": (0, Plausible(-math.inf, math.inf, math.inf, 1e-5)),
}


@dataclass(frozen=True)
class Channel:
    """One quantity that can be measured.

    Attributes
    ----------
    quantity : str
        Its name in ``observations.csv``.
    unit : str
        Unit of value and sigma, in `PLAUSIBLE`.
    location : str
        What the location is: "arc length", "tendon", or "" where there is none.
    meaning : str
        For people.
    values : callable
        From an observed step its value, shape (...), or those of all tendons, shape (..., n_tendons); or from the step
        and arc lengths [m], of shape (k,), those there, shape (..., k).
    """

    quantity: str
    unit: str
    location: Literal["arc length", "tendon", ""]
    meaning: str
    values: Callable[..., Array]

    @property
    def family(self) -> str:
        """Channels of one family have the same noise: the components of a vector."""
        return re.sub("_[xyz]$", "", self.quantity)

    def plausible(self, length: float) -> Plausible:
        """What its values may be on a backbone of a length [m], in its unit."""
        power, values = PLAUSIBLE[self.unit]
        return Plausible(*(x * length**power for x in values))

    def predict(self, step: ObservedStep, locations: Sequence[Location]) -> Array:
        """What an instrument shows at locations of the channel's kind, shape (..., k)."""
        if self.location == "arc length":
            return self.values(step, arc_lengths(locations))
        values = self.values(step)
        if self.location == "tendon":
            return values[..., [step.tendon_names.index(str(x)) for x in locations]]
        return np.repeat(values[..., None], len(locations), axis=-1)


def by_differences(found: Array, h: Array) -> Array:
    """Derivatives of predictions by parameters, by central differences, shape (k, P).

    An angle, or a distance from an axis, is not differentiable where it is zero; there it is the derivative to the side
    of growing parameters.

    Parameters
    ----------
    found
        Predictions in steps that `ObservedStep.moved` has changed, shape (1 + 2 P, k).
    h
        By how much, shape (P,).
    """
    here, (ahead, behind) = found[0], found[1:].reshape(2, h.size, -1)
    bend = np.abs(ahead - here) + np.abs(behind - here)
    at_zero = np.abs(ahead + behind - 2.0 * here) > 0.5 * bend
    changes = np.where(at_zero, ahead - here, 0.5 * (ahead - behind))
    return np.asarray(changes / h[:, None]).T


def arc_lengths(locations: Sequence[Location]) -> Array:
    """Locations of a channel along the backbone as an array [m]."""
    return np.array([float(x) for x in locations if x is not None])


def _along(name: str, unit: str, axes: str, vectors: Callable[..., Array], meaning: str) -> Iterator[Channel]:
    """Channels of some components of vectors along the backbone, shape (..., k, 3)."""
    for i, axis in enumerate(axes):

        def component(step: ObservedStep, s: Array, i: int = i) -> Array:
            return vectors(step, s)[..., i]

        yield Channel(f"{name}_{axis}", unit, "arc length", meaning.format(axis), component)


_COORDINATE = "{} coordinate of a marker in the measuring frame"
_BENDING = "angle between the tip tangent and the z axis"
_CHORD = "angle between the line from base to tip and the z axis"
_TURNING = "turning rate of the section about its own {} axis, as from fibre gratings"
_AT_ANCHOR = "tension of a tendon at its anchor"
_PULLED_IN = "tendon pulled in at the base plate since the straight, unloaded state"
_LOAD_CELL = "tension of a tendon above the base plate, as from a load cell"
#: Every quantity that can be measured.
CHANNELS: tuple[Channel, ...] = (
    *_along("position", "m", "xyz", ObservedStep.markers, _COORDINATE),
    Channel("bending_angle", "rad", "", _BENDING, lambda x: angle_from_z(x.tangent)),
    Channel("chord_angle", "rad", "", _CHORD, lambda x: angle_from_z(x.tip)),
    Channel("tip_offset", "m", "", "distance of the tip from the z axis", lambda x: off_axis(x.tip)),
    Channel("tendon_displacement", "m", "tendon", _PULLED_IN, lambda x: x.displacements),
    Channel("base_tension", "N", "tendon", _LOAD_CELL, lambda x: x.base_tensions),
    Channel("distal_tension", "N", "tendon", _AT_ANCHOR, lambda x: x.distal_tensions),
    *_along("curvature", "1/m", "xy", ObservedStep.curvature, _TURNING),
)

_BY_NAME = {c.quantity: c for c in CHANNELS}

#: Names of all channels, in the order of the list.
QUANTITIES: tuple[str, ...] = tuple(_BY_NAME)


def channel(quantity: str) -> Channel:
    """The channel of a quantity.

    Raises
    ------
    KeyError
        Names the quantities that exist.
    """
    if quantity not in _BY_NAME:
        raise KeyError(f"no quantity {quantity!r}; there are {', '.join(QUANTITIES)}")
    return _BY_NAME[quantity]
