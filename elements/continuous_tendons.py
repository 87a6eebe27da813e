"""Tendons that follow the backbone, the classical model: their lengths and the gradients of these.

The energy of a tendon of tension ``T`` is ``T`` times its length, whose variation is the distributed wrench of the
paper's Eq. 9 together with the point wrench where the tendon ends (derivation: docs/theory.md, section
"Tendons that follow the backbone").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.elements.backbone import POINTS, WEIGHTS
from tdcr_fe.elements.poses import cross


@dataclass(frozen=True)
class ContinuousTendons:
    """Tendons that follow the backbone."""

    # (m, E, 4, 3): Position and derivative of position along arc length, in beam axes, at `gauss_arc_lengths`
    # [m, 1]
    offset: Array
    slope: Array  # as `offset`
    weight: Array  # (m, E): One where the tendon runs along the element, zero beyond its end

    def evaluate(self, twists: Array, lengths: Array) -> tuple[Array, Array]:
        """Length of every tendon and its gradient.

        Parameters
        ----------
        twists
            Of the elements, shape (..., E, 6).
        lengths
            Of the elements [m], shape (E,).

        Returns
        -------
        length : ndarray, shape (m, ...)
            [m].
        gradient : ndarray, shape (m, ..., E, 6)
            With respect to the twists.
        """
        stretch, by_strain = self.along((twists / lengths[:, None])[..., None, :])
        length = (WEIGHTS * stretch * lengths[:, None]).sum(axis=(-1, -2))
        return length, (WEIGHTS[:, None] * by_strain).sum(axis=-2)

    def along(self, strain: Array) -> tuple[Array, Array]:
        """Length of every tendon by that of the backbone, and its gradient with respect to the strain.

        Shapes (m, ..., E, 4) and (m, ..., E, 4, 6), for strains at the Gauss points (..., E, 4 or 1, 6).
        """
        lead = (slice(None),) + (None,) * (strain.ndim - 3)
        offset, slope, weight = self.offset[lead], self.slope[lead], self.weight[lead][..., None]
        bend = np.broadcast_to(strain[..., 3:], (*strain.shape[:-2], len(POINTS), 3))
        e = strain[..., :3] + cross(bend, offset) + slope
        norm = np.sqrt(np.einsum("...i,...i->...", e, e))
        t = e * (weight / norm)[..., None]
        by_strain = np.concatenate((t, cross(np.broadcast_to(offset, t.shape), t)), axis=-1)
        return weight * norm, by_strain
