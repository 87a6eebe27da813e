"""The forward model: simulates many experiments at a time, on several processes, each once."""

from __future__ import annotations

import hashlib
import math
import pickle
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import replace
from types import TracebackType
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from tdcr_fe.effects import Experiment
from tdcr_fe.identify.run import Run
from tdcr_fe.identify.simulate_run import Task, run_settings, simulate_experiment
from tdcr_fe.io.processes import worker_pool
from tdcr_fe.model.settings import SolverSettings

if TYPE_CHECKING:
    from tdcr_fe.solve.sensitivities.parameters import Parameter

Given = TypeVar("Given")
Found = TypeVar("Found")

#: Runs kept in memory, with their paths: those without a reference path, which alone are asked for again.
CACHE = 24


class Job(NamedTuple):
    """One simulation asked for.

    Attributes
    ----------
    experiment : Experiment
    reference : Run or None
        A neighbouring run with its trajectory, used as reference path.
    record : bool
        Record the trajectory.
    parameters : tuple of Parameter
        By which the run is differentiated.
    """

    experiment: Experiment
    reference: Run | None = None
    record: bool = False
    parameters: tuple[Parameter, ...] = ()

    def task(self, settings: SolverSettings, deadline: float) -> Task:
        """What the process is given."""
        trajectory = None if self.reference is None else self.reference.trajectory
        return Task(self.experiment, settings, trajectory, self.record, self.parameters, deadline)


class ForwardModel:
    """Simulates experiments, each once, several at a time. Use as a context manager; leaving it ends the workers.

    Parameters
    ----------
    processes
        Worker processes; 1 stays in this one.
    settings
        The ``[solver]`` table of the declared model, see `tdcr_fe.identify.simulate_run.run_settings`.

    Attributes
    ----------
    runs, iterations : int
        Made so far, those of the processes included: the runs, and their Newton iterations. Decisions about what is
        affordable count these: time depends on what else the machine does.
    """

    def __init__(self, processes: int = 1, settings: SolverSettings | None = None) -> None:
        self.processes = max(1, processes)
        self.settings = settings or SolverSettings()
        self.runs = self.iterations = 0
        self._cache: dict[str, Run] = {}
        self._pool: ProcessPoolExecutor | None = None
        self._stack = ExitStack()

    def __enter__(self) -> ForwardModel:
        if self.processes > 1:
            self._pool = self._stack.enter_context(worker_pool(self.processes))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._pool = None
        self._stack.__exit__(kind, error, traceback)

    def run(
        self,
        experiments: Sequence[Experiment],
        path_tolerance: float,
        reference: Run | None = None,
        record: bool = False,
        deadline: float = math.inf,
    ) -> list[Run]:
        """Simulate experiments, those that were simulated before from memory.

        Parameters
        ----------
        experiments
            What to simulate; experiments that differ in the observation only share a run.
        path_tolerance
            Of the solver, where the declared settings leave it to the identification. Not part of a run's key: it grows
            once, and earlier, more accurate runs remain valid.
        reference
            A neighbouring run with its trajectory, used as reference path; three times as fast, for sensitivities.
        record
            Record trajectories.
        deadline
            Reading of `tdcr_fe.identify.time_limit.clock` at which simulations end [s].

        Raises
        ------
        OutOfTime
            The deadline has passed.
        """
        return self.run_jobs([Job(e, reference, record) for e in experiments], path_tolerance, deadline)

    def run_jobs(self, jobs: Sequence[Job], path_tolerance: float, deadline: float = math.inf) -> list[Run]:
        """Simulate jobs at a time; those without derivatives and reference that were simulated before from memory.

        Parameters
        ----------
        jobs
            What to simulate.
        path_tolerance, deadline
            See `run`.

        Raises
        ------
        OutOfTime
            The deadline has passed.
        """
        keys = []
        for job in jobs:
            key = _key(job.experiment, job.record)
            if not job.record:  # a recorded run can be used too
                recorded = _key(job.experiment, True)
                key = recorded if recorded in self._cache else key
            keys.append(key)
        todo: dict[int | str, Job] = {}
        for number, (key, job) in enumerate(zip(keys, jobs, strict=True)):
            if job.parameters or job.reference is not None:
                todo[number] = job
            elif key not in self._cache:
                todo[key] = job
        settings = run_settings(self.settings, path_tolerance)
        runs = self.map(simulate_experiment, [job.task(settings, deadline) for job in todo.values()])
        self.runs += len(runs)
        self.iterations += sum(r.iterations for r in runs)
        made = dict(zip(todo, runs, strict=True))
        found: list[Run] = []
        for number, (key, job) in enumerate(zip(keys, jobs, strict=True)):
            run = made.get(number, made.get(key))
            if run is not None and job.reference is None:
                self._cache[key] = replace(run, derivatives=None)
            found.append(self._cache[key] if run is None else run)
        while len(self._cache) > CACHE:
            self._cache.pop(next(iter(self._cache)))
        return found

    @property
    def parallel(self) -> bool:
        """Whether there are several processes."""
        return self._pool is not None

    def alone(self) -> ForwardModel:
        """One without processes and memory, which can be sent to a process."""
        return ForwardModel(1, self.settings)

    def keep(self, experiment: Experiment, record: bool, run: Run) -> None:
        """Keep a run without a reference path that was made elsewhere."""
        self._cache[_key(experiment, record)] = replace(run, derivatives=None)

    def map(self, function: Callable[[Given], Found], given: Sequence[Given]) -> list[Found]:
        """Values of a function, in the processes where there are several values; in this one if the processes end."""
        if self._pool is None or len(given) < 2:
            return [function(x) for x in given]
        try:
            return list(self._pool.map(function, given))
        except BrokenProcessPool:
            self._pool = None
            return [function(x) for x in given]


def _key(experiment: Experiment, record: bool) -> str:
    text = pickle.dumps(
        (experiment.robot, experiment.model, experiment.steps, experiment.ends, experiment.restarts)
    )
    return f"{hashlib.sha256(text).hexdigest()} {record}"
