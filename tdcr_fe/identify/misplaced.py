"""Causes without a name in the course of the tendons: holes or disks that are elsewhere than declared."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from tdcr_fe.effects import Experiment, Parameter
from tdcr_fe.effects.base import Kind, Values
from tdcr_fe.identify.causes import Cause, Change, ChangedDescription, number
from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.routing import MisplacedRouting, PointsRouting

if TYPE_CHECKING:
    from tdcr_fe.identify.problem import FitProblem


def routings(problem: FitProblem) -> list[Cause]:
    """The holes of one tendon elsewhere: at another angle and distance, the same along the backbone or not."""
    ends, found = ("base", "end"), list[Cause]()
    numbers = (
        number("factor", "1", (0.3, 3.0), 1.0, 0.02),
        number("angle", "rad", (-1.5, 1.5), 0.0, 0.02),
    )
    along = tuple(
        replace(p, name=f"{p.name}_{end}", meaning=f"{p.meaning} at the {end}")
        for p in numbers
        for end in ends
    )
    for name in problem.experiment.robot.tendon_names:

        def moved(experiment: Experiment, values: Values, name: str = name) -> Experiment:
            if "angle" in values:
                values = {f"{n}_{end}": x for n, x in values.items() for end in ends}
            tendons = tuple(
                replace(t, routing=MisplacedRouting(t.routing, **values)) if t.name == name else t
                for t in experiment.robot.tendons
            )
            return experiment.with_robot(tendons=tendons)

        text = "the holes of a tendon are elsewhere, at another angle or distance"
        for suffix, depends, own in (("", "nothing", numbers), (" along s", "place", along)):
            kind = Kind("routing", (depends,), f"tendon {name}")
            found.append(ChangedDescription(f"routing of {name}{suffix}", kind, own, moved, text))
    return found


def single_disks(problem: FitProblem) -> list[Cause]:
    """One hole elsewhere; one disk turned and shifted in its plane, or slipped along the backbone."""
    robot, found = problem.experiment.robot, list[Cause]()
    offset = max(float(np.max(np.linalg.norm(robot.holes(t), axis=1))) for t in robot.tendons)
    plane = tuple(number(a, "m", (-offset, offset), 0.0, 0.02 * offset) for a in "xy")
    turn = number("angle", "rad", (-1.5, 1.5), 0.0, 0.02)
    edges = robot.bay_edges
    for k, s in enumerate(robot.disks.positions):
        where = f"disk at s = {s:.4g} m"
        through = [t.name for t in robot.tendons if s <= robot.end(t) + ARC_TOLERANCE]

        def moved(
            experiment: Experiment, values: Values, k: int = k, names: Sequence[str] = through
        ) -> Experiment:
            tendons, robot = [], experiment.robot
            c, d = math.cos(values.get("angle", 0.0)), math.sin(values.get("angle", 0.0))
            for t in robot.tendons:
                if t.name in names:
                    holes = robot.holes(t).copy()
                    holes[k + 1] = np.array([[c, -d], [d, c]]) @ holes[k + 1] + [values["x"], values["y"]]
                    at = tuple(map(float, robot.hole_arc_lengths(t)))
                    t = replace(t, routing=PointsRouting(at, tuple((float(x), float(y)) for x, y in holes)))
                tendons.append(t)
            return experiment.with_robot(tendons=tuple(tendons))

        def slipped(experiment: Experiment, values: Values, k: int = k) -> Experiment:
            positions = list(experiment.robot.disks.positions)
            positions[k] += values["along"]
            return replace(experiment, robot=experiment.robot.with_disks(positions=tuple(positions)))

        entries: list[tuple[str, tuple[Parameter, ...], Change, str, int]] = [
            (
                f"hole of {name}",
                plane,
                partial(moved, names=(name,)),
                f"a hole of tendon {name} is elsewhere",
                len(through),
            )
            for name in through
        ]
        if len(through) > 1:
            text = "a disk is turned about the backbone, or off its centre"
            entries.append(("disk turned", (turn, *plane), moved, text, 1))
        if not any(t.end for t in robot.tendons) and k < len(robot.disks.positions) - 1:
            room = 0.9 * float(min(edges[k + 1] - edges[k], edges[k + 2] - edges[k + 1]))
            # of second order: no small step shows it
            along = (number("along", "m", (-room, room), 0.0, 0.5 * room),)
            entries.append(("disk slipped", along, slipped, "a disk has slipped along the backbone", 1))
        kind = Kind("routing", ("place",), where)
        for name, numbers, change, text, choices in entries:
            price = math.log(choices * len(robot.disks.positions))
            found.append(ChangedDescription(f"{name} ({where})", kind, numbers, change, text, price))
            found[-1].exact_derivatives = change is not slipped  # the mesh changes
    return found
