"""Recipes of blind sets: robot, hidden effects, noise; and a plan in which every kind occurs early."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tdcr_fe.effects import EFFECTS

Drive = Literal["tension", "displacement"]
DRIVES: tuple[Drive, ...] = ("tension", "displacement")

#: Kinds of robots: one tendon of any routing, three of one routing, two segments of three tendons each.
ROBOTS = ("single", "parallel", "helical", "converging", "points", "two-segment")

#: Effects at one place that `plan` has, and all of them.
PLANNED_PLACES = ("soft_bay", "side_spring", "stuck_hole")
PLACES = (*PLANNED_PLACES, "kink")

#: Effects detectable only in data driven by tension, and only in data driven by displacement.
BY_TENSION = ("actuator_loss", "idle_tension", "friction_coefficient", "hole_adhesion", "stuck_hole")
BY_DISPLACEMENT = ("actuator_backlash", "tendon_stretch", "pretension")

#: Effects of soft bodies, tried only where loads stretch the backbone noticeably, or where it has no disks: no robot
#: drawn here is so.
SOFT = ("modulus_scale", "density_scale", "nonlinear_material", "misplaced_channels")

#: Effects that `plan` leaves out, so that its sets stay those of version 0.1; `plan_of` has them.
LATER: tuple[str, ...] = ("time_lag", "idle_tension", "base_compliance", "pretension", *PLACES, *SOFT)

#: Pairs that occur together in real robots.
PAIRS = (
    ("gravity", "stiffness_scale"),
    ("actuator_loss", "precurvature"),
    ("friction_coefficient", "frame_misalignment"),
    ("precurvature", "stiffness_scale"),
    ("actuator_backlash", "precurvature"),
    ("gravity", "friction_coefficient"),
    ("marker_offset", "routing_twist"),
    ("superelastic", "actuator_loss"),
    ("creep", "frame_misalignment"),
    ("tendon_stretch", "gravity"),
)


@dataclass(frozen=True)
class Recipe:
    """How one blind set is made.

    Attributes
    ----------
    seed : int
        Of all random numbers.
    robot : str
        A member of `ROBOTS`.
    effects : tuple of str
        Names of the hidden effects.
    sigma : float
        Standard deviation of the noise on positions [m].
    drive : "tension" or "displacement"
    weak : bool
        Effects so weak that the misfit of the declared model is about two sigma.
    """

    seed: int
    robot: str = "parallel"
    effects: tuple[str, ...] = ()
    sigma: float = 1e-4
    drive: Drive = "tension"
    weak: bool = False

    def __post_init__(self) -> None:
        known = {e.name for e in EFFECTS}
        unknown = sorted(set(self.effects) - known)
        if unknown:
            raise ValueError(f"no effect {unknown[0]!r}; there are {', '.join(sorted(known))}")

    @property
    def kind(self) -> str:
        """Category of the set: "clean", "single", "pair", "place" or "weak"."""
        if self.weak:
            return "weak"
        if self.at_a_place:
            return "place"
        return ("clean", "single", "pair")[min(len(self.effects), 2)]

    @property
    def at_a_place(self) -> bool:
        """Whether an effect acts at one place."""
        return bool(set(self.effects) & set(PLACES))


def plan(count: int, seed: int = 0) -> list[Recipe]:
    """Recipes of a benchmark.

    Rounds of 28 sets, each with every listed effect but `LATER` alone once, four clean sets, three pairs, one of each
    effect at a place, and a weak one; half of the sets have a noise of 0.1 mm.

    Parameters
    ----------
    count
        Number of sets.
    seed
        Of the plan; set k of a plan does not depend on ``count``.
    """
    recipes: list[Recipe] = []
    number = 0
    while len(recipes) < count:
        rng = np.random.default_rng([seed, number])
        names = [e.name for e in EFFECTS if e.name not in LATER]
        rng.shuffle(names)
        entries: list[tuple[tuple[str, ...], bool]] = [((n,), False) for n in names]
        others: list[tuple[tuple[str, ...], bool]] = [((), False)] * 4
        others += [(PAIRS[(3 * number + k) % len(PAIRS)], False) for k in range(3)]
        others += [((n,), False) for n in PLANNED_PLACES]
        others.append(((names[0],), True))
        rng.shuffle(others)
        places = np.linspace(0, len(entries), len(others)).astype(int)
        for at, other in sorted(zip(places.tolist(), others, strict=True), key=lambda p: -p[0]):
            entries.insert(at, other)
        robots = [ROBOTS[k % len(ROBOTS)] for k in range(len(entries))]
        rng.shuffle(robots)
        for k, ((effects, weak), robot) in enumerate(zip(entries, robots, strict=True)):
            drive: Drive = "tension"
            if set(effects) & set(BY_DISPLACEMENT) or (
                not set(effects) & set(BY_TENSION)
                and rng.random() < (0.5 if "actuator_gain" in effects else 0.15)
            ):
                drive = "displacement"
            if robot == "two-segment" and drive == "displacement":
                robot = "parallel"
            noise = 1e-4 if rng.random() < 0.5 else float(np.exp(rng.uniform(np.log(5e-5), np.log(5e-4))))
            own = 10000 * (seed + 1) + 100 * number + k
            recipes.append(Recipe(own, robot, effects, round(noise, 6), drive, weak))
        number += 1
    return recipes[:count]


def plan_of(effects: Sequence[str], count: int, seed: int = 0) -> list[Recipe]:
    """Recipes of sets with one of certain effects each, in turn, with a noise of 0.1 mm.

    Parameters
    ----------
    effects
        Names.
    count
        Number of sets.
    seed
        Of the plan; set k of a plan does not depend on ``count``.
    """
    recipes = []
    for k in range(count):
        rng = np.random.default_rng([seed, k, 1])
        name = effects[k % len(effects)]
        drive: Drive = "displacement" if name in BY_DISPLACEMENT else "tension"
        robots = ROBOTS[:-1] if drive == "displacement" else ROBOTS
        recipes.append(Recipe(10000 * (seed + 1) + 5000 + k, str(rng.choice(robots)), (name,), 1e-4, drive))
    return recipes
