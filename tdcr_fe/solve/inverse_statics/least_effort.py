"""Bounded change of tensions that meets a linearised target with the least effort."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Effort:
    """Which tensions are preferred among those that reach a target.

    Attributes
    ----------
    lower, upper : ndarray, shape (m,)
        Bounds [N].
    reference : ndarray, shape (m,)
        Tensions of no effort: zero, or those at the beginning of the step [N].
    scale : float
        Tension of effort 1 [N].
    """

    lower: Array
    upper: Array
    reference: Array
    scale: float

    def of(self, tensions: Array) -> float:
        """Sum of the squares of the tensions from the reference, in units of the scale [1]."""
        return float(np.sum(((tensions - self.reference) / self.scale) ** 2))

    def around(self, tensions: Array) -> Effort:
        """The same with other tensions of no effort [N]: the smallest change from them is preferred."""
        return replace(self, reference=tensions)

    def step(self, tensions: Array, residual: Array, jacobian: Array, weight: float, radius: float) -> Array:
        """Change of the tensions that minimises ``|r + J dT|^2 + weight^2 effort(T + dT)`` within bounds.

        Parameters
        ----------
        tensions
            T [N], shape (m,).
        residual
            r, over the length of the robot [1], shape (k,).
        jacobian
            J, shape (k, m) [1/N].
        weight
            Of the effort [1].
        radius
            Largest change of a tension [N].
        """
        low = np.clip(self.lower - tensions, -radius, radius) / self.scale
        high = np.clip(self.upper - tensions, -radius, radius) / self.scale
        step = 0.5 * (low + high)
        free = np.flatnonzero(high - low > 1e-12)
        if free.size == 0:
            return self.scale * step
        # The stacked system keeps the condition number of J; its normal equations would square it.
        fixed = np.where(high - low > 1e-12, 0.0, step)
        columns = jacobian * self.scale
        matrix = np.vstack((columns[:, free] / weight, np.eye(free.size)))
        right = np.concatenate(
            (-(residual + columns @ fixed) / weight, ((self.reference - tensions) / self.scale)[free])
        )
        found = lsq_linear(matrix, right, (low[free], high[free]), method="bvls", max_iter=100 * free.size)
        step[free] = np.clip(found.x, low[free], high[free])
        return self.scale * step
