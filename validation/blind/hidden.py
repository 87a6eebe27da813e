"""Draw what is hidden: values of listed effects, scaled until they are detectable, and effects at one place."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tdcr_fe.effects import Experiment, effect
from tdcr_fe.model.backbone import StiffnessPatch
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.model.robot import Robot, SideSpring
from tdcr_fe.validation.blind.declared import largest_commands
from tdcr_fe.validation.blind.recipes import FORMS, PLACES, Recipe
from tdcr_fe.validation.reference import Extras, HoleFriction

#: By effect, the value of every parameter.
Values = dict[str, dict[str, float]]

#: Smallest misfit of the declared model over sigma, and the largest in a weak set [1].
DETECTABLE, WEAK = 5.0, 2.0


def _either(rng: np.random.Generator, low: float, high: float) -> float:
    """A size between two bounds, with either sign."""
    return float(rng.choice([-1.0, 1.0]) * rng.uniform(low, high))


@dataclass(frozen=True)
class _Sizes:
    """Sizes of the declared robot and of its solution, in which the values of effects are drawn.

    Attributes
    ----------
    length, shortest_bay, smallest_offset : float
        Of the backbone, between neighbouring disks, and of a hole from the backbone [m].
    bending_stiffness : float
        EI [N m^2].
    friction_coefficient : float
        Of the first tendon [1].
    holes : int
        Least number of holes with friction that a tendon passes.
    tension, displacement : float
        Largest base tension of the solution [N]; displacement that bends a part of the robot by 1 rad [m].
    strain : float
        Largest bending strain of the solution [1].
    duration : float
        Time of the last step [s]; zero without times.
    tendons : tuple of str
        Names.
    markers : int
        Number of markers.
    """

    length: float
    shortest_bay: float
    smallest_offset: float
    bending_stiffness: float
    friction_coefficient: float
    holes: int
    tension: float
    displacement: float
    strain: float
    duration: float
    tendons: tuple[str, ...]
    markers: int

    @classmethod
    def of(cls, declared: Experiment, solution: SequenceResult) -> _Sizes:
        """Of a declared robot and its solution."""
        robot, backbone = declared.robot, declared.robot.backbone
        return cls(
            length=backbone.length,
            shortest_bay=float(np.min(np.diff((0.0, *robot.disks.positions)))),
            smallest_offset=min(float(np.min(np.hypot(*robot.holes(t).T))) for t in robot.tendons),
            bending_stiffness=backbone.EI,
            friction_coefficient=robot.tendons[0].friction_coefficient,
            holes=min(len(robot.hole_arc_lengths(t)) - 2 for t in robot.tendons),
            tension=max(max(step.base_tensions) for step in solution.steps),
            displacement=max(largest_commands(robot, "displacement", 1.0).values()),
            strain=backbone.radius * max(_largest_curvature(step) for step in solution.steps),
            duration=max(s.time or 0.0 for s in declared.steps),
            tendons=robot.tendon_names,
            markers=len(declared.observation.markers),
        )


def _largest_curvature(step: StepResult) -> float:
    relative = np.swapaxes(step.rotations[:-1], 1, 2) @ step.rotations[1:]
    turn = Rotation.from_matrix(relative).as_rotvec()[:, :2]
    return float(np.max(np.linalg.norm(turn, axis=1) / np.diff(step.s)))


def _gravity(sizes: _Sizes, rng: np.random.Generator) -> dict[str, float]:
    """Of a robot that lies rather than stands."""
    direction = rng.standard_normal(3)
    direction[:2] *= 2.0
    g = (9.81 * direction / np.linalg.norm(direction)).tolist()
    return dict(zip(("g_x", "g_y", "g_z"), g, strict=True))


def _friction_coefficient(sizes: _Sizes, rng: np.random.Generator) -> dict[str, float]:
    """Above the declared one where that is small, else on either side."""
    mu = sizes.friction_coefficient
    sign = 1.0 if mu < 0.15 else float(rng.choice([-1.0, 1.0]))
    return {"mu": max(0.0, mu + sign * float(rng.uniform(0.05, 0.14)))}


#: By effect, a function of the sizes and the random numbers that draws the values of all parameters.
DRAW: dict[str, Callable[[_Sizes, np.random.Generator], dict[str, float]]] = {
    "gravity": _gravity,
    "stiffness_scale": lambda sizes, rng: {
        "bending": float(np.exp(_either(rng, 0.08, 0.35))),
        "torsion": float(np.exp(_either(rng, 0.05, 0.35))),
    },
    "friction_coefficient": _friction_coefficient,
    "actuator_loss": lambda sizes, rng: {
        "dead_band": float(rng.uniform(0.02, 0.12)) * sizes.tension,
        "efficiency": float(rng.uniform(0.85, 0.98)),
    },
    "hole_adhesion": lambda sizes, rng: {"drop": float(rng.uniform(0.1, 0.35)) * sizes.tension / sizes.holes},
    "superelastic": lambda sizes, rng: {
        "threshold_strain": float(rng.uniform(0.3, 0.6)) * sizes.strain,
        "plateau_ratio": float(rng.uniform(0.3, 0.7)),
    },
    "precurvature": lambda sizes, rng: {
        f"kappa_{axis}": _either(rng, 0.05, 0.3) / sizes.length for axis in "xy"
    },
    "rigid_disks": lambda sizes, rng: {"thickness": float(rng.uniform(0.1, 0.45)) * sizes.shortest_bay},
    "routing_twist": lambda sizes, rng: {"angle_tip": _either(rng, 0.1, 0.5)},
    "hole_clearance": lambda sizes, rng: {
        "clearance": min(float(rng.uniform(1e-4, 5e-4)), 0.4 * sizes.smallest_offset)
    },
    "tip_payload": lambda sizes, rng: {
        "mass": float(rng.uniform(0.1, 0.35)) * 2.0 * sizes.bending_stiffness / (9.81 * sizes.length**2)
    },
    "frame_misalignment": lambda sizes, rng: {f"rot_{axis}": _either(rng, 0.01, 0.05) for axis in "xyz"},
    "marker_offset": lambda sizes, rng: {f"offset_{axis}": _either(rng, 5e-4, 2.5e-3) for axis in "xy"},
    "tendon_stretch": lambda sizes, rng: {
        "axial_stiffness": sizes.tension
        * sizes.length
        / (float(rng.uniform(0.05, 0.25)) * sizes.displacement)
    },
    "base_compliance": lambda sizes, rng: {
        "stiffness": sizes.bending_stiffness / (float(rng.uniform(0.05, 0.2)) * sizes.length)
    },
    "time_lag": lambda sizes, rng: {"lag": float(rng.uniform(2.0, 8.0))},
    "pretension": lambda sizes, rng: {"tension": float(rng.uniform(0.1, 0.6)) * sizes.tension},
    "actuator_backlash": lambda sizes, rng: {"backlash": float(rng.uniform(0.05, 0.2)) * sizes.displacement},
    "actuator_gain": lambda sizes, rng: {
        "gain": float(rng.choice([rng.uniform(0.85, 0.95), rng.uniform(1.05, 1.15)]))
    },
    "idle_tension": lambda sizes, rng: {"tension": float(rng.uniform(0.03, 0.15)) * sizes.tension},
    "creep": lambda sizes, rng: {"rate": float(rng.uniform(0.05, 0.25)) / sizes.duration},
}


def _several(name: str, parts: Iterable[str], draw: Callable[[], float]) -> dict[str, float]:
    """A number of its own for each part."""
    return {f"{name}_{part}": draw() for part in parts}


#: The two segments of a robot, as parameters name them.
_SEGMENTS = ("segment_1", "segment_2")

#: The same as `DRAW` for the forms of effects.
DRAW_FORMS: dict[str, Callable[[_Sizes, np.random.Generator], dict[str, float]]] = {
    "stretch_by_segment": lambda sizes, rng: _several(
        "axial_stiffness", _SEGMENTS, lambda: DRAW["tendon_stretch"](sizes, rng)["axial_stiffness"]
    ),
    "stretch_of_each": lambda sizes, rng: _several(
        "axial_stiffness", sizes.tendons, lambda: DRAW["tendon_stretch"](sizes, rng)["axial_stiffness"]
    ),
    "pretension_by_segment": lambda sizes, rng: _several(
        "tension", _SEGMENTS, lambda: DRAW["pretension"](sizes, rng)["tension"]
    ),
    "friction_of_each": lambda sizes, rng: _several(
        "mu", sizes.tendons, lambda: float(rng.uniform(0.0, 0.4))
    ),
    "marker_beyond_tip": lambda sizes, rng: {
        **DRAW["marker_offset"](sizes, rng),
        "offset_z": _either(rng, 1e-3, 6e-3),
    },
    "markers_each": lambda sizes, rng: {
        f"offset_{axis}_marker_{k}": _either(rng, 5e-4, 2.5e-3)
        for k in range(1, sizes.markers + 1)
        for axis in "xyz"
    },
    "frame_elsewhere": lambda sizes, rng: {
        **DRAW["frame_misalignment"](sizes, rng),
        **{f"shift_{axis}": _either(rng, 5e-4, 4e-3) for axis in "xyz"},
    },
}


def draw_values(
    recipe: Recipe, declared: Experiment, solution: SequenceResult, rng: np.random.Generator
) -> Values:
    """Random values of the listed effects of a recipe.

    Parameters
    ----------
    recipe
        Its unlisted effects have no values here.
    declared, solution
        The declared robot and its solution, in whose sizes the values are drawn.
    rng
        Draws the values, in the order of the recipe's effects.
    """
    names = [name for name in recipe.effects if name not in PLACES]
    sizes = _Sizes.of(declared, solution)
    draw = {**DRAW, **DRAW_FORMS}
    return {FORMS.get(name, name): _rounded(draw[name](sizes, rng)) for name in names}


def _rounded(values: dict[str, float]) -> dict[str, float]:
    return {name: float(f"{value:.6g}") for name, value in values.items()}


def _stronger(declared: Experiment, values: Values, factor: float) -> Values:
    """All effects scaled about their null values, within their bounds; a softening section begins earlier."""
    result: Values = {}
    for name, own in values.items():
        e = effect(name)
        bounds = e.bounds(declared)
        new = dict(own)
        for p in (p for p in e.parameters_of(declared) if p.name in own):
            if name == "superelastic" and p.name == "threshold_strain":
                new[p.name] = own[p.name] / (factor if factor > 1.0 else 1.0)
                continue
            here, zero = p.coordinate(own[p.name]), p.coordinate(e.null_value(declared, p.name))
            low, high = sorted(p.coordinate(x) for x in bounds.get(p.name, (p.lower, p.upper)))
            new[p.name] = p.value(float(np.clip(zero + factor * (here - zero), low, high)))
        result[name] = _rounded(new)
    return result


def detectable(
    recipe: Recipe, declared: Experiment, values: Values, misfit: Callable[[Values], float]
) -> Values:
    """The effects strengthened until each is detectable by itself, or weakened until barely detectable.

    Parameters
    ----------
    recipe
        Says whether the effects are weak.
    declared
        The declared robot, for bounds and null values.
    values
        As drawn.
    misfit
        Root mean square misfit over sigma of the declared model, where the robot has certain effects [1].
    """
    result: Values = {}
    for name, own in values.items():
        single: Values = {name: own}
        size = misfit(single)
        for _ in range(3):
            if recipe.weak and not 0.7 * WEAK <= size <= 1.3 * WEAK:
                single = _stronger(declared, single, WEAK / size)
            elif not recipe.weak and size < 1.4 * DETECTABLE:
                single = _stronger(declared, single, min(2.5, 2.0 * DETECTABLE / size))
            else:
                break
            size = misfit(single)
        result |= single
    return result


@dataclass(frozen=True)
class Unlisted:
    """An unlisted effect, or none.

    Attributes
    ----------
    answer : dict
        "kind", location along the backbone ("start", "end" [m], "bay" from 1), and its size; empty where there is none.
    change : callable
        From the robot without it to the true one.
    extras : Extras
        Of the true robot.
    """

    answer: dict[str, Any]
    change: Callable[[Robot], Robot] = lambda robot: robot
    extras: Extras = field(default_factory=Extras)


def _with_patch(patch: StiffnessPatch) -> Callable[[Robot], Robot]:
    return lambda robot: robot.with_backbone(patches=(*robot.backbone.patches, patch))


def _soft_spot(declared: Experiment, edges: tuple[float, ...], rng: np.random.Generator) -> Unlisted:
    bay = int(rng.integers(1, max(2, round(0.7 * (len(edges) - 1))) + 1))
    factor = round(float(rng.uniform(0.3, 0.6)), 3)
    start, end = edges[bay - 1], edges[bay]
    answer = {"kind": "soft_spot", "bay": bay, "start": start, "end": end, "bending": factor}
    return Unlisted(answer, _with_patch(StiffnessPatch(start, end, factor, 1.0)))


def _side_spring(declared: Experiment, edges: tuple[float, ...], rng: np.random.Generator) -> Unlisted:
    bays = len(edges) - 1
    disk = int(rng.integers(round(0.35 * bays), round(0.65 * bays) + 1))
    at = edges[disk]
    stiffness = float(f"{rng.uniform(0.1, 0.5) * 3.0 * declared.robot.backbone.EI / at**3:.4g}")
    answer = {"kind": "side_spring", "bay": disk, "start": at, "end": at, "stiffness": stiffness}
    return Unlisted(answer, lambda robot: replace(robot, springs=(SideSpring(at, stiffness),)))


def _stuck_hole(declared: Experiment, edges: tuple[float, ...], rng: np.random.Generator) -> Unlisted:
    robot = declared.robot
    tendon = robot.tendons[int(rng.integers(0, len(robot.tendons)))]
    arc_lengths = robot.hole_arc_lengths(tendon)
    last = len(arc_lengths) - 1
    hole = int(rng.integers(max(1, round(0.3 * last)), max(2, round(0.7 * last) + 1)))
    at = float(arc_lengths[hole])
    highest = max(v for s in declared.steps for v in s.tensions.values())
    answer = {"kind": "stuck_hole", "bay": hole, "start": at, "end": at, "tendon": tendon.name, "hole": hole}
    return Unlisted(answer, extras=Extras(holes=(HoleFriction(tendon.name, hole, 0.0, 4.0 * highest),)))


def _kink(declared: Experiment, edges: tuple[float, ...], rng: np.random.Generator) -> Unlisted:
    bay = int(rng.integers(1, max(2, round(0.8 * (len(edges) - 1))) + 1))
    start, end = edges[bay - 1], edges[bay]
    angle, direction = float(rng.uniform(0.05, 0.2)), float(rng.uniform(0.0, 2.0 * np.pi))
    kappa = tuple(round(float(angle / (end - start) * f(direction)), 3) for f in (np.cos, np.sin))
    answer = {
        "kind": "kink",
        "bay": bay,
        "start": start,
        "end": end,
        "kappa_x": kappa[0],
        "kappa_y": kappa[1],
    }
    return Unlisted(answer, _with_patch(StiffnessPatch(start, end, 1.0, 1.0, (kappa[0], kappa[1]))))


_DRAW: dict[str, Callable[[Experiment, tuple[float, ...], np.random.Generator], Unlisted]] = {
    "soft_spot": _soft_spot,
    "side_spring": _side_spring,
    "stuck_hole": _stuck_hole,
    "kink": _kink,
}


def draw_unlisted(recipe: Recipe, declared: Experiment, rng: np.random.Generator) -> Unlisted:
    """The unlisted effect of a recipe, for the answer and for the true robot.

    Parameters
    ----------
    recipe
        With at most one of `tdcr_fe.validation.blind.recipes.PLACES`.
    declared
        The declared robot and its loading.
    rng
        Draws location and size.
    """
    wanted = [name for name in recipe.effects if name in PLACES]
    if not wanted:
        return Unlisted({})
    return _DRAW[wanted[0]](declared, (0.0, *declared.robot.disks.positions), rng)
