"""The forward model: simulates experiments, many at a time, on several processes."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from tdcr_fe.effects import Experiment
from tdcr_fe.identify.bay_state import bay_state
from tdcr_fe.identify.run import Run, RunDerivatives, Trajectory, mesh_nodes
from tdcr_fe.identify.settings import OutOfTime, clock, end_at, spend
from tdcr_fe.io.processes import worker_pool
from tdcr_fe.model.loading import SolverSettings
from tdcr_fe.model.results import SequenceResult

if TYPE_CHECKING:
    from tdcr_fe.solve.sensitivities.parameters import Parameter
    from tdcr_fe.solve.simulate import PathRecord

#: A load step is divided into so many parts at most: to resolve its friction path, or to follow a reference path.
DIVISIONS = 16


class Job(NamedTuple):
    """One simulation asked for."""

    experiment: Experiment
    reference: Trajectory | None = None  # of a neighbouring run, which this one follows: fast
    record: bool = False  # whether the run keeps its own path
    # by which the run is differentiated, see `tdcr_fe.solve.sensitivities.differences.tabulated`
    parameters: tuple[Parameter, ...] = ()
    curvatures: bool = True  # whether derivatives of the curvature rates are needed; else they are zero


def run_settings(declared: SolverSettings, path_tolerance: float) -> SolverSettings:
    """Settings of a run.

    Parameters
    ----------
    declared
        The ``[solver]`` table of ``model.toml``. What differs from the default there is used as it is, but for
        ``mesh_tolerance``: the identification refines its mesh against the noise.
    path_tolerance
        Chosen against the noise; used where the table has the default [1].
    """
    default = SolverSettings()
    chosen = {"path_tolerance": path_tolerance, "max_substeps": DIVISIONS}
    free = {name: x for name, x in chosen.items() if getattr(declared, name) == getattr(default, name)}
    return replace(declared, **free, mesh_tolerance=math.inf)  # type: ignore[arg-type]


def simulate_experiment(job: Job, settings: SolverSettings, deadline: float = math.inf) -> Run:
    """Simulate one experiment.

    Parameters
    ----------
    job
        What is simulated.
    settings
        See `run_settings`.
    deadline
        Reading of `tdcr_fe.identify.settings.clock` at which the simulation ends [s].

    Raises
    ------
    KeyboardInterrupt
        The simulation was interrupted.
    OutOfTime
        The deadline has passed.
    """
    experiment = job.experiment
    least = settings.min_substep if job.reference is None else max(settings.min_substep, 1.0 / DIVISIONS)
    path: PathRecord | None = [] if job.record else None
    try:
        result, refused = _differentiated(job, replace(settings, min_substep=least), deadline, path)
    except (ValueError, np.linalg.LinAlgError, IndexError) as error:
        # an impossible robot, or a reference path that does not fit
        if job.reference is not None:
            return simulate_experiment(job._replace(reference=None), settings, deadline)
        return Run.unsolved(str(error))
    # A run that cannot follow its reference path counts as not solved: it is too far away, and costly.
    if len(result.steps) < len(experiment.steps):
        return Run.unsolved(result.message)
    last = experiment.whole_steps
    commanded = [result.steps[j] for j in last]
    run = Run.of(commanded)
    derivatives = RunDerivatives.of(result.sensitivities, last, refused) if job.parameters else None
    trajectories = None if path is None else Trajectory(path, experiment.ends, run.s)
    return replace(
        run, bays=bay_state(experiment, commanded), derivatives=derivatives, trajectories=trajectories
    )


def solve_commanded_steps(
    experiment: Experiment, settings: SolverSettings, deadline: float, reference: Trajectory | None
) -> SequenceResult:
    """Simulate an experiment with all its results, those of a divided step at its end only.

    Parameters
    ----------
    experiment, settings
        What is simulated.
    deadline
        Reading of `tdcr_fe.identify.settings.clock` at which the simulation ends [s].
    reference
        Path of a run of this experiment, which is repeated; None: the simulation chooses its own substeps.

    Raises
    ------
    KeyboardInterrupt
        The simulation was interrupted.
    OutOfTime
        The deadline has passed.
    """
    try:
        result, _ = _differentiated(Job(experiment, reference), settings, deadline)
    except (IndexError, ValueError):  # the path does not have all steps, or is of another mesh
        result, _ = _differentiated(Job(experiment), settings, deadline)
    solved = len(result.steps)
    return replace(result, steps=tuple(result.steps[j] for j in experiment.whole_steps if j < solved))


def _differentiated(
    job: Job, settings: SolverSettings, deadline: float, path: PathRecord | None = None
) -> tuple[SequenceResult, dict[str, str]]:
    """The simulation of one loading sequence with all derivatives that there are; and why there are no others.

    ``path``: where the path is recorded.
    """
    from tdcr_fe.solve.sensitivities.differences import NoDerivative
    from tdcr_fe.solve.simulate import simulate

    experiment, refused = job.experiment, dict[str, str]()
    meshed = None if job.reference is None else job.reference.on_mesh(mesh_nodes(experiment))
    along = None if meshed is None else meshed.divided(experiment.ends)
    given = experiment.robot, experiment.model, experiment.steps, settings, partial(end_at, deadline)
    while True:
        chosen = [p for p in job.parameters if p.name not in refused]
        try:
            asked: dict[str, Any] = {"sensitivities": chosen, "curvatures": job.curvatures}
            asked["restarts"] = experiment.first_steps
            return simulate(*given, reference_path=along, record_path=path, **asked), refused
        except NoDerivative as error:
            refused[error.parameter] = error.reason


class ForwardModel(ExitStack):
    """Simulates experiments, several at a time. Use as a context manager; leaving it ends the workers.

    Parameters
    ----------
    processes
        Worker processes; 1 stays in this one.
    settings
        The ``[solver]`` table of the declared model, see `tdcr_fe.identify.forward.run_settings`.

    Attributes
    ----------
    runs : int
        Made so far, those of the processes included.
    """

    def __init__(self, processes: int = 1, settings: SolverSettings | None = None) -> None:
        super().__init__()
        self.processes = max(1, processes)
        self.settings = settings or SolverSettings()
        self.runs = 0
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> ForwardModel:
        if self.processes > 1:
            self._pool = self.enter_context(worker_pool(self.processes))
            self.callback(setattr, self, "_pool", None)  # left, it simulates in this process
        return self

    def run(self, jobs: Sequence[Job], path_tolerance: float, deadline: float = math.inf) -> list[Run]:
        """Simulate jobs, several at a time.

        Parameters
        ----------
        jobs
            What to simulate.
        path_tolerance
            Tolerance of the path of the solver, where the declared settings leave it to the identification [1].
        deadline
            Reading of `tdcr_fe.identify.settings.clock` at which simulations end [s].

        Raises
        ------
        OutOfTime
            The deadline has passed.
        """
        settings = run_settings(self.settings, path_tolerance)
        self.runs += len(jobs)
        if self._pool is not None and len(jobs) > 1:
            # each has the same share of the time that is left
            timed = partial(_timed, settings=settings, left=(deadline - clock()) / len(jobs))
            try:
                found = list(self._pool.map(timed, jobs))
            except BrokenProcessPool:
                self._pool = None
            else:
                spend(sum(seconds for _, seconds in found))
                runs = [run for run, _ in found if run is not None]
                if len(runs) < len(jobs):
                    raise OutOfTime
                return runs
        return [simulate_experiment(job, settings, deadline) for job in jobs]


def _timed(job: Job, settings: SolverSettings, left: float) -> tuple[Run | None, float]:
    """In a worker: a run, none where it takes longer than the time that is left; and the processor time it took [s]."""
    begun = clock()
    try:
        run = simulate_experiment(job, settings, begun + left)
    except OutOfTime:
        run = None
    return run, clock() - begun


Found = TypeVar("Found")
#: Work under way: yields jobs, is sent their runs, and returns what it has found.
Work = Generator[Sequence[Job], list[Run], Found]


def advance(work: Sequence[Work[Found]], simulate: Callable[[list[Job]], list[Run]]) -> list[Found]:
    """Advance several pieces of work to their ends together; what all of them ask for at a time is simulated at a time.

    Where the time is over, each is told so by `OutOfTime`.
    """
    found: dict[int, Found] = {}
    asked: dict[int, Sequence[Job]] = {}

    def go_on(number: int, step: Callable[[], Sequence[Job]]) -> None:
        try:
            asked[number] = step()
        except StopIteration as end:
            found[number] = end.value

    for number, one in enumerate(work):
        go_on(number, partial(next, one))
    while asked:
        now = dict(asked)
        asked.clear()
        try:
            runs = iter(simulate([job for jobs in now.values() for job in jobs]))
        except OutOfTime as end:
            for number in now:
                go_on(number, partial(work[number].throw, end))
            continue
        for number, jobs in now.items():
            go_on(number, partial(work[number].send, list(islice(runs, len(jobs)))))
    return [found[number] for number in range(len(work))]
