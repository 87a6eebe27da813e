"""How tension passes along all tendons of a substep, as functions of flat arrays: Capstan, and any other law."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.friction import TendonLaw

Array = NDArray[np.float64]
Index = NDArray[np.int_]


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


class Transfer(NamedTuple):
    """Tensions of the segments, and their derivatives.

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


class CapstanTransfer:
    """Constant coefficients without adhesion: ``T = T_base exp(-sum of s mu theta)``.

    Parameters
    ----------
    tendons
        By robot.
    """

    def __init__(self, tendons: Sequence[TendonsInSubstep]) -> None:
        q, r, k = (sum(getattr(t, name) for t in tendons) for name in ("segments", "angles", "holes"))
        c = sum(len(t.driven) for t in tendons)
        #: Holes before each segment, shape (q, r).
        self._before = np.zeros((q, r))
        self._friction, self._incidence = np.zeros(r), np.zeros((r, k))
        self._base, self._owner = np.zeros((2, q)), np.zeros((q, c))
        segment = angle = hole = base = 0
        for own in tendons:
            n = own.law.shape[1]
            incidence, every = own.law.law.hole_incidence(n), np.tri(n, n - 1, -1)
            given = own.tension.copy()
            given[:, own.driven] = 0.0
            for i, tendon in enumerate(own.which):
                segments, angles = slice(segment, segment + n), slice(angle, angle + n - 1)
                self._before[segments, angles] = every
                self._friction[angles] = own.law.parameters.friction[tendon]
                columns = incidence[:, own.frictional[i]]
                self._incidence[angles, hole : hole + columns.shape[1]] = columns
                self._base[:, segments] = given[:, i, None]
                if i in own.driven:
                    self._owner[segments, base] = 1.0
                    base += 1
                segment, angle, hole = segments.stop, angles.stop, hole + columns.shape[1]
        self._holes, self._unknown = k, c
        self._change = self._base[1] - self._base[0]
        #: Friction of each mobilisation that acts at one hole alone, by which columns are picked.
        single = (self._incidence != 0.0).sum(axis=0) == 1
        self._single = self._incidence.argmax(axis=0) if bool(single.all()) else None

    def _at_holes(self, values: Array) -> Array:
        """Values of the mobilisations at the holes."""
        if self._single is None:
            return np.asarray(self._incidence @ values)
        found = np.zeros(len(self._friction))
        found[self._single] = values
        return found

    def _given(self, factor: float, z: Array) -> Array:
        """Tension at the base of each segment's tendon [N]."""
        given = self._base[0] + factor * self._change
        return given + self._owner @ z[self._holes :] if self._unknown else given

    def derivatives(self, factor: float, z: Array, angles: Array) -> Transfer:
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
        acting = self._at_holes(z[: self._holes]) * self._friction
        ratio = np.exp(-(self._before @ (acting * angles)))
        tension = self._given(factor, z) * ratio
        passed = -tension[:, None] * self._before
        by = passed * (self._friction * angles)
        by = by @ self._incidence if self._single is None else by[:, self._single]
        if self._unknown:
            by = np.concatenate((by, ratio[:, None] * self._owner), axis=1)
        return Transfer(tension, passed * acting, by, ratio * self._change)


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
        self._places: list[_Places] = []
        segment = angle = hole = 0
        base = self._holes
        for own in tendons:
            self._places.append(_Places.of(own, segment, angle, hole, base))
            segment, angle, hole = segment + own.segments, angle + own.angles, hole + own.holes
            base += len(own.driven)

    def derivatives(self, factor: float, z: Array, angles: Array) -> Transfer:
        """As of `CapstanTransfer`."""
        q, r = self._size
        found = Transfer(
            np.zeros(q), np.zeros((q, r)), np.zeros((q, self._holes + self._unknown)), np.zeros(q)
        )
        for at in self._places:
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


class _Places(NamedTuple):
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
    def of(cls, tendons: TendonsInSubstep, segment: int, angle: int, hole: int, base: int) -> _Places:
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
