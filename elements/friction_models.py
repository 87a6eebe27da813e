"""Friction models: which slip drives friction at which holes; and the parameters of the tendons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

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


class FrictionModel(Protocol):
    """Which slip drives friction at which holes. Adding a model takes a class here and a line in `FRICTION_MODELS`.

    A model has ``g`` mobilisations per tendon; the matrices give the slip that drives them and where they act.
    """

    @property
    def kind(self) -> str:
        """Name in ``scenario.toml``."""
        ...

    @property
    def active(self) -> bool:
        """Whether the model has friction."""
        ...

    def slip_operator(self, n: int) -> Array:
        """Matrix from released segment lengths to the slip that drives each friction variable, shape (g, n)."""
        ...

    def hole_incidence(self, n: int) -> Array:
        """From the mobilisations to the holes ``1 .. n-1``, shape (n-1, g)."""
        ...


@dataclass(frozen=True)
class NoFriction:
    """The same tension all along (paper, Eq. 11)."""

    kind: ClassVar[str] = "none"
    active: ClassVar[bool] = False

    def slip_operator(self, n: int) -> Array:
        """See `FrictionModel.slip_operator`."""
        return np.zeros((0, n))

    def hole_incidence(self, n: int) -> Array:
        """See `FrictionModel.hole_incidence`."""
        return np.zeros((n - 1, 0))


@dataclass(frozen=True)
class PerTendonFriction:
    """The paper's law: one sign per tendon, from the rate of its whole length (Eqs. 15-31, Fig. 2)."""

    kind: ClassVar[str] = "per-tendon"
    active: ClassVar[bool] = True

    def slip_operator(self, n: int) -> Array:
        """See `FrictionModel.slip_operator`."""
        return np.ones((1, n))

    def hole_incidence(self, n: int) -> Array:
        """See `FrictionModel.hole_incidence`."""
        return np.ones((n - 1, 1))


@dataclass(frozen=True)
class PerHoleFriction:
    """Stick, pull-slip or release-slip at each hole, from the material that passes that hole."""

    kind: ClassVar[str] = "per-hole"
    active: ClassVar[bool] = True

    def slip_operator(self, n: int) -> Array:
        """See `FrictionModel.slip_operator`."""
        return np.triu(np.ones((n - 1, n)), 1)

    def hole_incidence(self, n: int) -> Array:
        """See `FrictionModel.hole_incidence`."""
        return np.eye(n - 1)


#: Every friction model, by the name it has in ``scenario.toml``.
FRICTION_MODELS: dict[str, FrictionModel] = {
    law.kind: law for law in (NoFriction(), PerTendonFriction(), PerHoleFriction())
}
