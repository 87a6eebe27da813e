"""The robot as data: backbone, disks, tendons and springs to ground, frozen and in SI units. Imports no solver.

World frame: base plate at the origin, undeformed backbone along +z.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Annotated, Any

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.checks import ARC_TOLERANCE, robot_contradictions
from tdcr_fe.model.friction import FRICTION_COEFFICIENTS, FrictionCoefficient
from tdcr_fe.model.messages import meant, shown
from tdcr_fe.model.routing import Routing
from tdcr_fe.model.schema import Checked, FieldError, Quantity, check_instance


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
        Radius of the spool [m]: the length wound is the radius times the motor's angle.
    stiffness : float or None
        Stiffness of the spring in series with the tendon [N/m]. None is rigid.
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
        Where its holes lie. In ``robot.toml`` its fields are keys of the table of the tendon, beside its name.
    friction_coefficient : float
        Coefficient of friction between tendon and holes [1]. ``mu`` in the Capstan equation (paper, Eq. 28).
    end : float or None
        Arc length of the disk to which it is anchored; by default the tip [m]. On a robot without disks it may be
        anchored anywhere.
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


# --------------------------------------------------------------------------------------------------------- the robot

_POSITIONS = "arc lengths of the disks [m], at least one, ascending from above 0 to at most the length"


@dataclass(frozen=True)
class Disks(Checked):
    """Rigid disks on the backbone; the base plate at s = 0 is not one of them.

    Attributes
    ----------
    positions : tuple of float
        Arc lengths of the disks, ascending [m]. Empty: a robot without disks, whose tendons follow the backbone.
    mass : float
        Mass of each disk [kg].
    thickness : float
        Length of backbone made rigid, centred on the disk [m].
    radius : float
        Radius of the disks and of the base plate [m].
    """

    positions: Annotated[tuple[float, ...], Quantity(unit="m", gt=0.0, allowed=_POSITIONS)] = ()
    mass: Annotated[float, Quantity(unit="kg", ge=0.0)] = 0.0
    thickness: Annotated[float, Quantity(unit="m", ge=0.0)] = 0.0
    radius: Annotated[float, Quantity(unit="m", gt=0.0, le=1000.0)] = 5e-3

    @classmethod
    def equally_spaced(cls, count: int, length: float, **rest: float) -> Disks:
        """``count`` disks at equal distances, the last at the tip."""
        hint = "a whole number, and then the length [m]"
        check_instance("Disks.equally_spaced", "count", count, Integral, hint)
        return cls(positions=tuple(float(x) for x in length * np.arange(1, count + 1) / count), **rest)


#: Bays of a robot without disks: stretches of equal length, for its mesh and for effects at one place.
BAYS_WITHOUT_DISKS = 20


@dataclass(frozen=True)
class SideSpring(Checked):
    """A spring from one place of the backbone to ground, at rest where the unloaded robot is.

    It acts sideways: along the x and y axes of the base.

    Attributes
    ----------
    at : float
        Arc length [m].
    stiffness : float
        Stiffness sideways, the same in every direction [N/m].
    """

    at: Annotated[float, Quantity(unit="m", gt=0.0)]
    stiffness: Annotated[float, Quantity(unit="N/m", ge=0.0)]


@dataclass(frozen=True)
class Robot(Checked):
    """A tendon-driven continuum robot.

    Attributes
    ----------
    backbone : Backbone
        The elastic rod.
    disks : Disks
        The rigid disks on it; without them tendons follow the backbone.
    tendons : tuple of Tendon
        Its tendons; in ``robot.toml`` one table ``[[tendons]]`` for each.
    name : str
        Name of the robot.
    tip_mass : float
        Point mass at the tip besides the disk [kg].
    springs : tuple of SideSpring
        Springs from the backbone to ground.
    base_stiffness : float or None
        Stiffness of the base against turning about x and y [N m/rad]. None is rigid.

    Raises
    ------
    ValueError
        With every contradiction found between the parts.
    """

    backbone: Backbone
    disks: Disks = Disks()
    tendons: Annotated[tuple[Tendon, ...], Quantity(in_file=False)] = ()
    name: Annotated[str, Quantity(name=True)] = "robot"
    tip_mass: Annotated[float, Quantity(unit="kg", ge=0.0)] = 0.0
    springs: tuple[SideSpring, ...] = ()
    base_stiffness: Annotated[float | None, Quantity(unit="N m/rad", gt=0.0)] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        lines = "\n".join(f"  {c.key}: {c.value}; {c.allowed}" for c in robot_contradictions(self))
        if lines:
            raise ValueError(f"robot {self.name!r}:\n{lines}")

    def __repr__(self) -> str:
        disks, tendons = len(self.disks.positions), ", ".join(self.tendon_names) or "none"
        return f"Robot {self.name!r}: {1e3 * self.backbone.length:g} mm, disks {disks}, tendons {tendons}"

    @property
    def tendon_names(self) -> tuple[str, ...]:
        """Names in order."""
        return tuple(t.name for t in self.tendons)

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
        return tendon.routing.position(self.hole_arc_lengths(tendon), self.end(tendon))

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
        chosen = self.tendon_names if names is None else names
        tendons = [replace(t, **changes) if t.name in chosen else t for t in self.tendons]
        return replace(self, tendons=tuple(tendons))
