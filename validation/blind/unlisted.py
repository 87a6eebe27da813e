"""Blind sets with a cause beyond the list of effects: twenty recipes, simulated by the reference.

Each hides one small cause that no listed effect is: a moment or force that depends on the state, another stiffness,
holes elsewhere, inputs or readings that are off. They are written with user functions of the reference and changed
descriptions, and know nothing of the dictionary of `tdcr_fe.identify`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tdcr_fe.effects import Experiment
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.model.backbone import StiffnessPatch
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.results import SequenceResult
from tdcr_fe.model.routing import MisplacedRouting
from tdcr_fe.validation.blind.declared import draw_loading, draw_robot
from tdcr_fe.validation.blind.readings import (
    Mark,
    NotMade,
    attempts,
    draw_markers,
    measured,
    planned,
    read,
    sigmas,
    solved,
)
from tdcr_fe.validation.reference import Extras, HoleFriction, ReferenceSettings
from tdcr_fe.validation.reference.rod import tendon_course
from tdcr_fe.validation.reference.settings import Array, BackboneState, PointForce

#: The declared model is off by this many sigma, root mean square [1]; strengths are scaled until it is.
LEAST_OFF, MOST_OFF = 5.0, 60.0


class Declared(NamedTuple):
    """The declared robot, and sizes of its solution by which strengths are chosen."""

    experiment: Experiment
    stiffness: float  # bending stiffness [N m^2]
    length: float  # [m]
    curvature: float  # largest [1/m]
    tension: float  # largest sum of tensions at the base [N]
    duration: float  # time of the last step, or their number without times [s]
    deflection: float  # largest displacement of the middle of the backbone [m]

    @classmethod
    def of(cls, experiment: Experiment, solution: SequenceResult) -> Declared:
        """Sizes of a solution."""
        backbone, steps = experiment.robot.backbone, solution.steps
        middle = [float(np.hypot(*s.positions[len(s.s) // 2][:2])) for s in steps]
        return cls(
            experiment,
            backbone.EI,
            backbone.length,
            max(max(s.bending_angle for s in steps) / backbone.length, 1e-9),
            max(float(np.sum(s.base_tensions)) for s in steps),
            max(s.time or float(k) for k, s in enumerate(experiment.steps, start=1)),
            max(middle),
        )

    def stiffer(self, b: BackboneState, share: float | Array) -> Array:
        """Moment of a bending stiffness that is larger by a share of it."""
        return np.asarray(self.stiffness * np.reshape(share, (-1, 1)) * b.strain[:, :2])

    def bent(self, b: BackboneState, share: float) -> Array:
        """Moment about the sections' x axis that bends to a share of the largest curvature."""
        return np.tile(share * self.stiffness * self.curvature * _X, (len(b.s), 1))

    def pulled(self, b: BackboneState, share: Array) -> Array:
        """Moment of the tendons, times a share, shape (1 or n, 1 or n_tendons)."""
        levers = tendon_course(self.experiment.robot, b.s).lever[:, :, 2, :2]
        return np.asarray(np.einsum("nt,ntk->nk", share * b.tension, levers))

    def with_backbone(self, **changes: object) -> Truth:
        """A true robot with another backbone."""
        return Truth(self.experiment.with_backbone(**changes))

    def with_steps(self, change: Callable[[LoadStep, float], LoadStep]) -> Truth:
        """A true robot whose steps differ; progress of a step goes from near 0 to 1."""
        steps = self.experiment.steps
        changed = tuple(change(s, k / len(steps)) for k, s in enumerate(steps, start=1))
        return Truth(replace(self.experiment, steps=changed))


class Truth(NamedTuple):
    """The true robot."""

    experiment: Experiment
    extras: Extras = Extras()
    #: From step, quantity and location of a reading, and its progress, to what is added to it.
    reading: Callable[[Mark, float], float] | None = None


@dataclass(frozen=True)
class Recipe:
    """One cause that a blind set hides."""

    name: str
    # What is perturbed, and what that depends on, in the words of ``result.json``
    perturbs: str
    depends_on: str
    truth: Callable[[Declared, float], Truth]  # by strength, about 1
    robot: str = "parallel"
    friction: bool = False  # whether the tendons have friction in the holes
    # "time": steps have times; "row": the cause depends on the number of the row, steps have none
    clock: str = ""
    listed: str = ""  # the listed effect that is the cause, if there is one since


def _bent(b: BackboneState, d: Declared) -> Array:
    """Size of the curvature over its largest value."""
    return np.asarray(np.linalg.norm(b.strain[:, :2], axis=1) / d.curvature)


#: From sizes and strength, about 1.
Cause = Callable[[Declared, float], Truth]


def _law(law: Callable[[BackboneState, Declared, float], Array]) -> Cause:
    """A true robot whose backbone carries a moment besides its elasticity, shape (n, 2) [N m]."""
    return lambda d, x: Truth(d.experiment, Extras(bending=lambda b: law(b, d, x)))


