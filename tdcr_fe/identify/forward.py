"""The forward model: simulates experiments, many at a time, on several processes."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Effect, Experiment
from tdcr_fe.effects.base import Values
from tdcr_fe.identify.bay_state import bay_state
from tdcr_fe.identify.run import Run, RunDerivatives, Trajectory, mesh_nodes
from tdcr_fe.identify.settings import OutOfTime, clock, ending_at, keep_time, spend
from tdcr_fe.io.processes import worker_pool
from tdcr_fe.model.loading import SolverSettings
from tdcr_fe.model.results import SequenceResult

if TYPE_CHECKING:
    from tdcr_fe.solve.sensitivities.parameters import Parameter
    from tdcr_fe.solve.simulate import PathRecord

Array = NDArray[np.float64]

#: Smallest fraction of a load step that is tried, without and with a reference path.
SMALLEST, SMALLEST_ON_REFERENCE = 1.0 / 256.0, 1.0 / 16.0

#: Maximum substeps used to resolve path dependence.
DIVISIONS = 16


class Task(NamedTuple):
    """What is simulated in one run."""

    experiment: Experiment
    settings: SolverSettings
    reference: Trajectory | None = None  # path that the run follows
    record: bool = False  # whether the run keeps its own path
    # by which the run is differentiated, see `tdcr_fe.solve.sensitivities.differences.tabulated`
    parameters: tuple[Parameter, ...] = ()
    # reading of `tdcr_fe.identify.settings.clock` at which the simulation ends [s]
    deadline: float = math.inf
    states: bool = False  # whether the run gives the states of the bays


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
    chosen = {"path_tolerance": path_tolerance, "max_substeps": DIVISIONS, "min_substep": SMALLEST}
    free = {name: x for name, x in chosen.items() if getattr(declared, name) == getattr(default, name)}
    return replace(declared, **free, mesh_tolerance=math.inf)  # type: ignore[arg-type]


def simulate_experiment(task: Task) -> Run:
    """Simulate one experiment.

    Raises
    ------
    KeyboardInterrupt
        The simulation was interrupted.
    OutOfTime
        The deadline has passed.
    """
    if task.experiment.restarts:
        return _simulate_sequences(task)
    experiment, settings, reference = task.experiment, task.settings, task.reference
    ends, last = experiment.step_ends, last_parts(experiment)
    if reference is not None:
        reference = _on_own_mesh(reference, experiment)
    if reference is not None:
        settings = replace(settings, min_substep=max(settings.min_substep, SMALLEST_ON_REFERENCE))
    path: PathRecord | None = [] if task.record else None
    try:
        result, refused = _differentiated(task, settings, reference, path)
    except (ValueError, np.linalg.LinAlgError, IndexError) as error:
        # an impossible robot, or a reference path that does not fit
        if reference is not None:
            return simulate_experiment(task._replace(reference=None))
        return Run.of((), len(last), experiment, str(error))
    # A run that cannot follow its reference path counts as not solved: it is too far away, and costly.
    ended = [j for j in last if j < len(result.steps)]
    run = Run.of([result.steps[j] for j in ended], len(last), experiment, result.message)
    run = replace(run, iterations=sum(s.iterations for s in result.steps))
    if task.states:
        run = replace(run, bays=bay_state(experiment, result.steps, last))
    if task.parameters and ended:
        run = replace(run, derivatives=RunDerivatives.of(result.sensitivities, ended, len(last), refused))
    return run if path is None else replace(run, trajectory=Trajectory(path, ends, run.s))


def _on_own_mesh(reference: Trajectory, experiment: Experiment) -> Trajectory | None:
    """A reference path on the mesh of an experiment; None where it cannot be taken there."""
    try:
        return reference.on_mesh(mesh_nodes(experiment))
    except ValueError:  # an impossible robot: the simulation says why
        return None


def _simulate_sequences(task: Task) -> Run:
    """Simulate several loading sequences, each from the unloaded robot, as one run."""
    experiment, reference = task.experiment, task.reference
    firsts = (0, *experiment.restarts)
    count = experiment.step_ends[-1][0] + 1
    runs: list[Run] = []
    bounds = zip(firsts, (*experiment.restarts, count), strict=True)
    for number, ((first, last), part) in enumerate(zip(bounds, experiment.sequences, strict=True)):
        own = None if reference is None else reference.part(first, last)
        chosen = tuple(_of_sequence(p, number) for p in task.parameters)
        run = simulate_experiment(task._replace(experiment=part, reference=own, parameters=chosen))
        runs.append(run)
        if run.solved < last - first:
            break
    lengths = [b - a for a, b in itertools.pairwise((*firsts, count))]
    return Run.joined(runs, lengths)


def _of_sequence(parameter: Parameter, number: int) -> Parameter:
    """A parameter of several loading sequences, for one of them."""
    from tdcr_fe.solve.sensitivities.differences import Tabulated
    from tdcr_fe.solve.sensitivities.parameters import StepInput

    if isinstance(parameter, StepInput):
        return parameter
    table = parameter.apply
    assert isinstance(table, Tabulated)
    own = {offset: e.sequences[number] for offset, e in table.experiments.items()}
    return replace(parameter, apply=replace(table, experiments=own))


def last_parts(experiment: Experiment) -> list[int]:
    """Where effects divide a step, its parts are simulated and the end of the last one is kept: their indices."""
    ends = experiment.step_ends
    return [j for j, (k, _) in enumerate(ends) if j + 1 == len(ends) or ends[j + 1][0] != k]


def solve_commanded_steps(
    experiment: Experiment,
    settings: SolverSettings,
    deadline: float = math.inf,
    reference: Trajectory | None = None,
) -> SequenceResult:
    """Simulate an experiment with all its results, those of a divided step at its end only.

    Parameters
    ----------
    experiment, settings
        What is simulated.
    deadline
        Reading of `tdcr_fe.identify.settings.clock` at which the simulation ends [s].
    reference
        Path of a run of this experiment, which is repeated; without it the simulation chooses its own substeps.

    Raises
    ------
    KeyboardInterrupt
        The simulation was interrupted.
    OutOfTime
        The deadline has passed.
    """
    task = Task(experiment, settings, deadline=deadline)
    along = None if reference is None else _on_own_mesh(reference, experiment)
    try:
        result, _ = _differentiated(task, settings, along, None)
    except IndexError:  # the path does not have all steps
        result, _ = _differentiated(task, settings, None, None)
    solved = len(result.steps)
    return replace(result, steps=tuple(result.steps[j] for j in last_parts(experiment) if j < solved))


def _differentiated(
    task: Task, settings: SolverSettings, reference: Trajectory | None, path: PathRecord | None
) -> tuple[SequenceResult, dict[str, str]]:
    """The simulation with all derivatives that there are; and those that there are not, with the reason."""
    from tdcr_fe.solve.sensitivities.differences import NoDerivative
    from tdcr_fe.solve.simulate import simulate

    experiment, refused = task.experiment, dict[str, str]()
    along = None if reference is None else reference.divided(experiment.step_ends)
    while True:
        chosen = [p for p in task.parameters if p.name not in refused]
        try:
            result = simulate(
                experiment.robot,
                experiment.model,
                experiment.steps,
                settings,
                ending_at(task.deadline),
                reference_path=along,
                record_path=path,
                sensitivities=chosen,
            )
        except NoDerivative as error:
            refused[error.parameter] = error.reason
            continue
        return result, refused


Given = TypeVar("Given")
Asked = TypeVar("Asked")
Answer = TypeVar("Answer")
Found = TypeVar("Found")

#: Experiments with an effect that are kept in memory: neighbouring models share most of their effects.
APPLIED = 64


class Job(NamedTuple):
    """One simulation asked for."""

    experiment: Experiment
    reference: Run | None = None  # a neighbouring run with its trajectory, used as reference path: fast
    record: bool = False  # record the trajectory
    parameters: tuple[Parameter, ...] = ()  # by which the run is differentiated
    states: bool = False  # whether the run gives the states of the bays

    def task(self, settings: SolverSettings, deadline: float) -> Task:
        """What the process is given."""
        trajectory = None if self.reference is None else self.reference.trajectory
        return Task(
            self.experiment, settings, trajectory, self.record, self.parameters, deadline, self.states
        )


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
    runs, iterations : int
        Made so far, those of the processes included: the runs, and their Newton iterations. Decisions about what is
        affordable count these: time depends on what else the machine does.
    """

    def __init__(self, processes: int = 1, settings: SolverSettings | None = None) -> None:
        self.processes = max(1, processes)
        self.settings = settings or SolverSettings()
        self.runs = self.iterations = 0
        self.lists = 0  # of tasks that were given to the processes
        # By the identity of both and the values, which holds as long as both are kept
        self._applied: dict[tuple[Any, ...], tuple[Experiment, Effect, Experiment]] = {}
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

    def run(self, jobs: Sequence[Job], path_tolerance: float, deadline: float = math.inf) -> list[Run]:
        """Simulate jobs, several at a time.

        Parameters
        ----------
        jobs
            What to simulate.
        path_tolerance
            Of the solver, where the declared settings leave it to the identification [1].
        deadline
            Reading of `tdcr_fe.identify.settings.clock` at which simulations end [s].

        Raises
        ------
        OutOfTime
            The deadline has passed.
        """
        settings = run_settings(self.settings, path_tolerance)
        runs = self.map(simulate_experiment, [job.task(settings, deadline) for job in jobs])
        self.runs += len(runs)
        self.iterations += sum(r.iterations for r in runs)
        return runs

    def with_effect(self, experiment: Experiment, effect: Effect, values: Values) -> Experiment:
        """An experiment with an effect; the last ones from memory."""
        key = (id(experiment), id(effect), *values.items())
        kept = self._applied.pop(key, None) or (experiment, effect, effect.apply(experiment, values))
        self._applied[key] = kept  # the last one used is the last one dropped
        if len(self._applied) > APPLIED:
            self._applied.pop(next(iter(self._applied)))
        return kept[2]

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
