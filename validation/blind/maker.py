"""Make one blind set with the reference: a folder of measured data, and the answer in a separate file."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Experiment, Observation, with_effects
from tdcr_fe.io.measured import MeasuredData, write_measured
from tdcr_fe.model.channels import channel
from tdcr_fe.model.loading import Model
from tdcr_fe.model.results import SequenceResult
from tdcr_fe.validation.blind.declared import (
    Mark,
    draw_loading,
    draw_markers,
    draw_robot,
    largest_commands,
    measured,
    planned_readings,
    read,
)
from tdcr_fe.validation.blind.hidden import (
    DETECTABLE,
    Values,
    detectable,
    draw_unlisted,
    draw_values,
)
from tdcr_fe.validation.blind.recipes import DRIVES, Recipe
from tdcr_fe.validation.reference import Extras, ReferenceSettings, solve_reference

Array = NDArray[np.float64]

#: Substeps of every load step of the true robot, to resolve path dependence.
SUBSTEPS = 16


class NotMade(Exception):
    """The true robot of a recipe cannot be solved; the message names the step."""


@dataclass(frozen=True)
class Answer:
    """The hidden truth of a blind set."""

    recipe: Recipe
    effects: Values  # by listed effect, the true value of every parameter
    #: The effect at a place: "kind", location along the backbone ("start", "end" [m], "bay" from 1), and its size.
    off_list: dict[str, Any]
    noise_free: list[float]  # readings without noise, in their order
    declared_off: float  # root mean square of the declared model's misfit, without noise, over sigma [1]
    detectable: bool  # whether that is at least `DETECTABLE`
    substeps: int  # of every load step of the true robot
    robot: str

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
    """One set from one series of random numbers. The order of the draws fixes what a seed gives."""
    declared, branches = _draw_declared(recipe, rng)
    plan = _draw_measurement(recipe, declared, rng)
    declared = replace(declared, observation=Observation(markers=plan.arc_lengths))
    coarse = min(2, substeps)
    base = _solve(declared, Extras(), plan.arc_lengths, coarse)
    start = read(base, declared, plan.marks)
    values = draw_values(recipe, declared, base, rng)
    unlisted = draw_unlisted(recipe, declared, rng)

    def readings(values: Values, substeps: int) -> Array:
        listed = with_effects(declared, values)
        setup = replace(listed, robot=unlisted.change(listed.robot))
        return read(_solve(setup, unlisted.extras, plan.arc_lengths, substeps), setup, plan.marks)

    def misfit(exact: Array) -> float:
        return float(np.sqrt(np.mean(((exact - start) / plan.sigma) ** 2)))

    if values:
        values = detectable(recipe, declared, values, lambda v: misfit(readings(v, coarse)))
    exact = readings(values, substeps)
    declared_off = misfit(exact) if recipe.effects else 0.0
    data = MeasuredData(
        f"seed {recipe.seed}",
        declared.robot,
        declared.model,
        tuple(range(1, len(declared.steps) + 1)),
        declared.steps,
        branches,
        measured(plan.marks, exact, plan.sigma, rng),
    )
    answer = Answer(
        recipe=recipe,
        effects=values,
        off_list=unlisted.answer,
        noise_free=[float(x) for x in exact],
        declared_off=declared_off,
        detectable=declared_off >= DETECTABLE,
        substeps=substeps,
        robot=declared.robot.name,
    )
    return data, answer


def _draw_declared(recipe: Recipe, rng: np.random.Generator) -> tuple[Experiment, tuple[str, ...]]:
    """The declared robot with its loading sequence, and the branches of the steps."""
    robot = draw_robot(recipe.robot, rng)
    if "pretension" in recipe.listed:
        # Tendons that stretch by a fifth of the largest displacement at the tension that bends the robot by 1 rad.
        largest = {d: min(largest_commands(robot, d, 1.0).values()) for d in DRIVES}
        stiffness = 5.0 * robot.backbone.length * largest["tension"] / largest["displacement"]
        robot = robot.with_tendons(axial_stiffness=float(f"{stiffness:.3g}"))
    timed = bool({"creep", "time_lag"} & set(recipe.effects)) or rng.random() < 0.2
    steps, branches = draw_loading(robot, recipe.drive, timed, rng)
    model = Model(gravity=_draw_gravity(recipe, rng), elements_per_bay=2)
    return Experiment(robot, model, steps), branches


def _draw_gravity(recipe: Recipe, rng: np.random.Generator) -> tuple[float, float, float]:
    """Declared gravity: zero in most sets, across the robot where a payload is hidden [m/s^2]."""
    payload = "tip_payload" in recipe.effects
    if not (payload or ("gravity" not in recipe.effects and rng.random() < 0.2)):
        return 0.0, 0.0, 0.0
    directions = ((0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
    drawn = directions[rng.integers(0, 4)]
    x, y, z = (0.0, 1.0, 0.0) if payload else drawn
    return 9.81 * x, 9.81 * y, 9.81 * z


@dataclass(frozen=True)
class _Measurement:
    """What is measured in a set, where, and how accurately.

    Attributes
    ----------
    arc_lengths : tuple of float
        Of the markers [m].
    marks : list of Mark
        Every reading.
    sigma : ndarray
        Its standard deviation [m, rad, N].
    """

    arc_lengths: tuple[float, ...]
    marks: list[Mark]
    sigma: Array


def _draw_measurement(recipe: Recipe, declared: Experiment, rng: np.random.Generator) -> _Measurement:
    """Positions at about five markers and the bending angle in every step; in some sets tendon readings as well."""
    arc_lengths = draw_markers(declared.robot, rng)
    tendon_quantities = []
    if recipe.drive == "tension" and rng.random() < 0.5:
        tendon_quantities.append("tendon_displacement")
    if rng.random() < 0.2:
        tendon_quantities.append("distal_tension")
    marks = planned_readings(declared, arc_lengths, tendon_quantities)
    by_unit = {"m": recipe.sigma, "rad": recipe.sigma / 0.06, "N": 5e-3}
    sigma = [5e-5 if m[1] == "tendon_displacement" else by_unit[channel(m[1]).unit] for m in marks]
    return _Measurement(arc_lengths, marks, np.array(sigma))


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
