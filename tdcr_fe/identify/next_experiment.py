"""The next experiment: a short loading sequence that parts the leading explanations, or shrinks the widest interval.

Candidates stay within the inputs that were measured: commands of measured steps, means of two of them, and tip forces
that were applied. Each starts from the unloaded robot. An explanation that fits the data as well as the best one is
parted from it by the difference of their predictions over the noise, where both may still be wrong within the
uncertainty of their parameters (T-optimality: A. C. Atkinson and V. V. Fedorov, Biometrika 62, 1975). Without such
rivals, the experiment minimises the standard error of the parameter that is known worst in proportion to its value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.identify.criteria import BIC_DIFFERENCE, bic, effective_noise
from tdcr_fe.identify.fitting import covariance
from tdcr_fe.identify.outcome import NextExperiment
from tdcr_fe.identify.problem import Fit, FitProblem, Point
from tdcr_fe.identify.reader import Reader
from tdcr_fe.identify.selection import Search, SearchState
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.loading import Load, LoadStep, resolve

Array = NDArray[np.float64]

#: Rivals, tip forces, candidates, and candidates that are looked at with the uncertainty of the parameters, at most.
RIVALS, FORCES, CANDIDATES, CLOSER = 3, 3, 40, 6


@dataclass(frozen=True)
class _Model:
    """A fitted explanation, and the covariance of its free numbers in their coordinates."""

    fit: Fit
    spread: Array

    @property
    def name(self) -> str:
        """Names of its effects."""
        return " + ".join(self.fit.names) or "the declared model"


def choose_next(search: Search, state: SearchState) -> NextExperiment | None:
    """The loading sequence that would tell most after this search; None where nothing is to be told apart or refined.

    Parameters
    ----------
    search, state
        The search and its last state, before the workers have ended.
    """
    problem, best = state.problem, state.best
    if not best.effects or not best.solved or any(name == "law" for name, _ in best.free):
        return None
    search.report("the next experiment", 0.96)
    rivals = leading_rivals(search, state)
    models = [_Model(f, covariance(problem, f)) for f in (best, *rivals)]
    sequences = candidate_sequences(problem)
    readings = [_planned(problem, len(s)) for s in sequences]
    central = [_predictions(problem, m.fit, sequences, readings) for m in models]
    usable = [i for i in range(len(sequences)) if all(np.isfinite(c[i]).all() for c in central)]
    if not usable:
        return None
    if rivals:
        rough = [min(float(np.linalg.norm(central[0][i] - c[i])) for c in central[1:]) for i in usable]
        return _parting(problem, models, sequences, readings, central, _best_of(usable, rough))
    return _shrinking(problem, models[0], sequences, readings, central[0], usable)


def leading_rivals(search: Search, state: SearchState) -> list[Fit]:
    """Fitted models of other effects that explain the data about as well as the best one, the best first."""
    problem, best = state.problem, state.best
    noise = effective_noise(problem, best, search.significance)
    mine = set(best.names)
    near = [
        (bic(problem, f), f)
        for key, f in state.fits.items()
        if f.solved
        and f.effects
        and not (mine <= key or key <= mine)
        and f.jacobian.shape[1] == len(f.free)
        and bic(problem, f) - bic(problem, best) < BIC_DIFFERENCE * noise
    ]
    return [f for _, f in sorted(near, key=lambda p: p[0])[:RIVALS]]


# ------------------------------------------------------------------------------------------------ candidates


def candidate_sequences(problem: FitProblem) -> list[tuple[LoadStep, ...]]:
    """Load, load with a tip force, and half unload, for extreme commands, means of two of them, and forces."""
    data = problem.data
    actions = resolve(data.robot, data.steps)
    commands = np.array([a.values for a in actions]).reshape(len(actions), -1)
    driven = actions[0].by_displacement
    rest = commands[int(np.argmin(np.abs(commands).sum(axis=1)))]
    extremes = [commands[int(np.argmax(commands[:, i]))] for i in range(commands.shape[1])]
    points = _distinct([*extremes, *(0.5 * (a + b) for a, b in combinations(_distinct(extremes), 2))])
    measured = np.array([a.loads["tip"].force if "tip" in a.loads else (0.0,) * 3 for a in actions])
    forces = _distinct([f for f in measured if np.linalg.norm(f) > 0.0])
    forces = sorted(forces, key=lambda f: -float(np.linalg.norm(f)))[:FORCES]
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
    found = []
    for force in forces or [none]:
        found += [(p, force) for p in points]
    found += [(rest, force) for force in forces]
    return [
        tuple(step(v, f, k) for k, (v, f) in enumerate(((p, none), (p, force), (0.5 * (p + rest), none))))
        for p, force in found[:CANDIDATES]
    ]


def _distinct(values: Sequence[Array]) -> list[Array]:
    """Values that differ, in their order."""
    found: list[Array] = []
    for v in values:
        if not any(np.allclose(v, f) for f in found):
            found.append(v)
    return found


def _planned(problem: FitProblem, steps: int) -> tuple[list[Reading], Array]:
    """What would be read in every step, as in the data, and its sigma."""
    data = problem.data
    series: dict[tuple[str, float | str | None], list[float]] = {}
    for r, sigma in zip(data.readings, problem.sigma, strict=True):
        series.setdefault((r.quantity, r.location), []).append(float(sigma))
    rows = [
        (Reading(k + 1, quantity, location, 0.0), float(np.median(sigma)))
        for k in range(steps)
        for (quantity, location), sigma in series.items()
    ]
    return [r for r, _ in rows], np.array([s for _, s in rows])


# ----------------------------------------------------------------------------------------------- predictions


def _predictions(
    problem: FitProblem,
    fit: Fit,
    sequences: Sequence[tuple[LoadStep, ...]],
    readings: Sequence[tuple[list[Reading], Array]],
    values: Point | None = None,
) -> list[Array]:
    """Predicted readings over sigma of every sequence, each from the unloaded robot."""
    experiments = []
    for steps in sequences:
        fresh = replace(problem, experiment=replace(problem.experiment, steps=steps, ends=None, restarts=()))
        experiments.append(fresh.with_effects(fit.effects, fit.values if values is None else values))
    runs = problem.solve(experiments)
    found = []
    for experiment, run, steps, (planned, sigma) in zip(experiments, runs, sequences, readings, strict=True):
        reader = Reader(planned, range(1, len(steps) + 1), problem.data.robot.tendon_names)
        found.append(reader.read(run, experiment) / sigma)
    return found


def _sensitivities(
    problem: FitProblem,
    model: _Model,
    sequences: Sequence[tuple[LoadStep, ...]],
    readings: Sequence[tuple[list[Reading], Array]],
    central: Sequence[Array],
) -> list[Array]:
    """Derivatives of the predictions by the free numbers of a model, by steps of half a standard error."""
    fit = model.fit
    by_name = {e.name: e for e in fit.effects}
    z = problem.coordinates(fit.effects, fit.values, fit.free)
    columns: list[list[Array]] = [[] for _ in sequences]
    for j, (effect, name) in enumerate(fit.free):
        low, high = problem.bounds(by_name[effect], name)
        h = 0.5 * float(np.sqrt(max(model.spread[j, j], 1e-300)))
        h = min(h, 0.1 * (high - low))
        h = h if z[j] + h <= high else -h
        moved = z.copy()
        moved[j] += h
        point = problem.point(fit.effects, fit.values, fit.free, moved)
        for i, x in enumerate(_predictions(problem, fit, sequences, readings, point)):
            columns[i].append((x - central[i]) / h)
    return [
        np.nan_to_num(np.stack(c, axis=1)) if c else np.zeros((len(x), 0))
        for c, x in zip(columns, central, strict=True)
    ]


def _best_of(usable: Sequence[int], value: Sequence[float]) -> list[int]:
    order = np.argsort(-np.array(value))[:CLOSER]
    return [usable[int(i)] for i in order]


# ------------------------------------------------------------------------------------------------ criteria


def _parting(
    problem: FitProblem,
    models: Sequence[_Model],
    sequences: Sequence[tuple[LoadStep, ...]],
    readings: Sequence[tuple[list[Reading], Array]],
    central: Sequence[Sequence[Array]],
    near: Sequence[int],
) -> NextExperiment:
    """The candidate at which the least parted rival differs most from the best model."""
    chosen = [sequences[i] for i in near]
    planned = [readings[i] for i in near]
    slopes = [
        _sensitivities(problem, m, chosen, planned, [c[i] for i in near])
        for m, c in zip(models, central, strict=True)
    ]
    values = np.zeros((len(near), len(models) - 1))
    for n, i in enumerate(near):
        for r in range(1, len(models)):
            d = central[0][i] - central[r][i]
            total = np.eye(len(d))
            for m, s in ((models[0], slopes[0][n]), (models[r], slopes[r][n])):
                total += s @ m.spread @ s.T
            values[n, r - 1] = np.sqrt(max(float(d @ np.linalg.solve(total, d)), 0.0))
    at = int(np.argmax(values.min(axis=1)))
    names = [m.name for m in models[1:]]
    listed = ", ".join(f"{name} ({v:.1f} sigma)" for name, v in zip(names, values[at], strict=True))
    return NextExperiment(
        steps=chosen[at],
        purpose=f"separates {models[0].name} from {listed}",
        separated=tuple(names),
        separation=tuple(float(v) for v in values[at]),
    )


def _shrinking(
    problem: FitProblem,
    model: _Model,
    sequences: Sequence[tuple[LoadStep, ...]],
    readings: Sequence[tuple[list[Reading], Array]],
    central: Sequence[Array],
    usable: Sequence[int],
) -> NextExperiment | None:
    """The candidate that leaves the smallest standard error of the parameter known worst."""
    fit = model.fit
    if not fit.free:
        return None
    z = problem.coordinates(fit.effects, fit.values, fit.free)
    error = np.sqrt(np.maximum(np.diag(model.spread), 0.0))
    widest = int(np.argmax(error / np.maximum(np.abs(z), 1e-300)))
    chosen = [sequences[i] for i in usable]
    planned = [readings[i] for i in usable]
    slopes = _sensitivities(problem, model, chosen, planned, [central[i] for i in usable])
    known = np.linalg.pinv(model.spread, hermitian=True)
    variance = [np.linalg.pinv(known + s.T @ s, hermitian=True)[widest, widest] for s in slopes]
    after = np.sqrt(np.array(variance, dtype=float))
    at = int(np.argmin(after))
    share = float(after[at]) / max(float(error[widest]), 1e-300)
    name = ".".join(fit.free[widest])
    return NextExperiment(
        steps=chosen[at],
        purpose=f"reduces the standard error of {name} to {share:.2g} of its present value",
        parameter=name,
        remaining_share=share,
    )
