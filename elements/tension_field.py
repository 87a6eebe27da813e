"""Tensions along all tendons with what follows from them, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.capstan import HoleSlopes, Slopes

Array = NDArray[np.float64]


class TensionDerivatives(NamedTuple):
    """Derivatives of the tensions along all tendons.

    Attributes
    ----------
    d_length : ndarray, shape (m, n, n)
        By the segments' lengths [N/m].
    d_angle : ndarray, shape (m, n, n-1)
        By the turning angles [N/rad].
    d_base : ndarray, shape (m, n)
        By the tension at the base [1].
    by_mobilisation : ndarray, shape (m, n, g)
        By the mobilisations, where these are independent unknowns [N].
    """

    d_length: Array
    d_angle: Array
    d_base: Array
    by_mobilisation: Array


@dataclass(slots=True, eq=False)
class TensionField:
    """Tensions along all tendons, and their derivatives, which are computed when first used.

    Attributes
    ----------
    tension : ndarray, shape (m, n)
        [N].
    released_length : ndarray, shape (m, n)
        Released length of each segment, ``L / (1 + T0/EA) - l / (1 + T/EA)`` with the pretension ``T0`` [m].
    slip, mobilisation : ndarray, shape (m, g)
        As they would be committed.
    released_d_length, released_d_tension : ndarray, shape (m, n)
        Of the released lengths, with respect to its own length [1] and its own tension [m/N].
    slip_rate : ndarray, shape (m, g), or None
        Rate of the slips [m/s]; None where no friction law depends on it.
    time : float
        [s].
    depends_on_length : bool
        Whether the tensions change with the segments' lengths; where not, `d_length` is zero.
    derive : callable
        Gives `derivatives`.
    at_holes : callable or None
        Gives the derivatives hole by hole, see `tdcr_fe.elements.capstan.HoleSlopes`; None where the tension behind a
        hole depends on more than that before it, its angle and its mobilisation.
    """

    tension: Array
    released_length: Array
    slip: Array
    mobilisation: Array
    released_d_length: Array
    released_d_tension: Array
    slip_rate: Array | None
    time: float
    depends_on_length: bool
    derive: Callable[[], TensionDerivatives]
    at_holes: Slopes | None = None
    _derivatives: TensionDerivatives | None = field(default=None, init=False)
    _hole_slopes: HoleSlopes | None = field(default=None, init=False)

    @property
    def base_slip(self) -> Array:
        """Tendon pulled in at the base plate, ``u_0`` [m], shape (m,)."""
        return np.asarray(self.released_length.sum(axis=1))

    @property
    def derivatives(self) -> TensionDerivatives:
        """Of the tensions."""
        if self._derivatives is None:
            self._derivatives = self.derive()
        return self._derivatives

    @property
    def hole_slopes(self) -> HoleSlopes | None:
        """Of the tensions hole by hole; None where `at_holes` is."""
        if self._hole_slopes is None and self.at_holes is not None:
            self._hole_slopes = self.at_holes()
        return self._hole_slopes

    @property
    def d_length(self) -> Array:
        """Of the tensions with respect to the segments' lengths [N/m], shape (m, n, n)."""
        return self.derivatives.d_length

    @property
    def d_angle(self) -> Array:
        """Of the tensions with respect to the turning angles [N/rad], shape (m, n, n-1)."""
        return self.derivatives.d_angle

    @property
    def d_base(self) -> Array:
        """Of the tensions with respect to the tension at the base [1], shape (m, n)."""
        slopes = self.hole_slopes
        return self.derivatives.d_base if slopes is None else slopes.by_base

    @property
    def by_mobilisation(self) -> Array:
        """Of the tensions with respect to the mobilisations, where these are unknowns [N], shape (m, n, g)."""
        return self.derivatives.by_mobilisation
