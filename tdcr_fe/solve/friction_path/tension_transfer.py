"""How tension passes along all tendons of a substep: by the Capstan equation, or by any other law.

Tensions of all segments, of all tendons one after the other, as functions of mobilisations, turning angles and tensions
at the base. `LawTransfer` asks `tdcr_fe.elements.friction.TendonLaw` for them; `CapstanTransfer` writes out the most
frequent law for flat arrays of all tendons at once, and takes a third of the time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.friction import TendonLaw

Array = NDArray[np.float64]
Index = NDArray[np.int_]
Flags = NDArray[np.bool_]


class TendonsInSubstep(NamedTuple):
    """Tendons of one robot that are under tension at either end of a substep.

    Attributes
    ----------
    law : TendonLaw
    which : ndarray of int
        Their numbers, shape (m,).
    frictional : ndarray of bool, shape (m, g)
        Which of their mobilisations are unknowns.
    driven : ndarray of int
        Which of them are driven by displacement; their tensions at the base are unknown.
    tension : ndarray, shape (2, m)
        At the base, at both ends [N].
    """

    law: TendonLaw
    which: Index
    frictional: NDArray[np.bool_]
    driven: Index
    tension: Array

    @property
    def segments(self) -> int:
        """Number of segments, padded ones included."""
        return len(self.which) * self.law.shape[1]

    @property
    def angles(self) -> int:
        """Number of turning angles, padded ones included."""
        return len(self.which) * (self.law.shape[1] - 1)

    @property
    def holes(self) -> int:
        """Number of frictional mobilisations."""
        return int(np.count_nonzero(self.frictional))


class Transfer(Protocol):
    """Tensions of the segments at given unknowns and angles, and their derivatives as linear maps."""

    @property
    def tension(self) -> Array:
        """Of the segments [N], shape (q,)."""
        ...

    @property
    def by_load(self) -> Array:
        """Derivatives by the load factor, through the given tensions at the base [N], shape (q,)."""
        ...

    def by_angles(self, change: Array) -> Array:
        """Change of the tensions by one of the turning angles [N], (r,) to (q,) or (r, j) to (q, j)."""
        ...

    def by_unknowns(self, change: Array) -> Array:
        """Change of the tensions by one of the mobilisations and unknown tensions at the base [N], (k + c,) to (q,)."""
        ...

    def rows(self, which: Index) -> Array:
        """Derivatives of the tensions by some of these unknowns, in ascending order, shape (i, q)."""
        ...


class CapstanTensions(NamedTuple):
    """Tensions by the Capstan equation, and their derivatives, see `Transfer`.

    Attributes
    ----------
    law : CapstanTransfer
    tension : ndarray, shape (q,)
        [N].
    ratio : ndarray, shape (q,)
        Tension over that at the base of the tendon [1].
    acting_friction : ndarray, shape (r,)
        Coefficient of friction times mobilisation [1].
    full_exponent : ndarray, shape (r,)
        Coefficient of friction times turning angle: Capstan's exponent at full mobilisation [1].
    """

    law: CapstanTransfer
    tension: Array
    ratio: Array
    acting_friction: Array
    full_exponent: Array

    @property
    def by_load(self) -> Array:
        """See `Transfer.by_load`."""
        return self.ratio * self.law.base_change

    def by_angles(self, change: Array) -> Array:
        """See `Transfer.by_angles`."""
        if change.ndim == 1:
            return -self.tension * self.law.holes_before.dot(self.acting_friction * change)
        found = self.law.summed_before_segments(self.acting_friction[:, None] * change)
        found *= -self.tension[:, None]
        return found

    def by_unknowns(self, change: Array) -> Array:
        """See `Transfer.by_unknowns`."""
        law, k = self.law, self.law.holes
        found = -self.tension * law.holes_before.dot(self.full_exponent * law.at_holes(change[:k]))
        return found + self.ratio * law.base_of_segment.dot(change[k:]) if law.unknown else found

    def rows(self, which: Index) -> Array:
        """See `Transfer.rows`."""
        law = self.law
        count = int(np.count_nonzero(which < law.holes)) if law.unknown else len(which)
        mobilised = which[:count]
        if law.hole_of_mobilisation is None:
            found = (law.holes_before @ (self.full_exponent[:, None] * law.incidence[:, mobilised])).T
        else:
            own = law.hole_of_mobilisation[mobilised]
            found = law.segments_behind.take(own, axis=0)
            found *= self.full_exponent[own][:, None]
        found *= -self.tension
        if count == len(which):
            return found
        return np.concatenate((found, self.ratio * law.base_of_segment.T[which[count:] - law.holes]))


class CapstanTransfer:
    """Constant coefficients without adhesion: ``T = T_base exp(-sum of s mu theta)``.

    Parameters
    ----------
    tendons
        By robot.

    Attributes
    ----------
    holes, unknown : int
        Numbers of mobilisations and of unknown tensions at the base.
    holes_before : ndarray, shape (q, r)
        Ones where a hole comes before a segment, on the way from the base.
    segments_behind : ndarray, shape (r, q)
        The same, transposed.
    incidence : ndarray, shape (r, k)
        From the mobilisations to the holes.
    hole_of_mobilisation : ndarray of int, shape (k,), or None
        The hole at which each mobilisation acts; None where any acts at several holes.
    base_of_segment : ndarray, shape (q, c)
        Ones where an unknown tension is that at the base of the segment's tendon.
    base_change : ndarray, shape (q,)
        Change of the tension at the base of the segment's tendon in the substep [N]; zero where it is unknown.
    """

    def __init__(self, tendons: Sequence[TendonsInSubstep]) -> None:
        q, r, k = (sum(getattr(t, name) for t in tendons) for name in ("segments", "angles", "holes"))
        c = sum(len(t.driven) for t in tendons)
        self.holes_before = np.zeros((q, r))
        self._friction, self.incidence = np.zeros(r), np.zeros((r, k))
        self._base, self.base_of_segment = np.zeros((2, q)), np.zeros((q, c))
        #: By robot, its segments, its angles, the number of its tendons, and holes before the segments of each.
        self._robots: list[tuple[slice, slice, int, Array]] = []
        segment = angle = hole = base = 0
        for own in tendons:
            n = own.law.shape[1]
            incidence, every = own.law.law.hole_incidence(n), np.tri(n, n - 1, -1)
            here = slice(segment, segment + own.segments), slice(angle, angle + own.angles)
            self._robots.append((*here, len(own.which), every))
            given = own.tension.copy()
            given[:, own.driven] = 0.0
            for i, tendon in enumerate(own.which):
                segments, angles = slice(segment, segment + n), slice(angle, angle + n - 1)
                self.holes_before[segments, angles] = every
                self._friction[angles] = own.law.parameters.friction[tendon]
                columns = incidence[:, own.frictional[i]]
                self.incidence[angles, hole : hole + columns.shape[1]] = columns
                self._base[:, segments] = given[:, i, None]
                if i in own.driven:
                    self.base_of_segment[segments, base] = 1.0
                    base += 1
                segment, angle, hole = segments.stop, angles.stop, hole + columns.shape[1]
        self.holes, self.unknown = k, c
        self.segments_behind: Array = np.ascontiguousarray(self.holes_before.T)
        self.base_change = self._base[1] - self._base[0]
        single = (self.incidence != 0.0).sum(axis=0) == 1
        self.hole_of_mobilisation = self.incidence.argmax(axis=0) if bool(single.all()) else None

    def at_holes(self, values: Array) -> Array:
        """Values of the mobilisations at the holes, (k,) to (r,)."""
        if self.hole_of_mobilisation is None:
            return np.asarray(self.incidence @ values)
        found = np.zeros(len(self._friction))
        found[self.hole_of_mobilisation] = values
        return found

    def summed_before_segments(self, at_holes: Array) -> Array:
        """Sums over the holes before each segment, (r, j) to (q, j)."""
        found = np.empty((len(self.holes_before), at_holes.shape[1]))
        for segments, angles, count, every in self._robots:
            own = at_holes[angles].reshape(count, every.shape[1], -1)
            np.matmul(every, own, out=found[segments].reshape(count, every.shape[0], -1))
        return found

    @staticmethod
    def regimes(z: Array, tension: Array) -> None:
        """See `LawTransfer.regimes`: Capstan's equation is smooth."""

    @staticmethod
    def distance_to_regime_change(z: Array, rate: Array, tension: Array, tension_rate: Array) -> float:
        """See `LawTransfer.distance_to_regime_change`."""
        return np.inf

    def at(self, factor: float, z: Array, angles: Array) -> CapstanTensions:
        """Tensions of the segments, and their derivatives.

        Parameters
        ----------
        factor
            Load factor within the substep [1].
        z
            Mobilisations, then unknown tensions at the base [N], shape (k + c,).
        angles
            Turning angles [rad], shape (r,).
        """
        acting = self.at_holes(z[: self.holes]) * self._friction
        ratio = np.exp(-self.holes_before.dot(acting * angles))
        given = self._base[0] + factor * self.base_change
        if self.unknown:
            given += self.base_of_segment.dot(z[self.holes :])
        return CapstanTensions(self, given * ratio, ratio, acting, self._friction * angles)


