"""Searches for critical loads in the helical case: the simulated robot, the prototype, and a column as a check."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.paper.cases import MODELS, paper_case, prototype
from tdcr_fe.validation.paper.studies.critical import CriticalSearch, search_critical_load

#: Results by tension [N], direction of the load, and model or robot.
Searches = dict[tuple[float, str, str], CriticalSearch]

#: Loads of the search [N]; up to twice the paper's own.
SEARCH_LOADS = (0.01, 0.02, 0.04, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8, 1.2, 1.6)
#: Tensions of the search [N]; the simulation has 1.2 N, the prototype 5 to 30 N.
SEARCH_TENSIONS = (1.2, 5.0, 10.0, 20.0, 30.0)
#: Directions of the search.
SEARCH_DIRECTIONS = {"+x": (1, 0, 0), "+y": (0, 1, 0), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}
#: Those across the robot.
ACROSS = tuple(name for name in SEARCH_DIRECTIONS if name != "-z")


def _search(robot: Robot, model: Model, tension: float, direction: str) -> CriticalSearch:
    pull = LoadStep("pull", {robot.tendon_names[0]: tension})
    return search_critical_load(robot, model, [pull], SEARCH_DIRECTIONS[direction], SEARCH_LOADS)


def search_without_friction(report: Callable[[str], None]) -> Searches:
    """The robot of Fig. 5 without friction, in all directions."""
    robot, found = paper_case("fig5").robot, {}
    for tension in SEARCH_TENSIONS:
        for direction in SEARCH_DIRECTIONS:
            found[tension, direction, "discrete"] = _search(robot, MODELS["discrete"], tension, direction)
        report(f"helical, {tension:g} N, without friction")
    return found


def search_with_friction() -> Searches:
    """The robot of Fig. 5 with friction at each hole, across the robot."""
    robot, model = paper_case("fig5").robot, MODELS["per-hole"]
    return {
        (tension, direction, "per-hole"): _search(robot, model, tension, direction)
        for tension in SEARCH_TENSIONS
        for direction in ACROSS
    }


def search_prototype(
    robots: Mapping[str, Robot], tensions: Sequence[float] = SEARCH_TENSIONS[1:]
) -> Searches:
    """Robots of the experiments, by name, at their own tensions, with friction at each hole, across the robot."""
    return {
        (tension, direction, name): _search(robot, MODELS["per-hole"], tension, direction)
        for name, robot in robots.items()
        for tension in tensions
        for direction in ACROSS
    }


def declared_and_fitted(fitted: Robot) -> dict[str, Robot]:
    """The prototype of Table 3 as declared, and with the stiffness fitted to that table."""
    return {"as declared": prototype(3), "stiffness of Table 3": fitted}


def search_column() -> CriticalSearch:
    """Euler's column, the robot of Fig. 5 with its tendon slack: the search must find its critical load."""
    robot = paper_case("fig5").robot
    slack = LoadStep("slack", {robot.tendon_names[0]: 0.0})
    return search_critical_load(robot, MODELS["discrete"], [slack], (0, 0, -1), (0.02, 0.04, 0.06, 0.08))


def euler_load(robot: Robot) -> float:
    """Critical load of the backbone as a column clamped at the base, ``pi^2 EI / (4 L^2)`` [N]."""
    return float(np.pi**2 * robot.backbone.EI / (4.0 * robot.backbone.length**2))
