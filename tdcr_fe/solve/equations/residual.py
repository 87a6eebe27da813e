"""Residual of a state under a target: unbalanced wrenches and gaps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.solve.equations.state import SolverState, Target

Array = NDArray[np.float64]


class Residual(NamedTuple):
    """Residual of a state under a target.

    Attributes
    ----------
    state : SolverState
    target : Target
    forces : tuple of TendonForces
        By robot.
    unbalanced : ndarray
        Reduced residual; zero at clamped bases, whose joints provide the reactions.
    on_bases : tuple of ndarray, shape (6,)
        By clamped robot, the wrench on its base.
    raw : ndarray
        Exudyn's residual.
    size : float
        Largest residual over its scale, prescribed displacements included [1].
    """

    state: SolverState
    target: Target
    forces: tuple[TendonForces, ...]
    unbalanced: Array
    on_bases: tuple[Array, ...]
    raw: Array
    size: float
