"""Models with a law: runs in which the law holds in the solved state, and fits of its coefficients.

A law gives the action (`tdcr_fe.identify.law_state`) from the state of the bays, and the action changes the state. Both
agree where ``a = c F(x(a))``. That is solved by Newton's method with the exact response ``H`` of the bays to an
action, evaluated once: ``(I - c F' H) da = c F(x) - a``. Convergence is linear with the error of ``H``: in practice
three to five runs. A model whose iteration does not converge counts as not solved.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Experiment
from tdcr_fe.identify.law_state import (
    COMPONENTS,
    ActedRun,
    Action,
    ActionResponse,
    action_response,
    run_with_action,
)
from tdcr_fe.identify.law_terms import Term, library
from tdcr_fe.identify.problem import Fit, FitProblem, Point

Array = NDArray[np.float64]

#: Iterations of the state at most, and the change that ends them: moments over EI/L, forces over EI/L^2 [1].
ITERATIONS, TOLERANCE = 15, 2e-6

#: Iterations over which the rate of convergence is taken.
RATE_OVER = 3

#: Gauss-Newton iterations of a fit at most.
FIT_ITERATIONS = 8


class Law(NamedTuple):
    """A law with its coefficients."""

    terms: Sequence[Term]
    coefficients: Array  # in the terms' units, shape (q,)

    def action(self, run: ActedRun) -> Array:
        """That it gives in the state of a run, shape (K, n_bays, 5)."""
        total = np.zeros(run.action.shape)
        for term, c in zip(self.terms, self.coefficients, strict=True):
            total += c * term.action(run.state)
        return total

    def coupling(self, run: ActedRun, response: ActionResponse) -> Array:
        """The matrix ``I - c F' H`` of every step, shape (K, 5 n_bays, 5 n_bays)."""
        steps, bays, components = run.action.shape
        slope = np.zeros((steps, bays, components, components))
        for term, c in zip(self.terms, self.coefficients, strict=True):
            slope += c * term.slope(run.state)
        rows = response.state.reshape(steps, bays, components, -1)
        through = np.einsum("kbij,kbjp->kbip", slope, rows).reshape(steps, bays * components, -1)
        return np.asarray(np.eye(bays * components) - through)


@dataclass(frozen=True)
class LawFit:
    """A model of listed effects and a law, fitted together."""

    base: Fit  # the effects, whose sensitivities are used
    values: Point  # of their parameters, fitted beside the law
    law: Law
    acted: ActedRun
    # Robust sums of squares over fitted and held-out readings
    cost: float
    held_cost: float
    # of the predictions over sigma, by the base's free parameters and the coefficients, shape (n, p + q)
    jacobian: Array

    @property
    def terms(self) -> Sequence[Term]:
        """Of the law."""
        return self.law.terms

    @property
    def coefficients(self) -> Array:
        """Of the law, shape (q,)."""
        return self.law.coefficients

    @property
    def count(self) -> int:
        """Fitted numbers."""
        return len(self.base.free) + len(self.terms)

    def as_fit(self) -> Fit:
        """The whole model as a fit: its effects are the listed ones, its residual and free numbers include the law."""
        return replace(
            self.base,
            values=self.values,
            residual=self.acted.residual,
            cost=self.cost,
            held_cost=self.held_cost,
            jacobian=self.jacobian,
            free=(*self.base.free, *(("law", t.key) for t in self.terms)),
            run=self.acted.run,
        )


def balance(
    problem: FitProblem, experiment: Experiment, law: Law, start: ActedRun, response: ActionResponse
) -> ActedRun | None:
    """The run in which a law holds in the solved state, from a solved run on; None where it does not converge."""
    backbone = experiment.robot.backbone
    scale = np.array([backbone.EI / backbone.length] * 2 + [backbone.EI / backbone.length**2] * 3)
    here, sizes = start, [np.inf]
    for left in range(ITERATIONS, 0, -1):
        gap = law.action(here) - here.action
        size = float(np.max(np.abs(gap) / scale))
        if here is not start and size <= TOLERANCE:
            return here
        if not np.isfinite(size) or size > 10.0 * min(sizes):
            return None
        sizes.append(size)
        # A single iteration may gain nothing, near the accuracy of the solver: the rate is that of the last three.
        rate = (size / sizes[-1 - RATE_OVER]) ** (1.0 / RATE_OVER) if len(sizes) > RATE_OVER else 0.0
        if size * min(rate, 1.0) ** left > TOLERANCE:
            return None  # at this rate it does not converge
        change = np.linalg.solve(law.coupling(here, response), gap.reshape(len(gap), -1, 1)).reshape(
            gap.shape
        )
        for share in (1.0, 0.5):
            action = Action(here.action + share * change, here.state.rotation)
            following = run_with_action(problem, experiment, action, here)
            if following.solved:
                break
        else:
            return None
        here = following
    return None


