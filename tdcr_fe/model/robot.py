"""The robot as data: backbone, disks and tendons, frozen and in SI units. Imports no solver.

World frame: base plate at the origin, undeformed backbone along +z, section frames aligned with the world
in the straight state; the tangent is the third axis of the section frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.friction import FrictionCoefficient
from tdcr_fe.model.routing import Routing

Array = NDArray[np.float64]

#: Arc lengths are the same place within this distance [m].
ARC_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Superelastic:
    """Bending moment that softens with curvature (NiTi).

    ``EI kappa`` up to ``kappa * radius = threshold_strain``; beyond it the slope is ``plateau_ratio * EI``;
    the slope changes smoothly over a tenth of the threshold.

    Attributes
    ----------
    threshold_strain : float
        Strain of the outer fibre where the plateau begins [1].
    plateau_ratio : float
        Slope beyond it over the slope before it [1].
    """

    threshold_strain: float
    plateau_ratio: float


@dataclass(frozen=True)
class StiffnessPatch:
    """A stretch of the backbone with other bending and torsional stiffness.

    Attributes
    ----------
    start, end : float
        Arc lengths [m].
    bending, torsion : float
        Factors on the stiffness there [1].
    """

    start: float
    end: float
    bending: float = 1.0
    torsion: float = 1.0


@dataclass(frozen=True)
class Backbone:
    """The elastic rod, with section stiffness ``diag(GJ, EI, EI, EA, GA, GA)`` (paper, below Eq. 5).

    Attributes
    ----------
    length, radius : float
        [m].
    youngs_modulus : float
        [Pa].
    poisson_ratio : float
        [1].
    density : float
        [kg/m^3].
    bending_stiffness, torsional_stiffness, axial_stiffness, shear_stiffness : float or None
        Override what radius and moduli give [N m^2, N m^2, N, N].
    precurvature : (float, float)
        Turning rate of the section about its x and y axes in the unloaded state [1/m].
    superelastic : Superelastic or None
        Softening of the bending moment.
    patches : tuple of StiffnessPatch
        Stretches of other stiffness.
    creep_rate : float
        Growth of bending and torsional compliance per time under load, relative to the declared one [1/s].
    """

    length: float
    radius: float
    youngs_modulus: float
    poisson_ratio: float
    density: float = 0.0
    bending_stiffness: float | None = None
    torsional_stiffness: float | None = None
    axial_stiffness: float | None = None
    shear_stiffness: float | None = None
    precurvature: tuple[float, float] = (0.0, 0.0)
    superelastic: Superelastic | None = None
    patches: tuple[StiffnessPatch, ...] = ()
    creep_rate: float = 0.0

    def compliance_factor(self, time: float) -> float:
        """By how much bending and torsional compliance have grown at a time [s]: ``1 + creep_rate time``."""
        return 1.0 + self.creep_rate * time

    @property
    def area(self) -> float:
        """Area of the cross-section [m^2]."""
        return float(np.pi * self.radius**2)

    @property
    def shear_modulus(self) -> float:
        """``E / (2 (1 + nu))`` [Pa]."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))

    @property
    def EI(self) -> float:
        """Bending stiffness [N m^2]."""
        if self.bending_stiffness is not None:
            return self.bending_stiffness
        return float(self.youngs_modulus * np.pi * self.radius**4 / 4.0)

    @property
    def GJ(self) -> float:
        """Torsional stiffness [N m^2]."""
        if self.torsional_stiffness is not None:
            return self.torsional_stiffness
        return float(self.shear_modulus * np.pi * self.radius**4 / 2.0)

    @property
    def EA(self) -> float:
        """Axial stiffness [N]."""
        if self.axial_stiffness is not None:
            return self.axial_stiffness
        return self.youngs_modulus * self.area

    @property
    def GA(self) -> float:
        """Shear stiffness, without shear correction [N]."""
        if self.shear_stiffness is not None:
            return self.shear_stiffness
        return self.shear_modulus * self.area

    @property
    def mass_per_length(self) -> float:
        """[kg/m]."""
        return self.density * self.area

    def stiffness_factors(self, s: Array) -> tuple[Array, Array]:
        """Factors of bending and torsional stiffness at arc lengths ``s`` [m], each of shape ``s.shape``."""
        bending, torsion = np.ones_like(s), np.ones_like(s)
        for patch in self.patches:
            inside = (s >= patch.start) & (s < patch.end)
            bending = np.where(inside, bending * patch.bending, bending)
            torsion = np.where(inside, torsion * patch.torsion, torsion)
        return bending, torsion


