"""How tension passes along all tendons of a substep: by the Capstan equation, with or without adhesion.

Tensions of all segments, of all tendons one after the other, as functions of mobilisations, turning angles and tensions
at the base. `AdhesiveTransfer` goes hole by hole; `CapstanTransfer` writes out the frequent law without adhesion for
flat arrays of all tendons at once, and takes a third of the time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tdcr_fe.compiled import compilable, compiled_as
from tdcr_fe.elements import Array, Flags, Index
from tdcr_fe.elements.capstan import capstan
from tdcr_fe.elements.friction import TendonLaw


class TendonsInSubstep(NamedTuple):
    """Tendons of one robot that are under tension at either end of a substep; it may have none."""

    law: TendonLaw
    which: Index  # (m,): Numbers of these tendons
    frictional: Flags  # (m, g): Which of their mobilisations are unknowns
    # Which of them have a prescribed length wound, so that their tension at the base is unknown
    driven: Index
    tension: Array  # (2, m): Tensions at the base, at both ends of the substep [N]

    @property
    def segments(self) -> int:
        """Number of segments, padded ones included."""
        return len(self.which) * self.law.shape[1]

    @property
    def holes(self) -> int:
        """Number of frictional mobilisations."""
        return int(np.count_nonzero(self.frictional))


class Tensions(NamedTuple):
    """Tensions of the segments at given unknowns and turning angles, and their derivatives."""

    tension: Array  # (q,): [N]
    by_angle: Array  # (q, r): Derivatives by the turning angles [N/rad]
    # (k + c, q): Derivatives by the mobilisations [N], and by unknown tensions at the base [1]
    by_unknown: Array
    by_load: Array  # (q,): Derivatives by the load factor, through the given tensions at the base [N]


class CapstanTransfer(NamedTuple):
    """Constant coefficients without adhesion: ``T = T_base exp(-sum of s mu theta)``."""

    holes_before: Array  # (q, r): Ones where a hole comes before a segment, on the way from the base
    friction: Array  # (r,): Coefficients of friction of the holes [1]
    incidence: Array  # (k, r): From the mobilisations to the holes
    # (q,): Tension at the base of the segment's tendon at the start of the substep, zero where it is unknown [N]
    base_tension: Array
    base_change: Array  # (q,): Its change in the substep, zero where it is unknown [N]
    # (c, q): Ones where an unknown tension is that at the base of the segment's tendon
    base_of_segment: Array

    @classmethod
    def of(cls, tendons: Sequence[TendonsInSubstep]) -> CapstanTransfer:
        """For some tendons, by robot."""
        holes_before, incidence, base_of_segment, friction, base = [], [], [], [], []
        for own in tendons:
            m, n = len(own.which), own.law.shape[1]
            holes_before += [np.tri(n, n - 1, -1)] * m
            incidence += [own.law.hole_incidence[:, frictional].T for frictional in own.frictional]
            base_of_segment.append(np.eye(m)[own.driven].repeat(n, axis=1))
            friction.append(own.law.parameters.friction[own.which].ravel())
            given = own.tension.copy()
            given[:, own.driven] = 0.0
            base.append(given.repeat(n, axis=1))
        before, from_mobilisations = block_diagonal(holes_before), block_diagonal(incidence)
        at_base, (first, last) = block_diagonal(base_of_segment), np.concatenate(base, axis=1)
        return cls(before, np.concatenate(friction), from_mobilisations, first, last - first, at_base)


def block_diagonal(blocks: Sequence[Array]) -> Array:
    """Matrices along the diagonal of a larger one: `scipy.linalg.block_diag` in a twentieth of its time."""
    rows, columns = (np.cumsum([0, *(block.shape[k] for block in blocks)]) for k in (0, 1))
    whole = np.zeros((rows[-1], columns[-1]))
    for block, i, j in zip(blocks, rows, columns, strict=False):
        whole[i : i + len(block), j : j + block.shape[1]] = block
    return whole


@compilable
def base_tensions(transfer: CapstanTransfer, factor: float, z: Array) -> Array:
    """Tension at the base of the tendon of every segment [N], shape (q,); arguments as of `capstan_tensions`."""
    base, unknown = transfer.base_tension + factor * transfer.base_change, z[len(transfer.incidence) :]
    return base + unknown.dot(transfer.base_of_segment) if unknown.size else base


@compilable
def capstan_tensions(transfer: CapstanTransfer, factor: float, z: Array, angles: Array) -> Tensions:
    """Tensions of the segments by Capstan's equation, and their derivatives.

    Parameters
    ----------
    transfer
        How tension passes along the tendons.
    factor
        Load factor within the substep [1].
    z
        Mobilisations, then unknown tensions at the base [N], shape (k + c,).
    angles
        Turning angles [rad], shape (r,).
    """
    holes = len(transfer.incidence)
    # Friction times mobilisation, and Capstan's exponent at full mobilisation.
    acting = z[:holes].dot(transfer.incidence) * transfer.friction
    exponent = transfer.friction * angles
    ratio = np.exp(-transfer.holes_before.dot(acting * angles))
    tension = base_tensions(transfer, factor, z) * ratio
    negative = -tension
    by_angle = acting * transfer.holes_before
    by_angle *= negative.reshape(-1, 1)
    by_unknown = np.empty((len(z), len(tension)))
    by_unknown[:holes] = (exponent * transfer.incidence).dot(transfer.holes_before.T) * negative
    if holes < len(z):
        by_unknown[holes:] = transfer.base_of_segment * ratio
    return Tensions(tension, by_angle, by_unknown, ratio * transfer.base_change)


@compiled_as(capstan_tensions)
def tensions_at(
    transfer: CapstanTransfer | AdhesiveTransfer, factor: float, z: Array, angles: Array
) -> Tensions:
    """As `capstan_tensions`, by any law; compiled functions know Capstan's equation only."""
    if isinstance(transfer, AdhesiveTransfer):
        return transfer.at(factor, z, angles)
    return capstan_tensions(transfer, factor, z, angles)


