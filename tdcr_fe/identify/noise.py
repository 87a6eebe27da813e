"""What a residual is: tests for noise, sigma, and what a regression explains of it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial.distance import cdist
from scipy.special import chdtrc, ndtr, ndtri

from tdcr_fe.elements import Array, Index
from tdcr_fe.identify.problem import NOISE_REACHES, Fit, FitProblem
from tdcr_fe.identify.result import Misfit, Structure
from tdcr_fe.identify.rows import blocks, directions, inputs, progress_along, read_rows
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.readings import Reading

#: The group of all readings in `structure`.
ALL_READINGS = "all readings"

#: A reading with a residual above this many sigma (of the remaining misfit, where that is larger) is an outlier.
OUTLIER = 5.0


def series(readings: Sequence[Reading]) -> list[Index]:
    """Indices of the readings of each quantity and location, in their order."""
    found: dict[tuple[str, float | str | None], list[int]] = {}
    for i, r in enumerate(readings):
        found.setdefault((r.quantity, r.location), []).append(i)
    return [np.array(i) for i in found.values()]


def estimate_sigma(data: MeasuredData, residual: Array) -> Array:
    """Sigma of every reading, in its unit, shape (n,): as given, or the scatter of the residual about smooth curves.

    The scatter is taken robustly from second differences along the steps, over all readings of the same kind.

    Parameters
    ----------
    data
        Readings.
    residual
        Reading less model, in the readings' units, shape (n,).
    """
    sigma = np.array([math.nan if r.sigma is None else r.sigma for r in data.readings])
    missing = np.isnan(sigma)
    family = np.array([r.channel.family for r in data.readings])
    for kind in set(family[missing].tolist()):
        own = [i for i in series(data.readings) if family[i[0]] == kind and i.size >= 3]
        seconds = [np.diff(residual[i], 2) for i in own]
        values = np.concatenate(seconds) if seconds else residual[family == kind]
        values = values[np.isfinite(values)]
        scatter = robust_scatter(values) / (math.sqrt(6.0) if seconds else 1.0)
        known = data.readings[int(np.flatnonzero(family == kind)[0])].channel
        floor = known.plausible(data.robot.backbone.length).resolution
        sigma[missing & (family == kind)] = max(scatter, floor)
    return sigma


def robust_scatter(values: Array) -> float:
    """Standard deviation of normally distributed values about zero, which few others hardly change; zero of none."""
    return 1.4826 * float(np.median(np.abs(values))) if values.size else 0.0


def clipped(r: Array) -> Array:
    """Residuals clipped to the range of noise, so that a few outliers do not dominate its tests."""
    return np.clip(r, -NOISE_REACHES, NOISE_REACHES)


def chi_square_z_score(r: Array, parameters: int = 0) -> float:
    """Sum of squares against noise of unit variance, as a z-score (robust: residuals are clipped)."""
    p = float(chdtrc(max(1, r.size - parameters), float(np.sum(clipped(r) ** 2))))
    return float(-ndtri(max(p, 1e-300)))


def lag1_autocorrelation(data: MeasuredData, r: Array) -> float:
    """Autocorrelation of the residual between neighbouring steps, over all quantities and locations [1]."""
    parts = [r[i] for i in series(data.readings) if i.size >= 2]
    size = sum(float(np.sum(x[1:] ** 2 + x[:-1] ** 2)) for x in parts) / 2.0
    return sum(float(np.sum(x[1:] * x[:-1])) for x in parts) / size if size > 0.0 else 0.0


def structure(data: MeasuredData, r: Array, parameters: int = 0) -> tuple[Structure, ...]:
    """Tests of a residual over sigma: by quantity, location, tendon, branch, load, step; autocorrelation and signs.

    Parameters
    ----------
    data
        Readings.
    r
        Residual over sigma, shape (n,).
    parameters
        How many were fitted.

    Returns
    -------
    tuple of Structure
        The most significant first.
    """
    c, readings, tendons = clipped(r), data.readings, data.robot.tendon_names
    step = read_rows(data)
    places = sorted({x.location for x in readings if isinstance(x.location, float)})
    table, moves = inputs(data), directions(data)
    loaded = np.abs(table[:, len(tendons) :]).max(axis=1) > 0.0
    groups = {ALL_READINGS: np.ones(r.size, dtype=bool)}
    for q in dict.fromkeys(x.quantity for x in readings):
        groups[f"quantity {q}"] = np.array([x.quantity == q for x in readings])
    groups |= {f"at s = {s:g} m": np.array([x.location == s for x in readings]) for s in places}
    for i, name in enumerate(tendons):
        groups[f"tendon {name} pulled"] = (table[:, i] > 0.3)[step]
        groups[f"tendon {name} being pulled"] = (moves[:, i] > 0)[step]
        groups[f"tendon {name} being let out"] = (moves[:, i] < 0)[step]
    groups |= {"loaded at the tip": loaded[step], "not loaded at the tip": ~loaded[step]}
    groups |= {f"step {number}": step == k for k, number in enumerate(data.step_ids)}
    tests, share = [], 1.0 - parameters / max(r.size, parameters + 1)
    for group, mask in groups.items():
        n = int(np.count_nonzero(mask))
        if n >= 5:
            p = float(chdtrc(n * share, float(np.sum(c[mask] ** 2))))
            tests.append(Structure(group, float(-ndtri(max(p, 1e-300))), p))
    long = [own for own in series(readings) if own.size >= 4]
    if long:
        products = np.concatenate([c[own][1:] * c[own][:-1] for own in long])
        signs = "equal signs in neighbouring steps"
        for group, x in (("neighbouring steps (correlation)", products), (signs, np.sign(products))):
            z = float(np.sum(x) / math.sqrt(x.size))
            tests.append(Structure(group, z, float(ndtr(-z))))
    for own in long:
        first, z = readings[int(own[0])], abs(float(np.sum(c[own]) / math.sqrt(own.size)))
        at = "" if first.location is None else f" at {first.location}"
        tests.append(Structure(f"mean of {first.quantity}{at}", z, float(2.0 * ndtr(-z))))
    return tuple(sorted(tests, key=lambda t: t.p_value))


#: Chance of adding a cause to data that miss nothing, over all candidates, and of finding structure in noise [1].
SIGNIFICANCE = 1e-3


def is_noise(tests: Sequence[Structure]) -> bool:
    """Whether no test is significant, with Bonferroni's correction for their number."""
    return all(t.p_value * len(tests) > SIGNIFICANCE for t in tests)


