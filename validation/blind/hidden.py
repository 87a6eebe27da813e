"""Draw what is hidden: values of effects, scaled until they are detectable."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from tdcr_fe.effects import Experiment, effect
from tdcr_fe.model.observed_step import turns
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.validation.blind.declared import largest_commands
from tdcr_fe.validation.blind.recipes import Recipe
from tdcr_fe.validation.drawing import ranges

Random = np.random.Generator
#: By effect, the value of every parameter.
Values = dict[str, dict[str, float]]
Misfit = Callable[[Values], float]

#: Smallest misfit of the declared model over sigma, and the largest in a weak set [1].
DETECTABLE, WEAK = 5.0, 2.0


def sizes_of(declared: Experiment, solution: SequenceResult) -> dict[str, float]:
    """Sizes of the declared robot and of its solution, in which the values of effects are drawn."""
    robot, backbone = declared.robot, declared.robot.backbone
    tension = max(max(step.base_tensions) for step in solution.steps)  # [N]
    # That bends a part by 1 rad [m].
    displacement = max(largest_commands(robot, "displacement", 1.0).values())
    holes = min(len(robot.hole_arc_lengths(t)) - 2 for t in robot.tendons)  # with friction, of a tendon
    duration = max(s.time or 0.0 for s in declared.steps)
    return {
        "tension": tension,
        "tension of a hole": tension / max(holes, 1),
        "displacement": displacement,
        "strain": backbone.radius * max(_largest_curvature(step) for step in solution.steps),
        "bay": float(np.min(np.diff((0.0, *robot.disks.positions)))),
        "offset": min(float(np.min(np.hypot(*robot.holes(t).T))) for t in robot.tendons),
        "curvature": 1.0 / backbone.length,
        "mass": 2.0 * backbone.EI / (9.81 * backbone.length**2),
        "axial stiffness": tension * backbone.length / displacement,
        "base stiffness": backbone.EI / backbone.length,
        "rate": 1.0 / duration if duration else np.nan,
        "friction": robot.tendons[0].friction_coefficient,
    }


def _largest_curvature(step: StepResult) -> float:
    return float(np.max(np.linalg.norm(turns(step.rotations)[:, :2], axis=1) / np.diff(step.s)))


#: By effect, the ranges of its parameters.
RANGES = ranges("blind")


def _gravity(declared: Experiment, sizes: Mapping[str, float], rng: Random) -> dict[str, float]:
    """Of a robot that lies rather than stands."""
    direction = rng.standard_normal(3)
    direction[:2] *= 2.0
    g = (9.81 * direction / np.linalg.norm(direction)).tolist()
    return dict(zip(("g_x", "g_y", "g_z"), g, strict=True))


def _friction(declared: Experiment, sizes: Mapping[str, float], rng: Random) -> dict[str, float]:
    """Above the declared one where that is small, else on either side."""
    mu = sizes["friction"]
    sign = 1.0 if mu < 0.15 else float(rng.choice([-1.0, 1.0]))
    return {"mu": max(0.0, mu + sign * float(rng.uniform(0.05, 0.14)))}


def _gain(declared: Experiment, sizes: Mapping[str, float], rng: Random) -> dict[str, float]:
    return {"gain": float(rng.choice([rng.uniform(0.85, 0.95), rng.uniform(1.05, 1.15)]))}


def _edges(declared: Experiment) -> tuple[tuple[float, ...], int]:
    """Edges of the bays between disks, and their number."""
    return (0.0, *declared.robot.disks.positions), len(declared.robot.disks.positions)


def _soft_bay(declared: Experiment, sizes: Mapping[str, float], rng: Random) -> dict[str, float]:
    edges, bays = _edges(declared)
    bay = int(rng.integers(1, max(2, round(0.7 * bays)) + 1))
    return {"s": 0.5 * (edges[bay - 1] + edges[bay]), "factor": round(float(rng.uniform(0.3, 0.6)), 3)}


def _kink(declared: Experiment, sizes: Mapping[str, float], rng: Random) -> dict[str, float]:
    edges, bays = _edges(declared)
    bay = int(rng.integers(1, max(2, round(0.8 * bays)) + 1))
    rate = float(rng.uniform(0.05, 0.2)) / (edges[bay] - edges[bay - 1])
    direction = float(rng.uniform(0.0, 2.0 * np.pi))
    kappa = {"kappa_x": rate * np.cos(direction), "kappa_y": rate * np.sin(direction)}
    return {"s": 0.5 * (edges[bay - 1] + edges[bay]), **{k: round(float(v), 3) for k, v in kappa.items()}}


def _side_spring(declared: Experiment, sizes: Mapping[str, float], rng: Random) -> dict[str, float]:
    edges, bays = _edges(declared)
    at = edges[int(rng.integers(round(0.35 * bays), round(0.65 * bays) + 1))]
    stiffness = rng.uniform(0.1, 0.5) * 3.0 * declared.robot.backbone.EI / at**3
    return {"s": at, "stiffness": float(f"{stiffness:.4g}")}


def _stuck_hole(declared: Experiment, sizes: Mapping[str, float], rng: Random) -> dict[str, float]:
    number = int(rng.integers(0, len(declared.robot.tendons)))
    at = declared.robot.hole_arc_lengths(declared.robot.tendons[number])
    last = len(at) - 1
    hole = int(rng.integers(max(1, round(0.3 * last)), max(2, round(0.7 * last) + 1)))
    return {"tendon": number + 1.0, "s": float(at[hole]), "drop": 4.0 * declared.largest_tension}


#: Effects whose values are no ranges alone.
DRAW: Mapping[str, Callable[[Experiment, Mapping[str, float], Random], dict[str, float]]] = {
    "gravity": _gravity,
    "friction_coefficient": _friction,
    "actuator_gain": _gain,
    "soft_bay": _soft_bay,
    "kink": _kink,
    "side_spring": _side_spring,
    "stuck_hole": _stuck_hole,
}


def draw_values(recipe: Recipe, declared: Experiment, solution: SequenceResult, rng: Random) -> Values:
    """Random values of the effects of a recipe, by their names.

    Parameters
    ----------
    recipe
        Names the effects.
    declared, solution
        The declared robot and its solution, in whose sizes the values are drawn.
    rng
        Draws the values, in the order of the recipe's effects.
    """
    sizes, found = sizes_of(declared, solution), {}
    for name in recipe.effects:
        if name in DRAW:
            own = DRAW[name](declared, sizes, rng)
        else:
            own = {p: r.draw(rng, sizes) for p, r in RANGES[name].items()}
        if name == "hole_clearance":
            own["clearance"] = min(own["clearance"], 0.4 * sizes["offset"])
        found[name] = own if recipe.at_a_place else _rounded(own)
    return found


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


def detectable(recipe: Recipe, declared: Experiment, values: Values, misfit: Misfit) -> Values:
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