class LawTensions(NamedTuple):
    """Tensions by any law, and their derivatives, see `Transfer`.

    Attributes
    ----------
    tension : ndarray, shape (q,)
        [N].
    by_angle : ndarray, shape (q, r)
        By the turning angles [N/rad].
    by_unknown : ndarray, shape (q, k + c)
        By the mobilisations [N], and by unknown tensions at the base [1].
    by_load : ndarray, shape (q,)
        By the load factor, through the given tensions at the base [N].
    """

    tension: Array
    by_angle: Array
    by_unknown: Array
    by_load: Array

    def by_angles(self, change: Array) -> Array:
        """See `Transfer.by_angles`."""
        return self.by_angle @ change

    def by_unknowns(self, change: Array) -> Array:
        """See `Transfer.by_unknowns`."""
        return self.by_unknown @ change

    def rows(self, which: Index) -> Array:
        """See `Transfer.rows`."""
        return self.by_unknown.T[which]


class LawTransfer:
    """Any law that has no slip rates, as with adhesion.

    Parameters
    ----------
    tendons
        By robot.
    """

    def __init__(self, tendons: Sequence[TendonsInSubstep]) -> None:
        self._holes = sum(t.holes for t in tendons)
        self._unknown = sum(len(t.driven) for t in tendons)
        self._size = sum(t.segments for t in tendons), sum(t.angles for t in tendons)
        self._positions: list[_Positions] = []
        segment = angle = hole = 0
        base, before = self._holes, []
        for own in tendons:
            self._positions.append(_Positions.of(own, segment, angle, hole, base))
            tendon, group = np.nonzero(own.frictional)
            before.append(segment + tendon * own.law.shape[1] + (group if own.law.each_hole else 0))
            segment, angle, hole = segment + own.segments, angle + own.angles, hole + own.holes
            base += len(own.driven)
        #: Segment before the hole, or the first one, of every mobilisation.
        self._before: Index = np.concatenate(before)

    def regimes(self, z: Array, tension: Array) -> Flags:
        """Which holes hold tension back, and which segments are under tension, shape (k + q,).

        Adhesion holds tension behind a hole that is released even where there is none before it, and takes at most
        what there is where it is pulled: there the derivatives jump.
        """
        return np.concatenate((z[: self._holes] < 0.0, tension > 0.0))

    def distance_to_regime_change(self, z: Array, rate: Array, tension: Array, tension_rate: Array) -> float:
        """Part of the substep to where these change at constant rates; segments that become taut are not foreseen.

        Parameters
        ----------
        z, rate
            Unknowns and their rates, shape (k + c,).
        tension, tension_rate
            Of the segments [N], shape (q,).
        """
        here, pace = z[: self._holes], rate[: self._holes]
        crossing = (here * pace < 0.0) & (tension[self._before] <= 0.0)
        falling = (tension > 0.0) & (tension_rate < 0.0)
        to_zero = np.concatenate(
            (-here[crossing] / pace[crossing], -tension[falling] / tension_rate[falling])
        )
        return float(to_zero.min(initial=np.inf))

    def at(self, factor: float, z: Array, angles: Array) -> LawTensions:
        """As of `CapstanTransfer`."""
        q, r = self._size
        found = LawTensions(
            np.zeros(q), np.zeros((q, r)), np.zeros((q, self._holes + self._unknown)), np.zeros(q)
        )
        for at in self._positions:
            own, which, (m, n) = at.tendons, at.tendons.which, at.tendons.law.shape
            change = own.tension[1] - own.tension[0]
            tension = own.tension[0] + factor * change
            tension[own.driven] = z[at.base]
            change[own.driven] = 0.0
            values = np.zeros(m), np.zeros((m, n)), np.zeros((m, n - 1)), np.zeros((m, own.law.groups))
            mobilisation = np.zeros(own.frictional.shape)
            mobilisation[own.frictional] = z[at.holes]
            values[0][which], values[3][which] = tension, mobilisation
            values[2][which] = angles[at.angles]
            field = own.law.field(*values)
            by = field.derivatives
            by_base = by.d_base[which]
            found.tension[at.segments] = field.tension[which]
            found.by_angle[at.segments[:, :, None], at.angles[:, None, :]] = by.d_angle[which]
            tendon, group = np.nonzero(own.frictional)
            by_hole = by.by_mobilisation[which][tendon, :, group]
            found.by_unknown[at.segments[tendon], at.holes[:, None]] = by_hole
            found.by_unknown[at.segments[own.driven], at.base[:, None]] = by_base[own.driven]
            found.by_load[at.segments] = by_base * change[:, None]
        return found


