"""The volume of the states that explain the readings: a term of the misfit of a frame.

Where the derivatives ``H`` of the readings vary with the unknowns, the least misfit is biased: it prefers states in
which the readings change much, since smaller errors explain them there. The states around it that explain them as well
fill a volume proportional to ``det(H P H' + R)^-1/2``, so that the misfit has the term ``log det(H P H' + R)`` beside
it (Laplace's method). It is linear here: its slope is that of a prior with another mean.

The slope is a sum over the directions in which the readings are informative, and each of them takes a load step. It
changes slowly from frame to frame, so a frame renews one direction or two, or none where it took long.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.estimate.frame import Solved

Array = NDArray[np.float64]

#: The readings are informative in a direction in which their variance is more than this many times that of their noise.
INFORMATIVE = 2.0


@dataclass(frozen=True, eq=False)
class Volume:
    """Slope of ``log det(H P H' + R)`` by the unknowns, as of the last frames."""

    slopes: tuple[Array, ...] = ()  # By direction, most informative last, each of shape (n,)
    oldest: int = 0  # Of them, the one to be renewed next

    def change_of_mean(self, covariance: Array) -> Array:
        """Of the prior that has this slope, shape (n,); ``covariance``: of the prior, shape (n, n)."""
        return -0.5 * covariance @ sum(self.slopes, np.zeros(len(covariance)))

    def renewed(self, solved: Solved, covariance: Array) -> Volume:
        """With one direction, or those that are new, as in a solved frame; ``covariance``: of its prior."""
        jacobian = solved.jacobian
        variances, directions = np.linalg.eigh(jacobian @ covariance @ jacobian.T + np.eye(len(jacobian)))
        weights = (directions / np.sqrt(variances)).T[variances > INFORMATIVE]
        slopes = list(self.slopes[: len(weights)])
        for k, weight in enumerate(weights):
            if k == self.oldest % len(weights) or k >= len(slopes):
                slopes[k : k + 1] = [_slope(solved, covariance, weight)]
        return Volume(tuple(slopes), (self.oldest + 1) % max(1, len(weights)))


def _slope(solved: Solved, covariance: Array, weight: Array) -> Array:
    """What a direction of the readings adds to the slope, shape (n,).

    It is taken over one standard deviation of the prior, so that holes between stick and slip count with their
    probability; and it is one over a standard deviation at most, since at such a hole it may be any.
    """
    jacobian = solved.jacobian
    near = solved.frame.solved(solved.unknowns + covariance @ jacobian.T @ weight, solved)
    if near is None:
        return np.zeros(len(covariance))
    slope = 2.0 * weight @ (near.jacobian - jacobian)
    return np.asarray(slope / max(1.0, math.sqrt(float(slope @ covariance @ slope))))
