"""Measured channels: every quantity that a data set may contain, each an object in the list `CHANNELS`.

Adding a channel takes one object in that list: its name, unit and kind of location, what is plausible, how it is
displayed, and how it is predicted from a solved step. Reading, prediction, fitting, reports and the maker of blind data
all go through the list.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tdcr_fe.model.interpolation import interpolate_positions
from tdcr_fe.model.results import StepResult

Array = NDArray[np.float64]

#: Arc length [m], tendon name, or None where a quantity has no location.
Location = float | str | None

#: An arc length that is this near to a node is at the node [m].
AT_NODE = 2e-6

#: Largest plausible position or displacement over the length of the backbone [1].
LARGEST_POSITION = 1.5

#: Largest plausible rotation of the section along the whole backbone, which bounds the curvature [rad].
LARGEST_TURN = 100.0


@dataclass(frozen=True)
class ObservedStep:
    """The quantities of a solved step from which readings are predicted.

    Attributes
    ----------
    s : ndarray, shape (n,)
        Arc lengths of the nodes [m].
    positions : ndarray, shape (n, 3)
        Of the nodes in the world [m].
    rotations : ndarray, shape (n, 3, 3)
        Of the sections; the third column is the tangent.
    displacements, distal_tensions : ndarray, shape (n_tendons,)
        Pulled in at the base [m]; at the anchor [N].
    tendon_names : tuple of str
    frame : ndarray, shape (3, 3)
        Rotation of what is measured against the world: measured = frame (p + R offset).
    offset : ndarray, shape (3,)
        Markers off the backbone, in their sections [m].
    """

    s: Array
    positions: Array
    rotations: Array
    displacements: Array
    distal_tensions: Array
    tendon_names: tuple[str, ...]
    frame: Array = field(default_factory=lambda: np.eye(3))
    offset: Array = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def of(
        cls,
        step: StepResult,
        tendon_names: tuple[str, ...],
        rotation: Sequence[float] = (0.0, 0.0, 0.0),
        offset: Sequence[float] = (0.0, 0.0),
    ) -> ObservedStep:
        """From a solved step, the rotation vector of the measuring frame [rad] and the markers' offset [m]."""
        return cls(
            step.s,
            step.positions,
            step.rotations,
            np.asarray(step.displacements, dtype=float),
            np.array([t[-1] for t in step.tensions], dtype=float),
            tendon_names,
            Rotation.from_rotvec(np.array(rotation, dtype=float)).as_matrix(),
            np.array([*offset, 0.0]),
        )

    def markers(self, s: Array) -> Array:
        """Measured positions of markers at arc lengths [m], shape (n_markers, 3)."""
        nodes = np.argmin(np.abs(s[:, None] - self.s), axis=1)
        if np.max(np.abs(self.s[nodes] - s)) < AT_NODE:
            at = self.positions[nodes]
        else:
            at = interpolate_positions(self.s, self.positions, self.rotations, s)
        return np.asarray((at + self.rotations[nodes] @ self.offset) @ self.frame.T)

    @property
    def tip(self) -> Array:
        """Measured position of the tip [m], shape (3,)."""
        return np.asarray(self.frame @ (self.positions[-1] + self.rotations[-1] @ self.offset))

    @property
    def tangent(self) -> Array:
        """Measured direction of the tip, shape (3,)."""
        return np.asarray(self.frame @ self.rotations[-1][:, 2])

    def curvature(self, s: Array) -> Array:
        """Turning rates of the section about its own axes [1/m], shape (n, 3).

        The mean over the element at ``s``, from the relative rotation of its ends; at a node the mean of both
        elements. Exact where the curvature is constant.
        """
        lower = np.clip(np.searchsorted(self.s, s - AT_NODE, side="right") - 1, 0, self.s.size - 2)
        upper = np.clip(np.searchsorted(self.s, s + AT_NODE, side="right") - 1, 0, self.s.size - 2)
        used = np.unique(np.concatenate((lower, upper)))
        relative = np.swapaxes(self.rotations[used], 1, 2) @ self.rotations[used + 1]
        rate = Rotation.from_matrix(relative).as_rotvec() / (self.s[used + 1] - self.s[used])[:, None]
        return np.asarray(0.5 * (rate[np.searchsorted(used, lower)] + rate[np.searchsorted(used, upper)]))


#: From an observed step and locations of the channel's kind to the values that an instrument would show.
Prediction = Callable[[ObservedStep, Sequence[Location]], Array]


@dataclass(frozen=True)
class Channel:
    """One quantity that can be measured.

    Attributes
    ----------
    quantity : str
        Its name in ``observations.csv``.
    unit : str
        Of value and sigma: "m", "rad", "N", "1/m".
    location : str
        What the location is: "arc length", "tendon", or "" where there is none.
    meaning : str
        For people.
    predict : callable
        See `Prediction`.
    limits, largest_sigma, resolution : callable
        From the backbone's length [m] to the lowest and highest plausible value, the largest plausible sigma, and the
        smallest sigma that may be estimated from scatter.
    display_unit, display_factor : str, float
        Unit in reports and pictures, and the factor from `unit` to it.
    at_rest : callable
        Value of the straight, unloaded robot, from the location.
    mistaken_unit, mistaken_factor : str, float
        A unit that is often given by mistake, and its size in `unit`.
    family : str
        Channels of one family have the same noise.
    """

    quantity: str
    unit: str
    location: Literal["arc length", "tendon", ""]
    meaning: str
    predict: Prediction
    limits: Callable[[float], tuple[float, float]]
    largest_sigma: Callable[[float], float]
    resolution: Callable[[float], float]
    display_unit: str
    display_factor: float
    family: str
    at_rest: Callable[[Location], float] = lambda location: 0.0
    mistaken_unit: str = ""
    mistaken_factor: float = 1.0


