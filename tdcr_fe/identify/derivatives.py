"""Predictions with their derivatives by parameters of effects: exact from one run, or differences where there are none.

How a derivative is taken follows from what the parameter changes:

- the observation only (a turned instrument, markers off the backbone): central differences of the reading of one run;
- robot, model or loading sequence: the solver's sensitivities, exact along the history, all in one run;
- a load that depends on the state: the exact response of readings and bays to loads in every bay, of the same run;
- where there are none (the mesh or the division of the load steps changes, or the effect declares so): the difference
  of two runs, named in `Linear.differenced`.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Effect, Experiment
from tdcr_fe.identify.bay_state import (
    COMPONENTS,
    LOAD,
    Action,
    BayState,
    Response,
    action_inputs,
    loads_of_action,
    state_change,
    with_action,
)
from tdcr_fe.identify.causes import ReadingCause, StateLoad
from tdcr_fe.identify.forward import Job
from tdcr_fe.identify.problem import FitProblem, Point
from tdcr_fe.identify.run import Acted, Run, RunDerivatives
from tdcr_fe.solve.sensitivities.differences import RELATIVE_STEP, Tabulated, same_structure, tabulated
from tdcr_fe.solve.sensitivities.parameters import ModelParameter

Array = NDArray[np.float64]

#: Difference step of parameters of the observation, over their typical change [1].
OBSERVATION_STEP = 1e-2


class Column(NamedTuple):
    """By what the predictions are differentiated."""

    effect: Effect
    parameter: str
    values: Mapping[str, float]  # of all its parameters, at which the derivative is taken
    step: float  # change of the coordinate, where the derivative is a difference of two runs

    @property
    def key(self) -> tuple[str, str]:
        """Effect and parameter."""
        return self.effect.name, self.parameter


class Request(NamedTuple):
    """A model whose predictions are linearised."""

    effects: tuple[Effect, ...]
    values: Point  # by effect and parameter
    columns: tuple[Column, ...]  # of these effects, or of others at values where they change nothing
    reference: Run | None = None  # path that the run follows
    record: bool = True  # whether the run keeps its own path


class Linear(NamedTuple):
    """Predictions around a point, to first order."""

    residual: Array  # reading less prediction over sigma, shape (n,)
    # derivatives of the predictions over sigma by the coordinates of the columns; zero where not solved,
    # shape (n, P)
    matrix: Array
    run: Run  # without its derivatives
    differenced: Mapping[int, str]  # columns that are differences of two runs, with the reason


def linearize(problem: FitProblem, requests: Sequence[Request]) -> list[Linear]:
    """Linearise several models, all at a time."""
    return linearize_each([(problem, request) for request in requests])


def linearize_each(pairs: Sequence[tuple[FitProblem, Request]]) -> list[Linear]:
    """Linearise several models, each of a problem of its own; their runs are shared among the processes.

    Forward model, path tolerance and deadline are those of the first. An impossible robot, as two laws of the material
    that exclude each other, counts as not solved, and so does a load that does not balance with the state it depends
    on.
    """
    parts = [_part(problem, request) for problem, request in pairs]
    ready = [part for part in parts if isinstance(part, _Part)]
    if not ready:
        return [part for part in parts if isinstance(part, Linear)]
    first = pairs[0][0]
    runs = first.run([part.job for part in ready])
    jobs = [part.differences(run) for part, run in zip(ready, runs, strict=True)]
    beside = iter(first.run(list(itertools.chain(*jobs))))
    found = (
        _linear(part, run, list(itertools.islice(beside, len(own))))
        for part, run, own in zip(ready, runs, jobs, strict=True)
    )
    return [part if isinstance(part, Linear) else next(found) for part in parts]


def _part(problem: FitProblem, request: Request) -> _Part | Linear:
    """What is simulated for a model, with balanced loads; what stands for it where it is not solved."""
    try:
        action, reference = balanced(problem, request)
        return _Part(problem, request._replace(reference=reference), action)
    except ValueError as error:
        return _unsolved(problem, request, error)


def _linear(part: _Part, run: Run, beside: Sequence[Run]) -> Linear:
    """What follows from the runs of a model."""
    try:
        return part.linear(run, beside)
    except ValueError as error:  # not all steps are solved
        return _unsolved(part.problem, part.request, error)


def _unsolved(problem: FitProblem, request: Request, reason: ValueError) -> Linear:
    """Of a model that is not solved."""
    run = Run.of((), len(problem.data.steps), problem.experiment, str(reason))
    nothing = np.full(problem.count, np.nan)
    return Linear(nothing, np.zeros((problem.count, len(request.columns))), run, {})


#: Iterations of a load and the state it depends on at most, and the change that ends them: moments over EI/L, forces
#: over EI/L^2 [1].
ITERATIONS, TOLERANCE = 12, 1e-5


def balanced(problem: FitProblem, request: Request) -> tuple[Action | None, Run | None]:
    """The action at which the loads of a model agree with the state that they depend on, and a run with it.

    Both agree where ``a = F(x(a))``. That is solved by Newton's method with the exact response ``H`` of the state to an
    action, evaluated once: ``(I - F' H) da = F(x) - a``.

    Returns
    -------
    action
        None where neither the model nor a column has loads that depend on the state.
    run
        The reference of the request where the model has no such loads.

    Raises
    ------
    ValueError
        It does not converge.
    """
    loads = [e for e in request.effects if isinstance(e, StateLoad)]
    if not loads and not any(isinstance(c.effect, StateLoad) for c in request.columns):
        return None, request.reference
    experiment = problem.with_effects(request.effects, request.values)
    steps, bays = experiment.step_ends[-1][0] + 1, len(experiment.robot.bay_edges) - 1
    none, reference = Action.none(steps, bays), request.reference
    if not loads:
        return none, reference

    def missing(run: Run, acted: Acted) -> tuple[Array, Array]:
        """What the loads give beyond the action, and the Newton step."""
        assert run.bays is not None
        gap = -acted.action.values
        for e in loads:
            gap = gap + e.action(run.bays, request.values[e.name])
        matrix = _coupling(loads, request.values, run.bays, acted.response)
        return gap, np.asarray(np.linalg.solve(matrix, gap.reshape(steps, -1, 1))).reshape(gap.shape)

    if reference is None or reference.acted is None or reference.bays is None:
        plain = Request((), {}, (), reference)
        effects = tuple(e for e in request.effects if not isinstance(e, StateLoad))
        part = _Part(problem, plain._replace(effects=effects, values=request.values), none)
        (run,) = problem.run([part.job])
        run = part.linear(run, []).run
        if run.solved < steps or run.acted is None:
            raise ValueError(run.message or "not solved")
        reference = run
    assert reference.acted is not None
    backbone = experiment.robot.backbone
    scale = np.array([backbone.EI / backbone.length] * 2 + [backbone.EI / backbone.length**2] * 3)
    acted, run = reference.acted, reference
    smallest = np.inf
    for _ in range(ITERATIONS):
        _, step = missing(run, acted)
        assert run.bays is not None
        action = Action(acted.action.values + step, run.bays.rotation)
        (run,) = problem.run([Job(with_action(experiment, action), run, True, states=True)])
        if run.solved < steps:
            raise ValueError(run.message or "not solved")
        acted = Acted(action, acted.response)
        gap, _ = missing(run, acted)
        size = float(np.max(np.abs(gap) / scale))
        if size <= TOLERANCE:
            return action, replace(run, acted=acted)
        if not size < 4.0 * smallest:
            break
        smallest = min(size, smallest)
    raise ValueError("the load does not balance with the state it depends on")


def _through_state(loads: Sequence[StateLoad], values: Point, state: BayState, moved: Array) -> Array:
    """Change of the action by changes of the state, shape (K, 5 n_bays, P) both."""
    slope = sum(
        (e.slope(state, values[e.name]) for e in loads), np.zeros((*state.shape, COMPONENTS, COMPONENTS))
    )
    rows = moved.reshape(*state.shape, COMPONENTS, -1)
    return np.einsum("kbij,kbjp->kbip", slope, rows).reshape(moved.shape)


def _coupling(loads: Sequence[StateLoad], values: Point, state: BayState, response: Response) -> Array:
    """The matrix ``I - F' H`` of every step, shape (K, 5 n_bays, 5 n_bays)."""
    through = _through_state(loads, values, state, response.state)
    return np.asarray(np.eye(through.shape[1]) - through)


def of_readings(problem: FitProblem, actions: Array, response: Response) -> Array:
    """Change of the predictions over sigma by actions of shape (K, 5 n_bays, q) to first order, shape (n, q)."""
    out = np.zeros((problem.count, actions.shape[-1]))
    steps = problem.readings.reader.step
    for k in np.unique(steps):
        mine = steps == k
        out[mine] = response.readings[mine] @ actions[k]
    return out


class _Part:
    """One model: what is simulated for it, and what follows."""

    def __init__(self, problem: FitProblem, request: Request, action: Action | None = None) -> None:
        self.problem, self.request, self.action = problem, request, action
        self.effects, self.values = self._at_null()
        bare = problem.with_effects(self.effects, self.values)
        self._bare: Experiment | None = None  # without the action, once that is there
        self.experiment = self._acted(bare)
        self._bare = bare
        self.observed: dict[int, Tabulated] = {}
        self.differenced: dict[int, str] = {}
        self.exact: dict[str, int] = {}
        self.beside: dict[int, Experiment] = {}
        tables = []
        for number, column in enumerate(request.columns):
            if isinstance(column.effect, StateLoad | ReadingCause):
                continue
            if not column.effect.exact_derivatives:
                self.differenced[number] = "it declares no exact derivatives"
                continue
            table = self._table(number)
            neighbours = list(table.experiments.values())
            if not neighbours:
                self.differenced[number] = table.refused
                continue
            if any(e.observation != self.experiment.observation for e in neighbours):
                self.observed[number] = self._table(number, OBSERVATION_STEP)
            if not all(_same_robot(self.experiment, e) for e in neighbours):
                name = f"{number} {column.effect.name}.{column.parameter}"
                self.exact[name] = number
                tables.append(
                    ModelParameter(name, table.value, table.step / RELATIVE_STEP, table, approximate=True)
                )
        inputs = () if action is None else action_inputs(action.values.shape[1])
        self.job = Job(
            self.experiment, request.reference, request.record, (*tables, *inputs), action is not None
        )

    def _acted(self, experiment: Experiment) -> Experiment:
        """The experiment with the action; steps and loads that are those of the model are shared with it."""
        if self.action is None:
            return experiment
        bare = self._bare
        if bare is None or experiment.ends != bare.ends:
            return with_action(experiment, self.action)
        if experiment.steps is bare.steps:
            return replace(experiment, steps=self.experiment.steps)
        steps = []
        for own, plain, acted in zip(experiment.steps, bare.steps, self.experiment.steps, strict=True):
            if own is not plain and own.loads != plain.loads:
                return with_action(experiment, self.action)
            steps.append(acted if own is plain else replace(own, loads=acted.loads))
        return replace(experiment, steps=tuple(steps))

    def _at_null(self) -> tuple[tuple[Effect, ...], Point]:
        """The model with those effects of the columns whose null values add inputs that act nowhere, such as loads."""
        effects, values = list(self.request.effects), dict(self.request.values)
        plain = self.problem.with_effects(effects, values)
        tried: set[str] = set()
        for e, _, at, _ in self.request.columns:
            if e.name in values or e.name in tried or isinstance(e, StateLoad | ReadingCause):
                continue
            tried.add(e.name)
            more = {**values, e.name: dict(at)}
            with_it = self.problem.with_effects([*effects, e], more)
            if with_it.steps is not plain.steps and not same_structure(plain.steps, with_it.steps):
                effects, values, plain = [*effects, e], more, with_it
        return tuple(effects), values

    def _moved(self, number: int, coordinate: float) -> Experiment:
        """The experiment with the parameter of a column at a coordinate.

        Raises
        ------
        ValueError
            Beyond its bounds, or an impossible robot.
        """
        column = self.request.columns[number]
        e = column.effect
        parameter = next(p for p in e.parameters if p.name == column.parameter)
        low, high = self.problem.bounds(e, column.parameter)
        if not low <= coordinate <= high:
            raise ValueError(f"{e.name}.{column.parameter} must be from {low:g} to {high:g}")
        effects = [x for x in self.effects if x.name != e.name]
        own = {**column.values, column.parameter: parameter.value(coordinate)}
        return self._acted(self.problem.with_effects([*effects, e], {**self.values, e.name: own}))

    def _table(self, number: int, relative_step: float | None = None) -> Tabulated:
        """Neighbours of the experiment by a column's parameter."""
        column = self.request.columns[number]
        about = next(p for p in column.effect.parameters if p.name == column.parameter)
        start = about.coordinate(column.values[column.parameter])
        # From zero most are linear, and a longer step has less round-off.
        size = max(abs(start), about.scale) if start != 0.0 else 100.0 * about.scale
        if relative_step is not None:
            size = about.scale * relative_step / RELATIVE_STEP
        parameter = ModelParameter(
            f"{column.effect.name}.{column.parameter}", start, size, lambda _, z: self._moved(number, z)
        )
        table = tabulated(parameter, self.experiment).apply
        assert isinstance(table, Tabulated)
        return table

    def differences(self, run: Run) -> list[Job]:
        """Runs beside this one, for derivatives that did not come out of it."""
        if run.derivatives is not None:
            self.differenced |= {self.exact[name]: why for name, why in run.derivatives.refused.items()}
        reference = run if run.trajectory is not None else self.request.reference
        if run.solved == 0:
            return []
        for number in self.differenced:
            try:
                self.beside[number] = self._moved(number, self._coordinate(number) + self._step(number))
            except ValueError:  # there is no such robot: the parameter stays where it is
                continue
        return [Job(moved, reference) for moved in self.beside.values()]

    def _coordinate(self, number: int) -> float:
        """Present coordinate of a column."""
        column = self.request.columns[number]
        about = next(p for p in column.effect.parameters if p.name == column.parameter)
        return about.coordinate(column.values[column.parameter])

    def _step(self, number: int) -> float:
        """Difference step of a column, within its bounds."""
        column = self.request.columns[number]
        low, high = self.problem.bounds(column.effect, column.parameter)
        z, h = self._coordinate(number), column.step
        if not low <= z + h <= high:
            h = -h
        if not low <= z + h <= high:
            h = max(high - z, low - z, key=abs)
        return h

    def linear(self, run: Run, beside: Sequence[Run]) -> Linear:
        """What follows from the runs."""
        problem, read = self.problem, partial(self.problem.readings.reader.read, run)
        residual = problem.residual(self.experiment, run) - problem.shift(self.effects, self.values, run)
        matrix = np.zeros((residual.size, len(self.request.columns)))
        by, acted = run.derivatives, None
        if by is not None and by.names:
            exact = [j for j, name in enumerate(by.names) if name in self.exact]
            numbers = [self.exact[by.names[j]] for j in exact]
            if exact:
                matrix[:, numbers] = self._of(run, by.part(exact))
            if self.action is not None:
                acted = Acted(self.action, self._response(run, by))
                self._add_loads(matrix, run, acted.response, numbers, state_change(run, by.part(exact)))
        for number, table in self.observed.items():
            values = {k: read(e) for k, e in table.experiments.items()}
            change = _difference(values, read(self.experiment), table.step)
            matrix[:, number] += problem.whitened(change / problem.sigma)
        for (number, moved), other in zip(self.beside.items(), beside, strict=True):
            plain = problem.residual(moved, other) - problem.shift(self.effects, self.values, other)
            matrix[:, number] = (residual - plain) / self._step(number)
        for number, column in enumerate(self.request.columns):
            if isinstance(column.effect, ReadingCause):
                unit = {p.name: 0.0 for p in column.effect.parameters} | {column.parameter: 1.0}
                matrix[:, number] = problem.whitened(column.effect.shift(problem, run, unit) / problem.sigma)
        matrix = np.where(np.isfinite(matrix), matrix, 0.0)
        return Linear(residual, matrix, replace(run, derivatives=None, acted=acted), self.differenced)

    def _of(self, run: Run, by: RunDerivatives) -> Array:
        """Derivatives of the predictions over sigma, shape (n, P)."""
        found = self.problem.readings.reader.derivatives(replace(run, derivatives=by), self.experiment)
        return self.problem.whitened(found / self.problem.sigma[:, None])

    def _response(self, run: Run, by: RunDerivatives) -> Response:
        """Of readings and bays to actions."""
        assert run.bays is not None
        named = [j for j, name in enumerate(by.names) if name.startswith(f"{LOAD} ")]
        actions = by.part(named).times(loads_of_action(run.bays.rotation))
        rows = self._of(run, actions)
        return Response(np.where(np.isfinite(rows), rows, 0.0), state_change(run, actions))

    def _add_loads(
        self, matrix: Array, run: Run, response: Response, numbers: Sequence[int], moved: Array
    ) -> None:
        """Columns of loads that depend on the state; and what those of the model add to the other columns."""
        assert run.bays is not None
        state, problem = run.bays, self.problem
        steps = len(run.positions)
        loads = [e for e in self.effects if isinstance(e, StateLoad)]
        own = [
            (n, c.effect, c.parameter, c.values)
            for n, c in enumerate(self.request.columns)
            if isinstance(c.effect, StateLoad)
        ]
        actions = [e.by_value(state, values, name).reshape(steps, -1) for _, e, name, values in own]
        columns = [n for n, *_ in own]
        if loads:
            by_state = _through_state(loads, self.values, state, moved)
            actions += list(np.moveaxis(by_state, 2, 0))
            columns += list(numbers)
        if not actions:
            return
        stacked = np.stack(actions, axis=-1)
        if loads:
            solved = np.all(np.isfinite(stacked), axis=(1, 2))
            coupling = _coupling(loads, self.values, state, response)
            stacked[solved] = np.linalg.solve(coupling[solved], stacked[solved])
        matrix[:, columns] += of_readings(problem, stacked, response)


def _difference(values: Mapping[int, Array], present: Array, step: float) -> Array:
    """Derivative from values at offsets 1 and -1, or at two offsets on one side."""
    if 1 in values and -1 in values:
        return (values[1] - values[-1]) / (2.0 * step)
    side = 1 if 1 in values else -1
    return side * (2.0 * values[side] - 0.5 * values[2 * side] - 1.5 * present) / step


def _same_robot(a: Experiment, b: Experiment) -> bool:
    """Whether two experiments differ in the observation at most."""
    return (a.robot, a.model, a.steps, a.ends) == (b.robot, b.model, b.steps, b.ends)
