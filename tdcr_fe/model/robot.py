"""The robot as data: backbone, disks, tendons and springs to ground, frozen and in SI units. Imports no solver.

World frame: base plate at the origin, undeformed backbone along +z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.checks import ARC_TOLERANCE, robot_contradictions
from tdcr_fe.model.schema import Checked, Quantity
from tdcr_fe.model.tendon import Tendon

DiskCount = Annotated[int, Quantity("disks at equal distances, the last at the tip", ge=1, le=10_000)]


@dataclass(frozen=True)
class Disks(Checked):
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
            "m",
            gt=0.0,
            allowed="arc lengths of the disks [m], at least one, ascending from above 0 to at most the length",
        ),
    ] = ()
    mass: Annotated[float, Quantity("mass of each disk", "kg", ge=0.0)] = 0.0
    thickness: Annotated[
        float, Quantity("length of backbone made rigid, centred on the disk", "m", ge=0.0)
    ] = 0.0
    radius: Annotated[
        float, Quantity("radius of the disks and of the base plate", "m", gt=0.0, le=1000.0)
    ] = 5e-3

    @classmethod
    def equally_spaced(cls, count: DiskCount, length: float, **rest: float) -> Disks:
        """``count`` disks at equal distances, the last at the tip."""
        positions = tuple(float(x) for x in length * np.arange(1, count + 1) / count)
        return cls(positions=positions, **rest)


Array = NDArray[np.float64]

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
        [N/m].
    """

    at: Annotated[float, Quantity("arc length", "m", gt=0.0)]
    stiffness: Annotated[float, Quantity("stiffness sideways, the same in every direction", "N/m", ge=0.0)]


@dataclass(frozen=True)
class Robot(Checked):
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
    tendons: Annotated[tuple[Tendon, ...], Quantity("one table per tendon", in_file=False)] = ()
    name: Annotated[str, Quantity("name of the robot", name=True)] = "robot"
    tip_mass: Annotated[float, Quantity("point mass at the tip besides the disk", "kg", ge=0.0)] = 0.0
    springs: Annotated[tuple[SideSpring, ...], Quantity("springs from the backbone to ground")] = ()
    base_stiffness: Annotated[
        float | None, Quantity("stiffness of the base against turning about x and y", "N m/rad", gt=0.0)
    ] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        found = robot_contradictions(self)
        if found:
            lines = "\n".join(f"  {c.key}: {c.value}; {c.allowed}" for c in found)
            raise ValueError(f"robot {self.name!r}:\n{lines}")

    def __repr__(self) -> str:
        disks, tendons = len(self.disks.positions), ", ".join(self.tendon_names) or "none"
        return f"Robot {self.name!r}: {1e3 * self.backbone.length:g} mm, disks {disks}, tendons {tendons}"

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
