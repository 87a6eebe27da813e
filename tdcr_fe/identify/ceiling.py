"""Ceiling: what a flexible regression of the residual removes at best on held-out steps.

A Gaussian process predicts the residual of every quantity and location from the inputs of the step, those of the step
before, the directions in which they changed, and time. It knows no mechanics. Whatever function of these it can learn
on the fitted steps and predict on the held-out ones, an effect could in principle explain; the rest is noise, or
depends on something else. Kernel and noise are chosen by cross-validation over whole branches of the fitted steps
(C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning, 2006, chapters 2 and 5).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from tdcr_fe.identify.holdout import blocks, directions, inputs
from tdcr_fe.identify.outcome import Misfit
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.io.measured import MeasuredData

Array = NDArray[np.float64]

#: Fitted steps from which the regression is tried.
FEWEST_STEPS = 8

#: Fitted steps on which the kernel is chosen, at most.
MOST_STEPS = 400

#: Folds of the cross-validation over branches.
FOLDS = 4

#: Length scales that are tried: inputs (over their largest value), inputs of the step before, directions, time (over
#: the duration); infinity leaves a group out.
SCALES = tuple(itertools.product((0.3, 1.0, 3.0), (1.0, 3.0, np.inf), (1.0, 3.0, np.inf), (0.3, 1.0, np.inf)))

#: Ratios of noise to signal variance that are tried [1].
NOISE = (1e-4, 1e-2, 0.3)


@dataclass(frozen=True)
class StepFeatures:
    """What the regression knows of every load step.

    Attributes
    ----------
    groups : tuple of ndarray, each of shape (K, f)
        Inputs, inputs of the step before, directions, time.
    """

    groups: tuple[Array, ...]

    @classmethod
    def of(cls, data: MeasuredData) -> StepFeatures:
        """Of a loading sequence."""
        table = inputs(data)
        before = np.concatenate((np.zeros_like(table[:1]), table[:-1]))
        times = np.array([np.nan if s.time is None else s.time for s in data.steps])
        known = np.isfinite(times)
        clock = np.arange(len(times), dtype=float)
        if known.any():
            clock = np.interp(clock, np.flatnonzero(known), times[known])
        clock = clock / max(float(clock.max(initial=0.0)), 1e-300)
        return cls((table, before, directions(data).astype(float), clock[:, None]))

    def kernel(self, scales: tuple[float, ...]) -> Array:
        """Covariance of all steps: constant, linear in the inputs, and squared exponential, shape (K, K)."""
        distance = np.zeros((len(self.groups[0]),) * 2)
        for group, scale in zip(self.groups, scales, strict=True):
            if np.isfinite(scale):
                square = np.sum(group**2, axis=1)
                gap = square[:, None] + square[None, :] - 2.0 * group @ group.T
                distance += np.maximum(gap, 0.0) / scale**2
        table = self.groups[0]
        return np.asarray(np.exp(-0.5 * distance) + table @ table.T + 1.0)


def held_out_ceiling(problem: FitProblem, declared: Fit, best: Fit) -> Misfit | None:
    """Held-out misfit that a flexible regression of the residual leaves at best.

    Of the declared model's and the final model's residual, with and without regression, that which the regression
    predicts best: a ceiling for what any effect can remove, as far as this regression can tell.

    Parameters
    ----------
    problem
        Readings, and which are held out.
    declared, best
        The declared and the final model.

    Returns
    -------
    Misfit or None
        None where no steps are held out, or too few are fitted.
    """
    steps = problem.readings.reader.step
    fitted = np.unique(steps[problem.fitted])
    if not np.any(problem.held_out) or fitted.size < FEWEST_STEPS or not (declared.solved and best.solved):
        return None
    features = StepFeatures.of(problem.data)
    left = [best.residual]
    for fit in (declared, best):
        left.append(fit.residual - predicted_residual(problem, features, fit.residual))
    cost = [float(np.sum(r[problem.held_out] ** 2)) for r in left]
    return problem.misfit(left[int(np.argmin(cost))], problem.held_out)


def predicted_residual(problem: FitProblem, features: StepFeatures, residual: Array) -> Array:
    """Residual over sigma that the regression predicts from the fitted readings, shape (n,)."""
    steps = problem.readings.reader.step
    fitted = np.unique(steps[problem.fitted])
    series = _series(problem, residual)
    best: tuple[float, Array, float] | None = None
    folds = _folds(problem, fitted)
    every = max(1, int(np.ceil(fitted.size / MOST_STEPS)))
    for scales in SCALES:
        kernel = features.kernel(scales)
        for noise in NOISE:
            error = sum(_fold_error(kernel, noise, series, fitted[::every], fold) for fold in folds)
            if best is None or error < best[0]:
                best = (error, kernel, noise)
    assert best is not None
    _, kernel, noise = best
    out = np.zeros(problem.count)
    table, index = series
    for columns in _patterns(table[fitted]):
        known = fitted[np.isfinite(table[fitted][:, columns[0]])]
        if known.size:
            predicted = _regress(kernel, noise, known, table[np.ix_(known, columns)], np.arange(len(table)))
            for j, column in enumerate(columns):
                there = index[:, column] >= 0
                out[index[there, column]] = predicted[there, j]
    return out


def _series(problem: FitProblem, residual: Array) -> tuple[Array, NDArray[np.int_]]:
    """Residuals and numbers of the readings by step and series; NaN and -1 where there is none, shape (K, S)."""
    series: dict[tuple[str, object], int] = {}
    columns = [series.setdefault((r.quantity, r.location), len(series)) for r in problem.data.readings]
    table = np.full((len(problem.data.steps), len(series)), np.nan)
    index = np.full(table.shape, -1)
    for i, (k, column) in enumerate(zip(problem.readings.reader.step, columns, strict=True)):
        table[k, column], index[k, column] = residual[i], i
    return table, index


def _folds(problem: FitProblem, fitted: NDArray[np.int_]) -> list[set[int]]:
    """Fitted steps in groups of whole branches; single steps where there are fewer branches than groups."""
    chosen = set(fitted.tolist())
    parts = [p for b in blocks(problem.data) if (p := [k for k in b if k in chosen])]
    if len(parts) < FOLDS:
        parts = [[int(k)] for k in fitted]
    return [{k for b in parts[n::FOLDS] for k in b} for n in range(FOLDS)]


def _patterns(table: Array) -> list[list[int]]:
    """Columns with readings in the same steps, together."""
    found: dict[bytes, list[int]] = {}
    for column in range(table.shape[1]):
        found.setdefault(np.isfinite(table[:, column]).tobytes(), []).append(column)
    return list(found.values())


def _regress(
    kernel: Array, noise: float, known: NDArray[np.int_], values: Array, wanted: NDArray[np.int_]
) -> Array:
    """Mean of the process at some steps, from its values at others."""
    factor = cho_factor(kernel[np.ix_(known, known)] + noise * np.eye(known.size), lower=True)
    return np.asarray(kernel[np.ix_(wanted, known)] @ cho_solve(factor, values))


def _fold_error(
    kernel: Array, noise: float, series: tuple[Array, NDArray[np.int_]], fitted: NDArray[np.int_], fold: set[int]
) -> float:  # fmt: skip
    """Sum of squares on the steps of a fold, predicted from the other fitted steps."""
    table = series[0]
    inside = np.array([int(k) in fold for k in fitted])
    error = 0.0
    for columns in _patterns(table[fitted]):
        there = np.isfinite(table[fitted][:, columns[0]])
        known, wanted = fitted[there & ~inside], fitted[there & inside]
        if not wanted.size:
            continue
        truth = table[np.ix_(wanted, columns)]
        predicted = np.zeros_like(truth)
        if known.size:
            predicted = _regress(kernel, noise, known, table[np.ix_(known, columns)], wanted)
        error += float(np.sum((truth - predicted) ** 2))
    return error
