"""Which robots and loads `compare` is given: all routings, models, loads and numbers of disks; histories; variants."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from tdcr_fe.model.backbone import Backbone, StiffnessPatch, Superelastic
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot, Tendon
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting, Routing

#: Length of the backbone [m].
LENGTH = 0.25
BACKBONE = Backbone(LENGTH, 0.4e-3, 85e9, 0.3, density=5600.0)
#: Friction coefficient where a case has friction [1].
MU = 0.3
#: Beam elements between neighbouring disks, in every case.
ELEMENTS_PER_BAY = 4
#: Highest tension [N], and the share of a bay's buckling load that all tendons together stay below.
MOST_TENSION, MOST_COMPRESSION = 4.0, 0.3
#: Highest tensions of the cases of large bending, without and with friction [N].
LARGE_TENSIONS = (5.5, 8.0)

ROUTINGS = ("parallel", "two-segment", "helical", "converging")
#: (tendon path, friction)
MODELS = (("continuous", "none"), ("straight", "none"), ("straight", "per-tendon"), ("straight", "per-hole"))
DISKS = (5, 10, 15, 20)
#: Plane in which the tendon of a single-segment robot bends it, from +x towards +y [deg], and its direction.
PLANE_DEG = 40.0
_C, _S = float(np.cos(np.radians(PLANE_DEG))), float(np.sin(np.radians(PLANE_DEG)))
GRAVITY = (2.0, -9.0, -3.0)
#: Concentrated loads by their description; with "gravity" there is `GRAVITY` instead.
LOADS: dict[str, dict[str, Load]] = {
    "no load": {},
    "tip in plane": {"tip": Load(LENGTH, (-0.05 * _C, -0.05 * _S, 0.0))},
    "tip out of plane": {"tip": Load(LENGTH, (-0.05 * _S, 0.05 * _C, 0.0))},
    "mid-span": {"middle": Load(LENGTH / 2.0, (0.08 * _C - 0.04 * _S, 0.08 * _S + 0.04 * _C, -0.02))},
    "gravity": {},
}
#: Loading, unloading, reloading, as shares of the highest tension.
CYCLE = (0.35, 0.7, 1.0, 0.8, 0.5, 0.2, 0.0, 0.3, 0.7, 1.0)


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
    load is a study of its own.
    """
    return min(MOST_TENSION, MOST_COMPRESSION * bay_buckling_load(disks))


def make_robot(routing: str, disks: int) -> Robot:
    """The robot of one of `ROUTINGS`, or of four "antagonists".

    Helical tendons wind once (from ten disks on: twice) about the backbone; the first segment of two ends at 40 % of
    the length, so that the number of disks is a multiple of five.
    """
    single: dict[str, Routing] = {
        "parallel": ParallelRouting(4.5e-3, PLANE_DEG),
        "helical": HelicalRouting(4.5e-3, 2.0 if disks >= 10 else 1.0, PLANE_DEG),
        "converging": ConvergingRouting(4.5e-3, 0.15e-3, PLANE_DEG),
    }
    if routing == "two-segment":
        end = round(0.4 * LENGTH, 9)
        first = [ParallelRouting(4.5e-3, a) for a in (90.0, 330.0, 210.0)]
        second = [ParallelRouting(3.5e-3, a) for a in (30.0, 150.0, 270.0)]
        tendons = [Tendon(f"a{i}", r, MU, end=end) for i, r in enumerate(first)]
        tendons += [Tendon(f"b{i}", r, MU) for i, r in enumerate(second)]
    elif routing == "antagonists":
        tendons = [Tendon(f"t{i}", ParallelRouting(4.5e-3, PLANE_DEG + 90.0 * i), MU) for i in range(4)]
    else:
        tendons = [Tendon("t1", single[routing], MU)]
    equal = Disks.equally_spaced(disks, LENGTH, mass=0.17e-3, radius=5e-3)
    return Robot(BACKBONE, equal, tuple(tendons), name=routing)


def pulls(routing: str, total: float, share: float) -> dict[str, float]:
    """A share of the highest tensions, by tendon, which add up to `total` [N]."""
    if routing == "two-segment":
        return {"a0": 0.55 * total * share, "b0": 0.45 * total * share}
    return {"t1": total * share}


