"""The next experiment: a short loading sequence that separates the leading explanations, or narrows an interval.

Candidates stay within the inputs that were measured: commands of measured steps, means of two of them, and tip forces
that were applied. Each starts from the unloaded robot. An explanation that fits the data as well as the best one is
separated from it by the difference of their predictions over the noise, where both may still be wrong within the
uncertainty of their parameters (T-optimality: A. C. Atkinson and V. V. Fedorov, Biometrika 62, 1975). Without such
rivals, the experiment minimises the standard error of the parameter that is known worst in proportion to its value.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.identify.causes import BesideDescription
from tdcr_fe.identify.derivatives import Linear, Request, linearized
from tdcr_fe.identify.fitting import columns_of, covariance
from tdcr_fe.identify.forward import advance
from tdcr_fe.identify.noise import series
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.identify.result import NextExperiment
from tdcr_fe.identify.rows import tip_forces
from tdcr_fe.identify.search_state import Search, SearchState, as_good
from tdcr_fe.model.loading import Load, LoadStep, resolve

#: Rivals, and tip forces, at most; and candidates.
MOST, CANDIDATES = 3, 10


class _Model(NamedTuple):
    """A fitted explanation, and the covariance of its free numbers in their coordinates."""

    fit: Fit
    spread: Array


def choose_next(search: Search, state: SearchState) -> NextExperiment | None:
    """The loading sequence that helps most after this search; None where nothing is to be separated or refined.

    Parameters
    ----------
    search, state
        The search and its last state, before the workers have ended.

    Raises
    ------
    OutOfTime
        The time limit has passed.
    """
    problem, best = state.problem, state.best
    if not best.effects or not best.solved or not _described(best):
        return None
    search.report("the next experiment", 0.96)
    models = [_Model(f, covariance(problem, f)) for f in (best, *leading_rivals(state))]
    judge = _parting if len(models) > 1 else _shrinking
    planned = [_planned(problem, steps) for steps in candidate_sequences(problem)]
    if not planned:  # nothing differs between the steps
        return None
    rough = judge(models, [p.rough for p in planned])
    for i, _ in sorted(rough, key=lambda x: -x[1].value):
        for _, exact in judge(models, [planned[i]]):
            return exact
    return None


def leading_rivals(state: SearchState) -> list[Fit]:
    """Fitted models of other effects that explain the data about as well as the best one, the best first."""
    mine = set(state.best.names)
    near = [f for f in as_good(state) if f.effects and _described(f)]
    return [f for f in near if not (mine <= set(f.names) or set(f.names) <= mine)][:MOST]


def _described(fit: Fit) -> bool:
    """Whether all causes of a model are in its description."""
    return not any(isinstance(e, BesideDescription) for e in fit.effects)


# ------------------------------------------------------------------------------------------------ candidates


def candidate_sequences(problem: FitProblem) -> list[tuple[LoadStep, ...]]:
    """Load, load with a tip force, and half unload, for extreme commands, means of two of them, and forces."""
    data = problem.data
    actions = resolve(data.robot, data.steps)
    commands = np.array([a.values for a in actions]).reshape(len(actions), -1)
    driven = actions[0].by_displacement
    rest = commands[int(np.argmin(np.abs(commands).sum(axis=1)))]
    ends = [*np.argmax(commands, axis=0), *np.argmin(commands, axis=0)[np.min(commands, axis=0) < 0.0]]
    extremes = _distinct([commands[int(k)] for k in ends if not np.array_equal(commands[int(k)], rest)])
    points = _distinct([*extremes, *(0.5 * (a + b) for a, b in itertools.combinations(extremes, 2))])
    forces = _distinct([f for f in tip_forces(actions) if np.linalg.norm(f) > 0.0])
    forces = sorted(forces, key=lambda f: -float(np.linalg.norm(f)))[:MOST]
    names, length = data.robot.tendon_names, data.robot.backbone.length
    timed = [s.time for s in data.steps if s.time is not None]
    pace = max(timed) / max(1, len(data.steps)) if timed else None

    def step(values: Array, force: Array, number: int) -> LoadStep:
        tensions = {n: float(v) for n, v, d in zip(names, values, driven, strict=True) if not d}
        displacements = {n: float(v) for n, v, d in zip(names, values, driven, strict=True) if d}
        x, y, z = (float(f) for f in force)
        time = None if pace is None else float(pace * (number + 1))
        loads = {"tip": Load(length, (x, y, z))}
        return LoadStep(tensions=tensions, displacements=displacements, loads=loads, time=time)

    none = np.zeros(3)
    found = [(rest, force) for force in forces] + [(p, force) for force in forces or [none] for p in points]
    chosen = [((p, none), (p, force), (0.5 * (p + rest), none)) for p, force in found[:CANDIDATES]]
    return [tuple(step(v, f, k) for k, (v, f) in enumerate(sequence)) for sequence in chosen]


def _distinct(values: Sequence[Array]) -> list[Array]:
    """Values that differ, in their order."""
    found: list[Array] = []
    for v in values:
        if not any(np.allclose(v, f, atol=0.0) for f in found):
            found.append(v)
    return found


def _planned(problem: FitProblem, steps: tuple[LoadStep, ...]) -> FitProblem:
    """The problem with a loading sequence in place of its own: in every step, all that was measured would be read."""
    data = problem.data
    typical = [(data.readings[i[0]], float(np.median(problem.sigma[i]))) for i in series(data.readings)]
    each = itertools.product(range(len(steps)), typical)
    readings = tuple(replace(r, step=k + 1, value=0.0, sigma=sigma) for k, (r, sigma) in each)
    ids, branches = tuple(range(1, len(steps) + 1)), ("next",) * len(steps)
    fresh = replace(data, step_ids=ids, steps=steps, branches=branches, readings=readings, parts=())
    sigma, fitted = np.array([r.sigma for r in readings]), np.zeros(len(readings), dtype=bool)
    planned = FitProblem.of(fresh, sigma, fitted, problem.forward, problem.path_tolerance)
    experiment = replace(problem.experiment, steps=steps, ends=(), restarts=())
    return replace(planned, experiment=experiment, catalogue=problem.catalogue, deadline=problem.deadline)


# ------------------------------------------------------------------------------------------------ criteria


#: A candidate that all models solve, with its number.
_Judged = tuple[int, NextExperiment]


def _solved(planned: Sequence[FitProblem], models: Sequence[_Model]) -> Iterator[tuple[int, list[Linear]]]:
    """Number of every sequence that all models solve, and what each predicts with derivatives by its free numbers."""
    work = []
    for p, model in itertools.product(planned, models):
        fit, half = model.fit, 0.5 * np.sqrt(np.maximum(np.diag(model.spread), 1e-300))
        columns = columns_of(fit.effects, fit.values, fit.free, half)
        work.append(linearized(p, Request(fit.effects, fit.values, columns, record=False)))
    found = advance(work, planned[0].run)
    for i in range(len(planned)):
        own = found[i * len(models) : (i + 1) * len(models)]
        if all(linear.run.solved for linear in own):
            yield i, own


def _parting(models: Sequence[_Model], planned: Sequence[FitProblem]) -> Iterator[_Judged]:
    """Candidates by how far they separate the rivals from the best model, over noise and uncertainty [sigma]."""
    for i, (best, *others) in _solved(planned, models):
        apart = {}
        for model, other in zip(models[1:], others, strict=True):
            d, total = other.residual - best.residual, np.eye(best.residual.size)
            for linear, spread in ((best, models[0].spread), (other, model.spread)):
                total += linear.matrix @ spread @ linear.matrix.T
            apart[model.fit.title] = float(np.sqrt(max(float(d @ np.linalg.solve(total, d)), 0.0)))
        listed = ", ".join(f"{name} ({v:.1f} sigma)" for name, v in apart.items())
        if min(apart.values()) > 0.0:
            purpose = f"separates {models[0].fit.title} from {listed}"
            yield i, NextExperiment(planned[i].data.steps, purpose, apart)


def _shrinking(models: Sequence[_Model], planned: Sequence[FitProblem]) -> Iterator[_Judged]:
    """Candidates by how much they reduce the standard error of the parameter that is known worst by its value."""
    (model,) = models
    fit = model.fit
    if not fit.free:
        return
    z = planned[0].coordinates(fit.effects, fit.values, fit.free)
    error = np.sqrt(np.maximum(np.diag(model.spread), 1e-300))
    widest = int(np.argmax(error / np.maximum(np.abs(z), 1e-300)))
    effect, parameter = fit.free[widest]
    known = np.linalg.pinv(model.spread, hermitian=True)
    for i, (linear,) in _solved(planned, models):
        left = np.linalg.pinv(known + linear.matrix.T @ linear.matrix, hermitian=True)[widest, widest]
        share = float(np.sqrt(left) / error[widest])
        percent, name = f"{100.0 * (1.0 - share):.0f}", f"{effect}.{parameter}"
        if int(percent) > 0:
            purpose = f"narrows the interval of {parameter} ({effect}) by {percent} %"
            yield i, NextExperiment(planned[i].data.steps, purpose, parameter=name, remaining_share=share)
