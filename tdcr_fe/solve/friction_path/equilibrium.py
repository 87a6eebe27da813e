"""A solved state with its linearisation and its response to the tensions of the segments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.solve.equations.linearization import Linearization
from tdcr_fe.solve.equations.numbering import Numbering
from tdcr_fe.solve.equations.state import SolverState, Target
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.friction_path.tension_response import LoadResponse, Tendons, TensionResponse
from tdcr_fe.solve.newton.friction_step import mobilisations

Array = NDArray[np.float64]

#: Largest turn of an element since the last linearisation with which that is as good as a new one [rad]. With four
#: times as much, one of twenty random robots ended 1.5e-5 of the length off (documentation, page "Theory").
EXACT_TURN = 1e-5
#: Relative residual below which forces balance [1].
BALANCED = 1e-3


class Equilibrium(NamedTuple):
    """A solved state with its linearisation.

    Attributes
    ----------
    state : SolverState
    forces : tuple of TendonForces
        By robot.
    linearization : Linearization
    response : TensionResponse or None
        To the tensions of some tendons, where it was needed.
    exact : bool
        Whether it is linearised in this very state, or so near that it makes no difference.
    balanced : bool
        Whether forces balance: not where weight acts on a robot that was never loaded.
    """

    state: SolverState
    forces: tuple[TendonForces, ...]
    linearization: Linearization
    response: TensionResponse | None = None
    exact: bool = False
    balanced: bool = True

    @classmethod
    def of(
        cls,
        state: SolverState,
        forces: tuple[TendonForces, ...],
        linearization: Linearization,
    ) -> Equilibrium:
        """With a linearisation in this state, or near it."""
        return cls(state, forces, linearization, exact=near_enough(state, linearization))

    @classmethod
    def at(cls, system: SceneSystem, state: SolverState, target: Target) -> Equilibrium:
        """Linearise in a solved state under its own target, which is in the scene."""
        numbering = system.numbering()
        residual = system.residual(state, target, numbering)
        linearization = system.linearize(residual, numbering)
        return cls(state, residual.forces, linearization, exact=True, balanced=residual.size < BALANCED)

    @property
    def numbering(self) -> Numbering:
        """Of the unknowns."""
        return self.linearization.numbering

    @property
    def slips(self) -> Array:
        """Slips of the frictional holes [m], shape (k,)."""
        return self.numbering.at_frictional_holes([own.field.slip for own in self.forces])

    @property
    def mobilisation(self) -> Array:
        """Of the frictional holes [1], shape (k,)."""
        return mobilisations(self.numbering, self.state)

    def with_response(self, clamped: Sequence[slice], tendons: Tendons) -> Equilibrium:
        """The same with the response to the tensions of some tendons; all others are slack."""
        if self.response is not None and all(
            np.array_equal(a, b) for a, b in zip(self.response.tendons, tendons, strict=True)
        ):
            return self
        response = TensionResponse.of(self.linearization, self.forces, clamped, tendons)
        return self._replace(response=response)

    def load_response(self, system: SceneSystem, other: Target) -> LoadResponse:
        """Response to the change to another target's loads, which are in the scene, at fixed tensions."""
        assert self.response is not None
        unbalanced = system.unbalanced(self.state, other, self.forces)
        return self.response.to_load(self.linearization, self.forces, unbalanced)


def near_enough(state: SolverState, linearization: Linearization) -> bool:
    """Whether a linearisation is in a state, or so near to it that it makes no difference."""
    return linearization.turn_since(state.configuration.twists) <= EXACT_TURN