def steps_of(levels: Sequence[Mapping[str, float]], load: str, substeps: int) -> tuple[LoadStep, ...]:
    """A load step for each set of tensions, under one of `LOADS`."""
    return tuple(LoadStep("", dict(t), loads=LOADS[load], substeps=substeps) for t in levels)


def model_of(path: str, friction: str, load: str = "no load") -> Model:
    """A model with the mesh of all cases, and with gravity where the load is that."""
    gravity = GRAVITY if load == "gravity" else (0.0, 0.0, 0.0)
    return Model(path, friction, ELEMENTS_PER_BAY, gravity)  # type: ignore[arg-type]


def grid() -> Iterator[Case]:
    """Routings x models x loads x numbers of disks: three levels up, one down."""
    for (r, routing), (m, (path, friction)), (k, load), (i, disks) in product(
        enumerate(ROUTINGS), enumerate(MODELS), enumerate(LOADS), enumerate(DISKS)
    ):
        levels = [pulls(routing, highest_tension(disks), x) for x in (0.3, 0.65, 1.0, 0.5)]
        name = f"{routing}_{path}_{friction}_{load.replace(' ', '-')}_{disks}"
        steps = steps_of(levels, load, 1 if friction == "none" else 4)
        robot, model = make_robot(routing, disks), model_of(path, friction, load)
        yield Case(name, "grid", routing, load, robot, model, steps, quick=i == (r + m + k) % len(DISKS))


def large_bending() -> Iterator[Case]:
    """Tips turned far beyond 180 degrees."""
    for (path, friction), disks in product(MODELS, (15, 20)):
        most, substeps = (LARGE_TENSIONS[0], 1) if friction == "none" else (LARGE_TENSIONS[1], 4)
        name = f"large_parallel_{path}_{friction}_{disks}"
        steps = steps_of([{"t1": x * most} for x in (0.25, 0.5, 0.75, 1.0)], "no load", substeps)
        robot, model = make_robot("parallel", disks), model_of(path, friction)
        yield Case(name, "large bending", "parallel", "no load", robot, model, steps, quick=disks == 20)


def histories() -> Iterator[Case]:
    """Loading, unloading and reloading; tendons pulled one against the other, in a circle and at random."""

    def history(name: str, robot: Robot, friction: str, steps: tuple[LoadStep, ...], load: str) -> Case:
        disks = len(robot.disks.positions)
        routing = "parallel" if robot.name == "antagonists" else robot.name
        model, name = model_of("straight", friction, load), f"history_{name}_{disks}"
        return Case(name, "history", routing, load, robot, model, steps, quick=disks == 10)

    for routing, friction in product(ROUTINGS, ("per-tendon", "per-hole")):
        for disks, load in ((10, "no load"), (15, "tip out of plane"), (20, "gravity")):
            levels = [pulls(routing, highest_tension(disks), x) for x in CYCLE]
            name = f"{routing}_{friction}_{load.replace(' ', '-')}"
            yield history(name, make_robot(routing, disks), friction, steps_of(levels, load, 4), load)
    turn = np.arange(12)[:, None] * np.pi / 4.0 - np.arange(4) * np.pi / 2.0
    circle_levels = 0.4 + 0.9 * np.maximum(0.0, np.cos(turn))
    levels = [{f"t{i}": x for i, x in enumerate(row)} for row in circle_levels.tolist()]
    for friction, disks in product(("per-tendon", "per-hole"), (10, 20)):
        circle = steps_of(levels, "no load", 4)
        robot = make_robot("antagonists", disks)
        yield history(f"antagonists-circle_{friction}", robot, friction, circle, "no load")
    for robot in (make_robot("antagonists", 13), make_robot("two-segment", 10)):
        names = robot.tendon_names
        drawn = np.random.default_rng(20).uniform(0.0, 6.0 / len(names), (8, len(names)))
        walk = steps_of([dict(zip(names, t, strict=True)) for t in drawn.tolist()], "no load", 6)
        yield history(f"{robot.name}-walk_per-hole", robot, "per-hole", walk, "no load")


