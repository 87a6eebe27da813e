"""A load step: how inputs and loads grow in it, its accepted substeps, the report on it, and its failure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.hysteresis import FrictionState
from tdcr_fe.scene.loads import PointLoad
from tdcr_fe.solve.equations.configuration import SolverState, StoredState, Target
from tdcr_fe.solve.equations.linearization import Linearization
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.friction_path.follow import FrictionPath
from tdcr_fe.solve.friction_path.response import Equilibrium, KnownStates
from tdcr_fe.solve.newton.newton import NewtonResult

#: Gives tension [N] or displacement [m] of every tendon at a load factor and a time [s].
InputRamp = Callable[[float, float], Array]


@dataclass(frozen=True, eq=False)
class LoadRamp:
    """Change of one concentrated load, six values: force [N] and moment [N m]."""

    item: PointLoad
    start: Array  # (6,): At the beginning of the load step
    end: Array  # (6,): At its end, as it is set in the scene

    @cached_property
    def changes(self) -> bool:
        """Whether it is another one at the end."""
        return bool((self.start != self.end).any())


@dataclass(frozen=True, eq=False)
class Ramp:
    """Change of inputs, loads and time in a load step."""

    inputs: tuple[InputRamp, ...]  # By robot, see `InputRamp`
    loads: tuple[LoadRamp, ...]
    start_time: float  # Time at the beginning of the load step [s]
    end_time: float  # Time at its end [s]
    before_increment: Callable[[float], None] | None = None  # Called with the time [s] before every solve
    user_loads: bool = False  # Whether user functions may change loads within the step
    user_inputs: bool = False  # Whether user functions set tendon inputs over time

    @classmethod
    def of(
        cls,
        system: SceneSystem,
        state: SolverState,
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
        end_time
            [s].
        before_increment, user_loads
            See `Ramp`.
        """
        inputs = tuple([_input_ramp(system, state, i) for i in range(len(system.robots))])
        given = zip(system.point_loads, state.loads, strict=True)
        loads = tuple([LoadRamp(item, before, item.value) for item, before in given])
        user_inputs = any(callable(robot.inputs) for robot in system.robots)
        return cls(inputs, loads, state.time, end_time, before_increment, user_loads, user_inputs)

    @property
    def nonlinear(self) -> bool:
        """Whether inputs or loads may be other than linear in the load factor."""
        return self.user_loads or self.user_inputs

    @property
    def loads_change(self) -> bool:
        """Whether any load changes in this load step, as far as known."""
        return self.user_loads or any(load.changes for load in self.loads)

    @property
    def several_change(self) -> bool:
        """Whether loads, or more than one input, change in this load step: slips may then reverse and return in it."""
        ends = (0.0, self.start_time), (1.0, self.end_time)
        start, end = (np.concatenate([ramp(*at) for ramp in self.inputs]) for at in ends)
        return self.loads_change or bool(np.count_nonzero(start != end) > 1)

    @property
    def changes_beyond_inputs(self) -> bool:
        """Whether anything but the tendons' inputs may change: loads, or what depends on time."""
        return self.loads_change or self.user_inputs or self.before_increment is not None

    def loads_at(self, load_factor: float) -> tuple[Array, ...]:
        """The concentrated loads at a load factor, shape (6,) each."""
        return tuple(_between(load.start, load.end, load_factor) for load in self.loads)

    def apply(self, system: SceneSystem, load_factor: float) -> Target:
        """Apply loads and time at a load factor in [0, 1] to the scene, and return the target."""
        time = self.start_time + load_factor * (self.end_time - self.start_time)
        system.mbs.systemData.SetTime(time)
        if self.before_increment is not None:
            self.before_increment(time)
        loads = self.loads_at(load_factor)
        for load, value in zip(self.loads, loads, strict=True):
            if load.changes or self.before_increment is not None:  # which may have set it
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
    start, driven = state.base_tension[i], robot.drives.winds
    if np.any(driven):
        prescribed = state.prescribed[i]
        if np.any(np.isnan(prescribed[driven])):
            # From tension to displacement: the ramp begins at the current displacement of the tendon.
            slip = system.forces(state, state.time)[i].field.base_slip
            prescribed = np.where(np.isnan(prescribed), slip, prescribed)
        start = np.where(driven, prescribed, start)
    goal = robot.input_values()
    return lambda load_factor, time: _between(start, goal, load_factor)


@dataclass(frozen=True)
class Increment:
    """End of a substep, as it is kept for other runs."""

    load_factor: float  # Fraction of the load step, in [0, 1] [1]
    state: StoredState  # The solved state
    judged: bool = False  # Whether the substep has passed the judges


class LocatedReversals(NamedTuple):
    """Slip reversals located in a substep, with which it was solved."""

    known: KnownStates  # The states through which the path was followed
    path: FrictionPath
    history: tuple[FrictionState, ...]  # By robot, what the mobilisations at the end count from


