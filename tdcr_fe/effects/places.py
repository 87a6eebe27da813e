"""Effects at one place of the robot: a soft bay, a spring to ground, a stuck hole, a kink.

Such an effect has a place and a size. `PlaceEffect.at` gives the effect at a fixed place, whose parameters are those of
the size alone: a search tries all `PlaceEffect.places` of a robot.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from tdcr_fe.effects.base import Bounds, Effect, ExcitationRange, Experiment, Kind, Parameter, Points, Values
from tdcr_fe.model.backbone import StiffnessPatch
from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.robot import Robot, SideSpring, TightHole

#: Drop of tension at a hole that holds its tendon fast, over the largest commanded tension [1].
HOLDS_FAST = 4.0

#: Place of an effect: names of its parameters and their values.
Place = Mapping[str, float]


def bays(robot: Robot) -> list[tuple[float, float]]:
    """Arc lengths where every bay begins and ends, the stretch beyond the last disk included [m]."""
    return list(itertools.pairwise(robot.bay_edges.tolist()))


def bay_at(robot: Robot, s: float) -> tuple[float, float]:
    """The bay that contains an arc length [m].

    Raises
    ------
    ValueError
        It is not on the backbone.
    """
    for start, end in bays(robot):
        if start <= s <= end:
            return start, end
    raise ValueError(f"s = {s:g} m is not on the backbone, which spans 0 to {robot.backbone.length:g} m")


class PlaceEffect(Effect):
    """An effect at one place.

    Attributes
    ----------
    place_names : tuple of str
        Which of the parameters are the place.
    saturates : bool
        Whether a strong effect does far less than its derivative says, so that a search has to simulate it at
        `full_strength`.
    """

    place_names: tuple[str, ...] = ("s",)
    saturates: bool = False

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """None along the whole robot."""
        return ()

    def probe_points(self, experiment: Experiment, excitation: ExcitationRange) -> Points:
        """None: the place has no derivative at the null value. `at` has them."""
        return []

    def places(self, robot: Robot) -> list[Place]:
        """All places on a robot, from the base on."""
        raise NotImplementedError

    def spread(self, robot: Robot, place: Place) -> dict[str, float]:
        """Standard uncertainty of a place that is known to be the right one among `places` [m, 1].

        The distance of neighbouring disks over the square root of 12: that of a uniform distribution.
        """
        a, b = bay_at(robot, place["s"])
        return {"s": (b - a) / math.sqrt(12.0)}

    def full_strength(self, experiment: Experiment) -> dict[str, float]:
        """Values of the size at which an effect that saturates is strongest."""
        raise NotImplementedError

    def at(self, place: Place, among: int = 1) -> EffectAtPlace:
        """The effect at a fixed place, which is one of so many."""
        return EffectAtPlace(self, place, among)

    def size_probes(self, experiment: Experiment, place: Place) -> Points:
        """As `Effect.probe_points`, for the parameters of the size."""
        raise NotImplementedError


class EffectAtPlace(Effect):
    """An effect at a fixed place: its parameters are those of the size.

    Parameters
    ----------
    general
        The effect whose place is fixed.
    place, among
        Its place, and of how many that is one.

    Attributes
    ----------
    place : mapping of str to float
    """

    def __init__(self, general: PlaceEffect, place: Place, among: int) -> None:
        self.general, self.place, self.among = general, dict(place), among
        named = ", ".join(f"{name} = {value:.6g}" for name, value in place.items())
        self.name = f"{general.name} ({named})"
        self._like(general)
        tendon = f"tendon {place['tendon']:.0f}, " if "tendon" in place else ""
        self.kind = general.kind._replace(where=f"{tendon}s = {place['s']:.4g} m")
        self.parameters = tuple(p for p in general.parameters if p.name not in general.place_names)

    @property
    def listed(self) -> str:
        """See `Effect.listed`."""
        return self.general.name

    def bounds(self, experiment: Experiment) -> Bounds:
        """See `Effect.bounds`."""
        every = self.general.bounds(experiment)
        return {p.name: every[p.name] for p in self.parameters}

    def probe_points(self, experiment: Experiment, excitation: ExcitationRange) -> Points:
        """See `Effect.probe_points`."""
        return self.general.size_probes(experiment, self.place)

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        return self.general.apply(experiment, {**self.place, **values})


class BayEffect(PlaceEffect):
    """An effect in one bay; its place is the middle of the bay."""

    def places(self, robot: Robot) -> list[Place]:
        """The middles of all bays."""
        return [{"s": 0.5 * (a + b)} for a, b in bays(robot)]


class SoftBay(BayEffect):
    """One bay softer or stiffer in bending.

    The backbone bends more or less easily in one bay: a crack, damage, glue that ran.

    Distinguished by: bend the bare backbone and look at the bay closely.
    """

    name = "soft_bay"
    kind = Kind("stiffness", ("place",))
    parameters = (
        Parameter("s", "m", 0.0, 1e3, 0.0, 1e-3, "middle of the bay"),
        Parameter("factor", "1", 0.02, 50.0, 1.0, 0.2, "factor on the bending stiffness", inverse=True),
    )

    def size_probes(self, experiment: Experiment, place: Place) -> Points:
        """A fifth softer."""
        return [[{"factor": 0.8}]]

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        return _with_patch(experiment, values["s"], bending=values["factor"])


class Kink(BayEffect):
    """One bay bent when unloaded.

    The unloaded backbone is bent in one bay: it was bent too far there once, or glued askew.

    Distinguished by: measure the unloaded shape closely, with the robot turned about its axis.
    """

    name = "kink"
    kind = Kind("precurvature", ("place",))
    parameters = (
        Parameter("s", "m", 0.0, 1e3, 0.0, 1e-3, "middle of the bay"),
        Parameter("kappa_x", "1/m", -200.0, 200.0, 0.0, 0.5, "turning rate about the section's x axis"),
        Parameter("kappa_y", "1/m", -200.0, 200.0, 0.0, 0.5, "turning rate about the section's y axis"),
    )

    def size_probes(self, experiment: Experiment, place: Place) -> Points:
        """A hundredth of a radian about both axes."""
        a, b = bay_at(experiment.robot, place["s"])
        rate = 0.01 / (b - a)
        return [[{"kappa_x": rate, "kappa_y": 0.0}, {"kappa_x": 0.0, "kappa_y": rate}]]

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        return _with_patch(experiment, values["s"], precurvature=(values["kappa_x"], values["kappa_y"]))


def _with_patch(experiment: Experiment, s: float, **changes: Any) -> Experiment:
    """The experiment with a patch of the backbone over the bay at an arc length [m]."""
    patch = StiffnessPatch(*bay_at(experiment.robot, s), **changes)
    return experiment.with_backbone(patches=(*experiment.robot.backbone.patches, patch))


class SideSpringEffect(PlaceEffect):
    """A spring from one place of the backbone to ground.

    Something restrains the robot at one place: a cable, a hose, a compliant wall.

    Distinguished by: remove what touches the robot, or push it there by a known force.
    """

    name = "side_spring"
    kind = Kind("force", ("position",))
    parameters = (
        Parameter("s", "m", 0.0, 1e3, 0.0, 1e-3, "arc length"),
        Parameter("stiffness", "N/m", 0.0, 1e6, 0.0, 0.05, "sideways, at rest where the unloaded robot is"),
    )

    def places(self, robot: Robot) -> list[Place]:
        """All disks, and the tip."""
        return [{"s": b} for _, b in bays(robot)]

    def size_probes(self, experiment: Experiment, place: Place) -> Points:
        """A hundredth of the robot's own stiffness against a force there."""
        return [[{"stiffness": 0.03 * experiment.robot.backbone.EI / place["s"] ** 3}]]

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        length = experiment.robot.backbone.length
        if not 0.0 < values["s"] <= length + ARC_TOLERANCE:
            if values["stiffness"] == 0.0:
                return experiment
            raise ValueError(f"s = {values['s']:g} m; must be above 0 and at most {length:g} m")
        spring = SideSpring(values["s"], values["stiffness"])
        return experiment.with_robot(springs=(*experiment.robot.springs, spring))


