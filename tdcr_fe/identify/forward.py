"""The forward model: simulates experiments, many at a time, on several processes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from tdcr_fe.effects import Experiment
from tdcr_fe.identify.bay_state import bay_state
from tdcr_fe.identify.run import Run, RunDerivatives, Trajectories, Trajectory, mesh_nodes
from tdcr_fe.identify.settings import OutOfTime, clock, end_at, keep_time, spend
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
    reference: Trajectories | None = None  # of a neighbouring run, which this one follows: fast
    record: bool = False  # whether the run keeps its own path
    # by which the run is differentiated, see `tdcr_fe.solve.sensitivities.differences.tabulated`
    parameters: tuple[Parameter, ...] = ()
    states: bool = False  # whether the run gives the states of the bays
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
    if experiment.restarts:
        runs: list[Run] = []
        end = 0
        for number, part in enumerate(experiment.sequences):
            own = None if job.reference is None else job.reference[number : number + 1]
            begin, end = end, end + len(part.steps)
            chosen = tuple(_of_sequence(p, number, slice(begin, end)) for p in job.parameters)
            one = job._replace(experiment=part, reference=own, parameters=chosen)
            runs.append(simulate_experiment(one, settings, deadline))
            if not runs[-1].solved:
                return runs[-1]
        return Run.joined(runs)
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
    bays = bay_state(experiment, commanded) if job.states else None
    derivatives = RunDerivatives.of(result.sensitivities, last, refused) if job.parameters else None
    trajectories = None if path is None else (Trajectory(path, experiment.ends, run.s),)
    return replace(run, bays=bays, derivatives=derivatives, trajectories=trajectories)


def _of_sequence(parameter: Parameter, number: int, steps: slice) -> Parameter:
    """A parameter of several loading sequences, for one of them, which has these steps."""
    from tdcr_fe.solve.sensitivities.differences import Tabulated
    from tdcr_fe.solve.sensitivities.parameters import StepInput, StepInputs

    if isinstance(parameter, StepInput):
        return parameter
    if isinstance(parameter, StepInputs):
        loads = {name: change[steps] for name, change in parameter.loads.items()}
        return replace(parameter, change=parameter.change[steps], loads=loads)
    table = parameter.apply
    assert isinstance(table, Tabulated)
    own = {offset: e.sequences[number] for offset, e in table.experiments.items()}
    return replace(parameter, apply=replace(table, experiments=own))


def solve_commanded_steps(
    experiment: Experiment, settings: SolverSettings, deadline: float, reference: Trajectories | None
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
    meshed = None if job.reference is None else job.reference[0].on_mesh(mesh_nodes(experiment))
    along = None if meshed is None else meshed.divided(experiment.ends)
    given = experiment.robot, experiment.model, experiment.steps, settings, partial(end_at, deadline)
    while True:
        chosen = [p for p in job.parameters if p.name not in refused]
        try:
            asked: dict[str, Any] = {"sensitivities": chosen, "curvatures": job.curvatures}
            return simulate(*given, reference_path=along, record_path=path, **asked), refused
        except NoDerivative as error:
            refused[error.parameter] = error.reason


Given = TypeVar("Given")
Asked = TypeVar("Asked")
Answer = TypeVar("Answer")
Found = TypeVar("Found")


class ForwardModel:
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
        self.processes = max(1, processes)
        self.settings = settings or SolverSettings()
        self.runs = 0
        self.lists = 0  # of tasks that were given to the processes
        self._pool: ProcessPoolExecutor | None = None
        self._stack = ExitStack()

    def __enter__(self) -> ForwardModel:
        if self.processes > 1:
            self._pool = self._stack.enter_context(worker_pool(self.processes))
        return self

    def __exit__(self, *error: Any) -> None:
        self._pool = None
        self._stack.__exit__(*error)

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
        return self.map(partial(simulate_experiment, settings=settings, deadline=deadline), jobs)

    def map(self, function: Callable[[Given], Found], given: Sequence[Given]) -> list[Found]:
        """Values of a function, in the processes where there are several values; in this one if the processes end."""
        if self._pool is None or len(given) < 2:
            return [function(x) for x in given]
        self.lists += 1
        timed = partial(_timed, function, self.lists, clock(), min(self.processes, len(given)))
        try:
            found = list(self._pool.map(timed, given))
        except BrokenProcessPool:
            self._pool = None
            return [function(x) for x in given]
        spend(sum(seconds for _, seconds in found))
        if not all(value for value, _ in found):
            raise OutOfTime
        return [x for value, _ in found for x in value]


def _timed(
    function: Callable[[Given], Found], task: int, reading: float, working: int, given: Given
) -> tuple[tuple[Found, ...], float]:
    """In a worker: the value of a function, none where the time is over; and the processor time that it took [s]."""
    keep_time(task, reading, working)
    begun = time.process_time()
    try:
        found = (function(given),)
    except OutOfTime:
        return (), time.process_time() - begun
    return found, time.process_time() - begun


def advance(
    work: Sequence[Generator[Asked, Answer, Found]], answers: Callable[[list[Asked]], Sequence[Answer]]
) -> list[Found]:
    """Advance several generators to their ends together; what all of them ask for at a time is answered at a time.

    Where the time is over, each is told so by `OutOfTime`.
    """
    found: dict[int, Found] = {}
    asked: dict[int, Asked] = {}

    def go_on(number: int, step: Callable[[], Asked]) -> None:
        try:
            asked[number] = step()
        except StopIteration as end:
            found[number] = end.value

    for number, one in enumerate(work):
        go_on(number, partial(next, one))
    while asked:
        numbers, questions = list(asked), list(asked.values())
        asked.clear()
        try:
            given = answers(questions)
        except OutOfTime as end:
            for number in numbers:
                go_on(number, partial(work[number].throw, end))
            continue
        for number, answer in zip(numbers, given, strict=True):
            go_on(number, partial(work[number].send, answer))
    return [found[number] for number in range(len(work))]
