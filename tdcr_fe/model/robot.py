"""The robot as data: backbone, disks and tendons, frozen and in SI units. Imports no solver.

World frame: base plate at the origin, undeformed backbone along +z, section frames aligned with the world
in the straight state; the tangent is the third axis of the section frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.checks import ARC_TOLERANCE, robot_contradictions
from tdcr_fe.model.friction import FRICTION_COEFFICIENTS, FrictionCoefficient
from tdcr_fe.model.quantity import Quantity
from tdcr_fe.model.routing import Routing
from tdcr_fe.model.schema import check_fields

Array = NDArray[np.float64]


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

    threshold_strain: Annotated[
        float, Quantity("strain of the outer fibre where the plateau begins", gt=0.0, le=1.0)
    ]
    plateau_ratio: Annotated[
        float, Quantity("slope beyond the threshold over the slope before it", gt=0.0, le=1.0)
    ]

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class NonlinearMaterial:
    """Fibres along the backbone with the nominal stress ``E (e + quadratic e^2 + cubic e^3)`` at the strain ``e``.

    Bending and stretching are coupled: with ``quadratic`` below zero a compressed backbone bends less. The
    third-order expansion of a neo-Hookean material has -1 and 4/3. Shear and torsion stay linear.

    Attributes
    ----------
    quadratic : float
        Difference of tension and compression: below zero softer in tension and stiffer in compression [1].
    cubic : float
        Hardening, below zero softening [1].
    """

    quadratic: Annotated[
        float, Quantity("below zero softer in tension and stiffer in compression", ge=-100.0, le=100.0)
    ] = 0.0
    cubic: Annotated[float, Quantity("hardening, below zero softening", ge=-1000.0, le=10_000.0)] = 0.0

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def largest_strain(self) -> float:
        """Smallest strain in tension or compression beyond which the stress falls [1]; infinite where there is none."""
        b, c = self.quadratic, self.cubic
        if c == 0.0:
            return 0.5 / abs(b) if b != 0.0 else math.inf
        inside = b * b - 3.0 * c
        if inside < 0.0:
            return math.inf
        return min(abs((-b + sign * math.sqrt(inside)) / (3.0 * c)) for sign in (1.0, -1.0))


@dataclass(frozen=True)
class StiffnessPatch:
    """A stretch of the backbone with other stiffness, of another material, or bent when unloaded.

    Attributes
    ----------
    start, end : float
        Arc lengths [m].
    bending, torsion : float
        Factors on the stiffness there [1].
    precurvature : (float, float)
        Turning rate of the section about its x and y axes there, in addition to the backbone's [1/m].
    modulus, density : float
        Factors on all stiffnesses, those above included, and on the density there: another material [1].
    """

    start: Annotated[float, Quantity("arc length where it begins", unit="m", ge=0.0)]
    end: Annotated[float, Quantity("arc length where it ends", unit="m", gt=0.0)]
    bending: Annotated[float, Quantity("factor on the bending stiffness", gt=0.0)] = 1.0
    torsion: Annotated[float, Quantity("factor on the torsional stiffness", gt=0.0)] = 1.0
    precurvature: Annotated[
        tuple[float, float],
        Quantity("turning rate about x and y when unloaded, added to the backbone's", unit="1/m"),
    ] = (0.0, 0.0)
    modulus: Annotated[float, Quantity("factor on all stiffnesses: another material", gt=0.0)] = 1.0
    density: Annotated[float, Quantity("factor on the density: another material", ge=0.0)] = 1.0

    def __post_init__(self) -> None:
        check_fields(self)


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
    nonlinear : NonlinearMaterial or None
        Hardening or softening of the fibres along the backbone.
    patches : tuple of StiffnessPatch
        Stretches of other stiffness or precurvature.
    taper : tuple of (float, float)
        Radius along the backbone: arc length and radius [m], linear in between, from the base, where it is ``radius``,
        to the tip. Empty: the radius is constant. In files it is the list given as ``radius``. Stiffnesses that are
        declared are those at the base.
    creep_rate : float
        Growth of bending and torsional compliance per time under load, relative to the declared one [1/s].
    retardation_time : float
        Kelvin-Voigt damping: the wrench of a section grows by this times its stiffness times the rate of its strain
        [s]. It acts in dynamics only.
    """

    length: Annotated[float, Quantity("from base plate to tip", unit="m", gt=0.0, le=1000.0)]
    radius: Annotated[float, Quantity("of the round section", unit="m", gt=0.0)]
    youngs_modulus: Annotated[float, Quantity("E", unit="Pa", gt=0.0)]
    poisson_ratio: Annotated[float, Quantity("nu, gives G = E / (2 (1 + nu))", gt=-1.0, le=0.5)]
    density: Annotated[float, Quantity("for gravity and dynamics", unit="kg/m^3", ge=0.0)] = 0.0
    bending_stiffness: Annotated[
        float | None, Quantity("EI, in place of E pi r^4 / 4", unit="N m^2", gt=0.0)
    ] = None
    torsional_stiffness: Annotated[
        float | None, Quantity("GJ, in place of G pi r^4 / 2", unit="N m^2", gt=0.0)
    ] = None
    axial_stiffness: Annotated[float | None, Quantity("EA, in place of E pi r^2", unit="N", gt=0.0)] = None
    shear_stiffness: Annotated[float | None, Quantity("GA, in place of G pi r^2", unit="N", gt=0.0)] = None
    precurvature: Annotated[
        tuple[float, float],
        Quantity(
            "turning rate of the section about its x and y axes in the unloaded state",
            unit="1/m",
            note="such as [0.0, 2.5]",
        ),
    ] = (0.0, 0.0)
    superelastic: Annotated[Superelastic | None, Quantity("softening of the bending moment (NiTi)")] = None
    nonlinear: Annotated[
        NonlinearMaterial | None, Quantity("fibres that harden or soften with their strain")
    ] = None
    patches: Annotated[
        tuple[StiffnessPatch, ...], Quantity("stretches of other stiffness, or bent when unloaded")
    ] = ()
    creep_rate: Annotated[
        float,
        Quantity("growth of bending and torsional compliance per time under load", unit="1/s", ge=0.0),
    ] = 0.0
    retardation_time: Annotated[
        float,
        Quantity(
            "damping by the material in dynamics, as stress per stiffness and strain rate", unit="s", ge=0.0
        ),
    ] = 0.0
    taper: Annotated[
        tuple[tuple[float, float], ...],
        Quantity("arc length and radius, from base to tip", unit="m", in_file=False),
    ] = ()

    def __post_init__(self) -> None:
        check_fields(self)

    def compliance_factor(self, time: float) -> float:
        """By how much bending and torsional compliance have grown at a time [s]: ``1 + creep_rate time``."""
        return 1.0 + self.creep_rate * time

    @property
    def area(self) -> float:
        """Area of the cross-section [m^2]."""
        return float(np.pi * self.radius**2)

    @property
    def second_moment(self) -> float:
        """Second moment of area about any axis through the centre of the section [m^4]."""
        return float(np.pi * self.radius**4 / 4.0)

    @property
    def shear_modulus(self) -> float:
        """``E / (2 (1 + nu))`` [Pa]."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))

    @property
    def EI(self) -> float:
        """Bending stiffness [N m^2]."""
        if self.bending_stiffness is not None:
            return self.bending_stiffness
        return float(self.youngs_modulus * self.second_moment)

    @property
    def GJ(self) -> float:
        """Torsional stiffness [N m^2]."""
        if self.torsional_stiffness is not None:
            return self.torsional_stiffness
        return float(self.shear_modulus * 2.0 * self.second_moment)

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
            bending = np.where(inside, bending * patch.bending * patch.modulus, bending)
            torsion = np.where(inside, torsion * patch.torsion * patch.modulus, torsion)
        return bending, torsion

    def material_factors(self, s: Array) -> tuple[Array, Array]:
        """Factors of axial and shear stiffness, and of the mass, at arc lengths ``s`` [m], each like ``s``."""
        modulus, density = np.ones_like(s), np.ones_like(s)
        for patch in self.patches:
            inside = (s >= patch.start) & (s < patch.end)
            modulus = np.where(inside, modulus * patch.modulus, modulus)
            density = np.where(inside, density * patch.density, density)
        return modulus, density

    def radius_at(self, s: Array) -> Array:
        """Radius at arc lengths ``s`` [m], shape ``s.shape``."""
        if not self.taper:
            return np.full(s.shape, self.radius)
        at, radius = np.array(self.taper).T
        return np.interp(s, at, radius)

    def taper_factors(self, arc_lengths: Array) -> tuple[Array, Array]:
        """Factors by which a taper changes the stretches between arc lengths [m], each of shape (n - 1,).

        Returns
        -------
        bending : ndarray
            Of bending and torsional stiffness: the inverse of the mean compliance.
        area : ndarray
            Of axial and shear stiffness, and of the mass: the mean area.
        """
        points, weights = np.polynomial.legendre.leggauss(4)
        start, width = arc_lengths[:-1, None], np.diff(arc_lengths)[:, None]
        ratio = self.radius_at(start + 0.5 * width * (1.0 + points)) / self.radius
        return 1.0 / (ratio**-4 @ weights / 2.0), ratio**2 @ weights / 2.0

    def unloaded_curvature(self, s: Array) -> Array:
        """Turning rates about x and y in the unloaded state at arc lengths ``s`` [m], shape (n, 2) [1/m]."""
        found = np.tile(np.array(self.precurvature, dtype=float), (len(s), 1))
        for patch in self.patches:
            found[(s >= patch.start) & (s < patch.end)] += patch.precurvature
        return found


#: Number of disks at equal distances; in files it may replace their positions.
DiskCount = Annotated[int, Quantity("disks at equal distances, the last at the tip", ge=1, le=10_000)]


#: Bays of a robot without disks: stretches of equal length, for its mesh and for effects at one place.
BAYS_WITHOUT_DISKS = 20


@dataclass(frozen=True)
class Disks:
    """Rigid disks on the backbone; the base plate at s = 0 is not one of them.

    Attributes
    ----------
    positions : tuple of float
        Arc lengths, ascending [m]. Empty: a robot without disks, whose tendons follow the backbone.
    mass : float
        Of each disk [kg].
    thickness : float
        Length of backbone that each disk makes rigid, centred on it [m].
    radius : float
        [m].
    """

    positions: Annotated[
        tuple[float, ...],
        Quantity(
            "arc lengths of the disks",
            unit="m",
            gt=0.0,
            allowed="arc lengths of the disks [m], at least one, ascending from above 0 to at most the length",
        ),
    ] = ()
    mass: Annotated[float, Quantity("of each disk", unit="kg", ge=0.0)] = 0.0
    thickness: Annotated[
        float, Quantity("length of backbone made rigid, centred on the disk", unit="m", ge=0.0)
    ] = 0.0
    radius: Annotated[float, Quantity("of the disks and of the base plate", unit="m", gt=0.0, le=1000.0)] = (
        5e-3
    )

    def __post_init__(self) -> None:
        check_fields(self)

    @classmethod
    def equally_spaced(cls, count: DiskCount, length: float, **rest: float) -> Disks:
        """``count`` disks at equal distances, the last at the tip."""
        positions = tuple(float(x) for x in length * np.arange(1, count + 1) / count)
        return cls(positions=positions, **rest)


@dataclass(frozen=True)
class TightHole:
    """A hole with an adhesion of its own, in place of its tendon's.

    Attributes
    ----------
    at : float
        Arc length [m].
    drop : float
        Tension that it takes at most [N]; a few times the largest tension holds the tendon fast.
    """

    at: Annotated[float, Quantity("arc length of a disk between base plate and anchor", unit="m", gt=0.0)]
    drop: Annotated[float, Quantity("tension that it takes at most", unit="N", ge=0.0)]

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class Tendon:
    """A cable through one hole in the base plate and in every disk up to the one it is anchored to.

    In a robot without disks it follows the backbone, in a channel of the body, up to its anchor.

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
    pretension : float
        Tension in the unloaded shape where all displacements are zero [N]; needs an elastic tendon. Before the first
        step that names it, a tendon with pretension is held at displacement zero.
    tight_holes : tuple of TightHole
        Holes that hold the tendon fast, or take more of its tension than the others.
    """

    name: Annotated[str, Quantity("by which steps and tables call it", name=True)]
    routing: Annotated[Routing, Quantity("where its holes lie", in_file=False)]
    friction_coefficient: Annotated[float, Quantity("mu of tendon and hole", ge=0.0)] = 0.0
    end: Annotated[
        float | None,
        Quantity(
            "arc length of the disk it is anchored to; any arc length without disks",
            unit="m",
            gt=0.0,
            note="where a disk is",
        ),
    ] = None
    axial_stiffness: Annotated[float | None, Quantity("EA of the tendon", unit="N", gt=0.0)] = None
    adhesion: Annotated[
        float, Quantity("tension drop per hole that does not grow with the tension", unit="N", ge=0.0)
    ] = 0.0
    clearance: Annotated[
        float, Quantity("how far the tendon can shift sideways in an oversized hole", unit="m", ge=0.0)
    ] = 0.0
    pretension: Annotated[
        float,
        Quantity(
            "tension in the unloaded shape where all displacements are zero",
            unit="N",
            ge=0.0,
            note="needs axial_stiffness",
        ),
    ] = 0.0
    tight_holes: Annotated[
        tuple[TightHole, ...], Quantity("holes that hold the tendon fast, or take more of its tension")
    ] = ()
    friction: Annotated[
        FrictionCoefficient | None,
        Quantity(
            "law of a coefficient that depends on slip rate or normal force",
            variants=FRICTION_COEFFICIENTS,
        ),
    ] = None

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class SideSpring:
    """A spring from one place of the backbone to ground, at rest where the unloaded robot is.

    It acts sideways: along the x and y axes of the base.

    Attributes
    ----------
    at : float
        Arc length [m].
    stiffness : float
        [N/m].
    """

    at: Annotated[float, Quantity("arc length", unit="m", gt=0.0)]
    stiffness: Annotated[float, Quantity("sideways, in every direction", unit="N/m", ge=0.0)]

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class Robot:
    """A tendon-driven continuum robot.

    Attributes
    ----------
    backbone : Backbone
    disks : Disks
        None by default: a robot without disks.
    tendons : tuple of Tendon
    name : str
    tip_mass : float
        Point mass at the tip besides the disk [kg].
    springs : tuple of SideSpring
        From the backbone to ground.
    base_stiffness : float or None
        Rotational stiffness with which the base plate holds the backbone, about x and y [N m/rad]; None is rigid.

    Raises
    ------
    ValueError
        With every contradiction found between the parts.
    """

    backbone: Annotated[Backbone, Quantity("the elastic rod")]
    disks: Annotated[Disks, Quantity("the rigid disks on it")] = Disks()
    tendons: Annotated[tuple[Tendon, ...], Quantity("one table a tendon", in_file=False)] = ()
    name: Annotated[str, Quantity("of the robot", name=True)] = "robot"
    tip_mass: Annotated[float, Quantity("point mass at the tip besides the disk", unit="kg", ge=0.0)] = 0.0
    springs: Annotated[tuple[SideSpring, ...], Quantity("springs from the backbone to ground")] = ()
    base_stiffness: Annotated[
        float | None,
        Quantity("with which the base plate holds the backbone, about x and y", unit="N m/rad", gt=0.0),
    ] = None

    def __post_init__(self) -> None:
        check_fields(self)
        found = robot_contradictions(self)
        if found:
            lines = "\n".join(f"  {c.key}: {c.value}; {c.allowed}" for c in found)
            raise ValueError(f"robot {self.name!r}:\n{lines}")

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

    @property
    def without_disks(self) -> bool:
        """Whether there are no disks, so that tendons follow the backbone."""
        return not self.disks.positions

    @property
    def plate_radius(self) -> float:
        """Radius of disks and base plate, as it is drawn; without disks that of the backbone at its base [m]."""
        return self.backbone.radius if self.without_disks else self.disks.radius

    @property
    def bay_ends(self) -> tuple[float, ...]:
        """Arc lengths where bays end: disks; without disks a twentieth of the backbone after the other [m]."""
        if self.disks.positions:
            return self.disks.positions
        n = BAYS_WITHOUT_DISKS
        return tuple(self.backbone.length * k / n for k in range(1, n + 1))

    @property
    def bay_edges(self) -> Array:
        """Arc lengths of base plate, ends of bays and, where it lies beyond the last disk, tip [m], (n_bays + 1,)."""
        edges = [0.0, *self.bay_ends]
        if self.backbone.length - edges[-1] > ARC_TOLERANCE:
            edges.append(self.backbone.length)
        return np.array(edges)

    def end(self, tendon: Tendon) -> float:
        """Arc length of the tendon's anchor [m]."""
        return self.backbone.length if tendon.end is None else tendon.end

    def hole_arc_lengths(self, tendon: Tendon) -> Array:
        """Arc lengths of the tendon's holes, base plate first, anchor last [m], shape (n + 1,).

        Without disks, those of base plate and anchor.
        """
        if self.without_disks:
            return np.array([0.0, self.end(tendon)])
        positions = np.asarray(self.disks.positions, dtype=float)
        return np.concatenate(([0.0], positions[positions <= self.end(tendon) + ARC_TOLERANCE]))

    def holes(self, tendon: Tendon) -> Array:
        """The tendon's holes in their section frames, base plate first, anchor last [m], shape (n + 1, 2)."""
        end = self.end(tendon)
        return tendon.routing.position(self.hole_arc_lengths(tendon), end)

    def hole_points(self, tendon: Tendon) -> Array:
        """The tendon's holes with their position along the tangent, zero in upright disks [m], shape (n + 1, 3)."""
        along = tendon.routing.axial(self.hole_arc_lengths(tendon), self.end(tendon))
        return np.column_stack((self.holes(tendon), along))

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
