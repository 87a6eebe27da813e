"""A robot taken through load steps one at a time, each of which answers a change: inputs, a pull, or the friction."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.model.loading import Load, LoadStep, Model, SolverSettings, resolve
from tdcr_fe.model.results import SequenceResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.scene.mesh import elements_of_bays
from tdcr_fe.solve.load_steps.load_path import StepFailed
from tdcr_fe.solve.sensitivities.linear_response import local_response
from tdcr_fe.solve.simulation import Simulation, step_warnings

#: Stiffness of the spring between mouse and robot, over that of the robot where it is pulled [1].
SPRING = 4.0
#: Largest displacement of what is pulled in one load step, over the length of the robot [1].
LARGEST_MOVE = 0.2
#: The spring is in balance where its force is off by less than this part of that of a spring as long as the robot [1].
BALANCED = 1e-3
#: Places that can be pulled on a robot without disks.
PLACES_WITHOUT_DISKS = 10
#: Longest time for a load step [s]; what has begun by then is ended.
LONGEST_STEP = 2.0
#: Numerics of a picture: a path that is resolved to 0.1 % of the length, and a snap-through that is not approached in
#: ever smaller substeps, which takes up to half a minute.
SETTINGS = SolverSettings(path_tolerance=1e-3, min_substep=1.0 / 8.0, max_substeps=8)
#: The first load step of every sequence.
UNLOADED = LoadStep("unloaded")


@dataclass(frozen=True)
class Answer:
    """What became of a change.

    Attributes
    ----------
    result : SequenceResult
        Result of this load step alone.
    seconds : float
        Time that it took.
    message : str
        Why the change could not be made, or a warning; empty where there is nothing to say.
    settled : bool
        Whether a pull ends here; if not, the same pull asked for once more comes nearer to the balance of its spring.
    made : bool
        Whether the change was made; if not, the result is that of the change before.
    """

    result: SequenceResult
    seconds: float
    message: str = ""
    settled: bool = True
    made: bool = True


@dataclass
class _Sequence:
    """A loading sequence since the robot was unloaded."""

    simulation: Simulation
    acting: LoadStep = UNLOADED  # all that acts now
    steps: list[LoadStep] = field(default_factory=list)
    stiffness: dict[int, float] = field(default_factory=dict)  # of the springs by place [N/m]


class PlayedRobot:
    """One robot, and its loading sequence so far.

    The mesh is that of the model, or the first one of the automatic mesh; it is not refined, so that every load step
    takes the same short time.

    Parameters
    ----------
    robot, model
        Description.
    settings
        Numerics; None are those of a picture, `SETTINGS`.

    Attributes
    ----------
    places : tuple of float
        Arc lengths that can be pulled: disks and tip [m].
    model : Model
        With the mesh in use.
    last : Answer
        To the last change.

    Raises
    ------
    StepFailed
        The unloaded robot is not solved.
    """

    def __init__(self, robot: Robot, model: Model, settings: SolverSettings | None = None) -> None:
        self.robot, self.settings = robot, settings or SETTINGS
        length = robot.backbone.length
        disks = robot.disks.positions or np.linspace(0.0, length, PLACES_WITHOUT_DISKS + 1)[1:]
        inner = (float(s) for s in disks if s < length * (1.0 - 1e-9))
        self.places = (*inner, length)
        self._mesh = elements_of_bays(robot, model)
        self.model = replace(model, elements_per_bay=self._mesh)
        self._kind_of_friction = "per-hole" if model.friction == "none" else model.friction
        self._sequence = self._new_sequence()
        self.last = self._solved(UNLOADED)

    def restart(self) -> Answer:
        """Begin again with the robot as it is when nothing but gravity acts."""
        self._sequence = self._new_sequence()
        return self._take(UNLOADED)

    def _new_sequence(self) -> _Sequence:
        """One without load steps, with nodes at all places that can be pulled."""
        nodes = [LoadStep(loads={self._name(i): Load(s)}) for i, s in enumerate(self.places)]
        return _Sequence(Simulation(self.robot, self.model, resolve(self.robot, nodes), self.settings))

    @property
    def steps(self) -> list[LoadStep]:
        """The sequence since the robot was unloaded; `simulate` takes it to the same shapes."""
        return self._sequence.steps

    def switch_friction(self, friction: bool) -> Answer:
        """Reach all that acts now anew, in one load step from the unloaded robot, with friction or without.

        Where that fails, the robot stays where it was.
        """
        before = self.model, self._sequence, self.last
        acting = self._sequence.acting
        self.model = replace(self.model, friction=self._kind_of_friction if friction else "none")
        answers = (
            self.restart(),
            self._take(replace(acting, label=f"friction {'on' if friction else 'off'}")),
        )
        if not all(answer.made for answer in answers):
            self.model, self._sequence, self.last = before
            self.last = replace(self.last, message=answers[-1].message, made=False)
        return self.last

    def drive(self, tensions: Mapping[str, float], displacements: Mapping[str, float]) -> Answer:
        """Change tensions [N] or displacements [m] at the base, by tendon.

        Raises
        ------
        ValueError
            A tendon is unknown or given twice, or a value is not allowed.
        """
        return self._take(LoadStep("", tensions, displacements))

    def pull(self, place: int, to: tuple[float, float, float]) -> Answer:
        """Take the robot towards the balance with a spring of rest length zero, as far as one load step goes.

        The spring begins `SPRING` times as stiff as the robot was at this place when it was first pulled. One step of
        Newton's method on the balance of its force gives the load; it is one that `simulate` can repeat.

        Parameters
        ----------
        place
            Index into `places`, where the spring is fastened.
        to
            Where its other end is held [m].

        Raises
        ------
        ValueError
            There is no such place, or the other end is not at a finite point.
        """
        if not 0 <= place < len(self.places):
            raise ValueError(f"place {place}: must be from 0 to {len(self.places) - 1}")
        if not np.isfinite(to).all():
            raise ValueError(f"to {to}: must be three finite numbers [m]")
        length, s = self.robot.backbone.length, self.places[place]
        compliance = local_response(self._sequence.simulation, s).compliance[:3, :3]
        if place not in self._sequence.stiffness:
            self._sequence.stiffness[place] = SPRING / float(np.linalg.eigvalsh(compliance)[-1])
        stiffness, force = self._sequence.stiffness[place], self._force(place)
        unbalanced = stiffness * (np.asarray(to) - self.position(place)) - force
        change = np.linalg.solve(np.eye(3) + stiffness * compliance, unbalanced)
        move = float(np.linalg.norm(compliance @ change))
        change *= min(1.0, LARGEST_MOVE * length / max(move, 1e-300))
        fx, fy, fz = (float(x) for x in force + change)
        answer = self._take(LoadStep("", loads={self._name(place): Load(s, (fx, fy, fz))}))
        if not answer.made:
            return answer
        left = stiffness * (np.asarray(to) - self.position(place)) - self._force(place)
        # Where the robot snaps through under a force, the spring may have no balance that load steps can reach.
        nearer = BALANCED * stiffness * length < np.linalg.norm(left) < np.linalg.norm(unbalanced)
        return replace(answer, settled=not nearer)

    def let_go(self) -> Answer:
        """Remove all loads."""
        return self._take(
            LoadStep("let go", loads={k: Load(v.at) for k, v in self._sequence.acting.loads.items()})
        )

    def position(self, place: int) -> Array:
        """Where a place of the robot is [m], shape (3,)."""
        step = self.last.result.steps[-1]
        return np.asarray(step.positions[int(np.argmin(np.abs(step.s - self.places[place])))])

    @staticmethod
    def _name(place: int) -> str:
        return f"pull_{place + 1}"

    def _force(self, place: int) -> Array:
        """With which a place is pulled now [N], shape (3,)."""
        load = self._sequence.acting.loads.get(self._name(place))
        return np.zeros(3) if load is None else np.array(load.force)

    def _take(self, step: LoadStep) -> Answer:
        """Solve one load step; where that fails, the robot stays where it was."""
        begun, before = time.perf_counter(), self._sequence.simulation.position
        try:
            self.last = self._solved(step)
        except StepFailed as failure:
            self._sequence.simulation.return_to(before)
            message = f"This change was not made, since its load step was not solved: {failure}"
            self.last = replace(self.last, seconds=time.perf_counter() - begun, message=message, made=False)
        return self.last

    def _solved(self, step: LoadStep) -> Answer:
        """Solve one load step; the unloaded robot, without which there is none to show, has all the time it needs."""
        begun = time.perf_counter()
        acting = step.after(self._sequence.acting)
        (target,) = resolve(self.robot, [acting])
        deadline = math.inf if step is UNLOADED else begun + LONGEST_STEP
        report = self._sequence.simulation.advance(target, deadline=deadline)
        self._sequence.acting, number = acting, len(self.steps) + 1
        self.steps.append(step)
        solved = self._sequence.simulation.result(number, step.label, report, target)
        result = SequenceResult(self.robot, self.model, (solved,), elements_per_bay=self._mesh)
        return Answer(result, time.perf_counter() - begun, " ".join(step_warnings(number, report)))
