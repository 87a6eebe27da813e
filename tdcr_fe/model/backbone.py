"""The backbone as data: the elastic rod, its section and material, and stretches of it that are different.

Section frames are aligned with the world in the straight state; the tangent is the third axis of the section frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.model.schema import Checked, Quantity


@dataclass(frozen=True)
class Superelastic(Checked):
    """Bending moment that softens with curvature (NiTi).

    ``EI kappa`` up to ``kappa * radius = threshold_strain``; beyond it the slope is ``plateau_ratio * EI``;
    the slope changes smoothly over a tenth of the threshold.

    Attributes
    ----------
    threshold_strain : float
        Strain of the outer fibre where the plateau begins [1].
    plateau_ratio : float
        Slope beyond the threshold over the slope before it [1].
    """

    threshold_strain: Annotated[float, Quantity(gt=0.0, le=1.0)]
    plateau_ratio: Annotated[float, Quantity(gt=0.0, le=1.0)]


@dataclass(frozen=True)
class NonlinearMaterial(Checked):
    """Fibres along the backbone with the nominal stress ``E (e + quadratic e^2 + cubic e^3)`` at the strain ``e``.

    Bending and stretching are coupled: with ``quadratic`` below zero a compressed backbone bends less. The
    third-order expansion of a neo-Hookean material has -1 and 4/3. Shear and torsion stay linear.

    Attributes
    ----------
    quadratic : float
        Coefficient b; negative: softer in tension, stiffer in compression [1].
    cubic : float
        Coefficient c; positive: hardening, negative: softening [1].
    """

    quadratic: Annotated[float, Quantity(ge=-100.0, le=100.0)] = 0.0
    cubic: Annotated[float, Quantity(ge=-1000.0, le=10_000.0)] = 0.0

    @property
    def largest_strain(self) -> float:
        """Smallest strain in tension or compression beyond which the stress falls [1]; infinite where there is none."""
        turns = np.roots([3.0 * self.cubic, 2.0 * self.quadratic, 1.0])  # where the slope is zero
        return float(np.min(np.abs(turns[np.isreal(turns)]), initial=math.inf))


@dataclass(frozen=True)
class StiffnessPatch(Checked):
    """A stretch of the backbone with other stiffness, of another material, or bent when unloaded.

    Attributes
    ----------
    start : float
        Arc length where it begins [m].
    end : float
        Arc length where it ends [m].
    bending : float
        Factor on the bending stiffness [1].
    torsion : float
        Factor on the torsional stiffness [1].
    precurvature : (float, float)
        Turning rate about x and y when unloaded, added to the backbone's [1/m].
    modulus : float
        Factor on all stiffnesses, those above included: another material [1].
    density : float
        Factor on the density: another material [1].
    """

    start: Annotated[float, Quantity(unit="m", ge=0.0)]
    end: Annotated[float, Quantity(unit="m", gt=0.0)]
    bending: Annotated[float, Quantity(gt=0.0)] = 1.0
    torsion: Annotated[float, Quantity(gt=0.0)] = 1.0
    precurvature: Annotated[tuple[float, float], Quantity(unit="1/m")] = (0.0, 0.0)
    modulus: Annotated[float, Quantity(gt=0.0)] = 1.0
    density: Annotated[float, Quantity(ge=0.0)] = 1.0


@dataclass(frozen=True)
class Backbone(Checked):
    """The elastic rod, with section stiffness ``diag(GJ, EI, EI, EA, GA, GA)`` (paper, below Eq. 5).

    Attributes
    ----------
    length : float
        Length from base plate to tip [m].
    radius : float
        Radius of the (round) cross-section; with a taper at the base [m].
    youngs_modulus : float
        Young's modulus E [Pa].
    poisson_ratio : float
        Poisson's ratio nu; the shear modulus is G = E / (2 (1 + nu)) [1].
    density : float
        Density of the material, for gravity and dynamics [kg/m^3].
    bending_stiffness : float or None
        Bending stiffness EI instead of E pi r^4 / 4 [N m^2].
    torsional_stiffness : float or None
        Torsional stiffness GJ instead of G pi r^4 / 2 [N m^2].
    axial_stiffness : float or None
        Axial stiffness EA instead of E pi r^2 [N].
    shear_stiffness : float or None
        Shear stiffness GA instead of G pi r^2 [N].
    precurvature : (float, float)
        Turning rate of the section about its x and y axes in the unloaded state [1/m].
    superelastic : Superelastic or None
        Softening of the bending moment (NiTi).
    nonlinear : NonlinearMaterial or None
        Fibres that harden or soften with their strain.
    patches : tuple of StiffnessPatch
        Parts of the backbone with another stiffness or precurvature.
    creep_rate : float
        Growth of bending and torsional compliance per time under load, relative to the declared one [1/s].
    retardation_time : float
        Damping by the material in dynamics, as stress per stiffness and strain rate [s]. Kelvin-Voigt: the wrench of a
        section grows by this times its stiffness times the rate of its strain.
    taper : tuple of (float, float)
        Arc length and radius, from base to tip [m]. Linear in between; it begins with ``radius``. Empty: the radius is
        constant. In files it is the list given as ``radius``. Stiffnesses that are declared are those at the base.
    """

    length: Annotated[float, Quantity(unit="m", gt=0.0, le=1000.0)]
    radius: Annotated[float, Quantity(unit="m", ge=1e-9, le=1000.0)]
    youngs_modulus: Annotated[float, Quantity(unit="Pa", ge=1e-6, le=1e18)]
    poisson_ratio: Annotated[float, Quantity(gt=-1.0, le=0.5)]
    density: Annotated[float, Quantity(unit="kg/m^3", ge=0.0)] = 0.0
    bending_stiffness: Annotated[float | None, Quantity(unit="N m^2", gt=0.0)] = None
    torsional_stiffness: Annotated[float | None, Quantity(unit="N m^2", gt=0.0)] = None
    axial_stiffness: Annotated[float | None, Quantity(unit="N", gt=0.0)] = None
    shear_stiffness: Annotated[float | None, Quantity(unit="N", gt=0.0)] = None
    precurvature: Annotated[tuple[float, float], Quantity(unit="1/m", note="such as [0.0, 2.5]")] = (0.0, 0.0)
    superelastic: Superelastic | None = None
    nonlinear: NonlinearMaterial | None = None
    patches: tuple[StiffnessPatch, ...] = ()
    creep_rate: Annotated[float, Quantity(unit="1/s", ge=0.0)] = 0.0
    retardation_time: Annotated[float, Quantity(unit="s", ge=0.0)] = 0.0
    taper: Annotated[tuple[tuple[float, float], ...], Quantity(unit="m", in_file=False)] = ()

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
        return self.bending_stiffness or self.youngs_modulus * self.second_moment

    @property
    def GJ(self) -> float:
        """Torsional stiffness [N m^2]."""
        return self.torsional_stiffness or self.shear_modulus * 2.0 * self.second_moment

    @property
    def EA(self) -> float:
        """Axial stiffness [N]."""
        return self.axial_stiffness or self.youngs_modulus * self.area

    @property
    def GA(self) -> float:
        """Shear stiffness, without shear correction [N]."""
        return self.shear_stiffness or self.shear_modulus * self.area

    @property
    def mass_per_length(self) -> float:
        """[kg/m]."""
        return self.density * self.area

    def stiffness_factors(self, s: Array) -> tuple[Array, Array]:
        """Factors of bending and torsional stiffness at arc lengths ``s`` [m], each of shape ``s.shape``."""
        return self._patched(s, "bending", "modulus"), self._patched(s, "torsion", "modulus")

    def material_factors(self, s: Array) -> tuple[Array, Array]:
        """Factors of axial and shear stiffness, and of the mass, at arc lengths ``s`` [m], each like ``s``."""
        return self._patched(s, "modulus"), self._patched(s, "density")

    def _patched(self, s: Array, *factors: str) -> Array:
        """Product of some factors of all patches at arc lengths, shape ``s.shape``."""
        found = np.ones_like(s)
        for patch in self.patches:
            found[(s >= patch.start) & (s < patch.end)] *= math.prod(getattr(patch, name) for name in factors)
        return found

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
            For bending and torsional stiffness: the inverse of the mean compliance.
        area : ndarray
            For axial and shear stiffness, and for the mass: the mean area.
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
