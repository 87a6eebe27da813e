"""What the net holds: by part, the keys of its cases and the function that computes the record of one."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

import tdcr_fe as tdcr
from tdcr_fe.effects import EFFECTS, Parameter
from tdcr_fe.elements import Array, Index
from tdcr_fe.validation.campaigns import broken_files
from tdcr_fe.validation.crosscheck.cases import Case, all_cases
from tdcr_fe.validation.net import scenes
from tdcr_fe.validation.random_robots import draw
from tdcr_fe.validation.reference import solve_reference

#: Of one case, by quantity: numbers, step by step, or a text.
Record = dict[str, Array | str]

#: Number of random robots, of those that the reference solves, and of broken input files.
ROBOTS, REFERENCES, FILES = 200, 30, 300
#: Nodes of a validation case whose positions are kept.
NODES = 5
#: Targets that each robot of the inverse statics is led through.
TARGETS = 20


class Part(NamedTuple):
    """One part of the net."""

    keys: Callable[[], Sequence[str]]
    solve: Callable[[str], Record]
    quick: int  # the quick form takes every so many-th case
    tolerance: float = 1e-9  # of a quantity, relative to its size


# ------------------------------------------------------------------------------------------------- loading sequences


def sequence(result: tdcr.SequenceResult, most_nodes: int | None = None, *, slips: bool = False) -> Record:
    """Shapes at the disks, tensions and hole states of all solved steps.

    Parameters
    ----------
    result
        Of either solver.
    most_nodes
        Largest number of disks whose positions are kept; None keeps all.
    slips
        Keep what the path of each tendon has shortened beyond each of its holes, too.
    """
    robot, steps = result.robot, result.steps
    at = np.array(robot.disks.positions or (robot.backbone.length,))
    if most_nodes is not None and len(at) > most_nodes:
        at = at[np.unique(np.linspace(0, len(at) - 1, most_nodes).round().astype(int))]
    found: Record = {
        "converged": str(result.converged if result.failed_step is None else result.failed_step),
        "warnings": str(len(result.warnings)),
        "elements_per_bay": " ".join(map(str, result.elements_per_bay)),
        "states": _states(step.hole_states for step in steps),
    }
    if not steps:
        return found
    found["positions"] = np.array([step.positions[_nodes(step, at)] for step in steps])
    found["tangents"] = np.array([step.tangent for step in steps])
    found["tensions"] = np.array([np.concatenate([*step.tensions, np.zeros(0)]) for step in steps])
    found["displacements"] = np.array([step.displacements for step in steps])
    found["estimates"] = np.array([step.discretisation_error or 0.0 for step in steps])
    if slips:
        found["slips"] = np.array([_slips(robot, step) for step in steps])
    return found


def _states(steps: Iterable[Sequence[Sequence[str]]]) -> str:
    """First letters of all hole states: steps are set apart by "/", tendons by a space."""
    return "/".join(" ".join("".join(s[0] for s in tendon) for tendon in step) for step in steps)


def _nodes(step: tdcr.StepResult, at: Array) -> Index:
    nodes = np.abs(step.s[:, None] - at).argmin(axis=0)
    if np.abs(step.s[nodes] - at).max() > 1e-9:
        raise RuntimeError("a disk is no node of the solution")
    return nodes


def _slips(robot: tdcr.Robot, step: tdcr.StepResult) -> Array:
    """By tendon and hole, what the path beyond the hole has shortened since the straight, unloaded robot [m]."""
    found = [np.zeros(0)]
    for tendon in robot.tendons:
        s = robot.hole_arc_lengths(tendon)
        offsets = np.zeros((len(s), 3))
        offsets[:, :2] = robot.hole_points(tendon)[:, :2]
        nodes = _nodes(step, np.asarray(s))
        holes = step.positions[nodes] + np.einsum("nij,nj->ni", step.rotations[nodes], offsets)
        straight = offsets + np.column_stack((np.zeros((len(s), 2)), s))
        now, before = (np.linalg.norm(np.diff(x, axis=0), axis=1) for x in (holes, straight))
        found.append(np.cumsum((before - now)[::-1])[::-1])
    return np.concatenate(found)


def _robot(key: str) -> Record:
    case = draw(int(key))
    return sequence(tdcr.simulate(case.robot, case.model, case.steps), slips=True)


def _reference(key: str) -> Record:
    case = draw(int(key))
    return sequence(solve_reference(case.robot, case.model, case.steps))


@cache
def _cases() -> Mapping[str, Case]:
    return {case.id: case for case in all_cases()}


def _case(key: str) -> Record:
    case = _cases()[key]
    return sequence(tdcr.simulate(case.robot, case.model, case.steps), NODES)


# ------------------------------------------------------------------------------------------------------- derivatives

LENGTH = 0.2
BACKBONE = tdcr.Backbone(LENGTH, 0.4e-3, 85e9, 0.3, density=5600.0)
DISKS = tdcr.Disks.equally_spaced(4, LENGTH, mass=2e-4, radius=5e-3)
#: Robots of the derivatives: by name, friction of the model, stiffness of the tendons, and the inputs.
DRIVES: Mapping[str, tuple[str, float | None, str]] = {
    "tension, no friction": ("none", None, "tensions"),
    "tension, per hole": ("per-hole", None, "tensions"),
    "displacement, elastic": ("per-hole", 400.0, "displacements"),
}


def _experiment(drive: str) -> tdcr.Experiment:
    """A robot of three tendons, and four steps with a reversal and a load."""
    friction, stiffness, inputs = DRIVES[drive]
    straight = tdcr.Tendon("t1", tdcr.ParallelRouting(4.5e-3, 0.0), 0.25, axial_stiffness=stiffness)
    winding = replace(straight, name="t2", routing=tdcr.HelicalRouting(4.5e-3, 0.3, 110.0))
    short = replace(straight, name="t3", routing=tdcr.ConvergingRouting(4.5e-3, 2e-3, -130.0), end=0.15)
    size = 1.0 if inputs == "tensions" else 2.5e-3
    levels = ((1.2, 0.3, 0.1), (0.9, 0.3, 0.2), (0.5, 0.2, 0.6), (1.0, 0.5, 0.3))
    load = {"tip": tdcr.Load(LENGTH, (0.01, 0.02, 0.0), (0.0, 5e-4, 3e-4))}
    given = [{f"t{i}": size * x for i, x in enumerate(level, start=1)} for level in levels]
    steps = [tdcr.LoadStep(**{inputs: x}, time=float(k)) for k, x in enumerate(given, start=1)]  # type: ignore[arg-type]
    steps[1] = replace(steps[1], loads=load)
    model = tdcr.Model(friction=friction, elements_per_bay=1, gravity=(0.5, 1.0, -9.81))  # type: ignore[arg-type]
    robot = tdcr.Robot(BACKBONE, DISKS, (straight, winding, short), "three")
    return tdcr.Experiment(robot, model, tuple(steps))


def _derivative_keys() -> list[str]:
    pairs = [(drive, effect, _experiment(drive)) for drive in DRIVES for effect in EFFECTS]
    return [f"{drive}: {e.name}.{p.name}" for drive, e, own in pairs for p in e.parameters_of(own)]


def _derivative(key: str) -> Record:
    """By one parameter of an effect at a noticeable value, times the parameter's typical change."""
    drive, name, parameter = re.fullmatch(r"(.*): (\w+)\.(.*)", key).groups()  # type: ignore[union-attr]
    declared, effect = _experiment(drive), tdcr.effect(name)
    known = {p.name: p for p in effect.parameters_of(declared)}
    about = known[parameter]
    given = [*effect.parameters, about] if about not in effect.parameters else effect.parameters
    values = {name: {p.name: _noticeable(name, p, effect.null_value(declared, p.name)) for p in given}}
    chosen = tdcr.effect_parameter(declared, name, parameter, values)
    experiment = tdcr.with_effects(declared, values)
    result = tdcr.simulate(experiment.robot, experiment.model, experiment.steps, sensitivities=[chosen])
    size, by = about.scale, result.sensitivities[chosen.name]
    found = {key: size * getattr(by, key) for key in ("positions", "rotations", "displacements")}
    found |= {key: size * np.concatenate(getattr(by, key), axis=1) for key in ("tensions", "slips")}
    return {"converged": str(result.converged), **found}


