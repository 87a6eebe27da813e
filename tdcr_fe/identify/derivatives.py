"""Predictions with their derivatives by parameters of effects: exact from one run, or differences where there are none.

How a derivative is taken follows from what the parameter changes:

- the observation only (a turned instrument, markers off the backbone): central differences of the reading of one run;
- robot, model or loading sequence: the solver's sensitivities, exact along the history, all in one run;
- a load that depends on the state: the exact response of readings and bays to loads in every bay, of the same run;
- where there are none (the mesh or the division of the load steps changes, or the effect declares so): the difference
  of two runs, named in `Linear.differenced`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from tdcr_fe.effects import Effect, Experiment, Parameter
from tdcr_fe.elements import Array
from tdcr_fe.identify import bay_state
from tdcr_fe.identify.bay_state import COMPONENTS, Acted, Action, BayState, scale
from tdcr_fe.identify.causes import BesideDescription, ReadingCause, StateLoad
from tdcr_fe.identify.forward import Job, Work, advance
from tdcr_fe.identify.input_causes import ChangedInputs, Commands
from tdcr_fe.identify.problem import FitProblem, Point
from tdcr_fe.identify.run import Run, RunDerivatives, Trajectory
from tdcr_fe.model.robot import Robot
from tdcr_fe.solve.sensitivities.differences import Tabulated, same_structure, tabulated
from tdcr_fe.solve.sensitivities.parameters import ModelParameter, StepInputs


class Column(NamedTuple):
    """By what the predictions are differentiated."""

    effect: Effect
    parameter: str
    values: Mapping[str, float]  # of all its parameters, at which the derivative is taken
    step: float  # change of the coordinate, where the derivative is a difference of two runs

    @property
    def about(self) -> Parameter:
        """The parameter."""
        return next(p for p in self.effect.parameters if p.name == self.parameter)

    @property
    def coordinate(self) -> float:
        """Its coordinate, at which the derivative is taken."""
        return self.about.coordinate(self.values[self.parameter])


class Request(NamedTuple):
    """A model whose predictions are linearised."""

    effects: tuple[Effect, ...]
    values: Point  # by effect and parameter
    columns: tuple[Column, ...]  # of these effects, or of others at values where they change nothing
    reference: Run | None = None  # path that the run follows
    record: bool = True  # whether the run keeps its own path
    # whether columns of loads that depend on the state have what friction remembers of earlier steps; without that all
    # of them follow from the response of each load step to loads
    history: bool = True

    @property
    def state(self) -> bay_state.BayState | None:
        """State of the bays along the path that the run follows."""
        return None if self.reference is None else self.reference.bays

    @property
    def trajectories(self) -> Trajectory | None:
        """The path that the run follows."""
        return None if self.reference is None else self.reference.trajectories


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
    return advance([linearized(problem, request) for request in requests], problem.run)


#: A load agrees with the state that it depends on where what is missing is less than this: moments over EI/L, forces
#: over EI/L^2; it is then added to first order [1].
BALANCED = 1e-2

#: A run has to leave less than this share of what the run before was missing [1]. Where loads balance it left less than
#: 0.3; where they do not, 80 runs of a soft robot left 0.694 each time, and three minutes were gone.
NEARER = 0.5


def linearized(problem: FitProblem, request: Request) -> Work[Linear]:
    """Linearise one model.

    An impossible robot, as two laws of the material that exclude each other, counts as not solved, and so does a load
    that does not balance with the state it depends on.

    Loads that depend on the state are made to agree with it, run by run as long as much less is missing, see
    `agreed`.
    """
    smallest = math.inf
    try:
        action = first_action(problem, request)
        while True:
            part = _Part(problem, request, action)
            (plain,) = yield [part.job]
            run, missing = part.balanced(plain)
            known = request.state is not None or not (request.history and run.solved and run.acted)
            if missing <= BALANCED and known:
                beside = yield part.differences(plain)
                return part.linear(run, plain, beside)
            if not missing < NEARER * smallest or run.acted is None:
                raise ValueError("the load does not balance with the state it depends on")
            smallest, action, request = missing, run.acted.action, request._replace(reference=run)
    except ValueError as error:
        nothing = np.full(problem.count, np.nan)
        return Linear(nothing, np.zeros((problem.count, len(request.columns))), Run.unsolved(str(error)), {})


def first_action(problem: FitProblem, request: Request) -> bay_state.Action | None:
    """The action with which a model is simulated first: that of its reference, moved by the change of its loads.

    None where neither the model nor a column has loads that depend on the state.
    """
    loads = _loads(request.effects)
    if not loads and not any(isinstance(c.effect, StateLoad) for c in request.columns):
        return None
    reference = request.reference
    if loads and reference is not None and reference.acted is not None:
        return agreed(loads, request.values, reference, problem.experiment.robot).action
    return bay_state.Action.none(problem.experiment)


def _loads(effects: Sequence[Effect]) -> list[StateLoad]:
    return [e for e in effects if isinstance(e, StateLoad)]


#: How parameters are named that changes of the inputs add up from.
_INPUTS = "inputs "


class _Part:
    """One model: what is simulated for it, and what follows."""

    def __init__(self, problem: FitProblem, request: Request, action: bay_state.Action | None = None) -> None:
        self.problem, self.request, self.action = problem, request, action
        self.effects, self.values = self._at_null()
        self._bare = problem.with_effects(self.effects, self.values)  # without the action
        self.experiment = self._bare if action is None else bay_state.with_action(self._bare, action)
        self.observed: dict[int, Tabulated] = {}
        self.differenced: dict[int, str] = {}
        self.beside: dict[int, Experiment] = {}
        self.along_history: dict[int, bay_state.Action] = {}  # what columns of loads act with
        tables: dict[int, ModelParameter | StepInputs] = {}
        inputs: dict[int, Array] = {}  # changes of the inputs by columns, shape (n_steps, n_tendons)
        for number, column in enumerate(request.columns):
            if isinstance(column.effect, BesideDescription):
                if request.history and request.state is not None and isinstance(column.effect, StateLoad):
                    tables[number] = self._of_load(number, request.state)
                continue
            if not column.effect.exact_derivatives:
                self.differenced[number] = "it declares no exact derivatives"
                continue
            if isinstance(column.effect, ChangedInputs) and column.effect.name not in self.values:
                inputs[number] = self._of_inputs(number)
                continue
            parameter = self._tabulated(number)
            table = parameter.apply
            assert isinstance(table, Tabulated)
            neighbours = list(table.experiments.values())
            if not neighbours:
                self.differenced[number] = table.refused
                continue
            here = self.experiment.observation
            if any(e.observation != here for e in neighbours):
                self.observed[number] = table
            if any(replace(e, observation=here) != self.experiment for e in neighbours):
                tables[number] = parameter
        # changes of the inputs that add up to those by the columns, which are many more
        rows = np.array(list(inputs.values())).reshape(len(inputs), self._no_inputs.size)
        _, size, changes = np.linalg.svd(rows, full_matrices=False)
        changes = changes[size > 1e-12 * np.max(size, initial=0.0)]
        parts = [StepInputs(f"{_INPUTS}{j}", x.reshape(self._no_inputs.shape)) for j, x in enumerate(changes)]
        self.exact = {table.name: number for number, table in tables.items()}
        self.of_inputs, self.shares = list(inputs), changes @ rows.T
        acting = () if action is None else bay_state.action_inputs(self.experiment)
        parameters, curvatures = (*tables.values(), *parts, *acting), problem.readings.of_curvature
        self.job = Job(self.experiment, request.trajectories, request.record, parameters, curvatures)

    def _acted(self, experiment: Experiment) -> Experiment:
        """The experiment with the action; steps and loads that are those of the model are shared with it."""
        if self.action is None:
            return experiment
        bare, acted = self._bare, self.experiment.steps
        moved = experiment.robot.bay_ends != bare.robot.bay_ends  # and with the bays where it acts
        if experiment.steps is bare.steps and not moved:
            return replace(experiment, steps=acted)
        pairs = list(zip(experiment.steps, bare.steps, strict=False))
        if moved or experiment.ends != bare.ends or any(a is not b and a.loads != b.loads for a, b in pairs):
            return bay_state.with_action(experiment, self.action)
        each = zip(pairs, acted, strict=True)
        return replace(
            experiment, steps=tuple(x if a is b else replace(a, loads=x.loads) for (a, b), x in each)
        )

    def _at_null(self) -> tuple[tuple[Effect, ...], Point]:
        """The model with those effects of the columns whose null values add inputs that act nowhere, such as loads."""
        effects, values = list(self.request.effects), dict(self.request.values)
        plain = self.problem.with_effects(effects, values)
        tried: set[str] = set()
        for e, _, at, _ in self.request.columns:
            if e.name in values or e.name in tried or isinstance(e, BesideDescription | ChangedInputs):
                continue
            tried.add(e.name)
            more = {**values, e.name: dict(at)}
            with_it = self.problem.with_effects([*effects, e], more)
            if with_it.steps is not plain.steps and not same_structure(plain.steps, with_it.steps):
                effects, values, plain = [*effects, e], more, with_it
        return tuple(effects), values

    @cached_property
    def _commands(self) -> list[tuple[Experiment, Commands]]:
        """Loading sequences, and their inputs."""
        return [(part, Commands.of(part)) for part in self.experiment.sequences]

    def _of_inputs(self, number: int) -> Array:
        """How a column changes the inputs, of a cause beside the model, which no neighbours have to show."""
        e, name, values, _ = self.request.columns[number]
        assert isinstance(e, ChangedInputs)
        return np.concatenate([e.by_number(part, own, values, name) for part, own in self._commands])

    @property
    def _no_inputs(self) -> Array:
        """Inputs of all steps, zero."""
        return np.zeros((len(self.experiment.steps), len(self.experiment.robot.tendons)))

    def _of_load(self, number: int, state: bay_state.BayState) -> StepInputs:
        """A column's parameter, of a load that depends on a state."""
        e, name, values, _ = self.request.columns[number]
        assert isinstance(e, StateLoad)
        change = bay_state.Action(e.by_value(state, values, name), state.rotation)
        self.along_history[number] = change
        loads = bay_state.loads_of(self.experiment, change)
        return StepInputs(f"{number} {e.name}.{name}", self._no_inputs, loads)

    def _moved(self, number: int, coordinate: float) -> Experiment:
        """The experiment with the parameter of a column at a coordinate.

        Raises
        ------
        ValueError
            Beyond its bounds, or an impossible robot.
        """
        column = self.request.columns[number]
        e = column.effect
        low, high = self.problem.bounds(e, column.parameter)
        if not low <= coordinate <= high:
            raise ValueError(f"{e.name}.{column.parameter} must be from {low:g} to {high:g}")
        effects = self.effects if e.name in self.values else (*self.effects, e)  # in their order
        own = {**column.values, column.parameter: column.about.value(coordinate)}
        return self._acted(self.problem.with_effects(effects, {**self.values, e.name: own}))

    def _tabulated(self, number: int) -> ModelParameter:
        """A column's parameter, with neighbours of the experiment."""
        column = self.request.columns[number]
        start, about = column.coordinate, column.about
        # From zero most are linear, and a longer step has less round-off.
        size = max(abs(start), about.scale) if start != 0.0 else 100.0 * about.scale
        name = f"{number} {column.effect.name}.{column.parameter}"
        parameter = ModelParameter(name, start, size, lambda _, z: self._moved(number, z), approximate=True)
        return tabulated(parameter, self.experiment)

    def balanced(self, run: Run) -> tuple[Run, float]:
        """The run with what its loads are missing added to first order, and its size over those of the rod [1].

        Raises
        ------
        ValueError
            The loads are not solved.
        """
        loads, by = _loads(self.effects), run.derivatives
        if loads and not run.solved:
            raise ValueError(run.message)
        if self.action is None or by is None or not by.names:
            return run, 0.0
        assert run.bays is not None
        named = [j for j, n in enumerate(by.names) if n not in self.exact and not n.startswith(_INPUTS)]
        actions = by.part(named).times(bay_state.loads_of_action(run.bays.rotation))
        rows = self._of(run, actions)
        moved = bay_state.state_change(run, actions)
        acted = bay_state.Acted(self.action, np.where(np.isfinite(rows), rows, 0.0), moved)
        run = replace(run, acted=acted)
        if not loads:
            return run, 0.0
        found = agreed(loads, self.values, run, self.experiment.robot)
        acted = acted._replace(action=found.action)
        return replace(run.moved(actions.times(found.change)), bays=found.state, acted=acted), found.missing

    def differences(self, run: Run) -> list[Job]:
        """Runs beside this one, for derivatives that did not come out of it."""
        if run.derivatives is not None:
            self.differenced |= {self.exact[name]: why for name, why in run.derivatives.refused.items()}
        reference = run.trajectories or self.request.trajectories
        if not run.solved:
            return []
        for number in self.differenced:
            with suppress(ValueError):  # there is no such robot: the parameter stays where it is
                coordinate = self.request.columns[number].coordinate + self._step(number)
                self.beside[number] = self._moved(number, coordinate)
        return [Job(moved, reference) for moved in self.beside.values()]

    def _step(self, number: int) -> float:
        """Difference step of a column, within its bounds."""
        column = self.request.columns[number]
        low, high = self.problem.bounds(column.effect, column.parameter)
        z, h = column.coordinate, column.step
        return next((x for x in (h, -h) if low <= z + x <= high), max(high - z, low - z, key=abs))

    def residual(self, experiment: Experiment, run: Run) -> Array:
        """Reading less prediction over sigma, shape (n,)."""
        return self.problem.residual(experiment, run) - self.problem.shift(self.effects, self.values, run)

    def linear(self, run: Run, plain: Run, beside: Sequence[Run]) -> Linear:
        """What follows from the runs: that with balanced loads, the same as it was simulated, and those beside that."""
        by = run.derivatives
        run, plain = (replace(x, derivatives=None) for x in (run, plain))  # large, and kept by no one else
        problem, read = self.problem, partial(self.problem.readings.read, run)
        residual = self.residual(self.experiment, run)
        matrix = np.zeros((residual.size, len(self.request.columns)))
        if by is not None and by.names:
            exact = [j for j, name in enumerate(by.names) if name in self.exact]
            inputs = [j for j, name in enumerate(by.names) if name.startswith(_INPUTS)]
            both = by.part(exact), by.part(inputs).times(self.shares[None])
            numbers = [self.exact[by.names[j]] for j in exact] + self.of_inputs
            if numbers:
                matrix[:, numbers] = np.hstack([self._of(run, part) for part in both if part.names])
            if run.acted is not None:
                moved = [bay_state.state_change(run, part) for part in both]
                self._add_loads(matrix, run, numbers, np.concatenate(moved, axis=-1))
        for number, table in self.observed.items():
            values = {k: read(e) for k, e in table.experiments.items()}
            change = _difference(values, read(self.experiment), table.step)
            matrix[:, number] += problem.whitened(change / problem.sigma)
        for (number, experiment), other in zip(self.beside.items(), beside, strict=True):
            change = self.residual(self.experiment, plain) - self.residual(experiment, other)
            matrix[:, number] = change / self._step(number)
        for number, column in enumerate(self.request.columns):
            if isinstance(column.effect, ReadingCause):
                unit = {p.name: 0.0 for p in column.effect.parameters} | {column.parameter: 1.0}
                matrix[:, number] = problem.whitened(column.effect.shift(problem, run, unit) / problem.sigma)
        matrix = np.where(np.isfinite(matrix), matrix, 0.0)
        return Linear(residual, matrix, run, self.differenced)

    def _of(self, run: Run, by: RunDerivatives) -> Array:
        """Derivatives of the predictions over sigma, shape (n, P)."""
        found = self.problem.readings.derivatives(replace(run, derivatives=by), self.experiment)
        return self.problem.whitened(found / self.problem.sigma[:, None])

    def _add_loads(self, matrix: Array, run: Run, numbers: Sequence[int], moved: Array) -> None:
        """Columns of loads that depend on the state; and what those of the model add to the other columns."""
        assert run.bays is not None and run.acted is not None
        state, loads = run.bays, _loads(self.effects)
        steps, bays = state.shape
        own = {n: x.effect for n, x in enumerate(self.request.columns) if isinstance(x.effect, StateLoad)}
        which = sorted({*own, *(numbers if loads else ())})
        actions = np.zeros((len(which), steps, bays, COMPONENTS))
        for action, number in zip(actions, which, strict=True):
            if number in own:
                column = self.request.columns[number]
                action += own[number].by_value(state, column.values, column.parameter)
            if number in self.along_history:
                action -= self.along_history[number].in_frames(state.rotation).values
        stacked = np.moveaxis(actions.reshape(len(which), steps, bays * COMPONENTS), 0, -1)
        if loads:
            by_state = through_state(loads, self.values, state, moved)
            stacked[..., np.searchsorted(which, numbers)] += by_state
            stacked[:] = np.linalg.solve(coupling(loads, self.values, state, run.acted), stacked)
        matrix[:, which] += of_readings(self.problem, stacked, run.acted)