def _force(middle: bool, force: Callable[[Array, Declared, float, float], Array]) -> Cause:
    """A true robot with a force on its middle or last disk, by displacement, sizes, strength and arc length."""

    def truth(d: Declared, x: float) -> Truth:
        disks = d.experiment.robot.disks.positions
        at = disks[len(disks) // 2 if middle else -1]
        return Truth(d.experiment, Extras(forces=(PointForce(at, lambda u: force(u, d, x, at)),)))

    return truth


def _attraction(u: Array, d: Declared, x: float, at: float) -> Array:
    away = np.array([-0.8, 0.5, -0.25]) * d.length - u
    return np.asarray(0.12 * x * d.stiffness * away / np.linalg.norm(away) ** 3)


def _harness(u: Array, d: Declared, x: float, at: float) -> Array:
    return np.asarray(0.5 * x * d.stiffness / d.length**3 * np.linalg.norm(u) * np.array([0.8, 0.6, 0.0]))


def _cubic(u: Array, d: Declared, x: float, at: float) -> Array:
    across = np.array([1.0, 1.0, 0.0])
    return np.asarray(-0.45 * x * d.stiffness / at**3 / d.deflection**2 * float(across @ u**2) * across * u)


def _halves(d: Declared, x: float) -> Truth:
    start = d.experiment.robot.bay_edges[len(d.experiment.robot.bay_edges) // 2]
    return d.with_backbone(patches=(StiffnessPatch(float(start), d.length, 1.0 / (1.0 + 0.25 * x)),))


def _tapered(d: Declared, x: float) -> Truth:
    radius = d.experiment.robot.backbone.radius
    base, tip = radius * (1.0 - 0.04 * x), radius * (1.0 + 0.07 * x)
    return d.with_backbone(radius=base, taper=((0.0, base), (d.length, tip)))


def _misplaced(**changes: float) -> Cause:
    """A true robot with one tendon whose holes are elsewhere, by so much for a strength of one."""

    def truth(d: Declared, x: float) -> Truth:
        tendons = d.experiment.robot.tendons
        moved = {name: ("factor" in name) + x * change for name, change in changes.items()}
        last = replace(tendons[-1], routing=MisplacedRouting(tendons[-1].routing, **moved))
        return Truth(d.experiment.with_robot(tendons=(*tendons[:-1], last)))

    return truth


def _rougher(d: Declared, x: float) -> Truth:
    robot = d.experiment.robot
    holes = []
    for tendon in robot.tendons:
        count = len(robot.hole_arc_lengths(tendon)) - 2
        mu = tendon.friction_coefficient
        holes += [HoleFriction(tendon.name, k, mu + 0.35 * x * k / count, 0.0) for k in range(1, count + 1)]
    return Truth(d.experiment, Extras(holes=tuple(holes)))


def _loaded(step: LoadStep, d: Declared, size: float) -> LoadStep:
    old = step.loads["tip"].force
    more = size * d.stiffness / d.length**2 * np.array([0.6, -0.8, 0.0])
    force = tuple(float(a + b) for a, b in zip(old, more, strict=True))
    return replace(step, loads={"tip": Load(d.length, force)})  # type: ignore[arg-type]


def _creeping_load(d: Declared, x: float) -> Truth:
    return d.with_steps(lambda step, progress: _loaded(step, d, 0.25 * x * progress))


def _saturated(d: Declared, x: float) -> Truth:
    def less(step: LoadStep, _: float) -> LoadStep:
        lost = min(0.25 * x, 0.9) / d.tension
        return replace(step, tensions={n: t * (1.0 - lost * t) for n, t in step.tensions.items()})

    return d.with_steps(less)


def _off_by_a_constant(d: Declared, x: float) -> Truth:
    name = d.experiment.robot.tendons[1].name

    def more(step: LoadStep, _: float) -> LoadStep:
        return replace(step, tensions={**step.tensions, name: step.tensions[name] + 0.06 * x * d.tension})

    return d.with_steps(more)


def _camera(d: Declared, x: float) -> Truth:
    way = {"x": 0.006, "y": -0.004, "z": 0.003}

    def shift(mark: Mark, progress: float) -> float:
        quantity = mark[1]
        return progress * x * d.length * way[quantity[-1]] if quantity.startswith("position_") else 0.0

    return Truth(d.experiment, reading=shift)


_X = np.array([1.0, 0.0])
#: The twenty recipes.
RECIPES: tuple[Recipe, ...] = (
    Recipe("hardening", "stiffness", "curvature",
           _law(lambda b, d, x: d.stiffer(b, 0.3 * x * _bent(b, d)))),
    Recipe("tension stiffening", "stiffness", "tension",
           _law(lambda b, d, x: d.stiffer(b, 0.3 * x * b.tension.sum(axis=1) / d.tension))),
    Recipe("drifting bend", "precurvature", "time",
           _law(lambda b, d, x: d.bent(b, -0.12 * x * b.time / d.duration)), clock="time"),
    Recipe("lag of the moment", "transmission", "direction of loading",
           _law(lambda b, d, x: d.pulled(b, -0.08 * x * b.direction))),
    Recipe("two stiffnesses", "stiffness", "direction of bending",
           _law(lambda b, d, x: d.stiffer(b, 0.3 * x) * _X), "converging"),
    Recipe("lever that grows", "routing", "place",
           _law(lambda b, d, x: d.pulled(b, 0.2 * x * b.s[:, None] / d.length)), "points"),
    Recipe("curing", "stiffness", "time",
           _law(lambda b, d, x: d.stiffer(b, 0.35 * x * b.time / d.duration)), friction=True, clock="time"),
    Recipe("stiffer with every row", "stiffness", "row",
           _law(lambda b, d, x: d.stiffer(b, 0.25 * x * b.time / d.duration)), clock="row"),
    Recipe("taper", "stiffness", "place", _tapered),
    Recipe("softer half", "stiffness", "place", _halves, friction=True),
    Recipe("tendon at another angle", "routing", "nothing", _misplaced(angle_base=-0.07, angle_end=-0.07),
           listed="misplaced_channels"),
    Recipe("tendon nearer to the axis at the tip", "routing", "place", _misplaced(factor_end=-0.15), friction=True),
    Recipe("attraction to a point", "force", "position", _force(False, _attraction)),
    Recipe("harness", "force", "position", _force(False, _harness), friction=True),
    Recipe("cubic spring", "force", "position", _force(True, _cubic)),
    Recipe("load that grows with every row", "force", "row", _creeping_load, clock="row"),
    Recipe("tensions that saturate", "input", "tension", _saturated),
    Recipe("one tension off by a constant", "input", "nothing", _off_by_a_constant, friction=True),
    Recipe("drift of the camera", "reading", "row", _camera, "helical", clock="row"),
    Recipe("holes rougher towards the tip", "transmission", "place", _rougher, friction=True),
)  # fmt: skip


@dataclass(frozen=True)
class UnlistedSet:
    """A blind set with a cause beyond the list."""

    recipe: Recipe
    data: MeasuredData
    exact: Array  # readings without noise, in their order
    declared_off: float  # root mean square of the declared model's misfit, without noise, over sigma [1]


def make_unlisted(recipe: Recipe, seed: int, sigma: float = 1e-4) -> UnlistedSet:
    """Simulate one recipe.

    Parameters
    ----------
    recipe
        One of `RECIPES`.
    seed
        Draws robot, loading sequence, markers and noise.
    sigma
        Standard deviation of the noise on positions [m].

    Raises
    ------
    NotMade
        No robot drawn from this seed can be solved with the cause.
    """
    return attempts(seed, lambda rng: _make(recipe, sigma, rng))


def _make(recipe: Recipe, sigma: float, rng: np.random.Generator) -> UnlistedSet:
    robot = draw_robot(recipe.robot, rng)
    if not recipe.friction:
        robot = robot.with_tendons(friction_coefficient=0.0)
    steps, branches = draw_loading(robot, "tension", recipe.clock == "time", rng)
    if recipe.clock == "row":  # the truth has times, which the data do not tell
        steps = tuple(replace(s, time=float(k)) for k, s in enumerate(steps, start=1))
    model = Model(friction="per-hole" if recipe.friction else "none", elements_per_bay=2)
    declared = Experiment(robot, model, steps)
    markers = draw_markers(robot, rng)
    marks = planned(declared, markers)
    settings = ReferenceSettings(markers, substeps=8 if recipe.friction else 2, max_interval=0.05)
    base = solved(declared, settings)
    start, noise = read(base, declared, marks), sigmas(marks, sigma)
    sizes, strength = Declared.of(declared, base), 1.0
    for _ in range(4):
        truth = recipe.truth(sizes, strength)
        exact = read(solved(truth.experiment, settings, truth.extras), truth.experiment, marks)
        if truth.reading is not None:
            exact = exact + [truth.reading(mark, (mark[0] + 1) / len(steps)) for mark in marks]
        off = float(np.sqrt(np.mean(((exact - start) / noise) ** 2)))
        if LEAST_OFF <= off <= MOST_OFF:
            break
        strength *= 0.5 * (LEAST_OFF + MOST_OFF) / off
    else:
        raise NotMade(f"{recipe.name}: the declared model is off by {off:.3g} sigma")
    if recipe.clock == "row":
        declared = replace(declared, steps=tuple(replace(s, time=None) for s in steps))
    noisy = exact + noise * rng.standard_normal(len(exact))
    data = measured(recipe.name, declared, branches, (marks, noisy, noise))
    return UnlistedSet(recipe, data, exact, off)
