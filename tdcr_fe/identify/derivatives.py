"""Predictions with their derivatives by parameters of effects: exact from one run, or differences where there are none.

How a derivative is taken follows from what the parameter changes:

- the observation only (a turned instrument, markers off the backbone): central differences of the reading of one run;
- robot, model or loading sequence: the solver's sensitivities, exact along the history, all in one run;
- where there are none (the mesh or the division of the load steps changes, or the effect declares so): the difference
  of two runs, named in `Linear.differenced`.
"""

from __future__ import annotations

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Effect, Experiment
from tdcr_fe.identify.forward import Job
from tdcr_fe.identify.problem import FitProblem, Point
from tdcr_fe.identify.run import Run
from tdcr_fe.solve.sensitivities.differences import RELATIVE_STEP, Tabulated, same_structure, tabulated
from tdcr_fe.solve.sensitivities.parameters import ModelParameter

Array = NDArray[np.float64]

#: Difference step of parameters of the observation, over their typical change [1].
OBSERVATION_STEP = 1e-2

#: One model is divided among processes where it has at least so many columns.
FEWEST_DIVIDED = 12


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
    """Linearise several models, all runs at a time."""
    return linearize_each([(problem, request) for request in requests])


def linearize_each(pairs: Sequence[tuple[FitProblem, Request]]) -> list[Linear]:
    """Linearise several models, each of a problem of its own.

    Forward model, path tolerance and deadline are those of the first. With several processes each model is linearised
    in one of them. A single one with many columns is divided where its run follows another one, so that to repeat the
    run costs little.
    """
    if not pairs:
        return []
    forward = pairs[0][0].forward
    problem, request = pairs[0]
    along = request.reference is not None and len(request.columns) >= FEWEST_DIVIDED
    if forward.parallel and len(pairs) == 1 and along:
        parts = [request.columns[k :: forward.processes] for k in range(forward.processes)]
        found = _in_processes([(problem, request._replace(columns=part)) for part in parts])
        if found is not None:
            return [_joined(found)]
    if forward.parallel and len(pairs) > 1:
        found = _in_processes(pairs)
        if found is not None:
            return found
    return _linearize_here(pairs)


def _linearize_here(pairs: Sequence[tuple[FitProblem, Request]]) -> list[Linear]:
    """Linearise models; only their runs are shared among processes."""
    first = pairs[0][0]
    given = [_part_or_impossible(problem, request) for problem, request in pairs]
    parts = [x for x in given if isinstance(x, _Part)]
    runs = first.run([p.job for p in parts])
    beside = [p.differences(run) for p, run in zip(parts, runs, strict=True)]
    found = iter(first.run([job for jobs in beside for job in jobs]))
    solved = iter(
        [
            part.linear(run, [next(found) for _ in jobs])
            for part, run, jobs in zip(parts, runs, beside, strict=True)
        ]
    )
    return [next(solved) if isinstance(x, _Part) else x for x in given]


def _part_or_impossible(problem: FitProblem, request: Request) -> _Part | Linear:
    """A model to be simulated; or what an impossible robot gives, as two laws of the material that exclude each other.

    Such a model counts as not solved, with the reason as its message.
    """
    try:
        return _Part(problem, request)
    except ValueError as error:
        run = Run.of((), len(problem.data.steps), problem.experiment, str(error))
        nothing = np.full(problem.count, np.nan)
        return Linear(nothing, np.zeros((problem.count, len(request.columns))), run, {})


def _in_processes(pairs: Sequence[tuple[FitProblem, Request]]) -> list[Linear] | None:
    """Linearise models, each in a process; None where one cannot be sent there, as an effect of one's own."""
    forward = pairs[0][0].forward
    alone = forward.alone()
    try:
        texts = [pickle.dumps((replace(problem, forward=alone), request)) for problem, request in pairs]
    except (pickle.PicklingError, AttributeError, TypeError):
        return None
    if any(not type(e).__module__.startswith("tdcr_fe.") for problem, _ in pairs for e in problem.catalogue):
        return None
    found = forward.map(_linearize_sent, texts)
    for _, runs, iterations in found:
        forward.runs += runs
        forward.iterations += iterations
    for (problem, request), (linear, *_) in zip(pairs, found, strict=True):
        if request.reference is None and linear.run.solved:
            forward.keep(problem.with_effects(request.effects, request.values), request.record, linear.run)
    return [linear for linear, *_ in found]


