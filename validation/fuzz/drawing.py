"""Draw a robot with any options that `robot.toml` has, and a loading history, at random."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from tdcr_fe.effects import Experiment, with_effects
from tdcr_fe.model.backbone import Backbone, NonlinearMaterial, StiffnessPatch, Superelastic
from tdcr_fe.model.checks import course_contradictions
from tdcr_fe.model.friction import ConstantFriction, ForceDependentFriction, StribeckFriction
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot, SideSpring, Tendon, TightHole
from tdcr_fe.model.routing import (
    ConvergingRouting,
    HelicalRouting,
    ParallelRouting,
    PointsRouting,
    Routing,
    VaryingHelicalRouting,
)
from tdcr_fe.validation.drawing import Draw, RandomCase, ranges

#: Largest bending angle that the tensions together give a straight robot [rad], largest force at the tip over EI/L^2,
#: and largest compression of a bay over its buckling load.
LARGEST_BEND, LARGEST_FORCE, LARGEST_COMPRESSION = 1.6, 1.2, 0.25
#: One case in so many has the default mesh; the others have a coarse one.
DEFAULT_MESH_EVERY = 25
#: Effects with the ranges of their parameters; those that need disks, and those that need no tendons.
_EFFECTS = ranges("fuzz")
_OF_HOLES = ("hole_adhesion", "hole_clearance", "friction_coefficient", "rigid_disks", "routing_twist")
_WITHOUT_TENDONS = ["gravity", "stiffness_scale", "precurvature", "tip_payload"]


def draw(number: int) -> RandomCase:
    """The case of a seed: the first of its descriptions that does not contradict itself.

    Parameters
    ----------
    number
        Seed.
    """
    for attempt in range(1000):
        try:
            return _draw(Draw(np.random.default_rng([31, number, attempt])), number)
        except ValueError:  # such as holes outside of the disks
            continue
    raise RuntimeError(f"no valid robot found for seed {number}")


def _draw(d: Draw, number: int) -> RandomCase:
    soft, length = d.chance(0.12), d.number(0.08, 0.4)
    disks = Disks() if soft else _disks(d, length)
    straight = not soft and d.chance(0.8)
    backbone = _backbone(d, length, soft)
    robot = Robot(backbone, disks, _tendons(d, backbone, disks, straight), f"fuzz-{number}")
    mass, springs = d.maybe(0.15, 0.0, 5e-4), _springs(d, backbone)
    stiffness = None if d.chance(0.85) else d.number(20.0, 200.0) * backbone.EI / length
    robot = replace(robot, tip_mass=mass, springs=springs, base_stiffness=stiffness)
    friction: Any = d.one(["none", "per-tendon", "per-hole"], [0.15, 0.15, 0.7]) if straight else "none"
    gravity = d.numbers(-10.0, 10.0, 3) if d.chance(0.3) else [0.0, 0.0, 0.0]
    mesh: Any = "auto" if number % DEFAULT_MESH_EVERY == 0 else d.one([1, 2, 3], [0.5, 0.4, 0.1])
    weight = backbone.mass_per_length * math.hypot(*gravity) * length**3 / backbone.EI
    if soft and weight > LARGEST_FORCE:
        gravity = [LARGEST_FORCE / weight * g for g in gravity]
    path: Any = "straight" if straight else "continuous"
    model = Model(path, friction, mesh, (gravity[0], gravity[1], gravity[2]))
    steps = _steps(d, robot)
    effects = _effects(d, robot) if d.chance(0.25) else {}
    changed = with_effects(Experiment(robot, model, steps), effects)
    if course_contradictions(changed.robot, changed.model):
        raise ValueError("the tendons cannot run so")
    return RandomCase(number, changed.robot, changed.model, changed.steps, effects)


# ----------------------------------------------------------------------------------------------------- the robot


def _disks(d: Draw, length: float) -> Disks:
    counts = [1, 2, 3, 4, 5, 6, 8, 10, 13]
    count = d.one(counts, [0.04, 0.08, 0.13, 0.2, 0.2, 0.15, 0.1, 0.06, 0.04])
    mass, thickness = d.maybe(0.5, 0.0, 5e-4), d.maybe(0.25, 0.02, 0.35) * length / count
    if d.chance(0.75):
        return Disks.equally_spaced(count, length, mass=mass, thickness=thickness, radius=7e-3)
    gaps = d.rng.uniform(0.7, 1.3, count)
    positions = gaps.cumsum() / gaps.sum() * length * (1.0 if d.chance(0.7) else 0.92)
    thickness = min(thickness, 0.4 * float(gaps.min() / gaps.sum()) * length)
    return Disks(tuple(positions.tolist()), mass=mass, thickness=thickness, radius=7e-3)


def _backbone(d: Draw, length: float, soft: bool) -> Backbone:
    radius = d.number(3e-3, 8e-3) if soft else d.number(0.3e-3, 0.8e-3)
    modulus = d.magnitude(5.5, 6.5) if soft else d.number(40e9, 200e9)
    rest: dict[str, Any] = {}
    if d.chance(0.5 if soft else 0.08):
        points = np.linspace(0.0, length, int(d.rng.integers(2, 4)))
        thinner = np.sort(d.rng.uniform(0.5, 1.0, len(points) - 1))[::-1]
        radii = (radius * np.concatenate(([1.0], thinner))).tolist()
        rest["taper"] = tuple(zip(points.tolist(), radii, strict=True))
    if d.chance(0.3 if soft else 0.05):
        rest["nonlinear"] = NonlinearMaterial(d.number(-2.0, 0.5), d.number(0.0, 3.0))
    elif d.chance(0.12):
        rest["superelastic"] = Superelastic(d.number(1e-3, 2e-2), d.number(0.15, 1.0))
    if d.chance(0.15):
        rest["precurvature"] = tuple((d.rng.uniform(-0.4, 0.4, 2) / length).tolist())
    if d.chance(0.15):
        start, (bend, twist, *more) = d.number(0.0, 0.6) * length, d.numbers(0.6, 1.6, 4)
        curvature = tuple((d.rng.uniform(-0.4, 0.4, 2) / length).tolist())
        end = start + d.number(0.1, 0.4) * length
        rest["patches"] = (StiffnessPatch(start, end, bend, twist, curvature, more[0], more[1]),)
    if "nonlinear" not in rest and d.chance(0.06):
        rest["creep_rate"] = d.magnitude(-5.0, -2.5)
    if d.chance(0.06):
        plain = Backbone(length, radius, modulus, 0.3)
        rest["bending_stiffness"] = d.number(0.7, 1.4) * plain.EI
        rest["torsional_stiffness"] = d.number(0.4, 1.4) * plain.GJ
    density = d.number(900.0, 1200.0) if soft else d.number(1000.0, 8000.0)
    return Backbone(length, radius, modulus, d.number(0.25, 0.48), density, **rest)


def _springs(d: Draw, backbone: Backbone) -> tuple[SideSpring, ...]:
    if d.chance(0.93):
        return ()
    at = d.number(0.3, 1.0) * backbone.length
    return (SideSpring(at, d.number(0.1, 5.0) * backbone.EI / backbone.length**3),)


def _tendons(d: Draw, backbone: Backbone, disks: Disks, straight: bool) -> tuple[Tendon, ...]:
    count, length = d.one([0, 1, 2, 3, 4, 6], [0.02, 0.2, 0.18, 0.35, 0.15, 0.1]), backbone.length
    elastic = d.chance(0.25)
    found = []
    for i in range(count):
        angle = 360.0 * i / count + d.number(-25.0, 25.0)
        if disks.positions:
            last = len(disks.positions) - 1
            whole = i == 0 or d.chance(0.7)
            end = disks.positions[last if whole else int(d.rng.integers(last // 2, last + 1))]
            holes, most = (0.0, *(s for s in disks.positions if s <= end + 1e-6)), 6e-3
        else:
            end = length * (1.0 if d.chance(0.6) else d.number(0.4, 1.0))
            holes = tuple(np.linspace(0.0, end, 5).tolist())
            most = 0.9 * float(backbone.radius_at(np.array([end]))[0])
        routing = _routing(d, holes, angle, most)
        rest: dict[str, Any] = {"end": None if abs(end - length) < 1e-9 else end}
        if elastic:
            rest["axial_stiffness"] = d.magnitude(2.0, 4.0)
            rest["pretension"] = d.maybe(0.4, 0.0, 0.3) * backbone.EI / length / 5e-3
        if straight:
            rest |= {"adhesion": d.maybe(0.1, 0.0, 5e-3), "clearance": d.maybe(0.1, 0.0, 3e-4)}
            rest |= _friction(d, holes)
        found.append(Tendon(f"t{i + 1}", routing, **rest))
    return tuple(found)


def _friction(d: Draw, holes: tuple[float, ...]) -> dict[str, Any]:
    kind, mu = d.rng.random(), d.number(0.0, 0.6)
    if kind < 0.08:
        return {"friction": StribeckFriction(1.2 * mu + 0.02, mu, d.magnitude(-4.0, -2.0))}
    if kind < 0.16:
        return {"friction": ForceDependentFriction(mu, d.number(0.1, 1.0), d.number(-0.5, 0.3))}
    if kind < 0.2:
        return {"friction": ConstantFriction(mu)}
    tight: tuple[TightHole, ...] = ()
    if len(holes) > 2 and d.chance(0.05):
        tight = (TightHole(holes[int(d.rng.integers(1, len(holes) - 1))], d.number(0.0, 0.2)),)
    return {"friction_coefficient": mu if d.chance(0.85) else 0.0, "tight_holes": tight}


def _routing(d: Draw, holes: tuple[float, ...], angle: float, most: float) -> Routing:
    offset = d.number(0.3, 1.0) * most
    kinds = ["parallel", "helical", "helical-varying", "converging", "points"]
    kind = d.one(kinds, [0.4, 0.2, 0.1, 0.2, 0.1])
    if kind == "helical":
        return HelicalRouting(offset, d.number(-1.0, 1.0), angle)
    if kind == "helical-varying":
        return VaryingHelicalRouting(offset, d.number(-1.0, 1.0), d.number(-1.0, 1.0), angle)
    if kind == "converging":
        return ConvergingRouting(offset, d.number(0.1, 1.0) * offset, angle)
    if kind == "points":
        turn = np.deg2rad(angle) + 0.15 * d.rng.standard_normal(len(holes)).cumsum() / np.sqrt(len(holes))
        away = offset * d.rng.uniform(0.7, 1.0, len(holes))
        points = zip((away * np.cos(turn)).tolist(), (away * np.sin(turn)).tolist(), strict=True)
        return PointsRouting(holes, tuple(points))
    return ParallelRouting(offset, angle)


# ------------------------------------------------------------------------------------------------- the history


def _steps(d: Draw, robot: Robot) -> tuple[LoadStep, ...]:
    backbone, names = robot.backbone, robot.tendon_names
    soft = min(float(backbone.radius_at(np.array([backbone.length]))[0]) / backbone.radius, 1.0) ** 4
    stiffness = backbone.EI * soft
    most = _largest_tension(robot, stiffness)
    how = d.one(["tension", "displacement", "both"], [0.62, 0.28, 0.1])
    driven = {n for n in names if how == "displacement" or (how == "both" and d.chance(0.5))}
    steps, time = [], 0.0
    for k in range(int(d.rng.integers(1, 6))):
        share = d.rng.uniform(0.0, 1.0, len(names)) * (d.rng.random(len(names)) < 0.7)
        pull = (share / max(1.0, float(share.sum())) * most).tolist()
        arc = dict(zip(names, _arc_displacements(d, robot), strict=True))
        tensions = {n: x for n, x in zip(names, pull, strict=True) if n not in driven and d.chance(0.9)}
        loads = _loads(d, backbone.length, stiffness) if d.chance(0.35) else {}
        if k and d.chance(0.2):
            loads["tip"] = Load(backbone.length)
        time += d.magnitude(-1.0, 2.0)
        substeps = None if d.chance(0.93) else int(d.rng.integers(1, 5))
        moved, at = {n: arc[n] for n in names if n in driven}, time if d.chance(0.8) else None
        steps.append(LoadStep(f"{k + 1}", tensions, moved, loads, substeps, at))
    return tuple(steps)


def _largest_tension(robot: Robot, stiffness: float) -> float:
    """What all tensions together may be [N]: by bending angle, and by the buckling load of a bay."""
    backbone = robot.backbone
    offset = max((float(np.linalg.norm(robot.holes(t), axis=1).max()) for t in robot.tendons), default=5e-3)
    bend = LARGEST_BEND * stiffness / (backbone.length * max(offset, 1e-4))
    edges = robot.bay_edges if not robot.without_disks else np.array([0.0, backbone.length])
    bay = float(np.max(np.diff(edges)))
    return min(bend, LARGEST_COMPRESSION * np.pi**2 * stiffness / bay**2)


def _loads(d: Draw, length: float, stiffness: float) -> dict[str, Load]:
    at = length if d.chance(0.6) else d.number(0.2, 0.95) * length
    direction = d.rng.standard_normal(3)
    force = LARGEST_FORCE * d.rng.random() * stiffness / length**2 * direction / np.linalg.norm(direction)
    moment = 0.5 * stiffness / length * d.rng.standard_normal(3) if d.chance(0.3) else np.zeros(3)
    load = Load(at, tuple(force.tolist()), tuple(moment.tolist()), "section" if d.chance(0.25) else "world")
    return {"tip" if at == length else "side": load}


def _arc_displacements(d: Draw, robot: Robot) -> list[float]:
    """What tendons are pulled in by in a circular arc, less up to 0.5 mm; some are slack [m]."""
    bend, plane = d.rng.uniform(0.0, 1.4), d.rng.uniform(0.0, 2.0 * np.pi)
    found = []
    for tendon in robot.tendons:
        x, y = robot.hole_points(tendon).mean(axis=0)[:2]
        share = robot.end(tendon) / robot.backbone.length
        arc = bend * share * (x * np.cos(plane) + y * np.sin(plane))
        stretch = 0.0
        if tendon.axial_stiffness is not None:
            stretch = d.rng.uniform(0.0, 0.3) * robot.backbone.EI / robot.backbone.length / 5e-3
            stretch *= robot.end(tendon) / tendon.axial_stiffness
        found.append(float(arc + stretch - d.maybe(0.85, 0.0, 0.5e-3, 2e-3)))
    return found


def _effects(d: Draw, robot: Robot) -> dict[str, dict[str, float]]:
    names = [n for n in _EFFECTS if not (robot.without_disks and n in _OF_HOLES)]
    names = names if robot.tendons else _WITHOUT_TENDONS
    chosen = d.rng.choice(names, int(d.rng.integers(1, 3)), replace=False)
    return {str(n): {p: r.draw(d.rng) for p, r in _EFFECTS[n].items()} for n in chosen}
