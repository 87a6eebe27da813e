"""One case of the cross-validation, its tolerances, and the robots and loads that all cases are made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting
from tdcr_fe.model.tendon import Tendon

#: Length of the backbone [m].
LENGTH = 0.25
BACKBONE = Backbone(LENGTH, 0.4e-3, 85e9, 0.3, density=5600.0)
#: Friction coefficient where a case has friction [1].
MU = 0.3
#: Beam elements between neighbouring disks, in every case.
ELEMENTS_PER_BAY = 4
#: Presliding distance of both solvers [m].
PRESLIDING = 1e-6
#: Tolerances [% of the length], [% of the tendon's largest tension].
TIP_TOLERANCE, TENSION_TOLERANCE = 0.05, 0.1
#: Upper bound of the median over all cases [% of the length].
MEDIAN_TOLERANCE = 0.01
#: Least order of mesh convergence.
LEAST_ORDER = 1.9
#: Highest tension [N], and the share of a bay's buckling load that all tendons together stay below.
MOST_TENSION, MOST_COMPRESSION = 4.0, 0.3

ROUTINGS = ("parallel", "two-segment", "helical", "converging")
#: (tendon path, friction)
MODELS = (
    ("continuous", "none"),
    ("straight", "none"),
    ("straight", "per-tendon"),
    ("straight", "per-hole"),
)
LOADS = ("no load", "tip in plane", "tip out of plane", "mid-span", "gravity")
DISKS = (5, 10, 15, 20)
GRAVITY = (2.0, -9.0, -3.0)
#: Plane in which the tendon of a single-segment robot bends it, from +x towards +y [deg].
PLANE_DEG = 40.0

Values = Sequence[float]


@dataclass(frozen=True)
class Case:
    """One robot, model and loading sequence, for both solvers.

    Attributes
    ----------
    id : str
    group : str
        "grid", "large bending", "history" or "variant".
    routing, load : str
        In words.
    robot : Robot
    model : Model
    steps : tuple of LoadStep
        Each with its number of substeps.
    quick : bool
        Part of the quick set.
    tolerance_percent, tension_tolerance_percent : float
        Of the length; of the tendon's largest tension.
    """

    id: str
    group: str
    routing: str
    load: str
    robot: Robot
    model: Model
    steps: tuple[LoadStep, ...]
    quick: bool = False
    tolerance_percent: float = TIP_TOLERANCE
    tension_tolerance_percent: float = TENSION_TOLERANCE

    @property
    def disks(self) -> int:
        """Number of disks."""
        return len(self.robot.disks.positions)


def bay_buckling_load(disks: int) -> float:
    """Axial force at which the backbone between two disks, hinged at both, would buckle, ``pi^2 EI / bay^2`` [N]."""
    return float(np.pi**2 * BACKBONE.EI * (disks / LENGTH) ** 2)


def highest_tension(disks: int) -> float:
    """Sum of the tensions that a case goes up to [N].

    4 N, but not more than 30 % of the load at which the backbone between two disks would buckle. The error beyond this
    load is the subject of `tdcr_fe.validation.crosscheck.studies.near_buckling`.
    """
    return min(MOST_TENSION, MOST_COMPRESSION * bay_buckling_load(disks))


def make_robot(routing: str, disks: int, mu: float = MU) -> Robot:
    """The robot of a routing.

    Parameters
    ----------
    routing
        One of `ROUTINGS`. Helical tendons wind once (from ten disks on: twice) about the backbone; the first
        segment of two ends at 40 % of the length.
    disks
        Number, a multiple of five for two segments.
    mu
        Friction coefficient [1].
    """
    tendons: list[Tendon]
    if routing == "parallel":
        tendons = [Tendon("t1", ParallelRouting(4.5e-3, PLANE_DEG), mu)]
    elif routing == "two-segment":
        end = round(0.4 * LENGTH, 9)
        tendons = [
            Tendon(f"a{i}", ParallelRouting(4.5e-3, a), mu, end=end)
            for i, a in enumerate((90.0, 330.0, 210.0))
        ]
        tendons += [
            Tendon(f"b{i}", ParallelRouting(3.5e-3, a), mu) for i, a in enumerate((30.0, 150.0, 270.0))
        ]
    elif routing == "helical":
        turns = 2.0 if disks >= 10 else 1.0
        tendons = [Tendon("t1", HelicalRouting(4.5e-3, turns, PLANE_DEG), mu)]
    elif routing == "converging":
        tendons = [Tendon("t1", ConvergingRouting(4.5e-3, 0.15e-3, PLANE_DEG), mu)]
    else:
        raise ValueError(f"routing {routing!r}; must be one of {', '.join(ROUTINGS)}")
    return Robot(
        BACKBONE, Disks.equally_spaced(disks, LENGTH, mass=0.17e-3, radius=5e-3), tuple(tendons), name=routing
    )


def pulls(routing: str, share: float, total: float) -> dict[str, float]:
    """Tensions of a share of the highest ones, by tendon [N]."""
    if routing == "two-segment":
        return {"a0": 0.55 * total * share, "b0": 0.45 * total * share}
    return {"t1": total * share}


def make_load(load: str) -> tuple[dict[str, Load], tuple[float, float, float]]:
    """Concentrated loads, and gravity [m/s^2], of one of `LOADS`."""
    c, s = float(np.cos(np.radians(PLANE_DEG))), float(np.sin(np.radians(PLANE_DEG)))
    none = (0.0, 0.0, 0.0)
    if load == "no load":
        return {}, none
    if load == "tip in plane":
        return {"tip": Load(LENGTH, (-0.05 * c, -0.05 * s, 0.0))}, none
    if load == "tip out of plane":
        return {"tip": Load(LENGTH, (-0.05 * s, 0.05 * c, 0.0))}, none
    if load == "mid-span":
        return {"middle": Load(LENGTH / 2.0, (0.08 * c - 0.04 * s, 0.08 * s + 0.04 * c, -0.02))}, none
    if load == "gravity":
        return {}, GRAVITY
    raise ValueError(f"load {load!r}; must be one of {', '.join(LOADS)}")
