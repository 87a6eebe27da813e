"""The frozen problem of an identification: readings, noise, held-out rows, discretisation, and fitted models."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from tdcr_fe.effects import EFFECTS, Effect, ExcitationRange, Experiment
from tdcr_fe.elements import Array, Flags, Index
from tdcr_fe.identify.bay_state import with_action
from tdcr_fe.identify.causes import ReadingCause, is_named
from tdcr_fe.identify.forward import ForwardModel, Job
from tdcr_fe.identify.result import Misfit
from tdcr_fe.identify.rows import RowChoice
from tdcr_fe.identify.run import Readings, Run
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.model.loading import LoadStep

#: Values of parameters, by effect and parameter name.
Point = dict[str, dict[str, float]]
#: Free parameters: names of effect and parameter.
Free = Sequence[tuple[str, str]]

#: Noise reaches so many standard deviations: residuals beyond it count less than by their squares, and statistics of
#: residuals beyond it are none of noise [1].
NOISE_REACHES = 4.0

#: Tolerated discretisation error, rms over sigma: too small to become significant with hundreds of readings.
MESH = 0.1

#: Elements per bay, at most.
FINEST = 6

#: Assumed order of the discretisation error; four where bending is small.
ORDER = 3.2


@dataclass(frozen=True, eq=False)
class FitProblem:
    """Readings, their sigma, and the forward model that predicts them. Never written to: `refine` gives a new one."""

    data: MeasuredData
    readings: Readings
    forward: ForwardModel  # solves experiments
    sigma: Array  # standard uncertainty of every reading, in its unit, shape (n,)
    held_out: Flags  # shape (n,)
    experiment: Experiment  # the declared one, with the mesh that is used
    path_tolerance: float  # of the solver, over the length [1]
    robust_threshold: float  # residuals over sigma count in full up to this [1]
    correction: Array  # extrapolated discretisation error, added to the residual over sigma, shape (n,)
    mesh_error: float = 0.0  # estimated discretisation error, rms over sigma [1]
    # typical step of a parameter in its fitted coordinate, by effect and parameter; from the score tests
    scales: Mapping[tuple[str, str], float] = field(default_factory=dict)
    catalogue: tuple[Effect, ...] = EFFECTS  # the candidates, in the order in which several are applied
    # for every step with readings: their indices, and the square root of their covariance over sigma, since errors of
    # the inputs move all readings of a step together; empty where there are no such errors, or none are known
    roots: tuple[tuple[Index, Array], ...] = ()
    # reading of `tdcr_fe.identify.settings.clock` at which simulations end with `OutOfTime` [s]
    deadline: float = math.inf

    @classmethod
    def of(
        cls, data: MeasuredData, sigma: Array, held_out: Flags, forward: ForwardModel, path_tolerance: float
    ) -> FitProblem:
        """The problem of a data set, with one element per bay; only declared effects divide its load steps."""
        readings = Readings.of(data.readings, data.step_ids, data.robot.tendon_names)
        experiment, correction = with_elements(data.experiment, 1), np.zeros(len(data.readings))
        given = data, readings, forward, sigma, held_out, experiment, path_tolerance
        return cls(*given, robust_threshold=NOISE_REACHES, correction=correction)

    def of_rows(self, rows: RowChoice) -> FitProblem:
        """The same problem on chosen load steps, with the declared model."""
        index, data = np.array(rows.readings), rows.of(self.data)
        sigma, held_out = self.sigma[index], self.held_out[index]
        fresh = FitProblem.of(data, sigma, held_out, self.forward, self.path_tolerance)
        at = {i: k for k, i in enumerate(rows.readings)}
        roots = tuple((np.array([at[i] for i in own]), root) for own, root in self.roots if own[0] in at)
        return replace(fresh, catalogue=self.catalogue, roots=roots, deadline=self.deadline)

    @property
    def elements(self) -> int:
        """Elements of its mesh in every bay."""
        return int(np.max(self.experiment.model.elements_per_bay))

    @property
    def count(self) -> int:
        """Number of readings."""
        return len(self.data.readings)

    @property
    def fitted(self) -> Flags:
        """Readings that are fitted, shape (n,)."""
        return ~self.held_out

    # ------------------------------------------------------------------ predictions

    def with_effects(self, effects: Sequence[Effect], values: Point) -> Experiment:
        """The experiment with effects, applied in the order of the catalogue, unlisted ones last."""
        order = {e.name: i for i, e in enumerate(self.catalogue)}
        ordered = sorted(effects, key=lambda e: order.get(e.listed, len(order)))
        every = tuple((e, tuple(values[e.name].items())) for e in ordered)
        return _applied(self, every).with_sequences(join_steps)

    def acted(self, effects: Sequence[Effect], values: Point, run: Run) -> Experiment:
        """The experiment with effects, and the action that a run carries as loads."""
        found = self.with_effects(effects, values)
        return found if run.acted is None else with_action(found, run.acted.action)

    @property
    def rough(self) -> FitProblem:
        """With each step solved as a whole, whatever its friction path, which suffices to order candidates."""
        steps = tuple(replace(step, substeps=1) for step in self.experiment.steps)
        return replace(self, experiment=replace(self.experiment, steps=steps))

    def run(self, jobs: Sequence[Job]) -> list[Run]:
        """Simulate jobs; see `ForwardModel.run`."""
        return self.forward.run(jobs, self.path_tolerance, self.deadline)

    def residual(self, experiment: Experiment, run: Run) -> Array:
        """Reading less prediction over sigma, shape (n,)."""
        predicted = self.readings.read(run, experiment)
        return self.whitened((self.readings.values - predicted) / self.sigma) + self.correction

    def whitened(self, x: Array) -> Array:
        """Readings over sigma, so that their noise is independent and of one sigma, with errors of the inputs."""
        found = np.array(x) if self.roots else x
        for own, root in self.roots:
            found[own] = np.linalg.solve(root, x[own])
        return found

    def lengths(self, r: Array) -> Array:
        """Residuals over sigma in the units of the readings, shape (n,) or (n, P)."""
        found = np.array(r)
        for own, root in self.roots:
            found[own] = root @ r[own]
        return (found.T * self.sigma).T

    @property
    def whole_sigma(self) -> Array:
        """Standard deviation of every reading with what the errors of the inputs add, in its unit, shape (n,)."""
        found = np.ones(self.count)
        for own, root in self.roots:
            found[own] = np.linalg.norm(root, axis=1)
        return found * self.sigma

    def shift(self, effects: Sequence[Effect], values: Point, run: Run) -> Array:
        """What causes in the readings themselves add to the predictions of a run over sigma, shape (n,)."""
        shifts = (e.shift(self, run, values[e.name]) for e in effects if isinstance(e, ReadingCause))
        return self.whitened(sum(shifts, np.zeros(self.count)) / self.sigma)

    # ------------------------------------------------------------------ measures

    def cost(self, r: Array) -> tuple[float, float]:
        """Robust sums of squares over fitted and held-out readings; infinite where a prediction is missing."""
        if not np.all(np.isfinite(r)):
            return float("inf"), float("inf")
        c = huber(r, self.robust_threshold)
        return float(np.sum(c[~self.held_out])), float(np.sum(c[self.held_out]))

    def with_residual(self, fit: Fit, r: Array) -> Fit:
        """A fit with another residual over sigma, and its cost by the measures of this problem."""
        cost, held_cost = self.cost(r)
        return replace(fit, residual=r, cost=cost, held_cost=held_cost)

    def root_weights(self, r: Array) -> Array:
        """Square roots of the weights that make squares of the residual robust, shape (n,)."""
        return np.sqrt(np.minimum(1.0, self.robust_threshold / np.maximum(np.abs(r), 1e-300)))

    def misfit(self, r: Array, which: Flags | None = None, parameters: int = 0) -> Misfit:
        """Misfit of residuals over sigma on some readings; None: on all."""
        raw, which = self.lengths(r), np.full(self.count, True) if which is None else which
        angles = raw[which & self.readings.is_angle]
        p = which & self.readings.is_position
        marker = np.unique(self.readings.markers[p], return_inverse=True)[1]
        distance = np.sqrt(np.bincount(marker, weights=raw[p] ** 2))

        def rms(x: Array) -> float:
            return float(np.sqrt(np.mean(x**2)))

        count, quantities = int(np.count_nonzero(which)), self.readings.quantities
        names = dict.fromkeys(quantities[which].tolist())
        return Misfit(
            rms_position=rms(distance) if distance.size else None,
            rms_angle=rms(angles) if angles.size else None,
            max_position=float(np.max(distance)) if distance.size else None,
            chi2_per_dof=float(np.sum(r[which] ** 2) / max(1, count - parameters)),
            count=count,
            rms_by_quantity={q: rms(raw[which & (quantities == q)]) for q in names},
        )

    def excitation_range(self, run: Run) -> ExcitationRange:
        """Excitation range of the data."""
        bend = np.linalg.norm(run.element_curvature[..., :2], axis=-1)
        commanded = [t for s in self.data.steps for t in s.tensions.values()]
        needed = float(np.nanmax(run.base_tensions, initial=1e-6))
        moved = [abs(d) for s in self.data.steps for d in s.displacements.values()]
        wound = float(np.nanmax(np.abs(run.displacements), initial=1e-9))
        most = max([*commanded, needed]), max([*moved, wound])
        times = [s.time for s in self.data.steps if s.time is not None]
        return ExcitationRange(*most, float(np.nanmax(bend, initial=1e-6)), max(times, default=0.0))

    # ------------------------------------------------------------------ coordinates

    def bounds(self, e: Effect, name: str) -> tuple[float, float]:
        """Bounds of a parameter's coordinate."""
        p = next(p for p in e.parameters if p.name == name)
        a, b = (p.coordinate(x) for x in e.bounds(self.experiment)[name])
        return min(a, b), max(a, b)

    def limits(self, effects: Sequence[Effect], free: Free) -> Array:
        """Bounds of the coordinates of the free parameters, shape (p, 2)."""
        by_name = {e.name: e for e in effects}
        return np.array([self.bounds(by_name[e], p) for e, p in free]).reshape(-1, 2)

    def coordinates(self, effects: Sequence[Effect], values: Point, free: Free) -> Array:
        """Fitted numbers of the free parameters, shape (p,)."""
        parameter = {(e.name, p.name): p for e in effects for p in e.parameters}
        return np.array([parameter[k].coordinate(values[k[0]][k[1]]) for k in free])

    def moved(self, effects: Sequence[Effect], values: Point, free: Free, change: Array) -> Point:
        """Values with the coordinates of the free parameters changed, within their bounds."""
        parameter = {(e.name, p.name): p for e in effects for p in e.parameters}
        new = {k: dict(v) for k, v in values.items()}
        z = self.coordinates(effects, values, free) + change
        for k, x in zip(free, np.clip(z, *self.limits(effects, free).T), strict=True):
            new[k[0]][k[1]] = parameter[k].value(float(x))
        return new


