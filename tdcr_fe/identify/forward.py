"""The forward model: predicts the readings of many experiments at a time, on several processes."""

from __future__ import annotations

import hashlib
import math
import pickle
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tdcr_fe.effects import Experiment
from tdcr_fe.effects.actuation import loads_between
from tdcr_fe.io.processes import worker_pool
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.channels import Channel, Location, ObservedStep, channel
from tdcr_fe.model.loading import Actuation, LoadStep, resolve

Array = NDArray[np.float64]

#: Smallest fraction of a load step that is tried, without and with a reference path.
SMALLEST, GUIDED = 1.0 / 256.0, 1.0 / 16.0

#: Maximum substeps used to resolve path dependence.
DIVISIONS = 16

#: Message of a simulation that was interrupted.
INTERRUPTED = "interrupted"

#: Runs kept in memory.
CACHE = 400


@dataclass(frozen=True)
class Run:
    """Results of one simulated loading sequence that predictions need.

    Attributes
    ----------
    s : ndarray, shape (n,)
        Arc lengths of the nodes [m].
    positions : ndarray, shape (n_steps, n, 3)
        [m].
    rotations : ndarray, shape (n_steps, n, 3, 3)
    displacements, base_tensions, distal_tensions : ndarray, shape (n_steps, n_tendons)
        [m, N, N].
    solved : int
        Number of steps solved, from the first on; the others are NaN.
    message : str
        Why it ended.
    trajectory : object
        Reference path for neighbouring runs; None where none was recorded.
    ends : tuple of (int, float)
        Of the steps of the trajectory, as in `Experiment.step_ends`.
    elements : int
        Per bay.
    """

    s: Array
    positions: Array
    rotations: Array
    displacements: Array
    base_tensions: Array
    distal_tensions: Array
    solved: int
    message: str
    trajectory: Any = None
    ends: tuple[tuple[int, float], ...] = ()
    elements: int = 0

    @property
    def curvature(self) -> Array:
        """Of the elements, as turning rates about the section's axes x, y, z [1/m], shape (n_steps, n-1, 3)."""
        relative = np.swapaxes(self.rotations[:, :-1], -1, -2) @ self.rotations[:, 1:]
        n = relative.shape[0], relative.shape[1]
        ok = np.isfinite(relative).all(axis=(-1, -2)).ravel()
        turn = np.full((ok.size, 3), np.nan)
        turn[ok] = Rotation.from_matrix(relative.reshape(-1, 3, 3)[ok]).as_rotvec()
        return turn.reshape(*n, 3) / np.diff(self.s)[None, :, None]


def _simulate(task: tuple[Experiment, Any, bool, float]) -> Run:
    """Simulate one experiment; the only call of the finite-element model."""
    from tdcr_fe.solve.simulate import SolverSettings, simulate

    experiment, guide, record, path_tolerance = task
    trajectory: list[Any] | None = [] if record else None
    ends = experiment.step_ends
    # Where effects divide a step, its parts are simulated and the end of the last one is kept.
    whole = [j for j, (k, _) in enumerate(ends) if j + 1 == len(ends) or ends[j + 1][0] != k]
    steps, m = len(whole), len(experiment.robot.tendons)
    waypoints = None
    if guide is not None and guide[2] != experiment.model.starting_elements_per_bay:
        guide = None
    if guide is not None:
        waypoints = guide[0] if guide[1] == ends else _divide(_join(*guide[:2]), ends)
    try:
        result = simulate(
            experiment.robot,
            experiment.model,
            experiment.steps,
            SolverSettings(
                path_tolerance=path_tolerance,
                max_substeps=DIVISIONS,
                mesh_tolerance=math.inf,  # the identification refines its mesh against the noise
                min_substep=SMALLEST if waypoints is None else GUIDED,
            ),
            reference_path=waypoints,
            record_path=trajectory,
        )
    except (
        ValueError,
        np.linalg.LinAlgError,
        IndexError,
    ) as error:  # an impossible robot, or a reference path that does not fit
        if guide is not None:
            return _simulate((experiment, None, record, path_tolerance))
        nothing = np.full((steps, m), np.nan)
        return Run(
            np.array([0.0, experiment.robot.backbone.length]),
            np.full((steps, 2, 3), np.nan),
            np.full((steps, 2, 3, 3), np.nan),
            nothing,
            nothing,
            nothing,
            0,
            str(error),
        )
    if result.message == INTERRUPTED:
        raise KeyboardInterrupt
    # In a fit, a run that cannot follow its reference path is too far away and costly: it counts as not solved.
    if not result.converged and guide is not None and not record:
        return _simulate((experiment, None, record, path_tolerance))
    kept = [result.steps[j] for j in whole if j < len(result.steps)]
    solved = len(kept)
    s = result.steps[0].s if solved else np.array([0.0, experiment.robot.backbone.length])

    def fill(values: list[Array], shape: tuple[int, ...]) -> Array:
        full = np.full((steps, *shape), np.nan)
        if values:
            full[:solved] = np.array(values)
        return full

    return Run(
        s,
        fill([r.positions for r in kept], (s.size, 3)),
        fill([r.rotations for r in kept], (s.size, 3, 3)),
        fill([r.displacements for r in kept], (m,)),
        fill([r.base_tensions for r in kept], (m,)),
        fill([np.array([t[-1] for t in r.tensions]) for r in kept], (m,)),
        solved,
        result.message,
        trajectory,
        ends,
        experiment.model.starting_elements_per_bay,
    )