def _noticeable(effect: str, parameter: Parameter, null: float) -> float:
    """A value of a parameter of an effect at which the effect can be noticed."""
    if parameter.name == "s":  # a place: within a bay, or a disk
        return 0.6 * LENGTH if effect in ("soft_bay", "kink") else 0.5 * LENGTH
    start, change = parameter.coordinate(null), 2.0 * parameter.scale
    if not math.isfinite(start):
        start = parameter.lower
    values = (parameter.value(start + change), parameter.value(start - change))
    return next(x for x in values if parameter.lower <= x <= parameter.upper)


# ---------------------------------------------------------------------------------------------------- inverse statics


#: Robots of the inverse statics.
INVERSE = ("no friction", "friction", "two segments")


def _inverse_robot(key: str) -> tuple[tdcr.Robot, tdcr.Model]:
    mu = 0.0 if key == "no friction" else 0.2
    at = (0.5 * LENGTH, LENGTH) if key == "two segments" else (LENGTH,)
    rows = [(f"t{k}{i}", 120.0 * i + 60.0 * k, end) for k, end in enumerate(at) for i in range(3)]
    tendons = tuple(tdcr.Tendon(n, tdcr.ParallelRouting(4.5e-3, a), mu, end=end) for n, a, end in rows)
    friction = "per-hole" if mu else "none"
    robot = tdcr.Robot(BACKBONE, tdcr.Disks.equally_spaced(6, LENGTH), tendons, key)
    return robot, tdcr.Model(friction=friction, elements_per_bay=1)  # type: ignore[arg-type]


