"""Control of the tip, sample by sample: `Tracker`.

From the estimated state, a bounded load step takes the tip to where it should be in the next sample. It is found by the
search of inverse statics, which follows stick and slip of every hole, so that friction is compensated where the model
has it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tdcr_fe.elements import Array
from tdcr_fe.elements.drives import TendonDrives
from tdcr_fe.estimate.description import Estimate, memory
from tdcr_fe.estimate.estimator import SUBSTEPS, Estimator
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.loading import Actuation, LoadStep
from tdcr_fe.model.targets import TensionLimits, TipTarget, tip_targets
from tdcr_fe.solve.inverse_statics.inverse import TOLERANCE
from tdcr_fe.solve.inverse_statics.target_search import (
    FIRST_RADIUS,
    Objective,
    TargetSearch,
    Trial,
    TrialSteps,
)
from tdcr_fe.solve.simulation import one_thread


@dataclass(frozen=True, eq=False)
class TrackedSample:
    """What is to be done in one sample.

    Attributes
    ----------
    command : LoadStep
        Inputs until the next sample, of the kinds that were measured: tensions, displacements or motor angles.
    estimate : Estimate
        State of the robot in this sample.
    error : float
        Distance of the tip from the target that is expected in the next sample [m].
    milliseconds : float
        Time that it took.
    message : str
        Empty, or why the command is that of the sample before.
    """

    command: LoadStep
    estimate: Estimate
    error: float
    milliseconds: float
    message: str = ""


class Tracker:
    """Inputs that move the tip along a path under unknown loads, one bounded step per sample.

    Parameters
    ----------
    estimator
        Estimates the robot's state. Whether friction is compensated depends on its model.
    limits
        Bounds of the tensions.
    largest_change
        Largest change of any tension from one sample to the next [N]. None is half of what bends the backbone by about
        1 rad.
    deadline
        Time from the beginning of a sample after which no further trial begins [s]. Without a trial that comes nearer
        to the target by then, the command of the sample before is kept.
    tolerance
        Tolerance of the error of the tip [m]; None is 0.1 % of the length. Where coming nearer by it would need much
        higher tensions, the tip stays away.

    Raises
    ------
    ValueError
        A number is not positive.
    """

    def __init__(
        self,
        estimator: Estimator,
        limits: TensionLimits,
        *,
        largest_change: float | None = None,
        deadline: float = math.inf,
        tolerance: float | None = None,
    ) -> None:
        given = {"largest_change": largest_change, "deadline": deadline, "tolerance": tolerance}
        for name, value in given.items():
            if value is not None and not value > 0.0:
                raise ValueError(f"Tracker: {name} = {value}; must be positive")
        robot = estimator.robot
        self.estimator, self.deadline = estimator, deadline
        self._bounds = limits.bounds(robot.tendon_names)
        self._length = robot.backbone.length
        self._scale = robot.backbone.EI / (self._length * robot.plate_radius)
        self._change = FIRST_RADIUS * self._scale if largest_change is None else largest_change
        self._tolerance = TOLERANCE if tolerance is None else tolerance / self._length
        self._trials: TrialSteps | None = None
        self._command: LoadStep | None = None
        self._time: float | None = None

    def step(
        self, measured: LoadStep, readings: Sequence[Reading], target: ArrayLike | TipTarget
    ) -> TrackedSample:
        """Estimate the state in a sample, and find the inputs until the next one.

        Parameters
        ----------
        measured, readings
            Inputs and readings of this sample, see `Estimator.step`.
        target
            Where the tip should be in the next sample: a position [m], of which coordinates may be None, or with a
            direction.

        Raises
        ------
        ValueError
            See `Estimator.step`; or there are several targets.
        """
        begun, (goal, *others) = time.perf_counter(), tip_targets(target)
        if others:
            raise ValueError(f"Tracker.step: {1 + len(others)} targets; must be one, that of the next sample")
        elapsed = 0.0 if self._time is None else (measured.time or 0.0) - self._time
        self._time = measured.time
        estimate = self.estimator.step(measured, readings)
        acting, message, error = estimate.result.actuation, estimate.message, np.nan
        if self._command is None:
            self._command = replace(measured, loads={}, time=None)
        if acting is not None and not message:
            found = self._nearest(goal, acting, begun + self.deadline)
            if found is None:
                message = "no load step towards the target was solved in time"
            else:
                (trial, error), kept = found, memory(self.estimator.inputs, elapsed)[0]
                self._command = self._inputs(trial, acting.drives, kept * estimate.input_errors)
        return TrackedSample(self._command, estimate, error, 1e3 * (time.perf_counter() - begun), message)

    def _nearest(self, target: TipTarget, acting: Actuation, until: float) -> tuple[Trial, float] | None:
        """The trial step from the estimated state that comes nearest in time, and its error [m]; None without any."""
        simulation, own = self.estimator.simulation, self.estimator.experiment
        # A new one also at other values of effects.
        if self._trials is None or self._trials.simulation is not simulation:
            loads = {name: load for step in own.steps for name, load in step.loads.items()}
            self._trials = TrialSteps(simulation, replace(own, steps=(LoadStep(loads=loads), LoadStep())))
        position, (lowest, highest) = simulation.position, self._bounds
        tensions = position.state.base_tension[0]
        near = (tensions - self._change, tensions + self._change)
        lower, upper = (np.clip(bound, *near).clip(lowest, highest) for bound in self._bounds)
        objective = Objective(
            target, self._length, self._tolerance, lower, upper, np.zeros_like(tensions), self._scale
        )
        self._trials.begin(acting)
        search = TargetSearch(self._trials, position.state, objective, deadline=until)
        with one_thread():
            found = search.run(np.clip(tensions, lower, upper), substeps=SUBSTEPS)
        simulation.return_to(position)
        late = search.count < 2 and time.perf_counter() > until
        return None if found is None or late else (found.trial, objective.errors(found.trial)[0])

    def _inputs(self, found: Trial, drives: TendonDrives, errors: Array) -> LoadStep:
        """What is to be commanded so that a trial comes about with these errors of the inputs."""
        values = np.where(drives.winds, found.displacements, found.tensions) / drives.scale - errors
        given: dict[str, Any] = {}
        for kind, name, value in zip(drives.kinds, self.estimator.robot.tendon_names, values, strict=True):
            given.setdefault(kind.inputs, {})[name] = float(value if kind.winds else max(value, 0.0))
        return LoadStep(**given)
