"""States of a scene in the quasi-static solver, as frozen values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.friction import FrictionState
from tdcr_fe.solve.equations.configuration import Configuration, Unknowns

Array = NDArray[np.float64]
ByRobot = tuple[Array, ...]


class SolverState(NamedTuple):
    """The complete state at the beginning of a step. Its arrays are never changed.

    Attributes
    ----------
    configuration : Configuration
        Of the whole scene.
    base_tension : tuple of ndarray, shape (m,)
        By robot, tension of every tendon at the base [N].
    mobilisation : tuple of ndarray, shape (m, g)
        By robot, mobilisation of the friction in [-1, 1]; in a solved state that of `friction`.
    friction : tuple of FrictionState
        By robot, history at the end of the last solved (sub)step.
    prescribed : tuple of ndarray, shape (m,)
        By robot, prescribed displacement [m], nan of tendons driven by tension.
    loads : tuple of ndarray, shape (6,)
        Concentrated loads that acted, force [N] and moment [N m] in their own frames.
    time : float
        At which it was solved [s].
    tangent_sign : int
        Sign of the determinant of the last tangent, 0 where it is unknown or unrelated to stability.
    """

    configuration: Configuration
    base_tension: ByRobot
    mobilisation: ByRobot
    friction: tuple[FrictionState, ...]
    prescribed: ByRobot
    loads: tuple[Array, ...] = ()
    time: float = 0.0
    tangent_sign: int = 0

    @property
    def inputs(self) -> ByRobot:
        """By robot, what every tendon is driven by: displacement [m] where prescribed, else tension [N]."""
        return tuple(
            np.where(np.isnan(given), tension, given)
            for given, tension in zip(self.prescribed, self.base_tension, strict=True)
        )

    def stored(self) -> StoredState:
        """The state as its unknowns alone, from which it can be restored."""
        return StoredState(self.configuration.unknowns, self.base_tension, self.mobilisation, self.friction)


@dataclass(frozen=True)
class StoredState:
    """A solved state reduced to its unknowns; small, and can be pickled.

    Attributes
    ----------
    unknowns : Unknowns
        Of the configuration.
    base_tension, mobilisation, friction
        As in `SolverState`.
    """

    unknowns: Unknowns
    base_tension: ByRobot
    mobilisation: ByRobot
    friction: tuple[FrictionState, ...]


@dataclass(frozen=True, eq=False)
class Target:
    """Inputs, loads and time with which a state has to be in equilibrium.

    Attributes
    ----------
    inputs : tuple of ndarray, shape (m,)
        By robot, tension [N] or displacement [m] of every tendon at the base.
    loads : tuple of ndarray, shape (6,)
        Concentrated loads, force [N] and moment [N m] in their own frames; they are already in the scene.
    time : float
        Time that user functions see [s].
    """

    inputs: ByRobot
    loads: tuple[Array, ...] = ()
    time: float = 0.0

    @property
    def load_size(self) -> float:
        """Largest component of a force, for the scale of the residual [N]."""
        return max((float(np.max(np.abs(load[:3]))) for load in self.loads), default=0.0)
