"""Derivatives of the results of a simulation by parameters. Imports no solver."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Derivatives by one parameter, whose unit is per unit of the parameter in its file.

    Attributes
    ----------
    parameter : str
        Name.
    value : float
        At which the derivative is taken.
    positions : ndarray, shape (n_steps, n, 3)
        Of the world positions of the backbone nodes [m].
    rotations : ndarray, shape (n_steps, n, 3)
        Of the sections' rotations as world rotation vectors [rad]: the derivative of a rotation matrix ``R`` is
        ``skew(rotations) R``.
    base_tensions : ndarray, shape (n_steps, n_tendons)
        [N].
    displacements : ndarray, shape (n_steps, n_tendons)
        Of the tendons pulled in at the base plate [m].
    tensions : tuple of ndarray, each of shape (n_steps, n_segments)
        By tendon, of every segment [N].
    slips : tuple of ndarray, each of shape (n_steps, n_segments - 1)
        By tendon, of the material that has passed each hole towards the base, base plate and anchor left out [m].
    arc_lengths : ndarray, shape (n,)
        Of the arc lengths of the backbone nodes [m]; nodes move along the backbone where disks or their ends do.
    """

    parameter: str
    value: float
    positions: Array
    rotations: Array
    base_tensions: Array
    displacements: Array
    tensions: tuple[Array, ...]
    slips: tuple[Array, ...]
    arc_lengths: Array

    @property
    def tips(self) -> Array:
        """Of the tip positions [m], shape (n_steps, 3)."""
        return self.positions[:, -1]


@dataclass(frozen=True, eq=False)
class Sensitivities(Mapping[str, Sensitivity]):
    """Derivatives by all parameters asked for, by name and in order.

    Attributes
    ----------
    by_parameter : tuple of Sensitivity
    """

    by_parameter: tuple[Sensitivity, ...] = ()

    def __getitem__(self, name: str) -> Sensitivity:
        for each in self.by_parameter:
            if each.parameter == name:
                return each
        names = ", ".join(self) or "none"
        raise KeyError(f"no sensitivity by {name!r}; computed were {names}")

    def __iter__(self) -> Iterator[str]:
        return iter([each.parameter for each in self.by_parameter])

    def __len__(self) -> int:
        return len(self.by_parameter)


@dataclass(frozen=True, eq=False)
class LocalResponse:
    """How one node moves under small changes of loads and inputs, in one solved state. World axes.

    Motions are ``[x, y, z, rotation vector]`` [m, rad], loads ``[force, moment]`` [N, N m].

    Attributes
    ----------
    s : float
        Arc length of the node [m].
    reversal : bool
        Whether all holes stick, as where every motion reverses. Else holes that slip go on slipping in their direction.
    compliance : ndarray, shape (6, 6)
        Motion by a load on the node. Tendons driven by tension keep their tension, those driven by displacement
        their displacement.
    by_tension : ndarray, shape (6, n_tendons)
        Motion by the tension of each tendon, all driven by tension [m/N, rad/N].
    by_displacement : ndarray, shape (6, n_tendons)
        Motion by the displacement of each taut tendon, all taut ones driven by displacement; zero for slack tendons
        [1, rad/m].
    motor_stiffness : ndarray, shape (n_tendons, n_tendons)
        Tension by displacement, all taut tendons driven by displacement; zero for slack tendons [N/m].
    """

    s: float
    reversal: bool
    compliance: Array
    by_tension: Array
    by_displacement: Array
    motor_stiffness: Array
