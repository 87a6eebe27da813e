"""Make one blind set with the reference: a folder of measured data, and the answer in a separate file."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tdcr_fe.effects import Experiment, effect, with_effects
from tdcr_fe.io.measured import MeasuredData, Reading, write_measured
from tdcr_fe.model.channels import ObservedStep, channel
from tdcr_fe.model.loading import Model
from tdcr_fe.model.results import SequenceResult
from tdcr_fe.model.robot import Robot, StiffnessPatch
from tdcr_fe.validation.blind.experiment import draw_loading, draw_robot, largest_commands
from tdcr_fe.validation.blind.recipes import OFF_LIST, Recipe
from tdcr_fe.validation.reference import Extras, HoleFriction, ReferenceSettings, Spring, solve_reference

Array = NDArray[np.float64]
Values = dict[str, dict[str, float]]

#: Substeps of every load step of the true robot, to resolve path dependence.
SUBSTEPS = 16

#: Smallest misfit of the declared model over sigma, and the largest in a weak set [1].
DETECTABLE, WEAK = 5.0, 2.0


class NotMade(Exception):
    """The true robot of a recipe cannot be solved; the message names the step."""


@dataclass(frozen=True)
class Answer:
    """The hidden truth of a blind set.

    Attributes
    ----------
    recipe : Recipe
    effects : dict
        By listed effect, the true value of every parameter.
    off_list : dict
        The unlisted effect: "kind", location along the backbone ("start", "end" [m], "bay" from 1), and its size.
    noise_free : list of float
        Readings without noise, in their order.
    declared_off : float
        Root mean square of the declared model's misfit, without noise, over sigma [1].
    detectable : bool
        Whether that is at least `DETECTABLE`.
    substeps : int
        Of every load step of the true robot.
    robot : str
    """

    recipe: Recipe
    effects: Values
    off_list: dict[str, Any]
    noise_free: list[float]
    declared_off: float
    detectable: bool
    substeps: int
    robot: str

    def to_json(self) -> dict[str, Any]:
        """For a file."""
        return asdict(self)

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Answer:
        """From a file."""
        recipe = document["recipe"]
        return cls(**{**document, "recipe": Recipe(**{**recipe, "effects": tuple(recipe["effects"])})})


def make_blind(folder: str | os.PathLike[str], recipe: Recipe | int, substeps: int = SUBSTEPS) -> Answer:
    """Make one blind set.

    Parameters
    ----------
    folder
        Where robot, loading sequence and readings are written; the answer is not.
    recipe
        What to make, or a seed for a clean set.
    substeps
        Of every load step of the true robot.

    Returns
    -------
    Answer
        The hidden truth.

    Raises
    ------
    NotMade
        No robot drawn from this seed can be solved with the effects.
    """
    if isinstance(recipe, int):
        recipe = Recipe(recipe)
    reason = ""
    for attempt in range(4):
        try:
            data, answer = _make(recipe, np.random.default_rng([recipe.seed, attempt]), substeps)
        except NotMade as problem:
            reason = str(problem)
            continue
        write_measured(data, folder)
        return answer
    raise NotMade(f"seed {recipe.seed}: {reason}")


def _make(recipe: Recipe, rng: np.random.Generator, substeps: int) -> tuple[MeasuredData, Answer]:
    robot = draw_robot(recipe.robot, rng)
    timed = "creep" in recipe.effects or rng.random() < 0.2
    steps, branches = draw_loading(robot, recipe.drive, timed, rng)
    gravity = (0.0, 0.0, 0.0)
    if "tip_payload" in recipe.effects or ("gravity" not in recipe.effects and rng.random() < 0.2):
        direction = np.array(
            [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)][rng.integers(0, 4)]
        )
        if "tip_payload" in recipe.effects:
            direction = np.array([0.0, 1.0, 0.0])
        gravity = (float(9.81 * direction[0]), float(9.81 * direction[1]), float(9.81 * direction[2]))
    declared = Experiment(robot, Model(gravity=gravity, elements_per_bay=2), steps)
    arc_lengths = _markers(robot, rng)
    kinds = {"tendon_displacement": recipe.drive == "tension" and rng.random() < 0.5,
             "distal_tension": rng.random() < 0.2}  # fmt: skip
    marks = _planned_readings(declared, arc_lengths, [k for k, wanted in kinds.items() if wanted])
    sigma = {"m": recipe.sigma, "rad": recipe.sigma / 0.06, "N": 5e-3}
    scale = np.array([5e-5 if m[1] == "tendon_displacement" else sigma[channel(m[1]).unit] for m in marks])

    coarse = min(2, substeps)
    base = _solve(declared, Extras(), arc_lengths, coarse)
    start = read(base, declared, marks)
    values = _draw_effects(recipe, declared, base, rng)
    off_list, patches, extras = _draw_off_list(recipe, declared, rng)

    def truth(values: Values) -> Experiment:
        setup = with_effects(declared, values)
        if patches:
            backbone = replace(setup.robot.backbone, patches=(*setup.robot.backbone.patches, *patches))
            setup = setup.with_robot(backbone=backbone)
        return setup

    def off(values: Values) -> float:
        setup = truth(values)
        change = (read(_solve(setup, extras, arc_lengths, coarse), setup, marks) - start) / scale
        return float(np.sqrt(np.mean(change**2)))

    if values:
        values = _detectable(recipe, declared, values, off)
    setup = truth(values)
    exact = read(_solve(setup, extras, arc_lengths, substeps), setup, marks)
    declared_off = float(np.sqrt(np.mean(((exact - start) / scale) ** 2))) if recipe.effects else 0.0
    measured = exact + scale * rng.standard_normal(len(exact))
    readings = tuple(
        Reading(step + 1, quantity, location, round(float(v), 8), float(u))
        for (step, quantity, location), v, u in zip(marks, measured, scale, strict=True)
    )
    ids = tuple(range(1, len(steps) + 1))
    data = MeasuredData(f"seed {recipe.seed}", robot, declared.model, ids, steps, branches, readings)
    answer = Answer(
        recipe,
        values,
        off_list,
        [float(x) for x in exact],
        declared_off,
        declared_off >= DETECTABLE,
        substeps,
        robot.name,
    )
    return data, answer


# ------------------------------------------------------------------------------------------- what is read

Mark = tuple[int, str, float | str | None]


def _markers(robot: Robot, rng: np.random.Generator) -> tuple[float, ...]:
    """About five disks, the last one among them."""
    count = len(robot.disks.positions)
    chosen = {round(x) for x in np.linspace(count / 5.0, count, 5) + rng.uniform(-0.4, 0.4, 5)}
    return tuple(robot.disks.positions[min(max(k, 1), count) - 1] for k in sorted({*chosen, count}))


def _planned_readings(setup: Experiment, arc_lengths: tuple[float, ...], more: list[str]) -> list[Mark]:
    """Step from 0, quantity and location of every reading."""
    marks: list[Mark] = []
    for k in range(len(setup.steps)):
        marks += [(k, f"position_{axis}", s) for s in arc_lengths for axis in "xyz"]
        marks.append((k, "bending_angle", None))
        marks += [(k, quantity, name) for quantity in more for name in setup.robot.tendon_names]
    return marks


def read(result: SequenceResult, setup: Experiment, marks: list[Mark]) -> Array:
    """Readings without noise.

    Parameters
    ----------
    result
        With nodes at all markers.
    setup
        Its observation: ``measured = Exp(rotation) (p + R offset)``, tangents turned as well.
    marks
        Step from 0, quantity and location of every reading.

    Returns
    -------
    numpy.ndarray
        In the order of the marks [m, rad, N].
    """
    names = tuple(setup.robot.tendon_names)
    look = setup.observation
    # Where effects divide a step, its end is read.
    end = {k: j for j, (k, _) in enumerate(setup.step_ends)}
    observed = {
        k: ObservedStep.of(result.steps[end[k]], names, look.rotation, look.offset) for k, _, _ in marks
    }
    return np.array([float(channel(q).predict(observed[k], [location])[0]) for k, q, location in marks])


def _solve(
    setup: Experiment, extras: Extras, arc_lengths: tuple[float, ...], substeps: int
) -> SequenceResult:
    settings = ReferenceSettings(sample_at=arc_lengths, substeps=substeps)
    result = solve_reference(setup.robot, setup.model, setup.steps, settings=settings, extras=extras)
    if not result.converged:
        raise NotMade(result.message)
    if max(step.bending_angle for step in result.steps) > 2.8:
        raise NotMade("the tip turns back to the base")
    return result


# ------------------------------------------------------------------------------------------- what is hidden


def _either(rng: np.random.Generator, low: float, high: float) -> float:
    """A size between two bounds, with either sign."""
    return float(rng.choice([-1.0, 1.0]) * rng.uniform(low, high))


def _draw_effects(
    recipe: Recipe, declared: Experiment, base: SequenceResult, rng: np.random.Generator
) -> Values:
    """Random values of the listed effects, in the range of real robots."""
    robot, steps = declared.robot, declared.steps
    backbone, length = robot.backbone, robot.backbone.length
    bay = float(np.min(np.diff((0.0, *robot.disks.positions))))
    top = max(max(step.base_tensions) for step in base.steps)
    pulled = max(largest_commands(robot, "displacement", 1.0).values())
    mu = robot.tendons[0].friction_coefficient
    holes = min(len(robot.hole_arc_lengths(t)) - 2 for t in robot.tendons)
    inner = min(float(np.min(np.hypot(*robot.holes(t).T))) for t in robot.tendons)
    strain = backbone.radius * max(_largest_curvature(step) for step in base.steps)
    values: Values = {}
    for name in recipe.effects:
        draw: dict[str, float] = {}
        if name == "gravity":
            direction = rng.standard_normal(3)
            direction[:2] *= 2.0
            draw = dict(
                zip(
                    ("g_x", "g_y", "g_z"),
                    (9.81 * direction / np.linalg.norm(direction)).tolist(),
                    strict=True,
                )
            )
        elif name == "stiffness_scale":
            draw = {
                "bending": float(np.exp(_either(rng, 0.08, 0.35))),
                "torsion": float(np.exp(_either(rng, 0.05, 0.35))),
            }
        elif name == "friction_coefficient":
            draw = {
                "mu": max(
                    0.0,
                    mu
                    + (1.0 if mu < 0.15 else float(rng.choice([-1.0, 1.0]))) * float(rng.uniform(0.05, 0.14)),
                )
            }
        elif name == "actuator_loss":
            draw = {
                "dead_band": float(rng.uniform(0.02, 0.12)) * top,
                "efficiency": float(rng.uniform(0.85, 0.98)),
            }
        elif name == "hole_adhesion":
            draw = {"drop": float(rng.uniform(0.1, 0.35)) * top / holes}
        elif name == "superelastic":
            draw = {
                "threshold_strain": float(rng.uniform(0.3, 0.6)) * strain,
                "plateau_ratio": float(rng.uniform(0.3, 0.7)),
            }
        elif name == "precurvature":
            draw = {"kappa_x": _either(rng, 0.05, 0.3) / length, "kappa_y": _either(rng, 0.05, 0.3) / length}
        elif name == "rigid_disks":
            draw = {"thickness": float(rng.uniform(0.1, 0.45)) * bay}
        elif name == "routing_twist":
            draw = {"angle_tip": _either(rng, 0.1, 0.5)}
        elif name == "hole_clearance":
            draw = {"clearance": min(float(rng.uniform(1e-4, 5e-4)), 0.4 * inner)}
        elif name == "tip_payload":
            draw = {"mass": float(rng.uniform(0.1, 0.35)) * 2.0 * backbone.EI / (9.81 * length**2)}
        elif name == "frame_misalignment":
            draw = {f"rot_{axis}": _either(rng, 0.01, 0.05) for axis in "xyz"}
        elif name == "marker_offset":
            draw = {f"offset_{axis}": _either(rng, 5e-4, 2.5e-3) for axis in "xy"}
        elif name == "tendon_stretch":
            draw = {"axial_stiffness": top * length / (float(rng.uniform(0.05, 0.25)) * pulled)}
        elif name == "actuator_backlash":
            draw = {"backlash": float(rng.uniform(0.05, 0.2)) * pulled}
        elif name == "actuator_gain":
            draw = {"gain": float(rng.choice([rng.uniform(0.85, 0.95), rng.uniform(1.05, 1.15)]))}
        elif name == "creep":
            draw = {"rate": float(rng.uniform(0.05, 0.25)) / max(s.time or 0.0 for s in steps)}
        if draw:
            values[name] = {k: float(f"{v:.6g}") for k, v in draw.items()}
    return values


def _largest_curvature(step: Any) -> float:
    relative = np.swapaxes(step.rotations[:-1], 1, 2) @ step.rotations[1:]
    turn = Rotation.from_matrix(relative).as_rotvec()[:, :2]
    return float(np.max(np.linalg.norm(turn, axis=1) / np.diff(step.s)))


def _stronger(declared: Experiment, values: Values, factor: float) -> Values:
    """All effects scaled about their null values, within their bounds; a softening section begins earlier."""
    result: Values = {}
    for name, own in values.items():
        e = effect(name)
        absent, bounds = e.null_values(declared), e.bounds(declared)
        new = dict(own)
        for p in e.parameters:
            if name == "superelastic" and p.name == "threshold_strain":
                new[p.name] = own[p.name] / (factor if factor > 1.0 else 1.0)
                continue
            here, zero = p.coordinate(own[p.name]), p.coordinate(absent[p.name])
            low, high = sorted(p.coordinate(x) for x in bounds[p.name])
            new[p.name] = p.value(float(np.clip(zero + factor * (here - zero), low, high)))
        result[name] = {k: float(f"{v:.6g}") for k, v in new.items()}
    return result


def _detectable(recipe: Recipe, declared: Experiment, values: Values, off: Any) -> Values:
    """The effects strengthened until each is detectable by itself, or weakened until barely detectable."""
    result: Values = {}
    for name, own in values.items():
        alone: Values = {name: own}
        size = off(alone)
        for _ in range(3):
            if recipe.weak and not 0.7 * WEAK <= size <= 1.3 * WEAK:
                alone = _stronger(declared, alone, WEAK / size)
            elif not recipe.weak and size < 1.4 * DETECTABLE:
                alone = _stronger(declared, alone, min(2.5, 2.0 * DETECTABLE / size))
            else:
                break
            size = off(alone)
        result |= alone
    return result


def _draw_off_list(
    recipe: Recipe, declared: Experiment, rng: np.random.Generator
) -> tuple[dict[str, Any], tuple[StiffnessPatch, ...], Extras]:
    """The unlisted effect, for the answer and for the true robot."""
    wanted = [n for n in recipe.effects if n in OFF_LIST]
    if not wanted:
        return {}, (), Extras()
    robot = declared.robot
    edges = (0.0, *robot.disks.positions)
    bays = len(edges) - 1
    if wanted[0] == "soft_spot":
        bay = int(rng.integers(1, max(2, round(0.7 * bays)) + 1))
        factor = round(float(rng.uniform(0.3, 0.6)), 3)
        hidden = {
            "kind": "soft_spot",
            "bay": bay,
            "start": edges[bay - 1],
            "end": edges[bay],
            "bending": factor,
        }
        return hidden, (StiffnessPatch(edges[bay - 1], edges[bay], factor, 1.0),), Extras()
    if wanted[0] == "side_spring":
        disk = int(rng.integers(round(0.35 * bays), round(0.65 * bays) + 1))
        at = edges[disk]
        stiffness = float(f"{rng.uniform(0.1, 0.5) * 3.0 * robot.backbone.EI / at**3:.4g}")
        hidden = {"kind": "side_spring", "bay": disk, "start": at, "end": at, "stiffness": stiffness}
        return hidden, (), Extras(springs=(Spring(at, (stiffness, stiffness, 0.0)),))
    tendon = robot.tendons[int(rng.integers(0, len(robot.tendons)))]
    arc_lengths = robot.hole_arc_lengths(tendon)
    hole = int(
        rng.integers(
            max(1, round(0.3 * (len(arc_lengths) - 1))), max(2, round(0.7 * (len(arc_lengths) - 1)) + 1)
        )
    )
    top = max(v for s in declared.steps for v in s.tensions.values())
    hidden = {"kind": "stuck_hole", "bay": hole, "start": float(arc_lengths[hole]), "end": float(arc_lengths[hole]),
            "tendon": tendon.name, "hole": hole}  # fmt: skip
    return hidden, (), Extras(holes=(HoleFriction(tendon.name, hole, 0.0, 4.0 * top),))
