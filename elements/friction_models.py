"""Friction models: which slip drives friction at which holes; and the parameters of the tendons."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.coefficients import CoefficientLaw

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TendonParameters:
    """Parameters of all tendons of one robot; shorter tendons are padded at the end."""

    lengths: Array  # (m, n): Length of every segment in the unloaded state, zero where padded [m]
    mask: NDArray[np.bool_]  # (m, n): Which segments exist
    friction: Array  # (m, n-1): Friction coefficient at every hole, zero at and beyond the anchor [1]
    adhesion: Array  # (m, n-1): Tension drop at every hole that does not grow with the tension [N]
    compliance: Array  # (m,): ``1 / EA`` of the tendon, zero where inextensible [1/N]
    pretension: Array  # (m,): Tension in the unloaded state where the displacement at the base is zero [N]
    # Law of each tendon's coefficients of friction, used instead of ``friction``; None, or an empty tuple,
    # where the coefficients are constant
    laws: tuple[CoefficientLaw | None, ...] = ()

    @property
    def material(self) -> Array:
        """Length of every segment's tendon without tension, where the displacement at the base is zero [m], (m, n)."""
        return self.lengths / (1.0 + self.compliance * self.pretension)[:, None]


@dataclass(frozen=True)
class FrictionModel:
    """Which slip drives friction at which holes, by ``g`` mobilisations of every tendon.

    The matrices are given for a number ``n`` of segments. Adding a model takes an entry of `FRICTION_MODELS`.
    """

    kind: str  # Name in ``scenario.toml``
    # From released segment lengths to the slip that drives each mobilisation, shape (g, n)
    slip_operator: Callable[[int], Array]
    hole_incidence: Callable[[int], Array]  # From the mobilisations to the holes ``1 .. n-1``, shape (n-1, g)
    active: bool = True  # Whether there is friction


#: Every friction model, by the name it has in ``scenario.toml``: none, so that the tension is the same all along (paper,
#: Eq. 11); the paper's law, with one sign per tendon from the rate of its whole length (Eqs. 15-31, Fig. 2); and stick,
#: pull-slip or release-slip at each hole, from the material that passes that hole.
FRICTION_MODELS: dict[str, FrictionModel] = {
    model.kind: model
    for model in (
        FrictionModel("none", lambda n: np.zeros((0, n)), lambda n: np.zeros((n - 1, 0)), active=False),
        FrictionModel("per-tendon", lambda n: np.ones((1, n)), lambda n: np.ones((n - 1, 1))),
        FrictionModel("per-hole", lambda n: np.triu(np.ones((n - 1, n)), 1), lambda n: np.eye(n - 1)),
    )
}
