"""Blind sets with laws on no list: twelve recipes, simulated by the reference.

The declared robot lacks a moment (or a force) that depends on the state by a law: curvature, tension, position, time,
direction of the last command. The recipes were written before the search for laws, and know nothing of it.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Experiment
from tdcr_fe.io.measured import MeasuredData, write_measured
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.blind.declared import draw_loading, draw_robot
from tdcr_fe.validation.blind.readings import (
    attempts,
    draw_markers,
    measured,
    planned,
    read,
    sigmas,
    solved,
)
from tdcr_fe.validation.reference import Extras, ReferenceSettings
from tdcr_fe.validation.reference.rod import tendon_course
from tdcr_fe.validation.reference.settings import BackboneState, PointForce

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sizes:
    """Typical values in the solution of the declared robot, by which the strength of a law is chosen."""

    stiffness: float  # bending stiffness [N m^2]
    length: float  # [m]
    curvature: float  # largest [1/m]
    tension: float  # largest sum of tensions at the base [N]
    duration: float  # time of the last step [s]
    deflection: float  # largest displacement of the middle of the backbone [m]


#: Moments that the backbone carries besides its elasticity, shape (n, 2) [N m].
Law = Callable[[BackboneState, Robot, Sizes], Array]


@dataclass(frozen=True)
class LawRecipe:
    """One law that a blind set hides."""

    name: str
    seed: int
    #: Of factors and direction: the missing moment or force but for a number, as `identify` writes it.
    product: str
    law: (
        Law | None
    )  # None: a spring from the middle disk to ground that grows with the cube of the displacement
    robot: str = "parallel"
    friction: bool = False  # whether the tendons have friction in the holes
    timed: bool = False

    def extras(self, robot: Robot, sizes: Sizes) -> Extras:
        """What the true robot has besides the declared one."""
        law = self.law
        if law is not None:
            return Extras(bending=lambda b: law(b, robot, sizes))
        at = robot.disks.positions[len(robot.disks.positions) // 2]
        size = 0.45 * sizes.stiffness / at**3 / sizes.deflection**2
        across = np.array([1.0, 1.0, 0.0])
        return Extras(forces=(PointForce(at, lambda u: -size * float(across @ u**2) * across * u),))


def _stiffer(b: BackboneState, z: Sizes, share: float | Array) -> Array:
    """Moment of a bending stiffness that is larger by a share of it."""
    return np.asarray(z.stiffness * np.reshape(share, (-1, 1)) * b.strain[:, :2])


def _lag(b: BackboneState, robot: Robot, share: Array) -> Array:
    """Moment of the tendons, times a share, shape (1 or n, 1 or n_tendons)."""
    levers = tendon_course(robot, b.s).lever[:, :, 2, :2]
    return np.asarray(np.einsum("nt,ntk->nk", share * b.tension, levers))


def _bent(b: BackboneState, z: Sizes) -> Array:
    """Size of the curvature over its largest value."""
    return np.asarray(np.linalg.norm(b.strain[:, :2], axis=1) / z.curvature)


def _in_one_bay(b: BackboneState, robot: Robot) -> Array:
    """One in the bay at about two fifths of the length, zero elsewhere."""
    edges = [0.0, *robot.disks.positions]
    k = round(0.4 * len(robot.disks.positions))
    return ((b.s > edges[k]) & (b.s < edges[k + 1])).astype(float)


_X = np.array([1.0, 0.0])
#: The twelve recipes.
LAWS: tuple[LawRecipe, ...] = (
    LawRecipe("hardening", 501, "|kappa| kappa", lambda b, r, z: _stiffer(b, z, 0.3 * _bent(b, z))),
    LawRecipe("softening", 502, "|kappa| kappa", lambda b, r, z: _stiffer(b, z, -0.18 * _bent(b, z)), "helical"),
    LawRecipe("tension stiffening", 503, "T kappa",
              lambda b, r, z: _stiffer(b, z, 0.3 * b.tension.sum(axis=1) / z.tension)),
    LawRecipe("tapered", 504, "s kappa", lambda b, r, z: _stiffer(b, z, 0.35 * b.s / z.length), friction=True),
    LawRecipe("drift", 505, "t e_x",
              lambda b, r, z: np.tile(-0.12 * z.stiffness * z.curvature * b.time / z.duration * _X, (len(b.s), 1)),
              timed=True),
    LawRecipe("cubic spring", 506, "|u|^2 u", None),
    LawRecipe("lag of the moment", 507, "sum(sign_i m_Ti)", lambda b, r, z: _lag(b, r, -0.08 * b.direction)),
    LawRecipe("two stiffnesses", 508, "kappa_x e_x", lambda b, r, z: _stiffer(b, z, 0.3) * _X, "converging"),
    LawRecipe("lever that grows", 509, "s m_T", lambda b, r, z: _lag(b, r, 0.2 * b.s[:, None] / z.length), "points"),
    LawRecipe("curing", 510, "t kappa", lambda b, r, z: _stiffer(b, z, 0.35 * b.time / z.duration),
              friction=True, timed=True),
    LawRecipe("hardening in one bay", 511, "|kappa| kappa",
              lambda b, r, z: _stiffer(b, z, 1.5 * _in_one_bay(b, r) * _bent(b, z))),
    LawRecipe("hardening towards the tip", 512, "|kappa| s kappa",
              lambda b, r, z: _stiffer(b, z, 0.5 * b.s / z.length * _bent(b, z)), "helical"),
)  # fmt: skip


@dataclass(frozen=True)
class LawSet:
    """A blind set with a law."""

    recipe: LawRecipe
    data: MeasuredData
    exact: Array  # readings without noise, in their order
    declared_off: float  # root mean square of the declared model's misfit, without noise, over sigma [1]


def make_law_set(
    recipe: LawRecipe, folder: str | os.PathLike[str] | None = None, sigma: float = 1e-4
) -> LawSet:
    """Simulate one recipe; write it to a folder where one is given.

    Parameters
    ----------
    recipe
        One of `LAWS`.
    folder
        Of the measured data.
    sigma
        Standard deviation of the noise on positions [m].

    Raises
    ------
    NotMade
        No robot drawn from this seed can be solved with the law.
    """
    made = attempts(recipe.seed, lambda rng: _make(recipe, sigma, rng))
    if folder is not None:
        write_measured(made.data, folder)
    return made


def _make(recipe: LawRecipe, sigma: float, rng: np.random.Generator) -> LawSet:
    robot = draw_robot(recipe.robot, rng)
    if not recipe.friction:
        robot = robot.with_tendons(friction_coefficient=0.0)
    steps, branches = draw_loading(robot, "tension", recipe.timed, rng)
    model = Model(friction="per-hole" if recipe.friction else "none", elements_per_bay=2)
    declared = Experiment(robot, model, steps)
    markers = draw_markers(robot, rng)
    marks = planned(declared, markers)
    settings = ReferenceSettings(markers, substeps=8 if recipe.friction else 2, max_interval=0.05)
    base = solved(declared, settings)
    middle = [float(np.hypot(*s.positions[len(s.s) // 2][:2])) for s in base.steps]
    sizes = Sizes(
        robot.backbone.EI,
        robot.backbone.length,
        max(max(s.bending_angle for s in base.steps) / robot.backbone.length, 1e-9),
        max(float(np.sum(s.base_tensions)) for s in base.steps),
        max(s.time or 0.0 for s in steps),
        max(middle),
    )
    start = read(base, declared, marks)
    exact = read(solved(declared, settings, recipe.extras(robot, sizes)), declared, marks)
    noise = sigmas(marks, sigma)
    noisy = exact + noise * rng.standard_normal(len(exact))
    data = measured(recipe.name, declared, branches, (marks, noisy, noise))
    return LawSet(recipe, data, exact, float(np.sqrt(np.mean(((exact - start) / noise) ** 2))))