class SolvedSubstep(NamedTuple):
    """An accepted substep."""

    # Fraction of the load step at its end, in [0, 1] [1]; 0 where weight acts on a robot that was never loaded
    load_factor: float
    state: SolverState  # There
    history: tuple[FrictionState, ...]  # By robot, what the mobilisations there count from
    presliding_factor: float = 1.0  # Factor on the presliding distance that it needed [1]
    located: LocatedReversals | None = None

    @property
    def parts(self) -> int:
        """Number of substeps as which it counts: each state within it ends one."""
        return 1 if self.located is None else len(self.located.known.points) - 1


@dataclass(frozen=True, eq=False)
class SolvedPath:
    """A solved part of a load step."""

    state: SolverState  # State at its end
    load_factor: float = 0.0  # Load factor at its end, in [0, 1] [1]
    # By robot, forces in that state; empty if the scene was last evaluated in another state
    forces: tuple[TendonForces, ...] = ()
    # The last linearisation of the last substep; None if that substep needed no iteration
    linearization: Linearization | None = None
    increments: tuple[SolvedSubstep, ...] = ()
    iterations: int = 0  # Iterations of the accepted substeps
    rejected: int = 0  # Iterations of attempts that were not accepted
    residual: float = 0.0  # Relative residual at the end [1]
    snapped: bool = False  # Whether the robot jumped to another equilibrium
    # Estimated displacement of a node by what is not resolved of the path, over the length; of a whole load step 0
    # where it is within the tolerance [1]
    refinement_error: float = 0.0
    end: Equilibrium | None = None  # The state at its end with its linearisation, where friction needed it
    # Whether the state at its end is known to be unstable; this is examined in contact and with buckled bays
    unstable: bool = False

    @classmethod
    def of(cls, result: NewtonResult, substep: SolvedSubstep) -> SolvedPath:
        """A converged solve as one substep."""
        return cls(
            result.state,
            substep.load_factor,
            result.forces,
            result.linearization,
            (substep,),
            result.iterations,
            residual=result.residual,
            unstable=result.unstable,
        )

    @property
    def substeps(self) -> int:
        """Number of accepted substeps."""
        return sum(each.parts for each in self.increments)

    @property
    def iterations_total(self) -> int:
        """Iterations with those of attempts that were not accepted."""
        return self.iterations + self.rejected

    @property
    def presliding_factor(self) -> float:
        """Largest factor on the presliding distance that a substep needed [1]."""
        return max((each.presliding_factor for each in self.increments), default=1.0)

    def recorded(self) -> list[Increment]:
        """The ends of its substeps, for other runs."""
        return [Increment(each.load_factor, each.state.stored(), judged=True) for each in self.increments]

    def then(self, other: SolvedPath) -> SolvedPath:
        """Join another part that begins where this one ends."""
        return replace(
            other,
            increments=self.increments + other.increments,
            iterations=self.iterations + other.iterations,
            rejected=self.rejected + other.rejected,
            snapped=self.snapped or other.snapped,
            refinement_error=self.refinement_error + other.refinement_error,
        )


class Position(NamedTuple):
    """Where a load step begins, or ended: the solved state, and what is known there."""

    state: SolverState
    linearization: Linearization | None = None  # A linearisation near this state, for the first iteration
    end: Equilibrium | None = None  # The same state with an exact linearisation, for the search of reversals


@dataclass(frozen=True)
class LoadStepReport:
    """Report on a solved load step.

    Attributes
    ----------
    iterations : int
        Newton iterations of the accepted path.
    iterations_total : int
        With those of rejected attempts.
    substeps : int
        Substeps of the accepted path.
    residual : float
        Relative residual at the end [1].
    snapped : bool
        Whether the robot jumped to another equilibrium within the step.
    presliding_factor : float
        Largest factor on the presliding distance that a substep needed for the stick-slip iteration to converge [1].
    refinement_error : float
        Estimated displacement of a node by what is not resolved of the path, over the length, where it is beyond the
        tolerance; else 0 [1].
    unstable : bool
        Whether the equilibrium at its end is known to be unstable; this is examined in contact and with buckled bays.
    """

    iterations: int
    iterations_total: int
    substeps: int
    residual: float
    snapped: bool
    presliding_factor: float
    refinement_error: float
    unstable: bool = False

    @classmethod
    def of(cls, *paths: SolvedPath) -> LoadStepReport:
        """Report on a load step that was solved along a path; on the largest values where there are several."""
        return cls(*map(max, zip(*map(_REPORTED, paths), strict=True)))


#: The values of a solved path that a report has, in its order.
_REPORTED = attrgetter(*(each.name for each in fields(LoadStepReport)))


class StepFailed(Exception):
    """A load step could not be solved.

    Attributes
    ----------
    load_factor : float
        Load factor up to which the step was solved [1].
    residual : float
        Relative residual of the failed attempt [1].
    state : SolverState
        At `load_factor`.
    iterations : int
        Spent on the step.
    """

    def __init__(
        self, message: str, load_factor: float, residual: float, state: SolverState, iterations: int
    ) -> None:
        super().__init__(message)
        self.load_factor = load_factor
        self.residual = residual
        self.state = state
        self.iterations = iterations
