"""Explainable variance: what a flexible regression of the residual removes at best on held-out steps.

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
from scipy.spatial.distance import cdist

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

    def kernel(self, scales: tuple[float, ...]) -> Array:
        """Covariance of all steps: constant, linear in the inputs, and squared exponential, shape (K, K)."""
        table = self.groups[0]
        distance = np.zeros((len(table), len(table)))
        for group, scale in zip(self.groups, scales, strict=True):
            if np.isfinite(scale):
                distance += cdist(group, group, "sqeuclidean") / scale**2
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
    index, tables = _series(problem, residuals)
    there, is_fitted = index >= 0, np.isin(np.arange(len(index)), fitted)
    found = []
    for table, (scales, noise) in zip(
        tables, _chosen_kernels(problem, features, fitted, tables), strict=True
    ):
        out = np.zeros(problem.count)
        out[index[there]] = _regress(features.kernel(scales), noise, table, is_fitted)[there]
        found.append(out)
    return found


def _chosen_kernels(
    problem: FitProblem, features: StepFeatures, fitted: NDArray[np.int_], tables: Sequence[Array]
) -> list[tuple[tuple[float, ...], float]]:
    """Length scales and noise of each of several residuals by cross-validation; all share the factors."""
    tried = fitted[:: max(1, int(np.ceil(fitted.size / MOST_STEPS)))]
    among = features.among(tried)
    folds = [np.isin(tried, fold) for fold in _folds(problem, fitted)]
    values = np.concatenate([table[tried] for table in tables], axis=1)
    best = [(np.inf, SCALES[0], NOISE[0])] * len(tables)
    for scales in SCALES:
        kernel = among.kernel(scales)
        for noise in NOISE:
            left = values.copy()
            for fold in folds:
                left[fold] -= _regress(kernel, noise, values, ~fold)[fold]
            errors = np.nansum(left**2, axis=0).reshape(len(tables), -1).sum(axis=1)
            for j, error in enumerate(errors.tolist()):
                if error < best[j][0]:
                    best[j] = (error, scales, noise)
    return [(scales, noise) for _, scales, noise in best]


def _series(problem: FitProblem, residuals: Sequence[Array]) -> tuple[NDArray[np.int_], list[Array]]:
    """Numbers of the readings by step and series, -1 where there is none, shape (K, S); residuals, NaN there."""
    series: dict[tuple[str, object], int] = {}
    columns = [series.setdefault((r.quantity, r.location), len(series)) for r in problem.data.readings]
    index = np.full((len(problem.data.steps), len(series)), -1)
    index[problem.readings.reader.step, columns] = np.arange(problem.count)
    return index, [np.where(index >= 0, r[index], np.nan) for r in residuals]


def _folds(problem: FitProblem, fitted: NDArray[np.int_]) -> list[list[int]]:
    """Fitted steps in groups of whole branches; single steps where there are fewer branches than groups."""
    chosen = set(fitted.tolist())
    parts = [p for b in blocks(problem.data) if (p := [k for k in b if k in chosen])]
    if len(parts) < FOLDS:
        parts = [[int(k)] for k in fitted]
    return [[k for b in parts[n::FOLDS] for k in b] for n in range(FOLDS)]


def _regress(kernel: Array, noise: float, table: Array, known: NDArray[np.bool_]) -> Array:
    """Mean of the process at all steps, from the values at some of them, shape (K, S); NaN: no value there."""
    out = np.zeros_like(table)
    patterns, which = np.unique(np.isfinite(table) & known[:, None], axis=1, return_inverse=True)
    for j, there in enumerate(patterns.T):
        if there.any():
            columns = which.ravel() == j
            own = kernel[np.ix_(there, there)] + noise * np.eye(int(there.sum()))
            weights = cho_solve(cho_factor(own, lower=True), table[np.ix_(there, columns)])
            out[:, columns] = kernel[:, there] @ weights
    return out
