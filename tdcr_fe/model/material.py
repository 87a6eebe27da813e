"""How a backbone's material departs from linear elasticity: softening with curvature, nonlinear fibres."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from tdcr_fe.model.schema import Quantity, check_fields


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