def _linearize_sent(text: bytes) -> tuple[Linear, int, int]:
    """A model that was sent to this process, linearised; and the numbers of runs and of iterations that took."""
    problem, request = pickle.loads(text)
    (linear,) = _linearize_here([(problem, request)])
    return linear, problem.forward.runs, problem.forward.iterations


def _joined(parts: Sequence[Linear]) -> Linear:
    """One model from parts that have every n-th of its columns each."""
    n = len(parts)
    matrix = np.zeros((parts[0].residual.size, sum(p.matrix.shape[1] for p in parts)))
    differenced: dict[int, str] = {}
    for k, part in enumerate(parts):
        matrix[:, k::n] = part.matrix
        differenced |= {n * j + k: why for j, why in part.differenced.items()}
    return parts[0]._replace(matrix=matrix, differenced=dict(sorted(differenced.items())))


class _Part:
    """One model: what is simulated for it, and what follows."""

    def __init__(self, problem: FitProblem, request: Request) -> None:
        self.problem, self.request = problem, request
        self.effects, self.values = self._at_null()
        self.experiment = problem.with_effects(self.effects, self.values)
        self.observed: dict[int, Tabulated] = {}
        self.differenced: dict[int, str] = {}
        self.exact: dict[str, int] = {}
        self.beside: dict[int, Experiment] = {}
        tables = []
        for number, column in enumerate(request.columns):
            if not column.effect.exact_derivatives:
                self.differenced[number] = "it declares no exact derivatives"
                continue
            table = self._table(number)
            neighbours = list(table.experiments.values())
            if not neighbours:
                self.differenced[number] = table.refused
            elif all(_same_robot(self.experiment, e) for e in neighbours):
                self.observed[number] = self._table(number, OBSERVATION_STEP)
            else:
                name = f"{number} {column.effect.name}.{column.parameter}"
                self.exact[name] = number
                tables.append(
                    ModelParameter(name, table.value, table.step / RELATIVE_STEP, table, approximate=True)
                )
        self.job = Job(self.experiment, request.reference, request.record, tuple(tables))

    def _at_null(self) -> tuple[tuple[Effect, ...], Point]:
        """The model with those effects of the columns whose null values add inputs that act nowhere, such as loads."""
        effects, values = list(self.request.effects), dict(self.request.values)
        plain = self.problem.with_effects(effects, values)
        for column in self.request.columns:
            if column.effect.name in values:
                continue
            more = {**values, column.effect.name: dict(column.values)}
            if not same_structure(
                plain.steps, self.problem.with_effects([*effects, column.effect], more).steps
            ):
                effects, values = [*effects, column.effect], more
                plain = self.problem.with_effects(effects, values)
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
        return self.problem.with_effects([*effects, e], {**self.values, e.name: own})

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
        residual = problem.residual(self.experiment, run)
        matrix = np.zeros((residual.size, len(self.request.columns)))
        if run.derivatives is not None and run.derivatives.names:
            found = problem.readings.reader.derivatives(run, self.experiment)
            for name, column in zip(run.derivatives.names, found.T, strict=True):
                matrix[:, self.exact[name]] = column / problem.sigma
        for number, table in self.observed.items():
            values = {k: read(e) for k, e in table.experiments.items()}
            matrix[:, number] = _difference(values, read(self.experiment), table.step) / problem.sigma
        for (number, moved), other in zip(self.beside.items(), beside, strict=True):
            matrix[:, number] = (residual - problem.residual(moved, other)) / self._step(number)
        matrix = np.where(np.isfinite(matrix), matrix, 0.0)
        return Linear(residual, matrix, replace(run, derivatives=None), self.differenced)


def _difference(values: Mapping[int, Array], present: Array, step: float) -> Array:
    """Derivative from values at offsets 1 and -1, or at two offsets on one side."""
    if 1 in values and -1 in values:
        return (values[1] - values[-1]) / (2.0 * step)
    side = 1 if 1 in values else -1
    return side * (2.0 * values[side] - 0.5 * values[2 * side] - 1.5 * present) / step


def _same_robot(a: Experiment, b: Experiment) -> bool:
    """Whether two experiments differ in the observation at most."""
    return (a.robot, a.model, a.steps, a.ends) == (b.robot, b.model, b.steps, b.ends)
