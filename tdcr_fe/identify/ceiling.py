"""Ceiling: what a flexible regression of the residual removes at best on held-out steps.

A Gaussian process predicts the residual of every quantity and location from the inputs of the step, those of the step
before, the directions in which they changed, and time. It knows no mechanics. Whatever function of these it can learn
on the fitted steps and predict on the held-out ones, an effect could in principle explain; the rest is noise, or
depends on something else. Kernel and noise are chosen by cross-validation over whole branches of the fitted steps
(C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning, 2006, chapters 2 and 5).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from tdcr_fe.identify.load_steps import blocks, directions, inputs
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.identify.result import Misfit
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
    """What the regression knows of every load step."""

    groups: tuple[Array, ...]  # inputs, inputs of the step before, directions, time, shape (K, f)

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

    def among(self, steps: NDArray[np.int_]) -> StepFeatures:
        """Of some of the steps."""
        return StepFeatures(tuple(g[steps] for g in self.groups))

    def distances(self) -> list[Array]:
        """Squared distances between all steps by group, each of shape (K, K)."""
        found = []
        for group in self.groups:
            square = np.sum(group**2, axis=1)
            found.append(np.maximum(square[:, None] + square[None, :] - 2.0 * group @ group.T, 0.0))
        return found

    def kernel(self, scales: tuple[float, ...], distances: Sequence[Array] | None = None) -> Array:
        """Covariance of all steps: constant, linear in the inputs, and squared exponential, shape (K, K)."""
        known = self.distances() if distances is None else distances
        distance = np.zeros_like(known[0])
        for own, scale in zip(known, scales, strict=True):
            if np.isfinite(scale):
                distance += own / scale**2
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
    residuals = [declared.residual, best.residual]
    predicted = predicted_residuals(problem, features, residuals)
    left = [best.residual, *(r - p for r, p in zip(residuals, predicted, strict=True))]
    cost = [float(np.sum(r[problem.held_out] ** 2)) for r in left]
    return problem.misfit(left[int(np.argmin(cost))], problem.held_out)


def predicted_residuals(
    problem: FitProblem, features: StepFeatures, residuals: Sequence[Array]
) -> list[Array]:
    """Residuals over sigma that the regression predicts from the fitted readings, each by a kernel of its own.

    Parameters
    ----------
    problem
        Readings, and which are held out.
    features
        Of the steps.
    residuals
        Over sigma, each of shape (n,).
    """
    steps = problem.readings.reader.step
    fitted = np.unique(steps[problem.fitted])
    tables, index = _series(problem, residuals)
    chosen = _chosen_kernels(problem, features, fitted, tables)
    found = []
    for table, (scales, noise) in zip(np.moveaxis(tables, 2, 0), chosen, strict=True):
        kernel, out = features.kernel(scales), np.zeros(problem.count)
        for columns in _patterns(table[fitted]):
            known = fitted[np.isfinite(table[fitted][:, columns[0]])]
            if known.size:
                predicted = _regress(
                    kernel, noise, known, table[np.ix_(known, columns)], np.arange(len(table))
                )
                for j, column in enumerate(columns):
                    there = index[:, column] >= 0
                    out[index[there, column]] = predicted[there, j]
        found.append(out)
    return found


def _chosen_kernels(
    problem: FitProblem, features: StepFeatures, fitted: NDArray[np.int_], tables: Array
) -> list[tuple[tuple[float, ...], float]]:
    """Length scales and noise of each of several residuals by cross-validation; all share the factors."""
    tried = fitted[:: max(1, int(np.ceil(fitted.size / MOST_STEPS)))]
    among = features.among(tried)
    distances = among.distances()
    folds = [np.array([int(k) in fold for k in tried]) for fold in _folds(problem, fitted)]
    best: list[tuple[float, tuple[float, ...], float]] = [(np.inf, SCALES[0], NOISE[0])] * tables.shape[2]
    for scales in SCALES:
        kernel = among.kernel(scales, distances)
        for noise in NOISE:
            errors = sum(_fold_errors(kernel, noise, tables[tried], fold) for fold in folds)
            for j, error in enumerate(np.atleast_1d(errors)):
                if error < best[j][0]:
                    best[j] = (float(error), scales, noise)
    return [(scales, noise) for _, scales, noise in best]


def _series(problem: FitProblem, residuals: Sequence[Array]) -> tuple[Array, NDArray[np.int_]]:
    """Residuals by step and series, and numbers of the readings; NaN and -1 where there is none.

    Returns
    -------
    tables : ndarray, shape (K, S, R)
    index : ndarray of int, shape (K, S)
    """
    series: dict[tuple[str, object], int] = {}
    columns = [series.setdefault((r.quantity, r.location), len(series)) for r in problem.data.readings]
    index = np.full((len(problem.data.steps), len(series)), -1)
    index[problem.readings.reader.step, columns] = np.arange(problem.count)
    tables = np.stack([np.where(index >= 0, r[index], np.nan) for r in residuals], axis=2)
    return tables, index


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


def _fold_errors(kernel: Array, noise: float, tables: Array, inside: NDArray[np.bool_]) -> Array:
    """Sums of squares on the steps of a fold, predicted from the others, by residual, shape (R,).

    Parameters
    ----------
    kernel
        Of the steps, shape (K, K).
    noise
        Over the signal variance [1].
    tables
        Residuals of these steps, shape (K, S, R).
    inside
        The steps of the fold, shape (K,).
    """
    error = np.zeros(tables.shape[2])
    for columns in _patterns(tables[..., 0]):
        there = np.isfinite(tables[:, columns[0], 0])
        known, wanted = np.flatnonzero(there & ~inside), np.flatnonzero(there & inside)
        if not wanted.size:
            continue
        truth = tables[wanted][:, columns]
        predicted = np.zeros_like(truth)
        if known.size:
            values = tables[known][:, columns].reshape(known.size, -1)
            predicted = _regress(kernel, noise, known, values, wanted).reshape(truth.shape)
        error += np.sum((truth - predicted) ** 2, axis=(0, 1))
    return error