class _Positions(NamedTuple):
    """Where the numbers of one robot's tendons stand in the arrays of a `LawTransfer`.

    Attributes
    ----------
    tendons : TendonsInSubstep
    segments : ndarray of int, shape (m, n)
    angles : ndarray of int, shape (m, n-1)
    holes : ndarray of int, shape (k,)
        Frictional mobilisations.
    base : ndarray of int, shape (c,)
        Unknown tensions at the base.
    """

    tendons: TendonsInSubstep
    segments: Index
    angles: Index
    holes: Index
    base: Index

    @classmethod
    def of(cls, tendons: TendonsInSubstep, segment: int, angle: int, hole: int, base: int) -> _Positions:
        """Those of tendons whose first numbers are given."""
        m, n = len(tendons.which), tendons.law.shape[1]
        return cls(
            tendons,
            segment + np.arange(m * n).reshape(m, n),
            angle + np.arange(m * (n - 1)).reshape(m, n - 1),
            hole + np.arange(tendons.holes),
            base + np.arange(len(tendons.driven)),
        )


def tension_transfer(tendons: Sequence[TendonsInSubstep]) -> CapstanTransfer | LawTransfer:
    """The transfer of tension of some tendons."""
    adhesive = any(np.any(t.law.parameters.adhesion[t.which] > 0.0) and t.law.has_friction for t in tendons)
    return LawTransfer(tendons) if adhesive else CapstanTransfer(tendons)
