"""Ramps of a load step: tendon inputs, concentrated loads and time from their current to their set values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.hooks import PointLoadItem
from tdcr_fe.solve.equations.state import SolverState, Target
from tdcr_fe.solve.equations.system import SceneSystem

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
    """Change of inputs, loads and time in a load step.

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
        Whether user functions may change loads within the step.
    user_inputs : bool
        Whether user functions set tendon inputs over time.
    """

    inputs: tuple[InputRamp, ...]
    loads: tuple[LoadRamp, ...]
    start_time: float
    end_time: float
    before_increment: Callable[[float], None] | None = None
    user_loads: bool = False
    user_inputs: bool = False

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
        """Ramp from the inputs and loads of a state to those that were set.

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
            any(callable(robot.inputs) for robot in system.robots),
        )

    @property
    def nonlinear(self) -> bool:
        """Whether inputs or loads may be other than linear in the load factor."""
        return self.user_loads or self.user_inputs

    @property
    def loads_change(self) -> bool:
        """Whether any load changes in this load step, as far as known."""
        return self.user_loads or any(bool((load.start != load.end).any()) for load in self.loads)

    @property
    def changes_beyond_inputs(self) -> bool:
        """Whether anything but the tendons' inputs may change: loads, or what depends on time."""
        return self.loads_change or self.user_inputs or self.before_increment is not None

    def apply(self, system: SceneSystem, load_factor: float) -> Target:
        """Apply loads and time at a load factor in [0, 1] to the scene, and return the target."""
        time = self.start_time + load_factor * (self.end_time - self.start_time)
        system.mbs.systemData.SetTime(time)
        if self.before_increment is not None:
            self.before_increment(time)
        loads = tuple(load.at(load_factor) for load in self.loads)
        for load, value in zip(self.loads, loads, strict=True):
            load.item.set(value[:3], value[3:])
        return Target(tuple(ramp(load_factor, time) for ramp in self.inputs), loads, time)

    def set_end(self) -> None:
        """Set the loads in the scene to their full values, whether or not the step was solved."""
        for load in self.loads:
            load.item.set(load.end[:3], load.end[3:])


def _between(start: Array, end: Array, load_factor: float) -> Array:
    return end if load_factor == 1.0 else start + load_factor * (end - start)


def _input_ramp(system: SceneSystem, state: SolverState, i: int) -> InputRamp:
    """Ramp of the inputs of a robot: linear from those of a state, or the user's function of time."""
    robot = system.robots[i]
    if callable(robot.inputs):
        return lambda load_factor, time: robot.input_values(time)
    start, driven = state.base_tension[i], robot.by_displacement
    if np.any(driven):
        prescribed = state.prescribed[i]
        if np.any(np.isnan(prescribed[driven])):
            # From tension to displacement: the ramp begins at the current displacement of the tendon.
            slip = system.forces(state, state.time)[i].field.base_slip
            prescribed = np.where(np.isnan(prescribed), slip, prescribed)
        start = np.where(driven, prescribed, start)
    goal = robot.input_values()
    return lambda load_factor, time: _between(start, goal, load_factor)
