"""Parameters of the tendons of a robot, as arrays by tendon and segment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.coefficients import CoefficientLaw

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TendonParameters:
    """Parameters of all tendons of one robot; shorter tendons are padded at the end.

    Attributes
    ----------
    lengths : ndarray, shape (m, n)
        Length of every segment in the unloaded state, zero where padded [m].
    mask : ndarray of bool, shape (m, n)
        Which segments exist.
    friction : ndarray, shape (m, n-1)
        Friction coefficient at every hole, zero at and beyond the anchor [1].
    adhesion : ndarray, shape (m, n-1)
        Tension drop at every hole that does not grow with the tension [N].
    compliance : ndarray, shape (m,)
        ``1 / EA`` of the tendon, zero where inextensible [1/N].
    pretension : ndarray, shape (m,)
        Tension in the unloaded state where the displacement at the base is zero [N].
    laws : tuple of CoefficientLaw or None
        Law of each tendon's coefficients of friction, used instead of ``friction``; None, or an empty tuple, where
        the coefficients are constant.
    """

    lengths: Array
    mask: NDArray[np.bool_]
    friction: Array
    adhesion: Array
    compliance: Array
    pretension: Array
    laws: tuple[CoefficientLaw | None, ...] = ()

    @property
    def material(self) -> Array:
        """Length of every segment's tendon without tension, where the displacement at the base is zero [m], (m, n)."""
        return self.lengths / (1.0 + self.compliance * self.pretension)[:, None]