#: An effect and its values.
_WithValues = tuple[Effect, tuple[tuple[str, float], ...]]


@lru_cache
def _applied(problem: FitProblem, every: tuple[_WithValues, ...]) -> Experiment:
    """The experiment with effects, in this order; kept, since derivatives by other effects begin with the same ones.

    Actuator loss alone took a tenth of the time of an identification with it.
    """
    if not every:
        return problem.experiment
    *before, (e, values) = every
    return _applied(problem, tuple(before)).with_sequences(lambda part: e.apply(part, dict(values)))


def huber(r: Array, threshold: float) -> Array:
    """Contribution of every residual to the robust sum of squares."""
    a = np.abs(r)
    return np.where(a <= threshold, a**2, 2.0 * threshold * a - threshold**2)


@dataclass(frozen=True, eq=False)
class Fit:
    """A model with its parameters fitted."""

    effects: tuple[Effect, ...]  # in the order of adding
    values: Point  # by effect and parameter
    residual: Array  # reading less model, over sigma, of all readings, shape (n,)
    # Robust sums of squares over fitted and held-out readings
    cost: float
    held_cost: float
    jacobian: Array  # of the predictions over sigma, by coordinate of every free parameter, shape (n, p)
    free: tuple[tuple[str, str], ...]  # effect and name of every free parameter
    run: Run
    path_residual: Array  # that of the run that has chosen the substeps, shape (n,)
    pruned: bool = False  # whether the fit was stopped because it could not come near the best
    stuck: bool = False  # whether no step from it leads down that the linear model says is worth one

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(e.name for e in self.effects)

    @property
    def title(self) -> str:
        """Its effects in one line."""
        return " + ".join(self.names) or "the declared model"

    @property
    def named(self) -> bool:
        """Whether no cause is an unlisted one."""
        return all(map(is_named, self.effects))

    @property
    def solved(self) -> bool:
        """Whether every reading is predicted."""
        return bool(np.isfinite(self.cost + self.held_cost))


