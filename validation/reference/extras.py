"""Properties beyond the robot description (springs to ground, holes with their own friction), for blind data."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Spring:
    """A linear spring between a point of the backbone and ground, without force in the unloaded state.

    Attributes
    ----------
    at : float
        Arc length [m].
    stiffness : (float, float, float)
        Along the world's axes [N/m].
    """

    at: float
    stiffness: tuple[float, float, float]


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
    mu: float = 0.0
    adhesion: float = 0.0


@dataclass(frozen=True)
class Extras:
    """All properties beyond the description.

    Attributes
    ----------
    springs : tuple of Spring
    holes : tuple of HoleFriction
        Straight tendon segments and friction per hole only.
    """

    springs: tuple[Spring, ...] = ()
    holes: tuple[HoleFriction, ...] = ()