def outliers(r: Array) -> tuple[tuple[int, float], ...]:
    """Indices of outliers, and their residual over sigma."""
    scale = max(1.0, robust_scatter(r))
    return tuple((int(i), float(r[i])) for i in np.flatnonzero(np.abs(r) > OUTLIER * scale))


#: Chance of reporting a group of readings in which nothing is left, or what differs from step to step and is not there
#: [1].
REPORTED = 1e-4

# ---------------------------------------------------------------------------------- what a regression explains

#: Steps on which the kernel of the regression is chosen at most, and the folds of its cross-validation over branches.
#: It is tried where each fold has two fitted steps.
MOST_STEPS, FOLDS = 400, 4
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
    fitted = np.unique(problem.readings.step[problem.fitted])
    if not np.any(problem.held_out) or fitted.size < 2 * FOLDS or not (declared.solved and best.solved):
        return None
    residuals = [declared.residual, best.residual]
    left = [best.residual, *(r - predicted_residual(problem, r) for r in residuals)]
    cost = [float(np.sum(r[problem.held_out] ** 2)) for r in left]
    return problem.misfit(left[int(np.argmin(cost))], problem.held_out)


def predicted_residual(problem: FitProblem, residual: Array) -> Array:
    """Residual over sigma that the regression predicts from the fitted readings.

    A reading that is missing counts as no residual. The kernel is chosen by cross-validation over whole branches.
    """
    steps, data = problem.readings.step, problem.data
    column, each = np.zeros(steps.size, dtype=int), series(data.readings)
    for number, own in enumerate(each):
        column[own] = number
    table = np.zeros((len(data.steps), len(each)))
    table[steps, column] = residual
    groups, fitted = _features(data), np.unique(steps[problem.fitted])
    tried = fitted[:: max(1, math.ceil(fitted.size / MOST_STEPS))]
    folds = _folds(data, tried)

    def missed(kernel: Array, noise: float) -> float:
        known = [_regress(kernel, noise, table, np.setdiff1d(tried, fold)) for fold in folds]
        return sum(float(np.sum((table - own)[fold] ** 2)) for own, fold in zip(known, folds, strict=True))

    kernels = (_kernel(groups, scales) for scales in SCALES)  # one at a time: they are large
    kernel, noise = min(((k, n) for k in kernels for n in NOISE), key=lambda x: missed(*x))
    return _regress(kernel, noise, table, fitted)[steps, column]


def _features(data: MeasuredData) -> tuple[Array, ...]:
    """What the regression knows of every step: inputs, those of the step before, directions, time; shape (K, f)."""
    table = inputs(data)
    before = np.concatenate((np.zeros_like(table[:1]), table[:-1]))
    return table, before, directions(data).astype(float), progress_along(data.steps)[:, None]


def _kernel(groups: tuple[Array, ...], scales: tuple[float, ...]) -> Array:
    """Covariance of all steps: constant, linear in the inputs, and squared exponential, shape (K, K)."""
    each = zip(groups, scales, strict=True)
    distance = sum(cdist(group, group, "sqeuclidean") / scale**2 for group, scale in each)
    return np.asarray(np.exp(-0.5 * distance) + groups[0] @ groups[0].T + 1.0)


def _folds(data: MeasuredData, steps: Index) -> list[Index]:
    """Steps in groups of whole branches; of single steps where there are fewer branches than groups."""
    parts = [part for b in blocks(data) if (part := np.intersect1d(b, steps)).size]
    if len(parts) < FOLDS:
        parts = [np.array([k]) for k in steps]
    return [np.concatenate(parts[n::FOLDS]) for n in range(FOLDS)]


def _regress(kernel: Array, noise: float, table: Array, known: Index) -> Array:
    """Mean of the process at all steps, from the values at the known ones, shape (K, S)."""
    own = kernel[np.ix_(known, known)] + noise * np.eye(known.size)
    return np.asarray(kernel[:, known] @ np.linalg.solve(own, table[known]))