def evaluate(problem: FitProblem, effects: Sequence[Effect], values: Point) -> Fit:
    """A model at given values, nothing fitted."""
    (run,) = problem.run([Job(problem.with_effects(effects, values), record=True)])
    return fit_of_run(problem, effects, values, run)


def fit_of_run(problem: FitProblem, effects: Sequence[Effect], values: Point, run: Run) -> Fit:
    """A model at given values, nothing fitted, of which there is a run."""
    r = problem.residual(problem.with_effects(effects, values), run) - problem.shift(effects, values, run)
    return Fit(tuple(effects), values, r, *problem.cost(r), np.zeros((r.size, 0)), (), run, r)


def refine(problem: FitProblem, effects: Sequence[Effect], values: Point, run: Run) -> tuple[FitProblem, Run]:
    """Refine the mesh until its error stays below the noise near a point.

    A run with one element per bay more, which takes the same substeps, shows whether the mesh matters: two runs that
    divide the load steps each in its own way differ by the error of their paths as well. Elements are added until the
    error, which falls with a power of their number, is small. The remaining error is extrapolated and subtracted.

    Parameters
    ----------
    problem
        Readings, with the mesh so far.
    effects, values
        The model.
    run
        Its run, with its path.

    Returns
    -------
    problem : FitProblem
    run : Run
        The run of the model on the mesh of that problem; the given one where nothing was changed, so that earlier
        predictions still count.
    """
    problem = replace(problem, correction=np.zeros(problem.count))

    def with_model(count: int) -> Experiment:
        """With so many elements a bay, the model, and the loads of its run."""
        meshed = replace(problem, experiment=with_elements(problem.experiment, count))
        return meshed.acted(effects, values, run)

    n = problem.elements
    here = problem.residual(with_model(n), run)
    finer = with_model(n + 1)
    (other,) = problem.run([Job(finer, run.trajectories)])
    change = problem.residual(finer, other) - here
    change = np.where(np.isfinite(change), change, 0.0)
    share = 1.0 - (n / (n + 1.0)) ** ORDER
    mesh_error = float(np.sqrt(np.mean(change**2))) / share
    if mesh_error <= MESH:  # extrapolated only where it is small, so that its law is known
        return replace(problem, mesh_error=mesh_error, correction=change / share), run
    if n >= FINEST:
        return replace(problem, mesh_error=mesh_error), run
    more = min(FINEST, max(n + 1, int(np.ceil(n * (mesh_error / MESH) ** (1.0 / ORDER)))))
    experiment = with_elements(problem.experiment, more)
    (again,) = problem.run([Job(with_model(more), run.trajectories, True)])
    problem = replace(problem, mesh_error=mesh_error * (n / more) ** ORDER, experiment=experiment)
    return problem, replace(again, acted=run.acted)


def join_steps(experiment: Experiment) -> Experiment:
    """Join the parts into which effects have divided commanded steps, where no state depends on those before.

    Without friction the robot has no history: what counts is the end of a commanded step. Effects that have a history
    of their own, such as backlash, have acted already.

    Parameters
    ----------
    experiment
        One loading sequence, with all its effects.

    Returns
    -------
    Experiment
        The same one where there is friction, or effects divide nothing.
    """
    if experiment.model.friction != "none" or len(experiment.whole_steps) == len(experiment.steps):
        return experiment
    steps, passed = [], LoadStep()
    for step, (_, factor) in zip(experiment.steps, experiment.ends, strict=True):
        passed = step.after(passed)
        if factor == 1.0:
            steps.append(passed)
            passed = LoadStep()
    return replace(experiment, steps=tuple(steps), ends=())


def with_elements(experiment: Experiment, count: int) -> Experiment:
    """The same with so many elements a bay."""
    return replace(experiment, model=replace(experiment.model, elements_per_bay=count))