def _difference(values: Mapping[int, Array], present: Array, step: float) -> Array:
    """Derivative from values at offsets 1 and -1, or at two offsets on one side."""
    if 1 in values and -1 in values:
        return (values[1] - values[-1]) / (2.0 * step)
    side = 1 if 1 in values else -1
    return side * (2.0 * values[side] - 0.5 * values[2 * side] - 1.5 * present) / step


# ------------------------------------------------------------------------------------ loads and state


#: Loads agree with the state where less is missing: moments over EI/L, forces over EI/L^2 [1].
AGREED = 1e-8


class Agreement(NamedTuple):
    """Loads and state near a run."""

    action: Action
    change: Array  # of the action from that of the run, shape (K, 6 n_bays, 1)
    state: BayState  # with the change
    missing: float  # what the loads give beyond the action of the run, over `scale` [1]


def agreed(loads: Sequence[StateLoad], values: Point, run: Run, robot: Robot) -> Agreement:
    """Loads and state near a run that carries an action, by Newton's method.

    What depends on the rows before is right for one row more with each iteration: there are as many as rows.
    """
    assert run.bays is not None and run.acted is not None
    acted, start = run.acted, run.acted.action.in_frames(run.bays.rotation)
    shape, size = start.values.shape, scale(robot)
    change, missing, best = np.zeros((shape[0], shape[1] * COMPONENTS, 1)), list[float](), None
    while True:
        state = run.bays.corrected((acted.state @ change).reshape(shape))
        action = start.values + change.reshape(shape)
        gap = sum((e.action(state, values[e.name]) for e in loads), -action)
        missing.append(float(np.max(np.abs(gap) / size)))
        if best is None or missing[-1] <= min(missing):
            best = Agreement(Action(action, start.rotation), change, state, missing[0])
        if missing[-1] < AGREED or len(missing) > len(start.values):
            return best
        change = change + np.linalg.solve(coupling(loads, values, state, acted), gap.reshape(change.shape))


def through_state(loads: Sequence[StateLoad], values: Point, state: BayState, moved: Array) -> Array:
    """Change of the action by changes of the state, shape (K, 6 n_bays, P) both."""
    none = np.zeros((*state.shape, COMPONENTS, COMPONENTS))
    slope = sum((e.slope(state, values[e.name]) for e in loads), none)
    rows = moved.reshape(*state.shape, COMPONENTS, -1)
    return np.einsum("kbij,kbjp->kbip", slope, rows).reshape(moved.shape)


def coupling(loads: Sequence[StateLoad], values: Point, state: BayState, acted: Acted) -> Array:
    """The matrix ``I - F' H`` of every step, shape (K, 6 n_bays, 6 n_bays)."""
    through = through_state(loads, values, state, acted.state)
    return np.asarray(np.eye(through.shape[1]) - through)


def of_readings(problem: FitProblem, actions: Array, acted: Acted) -> Array:
    """Change of the predictions over sigma by actions of shape (K, 6 n_bays, q) to first order, shape (n, q)."""
    out = np.zeros((problem.count, actions.shape[-1]))
    steps = problem.readings.step
    for k in np.unique(steps):
        mine = steps == k
        out[mine] = acted.readings[mine] @ actions[k]
    return out
