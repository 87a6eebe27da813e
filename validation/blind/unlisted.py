"""Draw the effects at one place: a soft stretch of the backbone, a spring from the side, a stuck hole, a kink."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tdcr_fe.effects import Experiment
from tdcr_fe.model.backbone import StiffnessPatch
from tdcr_fe.validation.blind.recipes import PLACES, Recipe
from tdcr_fe.validation.reference import Extras, HoleFriction, Spring


@dataclass(frozen=True)
class Unlisted:
    """An unlisted effect, or none.

    Attributes
    ----------
    answer : dict
        "kind", location along the backbone ("start", "end" [m], "bay" from 1), and its size; empty where there is none.
    patches : tuple of StiffnessPatch
        Of the true backbone.
    extras : Extras
        Of the true robot.
    """

    answer: dict[str, Any]
    patches: tuple[StiffnessPatch, ...] = ()
    extras: Extras = field(default_factory=Extras)


def _soft_spot(declared: Experiment, edges: tuple[float, ...], rng: np.random.Generator) -> Unlisted:
    bay = int(rng.integers(1, max(2, round(0.7 * (len(edges) - 1))) + 1))
    factor = round(float(rng.uniform(0.3, 0.6)), 3)
    start, end = edges[bay - 1], edges[bay]
    answer = {"kind": "soft_spot", "bay": bay, "start": start, "end": end, "bending": factor}
    return Unlisted(answer, patches=(StiffnessPatch(start, end, factor, 1.0),))


def _side_spring(declared: Experiment, edges: tuple[float, ...], rng: np.random.Generator) -> Unlisted:
    bays = len(edges) - 1
    disk = int(rng.integers(round(0.35 * bays), round(0.65 * bays) + 1))
    at = edges[disk]
    stiffness = float(f"{rng.uniform(0.1, 0.5) * 3.0 * declared.robot.backbone.EI / at**3:.4g}")
    answer = {"kind": "side_spring", "bay": disk, "start": at, "end": at, "stiffness": stiffness}
    return Unlisted(answer, extras=Extras(springs=(Spring(at, (stiffness, stiffness, 0.0)),)))


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
    return Unlisted(answer, patches=(StiffnessPatch(start, end, 1.0, 1.0, (kappa[0], kappa[1])),))


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
