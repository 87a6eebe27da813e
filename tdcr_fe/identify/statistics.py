"""Statistics of a fit: goodness, correlations, profiles of the parameters, and a regression of the residual."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from tdcr_fe.identify import fitting
from tdcr_fe.identify.causes import ReadingCause
from tdcr_fe.identify.load_steps import blocks, directions, inputs
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.identify.result import IdentificationResult, Misfit, Profile
from tdcr_fe.identify.settings import OutOfTime
from tdcr_fe.io.measured import MeasuredData

Array = NDArray[np.float64]

#: Where a profile is computed, in standard errors from the fit [1].
DISTANCES = np.array([-2.0, -1.0, 1.0, 2.0])


def goodness(misfit: Misfit, variables: int) -> dict[str, float]:
    """Statistics of a fit by name; the two information criteria as lmfit defines them.

    Parameters
    ----------
    misfit
        On the fitted readings.
    variables
        How many numbers were fitted.
    """
    n = misfit.count
    chi2 = misfit.chi2_per_dof * max(1, n - variables)
    likelihood = n * math.log(chi2 / n) if n and chi2 > 0.0 else math.nan
    return {
        "chi-square": chi2,
        "reduced chi-square": misfit.chi2_per_dof,
        "Akaike (AIC)": likelihood + 2.0 * variables,
        "Bayesian (BIC)": likelihood + math.log(max(n, 1)) * variables,
    }


def correlated(result: IdentificationResult, least: float) -> list[tuple[float, str, str]]:
    """Correlations of fitted parameters of more than a size, with both names, the largest first."""
    names, found = result.parameters.names, result.parameters.correlation
    pairs = [(float(found[i, j]), names[i], names[j]) for j in range(len(names)) for i in range(j)]
    return sorted((p for p in pairs if abs(p[0]) > least), key=lambda pair: -abs(pair[0]))


# ------------------------------------------------------------------------------------------------------ profiles


def profiles(problem: FitProblem, fit: Fit) -> tuple[Profile, ...]:
    """Likelihood profiles of all free parameters of a fit: how the misfit grows as one is moved and the others follow.

    Where a parameter is normally distributed, the misfit grows with the square of the distance in standard errors.
    Where it is not, its 95 % interval is that of the profile (Bates and Watts, Nonlinear Regression Analysis, Sec.
    6.1). The others follow along the ridge that the covariance gives, so that a profile takes four runs. Those for
    which the time of the problem does not suffice are left out.
    """
    spread = fitting.covariance(problem, fit)
    deviation = np.sqrt(np.maximum(np.diag(spread), 0.0))
    by_name = {e.name: e for e in fit.effects}
    z = problem.coordinates(fit.effects, fit.values, fit.free)
    limits = np.array([problem.bounds(by_name[k[0]], k[1]) for k in fit.free]).reshape(-1, 2)
    weights = problem.root_weights(fit.residual)[problem.fitted]
    jacobian = fit.jacobian[problem.fitted] * weights[:, None]
    found = []
    for i, key in enumerate(fit.free):
        if not deviation[i] > 0.0 or isinstance(by_name[key[0]], ReadingCause):  # the latter are linear
            continue
        step = spread[:, i] / deviation[i]
        ridge = z + DISTANCES[:, None] * step
        inside = np.all((ridge >= limits[:, 0]) & (ridge <= limits[:, 1]), axis=1)
        points = [problem.point(fit.effects, fit.values, fit.free, x) for x in ridge[inside]]
        fits = [fitting.evaluated(problem, fit.effects, p, (), fit) for p in points]
        try:
            cost = np.array([x.cost for x in fitting.run_fits(problem, fits)])
        except OutOfTime:
            break
        # In units of the growth by one standard error where the model is linear.
        growth = np.sqrt(np.maximum(cost - fit.cost, 0.0)) / np.linalg.norm(jacobian @ step)
        roots = np.append(np.sign(DISTANCES[inside]) * growth, 0.0)
        values = np.array([p[key[0]][key[1]] for p in (*points, fit.values)])
        order = np.argsort(values)
        order = order[np.isfinite(roots[order])]
        found.append(Profile(".".join(key), values[order], roots[order]))
    return tuple(found)


# ---------------------------------------------------------------------------------- what a regression explains

#: Fitted steps from which the regression is tried, those on which its kernel is chosen at most, and the folds of the
#: cross-validation over branches.
FEWEST_STEPS, MOST_STEPS, FOLDS = 8, 400, 4
#: Length scales that are tried: inputs (over their largest value), inputs of the step before, directions, time (over
#: the duration); infinity leaves a group out. And ratios of noise to signal variance [1].
SCALES = tuple(itertools.product((0.3, 1.0, 3.0), (1.0, 3.0, np.inf), (1.0, np.inf), (0.3, 1.0, np.inf)))
NOISE = (1e-4, 1e-2, 0.3)


def held_out_ceiling(problem: FitProblem, declared: Fit, best: Fit) -> Misfit | None:
    """Held-out misfit that a flexible regression of the residual leaves.

    A Gaussian process predicts the residual of every quantity and location from the inputs of the step, those of the
    step before, the directions in which they changed, and time. It knows no mechanics. What it can learn on the fitted
    steps and predict on the held-out ones, an effect could in principle explain (C. E. Rasmussen, C. K. I. Williams,
    Gaussian Processes for Machine Learning, 2006, chapters 2 and 5). Of the declared model's and the final model's
    residual, with and without regression, that which is smallest; None where no steps are held out, or too few fitted.
    """
    fitted = np.unique(problem.readings.reader.step[problem.fitted])
    if not np.any(problem.held_out) or fitted.size < FEWEST_STEPS or not (declared.solved and best.solved):
        return None
    residuals = [declared.residual, best.residual]
    predicted = predicted_residuals(problem, residuals)
    left = [best.residual, *(r - p for r, p in zip(residuals, predicted, strict=True))]
    cost = [float(np.sum(r[problem.held_out] ** 2)) for r in left]
    return problem.misfit(left[int(np.argmin(cost))], problem.held_out)


def predicted_residuals(problem: FitProblem, residuals: list[Array]) -> list[Array]:
    """Residuals over sigma that the regression predicts from the fitted readings, each by a kernel of its own.

    A reading that is missing counts as no residual. The kernel is chosen by cross-validation over whole branches.
    """
    steps, data = problem.readings.reader.step, problem.data
    series: dict[tuple[str, object], int] = {}
    column = np.array([series.setdefault((r.quantity, r.location), len(series)) for r in data.readings])
    tables = np.zeros((len(residuals), len(data.steps), len(series)))
    for table, residual in zip(tables, residuals, strict=True):
        table[steps, column] = residual
    groups, fitted = _features(data), np.unique(steps[problem.fitted])
    tried = fitted[:: max(1, math.ceil(fitted.size / MOST_STEPS))]
    folds = _folds(data, tried)
    errors: list[list[tuple[float, Array, float]]] = [[] for _ in residuals]
    for scales in SCALES:
        kernel = _kernel(groups, scales)
        for noise in NOISE:
            left = tables.copy()
            for fold in folds:
                left[:, fold] -= _regress(kernel, noise, tables, np.setdiff1d(tried, fold))[:, fold]
            for found, table in zip(errors, left[:, tried], strict=True):
                found.append((float(np.sum(table**2)), kernel, noise))
    chosen = [min(found, key=lambda x: x[0]) for found in errors]
    return [
        _regress(kernel, noise, table[None], fitted)[0][steps, column]
        for table, (_, kernel, noise) in zip(tables, chosen, strict=True)
    ]


def _features(data: MeasuredData) -> tuple[Array, ...]:
    """What the regression knows of every step: inputs, those of the step before, directions, time; shape (K, f)."""
    table = inputs(data)
    before = np.concatenate((np.zeros_like(table[:1]), table[:-1]))
    times = np.array([np.nan if s.time is None else s.time for s in data.steps])
    known, clock = np.isfinite(times), np.arange(len(times), dtype=float)
    if known.any():
        clock = np.interp(clock, np.flatnonzero(known), times[known])
    clock = clock / max(float(clock.max(initial=0.0)), 1e-300)
    return table, before, directions(data).astype(float), clock[:, None]


def _kernel(groups: tuple[Array, ...], scales: tuple[float, ...]) -> Array:
    """Covariance of all steps: constant, linear in the inputs, and squared exponential, shape (K, K)."""
    distance = sum(
        cdist(group, group, "sqeuclidean") / scale**2 for group, scale in zip(groups, scales, strict=True)
    )
    return np.asarray(np.exp(-0.5 * distance) + groups[0] @ groups[0].T + 1.0)


def _folds(data: MeasuredData, steps: NDArray[np.int_]) -> list[NDArray[np.int_]]:
    """Steps in groups of whole branches; of single steps where there are fewer branches than groups."""
    parts = [part for b in blocks(data) if (part := np.intersect1d(b, steps)).size]
    if len(parts) < FOLDS:
        parts = [np.array([k]) for k in steps]
    return [np.concatenate(parts[n::FOLDS]) for n in range(FOLDS)]


def _regress(kernel: Array, noise: float, tables: Array, known: NDArray[np.int_]) -> Array:
    """Mean of the process at all steps, from the values at the known ones, shape (R, K, S)."""
    own = kernel[np.ix_(known, known)] + noise * np.eye(known.size)
    return np.asarray(kernel[:, known] @ np.linalg.solve(own, tables[:, known]))
