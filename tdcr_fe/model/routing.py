"""Where a tendon's holes lie: routings as functions of arc length.

A routing gives the hole position (x, y) [m] in the section frame at arc length ``s`` and its first two
derivatives. Adding one takes a class here and a line in `ROUTINGS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

Array = NDArray[np.float64]


class Routing(Protocol):
    """What every routing offers; ``end`` [m] is the arc length of the disk that the tendon is anchored to."""

    @property
    def kind(self) -> str:
        """Name of the routing in ``robot.toml``."""
        ...

    def position(self, s: ArrayLike, end: float, derivative: int = 0) -> Array:
        """Hole position or its derivative with respect to arc length.

        Parameters
        ----------
        s
            Arc lengths [m], shape (n,).
        end
            Arc length of the anchor [m].
        derivative
            0, 1 or 2.

        Returns
        -------
        numpy.ndarray
            x and y in the section frame [m, 1, 1/m], shape (n, 2).
        """
        ...


def _polar(radius: list[Array], angle: list[Array], derivative: int) -> Array:
    """Position ``radius * exp(i angle)`` and derivatives from [value, first, second] of both."""
    (r, dr, ddr), (a, da, dda) = radius, angle
    z = np.exp(1j * a)
    if derivative == 0:
        z = r * z
    elif derivative == 1:
        z = (dr + 1j * r * da) * z
    elif derivative == 2:
        z = (ddr - r * da**2 + 1j * (2.0 * dr * da + r * dda)) * z
    else:
        raise ValueError(f"derivative {derivative}: a routing gives the orders 0, 1 and 2")
    return np.stack((z.real, z.imag), axis=-1)


@dataclass(frozen=True)
class ParallelRouting:
    """Holes at constant offset and angle: the tendon runs parallel to the backbone.

    Attributes
    ----------
    offset : float
        Distance of the holes from the backbone [m].
    angle_deg : float
        Angle from +x towards +y [deg].
    """

    offset: float
    angle_deg: float = 0.0
    kind: ClassVar[str] = "parallel"

    def position(self, s: ArrayLike, end: float, derivative: int = 0) -> Array:
        """See `Routing.position`."""
        s = np.asarray(s, dtype=float)
        zero = np.zeros_like(s)
        angle = np.full_like(s, np.deg2rad(self.angle_deg))
        return _polar([zero + self.offset, zero, zero], [angle, zero, zero], derivative)


@dataclass(frozen=True)
class HelicalRouting:
    """Holes that wind about the backbone at constant offset.

    Attributes
    ----------
    offset : float
        Distance of the holes from the backbone [m].
    turns : float
        Turns over the whole length from base to end; positive is right-handed about +z.
    angle_deg : float
        Angle at the base plate from +x towards +y [deg].
    """

    offset: float
    turns: float
    angle_deg: float = 0.0
    kind: ClassVar[str] = "helical"

    def position(self, s: ArrayLike, end: float, derivative: int = 0) -> Array:
        """See `Routing.position`."""
        s = np.asarray(s, dtype=float)
        zero = np.zeros_like(s)
        rate = 2.0 * np.pi * self.turns / end
        angle = np.deg2rad(self.angle_deg) + rate * s
        return _polar([zero + self.offset, zero, zero], [angle, zero + rate, zero], derivative)


@dataclass(frozen=True)
class ConvergingRouting:
    """Holes whose offset changes linearly with arc length.

    Attributes
    ----------
    offset, end_offset : float
        Distance from the backbone at the base plate and at the end [m].
    angle_deg : float
        Angle from +x towards +y [deg].
    """

    offset: float
    end_offset: float
    angle_deg: float = 0.0
    kind: ClassVar[str] = "converging"

    def position(self, s: ArrayLike, end: float, derivative: int = 0) -> Array:
        """See `Routing.position`."""
        s = np.asarray(s, dtype=float)
        zero = np.zeros_like(s)
        rate = (self.end_offset - self.offset) / end
        angle = np.full_like(s, np.deg2rad(self.angle_deg))
        return _polar([self.offset + rate * s, zero + rate, zero], [angle, zero, zero], derivative)


@dataclass(frozen=True)
class PointsRouting:
    """A free list of holes.

    Between the holes, which only the classical model asks for, the path is the natural cubic spline
    through them.

    Attributes
    ----------
    arc_lengths : tuple of float
        Arc length of every hole, base plate first [m].
    holes : tuple of (float, float)
        x and y of every hole in the section frame [m].
    """

    arc_lengths: tuple[float, ...]
    holes: tuple[tuple[float, float], ...]
    kind: ClassVar[str] = "points"

    def __post_init__(self) -> None:
        if len(self.arc_lengths) != len(self.holes) or len(self.holes) < 2:
            raise ValueError(
                f"a points routing needs one hole per arc length and at least two, got "
                f"{len(self.holes)} holes and {len(self.arc_lengths)} arc lengths"
            )

    @cached_property
    def _path(self) -> CubicSpline:
        return CubicSpline(self.arc_lengths, np.asarray(self.holes, dtype=float), bc_type="natural")

    def position(self, s: ArrayLike, end: float, derivative: int = 0) -> Array:
        """See `Routing.position`."""
        if derivative not in (0, 1, 2):
            raise ValueError(f"derivative {derivative}: a routing gives the orders 0, 1 and 2")
        return np.asarray(self._path(np.asarray(s, dtype=float), derivative), dtype=float)


@dataclass(frozen=True)
class TwistedRouting:
    """Another routing whose holes are rotated about the backbone, growing linearly with arc length.

    Attributes
    ----------
    base : Routing
        The routing as designed.
    rate : float
        Rotation per arc length [rad/m].
    """

    base: Routing
    rate: float
    kind: ClassVar[str] = "twisted"

    def position(self, s: ArrayLike, end: float, derivative: int = 0) -> Array:
        """See `Routing.position`."""
        if derivative not in (0, 1, 2):
            raise ValueError(f"derivative {derivative}: a routing gives the orders 0, 1 and 2")
        s = np.asarray(s, dtype=float)
        z = [self.base.position(s, end, k) @ np.array([1.0, 1.0j]) for k in range(derivative + 1)]
        turn = np.exp(1j * self.rate * s)
        ik = 1j * self.rate
        value: Callable[[], Array] = [
            lambda: turn * z[0],
            lambda: turn * (z[1] + ik * z[0]),
            lambda: turn * (z[2] + 2.0 * ik * z[1] + ik**2 * z[0]),
        ][derivative]
        w = value()
        return np.stack((w.real, w.imag), axis=-1)


#: Every routing that ``robot.toml`` may name.
ROUTINGS: dict[str, type] = {
    r.kind: r for r in (ParallelRouting, HelicalRouting, ConvergingRouting, PointsRouting)
}
