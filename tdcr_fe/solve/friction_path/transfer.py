"""Tensions of all segments in a substep, of all tendons one after the other.

They are functions of mobilisations, turning angles and tensions at the base.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.compiled import compilable
from tdcr_fe.elements.capstan import transfer_tension
from tdcr_fe.elements.friction import TendonLaw

Array = NDArray[np.float64]
Index = NDArray[np.int_]


class TendonsInSubstep(NamedTuple):
    """Tendons of one robot that are under tension at either end of a substep."""

    law: TendonLaw
    which: Index  # Their numbers, shape (m,)
    frictional: NDArray[np.bool_]  # (m, g): Which of their mobilisations are unknowns
    driven: Index  # Which of them are driven by displacement; their tensions at the base are unknown
    tension: Array  # (2, m): At the base, at both ends [N]

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


class Tensions(NamedTuple):
    """Tensions of the segments at given unknowns and turning angles, and their derivatives."""

    tension: Array  # (q,): [N]
    by_angle: Array  # (q, r): By the turning angles [N/rad]
    by_unknown: Array  # (k + c, q): By the mobilisations [N], and by unknown tensions at the base [1]
    by_load: Array  # (q,): By the load factor, through the given tensions at the base [N]


class Transfer(NamedTuple):
    """How the tensions follow, by the law of `tdcr_fe.elements.capstan` with constant coefficients."""

    holes: int  # Number of mobilisations; unknown tensions at the base follow
    holes_before: Array  # (q, r): Ones where a hole comes before a segment, on the way from the base
    friction: Array  # (r,): Coefficients of friction of the holes [1]
    adhesion: Array  # (r,): Their adhesion [N]; (0,) where there is none
    incidence: Array  # (k, r): From the mobilisations to the holes
    # (k, q): Ones where the hole of a mobilisation comes before a segment; no rows where any acts at several
    # holes
    behind: Array
    at_hole: Index  # (k,): The hole of each mobilisation; none where any acts at several
    # (m,): Tension at the base of every tendon at the start of the substep, and its change in it [N]; zero where
    # they are unknown
    base_tension: Array
    base_change: Array  # as `base_tension`
    base_of_tendon: Array  # (c, m): Ones where an unknown tension is that at the base of a tendon
    of_segment: Index  # (q,): The tendon of every segment
    longest: int  # Segments of the longest tendon
    # Places of the segments (q,) and holes (r,) in arrays for m tendons as long as it
    segments: Index
    angles: Index

    @classmethod
    def of(cls, tendons: Sequence[TendonsInSubstep]) -> Transfer:
        """For some tendons, by robot."""
        q, r, k = (sum(getattr(t, name) for t in tendons) for name in ("segments", "angles", "holes"))
        m, c = sum(len(t.which) for t in tendons), sum(len(t.driven) for t in tendons)
        longest = max(t.law.shape[1] for t in tendons)
        holes_before, (friction, adhesion), incidence = np.zeros((q, r)), np.zeros((2, r)), np.zeros((k, r))
        base_tension, base_of_tendon = np.zeros((2, m)), np.zeros((c, m))
        of_segment, segments, angles = np.zeros(q, dtype=int), np.zeros(q, dtype=int), np.zeros(r, dtype=int)
        segment = angle = hole = base = tendon = 0
        for own in tendons:
            n = own.law.shape[1]
            at_holes, before = own.law.law.hole_incidence(n), np.tri(n, n - 1, -1)
            for i, number in enumerate(own.which):
                along, through = slice(segment, segment + n), slice(angle, angle + n - 1)
                holes_before[along, through] = before
                friction[through] = own.law.coefficients[number]
                adhesion[through] = 0.0 if own.law.adhesion is None else own.law.adhesion[number]
                rows = at_holes[:, own.frictional[i]].T
                incidence[hole : hole + len(rows), through] = rows
                of_segment[along], segments[along] = tendon, tendon * longest + np.arange(n)
                angles[through] = tendon * (longest - 1) + np.arange(n - 1)
                if i in own.driven:
                    base_of_tendon[base, tendon] = 1.0
                    base += 1
                else:
                    base_tension[:, tendon] = own.tension[:, i]
                segment, angle, hole, tendon = along.stop, through.stop, hole + len(rows), tendon + 1
        single = bool(((incidence != 0.0).sum(axis=1) == 1).all())
        at_hole = incidence.argmax(axis=1) if single else np.zeros(0, dtype=int)
        behind = np.ascontiguousarray(holes_before.T[at_hole])
        first, last = base_tension
        adhesion = adhesion if adhesion.any() else adhesion[:0]
        along_holes = k, holes_before, friction, adhesion, incidence, behind, at_hole
        bases = first, last - first, base_of_tendon, of_segment
        return cls(*along_holes, *bases, longest, segments, angles)


@compilable
def tensions_at(transfer: Transfer, factor: float, z: Array, angles: Array) -> Tensions:
    """Tensions of the segments, and their derivatives.

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
    holes, adhesive = transfer.holes, len(transfer.adhesion) > 0
    turned, mobilised = transfer.friction * angles, z[:holes].dot(transfer.incidence)
    base = transfer.base_tension + factor * transfer.base_change
    if len(z) > holes:
        base = base + z[holes:].dot(transfer.base_of_tendon)
    exponent = np.zeros((len(base), transfer.longest - 1))
    exponent.reshape(-1)[transfer.angles] = -mobilised * turned
    drop = np.zeros((len(base), exponent.shape[1] if adhesive else 0))
    if adhesive:
        drop.reshape(-1)[transfer.angles] = mobilised * transfer.adhesion
    found = transfer_tension(base, exponent, drop)
    by_base, behind = found.by_base.reshape(-1)[transfer.segments], found.by_base[:, 1:]
    # By exponents and mobilisations as if they were tensions at the base.
    by_exponent = (found.by_exponent / behind).reshape(-1)[transfer.angles]
    by_mobilisation = -turned * by_exponent
    if adhesive:
        by_mobilisation -= transfer.adhesion * (found.by_drop / behind).reshape(-1)[transfer.angles]
    by_angle = (-mobilised * transfer.friction * by_exponent) * transfer.holes_before
    by_angle *= by_base.reshape(-1, 1)
    by_unknown = np.empty((len(z), len(by_base)))
    if transfer.at_hole.size:
        by_unknown[:holes] = by_mobilisation[transfer.at_hole].reshape(-1, 1) * transfer.behind
    else:
        by_unknown[:holes] = (by_mobilisation * transfer.incidence).dot(transfer.holes_before.T)
    by_unknown[:holes] *= by_base
    if len(z) > holes:
        by_unknown[holes:] = transfer.base_of_tendon[:, transfer.of_segment] * by_base
    tension = found.tension.reshape(-1)[transfer.segments]
    return Tensions(tension, by_angle, by_unknown, by_base * transfer.base_change[transfer.of_segment])