class StuckHole(PlaceEffect):
    """A hole that holds its tendon fast, or takes much of its tension.

    One hole holds its tendon fast, or nearly so: glue, a knot, a burr, a strand that jams.

    Distinguished by: pull the tendon and watch it move on both sides of the hole.
    """

    name = "stuck_hole"
    kind = Kind("transmission", ("place",))
    needs_friction = True
    saturates = True
    place_names = ("tendon", "s")
    parameters = (
        Parameter("tendon", "1", 1.0, 1000.0, 1.0, 1.0, "number of the tendon, from 1"),
        Parameter("s", "m", 0.0, 1e3, 0.0, 1e-3, "arc length of the hole"),
        Parameter("drop", "N", 0.0, 1e4, 0.0, 0.01, "tension that it takes at most"),
    )

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """No hole, since there is none at the base. A hole that is named without a drop holds its tendon fast."""
        return {"tendon": 1.0, "s": 0.0, **self.full_strength(experiment)}

    def full_strength(self, experiment: Experiment) -> dict[str, float]:
        """A drop above all tensions, which holds the tendon fast."""
        return {"drop": HOLDS_FAST * _largest_tension(experiment)}

    def places(self, robot: Robot) -> list[Place]:
        """All holes between base plate and anchor."""
        return [
            {"tendon": float(i), "s": float(s)}
            for i, tendon in enumerate(robot.tendons, start=1)
            for s in robot.hole_arc_lengths(tendon)[1:-1]
        ]

    def spread(self, robot: Robot, place: Place) -> dict[str, float]:
        """The tendon is certain."""
        return {"tendon": 0.0, **super().spread(robot, place)}

    def size_probes(self, experiment: Experiment, place: Place) -> Points:
        """The largest tension that is commanded."""
        return [[{"drop": _largest_tension(experiment)}]]

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        if values["s"] == 0.0:
            return experiment
        robot = experiment.robot
        number = round(values["tendon"])
        if number > len(robot.tendons):
            raise ValueError(f"tendon = {number}; the robot has {len(robot.tendons)}")
        tendon = robot.tendons[number - 1]
        inner = robot.hole_arc_lengths(tendon)[1:-1]
        at = float(min(inner, key=lambda s: abs(s - values["s"]), default=math.nan))
        if not abs(at - values["s"]) <= 1e-4:
            near = f"the nearest is at {at:.6g} m" if len(inner) else "nor any between base plate and anchor"
            raise ValueError(f"s = {values['s']:g} m: tendon {tendon.name} has no hole there; {near}")
        holes = (*tendon.tight_holes, TightHole(at, values["drop"]))
        stuck = robot.with_tendons([tendon.name], tight_holes=holes)
        return replace(experiment, robot=stuck).with_friction()


def _largest_tension(experiment: Experiment) -> float:
    """Largest commanded tension; driven by displacement, that which bends the robot by two radians [N]."""
    if experiment.largest_tension > 0.0:
        return experiment.largest_tension
    robot = experiment.robot
    lever = min((float(np.hypot(*robot.holes(t).T).max()) for t in robot.tendons), default=1e-3)
    return 2.0 * robot.backbone.EI / (max(lever, 1e-6) * robot.backbone.length)
