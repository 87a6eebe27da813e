"""Coefficients of friction at the holes: constant, Stribeck, dependent on the normal force or the turning angle.

The annotated fields of a law are the keys of its table in ``robot.toml``. Adding one takes a class here and its name in
`FRICTION_COEFFICIENTS`; docs/architecture.md, section "Nine extension points", has an example. Friction with
memory is in `tdcr_fe.elements.hysteresis`, the share of friction states among holes in `tdcr_fe.elements.friction`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, Protocol

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.model.schema import Checked, Quantity


class FrictionCoefficient(Protocol):
    """What every law of the coefficient offers."""

    @property
    def kind(self) -> str:
        """Name of the law in ``robot.toml``."""
        ...

    def coefficient(self, normal_force: Array, slip_rate: Array, turning_angle: Array) -> tuple[Array, ...]:
        """Coefficient of friction and its derivatives, hole by hole.

        Parameters
        ----------
        normal_force
            ``(T_k + T_k+1) sin(theta_k / 2)`` [N], not negative, shape (k,).
        slip_rate
            Rate at which the tendon passes the hole, positive towards the base [m/s], shape (k,).
        turning_angle
            By which the tendon turns at the hole [rad], not negative, shape (k,).

        Returns
        -------
        mu, dmu_dnormal, dmu_drate, dmu_dangle : ndarray, shape (k,)
            Coefficient, not negative [1], and its derivatives by the three arguments [1/N, s/m, 1/rad].
        """
        ...


@dataclass(frozen=True)
class ConstantFriction(Checked):
    """The same coefficient at any force and rate (Coulomb), as ``friction_coefficient`` of a tendon gives it.

    Attributes
    ----------
    mu : float
        Coefficient of friction [1].
    """

    mu: Annotated[float, Quantity(ge=0.0, le=100.0)]
    kind: Literal["constant"] = "constant"

    def coefficient(self, normal_force: Array, slip_rate: Array, turning_angle: Array) -> tuple[Array, ...]:
        """See `FrictionCoefficient.coefficient`."""
        zero = np.zeros_like(normal_force)
        return zero + self.mu, zero, zero, zero


@dataclass(frozen=True)
class StribeckFriction(Checked):
    """Coefficient that falls from static to kinetic with the slip rate, and rises again by viscosity.

    ``mu(v) = kinetic + (static - kinetic) exp(-(|v| / stribeck_rate)^exponent) + viscous |v|``; B. Armstrong-Helouvry,
    P. Dupont, C. Canudas de Wit, A survey of models, analysis tools and compensation methods for the control of
    machines with friction, Automatica 30 (1994) 1083-1138.

    Attributes
    ----------
    static : float
        Coefficient at rest [1].
    kinetic : float
        Coefficient of fast slip, without viscosity [1].
    stribeck_rate : float
        Slip rate at which the difference has fallen to 1/e [m/s].
    exponent : float
        Shape of the fall, 2 is Gaussian [1].
    viscous : float
        Rise of the coefficient with the slip rate [s/m].
    """

    static: Annotated[float, Quantity(ge=0.0, le=100.0)]
    kinetic: Annotated[float, Quantity(ge=0.0, le=100.0)]
    stribeck_rate: Annotated[float, Quantity(unit="m/s", gt=0.0)]
    exponent: Annotated[float, Quantity(ge=1.0, le=10.0)] = 2.0
    viscous: Annotated[float, Quantity(unit="s/m", ge=0.0)] = 0.0
    kind: Literal["stribeck"] = "stribeck"

    def coefficient(self, normal_force: Array, slip_rate: Array, turning_angle: Array) -> tuple[Array, ...]:
        """See `FrictionCoefficient.coefficient`."""
        x = np.abs(slip_rate) / self.stribeck_rate
        fall = (self.static - self.kinetic) * np.exp(-(x**self.exponent))
        mu = self.kinetic + fall + self.viscous * np.abs(slip_rate)
        slope = self.viscous - fall * self.exponent * x ** (self.exponent - 1.0) / self.stribeck_rate
        zero = np.zeros_like(mu)
        return mu, zero, slope * np.sign(slip_rate), zero


@dataclass(frozen=True)
class ForceDependentFriction(Checked):
    """Coefficient that changes with the normal force by a power law.

    ``mu(N) = mu ((N^2 + smallest_force^2) / reference_force^2)^(exponent / 2)``. A single elastic contact of
    Hertz grows as ``N^(2/3)``; where friction grows with its area, the exponent is -1/3 (F. P. Bowden, D. Tabor, The
    Friction and Lubrication of Solids, Oxford 1950). The paper names this dependence as a limitation of its model
    (section 4).

    Attributes
    ----------
    mu : float
        Coefficient at the reference force, to ``(smallest_force / reference_force)^2`` [1].
    reference_force : float
        Normal force [N].
    exponent : float
        Power of the normal force; -1/3 is an elastic contact of Hertz [1]. With -1 friction does not depend on it.
    smallest_force : float
        Normal force below which the coefficient becomes constant [N].
    """

    mu: Annotated[float, Quantity(ge=0.0, le=100.0)]
    reference_force: Annotated[float, Quantity(unit="N", gt=0.0)]
    exponent: Annotated[float, Quantity(ge=-1.0, le=1.0)] = -1.0 / 3.0
    smallest_force: Annotated[float, Quantity(unit="N", gt=0.0)] = 1e-3
    kind: Literal["force-dependent"] = "force-dependent"

    def coefficient(self, normal_force: Array, slip_rate: Array, turning_angle: Array) -> tuple[Array, ...]:
        """See `FrictionCoefficient.coefficient`."""
        square = normal_force**2 + self.smallest_force**2
        mu = self.mu * (square / self.reference_force**2) ** (0.5 * self.exponent)
        zero = np.zeros_like(mu)
        return mu, self.exponent * mu * normal_force / square, zero, zero


@dataclass(frozen=True)
class AngleDependentFriction(Checked):
    """Coefficient that changes with the angle by which the tendon turns at the hole, not below zero.

    ``mu(theta) = mu + slope theta``: a tendon that resists bending touches the edges of a hole, the more the further it
    turns.

    Attributes
    ----------
    mu : float
        Coefficient where the tendon runs straight through the hole [1].
    slope : float
        Its change with the turning angle [1/rad].
    """

    mu: Annotated[float, Quantity(ge=0.0, le=100.0)]
    slope: Annotated[float, Quantity(unit="1/rad", ge=-1000.0, le=1000.0)]
    kind: Literal["angle-dependent"] = "angle-dependent"

    def coefficient(self, normal_force: Array, slip_rate: Array, turning_angle: Array) -> tuple[Array, ...]:
        """See `FrictionCoefficient.coefficient`."""
        mu, zero = self.mu + self.slope * turning_angle, np.zeros_like(turning_angle)
        return np.maximum(mu, 0.0), zero, zero, np.where(mu > 0.0, self.slope, 0.0)


#: Every law of the coefficient that ``robot.toml`` may name.
FRICTION_COEFFICIENTS: dict[str, type] = {
    law.kind: law
    for law in (ConstantFriction, StribeckFriction, ForceDependentFriction, AngleDependentFriction)
}
