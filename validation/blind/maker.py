"""Make one blind set with the reference: a folder of measured data, and the answer in a separate file."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tdcr_fe.effects import Experiment, Observation, with_effects
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.model.loading import Model
from tdcr_fe.validation.blind.declared import draw_loading, draw_robot, largest_commands
from tdcr_fe.validation.blind.hidden import Values, detectable, draw_values
from tdcr_fe.validation.blind.readings import attempts, draw_markers, measured, planned, read, sigmas, solved
from tdcr_fe.validation.blind.recipes import DRIVES, Recipe
from tdcr_fe.validation.measured_folder import write_measured
from tdcr_fe.validation.reference import ReferenceSettings
from tdcr_fe.validation.reference.settings import Array

#: Substeps of every load step of the true robot, to resolve path dependence.
SUBSTEPS = 16


@dataclass(frozen=True)
class Answer:
    """The hidden truth of a blind set."""

    recipe: Recipe
    effects: Values  # by effect, the true value of every parameter
    noise_free: list[float]  # readings without noise, in their order
    declared_off: float  # root mean square of the declared model's misfit, without noise, over sigma [1]
    robot: str

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Answer:
        """From a file."""
        recipe = document["recipe"]
        return cls(**{**document, "recipe": Recipe(**{**recipe, "effects": tuple(recipe["effects"])})})


def make_blind(folder: str | os.PathLike[str], recipe: Recipe, substeps: int = SUBSTEPS) -> Answer:
    """Make one blind set.

    Parameters
    ----------
    folder
        Where robot, loading sequence and readings are written; the answer is not.
    recipe
        What to make.
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
    data, answer = attempts(recipe.seed, lambda rng: _make(recipe, rng, substeps))
    write_measured(data, folder)
    return answer


def _make(recipe: Recipe, rng: np.random.Generator, substeps: int) -> tuple[MeasuredData, Answer]:
    """One set from one series of random numbers. The order of the draws fixes what a seed gives."""
    declared, branches = _draw_declared(recipe, rng)
    markers = draw_markers(declared.robot, rng)
    of_tendons = ["tendon_displacement"] if recipe.drive == "tension" and rng.random() < 0.5 else []
    if rng.random() < 0.2:
        of_tendons.append("distal_tension")
    marks = planned(declared, markers, of_tendons)
    sigma = sigmas(marks, recipe.sigma)
    declared = replace(declared, observation=Observation(markers=markers))
    coarse = min(2, substeps)
    base = solved(declared, ReferenceSettings(markers, coarse))
    start = read(base, declared, marks)
    values = draw_values(recipe, declared, base, rng)

    def readings(values: Values, substeps: int) -> Array:
        setup = with_effects(declared, values)
        return read(solved(setup, ReferenceSettings(markers, substeps)), setup, marks)

    def misfit(exact: Array) -> float:
        return float(np.sqrt(np.mean(((exact - start) / sigma) ** 2)))

    if not recipe.at_a_place:
        values = detectable(recipe, declared, values, lambda v: misfit(readings(v, coarse)))
    exact = readings(values, substeps)
    noisy = exact + sigma * rng.standard_normal(len(exact))
    data = measured(f"seed {recipe.seed}", declared, branches, (marks, noisy, sigma))
    off = misfit(exact) if recipe.effects else 0.0
    return data, Answer(recipe, values, exact.tolist(), off, declared.robot.name)


def _draw_declared(recipe: Recipe, rng: np.random.Generator) -> tuple[Experiment, tuple[str, ...]]:
    """The declared robot with its loading sequence, and the branches of the steps."""
    robot = draw_robot(recipe.robot, rng)
    if "pretension" in recipe.effects:
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
