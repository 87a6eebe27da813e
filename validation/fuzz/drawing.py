"""Draw a robot with any options that `robot.toml` has, and a loading history, at random."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tdcr_fe.effects import Experiment, with_effects
from tdcr_fe.model.backbone import Backbone, NonlinearMaterial, StiffnessPatch, Superelastic
from tdcr_fe.model.checks import course_contradictions
from tdcr_fe.model.friction import ConstantFriction, ForceDependentFriction, StribeckFriction
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot, SideSpring
from tdcr_fe.model.routing import (
    ConvergingRouting,
    HelicalRouting,
    ParallelRouting,
    PointsRouting,
    Routing,
    VaryingHelicalRouting,
)
from tdcr_fe.model.tendon import Tendon, TightHole
from tdcr_fe.validation.ranges import ranges

Random = np.random.Generator

#: Largest bending angle that the tensions together give a straight robot [rad], largest force at the tip over EI/L^2,
#: and largest compression of a bay over its buckling load.
LARGEST_BEND, LARGEST_FORCE, LARGEST_COMPRESSION = 1.6, 1.2, 0.25
#: One case in so many has the default mesh; the others have a coarse one.
DEFAULT_MESH_EVERY = 25

#: Effects with the ranges of their parameters.
_EFFECTS = ranges("fuzz")


@dataclass(frozen=True)
class FuzzCase:
    """One robot and its history.

    Attributes
    ----------
    number : int
        Seed.
    robot : Robot
    model : Model
    steps : tuple of LoadStep
        With the effects in all three.
    effects : dict
        That were asked for, by name.
    redrawn : int
        How many descriptions before this one contradicted themselves.
    """

    number: int
    robot: Robot
    model: Model
    steps: tuple[LoadStep, ...]
    effects: dict[str, dict[str, float]]
    redrawn: int = 0

    @property
    def default_mesh(self) -> bool:
        """Whether the solver chooses the mesh."""
        return self.model.elements_per_bay == "auto"


def draw(number: int) -> FuzzCase:
    """The case of a seed.

    Parameters
    ----------
    number
        Seed.
    """
    for attempt in range(1000):
        rng = np.random.default_rng([31, number, attempt])
        try:
            return _draw(rng, number, attempt)
        except ValueError:  # the description contradicts itself, such as holes outside of the disks
            continue
    raise RuntimeError(f"no valid robot found for seed {number}")


def _draw(rng: Random, number: int, attempt: int) -> FuzzCase:
    soft = rng.random() < 0.12
    length = float(rng.uniform(0.08, 0.4))
    disks = Disks() if soft else _disks(rng, length)
    straight = not soft and rng.random() < 0.8
    backbone = _backbone(rng, length, soft)
    robot = Robot(
        backbone,
        disks,
        _tendons(rng, backbone, disks, straight),
        name=f"fuzz-{number}",
        tip_mass=_maybe(rng, 0.15, 0.0, 5e-4, 0.0),
        springs=_springs(rng, backbone),
        base_stiffness=None
        if rng.random() < 0.85
        else float(rng.uniform(20.0, 200.0)) * backbone.EI / length,
    )
    friction = (
        str(rng.choice(["none", "per-tendon", "per-hole"], p=[0.15, 0.15, 0.7])) if straight else "none"
    )
    gravity = tuple(rng.uniform(-10.0, 10.0, 3).tolist()) if rng.random() < 0.3 else (0.0, 0.0, 0.0)
    mesh = "auto" if number % DEFAULT_MESH_EVERY == 0 else int(rng.choice([1, 2, 3], p=[0.5, 0.4, 0.1]))
    if soft and _weight(backbone, gravity) > LARGEST_FORCE:
        gravity = tuple(LARGEST_FORCE / _weight(backbone, gravity) * g for g in gravity)
    model = Model("straight" if straight else "continuous", friction, mesh, gravity)  # type: ignore[arg-type]
    steps = _steps(rng, robot)
    effects = _effects(rng, robot) if rng.random() < 0.25 else {}
    changed = with_effects(Experiment(robot, model, steps), effects)
    if course_contradictions(changed.robot, changed.model):
        raise ValueError("the tendons cannot run so")
    return FuzzCase(number, changed.robot, changed.model, changed.steps, effects, attempt)


def _maybe(rng: Random, chance: float, low: float, high: float, otherwise: float) -> float:
    """A number between two bounds with a chance, else another one."""
    return float(rng.uniform(low, high)) if rng.random() < chance else otherwise


def _weight(backbone: Backbone, gravity: tuple[float, ...]) -> float:
    """Weight of the backbone over EI/L^2."""
    return backbone.mass_per_length * math.hypot(*gravity) * backbone.length**3 / backbone.EI


# ----------------------------------------------------------------------------------------------------- the robot


def _disks(rng: Random, length: float) -> Disks:
    count = int(
        rng.choice([1, 2, 3, 4, 5, 6, 8, 10, 13], p=[0.04, 0.08, 0.13, 0.2, 0.2, 0.15, 0.1, 0.06, 0.04])
    )
    rest = {
        "mass": _maybe(rng, 0.5, 0.0, 5e-4, 0.0),
        "thickness": _maybe(rng, 0.25, 0.02, 0.35, 0.0) * length / count,
        "radius": 7e-3,
    }
    if rng.random() < 0.75:
        return Disks.equally_spaced(count, length, **rest)
    gaps = rng.uniform(0.7, 1.3, count)
    positions = gaps.cumsum() / gaps.sum() * length * (1.0 if rng.random() < 0.7 else 0.92)
    thickness = min(rest.pop("thickness"), 0.4 * float(gaps.min() / gaps.sum()) * length)
    return Disks(tuple(positions.tolist()), thickness=thickness, **rest)


def _backbone(rng: Random, length: float, soft: bool) -> Backbone:
    radius = float(rng.uniform(3e-3, 8e-3) if soft else rng.uniform(0.3e-3, 0.8e-3))
    modulus = float(10.0 ** rng.uniform(5.5, 6.5) if soft else rng.uniform(40e9, 200e9))
    rest: dict[str, object] = {}
    if rng.random() < (0.5 if soft else 0.08):
        points = np.linspace(0.0, length, int(rng.integers(2, 4)))
        radii = radius * np.concatenate(([1.0], np.sort(rng.uniform(0.5, 1.0, len(points) - 1))[::-1]))
        rest["taper"] = tuple(zip(points.tolist(), radii.tolist(), strict=True))
    if rng.random() < (0.3 if soft else 0.05):
        rest["nonlinear"] = NonlinearMaterial(float(rng.uniform(-2.0, 0.5)), float(rng.uniform(0.0, 3.0)))
    elif rng.random() < 0.12:
        rest["superelastic"] = Superelastic(float(rng.uniform(1e-3, 2e-2)), float(rng.uniform(0.15, 1.0)))
    if rng.random() < 0.15:
        rest["precurvature"] = tuple((rng.uniform(-0.4, 0.4, 2) / length).tolist())
    if rng.random() < 0.15:
        start = float(rng.uniform(0.0, 0.6)) * length
        factors = rng.uniform(0.6, 1.6, 4).tolist()
        curvature = tuple((rng.uniform(-0.4, 0.4, 2) / length).tolist())
        end = start + float(rng.uniform(0.1, 0.4)) * length
        rest["patches"] = (
            StiffnessPatch(start, end, factors[0], factors[1], curvature, factors[2], factors[3]),
        )
    if "nonlinear" not in rest and rng.random() < 0.06:
        rest["creep_rate"] = float(10.0 ** rng.uniform(-5.0, -2.5))
    if rng.random() < 0.06:
        plain = Backbone(length, radius, modulus, 0.3)
        rest["bending_stiffness"] = float(rng.uniform(0.7, 1.4)) * plain.EI
        rest["torsional_stiffness"] = float(rng.uniform(0.4, 1.4)) * plain.GJ
    density = float(rng.uniform(900.0, 1200.0) if soft else rng.uniform(1000.0, 8000.0))
    return Backbone(length, radius, modulus, float(rng.uniform(0.25, 0.48)), density, **rest)  # type: ignore[arg-type]


def _springs(rng: Random, backbone: Backbone) -> tuple[SideSpring, ...]:
    if rng.random() < 0.93:
        return ()
    at = float(rng.uniform(0.3, 1.0)) * backbone.length
    return (SideSpring(at, float(rng.uniform(0.1, 5.0)) * backbone.EI / backbone.length**3),)


def _tendons(rng: Random, backbone: Backbone, disks: Disks, straight: bool) -> tuple[Tendon, ...]:
    count = int(rng.choice([0, 1, 2, 3, 4, 6], p=[0.02, 0.2, 0.18, 0.35, 0.15, 0.1]))
    drives = rng.random()
    found = []
    for i in range(count):
        angle = 360.0 * i / count + float(rng.uniform(-25.0, 25.0))
        if disks.positions:
            last = len(disks.positions) - 1
            end = disks.positions[
                last if i == 0 or rng.random() < 0.7 else int(rng.integers(last // 2, last + 1))
            ]
            holes = (0.0, *(s for s in disks.positions if s <= end + 1e-6))
            most = 6e-3
        else:
            end = backbone.length * (1.0 if rng.random() < 0.6 else float(rng.uniform(0.4, 1.0)))
            holes = tuple(np.linspace(0.0, end, 5).tolist())
            most = 0.9 * float(backbone.radius_at(np.array([end]))[0])
        elastic = drives < 0.25
        found.append(
            Tendon(
                f"t{i + 1}",
                _routing(rng, holes, angle, most),
                end=None if abs(end - backbone.length) < 1e-9 else end,
                axial_stiffness=float(10.0 ** rng.uniform(2.0, 4.0)) if elastic else None,
                pretension=_maybe(rng, 0.4, 0.0, 0.3, 0.0) * backbone.EI / backbone.length / 5e-3
                if elastic
                else 0.0,
                adhesion=_maybe(rng, 0.1, 0.0, 5e-3, 0.0) if straight else 0.0,
                clearance=_maybe(rng, 0.1, 0.0, 3e-4, 0.0) if straight else 0.0,
                **(_friction(rng, holes) if straight else {}),  # type: ignore[arg-type]
            )
        )
    return tuple(found)


def _friction(rng: Random, holes: tuple[float, ...]) -> dict[str, object]:
    kind, mu = rng.random(), float(rng.uniform(0.0, 0.6))
    if kind < 0.08:
        return {"friction": StribeckFriction(1.2 * mu + 0.02, mu, float(10.0 ** rng.uniform(-4.0, -2.0)))}
    if kind < 0.16:
        return {
            "friction": ForceDependentFriction(
                mu, float(rng.uniform(0.1, 1.0)), float(rng.uniform(-0.5, 0.3))
            )
        }
    if kind < 0.2:
        return {"friction": ConstantFriction(mu)}
    tight = len(holes) > 2 and rng.random() < 0.05
    where = (
        (TightHole(holes[int(rng.integers(1, len(holes) - 1))], float(rng.uniform(0.0, 0.2))),)
        if tight
        else ()
    )
    return {"friction_coefficient": mu if rng.random() < 0.85 else 0.0, "tight_holes": where}


def _routing(rng: Random, holes: tuple[float, ...], angle: float, most: float) -> Routing:
    offset = float(rng.uniform(0.3, 1.0)) * most
    kind = rng.choice(
        ["parallel", "helical", "helical-varying", "converging", "points"], p=[0.4, 0.2, 0.1, 0.2, 0.1]
    )
    if kind == "helical":
        return HelicalRouting(offset, float(rng.uniform(-1.0, 1.0)), angle)
    if kind == "helical-varying":
        first, last = rng.uniform(-1.0, 1.0, 2).tolist()
        return VaryingHelicalRouting(offset, first, last, angle)
    if kind == "converging":
        return ConvergingRouting(offset, float(rng.uniform(0.1, 1.0)) * offset, angle)
    if kind == "points":
        turn = np.deg2rad(angle) + 0.15 * rng.standard_normal(len(holes)).cumsum() / np.sqrt(len(holes))
        away = offset * rng.uniform(0.7, 1.0, len(holes))
        points = np.column_stack((away * np.cos(turn), away * np.sin(turn)))
        return PointsRouting(holes, tuple((float(x), float(y)) for x, y in points))
    return ParallelRouting(offset, angle)


# ------------------------------------------------------------------------------------------------- the history


def _steps(rng: Random, robot: Robot) -> tuple[LoadStep, ...]:
    backbone, names = robot.backbone, robot.tendon_names
    soft = min(float(backbone.radius_at(np.array([backbone.length]))[0]) / backbone.radius, 1.0) ** 4
    stiffness = backbone.EI * soft
    most = _largest_tension(robot, stiffness)
    how = rng.choice(["tension", "displacement", "both"], p=[0.62, 0.28, 0.1])
    driven = {n for n in names if how == "displacement" or (how == "both" and rng.random() < 0.5)}
    steps, time = [], 0.0
    for k in range(int(rng.integers(1, 6))):
        tensions: dict[str, float] = {}
        displacements: dict[str, float] = {}
        share = rng.uniform(0.0, 1.0, len(names)) * (rng.random(len(names)) < 0.7)
        pull = share / max(1.0, float(share.sum())) * most
        arc = _arc_displacements(rng, robot)
        for i, name in enumerate(names):
            if name in driven:
                displacements[name] = arc[i]
            elif rng.random() < 0.9:
                tensions[name] = float(pull[i])
        loads = _loads(rng, backbone.length, stiffness) if rng.random() < 0.35 else {}
        if k and rng.random() < 0.2:
            loads["tip"] = Load(backbone.length)
        time += float(10.0 ** rng.uniform(-1.0, 2.0))
        substeps = None if rng.random() < 0.93 else int(rng.integers(1, 5))
        steps.append(
            LoadStep(
                f"{k + 1}", tensions, displacements, loads, substeps, time if rng.random() < 0.8 else None
            )
        )
    return tuple(steps)


def _largest_tension(robot: Robot, stiffness: float) -> float:
    """What all tensions together may be [N]: by bending angle, and by the buckling load of a bay."""
    backbone = robot.backbone
    offset = max((float(np.linalg.norm(robot.holes(t), axis=1).max()) for t in robot.tendons), default=5e-3)
    bend = LARGEST_BEND * stiffness / (backbone.length * max(offset, 1e-4))
    edges = robot.bay_edges if not robot.without_disks else np.array([0.0, backbone.length])
    bay = float(np.max(np.diff(edges)))
    return min(bend, LARGEST_COMPRESSION * np.pi**2 * stiffness / bay**2)


def _loads(rng: Random, length: float, stiffness: float) -> dict[str, Load]:
    at = length if rng.random() < 0.6 else float(rng.uniform(0.2, 0.95)) * length
    direction = rng.standard_normal(3)
    force = LARGEST_FORCE * rng.random() * stiffness / length**2 * direction / np.linalg.norm(direction)
    moment = 0.5 * stiffness / length * rng.standard_normal(3) if rng.random() < 0.3 else np.zeros(3)
    frame = "section" if rng.random() < 0.25 else "world"
    name = "tip" if at == length else "side"
    return {name: Load(at, tuple(force.tolist()), tuple(moment.tolist()), frame)}  # type: ignore[arg-type]


def _arc_displacements(rng: Random, robot: Robot) -> list[float]:
    """What tendons are pulled in by in a circular arc, less up to 0.5 mm; some are slack [m]."""
    bend, plane = rng.uniform(0.0, 1.4), rng.uniform(0.0, 2.0 * np.pi)
    found = []
    for tendon in robot.tendons:
        x, y = robot.hole_points(tendon).mean(axis=0)[:2]
        share = robot.end(tendon) / robot.backbone.length
        arc = bend * share * (x * np.cos(plane) + y * np.sin(plane))
        stretch = 0.0
        if tendon.axial_stiffness is not None:
            stretch = rng.uniform(0.0, 0.3) * robot.backbone.EI / robot.backbone.length / 5e-3
            stretch *= robot.end(tendon) / tendon.axial_stiffness
        slack = rng.uniform(0.0, 0.5e-3) if rng.random() < 0.85 else 2e-3
        found.append(float(arc + stretch - slack))
    return found


def _effects(rng: Random, robot: Robot) -> dict[str, dict[str, float]]:
    without_holes = robot.without_disks
    needs_holes = ("hole_adhesion", "hole_clearance", "friction_coefficient", "rigid_disks", "routing_twist")
    names = [n for n in _EFFECTS if not (without_holes and n in needs_holes)]
    if not robot.tendons:
        names = ["gravity", "stiffness_scale", "precurvature", "tip_payload"]
    chosen = rng.choice(names, int(rng.integers(1, 3)), replace=False)
    return {str(n): {p: r.draw(rng) for p, r in _EFFECTS[n].items()} for n in chosen}
