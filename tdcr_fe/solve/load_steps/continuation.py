"""What a call of `SolveTDCR` leaves to the next one: the last state with its linearisation, as in `simulate`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.complementarity import ROUND_OFF
from tdcr_fe.elements.forces import ForceModel
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.load_steps.load_path import Position, SolvedPath

Array = NDArray[np.float64]

#: Key of the last solution in ``mbs.variables``.
KEY = "tdcr_fe.last_solution"


class LastSolution(NamedTuple):
    """The end of a solved load step, and the scene that it left."""

    positions: tuple[Position, ...]  # By system that was solved by itself
    scene: tuple[Array, ...]  # Everything that Exudyn keeps of it, see `_scene`
    models: tuple[ForceModel, ...]  # By robot


def remember(system: SceneSystem, paths: Sequence[SolvedPath]) -> None:
    """Keep the ends of paths for the next load step, after the scene was left there."""
    models = tuple(robot.model for robot in system.robots)
    positions = tuple([Position(path.state, path.linearization, path.end) for path in paths])
    system.mbs.variables[KEY] = LastSolution(positions, _scene(system), models)


def recall(system: SceneSystem, parts: Sequence[SceneSystem], time: float) -> list[Position]:
    """Where the next load step begins: with what the last one found, if nothing in the scene has changed since.

    Parameters
    ----------
    system
        The scene.
    parts
        What is solved by itself in it.
    time
        At which the load step begins [s].
    """
    last: Any = system.mbs.variables.get(KEY)
    if (
        not isinstance(last, LastSolution)
        or len(last.positions) != len(parts)
        or not _is_as_left(system, last)
    ):
        return [Position(part.current_state(time)) for part in parts]
    return [_at_time(position, time) for position in last.positions]


def _at_time(position: Position, time: float) -> Position:
    """The same at another time [s]."""
    friction = tuple(replace(each, time=time) for each in position.state.friction)
    return position._replace(state=position.state._replace(friction=friction, time=time))


def _is_as_left(system: SceneSystem, last: LastSolution) -> bool:
    """Whether a scene of robots alone is as it was left; what else may be in a scene could have changed unseen."""
    users = any(system.hooks.user_function(kind) for kind in ("PreNewtonResidual", "SystemJacobian"))
    if not system.layout.no_others or system.layout.user_loads or users or system.has_contact:
        return False
    if len(last.models) != len(system.robots) or any(
        robot.model is not model for robot, model in zip(system.robots, last.models, strict=True)
    ):
        return False
    return all(
        len(now) == len(before) and np.allclose(now, before, rtol=ROUND_OFF, atol=ROUND_OFF)
        for now, before in zip(_scene(system), last.scene, strict=True)
    )


def _scene(system: SceneSystem) -> tuple[Array, ...]:
    """State and the user's own loads of a scene."""
    mbs, data = system.mbs, system.mbs.systemData
    ramped = {int(number) for item in system.point_loads for number in item.numbers}
    loads = [
        np.atleast_1d(mbs.GetLoadParameter(i, "load" if "load" in load else "loadVector"))
        for i, load in ((i, mbs.GetLoad(i)) for i in range(data.NumberOfLoads()))
        if i not in ramped
    ]
    return *map(np.array, data.GetSystemState()), np.concatenate((np.zeros(0), *loads))
