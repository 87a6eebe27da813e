"""A tendon as data: its routing, friction, elasticity and holes of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.model.friction import FRICTION_COEFFICIENTS, FrictionCoefficient
from tdcr_fe.model.messages import meant, shown
from tdcr_fe.model.routing import Routing
from tdcr_fe.model.schema import Checked, FieldError, Quantity


@dataclass(frozen=True)
class TightHole(Checked):
    """A hole with friction of its own, in place of its tendon's.

    Attributes
    ----------
    at : float
        Arc length of a disk between base plate and anchor [m].
    drop : float or None
        Tension that it takes at most [N]; a few times the largest tension holds the tendon fast. None: the adhesion of
        the tendon.
    friction_coefficient : float or None
        Coefficient of friction at this hole [1]. None: that of the tendon.
    """

    at: Annotated[float, Quantity(unit="m", gt=0.0)]
    drop: Annotated[float | None, Quantity(unit="N", ge=0.0)] = None
    friction_coefficient: Annotated[float | None, Quantity(ge=0.0)] = None


@dataclass(frozen=True)
class Spool(Checked):
    """A spool on which a motor winds a tendon, with a spring between both.

    Attributes
    ----------
    radius : float
        Of the spool [m]: the length wound is the radius times the motor's angle.
    stiffness : float or None
        Of the spring in series with the tendon [N/m]. None is rigid.
    """

    radius: Annotated[float, Quantity(unit="m", gt=0.0, le=1.0)]
    stiffness: Annotated[float | None, Quantity(unit="N/m", gt=0.0)] = None


@dataclass(frozen=True)
class Tendon(Checked):
    """A cable through one hole in the base plate and in every disk up to the one it is anchored to.

    In a robot without disks it follows the backbone, in a channel of the body, up to its anchor.

    Attributes
    ----------
    name : str
        Name of the tendon in steps and tables.
    routing : Routing
        Where its holes lie.
    friction_coefficient : float
        Coefficient of friction between tendon and holes [1]. ``mu`` in the Capstan equation (paper, Eq. 28).
    end : float or None
        Arc length of the disk it is anchored to, without it the tip; any arc length without disks [m].
    axial_stiffness : float or None
        Axial stiffness EA of the tendon [N]. None is inextensible.
    adhesion : float
        Tension drop per hole that does not grow with the tension [N].
    clearance : float
        How far the tendon can shift sideways in an oversized hole [m].
    pretension : float
        Tension in the unloaded shape where all displacements are zero [N]. Needs an elastic tendon. Before the first
        step that names it, a tendon with pretension is held at displacement zero.
    tight_holes : tuple of TightHole
        Holes that hold the tendon fast, or take more of its tension than the others.
    spool : Spool or None
        On which a motor winds it; needed where the motor's angle is prescribed.
    friction : FrictionCoefficient or None
        Law of a coefficient that depends on slip rate or normal force, in place of friction_coefficient.
    """

    name: Annotated[str, Quantity(name=True)]
    routing: Annotated[Routing, Quantity(in_file=False)]
    friction_coefficient: Annotated[float, Quantity(ge=0.0)] = 0.0
    end: Annotated[float | None, Quantity(unit="m", gt=0.0, note="where a disk is")] = None
    axial_stiffness: Annotated[float | None, Quantity(unit="N", gt=0.0)] = None
    adhesion: Annotated[float, Quantity(unit="N", ge=0.0)] = 0.0
    clearance: Annotated[float, Quantity(unit="m", ge=0.0)] = 0.0
    pretension: Annotated[float, Quantity(unit="N", ge=0.0, note="needs axial_stiffness")] = 0.0
    tight_holes: tuple[TightHole, ...] = ()
    spool: Spool | None = None
    friction: Annotated[FrictionCoefficient | None, Quantity(variants=FRICTION_COEFFICIENTS)] = None


def by_tendon(
    key: str, given: float | Mapping[str, float], names: Sequence[str], default: float | None = None
) -> Array:
    """Numbers of all tendons, from one for all or a table by name; those that it may leave out have a default.

    Raises
    ------
    FieldError
        The table names an unknown tendon, or not all that it must.
    """
    table = given if isinstance(given, Mapping) else dict.fromkeys(names, given)
    wrong = [f"unknown tendon {name}{meant(name, names)}" for name in table if name not in names]
    if default is None:
        wrong += [f"tendon {name} is missing" for name in names if name not in table]
    if wrong:
        raise FieldError(key, shown(given), f"{'; '.join(wrong)}; the robot has {', '.join(names)}")
    return np.array([table.get(name, default) for name in names], dtype=float)