def readings_of(problem: FitProblem, actions: Array, response: ActionResponse) -> Array:
    """Change of the predictions over sigma by actions of shape (K, 5 n_bays, q) to first order, shape (n, q)."""
    out = np.zeros((problem.count, actions.shape[-1]))
    for k, (mine, rows) in enumerate(response.readings):
        out[mine] = rows @ actions[k]
    return out


def fit_law(
    problem: FitProblem, base: Fit, law: Law, start: ActedRun, response: ActionResponse
) -> LawFit | None:
    """Fit the coefficients of a law, and the parameters of the base's effects beside it.

    Gauss and Newton with bounds on the effects' parameters; every trial is a run in which the law holds. None where
    none converges.
    """

    def trial(values: Point, coefficients: Array, start: ActedRun) -> LawFit | None:
        own = Law(law.terms, np.asarray(coefficients, dtype=float))
        run = balance(problem, problem.with_effects(base.effects, values), own, start, response)
        if run is None:
            return None
        cost, held_cost = problem.cost(run.residual)
        if not np.isfinite(cost + held_cost):
            return None
        # Derivatives of the predictions over sigma by the coefficients of the law that holds
        matrix = own.coupling(run, response)
        actions = np.stack([t.action(run.state).reshape(len(matrix), -1) for t in law.terms], axis=-1)
        columns = readings_of(problem, np.asarray(np.linalg.solve(matrix, actions), dtype=float), response)
        jacobian = np.concatenate((base.jacobian, columns), axis=1)
        return LawFit(base, values, own, run, cost, held_cost, jacobian)

    found = trial(base.values, law.coefficients, start)
    share = 1.0
    while found is None and share > 0.2:
        share *= 0.5
        found = trial(base.values, share * law.coefficients, start)
    if found is None:
        return None
    fitted, p = problem.fitted, len(base.free)
    by_name = {e.name: e for e in base.effects}
    limits = np.array([problem.bounds(by_name[k[0]], k[1]) for k in base.free]).reshape(p, 2)
    for _ in range(FIT_ITERATIONS):
        w = problem.root_weights(found.acted.residual)[fitted]
        a, b = found.jacobian[fitted] * w[:, None], found.acted.residual[fitted] * w
        norm = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
        move = np.linalg.lstsq(a / norm, b, rcond=1e-8)[0] / norm
        z = problem.coordinates(base.effects, found.values, base.free)
        promised = float(b @ b - np.sum((b - a @ move) ** 2))
        if promised < 0.05 + 1e-3 * found.cost:
            break
        for step in (1.0, 0.4, 0.15):
            goal = np.clip(z + step * move[:p], limits[:, 0], limits[:, 1])
            point = problem.point(base.effects, found.values, base.free, goal) if p else found.values
            better = trial(point, found.coefficients + step * move[p:], found.acted)
            if better is not None and better.cost < found.cost:
                break
        else:
            break
        assert better is not None
        gain, found = found.cost - better.cost, better
        if gain < 0.05 + 1e-3 * found.cost:
            break
    return found


#: Repetitions of reading the missing moments at most.
READINGS = 5

#: Terms of a pair must have a smaller cosine than this.
PARALLEL = 0.999

#: Share of the residual that nonlinearity leaves after one reading; size of missing moments over elastic ones [1].
CLOSER, PRIOR = 0.1, 0.3


@dataclass(frozen=True)
class LawSearch:
    """A base of listed effects with the missing moment read from the shapes, ready for laws beside it."""

    problem: FitProblem
    base: Fit
    # run in which the missing moments act, so that its state is that of the measured shapes
    reading: ActedRun
    response: ActionResponse  # of readings and bays in that state
    # what all actions together have to explain, over sigma: residual of that run, and what its action brings,
    # shape (n,)
    total: Array

    @classmethod
    def of(cls, problem: FitProblem, base: Fit, most_iterations: float = math.inf) -> LawSearch | None:
        """Beside a fitted model; None where it is not solved with loads at every disk, or one run takes too much."""
        experiment = problem.with_effects(base.effects, base.values)
        steps, bays = len(problem.data.steps), len(experiment.robot.bay_edges) - 1
        zero = np.zeros((steps, bays, COMPONENTS))
        upright = np.broadcast_to(np.eye(3), (steps, bays, 3, 3))
        run = run_with_action(problem, experiment, Action(zero, upright))
        if not run.solved or run.run.iterations > most_iterations:
            return None
        response, run = action_response(problem, experiment, run)
        for _ in range(READINGS):
            action = missing_action(problem, run, response)
            following = run_with_action(problem, experiment, Action(action, run.state.rotation), run)
            if not following.solved or problem.cost(following.residual)[0] > problem.cost(run.residual)[0]:
                break
            done = problem.cost(run.residual)[0] < 1.2 * problem.cost(following.residual)[0]
            response, run = action_response(problem, experiment, following)
            if done:
                break
        total = run.residual + explained(problem, run.action, response)
        return cls(problem, base, run, response, total)


def explained(problem: FitProblem, action: Array, response: ActionResponse) -> Array:
    """What an action brings to the predictions over sigma to first order, shape (n,)."""
    return readings_of(problem, action.reshape(len(action), -1, 1), response)[:, 0]


