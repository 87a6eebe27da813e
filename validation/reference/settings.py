"""Settings of the reference, and what a true robot may have besides its description (extras)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.robot import Robot


@dataclass(frozen=True)
class ReferenceSettings:
    """Numerical settings, apart from the physics.

    Attributes
    ----------
    sample_at : tuple of float
        Extra arc lengths at which the shape is given [m].
    samples_per_bay : int
        Extra points between neighbouring nodes at which the shape is given.
    substeps : int or None
        Substeps of a load step without a number of its own; None chooses them by step doubling.
    path_tolerance : float
        Largest displacement of a node, over the length, by halving every substep of a load step [1]; distributed over
        the substeps.
    initial_substeps : int
        Substeps that step doubling begins with; four to each are solved at least.
    presliding : float
        Slip of a tendon through a hole from rest to full friction [m].
    max_interval : float
        Longest interval of the multiple shooting, over the length of the backbone [1].
    max_step : float
        Longest Runge-Kutta step, over the length of the backbone [1]; with continuous tendons, which bend
        the rod more evenly, twice that.
    tolerance : float
        Largest scaled residual of a converged state: moments over EI/L, forces over EI/L^2 [1].
    max_iterations : int
        Of Newton's method, in one attempt.
    max_bisections : int
        How often a substep may be halved, for the path or to converge. Beyond it, a path that is not resolved is
        reported with its refinement error, and a substep that does not converge ends the sequence.
    """

    sample_at: tuple[float, ...] = ()
    samples_per_bay: int = 0
    substeps: int | None = None
    path_tolerance: float = 1e-4
    initial_substeps: int = 2
    presliding: float = 1e-6
    max_interval: float = 0.125
    max_step: float = 0.03
    tolerance: float = 1e-10
    max_iterations: int = 30
    max_bisections: int = 10

    def __post_init__(self) -> None:
        for name in ("presliding", "max_interval", "max_step", "tolerance", "path_tolerance"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} = {getattr(self, name)}; must be positive")
        counts = {"initial_substeps": self.initial_substeps, "max_iterations": self.max_iterations}
        if self.substeps is not None:
            counts["substeps"] = self.substeps
        for name, value in counts.items():
            if value < 1:
                raise ValueError(f"{name} = {value}; must be at least 1")
        if self.samples_per_bay < 0 or self.max_bisections < 0:
            raise ValueError("samples_per_bay and max_bisections must not be negative")


Array = NDArray[np.float64]


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
    """All such properties.

    Attributes
    ----------
    springs : tuple of Spring
    holes : tuple of HoleFriction
        Straight tendon segments and friction per hole only.
    bending : callable or None
        Bending moment that the backbone carries besides its elasticity: from a `BackboneState` to moments about the
        sections' x and y axes [N m], shape (n, 2). Straight tendon segments only.
    forces : tuple of PointForce
    """

    springs: tuple[Spring, ...] = ()
    holes: tuple[HoleFriction, ...] = ()
    bending: Callable[[BackboneState], Array] | None = None
    forces: tuple[PointForce, ...] = ()

    @property
    def has_laws(self) -> bool:
        """Whether anything depends on the state by a law of its own."""
        return self.bending is not None or bool(self.forces)

    def with_robot(self, robot: Robot) -> Extras:
        """With the springs and the stuck holes of a robot's description."""
        springs = tuple(Spring(x.at, (x.stiffness, x.stiffness, 0.0)) for x in robot.springs)
        holes = tuple(
            HoleFriction(
                t.name,
                int(np.argmin(np.abs(robot.hole_arc_lengths(t) - x.at))),
                t.friction_coefficient,
                x.drop,
            )
            for t in robot.tendons
            for x in t.tight_holes
        )
        return replace(self, springs=(*self.springs, *springs), holes=(*self.holes, *holes))