def arc_lengths(locations: Sequence[Location]) -> Array:
    """Locations of a channel along the backbone as an array [m]."""
    return np.array([float(x) for x in locations if x is not None])


def _tendon_table(values: Callable[[ObservedStep], Array]) -> Prediction:
    def predict(step: ObservedStep, locations: Sequence[Location]) -> Array:
        return values(step)[[step.tendon_names.index(str(x)) for x in locations]]

    return predict


def _single(value: Callable[[ObservedStep], float]) -> Prediction:
    def predict(step: ObservedStep, locations: Sequence[Location]) -> Array:
        return np.full(len(locations), value(step))

    return predict


def _from_z(vector: Array) -> float:
    """Angle between a vector and the z axis [rad]."""
    return math.atan2(math.hypot(vector[0], vector[1]), vector[2])


def _length(
    quantity: str,
    location: Literal["arc length", "tendon", ""],
    meaning: str,
    predict: Prediction,
    family: str = "",
    at_rest: Callable[[Location], float] = lambda location: 0.0,
) -> Channel:
    """A channel in metres."""
    return Channel(
        quantity,
        "m",
        location,
        meaning,
        predict,
        limits=lambda length: (-LARGEST_POSITION * length, LARGEST_POSITION * length),
        largest_sigma=lambda length: 0.5 * length,
        resolution=lambda length: 2e-5 * length,
        display_unit="mm",
        display_factor=1e3,
        family=family or quantity,
        at_rest=at_rest,
        mistaken_unit="mm",
        mistaken_factor=1e-3,
    )


def _position(axis: int) -> Channel:
    def predict(step: ObservedStep, locations: Sequence[Location]) -> Array:
        return step.markers(arc_lengths(locations))[:, axis]

    return _length(
        f"position_{'xyz'[axis]}",
        "arc length",
        f"{'xyz'[axis]} coordinate of a marker in the measuring frame",
        predict,
        family="position",
        at_rest=(lambda location: float(location or 0.0)) if axis == 2 else (lambda location: 0.0),
    )


def _angle(quantity: str, meaning: str, value: Callable[[ObservedStep], float]) -> Channel:
    """A channel of angles from the z axis."""
    return Channel(
        quantity,
        "rad",
        "",
        meaning,
        _single(value),
        limits=lambda length: (-0.2, math.pi + 0.2),
        largest_sigma=lambda length: 1.6,
        resolution=lambda length: 2e-5,
        display_unit="deg",
        display_factor=math.degrees(1.0),
        family=quantity,
        mistaken_unit="degrees",
        mistaken_factor=math.radians(1.0),
    )


def _curvature(axis: int) -> Channel:
    def predict(step: ObservedStep, locations: Sequence[Location]) -> Array:
        return step.curvature(arc_lengths(locations))[:, axis]

    return Channel(
        f"curvature_{'xy'[axis]}",
        "1/m",
        "arc length",
        f"turning rate of the section about its own {'xy'[axis]} axis, as from fibre gratings",
        predict,
        limits=lambda length: (-LARGEST_TURN / length, LARGEST_TURN / length),
        largest_sigma=lambda length: 0.5 * LARGEST_TURN / length,
        resolution=lambda length: 2e-5 / length,
        display_unit="1/m",
        display_factor=1.0,
        family="curvature",
    )


#: Every quantity that can be measured.
CHANNELS: tuple[Channel, ...] = (
    _position(0),
    _position(1),
    _position(2),
    _angle(
        "bending_angle", "angle between the tip tangent and the z axis", lambda step: _from_z(step.tangent)
    ),
    _angle(
        "chord_angle",
        "angle between the line from base to tip and the z axis",
        lambda step: _from_z(step.tip),
    ),
    _length(
        "tip_offset",
        "",
        "distance of the tip from the z axis",
        _single(lambda step: math.hypot(step.tip[0], step.tip[1])),
    ),
    _length(
        "tendon_displacement",
        "tendon",
        "tendon pulled in at the base plate since the straight, unloaded state",
        _tendon_table(lambda step: step.displacements),
    ),
    Channel(
        "distal_tension",
        "N",
        "tendon",
        "tension of a tendon at its anchor",
        _tendon_table(lambda step: step.distal_tensions),
        limits=lambda length: (-math.inf, math.inf),
        largest_sigma=lambda length: math.inf,
        resolution=lambda length: 1e-5,
        display_unit="N",
        display_factor=1.0,
        family="distal_tension",
    ),
    _curvature(0),
    _curvature(1),
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