def _inverse(key: str) -> Record:
    """The tips of a random walk of the tensions; the last target is out of reach."""
    robot, model = _inverse_robot(key)
    walk = np.random.default_rng(5).uniform(-0.5, 0.5, (TARGETS, len(robot.tendons))).cumsum(axis=0)
    tensions = 0.2 + np.abs(walk)
    steps = [tdcr.LoadStep("", dict(zip(robot.tendon_names, t, strict=True))) for t in tensions.tolist()]
    targets = tdcr.simulate(robot, model, steps).tips
    targets[-1] *= 1.2
    found = tdcr.follow_path(robot, model, targets, tdcr.TensionLimits(largest=3.0, pretension=0.1)).targets
    inputs = {key: np.array([getattr(x, key) for x in found]) for key in ("tensions", "displacements")}
    status = " ".join(str(x.status.value) for x in found)
    return {"status": status, "positions": np.array([x.result.tip for x in found]), **inputs}


# ------------------------------------------------------------------------------------------------------ broken files


def _file(key: str) -> Record:
    """Verdict about a broken input file, and the keys that the message names."""
    found = vars(broken_files.run_case(broken_files.draw(int(key))))
    named = re.findall(r"(\w+\.(?:toml|csv|json)): ([\w.\[\]]+) = ", found["text"])
    texts = {name: str(found[name]) for name in ("inputs", "file", "mutation", "key", "outcome", "status")}
    if found["outcome"] == "valid, long":
        texts |= {"outcome": "valid", "status": "0"}
    return {**texts, "named": ", ".join(sorted({f"{file}: {name}" for file, name in named}))}


def _numbers(count: int) -> Callable[[], list[str]]:
    return lambda: [str(k) for k in range(count)]


#: All parts that are computed case by case.
PARTS: Mapping[str, Part] = {
    "robots": Part(_numbers(ROBOTS), _robot, 5),
    "cases": Part(lambda: list(_cases()), _case, 6),
    # Exudyn's solvers stop at tolerances of their own.
    "scenes": Part(lambda: list(scenes.SCENES), scenes.solve, 3, 1e-7),
    # Difference steps of parameters round off.
    "derivatives": Part(_derivative_keys, _derivative, 10, 1e-6),
    # A target is reached within 1e-6 of the length.
    "inverse": Part(lambda: list(INVERSE), _inverse, 3, 1e-6),
    "reference": Part(_numbers(REFERENCES), _reference, 10),
    "files": Part(_numbers(FILES), _file, 10),
}


def solve(part: str, key: str) -> Record:
    """The record of one case of a part; where the program fails, the kind of error."""
    try:
        return PARTS[part].solve(key)
    except Exception as error:
        return {"failure": type(error).__name__}
