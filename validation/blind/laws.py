"""Blind sets with laws on no list: twelve recipes, simulated by the reference.

The declared robot lacks a moment (or a force) that depends on the state by a law: curvature, tension, position, time,
direction of the last command. The recipes were written before the search for laws, and know nothing of it.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Experiment
from tdcr_fe.io.measured import MeasuredData, write_measured
from tdcr_fe.model.channels import channel
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.blind.declared import (
    draw_loading,
    draw_markers,
    draw_robot,
    measured,
    planned_readings,
    read,
)
from tdcr_fe.validation.reference import Extras, ReferenceSettings, solve_reference
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


@dataclass(frozen=True)
class LawRecipe:
    """One law that a blind set hides."""

    name: str
    seed: int
    product: (
        str  # of factors and direction: the missing moment or force but for a number, as `identify` writes it
    )
    law: Callable[[Robot, Sizes], Extras]  # from robot and sizes to the extras of the true robot
    robot: str = "parallel"
    friction: bool = False  # whether the tendons have friction in the holes
    timed: bool = False


def _bending(
    strength: float, scalar: Callable[[BackboneState, Robot, Sizes], Array]
) -> Callable[[Robot, Sizes], Extras]:
    """A moment along the curvature: ``m = -strength EI scalar kappa`` (a positive strength stiffens)."""

    def make(robot: Robot, sizes: Sizes) -> Extras:
        return Extras(
            bending=lambda b: strength * sizes.stiffness * scalar(b, robot, sizes)[:, None] * b.strain[:, :2]
        )

    return make


def _size(b: BackboneState) -> Array:
    return np.asarray(np.linalg.norm(b.strain[:, :2], axis=1))


def _levers(b: BackboneState, robot: Robot) -> Array:
    """Moment of a unit tension of every tendon about the section's axes [m], shape (n, n_tendons, 2)."""
    levers = np.zeros((len(b.s), len(robot.tendons), 2))
    for i, tendon in enumerate(robot.tendons):
        end = robot.end(tendon)
        x = tendon.routing.position(np.minimum(b.s, end), end)
        levers[:, i] = np.stack((-x[:, 1], x[:, 0]), axis=1)
    return levers


def _tendon_moment(
    strength: float, scalar: Callable[[BackboneState, Sizes], Array]
) -> Callable[[Robot, Sizes], Extras]:
    """A moment along that of the tendons: ``m = strength sum_i scalar_i T_i lever_i``."""

    def make(robot: Robot, sizes: Sizes) -> Extras:
        def carried(b: BackboneState) -> Array:
            weight = scalar(b, sizes) * b.tension
            return np.asarray(-strength * np.einsum("nt,ntk->nk", weight, _levers(b, robot)))

        return Extras(bending=carried)

    return make


def _drift(strength: float) -> Callable[[Robot, Sizes], Extras]:
    """A moment about the x axis that grows with time."""

    def make(robot: Robot, sizes: Sizes) -> Extras:
        size = strength * sizes.stiffness * sizes.curvature / sizes.duration

        def carried(b: BackboneState) -> Array:
            return np.asarray(np.stack((np.full(len(b.s), -size * b.time), np.zeros(len(b.s))), axis=1))

        return Extras(bending=carried)

    return make


def _about_x(strength: float) -> Callable[[Robot, Sizes], Extras]:
    """Another stiffness about the x axis than about y."""

    def make(robot: Robot, sizes: Sizes) -> Extras:
        return Extras(bending=lambda b: strength * sizes.stiffness * b.strain[:, :2] * np.array([1.0, 0.0]))

    return make


