"""A tendon as data: its routing, friction, elasticity and holes of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from tdcr_fe.model.friction import FRICTION_COEFFICIENTS, FrictionCoefficient
from tdcr_fe.model.routing import Routing
from tdcr_fe.model.schema import Checked, Quantity


@dataclass(frozen=True)
class TightHole(Checked):
    """A hole with an adhesion of its own, in place of its tendon's.

    Attributes
    ----------
    at : float
        Arc length [m].
    drop : float
        Tension that it takes at most [N]; a few times the largest tension holds the tendon fast.
    """

    at: Annotated[float, Quantity("arc length of a disk between base plate and anchor", "m", gt=0.0)]
    drop: Annotated[float, Quantity("tension that it takes at most", "N", ge=0.0)]


@dataclass(frozen=True)
class Tendon(Checked):
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

    name: Annotated[str, Quantity("name of the tendon in steps and tables", name=True)]
    routing: Annotated[Routing, Quantity("where its holes lie", in_file=False)]
    friction_coefficient: Annotated[
        float, Quantity("coefficient of friction between tendon and holes", ge=0.0)
    ] = 0.0
    end: Annotated[
        float | None,
        Quantity(
            "arc length of the disk it is anchored to; any arc length without disks",
            "m",
            gt=0.0,
            note="where a disk is",
        ),
    ] = None
    axial_stiffness: Annotated[float | None, Quantity("axial stiffness EA of the tendon", "N", gt=0.0)] = None
    adhesion: Annotated[
        float, Quantity("tension drop per hole that does not grow with the tension", "N", ge=0.0)
    ] = 0.0
    clearance: Annotated[
        float, Quantity("how far the tendon can shift sideways in an oversized hole", "m", ge=0.0)
    ] = 0.0
    pretension: Annotated[
        float,
        Quantity(
            "tension in the unloaded shape where all displacements are zero",
            "N",
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
            "law of a coefficient that depends on slip rate or normal force", variants=FRICTION_COEFFICIENTS
        ),
    ] = None
