"""Scatter of the inputs that would account for the residual: an error of every input, another one in every step.

Tensions that are computed from the torque of a motor, or displacements from its encoder, are wrong by some percent, and
by another amount each time. No effect predicts that, but the readings show it: the residual of a step then lies in the
few directions in which the inputs of this step move the robot. With the derivatives ``B`` of the readings of a step by
its inputs, the residual is ``r = B a + e``, with ``a ~ N(0, t^2)`` for every input and ``e ~ N(0, s^2)`` for every
reading over its sigma. Both variances are those of the largest likelihood; that of ``a`` counts where the likelihood
falls much without it (D. A. Harville, J. Am. Stat. Assoc. 72, 1977, 320-338: components of variance).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import chdtri

from tdcr_fe.effects import Experiment
from tdcr_fe.identify.findings import InputScatter, ScatterKind
from tdcr_fe.identify.forward import Job
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.identify.simulate_run import last_parts
from tdcr_fe.model.loading import resolve

Array = NDArray[np.float64]

#: Chance of reporting scatter that is not there [1].
SIGNIFICANCE = 1e-4

#: The rms residual over sigma must fall at least to this share of it [1].
MOST_REMAINING = 0.8

#: Largest relative error of an input that is called scatter [1]; beyond, something else is wrong.
LARGEST = 0.25

#: Largest mean of the errors over the standard error of a mean; beyond, the errors are systematic [1].
LARGEST_MEAN = 3.5

#: Range of the ratio of the variances that is searched, as exponents of ten, over that at which both matter alike.
EXPONENTS = (-6.0, 6.0)


class _Block(NamedTuple):
    """One step: its readings, the residual in the directions of its inputs, and how strong these are.

    Attributes
    ----------
    readings : ndarray of int, shape (r,)
    left, right : ndarray, shape (r, q), (q, q)
        Singular vectors of the derivatives.
    strength : ndarray, shape (q,)
        Singular values.
    along : ndarray, shape (q,)
        Residual in the directions of ``left``.
    rest : float
        Sum of squares of the residual across them.
    """

    readings: NDArray[np.int_]
    left: Array
    strength: Array
    right: Array
    along: Array
    rest: float


def find_input_scatter(problem: FitProblem, fit: Fit) -> InputScatter | None:
    """Scatter of the inputs that would account for the residual of a model.

    Parameters
    ----------
    problem
        Readings and forward model.
    fit
        The model.

    Returns
    -------
    InputScatter or None
        None where it would account for little, the errors would be systematic or larger than scatter is, or the model
        was not solved.

    Raises
    ------
    OutOfTime
        The deadline of the problem has passed.
    """
    if not fit.solved:
        return None
    experiment = problem.with_effects(fit.effects, fit.values)
    by_input = _input_response(problem, fit, experiment)
    values, displaced = _inputs(experiment)
    steps = problem.readings.reader.step
    found = [_likeliest(problem, fit, by_input * values[steps], "relative", "1")]
    driven = np.any(values != 0.0, axis=0)
    if len(set(displaced[driven].tolist())) == 1:
        unit = "m" if displaced[driven][0] else "N"
        found.append(_likeliest(problem, fit, by_input * (values[steps] != 0.0), "absolute", unit))
    best = max(found, key=lambda x: x.likelihood)
    if best.likelihood < 0.5 * chdtri(1, SIGNIFICANCE) or best.systematic:
        return None
    size = best.scatter.size
    relative = size if best.scatter.kind == "relative" else size / float(np.max(np.abs(values)))
    before, after = best.scatter.before.chi2_per_dof, best.scatter.after.chi2_per_dof
    if relative > LARGEST or after > MOST_REMAINING**2 * before:
        return None
    return best.scatter


class _Candidate(NamedTuple):
    """Scatter of one kind, the gain of its logarithmic likelihood, and whether its errors have a mean."""

    scatter: InputScatter
    likelihood: float
    systematic: bool


def _likeliest(problem: FitProblem, fit: Fit, derivatives: Array, kind: ScatterKind, unit: str) -> _Candidate:
    """The variances of the largest likelihood, for inputs whose errors change the readings over sigma by these."""
    blocks = _blocks(problem, fit.residual, derivatives)
    usual = float(np.median(np.concatenate([b.strength for b in blocks]) ** 2)) if blocks else 0.0
    usual = max(usual, 1e-300)

    def cost(exponent: float) -> float:
        return -_log_likelihood(blocks, 10.0**exponent / usual)

    found = minimize_scalar(cost, bounds=EXPONENTS, method="bounded", options={"xatol": 1e-3})
    ratio = 10.0 ** float(found.x) / usual
    errors = [b.right.T @ (b.along * ratio * b.strength / (1.0 + ratio * b.strength**2)) for b in blocks]
    left = fit.residual.copy()
    for b, a in zip(blocks, errors, strict=True):
        left[b.readings] -= b.left @ (b.strength * (b.right @ a))
    everything = np.ones(left.size, dtype=bool)
    scatter = InputScatter(
        kind,
        float(np.sqrt(ratio * _noise_variance(blocks, ratio))),
        unit,
        problem.misfit(fit.residual, everything),
        problem.misfit(left, everything),
    )
    gain = _log_likelihood(blocks, ratio) - _log_likelihood(blocks, 0.0)
    return _Candidate(scatter, gain, _is_systematic(errors))


def _is_systematic(errors: Sequence[Array]) -> bool:
    """Whether the errors have a mean that differs from zero: then a listed effect of the actuation is meant."""
    each = np.concatenate(errors) if errors else np.zeros(0)
    each = each[each != 0.0]
    if each.size < 2:
        return True
    return bool(abs(np.mean(each)) > LARGEST_MEAN * np.std(each) / np.sqrt(each.size))


def _blocks(problem: FitProblem, residual: Array, derivatives: Array) -> list[_Block]:
    """One block for every step with readings."""
    steps = problem.readings.reader.step
    found = []
    for k in np.unique(steps):
        own = np.flatnonzero(steps == k)
        active = np.any(derivatives[own] != 0.0, axis=0)
        left, strength, right = np.linalg.svd(derivatives[np.ix_(own, active)], full_matrices=False)
        along = left.T @ residual[own]
        found.append(
            _Block(own, left, strength, right, along, float(residual[own] @ residual[own] - along @ along))
        )
    return found


def _noise_variance(blocks: Sequence[_Block], ratio: float) -> float:
    """The likeliest variance of the readings over sigma, where that of the inputs is in this ratio to it."""
    squares = sum(b.rest + float(np.sum(b.along**2 / (1.0 + ratio * b.strength**2))) for b in blocks)
    return squares / sum(b.readings.size for b in blocks)


def _log_likelihood(blocks: Sequence[_Block], ratio: float) -> float:
    """Of the residual, at the likeliest variance of the readings, but for a constant."""
    count = sum(b.readings.size for b in blocks)
    spread = sum(float(np.sum(np.log1p(ratio * b.strength**2))) for b in blocks)
    return -0.5 * (count * float(np.log(max(_noise_variance(blocks, ratio), 1e-300))) + spread)


def _inputs(experiment: Experiment) -> tuple[Array, NDArray[np.bool_]]:
    """Inputs of all commanded steps, shape (K, n_tendons), and which tendons are driven by displacement."""
    actions = resolve(experiment.robot, experiment.steps)
    chosen = [actions[j] for j in last_parts(experiment)]
    return np.array([a.values for a in chosen]), np.any([a.by_displacement for a in chosen], axis=0)


def _input_response(problem: FitProblem, fit: Fit, experiment: Experiment) -> Array:
    """Derivatives of the readings over sigma by the inputs of their own step, shape (n, n_tendons)."""
    from tdcr_fe.solve.sensitivities.parameters import StepInput

    names = experiment.robot.tendon_names
    inputs = tuple(StepInput(f"inputs.{name}", tendon=i) for i, name in enumerate(names))
    reference = fit.run if fit.run.trajectory is not None else None
    job = Job(experiment, reference, False, inputs)
    (run,) = problem.forward.run_jobs([job], problem.path_tolerance, problem.deadline)
    derivatives = problem.readings.reader.derivatives(run, experiment) / problem.sigma[:, None]
    found: Array = np.where(np.isfinite(derivatives), derivatives, 0.0)
    return found