def _cubic_spring(strength: float) -> Callable[[Robot, Sizes], Extras]:
    """A spring from the middle disk to ground whose force grows with the third power of the displacement."""

    def make(robot: Robot, sizes: Sizes) -> Extras:
        at = robot.disks.positions[len(robot.disks.positions) // 2]
        size = strength * 3.0 * sizes.stiffness / at**3 / sizes.deflection**2

        def force(u: Array) -> Array:
            across = np.array([u[0], u[1], 0.0])
            return np.asarray(-size * float(across @ across) * across)

        return Extras(forces=(PointForce(at, force),))

    return make


def _in_one_bay(b: BackboneState, robot: Robot) -> Array:
    """One in the bay at about two fifths of the length, zero elsewhere."""
    edges = [0.0, *robot.disks.positions]
    k = round(0.4 * len(robot.disks.positions))
    return ((b.s > edges[k]) & (b.s < edges[k + 1])).astype(float)


#: The twelve recipes.
LAWS: tuple[LawRecipe, ...] = (
    LawRecipe("hardening", 501, "|kappa| kappa",
              _bending(0.30, lambda b, r, z: _size(b) / z.curvature)),
    LawRecipe("softening", 502, "|kappa| kappa",
              _bending(-0.18, lambda b, r, z: _size(b) / z.curvature), robot="helical"),
    LawRecipe("tension stiffening", 503, "T kappa",
              _bending(0.30, lambda b, r, z: b.tension.sum(axis=1) / z.tension), robot="parallel"),
    LawRecipe("tapered", 504, "s kappa",
              _bending(0.35, lambda b, r, z: b.s / z.length), robot="parallel", friction=True),
    LawRecipe("drift", 505, "t e_x", _drift(0.12), timed=True),
    LawRecipe("cubic spring", 506, "|u|^2 u",
              _cubic_spring(0.15)),
    LawRecipe("lag of the moment", 507, "sum(sign_i m_Ti)",
              _tendon_moment(-0.08, lambda b, z: b.direction[None, :])),
    LawRecipe("two stiffnesses", 508, "kappa_x e_x", _about_x(0.3),
              robot="converging"),
    LawRecipe("lever that grows", 509, "s m_T",
              _tendon_moment(0.2, lambda b, z: (b.s / z.length)[:, None]), robot="points"),
    LawRecipe("curing", 510, "t kappa",
              _bending(0.35, lambda b, r, z: np.full(len(b.s), b.time / z.duration)), timed=True,
              friction=True),
    LawRecipe("hardening in one bay", 511, "|kappa| kappa",
              _bending(1.5, lambda b, r, z: _in_one_bay(b, r) * _size(b) / z.curvature)),
    LawRecipe("hardening towards the tip", 512, "|kappa| s kappa",
              _bending(0.5, lambda b, r, z: b.s / z.length * _size(b) / z.curvature), robot="helical"),
)  # fmt: skip


@dataclass(frozen=True)
class LawSet:
    """A blind set with a law.

    Attributes
    ----------
    recipe : LawRecipe
    data : MeasuredData
    exact : ndarray
        Readings without noise, in their order.
    declared_off : float
        Root mean square of the declared model's misfit, without noise, over sigma [1].
    """

    recipe: LawRecipe
    data: MeasuredData
    exact: Array
    declared_off: float


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
    ValueError
        No robot drawn from this seed can be solved with the law.
    """
    reason = ""
    for attempt in range(4):
        rng = np.random.default_rng([recipe.seed, attempt])
        try:
            made = _made(recipe, sigma, rng)
        except ValueError as error:
            reason = str(error)
            continue
        if folder is not None:
            write_measured(made.data, folder)
        return made
    raise ValueError(f"{recipe.name}: {reason}")


def _made(recipe: LawRecipe, sigma: float, rng: np.random.Generator) -> LawSet:
    robot = draw_robot(recipe.robot, rng)
    if not recipe.friction:
        smooth = tuple(replace(t, friction_coefficient=0.0) for t in robot.tendons)
        robot = replace(robot, tendons=smooth)
    steps, branches = draw_loading(robot, "tension", recipe.timed, rng)
    model = Model(friction="per-hole" if recipe.friction else "none", elements_per_bay=2)
    declared = Experiment(robot, model, steps)
    arc_lengths = draw_markers(robot, rng)
    marks = planned_readings(declared, arc_lengths, [])
    settings = ReferenceSettings(
        sample_at=arc_lengths, substeps=8 if recipe.friction else 2, max_interval=0.05
    )

    def readings(extras: Extras) -> tuple[Array, Sizes]:
        result = solve_reference(robot, model, steps, settings=settings, extras=extras)
        if not result.converged:
            raise ValueError(result.message)
        if max(step.bending_angle for step in result.steps) > 2.8:
            raise ValueError("the tip turns back to the base")
        middle = [float(np.hypot(*s.positions[len(s.s) // 2][:2])) for s in result.steps]
        sizes = Sizes(
            robot.backbone.EI,
            robot.backbone.length,
            max(max(s.bending_angle for s in result.steps) / robot.backbone.length, 1e-9),
            max(float(np.sum(s.base_tensions)) for s in result.steps),
            max((s.time or 0.0 for s in steps), default=0.0),
            max(middle),
        )
        return read(result, declared, marks), sizes

    base, sizes = readings(Extras())
    exact, _ = readings(recipe.law(robot, sizes))
    noise = np.array([sigma if channel(q).unit == "m" else sigma / 0.06 for _, q, _ in marks])
    observed = measured(marks, exact, noise, rng)
    data = MeasuredData(recipe.name, robot, model, tuple(range(1, len(steps) + 1)), steps, branches, observed)
    return LawSet(recipe, data, exact, float(np.sqrt(np.mean(((exact - base) / noise) ** 2))))