def _up_and_down(most: float = 3.0, load: str = "no load", **others: Load) -> list[LoadStep]:
    """Loading, unloading, reloading up to a tension [N], under one of `LOADS` or other loads."""
    acting = others or LOADS[load]
    return [LoadStep("", {"t1": x * most}, loads=acting, substeps=4) for x in (0.4, 1.0, 0.5, 0.1, 0.8)]


def _by_displacement(most: float) -> list[LoadStep]:
    """The same with the tendon's displacement prescribed, up to a largest one [m]."""
    return [LoadStep("", displacements={"t1": x * most}, substeps=4) for x in (0.4, 1.0, 0.7, 0.2, 0.8)]


def variants() -> list[Case]:
    """Cases for the remaining properties of a description."""

    def case(name: str, robot: Robot, steps: list[LoadStep], load: str = "no load", **model: Any) -> Case:
        with_mesh = Model(**{"elements_per_bay": ELEMENTS_PER_BAY, **model})
        about = (f"variant_{name}", "variant", robot.name, load)
        return Case(*about, robot, with_mesh, tuple(steps), quick=True)

    parallel, helical, converging = (make_robot(r, 15) for r in ("parallel", "helical", "converging"))
    side, continuous = "tip out of plane", {"tendon_path": "continuous", "friction": "none"}
    plain, sideways, pulled_in = _up_and_down(), _up_and_down(load=side), _by_displacement(9e-3)
    elastic, thick = [r.with_tendons(axial_stiffness=400.0) for r in (parallel, converging, helical)], 4.5e-3
    bent, soft = {"precurvature": (3.0, -2.0)}, {"superelastic": Superelastic(0.002, 0.2)}
    adhesive = helical.with_tendons(adhesion=0.05, friction_coefficient=0.0)
    heavy = replace(parallel, tip_mass=3e-3)
    patched = converging.with_backbone(patches=(StiffnessPatch(0.1, 0.13, 0.6, 0.8),))
    spaced = tuple((LENGTH * (np.arange(1, 13) / 12.0) ** 1.2).tolist())
    uneven = replace(parallel, disks=replace(parallel.disks, positions=spaced))
    follower = _up_and_down(tip=Load(LENGTH, (0.02, 0.05, 0.0), (2e-3, 0.0, 1e-3), frame="section"))
    couple = _up_and_down(couple=Load(0.11, (0.0, 0.0, 0.0), (0.0, 4e-3, 2e-3)))
    force = [LoadStep("", loads=LOADS[side], substeps=2)]
    return [
        case("displacement-driven", parallel, _by_displacement(8e-3)),
        case("displacement-driven-elastic-tendon", elastic[0], pulled_in),
        case("displacement-driven-continuous", elastic[0], pulled_in, **continuous),
        case("elastic-tendon", elastic[1], sideways, side),
        case("elastic-tendon-helical", elastic[2], sideways, side),
        case("thick-disks", parallel.with_disks(thickness=thick), sideways, side),
        case("thick-disks-helical", helical.with_disks(thickness=thick), plain),
        case("precurved", parallel.with_backbone(**bent), sideways, side),
        case("precurved-continuous", helical.with_backbone(**bent), plain, **continuous),
        case("superelastic", parallel.with_backbone(**soft), _up_and_down(2.0)),
        case("superelastic-tip-force", converging.with_backbone(**soft), _up_and_down(2.0, side), side),
        case("adhesion", parallel.with_tendons(adhesion=0.05), plain),
        case("adhesion-only", adhesive, plain),
        case("tip-mass", heavy, plain, "gravity", gravity=GRAVITY),
        case("stiffness-patch", patched, sideways, side),
        case("follower-load", parallel, follower, "force and moment that follow the tip"),
        case("moment-in-a-bay", parallel, couple, "moment between two disks"),
        case("uneven-disks", uneven, sideways, side),
        case("no-tendon-pulled", parallel, force, side),
    ]


def all_cases() -> list[Case]:
    """Every case; those of the quick set are marked."""
    return [*grid(), *large_bending(), *histories(), *variants()]