def _join(trajectory: Any, ends: Sequence[tuple[int, float]]) -> dict[int, list[Any]]:
    """Waypoints by commanded step, their load factors those of the commanded step."""
    joined: dict[int, list[Any]] = {}
    done: dict[int, float] = {}
    for waypoints, (k, factor) in zip(trajectory, ends, strict=True):
        start = done.get(k, 0.0)
        joined.setdefault(k, []).extend(
            replace(w, load_factor=start + (factor - start) * w.load_factor) for w in waypoints
        )
        done[k] = factor
    return joined


def _divide(joined: dict[int, list[Any]], ends: Sequence[tuple[int, float]]) -> list[list[Any]]:
    """Waypoints of commanded steps, for steps divided in another way."""
    divided = []
    done: dict[int, float] = {}
    for k, factor in ends:
        start = done.get(k, 0.0)
        inside = [w for w in joined[k] if start + 1e-9 < w.load_factor < factor - 1e-9]
        last = next(w for w in joined[k] if w.load_factor >= factor - 1e-9)
        part = [replace(w, load_factor=(w.load_factor - start) / (factor - start)) for w in inside]
        divided.append([*part, replace(last, load_factor=1.0)])
        done[k] = factor
    return divided


def divide_steps(experiment: Experiment, which: set[int], parts: int) -> Experiment:
    """Divide commanded steps into equal parts to resolve path dependence.

    Steps already divided, of a fixed number of substeps, or in which a tendon changes from tension to displacement stay
    whole. Without friction at each hole, or with friction that has no history, all steps stay whole.

    Parameters
    ----------
    experiment
        With the commands.
    which
        Commanded steps, from 0.
    parts
        Of each.

    Returns
    -------
    Experiment
        The same one where nothing is to be divided.
    """
    if experiment.model.friction != "per-hole":
        return experiment
    actions = resolve(experiment.robot, experiment.steps)
    whole = [k for k, factor in experiment.step_ends if factor == 1.0]
    single = {k for k, _ in experiment.step_ends if [x for x, _ in experiment.step_ends].count(k) == 1}
    steps: list[LoadStep] = []
    ends: list[tuple[int, float]] = []
    names = experiment.robot.tendon_names
    before = Actuation(actions[0].by_displacement, np.zeros(len(names)))
    for step, action, (k, factor) in zip(experiment.steps, actions, experiment.step_ends, strict=True):
        same = bool(np.all(before.by_displacement == action.by_displacement))
        if k in which and k in single and k in whole and same and step.substeps is None:
            for i in range(1, parts):
                x = i / parts
                values = before.values + x * (action.values - before.values)
                commanded = {n: float(values[names.index(n)]) for n in (*step.tensions, *step.displacements)}
                steps.append(
                    replace(
                        step,
                        tensions={n: commanded[n] for n in step.tensions},
                        displacements={n: commanded[n] for n in step.displacements},
                        loads=loads_between(before.loads, step.loads, x),
                        time=None if step.time is None else before.time + x * (action.time - before.time),
                    )
                )
                ends.append((k, x))
        steps.append(step)
        ends.append((k, factor))
        before = action
    if len(steps) == len(experiment.steps):
        return experiment
    return replace(experiment, steps=tuple(steps), ends=tuple(ends))


