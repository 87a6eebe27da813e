"""Where a tendon's holes lie: routings as functions of arc length.

A routing gives the hole position (x, y) [m] in the section frame at arc length ``s`` and its first two
derivatives. Its annotated fields are the keys of its tables in ``robot.toml``. Adding a routing takes a class here
and its name in `ROUTINGS`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from tdcr_fe.elements import Array
from tdcr_fe.model.messages import count
from tdcr_fe.model.schema import Checked, FieldError, Quantity

Offset = Annotated[float, Quantity(unit="m", ge=0.0, note="not outside the disk")]
Angle = Annotated[float, Quantity(unit="deg")]
Turns = Annotated[float, Quantity(ge=-1000.0, le=1000.0, note="negative for left-handed")]
Rate = Annotated[float, Quantity(ge=-1000.0, le=1000.0)]
Factor = Annotated[float, Quantity(ge=0.0, in_file=False)]
Radians = Annotated[float, Quantity(unit="rad", in_file=False)]
_HOLES = "pairs [x, y] in m, one a hole: base plate first, then every disk up to the end"


class Routing:
    """What every routing offers; its classes are frozen dataclasses.

    Attributes
    ----------
    kind : str
        Name of the routing in ``robot.toml``.
    """

    kind: ClassVar[str]

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
        raise NotImplementedError

    def axial(self, s: ArrayLike, end: float) -> Array:
        """How far the holes lie beyond their sections along the tangent, as in tilted disks [m], shape (n,).

        Zero in upright disks. It acts where tendons are straight between their holes.

        Parameters
        ----------
        s, end
            As in `position`.
        """
        return np.zeros_like(np.asarray(s, dtype=float))

    @property
    def fixed_arc_lengths(self) -> tuple[float, ...] | None:
        """Arc lengths of the holes that it was made for [m]; None where it applies to any arc lengths."""
        return None

    def deciding_field(self, hole: int) -> str:
        """The field that determines the distance of a hole from the backbone; hole 0 is in the base plate."""
        return "offset"

    @classmethod
    def from_table(cls, values: Mapping[str, Any], hole_arc_lengths: tuple[float, ...]) -> Routing:
        """The routing described by the valid values of a table of ``robot.toml``.

        Parameters
        ----------
        values
            By field.
        hole_arc_lengths
            Arc lengths of base plate and disks up to the tendon's end [m].

        Raises
        ------
        FieldError
            A value does not fit the holes.
        """
        return cls(**values)


def _turned(distance: Polynomial, angle: Polynomial, s: Array, derivative: int) -> NDArray[np.complex128]:
    """``r exp(i a)`` at arc lengths, or a derivative of it, for polynomials ``r`` and ``a``; x and y as ``x + i y``."""
    if derivative not in (0, 1, 2):
        raise ValueError(f"derivative {derivative}: a routing gives the orders 0, 1 and 2")
    for _ in range(derivative):
        distance = distance.deriv() + 1j * angle.deriv() * distance
    return np.asarray(distance(s) * np.exp(1j * angle(s)))


class _PolarRouting(Routing, Checked):
    """A routing by distance from the backbone and angle in the plane of the section."""

    def position(self, s: ArrayLike, end: float, derivative: int = 0) -> Array:
        """See `Routing.position`."""
        z = _turned(*self._course(end), np.asarray(s, dtype=float), derivative)
        return np.stack((z.real, z.imag), axis=-1)

    def _course(self, end: float) -> tuple[Polynomial, Polynomial]:
        """Distance [m] and angle [rad] as polynomials of the arc length [m]."""
        raise NotImplementedError


@dataclass(frozen=True)
class ParallelRouting(_PolarRouting):
    """Holes at constant offset and angle: the tendon runs parallel to the backbone.

    Attributes
    ----------
    offset : float
        Distance of the holes from the backbone [m].
    angle_deg : float
        Angle at the base plate, from +x towards +y [deg].
    """

    offset: Offset
    angle_deg: Angle = 0.0
    kind: ClassVar[str] = "parallel"

    def _course(self, end: float) -> tuple[Polynomial, Polynomial]:
        return Polynomial([self.offset]), Polynomial([np.deg2rad(self.angle_deg)])


@dataclass(frozen=True)
class HelicalRouting(_PolarRouting):
    """Holes that wind about the backbone at constant offset.

    Attributes
    ----------
    offset : float
        Distance of the holes from the backbone [m].
    turns : float
        Turns from base plate to end. Positive is right-handed about +z.
    angle_deg : float
        Angle at the base plate, from +x towards +y [deg].
    """

    offset: Offset
    turns: Turns
    angle_deg: Angle = 0.0
    kind: ClassVar[str] = "helical"

    def _course(self, end: float) -> tuple[Polynomial, Polynomial]:
        rate = 2.0 * np.pi * self.turns / end
        return Polynomial([self.offset]), Polynomial([np.deg2rad(self.angle_deg), rate])


@dataclass(frozen=True)
class VaryingHelicalRouting(_PolarRouting):
    """Holes that wind about the backbone at constant offset, with a rate that changes linearly with arc length.

    At ``x = s / end`` the angle is ``angle + 2 pi (turns_base x + (turns_end - turns_base) x^2 / 2)``: the rate of
    turning is that of a helix of ``turns_base`` turns at the base plate and of ``turns_end`` turns at the end,
    and the tendon makes their mean in all.

    Attributes
    ----------
    offset : float
        Distance of the holes from the backbone [m].
    turns_base : float
        Rate of turning at the base plate, in turns per length to the end. Positive is right-handed about +z.
    turns_end : float
        Rate of turning at the end, in turns per length to the end.
    angle_deg : float
        Angle at the base plate, from +x towards +y [deg].
    """

    offset: Offset
    turns_base: Rate
    turns_end: Rate
    angle_deg: Angle = 0.0
    kind: ClassVar[str] = "helical-varying"

    def _course(self, end: float) -> tuple[Polynomial, Polynomial]:
        rate = 2.0 * np.pi * self.turns_base / end
        growth = 2.0 * np.pi * (self.turns_end - self.turns_base) / end**2
        return Polynomial([self.offset]), Polynomial([np.deg2rad(self.angle_deg), rate, 0.5 * growth])


@dataclass(frozen=True)
class ConvergingRouting(_PolarRouting):
    """Holes whose offset changes linearly with arc length.

    Attributes
    ----------
    offset : float
        Distance of the holes from the backbone at the base plate [m].
    end_offset : float
        Offset at the end; linear in between [m].
    angle_deg : float
        Angle at the base plate, from +x towards +y [deg].
    """

    offset: Offset
    end_offset: Offset
    angle_deg: Angle = 0.0
    kind: ClassVar[str] = "converging"

    def deciding_field(self, hole: int) -> str:
        """See `Routing.deciding_field`."""
        return "end_offset" if hole > 0 else "offset"

    def _course(self, end: float) -> tuple[Polynomial, Polynomial]:
        rate = (self.end_offset - self.offset) / end
        return Polynomial([self.offset, rate]), Polynomial([np.deg2rad(self.angle_deg)])


@dataclass(frozen=True)
class PointsRouting(Routing, Checked):
    """A free list of holes.

    Between the holes, where only the classical model needs it, the path is the natural cubic spline
    through them.

    Attributes
    ----------
    arc_lengths : tuple of float
        Arc length of every hole, base plate first [m].
    holes : tuple of (float, float)
        [x, y] of every hole, in the section frame [m].
    """

    arc_lengths: Annotated[tuple[float, ...], Quantity(unit="m", ge=0.0, in_file=False)]
    holes: Annotated[tuple[tuple[float, float], ...], Quantity(unit="m", ge=-1e3, le=1e3, allowed=_HOLES)]
    kind: ClassVar[str] = "points"

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.arc_lengths) != len(self.holes) or len(self.holes) < 2:
            raise ValueError(
                f"PointsRouting: {len(self.holes)} holes and {len(self.arc_lengths)} arc lengths; must be one hole "
                "per arc length, and at least two"
            )

    @property
    def fixed_arc_lengths(self) -> tuple[float, ...] | None:
        """See `Routing.fixed_arc_lengths`."""
        return self.arc_lengths

    def deciding_field(self, hole: int) -> str:
        """See `Routing.deciding_field`."""
        return f"holes[{hole}]"

    @classmethod
    def from_table(cls, values: Mapping[str, Any], hole_arc_lengths: tuple[float, ...]) -> Routing:
        """See `Routing.from_table`."""
        holes = values["holes"]
        if len(holes) != len(hole_arc_lengths):
            raise FieldError("holes", *hole_count_text(len(holes), len(hole_arc_lengths)))
        return cls(hole_arc_lengths, holes)

    @cached_property
    def _path(self) -> CubicSpline:
        return CubicSpline(self.arc_lengths, np.asarray(self.holes, dtype=float), bc_type="natural")

    def position(self, s: ArrayLike, end: float, derivative: int = 0) -> Array:
        """See `Routing.position`."""
        if derivative not in (0, 1, 2):
            raise ValueError(f"derivative {derivative}: a routing gives the orders 0, 1 and 2")
        return np.asarray(self._path(np.asarray(s, dtype=float), derivative), dtype=float)


@dataclass(frozen=True)
class TurnedRouting(Routing, Checked):
    """Another routing whose holes are moved in their sections: turned about the backbone, and nearer to it or farther.

    Attributes
    ----------
    base : Routing
        The routing as designed.
    """

    base: Annotated[Routing, Quantity(in_file=False)]

    @property
    def fixed_arc_lengths(self) -> tuple[float, ...] | None:
        """See `Routing.fixed_arc_lengths`."""
        return self.base.fixed_arc_lengths

    def axial(self, s: ArrayLike, end: float) -> Array:
        """See `Routing.axial`."""
        return self.base.axial(s, end)

    def deciding_field(self, hole: int) -> str:
        """See `Routing.deciding_field`."""
        return self.base.deciding_field(hole)

    def position(self, s: ArrayLike, end: float, derivative: int = 0) -> Array:
        """See `Routing.position`."""
        s, (factor, angle) = np.asarray(s, dtype=float), self._turn(end)
        z = sum(
            math.comb(derivative, k)
            * _turned(factor, angle, s, k)
            * (self.base.position(s, end, derivative - k) @ np.array([1.0, 1.0j]))
            for k in range(derivative + 1)
        )
        return np.stack((np.real(z), np.imag(z)), axis=-1)

    def _turn(self, end: float) -> tuple[Polynomial, Polynomial]:
        """Factor [1] on the distance, and angle [rad] of the turn, as polynomials of the arc length [m]."""
        raise NotImplementedError


@dataclass(frozen=True)
class TwistedRouting(TurnedRouting):
    """Another routing whose holes are rotated about the backbone, growing linearly with arc length.

    Attributes
    ----------
    base : Routing
        The routing as designed.
    rate : float
        Rotation per arc length [rad/m].
    """

    rate: Annotated[float, Quantity(unit="rad/m", in_file=False)]
    kind: ClassVar[str] = "twisted"

    def _turn(self, end: float) -> tuple[Polynomial, Polynomial]:
        return Polynomial([1.0]), Polynomial([0.0, self.rate])


@dataclass(frozen=True)
class MisplacedRouting(TurnedRouting):
    """Another routing whose holes are farther from the backbone and turned about it, linearly from base to end.

    At ``x = s / end`` the position of the other routing is multiplied by ``factor_base + (factor_end - factor_base) x``
    and turned by ``angle_base + (angle_end - angle_base) x``.

    Attributes
    ----------
    base : Routing
        The routing as designed.
    factor_base, factor_end : float
        Factors on the distance from the backbone at the base plate and at the end [1].
    angle_base, angle_end : float
        Angles from where they are designed, from +x towards +y, at the base plate and at the end [rad].
    """

    factor_base: Factor = 1.0
    factor_end: Factor = 1.0
    angle_base: Radians = 0.0
    angle_end: Radians = 0.0
    kind: ClassVar[str] = "misplaced"

    def _turn(self, end: float) -> tuple[Polynomial, Polynomial]:
        growth, turn = (self.factor_end - self.factor_base) / end, (self.angle_end - self.angle_base) / end
        return Polynomial([self.factor_base, growth]), Polynomial([self.angle_base, turn])


def hole_count_text(found: int, needed: int) -> tuple[str, str]:
    """The value found and what is allowed, where a list has other holes than the number that is needed."""
    text = f"{needed} are needed: one in the base plate and one in every disk up to the tendon's end"
    return count(found, "hole"), text


#: Every routing that ``robot.toml`` may name.
ROUTINGS: dict[str, type[Routing]] = {
    r.kind: r
    for r in (ParallelRouting, HelicalRouting, VaryingHelicalRouting, ConvergingRouting, PointsRouting)
}
