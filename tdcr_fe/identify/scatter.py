"""What differs from step to step: errors of the inputs, a shift of all positions, or a force, and how large they are.

The values of every step are normally distributed with one variance. Its ratio to that of the readings is the likeliest
one (D. J. C. MacKay, Bayesian interpolation, Neural Computation 4, 1992); the values are then the most probable ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import chdtri, fdtrc

from tdcr_fe.effects import Effect, Experiment
from tdcr_fe.identify.bay_state import COMPONENTS, FORCE, Action, action_inputs, end_of_bay, with_action
from tdcr_fe.identify.criteria import NOISE_Z_SCORE
from tdcr_fe.identify.forward import Job, last_parts
from tdcr_fe.identify.noise import SIGNIFICANCE, chi_square_z_score
from tdcr_fe.identify.problem import Fit, FitProblem, Point
from tdcr_fe.identify.result import Scatter
from tdcr_fe.identify.run import Run, Trajectories
from tdcr_fe.model.loading import resolve

Array = NDArray[np.float64]

#: Chance of calling errors systematic that follow nothing [1].
FOLLOWS = 1e-3

#: So many standard errors beyond that of normal errors, the kurtosis tells that errors are rare and large [1].
KURTOSIS = 5.0

#: The rms residual over sigma must fall at least to this share of it, and the relative error of an input be at most so
#: large; beyond, something else is wrong [1].
MOST_REMAINING, LARGEST = 0.8, 0.25

#: Range of the ratio of the variances that is searched, as exponents of ten, over that at which both matter alike.
EXPONENTS = (-6.0, 6.0)

#: Places of a force that are simulated with the forces of first order, which does not separate neighbours: beside a
#: force on the tip, 40 sigma off, the disk before it came first.
PLACES = 3


class _Source(NamedTuple):
    """What may be different in every step."""

    # See `Scatter`
    what: str
    unit: str
    residual: Array  # over sigma, where its values are zero, shape (n,)
    by: Array  # derivatives of the readings over sigma by its values in their own step, shape (n, q)
    bay: int | None = None  # at whose end a force acts, from 0


class _Block(NamedTuple):
    """One step: its readings, the residual in the directions of a source, and how strong these are."""

    step: int
    readings: NDArray[np.int_]  # shape (r,)
    active: NDArray[np.int_]  # values of the source that move the readings, shape (q,)
    # Singular vectors of the derivatives, shape (r, q), (q, q)
    left: Array
    strength: Array  # singular values, shape (q,)
    right: Array
    along: Array  # residual in the directions of ``left``, shape (q,)
    rest: float  # sum of squares of the residual across them


class _Likeliest(NamedTuple):
    """The likeliest scatter of a source."""

    source: _Source
    gain: float  # of the logarithmic likelihood
    size: float  # standard deviation of its values
    values: Array  # the most probable ones, shape (K, q)
    left: Array  # residual over sigma that they leave, shape (n,)
    systematic: bool  # whether the values follow something, or only a few inputs have errors


def find_scatter(problem: FitProblem, fit: Fit) -> Scatter | None:
    """What may be different in every step and would account for the residual of a model.

    Errors of the inputs, in proportion to them or alike for all; a shift of all positions; or a force on one disk. The
    last two count only where they account for all of it, from at least twice as many readings of a step as they have
    values there.

    Parameters
    ----------
    problem
        Readings and forward model.
    fit
        The model.

    Returns
    -------
    Scatter or None
        None where nothing would account for much, errors of the inputs would be systematic or larger than noise is, or
        the model was not solved.

    Raises
    ------
    OutOfTime
        The deadline of the problem has passed.
    """
    if not fit.solved or problem.roots:  # errors of the inputs that are declared are in the covariance
        return None
    experiment = problem.with_effects(fit.effects, fit.values)
    inputs, displaced = _inputs(experiment)
    bays = range(len(experiment.robot.bay_edges) - 1)
    found = [
        _likeliest(problem, fit, x, inputs)
        for x in _errors_of_inputs(problem, fit, experiment, inputs, displaced)
    ]
    if np.min(np.unique(problem.readings.step, return_counts=True)[1]) >= 6:
        others = (_shift(problem, fit), *_forces(problem, fit, experiment, bays))
        found += [_likeliest(problem, fit, x, inputs) for x in others if np.any(x.by)]
    for x in sorted((x for x in found if x.source.bay is not None), key=lambda x: -x.gain)[:PLACES]:
        assert x.source.bay is not None
        (source,) = _forces(problem, fit, experiment, [x.source.bay], x.values)
        found.append(_likeliest(problem, fit, source, inputs))
    likely = [
        x for x in found if _is_possible(problem, x, inputs) and x.gain >= 0.5 * chdtri(1, SIGNIFICANCE)
    ]
    if not likely:
        return None
    best = max(likely, key=lambda x: x.gain)
    scatter = _scatter(problem, fit.residual, best)
    accounts = scatter.after.chi2_per_dof <= MOST_REMAINING**2 * scatter.before.chi2_per_dof
    return scatter if accounts else None


def _scatter(problem: FitProblem, before: Array, found: _Likeliest) -> Scatter:
    """As it is reported; ``before``: residual over sigma without it, shape (n,)."""
    source = found.source
    place = "" if source.bay is None else end_of_bay(problem.experiment.robot.bay_edges, source.bay)
    misfits = (problem.misfit(r, np.ones(problem.count, dtype=bool)) for r in (before, found.left))
    return Scatter(source.what, place, found.size, source.unit, *misfits)


def _is_possible(problem: FitProblem, found: _Likeliest, inputs: Array) -> bool:
    """Whether it follows nothing, and errors of inputs are small, or anything else leaves only noise."""
    if found.source.what != "inputs":
        return not found.systematic and chi_square_z_score(found.left, found.values.size) <= NOISE_Z_SCORE
    largest = LARGEST if found.source.unit == "1" else LARGEST * float(np.max(np.abs(inputs)))
    return not found.systematic and found.size <= largest


def _errors_of_inputs(
    problem: FitProblem, fit: Fit, experiment: Experiment, inputs: Array, displaced: NDArray[np.bool_]
) -> list[_Source]:
    """Errors in proportion to the inputs, and such that are alike for all."""
    by, each = (
        _input_response(problem, experiment, fit.run.trajectories),
        inputs[problem.readings.step],
    )
    found = [_Source("inputs", "1", fit.residual, by * each)]
    driven = np.any(inputs != 0.0, axis=0)
    if len(set(displaced[driven].tolist())) == 1:
        unit = "m" if displaced[driven][0] else "N"
        found.append(_Source("inputs", unit, fit.residual, by * (each != 0.0)))
    return found


def _shift(problem: FitProblem, fit: Fit) -> _Source:
    """A shift of all positions along the axes of the world."""
    readings = problem.readings
    axes = np.eye(3)[readings.axes] * readings.is_position[:, None]
    return _Source("positions", "m", fit.residual, axes / problem.sigma[:, None])


def _forces(
    problem: FitProblem, fit: Fit, experiment: Experiment, bays: Sequence[int], near: Array | None = None
) -> list[_Source]:
    """A force on the ends of some bays, from 0, beside a run with forces of shape (K, 3 per bay); None: without."""
    steps, count = experiment.step_ends[-1][0] + 1, len(experiment.robot.bay_edges) - 1
    own = Action.none(steps, count) if fit.run.acted is None else fit.run.acted.action
    near = np.zeros((steps, 3 * len(bays))) if near is None else near
    action = Action(own.values.copy(), own.rotation)
    action.values[:, bays, FORCE] += near.reshape(steps, len(bays), 3)
    acted, every = with_action(experiment, action), action_inputs(count)
    asked = tuple(every[COMPONENTS * j + c] for j in bays for c in range(3))
    (run,) = problem.run([Job(acted, fit.run.trajectories, False, asked)])
    by = _derivatives(problem, acted, run)
    residual = problem.residual(acted, run) - problem.shift(fit.effects, fit.values, run)
    start = residual + np.einsum("nq,nq->n", by, near[problem.readings.step])
    parts = np.split(by, len(bays), axis=1)
    return [_Source("force", "N", start, x, j) for j, x in zip(bays, parts, strict=True)]


def _likeliest(problem: FitProblem, fit: Fit, source: _Source, inputs: Array) -> _Likeliest:
    """The likeliest scatter of a source; ``inputs``: of all steps, shape (K, n_tendons)."""
    blocks = _blocks(problem, source.residual, source.by)
    usual = float(np.median(np.concatenate([b.strength for b in blocks]) ** 2)) if blocks else 0.0
    usual = max(usual, 1e-300)

    def cost(exponent: float) -> float:
        return -_log_likelihood(blocks, 10.0**exponent / usual)

    optimum = minimize_scalar(cost, bounds=EXPONENTS, method="bounded", options={"xatol": 1e-3})
    ratio = 10.0 ** float(optimum.x) / usual
    errors = [b.right.T @ (b.along * ratio * b.strength / (1.0 + ratio * b.strength**2)) for b in blocks]
    values, left = np.zeros((len(inputs), source.by.shape[1])), source.residual.copy()
    for b, own in zip(blocks, errors, strict=True):
        values[b.step, b.active] = own
        left[b.readings] -= b.left @ (b.strength * (b.right @ own))
    nothing = 0.5 * problem.count * math.log(float(np.mean(fit.residual**2)))
    gain = _log_likelihood(blocks, ratio) + nothing
    if source.bay is not None:
        gain -= math.log(len(problem.experiment.robot.bay_edges) - 1)
    size = float(np.sqrt(ratio * _noise_variance(blocks, ratio)))
    if source.what == "inputs":
        systematic = _is_systematic(errors, blocks, inputs) or _are_rare(blocks, ratio)
    else:
        systematic = _follows_inputs(values, inputs)
    return _Likeliest(source, gain, size, values, left, systematic)


def _is_systematic(errors: Sequence[Array], blocks: Sequence[_Block], inputs: Array) -> bool:
    """Whether errors of inputs follow anything: then another cause is meant, and no scatter.

    A mean of a tendon that differs from zero, or a dependence on the input, its square, the direction in which it has
    changed, the row, or the error in the step before.
    """
    largest, count = max(float(np.max(np.abs(inputs))), 1e-300), inputs.shape[1]
    before = np.zeros(count)
    rows, goal = [], []
    for block, own in zip(blocks, errors, strict=True):
        last = inputs[block.step - 1] if block.step else np.zeros(count)
        for i, error in zip(block.active, own, strict=True):
            x, changed = inputs[block.step, i] / largest, np.sign(inputs[block.step, i] - last[i])
            rows.append((*np.eye(count)[i], x, x * x, changed, block.step, before[i]))
            goal.append(error)
            before[i] = error
    return _depends(np.array(rows, dtype=float), np.array(goal))


def _follows_inputs(values: Array, inputs: Array) -> bool:
    """Whether values of shape (K, q) have a mean, or depend on the inputs, each by itself."""
    known = np.column_stack((np.ones(len(inputs)), inputs))
    rows = np.asarray(np.kron(np.eye(values.shape[1]), known), dtype=float)
    return _depends(rows, values.T.ravel())


def _depends(rows: Array, goal: Array) -> bool:
    """Whether numbers depend linearly on others, shape (n, p), by the F test; also where there are too few."""
    rank = int(np.linalg.matrix_rank(rows)) if rows.size else 0
    spare = len(goal) - rank
    if spare < 3:
        return True
    left = float(np.sum((goal - rows @ np.linalg.lstsq(rows, goal, rcond=None)[0]) ** 2))
    ratio = (float(goal @ goal) - left) / rank / max(left / spare, 1e-300)
    return bool(fdtrc(rank, spare, ratio) < FOLLOWS)


def _are_rare(blocks: Sequence[_Block], ratio: float) -> bool:
    """Whether some steps have large errors and most have none, by the kurtosis: then something acts there alone."""
    z = np.concatenate([b.along / np.sqrt(1.0 + ratio * b.strength**2) for b in blocks])
    kurtosis = float(np.mean(z**4) / max(float(np.mean(z**2)) ** 2, 1e-300))
    return kurtosis - 3.0 > KURTOSIS * math.sqrt(24.0 / z.size)


def _blocks(problem: FitProblem, residual: Array, derivatives: Array) -> list[_Block]:
    """One block for every step with readings."""
    steps = problem.readings.step
    found = []
    for k in np.unique(steps):
        own = np.flatnonzero(steps == k)
        active = np.flatnonzero(np.any(derivatives[own] != 0.0, axis=0))
        left, strength, right = np.linalg.svd(derivatives[np.ix_(own, active)], full_matrices=False)
        along = left.T @ residual[own]
        rest = float(residual[own] @ residual[own] - along @ along)
        found.append(_Block(int(k), own, active, left, strength, right, along, rest))
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


def with_input_sigma(
    problem: FitProblem, effects: Sequence[Effect] = (), values: Point | None = None
) -> FitProblem:
    """The problem with the covariance that declared errors of the inputs give the readings of a model, by step.

    They are independent from step to step; what an error does to later steps through friction is left out.
    """
    if not problem.data.input_sigma:
        return problem
    experiment = problem.with_effects(effects, values or {})
    by_input = _input_response(problem, experiment) * np.array(problem.data.input_sigma)
    roots, steps = [], problem.readings.step
    for k in np.unique(steps):
        own = np.flatnonzero(steps == k)
        size, along = np.linalg.eigh(np.eye(own.size) + by_input[own] @ by_input[own].T)
        roots.append((own, np.asarray((along * np.sqrt(size)) @ along.T)))
    return replace(problem, roots=tuple(roots))


def _input_response(
    problem: FitProblem, experiment: Experiment, reference: Trajectories | None = None
) -> Array:
    """Derivatives of the readings over sigma by the inputs of their own step, shape (n, n_tendons)."""
    from tdcr_fe.solve.sensitivities.parameters import StepInput

    names = experiment.robot.tendon_names
    inputs = tuple(StepInput(f"inputs.{name}", tendon=i) for i, name in enumerate(names))
    (run,) = problem.run([Job(experiment, reference, False, inputs)])
    return _derivatives(problem, experiment, run)


def _derivatives(problem: FitProblem, experiment: Experiment, run: Run) -> Array:
    """Of the predictions over sigma by what a run is differentiated by, zero where not solved, shape (n, P)."""
    derivatives = problem.readings.derivatives(run, experiment) / problem.sigma[:, None]
    return np.where(np.isfinite(derivatives), derivatives, 0.0)