def missing_action(problem: FitProblem, run: ActedRun, response: ActionResponse) -> Array:
    """Missing bending moment of every bay and step, shape (K, n_bays, 5); forces are zero.

    The most probable one, for moments of about `PRIOR` times the elastic ones that vary less from bay to bay, and for
    readings whose error is sigma plus a share `CLOSER` of the present residual, which nonlinearity leaves.
    """
    steps, bays, _ = run.action.shape
    backbone = run.result.robot.backbone
    typical = float(np.sqrt(np.mean(np.sum(run.state.curvature[..., :2] ** 2, axis=-1))))
    size = PRIOR * backbone.EI * max(typical, 1e-3 / backbone.length)
    difference = np.kron(np.diff(np.eye(bays), axis=0), np.eye(2))
    precision = (difference.T @ difference / PRIOR**2 + np.eye(2 * bays)) / size**2
    moments = np.array([COMPONENTS * b + c for b in range(bays) for c in range(2)])
    total = run.residual + explained(problem, run.action, response)
    out = np.zeros((steps, COMPONENTS * bays))
    for k, (mine, rows) in enumerate(response.readings):
        if mine.size:
            a = rows[:, moments]
            variance = 1.0 + CLOSER**2 * float(np.mean(run.residual[mine] ** 2))
            out[k, moments] = np.linalg.solve(a.T @ a / variance + precision, a.T @ total[mine] / variance)
    return out.reshape(run.action.shape)


@dataclass(frozen=True)
class Columns:
    """Candidate terms as columns, freed of what the base's parameters can bring."""

    terms: tuple[Term, ...]
    free: Array  # weighted changes of the fitted readings over sigma by a term, of norm one, shape (m, q)
    size: Array  # coefficient that belongs to a column of norm one, shape (q,)
    rest: Array  # what has to be explained, shape (m,)

    @classmethod
    def of(cls, search: LawSearch) -> Columns:
        """All terms of the library in the state of the measured shapes."""
        problem, state = search.problem, search.reading.state
        terms = library(state)
        actions = np.stack([t.action(state).reshape(len(state.time), -1) for t in terms], axis=-1)
        scale = np.max(np.abs(actions), axis=(0, 1))
        fitted = problem.fitted
        w = problem.root_weights(search.reading.residual)[fitted]
        x = readings_of(problem, actions / scale, search.response)[fitted] * w[:, None]
        r = search.total[fitted] * w
        known = search.base.jacobian[fitted] * w[:, None]
        if known.shape[1]:
            basis = np.linalg.qr(known / np.maximum(np.linalg.norm(known, axis=0), 1e-300))[0]
            own = np.linalg.norm(x, axis=0)
            x, r = x - basis @ (basis.T @ x), r - basis @ (basis.T @ r)
        else:
            own = np.linalg.norm(x, axis=0)
        norm = np.linalg.norm(x, axis=0)
        seen = np.flatnonzero((norm > 1e-3 * own) & (norm > 1.0))
        return cls(
            tuple(terms[j] for j in seen), x[:, seen] / norm[seen], 1.0 / (scale[seen] * norm[seen]), r
        )

    def coefficients(self, which: Sequence[int]) -> Array:
        """Of some terms together, by least squares, in the terms' units."""
        found = np.linalg.lstsq(self.free[:, list(which)], self.rest, rcond=1e-10)[0]
        return np.asarray(found * self.size[list(which)])

    def left(self, which: Sequence[int]) -> float:
        """Sum of squares that some terms together leave."""
        x = self.free[:, list(which)]
        return float(np.sum((self.rest - x @ np.linalg.lstsq(x, self.rest, rcond=1e-10)[0]) ** 2))

    def best_sets(self, number: int, known: Sequence[int]) -> list[tuple[int, ...]]:
        """Sets of so many terms, the best first: all single terms, all pairs, or one more beside ``known``."""
        r = self.free.T @ self.rest
        if number == 1:
            return [(int(j),) for j in np.argsort(-(r**2))]
        if number == 2:
            gram = self.free.T @ self.free
            determinant = np.maximum(1.0 - gram**2, 1e-6)
            drop = (r[:, None] ** 2 + r[None, :] ** 2 - 2.0 * gram * r[:, None] * r[None, :]) / determinant
            drop[np.abs(gram) > PARALLEL] = 0.0
            rows, columns = np.triu_indices(len(r), 1)
            order = np.argsort(-drop[rows, columns])[:60]
            return [(int(rows[i]), int(columns[i])) for i in order]
        basis = np.linalg.qr(self.free[:, list(known)])[0]
        x = self.free - basis @ (basis.T @ self.free)
        norm = np.linalg.norm(x, axis=0)
        drop = np.where(norm > 0.05, (x.T @ self.rest) / np.maximum(norm, 1e-300), 0.0) ** 2
        return [(*known, int(j)) for j in np.argsort(-drop) if j not in known]