@compiled_as(lambda transfer, z, tension: np.zeros(0, dtype=np.bool_))
def branches_at(transfer: CapstanTransfer | AdhesiveTransfer, z: Array, tension: Array) -> Flags:
    """See `AdhesiveTransfer.branches`; none of Capstan's equation, which is smooth."""
    return transfer.branches(z, tension) if isinstance(transfer, AdhesiveTransfer) else np.zeros(0, bool)


@compiled_as(lambda transfer, z, rate, tension, tension_rate: np.inf)
def distance_to_branch_change(
    transfer: CapstanTransfer | AdhesiveTransfer, z: Array, rate: Array, tension: Array, tension_rate: Array
) -> float:
    """See `AdhesiveTransfer.distance_to_branch_change`."""
    if isinstance(transfer, AdhesiveTransfer):
        return transfer.distance_to_branch_change(z, rate, tension, tension_rate)
    return np.inf


class AdhesiveTransfer:
    """Constant coefficients with adhesion: hole by hole, as `tdcr_fe.elements.capstan.capstan`.

    Parameters
    ----------
    tendons
        By robot.
    """

    def __init__(self, tendons: Sequence[TendonsInSubstep]) -> None:
        self._capstan = CapstanTransfer.of(tendons)
        self._holes = len(self._capstan.incidence)
        self._adhesion = np.concatenate([t.law.parameters.adhesion[t.which].ravel() for t in tendons])
        #: By robot, numbers of the segments (m, n) and of the holes (m, n-1) of its tendons.
        self._places: list[tuple[Index, Index]] = []
        segment = hole = 0
        for own in tendons:
            m, n = len(own.which), own.law.shape[1]
            segments, holes = np.arange(m * n).reshape(m, n), np.arange(m * (n - 1)).reshape(m, n - 1)
            self._places.append((segment + segments, hole + holes))
            segment, hole = segment + segments.size, hole + holes.size
        behind = np.flatnonzero(self._capstan.holes_before.any(axis=1))
        #: Segment before the hole, or the first one, of every mobilisation.
        self._before = behind[self._capstan.incidence.argmax(axis=1)] - 1

    def branches(self, z: Array, tension: Array) -> Flags:
        """Which holes hold tension back, and which segments are under tension, shape (k + q,).

        Adhesion holds tension behind a hole that is released even where there is none before it, and takes at most
        what there is where it is pulled: there the derivatives jump.
        """
        return np.concatenate((z[: self._holes] < 0.0, tension > 0.0))

    def distance_to_branch_change(self, z: Array, rate: Array, tension: Array, tension_rate: Array) -> float:
        """Part of the substep to where these change at constant rates; segments that become taut are not foreseen.

        Parameters
        ----------
        z, rate
            Unknowns and their rates, shape (k + c,).
        tension, tension_rate
            Tension and tension rate of the segments [N], shape (q,).
        """
        here, pace = z[: self._holes], rate[: self._holes]
        crossing = (here * pace < 0.0) & (tension[self._before] <= 0.0)
        falling = (tension > 0.0) & (tension_rate < 0.0)
        to_zero = -here[crossing] / pace[crossing], -tension[falling] / tension_rate[falling]
        return float(np.concatenate(to_zero).min(initial=np.inf))

    def at(self, factor: float, z: Array, angles: Array) -> Tensions:
        """Tensions of the segments and their derivatives, see `capstan_tensions`."""
        flat, q, r = self._capstan, len(self._capstan.base_tension), len(angles)
        base, mobilisation = base_tensions(flat, factor, z), z[: self._holes].dot(flat.incidence)
        at_holes = angles, mobilisation, flat.friction, self._adhesion
        tension, by_base, beyond = np.empty(q), np.empty(q), np.zeros((q, r))
        by_angle, by_mobilisation = np.empty(r), np.empty(r)
        for segments, holes in self._places:
            found, slopes = capstan(base[segments[:, 0]], *(x[holes] for x in at_holes))
            own = slopes()
            tension[segments], by_base[segments] = found, own.by_base
            beyond[segments[:, :, None], holes[:, None]] = own.chain()[:, :, 1:]
            by_angle[holes], by_mobilisation[holes] = own.by_angle, own.by_mobilisation
        by_holes = flat.incidence @ (beyond * by_mobilisation).T
        by_unknown = np.concatenate((by_holes, flat.base_of_segment * by_base))
        return Tensions(tension, beyond * by_angle, by_unknown, by_base * flat.base_change)


def tension_transfer(tendons: Sequence[TendonsInSubstep]) -> CapstanTransfer | AdhesiveTransfer:
    """The transfer of tension of some tendons, whose coefficients of friction are constant."""
    adhesive = any(t.law.adhesive[t.which].any() and t.law.has_friction for t in tendons)
    return AdhesiveTransfer(tendons) if adhesive else CapstanTransfer.of(tendons)