class Reader:
    """Predicts readings from a run, by the channels of `tdcr_fe.model.channels`.

    Parameters
    ----------
    readings
        What is measured, where and in which step.
    step_ids
        Numbers of the steps in order.
    tendon_names
        Of the robot.
    """

    def __init__(
        self, readings: Sequence[Reading], step_ids: Sequence[int], tendon_names: Sequence[str]
    ) -> None:
        index = {n: i for i, n in enumerate(step_ids)}
        self.count = len(readings)
        self.step = np.array([index[r.step] for r in readings], dtype=int)
        self.tendon_names = tuple(tendon_names)
        groups: dict[tuple[int, str], list[int]] = {}
        for i, r in enumerate(readings):
            groups.setdefault((index[r.step], r.quantity), []).append(i)
        self._groups: dict[int, list[tuple[Channel, Array, list[Location]]]] = {}
        for (k, quantity), which in groups.items():
            locations = [readings[i].location for i in which]
            self._groups.setdefault(k, []).append((channel(quantity), np.array(which), locations))

    def read(self, run: Run, experiment: Experiment) -> Array:
        """What would be read, in the readings' units, shape (n,); NaN for steps that were not solved.

        Parameters
        ----------
        run
            Of the experiment's robot, model and steps.
        experiment
            Whose observation map is used.
        """
        out = np.full(self.count, np.nan)
        frame = Rotation.from_rotvec(np.array(experiment.observation.rotation)).as_matrix()
        offset = np.array([*experiment.observation.offset, 0.0])
        for k in range(run.solved):
            step = ObservedStep(
                run.s,
                run.positions[k],
                run.rotations[k],
                run.displacements[k],
                run.distal_tensions[k],
                self.tendon_names,
                frame,
                offset,
            )
            for known, which, locations in self._groups.get(k, ()):
                out[which] = known.predict(step, locations)
        return out


class ForwardModel:
    """Simulates experiments, each once, several at a time. Use as a context manager; leaving it ends the workers.

    Parameters
    ----------
    processes
        Worker processes; 1 stays in this one.
    """

    def __init__(self, processes: int = 1) -> None:
        self.processes = max(1, processes)
        self.runs = 0
        self._cache: dict[str, Run] = {}
        self._guides: dict[int, Run] = {}
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
        guide: Run | None = None,
        record: bool = False,
    ) -> list[Run]:
        """Simulate experiments, those that were simulated before from memory.

        Parameters
        ----------
        experiments
            What to simulate; experiments that differ in the observation only share a run.
        path_tolerance
            Of the solver. Not part of a run's key: it grows once, and earlier, more accurate runs remain valid.
        guide
            A neighbouring run with its trajectory, used as reference path; three times as fast, for sensitivities.
        record
            Record trajectories.
        """
        kind = f"free{record}"
        if guide is not None:
            self._guides[id(guide)] = guide  # a reference keeps the id unique
            kind = f"guided{id(guide)}{record}"
        keys = [_key(s, kind) for s in experiments]
        if not record:  # a recorded run can be used too
            keys = [k[:-5] + "True" if k[:-5] + "True" in self._cache else k for k in keys]
        todo = {k: s for k, s in zip(keys, experiments, strict=True) if k not in self._cache}
        trajectory = None if guide is None else (guide.trajectory, guide.ends, guide.elements)
        tasks = [(s, trajectory, record, path_tolerance) for s in todo.values()]
        for key, run in zip(todo, self._map(tasks), strict=True):
            self._cache[key] = run
        self.runs += len(tasks)
        found = [self._cache[k] for k in keys]
        while len(self._cache) > CACHE:
            self._cache.pop(next(iter(self._cache)))
        return found

    def _map(self, tasks: list[tuple[Experiment, Any, bool, float]]) -> list[Run]:
        if self._pool is None or len(tasks) < 2:
            return [_simulate(t) for t in tasks]
        try:
            return list(self._pool.map(_simulate, tasks))
        except BrokenProcessPool:
            self._pool = None
            return [_simulate(t) for t in tasks]


def _key(experiment: Experiment, kind: str) -> str:
    text = pickle.dumps((experiment.robot, experiment.model, experiment.steps, experiment.ends))
    return hashlib.sha256(text).hexdigest() + kind
