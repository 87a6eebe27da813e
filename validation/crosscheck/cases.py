"""The cases of the cross-validation, and the robots, loads and tolerances that they are made of.

All routings, models, loads and numbers of disks; histories; variants for the remaining properties of a description.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from types import MappingProxyType
from typing import Any

import numpy as np

from tdcr_fe.model.backbone import Backbone, StiffnessPatch, Superelastic
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
MODELS = (("continuous", "none"), ("straight", "none"), ("straight", "per-tendon"), ("straight", "per-hole"))
LOADS = ("no load", "tip in plane", "tip out of plane", "mid-span", "gravity")
DISKS = (5, 10, 15, 20)
GRAVITY = (2.0, -9.0, -3.0)
#: Plane in which the tendon of a single-segment robot bends it, from +x towards +y [deg].
PLANE_DEG = 40.0

Values = Sequence[float]


@dataclass(frozen=True)
class Case:
    """One robot, model and loading sequence, for both solvers."""

    id: str
    group: str  # "grid", "large bending", "history" or "variant"
    routing: str
    load: str  # in words
    robot: Robot
    model: Model
    steps: tuple[LoadStep, ...]  # each with its number of substeps
    quick: bool = False  # part of the quick set
    tolerance_percent: float = TIP_TOLERANCE  # of the length
    tension_tolerance_percent: float = TENSION_TOLERANCE  # of the tendon's largest tension

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


def grid() -> Iterator[Case]:
    """Routings x models x loads x numbers of disks: three levels up, one down."""
    for (r, routing), (m, (path, friction)), (k, load) in product(
        enumerate(ROUTINGS), enumerate(MODELS), enumerate(LOADS)
    ):
        for i, disks in enumerate(DISKS):
            loads, gravity = make_load(load)
            total = highest_tension(disks)
            substeps = 1 if friction == "none" else 4
            steps = tuple(
                LoadStep(
                    f"{share:g} of the highest tension",
                    pulls(routing, share, total),
                    loads=loads,
                    substeps=substeps,
                )
                for share in (0.3, 0.65, 1.0, 0.5)
            )
            yield Case(
                f"{routing}_{path}_{friction}_{load.replace(' ', '-')}_{disks}",
                "grid",
                routing,
                load,
                make_robot(routing, disks),
                Model(path, friction, ELEMENTS_PER_BAY, gravity),  # type: ignore[arg-type]
                steps,
                quick=i == (r + m + k) % len(DISKS),
            )


def large_bending() -> Iterator[Case]:
    """Tips turned far beyond 180 degrees."""
    for (path, friction), disks in product(MODELS, (15, 20)):
        most = 5.5 if friction == "none" else 8.0
        substeps = 1 if friction == "none" else 4
        yield Case(
            f"large_parallel_{path}_{friction}_{disks}",
            "large bending",
            "parallel",
            "no load",
            make_robot("parallel", disks),
            Model(path, friction, ELEMENTS_PER_BAY),  # type: ignore[arg-type]
            tuple(
                LoadStep(f"{t:g} N", {"t1": t}, substeps=substeps)
                for t in most * np.array([0.25, 0.5, 0.75, 1.0])
            ),
            quick=disks == 20,
        )


#: Loading, unloading, reloading, as shares of the highest tension.
CYCLE = (0.35, 0.7, 1.0, 0.8, 0.5, 0.2, 0.0, 0.3, 0.7, 1.0)


def _cycle(routing: str, total: float, loads: dict[str, Load]) -> tuple[LoadStep, ...]:
    return tuple(
        LoadStep(f"{share:g} of the highest tension", pulls(routing, share, total), loads=loads, substeps=4)
        for share in CYCLE
    )


def _antagonists(disks: int, mu: float = MU) -> Robot:
    tendons = tuple(Tendon(f"t{i}", ParallelRouting(4.5e-3, PLANE_DEG + 90.0 * i), mu) for i in range(4))
    return replace(make_robot("parallel", disks), tendons=tendons)


def histories() -> Iterator[Case]:
    """Loading, unloading and reloading; and four tendons pulled one against the other."""
    for routing, friction in product(ROUTINGS, ("per-tendon", "per-hole")):
        for disks, load in ((10, "no load"), (15, "tip out of plane"), (20, "gravity")):
            loads, gravity = make_load(load)
            yield Case(
                f"history_{routing}_{friction}_{load.replace(' ', '-')}_{disks}",
                "history",
                routing,
                load,
                make_robot(routing, disks),
                Model("straight", friction, ELEMENTS_PER_BAY, gravity),  # type: ignore[arg-type]
                _cycle(routing, highest_tension(disks), loads),
                quick=disks == 10,
            )
    for friction, disks in product(("per-tendon", "per-hole"), (10, 20)):
        turn = np.arange(12) * np.pi / 4.0
        levels = [
            {f"t{i}": float(0.4 + 0.9 * max(0.0, np.cos(a - i * np.pi / 2.0))) for i in range(4)}
            for a in turn
        ]
        yield Case(
            f"history_antagonists-circle_{friction}_{disks}",
            "history",
            "parallel",
            "no load",
            _antagonists(disks),
            Model("straight", friction, ELEMENTS_PER_BAY),  # type: ignore[arg-type]
            tuple(LoadStep(f"circle {k + 1}", t, substeps=4) for k, t in enumerate(levels)),
            quick=disks == 10,
        )
    for name, names, routing, disks in (
        ("antagonists", [f"t{i}" for i in range(4)], "parallel", 13),
        ("two-segment", ["a0", "a1", "a2", "b0", "b1", "b2"], "two-segment", 10),
    ):
        draw = np.random.default_rng(20)
        walk = [
            {n: float(t) for n, t in zip(names, draw.uniform(0.0, 6.0 / len(names), len(names)), strict=True)}
            for _ in range(8)
        ]
        robot = _antagonists(disks) if name == "antagonists" else make_robot(routing, disks)
        yield Case(
            f"history_{name}-walk_per-hole_{disks}",
            "history",
            routing,
            "no load",
            robot,
            Model("straight", "per-hole", ELEMENTS_PER_BAY),
            tuple(LoadStep(f"walk {k + 1}", t, substeps=6) for k, t in enumerate(walk)),
            quick=name == "two-segment",
        )


# ------------------------------------------------------------------------------------------------- variants

#: Model options of tendons that follow the backbone.
_CONTINUOUS = {"tendon_path": "continuous", "friction": "none"}

#: A tip force out of the plane of bending, and its name.
_SIDE, _SIDE_NAME = make_load("tip out of plane")[0], "tip out of plane"


def _case(name: str, robot: Robot, steps: Sequence[LoadStep], load: str = "no load", **model: Any) -> Case:
    options = {"elements_per_bay": ELEMENTS_PER_BAY, **model}
    return Case(
        f"variant_{name}", "variant", robot.name, load, robot, Model(**options), tuple(steps), quick=True
    )


def _up_and_down(loads: Mapping[str, Load] = MappingProxyType({}), most: float = 3.0) -> list[LoadStep]:
    """Loading, unloading, reloading of the tendon up to a tension [N], under loads that stay."""
    return [
        LoadStep(f"{x * most:g} N", {"t1": x * most}, loads=dict(loads), substeps=4)
        for x in (0.4, 1.0, 0.5, 0.1, 0.8)
    ]


def _by_displacement(most: float) -> list[LoadStep]:
    """The same with the tendon's displacement prescribed, up to a largest one [m]."""
    return [
        LoadStep(f"{1e3 * x * most:g} mm", displacements={"t1": x * most}, substeps=4)
        for x in (0.4, 1.0, 0.7, 0.2, 0.8)
    ]


