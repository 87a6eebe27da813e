"""Settings of the reference, and what a true robot may have besides its description (extras)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: Arrays of numbers, of whole numbers, and of truth values.
Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class ReferenceSettings:
    """Numerical settings, apart from the physics.

    Attributes
    ----------
    sample_at : tuple of float
        Extra arc lengths at which the shape is given [m].
    substeps : int or None
        Substeps of a load step without a number of its own; None chooses them by step doubling.
    presliding : float
        Slip of a tendon through a hole from rest to full friction [m].
    max_interval : float
        Longest interval of the multiple shooting, over the length of the backbone [1].
    max_step : float
        Longest Runge-Kutta step, over the length of the backbone [1]; with continuous tendons, which bend
        the rod more evenly, twice that.
    """

    sample_at: tuple[float, ...] = ()
    substeps: int | None = None
    presliding: float = 1e-6
    max_interval: float = 0.125
    max_step: float = 0.03

    def __post_init__(self) -> None:
        for name in ("presliding", "max_interval", "max_step"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} = {getattr(self, name)}; must be positive")
        if self.substeps is not None and self.substeps < 1:
            raise ValueError(f"substeps = {self.substeps}; must be at least 1")


@dataclass(frozen=True)
class HoleFriction:
    """One hole with its own friction; with an adhesion above every tension the tendon never slips.

    Attributes
    ----------
    tendon : str
        Name of the tendon.
    hole : int
        Number among the holes between base plate and anchor, 1 at the first disk.
    mu : float
        Friction coefficient there [1].
    adhesion : float
        Drop of tension there [N].
    """

    tendon: str
    hole: int
    mu: float
    adhesion: float


@dataclass(frozen=True)
class BackboneState:
    """What a law of bending may depend on, in a solved configuration.

    Attributes
    ----------
    s : ndarray, shape (n,)
        Middles of the intervals [m].
    strain : ndarray, shape (n, 3)
        Curvatures and twist of the intervals, section frame [1/m].
    tension : ndarray, shape (n, n_tendons)
        Of the segment that passes each interval, zero beyond a tendon's end [N].
    direction : ndarray, shape (n_tendons,)
        Sign of the last change of each tendon's input [1].
    time : float
        [s].
    """

    s: Array
    strain: Array
    tension: Array
    direction: Array
    time: float


@dataclass(frozen=True)
class PointForce:
    """A force on a point of the backbone that depends on its displacement.

    Attributes
    ----------
    at : float
        Arc length [m].
    force : callable
        From the displacement since the unloaded state, world frame [m], shape (3,), to the force [N], shape (3,).
    """

    at: float
    force: Callable[[Array], Array]


@dataclass(frozen=True)
class Extras:
    """All that a true robot has besides its description.

    Attributes
    ----------
    holes : tuple of HoleFriction
        Straight tendon segments and friction per hole only.
    bending : callable or None
        Bending moment that the backbone carries besides its elasticity: from a `BackboneState` to moments about the
        sections' x and y axes [N m], shape (n, 2). Straight tendon segments only.
    forces : tuple of PointForce
    """

    holes: tuple[HoleFriction, ...] = ()
    bending: Callable[[BackboneState], Array] | None = None
    forces: tuple[PointForce, ...] = ()