@dataclass(frozen=True)
class Disks:
    """Rigid disks on the backbone; the base plate at s = 0 is not one of them.

    Attributes
    ----------
    positions : tuple of float
        Arc lengths, ascending [m].
    mass : float
        Of each disk [kg].
    thickness : float
        Length of backbone that each disk makes rigid, centred on it [m].
    radius : float
        [m].
    """

    positions: tuple[float, ...]
    mass: float = 0.0
    thickness: float = 0.0
    radius: float = 5e-3

    @classmethod
    def equally_spaced(cls, count: int, length: float, **rest: float) -> Disks:
        """``count`` disks at equal distances, the last at the tip."""
        positions = tuple(float(x) for x in length * np.arange(1, count + 1) / count)
        return cls(positions=positions, **rest)


@dataclass(frozen=True)
class Tendon:
    """A cable through one hole in the base plate and in every disk up to the one it is anchored to.

    Attributes
    ----------
    name : str
    routing : Routing
        Where its holes lie.
    friction_coefficient : float
        Of tendon and hole, ``mu`` in the Capstan equation (paper, Eq. 28) [1].
    friction : FrictionCoefficient or None
        Law of a coefficient that depends on slip rate or normal force, instead of ``friction_coefficient``.
    end : float or None
        Arc length of its anchor [m]; None is the tip.
    axial_stiffness : float or None
        ``EA`` of the tendon [N]; None is inextensible.
    adhesion : float
        Tension drop per hole that does not grow with the tension [N].
    clearance : float
        How far the tendon can shift sideways in an oversized hole [m].
    """

    name: str
    routing: Routing
    friction_coefficient: float = 0.0
    end: float | None = None
    axial_stiffness: float | None = None
    adhesion: float = 0.0
    clearance: float = 0.0
    friction: FrictionCoefficient | None = None


@dataclass(frozen=True)
class Robot:
    """A tendon-driven continuum robot.

    Attributes
    ----------
    backbone : Backbone
    disks : Disks
    tendons : tuple of Tendon
    name : str
    tip_mass : float
        Point mass at the tip besides the disk [kg].

    Raises
    ------
    ValueError
        With every contradiction found between the parts.
    """

    backbone: Backbone
    disks: Disks
    tendons: tuple[Tendon, ...] = ()
    name: str = "robot"
    tip_mass: float = 0.0
    metadata: dict[str, Any] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        from tdcr_fe.model.checks import robot_problems

        problems = robot_problems(self)
        if problems:
            raise ValueError(
                f"robot {self.name!r}:\n" + "\n".join(f"  {key}: {text}" for key, text in problems)
            )

    @property
    def tendon_names(self) -> tuple[str, ...]:
        """Names in order."""
        return tuple(t.name for t in self.tendons)

    def tendon(self, name: str) -> Tendon:
        """The tendon of that name; `KeyError` names those that exist."""
        for t in self.tendons:
            if t.name == name:
                return t
        raise KeyError(f"no tendon {name!r}; the robot has {', '.join(self.tendon_names) or 'none'}")

    def end(self, tendon: Tendon) -> float:
        """Arc length of the tendon's anchor [m]."""
        return self.backbone.length if tendon.end is None else tendon.end

    def hole_arc_lengths(self, tendon: Tendon) -> Array:
        """Arc lengths of the tendon's holes, base plate first, anchor last [m], shape (n + 1,)."""
        positions = np.asarray(self.disks.positions, dtype=float)
        return np.concatenate(([0.0], positions[positions <= self.end(tendon) + ARC_TOLERANCE]))

    def holes(self, tendon: Tendon) -> Array:
        """The tendon's holes in their section frames, base plate first, anchor last [m], shape (n + 1, 2)."""
        end = self.end(tendon)
        return tendon.routing.position(self.hole_arc_lengths(tendon), end)

    def with_backbone(self, **changes: Any) -> Robot:
        """A copy with fields of the backbone replaced."""
        return replace(self, backbone=replace(self.backbone, **changes))

    def with_disks(self, **changes: Any) -> Robot:
        """A copy with fields of the disks replaced."""
        return replace(self, disks=replace(self.disks, **changes))

    def with_tendons(self, names: Sequence[str] | None = None, **changes: Any) -> Robot:
        """A copy with fields of the named tendons (None: of all) replaced."""
        tendons = tuple(
            replace(t, **changes) if names is None or t.name in names else t for t in self.tendons
        )
        return replace(self, tendons=tendons)