def _tendons() -> Iterator[Case]:
    """Prescribed displacements and elastic tendons."""
    elastic, helical, converging = (
        make_robot(r, 15).with_tendons(axial_stiffness=400.0) for r in ("parallel", "helical", "converging")
    )
    yield _case("displacement-driven", make_robot("parallel", 15), _by_displacement(8e-3))
    yield _case("displacement-driven-elastic-tendon", elastic, _by_displacement(9e-3))
    yield _case("displacement-driven-continuous", elastic, _by_displacement(9e-3), **_CONTINUOUS)
    yield _case("elastic-tendon", converging, _up_and_down(_SIDE), _SIDE_NAME)
    yield _case("elastic-tendon-helical", helical, _up_and_down(_SIDE), _SIDE_NAME)


def _backbones() -> Iterator[Case]:
    """Thick disks, precurvature, superelasticity."""
    parallel, helical, converging = (make_robot(r, 15) for r in ("parallel", "helical", "converging"))
    bent = {"precurvature": (3.0, -2.0)}
    soft = Superelastic(0.002, 0.2)
    yield _case("thick-disks", parallel.with_disks(thickness=4.5e-3), _up_and_down(_SIDE), _SIDE_NAME)
    yield _case("thick-disks-helical", helical.with_disks(thickness=4.5e-3), _up_and_down())
    yield _case("precurved", parallel.with_backbone(**bent), _up_and_down(_SIDE), _SIDE_NAME)
    yield _case("precurved-continuous", helical.with_backbone(**bent), _up_and_down(), **_CONTINUOUS)
    yield _case("superelastic", parallel.with_backbone(superelastic=soft), _up_and_down(most=2.0))
    yield _case(
        "superelastic-tip-force",
        converging.with_backbone(superelastic=soft),
        _up_and_down(_SIDE, 2.0),
        _SIDE_NAME,
    )


