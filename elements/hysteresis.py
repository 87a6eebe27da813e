"""What happens at a hole as the tendon slips: the part of the friction that acts, as a function of the slip.

The mobilisation ``s`` in [-1, 1] follows the slip ``u`` over the presliding distance ``delta``. While the slip goes one
way from a history ``(u0, s0)``, the law is a curve ``u - u0 = G(s) - G(s0)`` up to full friction, where the hole slips:

- elastic-plastic, a spring in series with a slider (the stop operator): ``G = delta s``;
- Dahl, ``ds/du = (1 - s sgn(du)) / delta``: ``G = -+ delta log(1 -+ s)`` in the direction of the slip, so that friction
  grows smoothly and a reversal is felt at once (P. R. Dahl, A solid friction model, Aerospace Corp. report
  TOR-0158(3107-18)-1 (1968)).

Adding a law takes its class here, its entry in `HYSTERESES`, its name in `HysteresisKind`, and a phrase in the
docstring of `tdcr_fe.model.loading.Model`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from tdcr_fe.elements import Array

#: Names of the entries of `HYSTERESES`, as a type.
HysteresisKind = Literal["elastic-plastic", "dahl"]

#: Largest error of mobilisations, and of coefficients of friction, that are iterated in a configuration [1]. Dahl's
#: friction tends to this much more than full friction, which it thus reaches: after 23 presliding distances.
ACCEPTED = 1e-10


@dataclass(frozen=True)
class FrictionState:
    """History, committed at the end of a (sub)step."""

    slip: Array  # (m, g): Slip that drives each mobilisation [m]
    mobilisation: Array  # (m, g): Part of the available friction that acts, in [-1, 1]
    # (m, g): Slip rate over the last step of nonzero duration [m/s]; None is zero
    slip_rate: Array | None = None
    time: float = 0.0  # Time at which it was committed [s]
    # Slip and time of the history before it, where the step goes on; None at the beginning of a load step
    former: tuple[Array, float] | None = None

    @property
    def anew(self) -> FrictionState:
        """The same where a new motion begins, whose rates may jump."""
        return self if self.former is None else replace(self, former=None)

    def rates_from(self, time: float) -> tuple[Array, float]:
        """A slip and a duration, with which the rate at a time is the slip since then over it [m, s].

        The rate is the mean since this history, or, with the one before it, the slope of the parabola through the
        slips (backward differentiation, E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (1996),
        sec. III.1).
        """
        elapsed = time - self.time
        if self.former is None or elapsed <= 0.0:
            return self.slip, elapsed
        slip, begin = self.former
        weight = elapsed / (time - begin)
        part = weight * elapsed / (self.time - begin) / (1.0 + weight)
        return self.slip + part * (self.slip - slip), elapsed / (1.0 + weight)


@dataclass(frozen=True)
class Hysteresis(ABC):
    """A law of the mobilisation. Arrays are of any one shape, hole by hole.

    A law must pass -1 and 1 at a finite slip, where the hole begins to slip; one that only tends to them tends to
    `ACCEPTED` more.

    Attributes
    ----------
    presliding : float
        Slip from rest to full friction, or the scale of it [m].
    kind : str
        Name in ``scenario.toml``.
    linear : bool
        Whether the mobilisation is linear in the slip up to full friction. Then only reversals at full friction count,
        and the path of a step is followed (`tdcr_fe.solve.friction_path`).
    """

    presliding: float = 1e-6
    kind: ClassVar[HysteresisKind]
    linear: ClassVar[bool] = False

    @abstractmethod
    def trial(self, slip: Array, before: FrictionState) -> Array:
        """The mobilisation at a slip [m] that goes one way from a history, without its limits -1 and 1 [1]."""

    @abstractmethod
    def slip_of(self, mobilisation: Array, before: FrictionState) -> Array:
        """Slip since the history at which a mobilisation is reached [m]: the inverse of `trial`."""

    @abstractmethod
    def flexibility(self, mobilisation: Array, direction: Array) -> Array:
        """Slope of the slip by the mobilisation in a direction of the slip, -1 or 1 [m].

        In direction 0 the slope of the mobilisation by the slip is the mean of those in both, and this its inverse.
        """

    def softened(self, factor: float) -> Hysteresis:
        """The same law with a presliding distance that is larger by a factor."""
        return self if factor == 1.0 else replace(self, presliding=factor * self.presliding)


@dataclass(frozen=True)
class ElasticPlastic(Hysteresis):
    """A spring in series with a slider."""

    kind: ClassVar[HysteresisKind] = "elastic-plastic"
    linear: ClassVar[bool] = True

    def trial(self, slip: Array, before: FrictionState) -> Array:
        """See `Hysteresis.trial`."""
        return before.mobilisation + (slip - before.slip) / self.presliding

    def slip_of(self, mobilisation: Array, before: FrictionState) -> Array:
        """See `Hysteresis.slip_of`."""
        return self.presliding * (mobilisation - before.mobilisation)

    def flexibility(self, mobilisation: Array, direction: Array) -> Array:
        """See `Hysteresis.flexibility`."""
        return np.full_like(mobilisation, self.presliding)


@dataclass(frozen=True)
class Dahl(Hysteresis):
    """Friction that grows the more slowly the nearer it is to full friction."""

    kind: ClassVar[HysteresisKind] = "dahl"

    def trial(self, slip: Array, before: FrictionState) -> Array:
        """See `Hysteresis.trial`."""
        travel = (slip - before.slip) / self.presliding
        limit = np.copysign(1.0 + ACCEPTED, travel)
        return limit - (limit - before.mobilisation) * np.exp(-np.abs(travel))

    def slip_of(self, mobilisation: Array, before: FrictionState) -> Array:
        """See `Hysteresis.slip_of`."""
        side = np.where(mobilisation >= before.mobilisation, 1.0, -1.0)
        limit = side * (1.0 + ACCEPTED)
        return side * self.presliding * np.log((limit - before.mobilisation) / (limit - mobilisation))

    def flexibility(self, mobilisation: Array, direction: Array) -> Array:
        """See `Hysteresis.flexibility`; in direction 0 it is the presliding distance, whatever the mobilisation."""
        return self.presliding / (1.0 + np.abs(direction) * ACCEPTED - direction * mobilisation)


#: Every law, by its name in ``scenario.toml``.
HYSTERESES: dict[str, type[Hysteresis]] = {law.kind: law for law in (ElasticPlastic, Dahl)}
