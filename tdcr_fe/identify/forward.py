"""The forward model: simulates many experiments at a time, on several processes, each once."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from types import TracebackType

from tdcr_fe.effects import Experiment
from tdcr_fe.identify.run import Run, Task, run_settings, simulate_experiment
from tdcr_fe.io.processes import worker_pool
from tdcr_fe.model.settings import SolverSettings

#: Runs kept in memory.
CACHE = 400


class ForwardModel:
    """Simulates experiments, each once, several at a time. Use as a context manager; leaving it ends the workers.

    Parameters
    ----------
    processes
        Worker processes; 1 stays in this one.
    settings
        The ``[solver]`` table of the declared model, see `tdcr_fe.identify.run.run_settings`.
    """

    def __init__(self, processes: int = 1, settings: SolverSettings | None = None) -> None:
        self.processes = max(1, processes)
        self.settings = settings or SolverSettings()
        self.runs = 0
        self._cache: dict[str, Run] = {}
        self._references: dict[int, Run] = {}
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
        """
        kind = f"free{record}"
        if reference is not None:
            self._references[id(reference)] = reference  # while it is kept, its id is unique
            kind = f"reference{id(reference)}{record}"
        keys = [_key(s, kind) for s in experiments]
        if not record:  # a recorded run can be used too
            keys = [k[:-5] + "True" if k[:-5] + "True" in self._cache else k for k in keys]
        todo = {k: s for k, s in zip(keys, experiments, strict=True) if k not in self._cache}
        settings = run_settings(self.settings, path_tolerance)
        trajectory = None if reference is None else reference.trajectory
        tasks = [Task(s, settings, trajectory, record) for s in todo.values()]
        for key, run in zip(todo, self._map(tasks), strict=True):
            self._cache[key] = run
        self.runs += len(tasks)
        found = [self._cache[k] for k in keys]
        while len(self._cache) > CACHE:
            self._cache.pop(next(iter(self._cache)))
        return found

    def _map(self, tasks: list[Task]) -> list[Run]:
        if self._pool is None or len(tasks) < 2:
            return [simulate_experiment(t) for t in tasks]
        try:
            return list(self._pool.map(simulate_experiment, tasks))
        except BrokenProcessPool:
            self._pool = None
            return [simulate_experiment(t) for t in tasks]


def _key(experiment: Experiment, kind: str) -> str:
    text = pickle.dumps((experiment.robot, experiment.model, experiment.steps, experiment.ends))
    return hashlib.sha256(text).hexdigest() + kind