def _friction_and_masses() -> Iterator[Case]:
    """Adhesion at the holes, a mass at the tip, a soft stretch of the backbone."""
    parallel, helical, converging = (make_robot(r, 15) for r in ("parallel", "helical", "converging"))
    yield _case("adhesion", parallel.with_tendons(adhesion=0.05), _up_and_down())
    adhesion_only = helical.with_tendons(adhesion=0.05, friction_coefficient=0.0)
    yield _case("adhesion-only", adhesion_only, _up_and_down())
    yield _case("tip-mass", replace(parallel, tip_mass=3e-3), _up_and_down(), "gravity", gravity=GRAVITY)
    patch = (StiffnessPatch(0.1, 0.13, 0.6, 0.8),)
    yield _case("stiffness-patch", converging.with_backbone(patches=patch), _up_and_down(_SIDE), _SIDE_NAME)


def _loads_and_disks() -> Iterator[Case]:
    """Follower loads, a moment between two disks, disks at uneven distances, tendons that nobody pulls."""
    parallel = make_robot("parallel", 15)
    follower = Load(LENGTH, (0.02, 0.05, 0.0), (2e-3, 0.0, 1e-3), frame="section")
    couple = Load(0.11, (0.0, 0.0, 0.0), (0.0, 4e-3, 2e-3))
    spaced = tuple(float(x) for x in LENGTH * (np.arange(1, 13) / 12.0) ** 1.2)
    uneven = replace(parallel, disks=replace(parallel.disks, positions=spaced))
    yield _case(
        "follower-load", parallel, _up_and_down({"tip": follower}), "force and moment that follow the tip"
    )
    yield _case("moment-in-a-bay", parallel, _up_and_down({"couple": couple}), "moment between two disks")
    yield _case("uneven-disks", uneven, _up_and_down(_SIDE), _SIDE_NAME)
    yield _case("no-tendon-pulled", parallel, [LoadStep("force", loads=_SIDE, substeps=2)], _SIDE_NAME)


def variants() -> Iterator[Case]:
    """Cases for the remaining properties of a description."""
    yield from _tendons()
    yield from _backbones()
    yield from _friction_and_masses()
    yield from _loads_and_disks()


def all_cases() -> list[Case]:
    """Every case; those of the quick set are marked."""
    cases = [*grid(), *large_bending(), *histories(), *variants()]
    if len({case.id for case in cases}) != len(cases):
        raise RuntimeError("two cases have one id")
    return cases
