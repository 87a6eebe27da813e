"""From what acts on a scene now to what was set: tendons, concentrated loads and time, ramped together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.hooks import PointLoadItem
from tdcr_fe.solve.state import SolverState, Target
from tdcr_fe.solve.system import SceneSystem

Array = NDArray[np.float64]
#: Gives tension [N] or displacement [m] of every tendon at a load factor and a time [s].
InputRamp = Callable[[float, float], Array]


@dataclass(frozen=True, eq=False)
class LoadRamp:
    """Change of one concentrated load, six values: force [N] and moment [N m].

    Attributes
    ----------
    item : PointLoadItem
    start, end : ndarray, shape (6,)
    """

    item: PointLoadItem
    start: Array
    end: Array

    def at(self, load_factor: float) -> Array:
        """The load at a load factor."""
        return _between(self.start, self.end, load_factor)


@dataclass(frozen=True, eq=False)
class Ramp:
    """What a load step does to a scene.

    Attributes
    ----------
    inputs : tuple of callable
        By robot, see `InputRamp`.
    loads : tuple of LoadRamp
    start_time, end_time : float
        [s].
    before_increment : callable or None
        Called with the time [s] before every solve.
    user_loads : bool
        Whether functions of the user may change loads on the way.
    """

    inputs: tuple[InputRamp, ...]
    loads: tuple[LoadRamp, ...]
    start_time: float
    end_time: float
    before_increment: Callable[[float], None] | None = None
    user_loads: bool = False

    @classmethod
    def of(
        cls,
        system: SceneSystem,
        state: SolverState,
        start_time: float,
        end_time: float,
        before_increment: Callable[[float], None] | None = None,
        user_loads: bool = False,
    ) -> Ramp:
        """From what acts in a state to what was set.

        Parameters
        ----------
        system
            The scene.
        state
            At the beginning.
        start_time, end_time
            [s].
        before_increment, user_loads
            See `Ramp`.
        """
        return cls(
            tuple(_input_ramp(system, state, i) for i in range(len(system.robots))),
            tuple(
                LoadRamp(item, before, item.value)
                for item, before in zip(system.hooks.point_loads, state.loads, strict=True)
            ),
            start_time,
            end_time,
            before_increment,
            user_loads,
        )

    @property
    def loads_change(self) -> bool:
        """Whether any load changes in this load step, as far as known."""
        return self.user_loads or any(bool((load.start != load.end).any()) for load in self.loads)

    def apply(self, system: SceneSystem, load_factor: float) -> Target:
        """Give the scene the loads and the time of a load factor in [0, 1], and say what acts then."""
        time = self.start_time + load_factor * (self.end_time - self.start_time)
        system.mbs.systemData.SetTime(time)
        if self.before_increment is not None:
            self.before_increment(time)
        loads = tuple(load.at(load_factor) for load in self.loads)
        for load, value in zip(self.loads, loads, strict=True):
            load.item.set(value[:3], value[3:])
        return Target(tuple(ramp(load_factor, time) for ramp in self.inputs), loads, time)

    def set_end(self) -> None:
        """Let the loads stand in the scene as they were set, however far they were solved."""
        for load in self.loads:
            load.item.set(load.end[:3], load.end[3:])


def _between(start: Array, end: Array, load_factor: float) -> Array:
    return end if load_factor == 1.0 else start + load_factor * (end - start)


def _input_ramp(system: SceneSystem, state: SolverState, i: int) -> InputRamp:
    """How the inputs of a robot change: linearly from those of a state, or as its own function of time says."""
    robot = system.robots[i]
    if callable(robot.inputs):
        return lambda load_factor, time: robot.input_values(time)
    start, driven = state.base_tension[i], robot.by_displacement
    if np.any(driven):
        prescribed = state.prescribed[i]
        if np.any(np.isnan(prescribed[driven])):
            # From tension to displacement: the ramp begins at what the tendon is pulled in.
            slip = system.forces(state, state.time)[i].field.base_slip
            prescribed = np.where(np.isnan(prescribed), slip, prescribed)
        start = np.where(driven, prescribed, start)
    goal = robot.input_values()
    return lambda load_factor, time: _between(start, goal, load_factor)
