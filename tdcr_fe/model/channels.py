"""Measured channels: every quantity that a data set may contain, each an object in the list `CHANNELS`.

Adding a channel takes one object in that list: its name, unit and kind of location, what is plausible, how it is
displayed, how it is predicted from a solved step, and how the prediction changes with the step. Reading, prediction,
fitting, reports and the maker of blind data all go through the list.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tdcr_fe.model.interpolation import interpolate_positions, rotation_vector_rate, within_elements
from tdcr_fe.model.results import StepResult

Array = NDArray[np.float64]

#: Arc length [m], tendon name, or None where a quantity has no location.
Location = float | str | None

#: An arc length that is this near to a node is at the node [m].
AT_NODE = 2e-6

#: A vector that is nearer to the z axis than this angle is on the axis [rad].
ON_AXIS = 1e-9

#: Largest plausible position or displacement over the length of the backbone [1].
LARGEST_POSITION = 1.5

#: Largest plausible rotation of the section along the whole backbone, which bounds the curvature [rad].
LARGEST_TURN = 100.0


@dataclass(frozen=True, eq=False)
class ObservedChange:
    """Derivatives of the quantities of an `ObservedStep` by parameters, which are the last axis.

    Attributes
    ----------
    positions : ndarray, shape (n, 3, P)
        Of the nodes in the world.
    rotations : ndarray, shape (n, 3, P)
        Of the sections, as world rotation vectors.
    displacements, distal_tensions : ndarray, shape (n_tendons, P)
    s : ndarray, shape (n, P)
        Of the arc lengths of the nodes, which move along the backbone where disks do.
    """

    positions: Array
    rotations: Array
    displacements: Array
    distal_tensions: Array
    s: Array


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
        Rotation of what is measured against the world: measured = shift + frame (p + R offset).
    offset : ndarray, shape (3,)
        Markers off the backbone, in their sections [m].
    shift : ndarray, shape (3,)
        The base in the measuring frame [m].
    single : tuple of (float, ndarray)
        Arc length [m] of a marker, and what its offset differs by from the others' [m], shape (3,).
    """

    s: Array
    positions: Array
    rotations: Array
    displacements: Array
    distal_tensions: Array
    tendon_names: tuple[str, ...]
    frame: Array = field(default_factory=lambda: np.eye(3))
    offset: Array = field(default_factory=lambda: np.zeros(3))
    shift: Array = field(default_factory=lambda: np.zeros(3))
    single: tuple[tuple[float, Array], ...] = ()

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
            np.array([*offset, *(0.0,) * (3 - len(offset))]),
        )

    def offsets(self, s: Array) -> Array:
        """Offsets of markers at arc lengths from the backbone, in their sections [m], shape (n_markers, 3)."""
        found = np.tile(self.offset, (len(s), 1))
        for at, own in self.single:
            found[np.abs(s - at) < AT_NODE] += own
        return found

    def levers(self, s: Array) -> Array:
        """The same in the world [m], shape (n_markers, 3)."""
        nodes = np.argmin(np.abs(s[:, None] - self.s), axis=1)
        return np.asarray(np.einsum("nij,nj->ni", self.rotations[nodes], self.offsets(s)))

    def markers(self, s: Array) -> Array:
        """Measured positions of markers at arc lengths [m], shape (n_markers, 3)."""
        nodes = np.argmin(np.abs(s[:, None] - self.s), axis=1)
        if np.max(np.abs(self.s[nodes] - s)) < AT_NODE:
            at = self.positions[nodes]
        else:
            at = interpolate_positions(self.s, self.positions, self.rotations, s)
        return np.asarray((at + self.levers(s)) @ self.frame.T + self.shift)

    def marker_changes(self, change: ObservedChange, s: Array) -> Array:
        """Derivatives of `markers`, shape (n_markers, 3, P)."""
        nodes = np.argmin(np.abs(s[:, None] - self.s), axis=1)
        if np.max(np.abs(self.s[nodes] - s)) < AT_NODE and not np.any(change.s):
            moved = change.positions[nodes]
        else:
            moved = self._between_nodes(change, s)
        turned = np.cross(change.rotations[nodes], self.levers(s)[..., None], axis=1)
        return np.asarray(self.frame @ (moved + turned))

    def _between_nodes(self, change: ObservedChange, s: Array) -> Array:
        """Derivatives of the positions at arc lengths between nodes, (n_markers, 3, P), by central differences."""
        k = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, self.s.size - 2)
        columns = range(change.positions.shape[-1])
        steps = np.array([_difference_step(self, change, p) for p in columns])
        moved = []
        for h in (steps, -steps):
            ends = []
            for nodes in (k, k + 1):
                turned = (h * change.rotations[nodes]).swapaxes(1, 2)
                turn = Rotation.from_rotvec(turned.reshape(-1, 3)).as_matrix().reshape(*turned.shape, 3)
                at = self.positions[nodes, :, None] + h * change.positions[nodes]
                rotation = (turn @ self.rotations[nodes, None]).reshape(-1, 3, 3)
                ends.append(
                    (at.swapaxes(1, 2).reshape(-1, 3), rotation, self.s[nodes, None] + h * change.s[nodes])
                )
            (a, turn_a, start), (b, turn_b, end) = ends
            share = (s[:, None] - start) / (end - start)
            moved.append(within_elements(a, turn_a, b, turn_b, share.ravel()))
        found = (moved[0] - moved[1]).reshape(len(s), -1, 3).swapaxes(1, 2)
        return np.asarray(found / (2.0 * steps))

    def tip_change(self, change: ObservedChange) -> Array:
        """Derivatives of `tip`, shape (3, P)."""
        turned = np.cross(change.rotations[-1], self.levers(self.s[-1:])[0][:, None], axis=0)
        return np.asarray(self.frame @ (change.positions[-1] + turned))

    def tangent_change(self, change: ObservedChange) -> Array:
        """Derivatives of `tangent`, shape (3, P)."""
        return np.asarray(self.frame @ np.cross(change.rotations[-1], self.rotations[-1][:, 2, None], axis=0))

    @property
    def tip(self) -> Array:
        """Measured position of the tip [m], shape (3,)."""
        lever = self.levers(self.s[-1:])[0]
        return np.asarray(self.frame @ (self.positions[-1] + lever) + self.shift)

    @property
    def tangent(self) -> Array:
        """Measured direction of the tip, shape (3,)."""
        return np.asarray(self.frame @ self.rotations[-1][:, 2])

    def curvature(self, s: Array) -> Array:
        """Turning rates of the section about its own axes [1/m], shape (n, 3).

        The mean over the element at ``s``, from the relative rotation of its ends; at a node the mean of both
        elements. Exact where the curvature is constant.
        """
        lower, upper = self._elements_at(s)
        used = np.unique(np.concatenate((lower, upper)))
        relative = np.swapaxes(self.rotations[used], 1, 2) @ self.rotations[used + 1]
        rate = Rotation.from_matrix(relative).as_rotvec() / (self.s[used + 1] - self.s[used])[:, None]
        return np.asarray(0.5 * (rate[np.searchsorted(used, lower)] + rate[np.searchsorted(used, upper)]))

    def curvature_change(self, change: ObservedChange, s: Array) -> Array:
        """Derivatives of `curvature`, shape (n, 3, P)."""
        lower, upper = self._elements_at(s)
        used = np.unique(np.concatenate((lower, upper)))
        end = np.swapaxes(self.rotations[used + 1], 1, 2)
        turn = Rotation.from_matrix(np.swapaxes(end @ self.rotations[used], 1, 2)).as_rotvec()
        own = rotation_vector_rate(turn) @ end @ (change.rotations[used + 1] - change.rotations[used])
        length = (self.s[used + 1] - self.s[used])[:, None, None]
        own = own / length - turn[:, :, None] * (change.s[used + 1] - change.s[used])[:, None] / length**2
        return np.asarray(0.5 * (own[np.searchsorted(used, lower)] + own[np.searchsorted(used, upper)]))

    def _elements_at(self, s: Array) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Numbers of the elements before and after arc lengths; the same one between nodes."""
        lower = np.clip(np.searchsorted(self.s, s - AT_NODE, side="right") - 1, 0, self.s.size - 2)
        upper = np.clip(np.searchsorted(self.s, s + AT_NODE, side="right") - 1, 0, self.s.size - 2)
        return lower, upper


#: From an observed step and locations of the channel's kind to the values that an instrument would show.
Prediction = Callable[[ObservedStep, Sequence[Location]], Array]

#: From an observed step, its derivatives and locations to the derivatives of the prediction, shape (k, P).
Derivation = Callable[[ObservedStep, ObservedChange, Sequence[Location]], Array]


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
    derive : callable or None
        See `Derivation`. None: by central differences of `predict`, which takes longer; see `Channel.derivatives`.
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
    derive: Derivation | None = None

    def derivatives(self, step: ObservedStep, change: ObservedChange, locations: Sequence[Location]) -> Array:
        """Derivatives of the prediction by parameters, shape (k, P).

        Parameters
        ----------
        step
            The observed step.
        change
            Its derivatives by the parameters.
        locations
            Of the readings, k of them.
        """
        if self.derive is not None:
            return self.derive(step, change, locations)
        columns = []
        for p in range(change.positions.shape[-1]):
            h = _difference_step(step, change, p)
            ahead, behind = (self.predict(_moved(step, change, p, x), locations) for x in (h, -h))
            columns.append((ahead - behind) / (2.0 * h))
        return np.array(columns).T.reshape(len(locations), -1)


def _difference_step(step: ObservedStep, change: ObservedChange, p: int) -> float:
    """Change of parameter ``p`` that moves a step by 1e-5 of its length, or turns it by so much."""
    length = float(step.s[-1])
    largest = max(
        float(np.max(np.abs(change.rotations[:, :, p]), initial=0.0)),
        float(np.max(np.abs(change.positions[:, :, p]), initial=0.0)) / length,
        float(np.max(np.abs(change.s[:, p]), initial=0.0)) / length,
        float(np.max(np.abs(change.displacements[:, p]), initial=0.0)) / length,
    )
    return 1e-5 / largest if largest > 0.0 else 1e-5


def _moved(step: ObservedStep, change: ObservedChange, p: int, h: float) -> ObservedStep:
    """A step with parameter ``p`` changed by ``h``, to first order."""
    turn = Rotation.from_rotvec(h * change.rotations[:, :, p]).as_matrix()
    return replace(
        step,
        s=step.s + h * change.s[:, p],
        positions=step.positions + h * change.positions[:, :, p],
        rotations=turn @ step.rotations,
        displacements=step.displacements + h * change.displacements[:, p],
        distal_tensions=step.distal_tensions + h * change.distal_tensions[:, p],
    )


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


def _tendon_derivation(values: Callable[[ObservedChange], Array]) -> Derivation:
    def derive(step: ObservedStep, change: ObservedChange, locations: Sequence[Location]) -> Array:
        return values(change)[[step.tendon_names.index(str(x)) for x in locations]]

    return derive


def _single_derivation(value: Callable[[ObservedStep, ObservedChange], Array]) -> Derivation:
    def derive(step: ObservedStep, change: ObservedChange, locations: Sequence[Location]) -> Array:
        return np.repeat(value(step, change)[None, :], len(locations), axis=0)

    return derive


def _from_z(vector: Array) -> float:
    """Angle between a vector and the z axis [rad]."""
    return math.atan2(math.hypot(vector[0], vector[1]), vector[2])


def _off_axis_change(vector: Array, change: Array) -> Array:
    """Derivatives of a vector's distance from the z axis, (3,) and (3, P) to (P,).

    On the axis the distance is not differentiable; there it is the derivative to the side of growing parameters.
    """
    distance = math.hypot(vector[0], vector[1])
    if distance < ON_AXIS * math.hypot(distance, vector[2]):
        return np.asarray(np.hypot(change[0], change[1]))
    return np.asarray((vector[0] * change[0] + vector[1] * change[1]) / distance)


def _from_z_change(vector: Array, change: Array) -> Array:
    """Derivatives of the angle between a vector and the z axis, (3,) and (3, P) to (P,)."""
    distance = math.hypot(vector[0], vector[1])
    turned = vector[2] * _off_axis_change(vector, change) - distance * change[2]
    return np.asarray(turned / (distance**2 + vector[2] ** 2))


def _length(
    quantity: str,
    location: Literal["arc length", "tendon", ""],
    meaning: str,
    predict: Prediction,
    family: str = "",
    at_rest: Callable[[Location], float] = lambda location: 0.0,
    derive: Derivation | None = None,
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
        derive=derive,
    )


def _position(axis: int) -> Channel:
    def predict(step: ObservedStep, locations: Sequence[Location]) -> Array:
        return step.markers(arc_lengths(locations))[:, axis]

    def derive(step: ObservedStep, change: ObservedChange, locations: Sequence[Location]) -> Array:
        return step.marker_changes(change, arc_lengths(locations))[:, axis]

    return _length(
        f"position_{'xyz'[axis]}",
        "arc length",
        f"{'xyz'[axis]} coordinate of a marker in the measuring frame",
        predict,
        family="position",
        at_rest=(lambda location: float(location or 0.0)) if axis == 2 else (lambda location: 0.0),
        derive=derive,
    )


def _angle(
    quantity: str,
    meaning: str,
    vector: Callable[[ObservedStep], Array],
    change: Callable[[ObservedStep, ObservedChange], Array],
) -> Channel:
    """A channel of the angle between a vector and the z axis."""
    return Channel(
        quantity,
        "rad",
        "",
        meaning,
        _single(lambda step: _from_z(vector(step))),
        limits=lambda length: (-0.2, math.pi + 0.2),
        largest_sigma=lambda length: 1.6,
        resolution=lambda length: 2e-5,
        display_unit="deg",
        display_factor=math.degrees(1.0),
        family=quantity,
        mistaken_unit="degrees",
        mistaken_factor=math.radians(1.0),
        derive=_single_derivation(lambda step, by: _from_z_change(vector(step), change(step, by))),
    )


def _curvature(axis: int) -> Channel:
    def predict(step: ObservedStep, locations: Sequence[Location]) -> Array:
        return step.curvature(arc_lengths(locations))[:, axis]

    def derive(step: ObservedStep, change: ObservedChange, locations: Sequence[Location]) -> Array:
        return step.curvature_change(change, arc_lengths(locations))[:, axis]

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
        derive=derive,
    )


#: Every quantity that can be measured.
CHANNELS: tuple[Channel, ...] = (
    _position(0),
    _position(1),
    _position(2),
    _angle(
        "bending_angle",
        "angle between the tip tangent and the z axis",
        lambda step: step.tangent,
        lambda step, change: step.tangent_change(change),
    ),
    _angle(
        "chord_angle",
        "angle between the line from base to tip and the z axis",
        lambda step: step.tip,
        lambda step, change: step.tip_change(change),
    ),
    _length(
        "tip_offset",
        "",
        "distance of the tip from the z axis",
        _single(lambda step: math.hypot(step.tip[0], step.tip[1])),
        derive=_single_derivation(lambda step, change: _off_axis_change(step.tip, step.tip_change(change))),
    ),
    _length(
        "tendon_displacement",
        "tendon",
        "tendon pulled in at the base plate since the straight, unloaded state",
        _tendon_table(lambda step: step.displacements),
        derive=_tendon_derivation(lambda change: change.displacements),
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
        derive=_tendon_derivation(lambda change: change.distal_tensions),
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
