"""What differs from step to step: errors of the inputs, a shift of all positions, or a force, and how large they are.

The values of every step are normally distributed with one variance. Its ratio to that of the readings is the likeliest
one (D. J. C. MacKay, Bayesian interpolation, Neural Computation 4, 1992); the values are then the most probable ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import chdtri, fdtrc

from tdcr_fe.effects import Effect, Experiment
from tdcr_fe.elements import Array, Flags, Index
from tdcr_fe.identify.bay_state import (
    COMPONENTS,
    FORCE,
    Action,
    action_inputs,
    at_ends,
    end_of_bay,
    with_action,
)
from tdcr_fe.identify.forward import Job
from tdcr_fe.identify.noise import REPORTED, chi_square_z_score
from tdcr_fe.identify.problem import NOISE_REACHES, Fit, FitProblem, Point
from tdcr_fe.identify.result import Scatter
from tdcr_fe.identify.run import Run, Trajectory

#: Errors of inputs must let the rms residual over sigma fall at least to this share, and be at most so large over the
#: input; beyond, something else is wrong [1].
MOST_REMAINING, LARGEST = 0.8, 0.25

#: Share of the variance of a force or a shift that may follow the inputs and the rows [1]: with more, it is the trace
#: of another cause. Springs, attractions and a stiffness that changes with time followed them by 0.9; true forces by
#: 0.15 if arbitrary, and by 0.77 if they turned slowly from row to row or acted in a few rows alone.
FOLLOWED = 0.85

#: Range of the ratio of the variances that is searched, as exponents of ten, over that at which both matter alike.
EXPONENTS = (-6.0, 6.0)

#: Sources that are simulated with their values of first order. That does not separate neighbouring disks (for a force
#: on the tip, 40 sigma off, the disk before it came first), and leaves out what an error does to later steps through
#: friction (rounded inputs left 1.96 of the noise, and 0.97 after it).
SIMULATED = 3


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
    readings: Index  # shape (r,)
    active: Index  # values of the source that move the readings, shape (q,)
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
    # whether the values follow something, so that another cause must be meant: errors of inputs must follow nothing at
    # all, since those of three inputs can imitate nearly any bending; forces and shifts not mostly inputs and rows
    followed: bool
    rare: bool  # whether only a few values differ from zero
    beyond: tuple[int, ...]  # steps, from 0, in which they are larger than noise


def find_scatter(problem: FitProblem, fit: Fit) -> Scatter | None:
    """What may be different in every step and would account for all that a model leaves.

    Errors of the inputs, in proportion to them or alike for all; a shift of all positions; or a force on one disk. Each
    from at least twice as many readings of a step as it has values there.

    Parameters
    ----------
    problem
        Readings and forward model.
    fit
        The model.

    Returns
    -------
    Scatter or None
        None where nothing accounts for all, its values mostly follow something else, or the model was not solved.

    Raises
    ------
    OutOfTime
        The deadline of the problem has passed.
    """
    if not fit.solved:
        return None
    fewest, sources = np.min(np.unique(problem.readings.step, return_counts=True)[1]), list[_Source]()
    if fewest >= 2 * len(problem.experiment.robot.tendons):
        sources += _errors(problem, fit)
    if fewest >= 6:
        bays = range(len(problem.experiment.robot.bay_edges) - 1)
        sources += [_shift(problem, fit), *_forces(problem, fit, bays)]
    found = _judged(problem, fit, sources)
    best = sorted(found, key=lambda x: -x.gain)[:SIMULATED]
    found += _judged(problem, fit, [_near(problem, fit, x.source, x.values) for x in best])
    noise = [x for x in found if chi_square_z_score(x.left, x.values.size) <= NOISE_REACHES]
    return _most_likely(problem, fit, [x for x in noise if not x.followed])


def errors_of_inputs(problem: FitProblem, fit: Fit) -> Scatter | None:
    """Errors of the inputs, as in `find_scatter`, that follow nothing and would account for much of what is left."""
    found = _judged(problem, fit, _errors(problem, fit)) if fit.solved else []
    return _most_likely(problem, fit, [x for x in found if not (x.followed or x.rare)])


def _judged(problem: FitProblem, fit: Fit, sources: Sequence[_Source]) -> list[_Likeliest]:
    """The likeliest scatter of each source that moves readings; none does where its run is not solved.

    Errors of inputs are the same in either unit: where they follow something in one, they do.
    """
    inputs = _inputs(problem.experiment)[0]
    found = [_likeliest(problem, fit, x, inputs) for x in sources if np.any(x.by)]
    followed = any(x.followed for x in found if x.source.what == "inputs")
    return [x._replace(followed=followed) if x.source.what == "inputs" else x for x in found]


def _most_likely(problem: FitProblem, fit: Fit, found: Sequence[_Likeliest]) -> Scatter | None:
    """The most likely of these; None where it would not account for much, or errors of inputs would be large."""
    largest = float(np.max(np.abs(_inputs(problem.experiment)[0])))

    def is_possible(x: _Likeliest) -> bool:
        return x.source.what != "inputs" or x.size <= LARGEST * (1.0 if x.source.unit == "1" else largest)

    likely = [x for x in found if x.gain >= 0.5 * chdtri(1, REPORTED) and is_possible(x)]
    if not likely:
        return None
    scatter = _scatter(problem, fit.residual, max(likely, key=lambda x: x.gain))
    accounts = scatter.after.chi2_per_dof <= MOST_REMAINING**2 * scatter.before.chi2_per_dof
    return scatter if accounts else None


def _scatter(problem: FitProblem, before: Array, found: _Likeliest) -> Scatter:
    """As it is reported; ``before``: residual over sigma without it, shape (n,)."""
    source = found.source
    place = "" if source.bay is None else end_of_bay(problem.experiment.robot.bay_edges, source.bay)
    left = problem.misfit(before), problem.misfit(found.left)
    rows = tuple(problem.data.step_ids[k] for k in found.beyond)
    few = rows if 2 * len(rows) < len(problem.data.step_ids) else ()
    return Scatter(source.what, place, found.size, source.unit, *left, few)


def _near(problem: FitProblem, fit: Fit, source: _Source, values: Array) -> _Source:
    """A source beside a run with values of it, shape (K, q)."""
    if source.what == "positions":
        return source
    if source.bay is None:
        return _errors(problem, fit, source.unit, values)[0]
    return _forces(problem, fit, [source.bay], values)[0]


def _errors(problem: FitProblem, fit: Fit, unit: str = "", near: Array | None = None) -> list[_Source]:
    """Errors in proportion to the inputs, and such that are alike for all; none where they are declared.

    Or those of one unit beside a run with such errors, shape (K, n_tendons).
    """
    if problem.roots:  # they are in the covariance
        return []
    experiment = problem.acted(fit.effects, fit.values, fit.run)
    inputs, displaced = _inputs(experiment)
    driven, sizes = np.any(inputs != 0.0, axis=0), {"1": inputs}
    if len(set(displaced[driven].tolist())) == 1:
        sizes["m" if displaced[driven][0] else "N"] = (inputs != 0.0).astype(float)
    if near is not None:
        sizes = {unit: sizes[unit]}
        experiment = _with_errors(experiment, near * sizes[unit])
    run, by = _by_inputs(problem, experiment, fit.run.trajectories)
    parts = [by * size[problem.readings.step] for size in sizes.values()]
    starts = _starts(problem, fit, experiment, run, parts, near)
    return [_Source("inputs", *x) for x in zip(sizes, starts, parts, strict=True)]


def _starts(
    problem: FitProblem, fit: Fit, acted: Experiment, run: Run, by: Sequence[Array], near: Array | None
) -> list[Array]:
    """Residual over sigma where values are zero, from a run with these, by source."""
    residual = problem.residual(acted, run) - problem.shift(fit.effects, fit.values, run)
    if near is None:
        return [residual] * len(by)
    return [residual + np.einsum("nq,nq->n", x, near[problem.readings.step]) for x in by]


def _with_errors(experiment: Experiment, errors: Array) -> Experiment:
    """The experiment, possibly with divided steps, with errors of the inputs, shape (K, n_tendons)."""
    steps, names = [], experiment.robot.tendon_names
    for step, here in at_ends(experiment, errors):
        by = dict(zip(names, here.tolist(), strict=True))
        moved: Any = {d.inputs: {n: x + by[n] for n, x in own.items()} for d, own in step.inputs()}
        moved["tensions"] = {n: max(x, 0.0) for n, x in moved["tensions"].items()}
        steps.append(replace(step, **moved))
    return replace(experiment, steps=tuple(steps))


def _shift(problem: FitProblem, fit: Fit) -> _Source:
    """A shift of all positions along the axes of the world."""
    readings = problem.readings
    axes = np.eye(3)[readings.axes] * readings.is_position[:, None]
    return _Source("positions", "m", fit.residual, problem.whitened(axes / problem.sigma[:, None]))


def _forces(problem: FitProblem, fit: Fit, bays: Sequence[int], near: Array | None = None) -> list[_Source]:
    """A force on the ends of some bays, from 0; or on the end of one, beside a run with such forces, shape (K, 3)."""
    experiment = problem.with_effects(fit.effects, fit.values)
    own = Action.none(experiment) if fit.run.acted is None else fit.run.acted.action
    action = Action(own.values.copy(), own.rotation)
    if near is not None:
        action.values[:, bays[0], FORCE] += near
    acted, every = with_action(experiment, action), action_inputs(experiment)
    asked = tuple(every[COMPONENTS * j + c] for j in bays for c in range(3))
    (run,) = problem.run([Job(acted, fit.run.trajectories, False, asked)])
    parts = np.split(problem.whitened(_derivatives(problem, acted, run, len(asked))), len(bays), axis=1)
    starts = _starts(problem, fit, acted, run, parts, near)
    return [_Source("force", "N", *x) for x in zip(starts, parts, bays, strict=True)]


def _likeliest(problem: FitProblem, fit: Fit, source: _Source, inputs: Array) -> _Likeliest:
    """The likeliest scatter of a source; ``inputs``: of all steps, shape (K, n_tendons)."""
    blocks = _blocks(problem, source.residual, source.by)
    usual = max(float(np.median(np.concatenate([b.strength for b in blocks]) ** 2)), 1e-300)

    def cost(exponent: float) -> float:
        return -_log_likelihood(blocks, 10.0**exponent / usual)

    optimum = minimize_scalar(cost, bounds=EXPONENTS, method="bounded", options={"xatol": 1e-3})
    ratio = 10.0 ** float(optimum.x) / usual
    values, left = np.zeros((len(inputs), source.by.shape[1])), source.residual.copy()
    active = np.zeros(values.shape, dtype=bool)
    for b in blocks:
        own = b.right.T @ (b.along * ratio * b.strength / (1.0 + ratio * b.strength**2))
        values[b.step, b.active], active[b.step, b.active] = own, True
        left[b.readings] -= b.left @ (b.strength * (b.right @ own))
    nothing = 0.5 * problem.count * math.log(float(np.mean(fit.residual**2)))
    gain = _log_likelihood(blocks, ratio) + nothing
    if source.bay is not None:
        gain -= math.log(len(problem.experiment.robot.bay_edges) - 1)
    noise = _noise_variance(blocks, ratio)
    size = float(np.sqrt(ratio * noise))
    if source.what == "inputs":
        followed = _is_systematic(values, active, inputs, fit.run.base_tensions)
    else:
        followed = _mostly_follow(values, active, inputs)
    rare = _are_rare(blocks, ratio)
    beyond = tuple(b.step for b in blocks if b.along @ b.along > noise * chdtri(b.active.size, REPORTED))
    return _Likeliest(source, gain, size, values, left, followed, rare, beyond)


def _is_systematic(values: Array, active: Flags, inputs: Array, tensions: Array) -> bool:
    """Whether errors of inputs, where they are active, follow anything.

    A mean of a tendon that differs from zero, or a dependence on the input, the tension at the base and their squares,
    the direction in which the input has changed, the row, or the error in the step before.
    """
    row, tendon = np.nonzero(active)
    x = inputs[active] / max(float(np.max(np.abs(inputs))), 1e-300)
    pull = tensions[active] / max(float(np.max(tensions)), 1e-300)
    changed = np.sign(np.diff(inputs, axis=0, prepend=0.0))[active]
    before = np.zeros(values.shape)
    for i, own in enumerate(active.T):
        before[own, i] = np.concatenate(([0.0], values[own, i]))[:-1]
    known = np.eye(len(active.T))[tendon], x, x * x, pull, pull * pull, changed, row, before[active]
    return _depends(np.column_stack(known), values[active])


def _mostly_follow(values: Array, active: Flags, inputs: Array) -> bool:
    """Whether values, where they are active, mostly follow inputs, rows and their products; also with too few steps."""
    row = np.arange(len(inputs))[:, None] / len(inputs)
    known = np.hstack([np.ones_like(row), inputs, row, row * inputs])
    squares, unexplained = 0.0, 0.0
    for x, own in zip(values.T, active.T, strict=True):
        x, rows = x[own], known[own]
        spare = len(x) - int(np.linalg.matrix_rank(rows)) if len(x) else 1
        if spare < 1:
            return True
        left = x - rows @ np.linalg.lstsq(rows, x, rcond=None)[0]
        squares, unexplained = squares + float(x @ x), unexplained + float(left @ left) / spare * len(x)
    return unexplained < (1.0 - FOLLOWED) * squares


def _depends(rows: Array, goal: Array) -> bool:
    """Whether numbers depend linearly on others, shape (n, p), by the F test; also where there are too few."""
    rank = int(np.linalg.matrix_rank(rows)) if rows.size else 0
    spare = len(goal) - rank
    if spare < 3:
        return True
    left = float(np.sum((goal - rows @ np.linalg.lstsq(rows, goal, rcond=None)[0]) ** 2))
    ratio = (float(goal @ goal) - left) / rank / max(left / spare, 1e-300)
    return bool(fdtrc(rank, spare, ratio) < REPORTED)


def _are_rare(blocks: Sequence[_Block], ratio: float) -> bool:
    """Whether some steps have large errors and most have none, by the kurtosis: then something acts there alone."""
    z = np.concatenate([b.along / np.sqrt(1.0 + ratio * b.strength**2) for b in blocks])
    kurtosis = float(np.mean(z**4) / max(float(np.mean(z**2)) ** 2, 1e-300))
    return kurtosis - 3.0 > NOISE_REACHES * math.sqrt(24.0 / z.size)


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
    """Log-likelihood of the residual at the likeliest variance of the readings, up to a constant."""
    count = sum(b.readings.size for b in blocks)
    spread = sum(float(np.sum(np.log1p(ratio * b.strength**2))) for b in blocks)
    return -0.5 * (count * float(np.log(max(_noise_variance(blocks, ratio), 1e-300))) + spread)


def _inputs(experiment: Experiment) -> tuple[Array, Flags]:
    """Inputs of all commanded steps, shape (K, n_tendons), and which tendons are driven by displacement."""
    actions = experiment.actions
    chosen = [actions[j] for j in experiment.whole_steps]
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
    by_input = _by_inputs(problem, experiment)[1] * np.array(problem.data.input_sigma)
    roots, steps = [], problem.readings.step
    for k in np.unique(steps):
        own = np.flatnonzero(steps == k)
        size, along = np.linalg.eigh(np.eye(own.size) + by_input[own] @ by_input[own].T)
        roots.append((own, np.asarray((along * np.sqrt(size)) @ along.T)))
    return replace(problem, roots=tuple(roots))


def _by_inputs(
    problem: FitProblem, experiment: Experiment, reference: Trajectory | None = None
) -> tuple[Run, Array]:
    """A run, and derivatives of the readings over sigma by the inputs of their own step, shape (n, n_tendons)."""
    from tdcr_fe.solve.sensitivities.parameters import StepInput

    names = experiment.robot.tendon_names
    inputs = tuple(StepInput(f"inputs.{name}", tendon=i) for i, name in enumerate(names))
    (run,) = problem.run([Job(experiment, reference, False, inputs)])
    return run, _derivatives(problem, experiment, run, len(inputs))


def _derivatives(problem: FitProblem, experiment: Experiment, run: Run, count: int) -> Array:
    """Derivatives of the predictions over sigma by the parameters of a run, zero where not solved, shape (n, count)."""
    if not run.solved:
        return np.zeros((problem.count, count))
    derivatives = problem.readings.derivatives(run, experiment) / problem.sigma[:, None]
    return np.where(np.isfinite(derivatives), derivatives, 0.0)
