"""Search for a law that nobody listed: reads the missing moment, regresses it sparsely, fits and judges the law.

The missing moment of every bay and load step is read from the residual through the exact response of the readings, as
smooth along the backbone as the noise allows. It corrects the state in which the candidate terms are evaluated. Terms
are then regressed on the residual itself (orthogonal matching pursuit in the metric of the readings), the best are put
into the model and fitted in full, and the number of terms is that at which the held-out steps stop improving.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.identify.criteria import (
    BIC_DIFFERENCE,
    HELD_OUT_DROP,
    chi_square_threshold,
    effective_noise,
    residual_is_noise,
)
from tdcr_fe.identify.forward import ForwardModel
from tdcr_fe.identify.law_fit import LawFit, fit_law, readings_of
from tdcr_fe.identify.law_state import (
    COMPONENTS,
    ActedRun,
    ActionResponse,
    action_response,
    run_with_action,
)
from tdcr_fe.identify.law_terms import Term, library
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.identify.time_limit import clock

Array = NDArray[np.float64]

#: Terms of a law at most, and candidates that are fitted in a round.
MOST_TERMS, FITTED = 3, 5

#: Repetitions of reading the missing moments at most.
READINGS = 5

#: Share of the residual that nonlinearity leaves after one reading; size of missing moments over elastic ones [1].
CLOSER, PRIOR = 0.1, 0.3

#: Sets of terms whose predictions have a larger cosine than this are the same; terms of a pair must have a smaller one.
ALIKE, PARALLEL = 0.999999, 0.999

#: A further term must lower the held-out misfit at least by this factor.
LOWER = 0.95


@dataclass(frozen=True)
class Budget:
    """What a search may cost.

    Attributes
    ----------
    forward : ForwardModel
        Which counts the runs.
    runs, iterations : int
        Counts at which the budget is spent.
    deadline : float
        Reading of `tdcr_fe.identify.time_limit.clock` at which it is spent [s].
    """

    forward: ForwardModel
    runs: int
    iterations: int
    deadline: float

    @property
    def spent(self) -> bool:
        """Whether nothing further may begin."""
        forward = self.forward
        return forward.runs >= self.runs or forward.iterations >= self.iterations or clock() > self.deadline


@dataclass(frozen=True)
class LawSearch:
    """A base of listed effects with the missing moment read from the shapes, ready for laws beside it.

    Attributes
    ----------
    problem : FitProblem
    base : Fit
    reading : ActedRun
        Run in which the missing moments act, so that its state is that of the measured shapes.
    response : ActionResponse
        Of readings and bays in that state.
    total : ndarray, shape (n,)
        What all actions together have to explain, over sigma: residual of that run, and what its action brings.
    """

    problem: FitProblem
    base: Fit
    reading: ActedRun
    response: ActionResponse
    total: Array

    @classmethod
    def of(cls, problem: FitProblem, base: Fit, most_iterations: float = math.inf) -> LawSearch | None:
        """Beside a fitted model; None where it is not solved with loads at every disk, or one run takes too much."""
        experiment = problem.with_effects(base.effects, base.values)
        steps, bays = len(problem.data.steps), len(experiment.robot.bay_edges) - 1
        zero = np.zeros((steps, bays, COMPONENTS))
        upright = np.broadcast_to(np.eye(3), (steps, bays, 3, 3))
        run = run_with_action(problem, experiment, zero, upright)
        if not run.solved or run.run.iterations > most_iterations:
            return None
        response, run = action_response(problem, experiment, run)
        for _ in range(READINGS):
            action = missing_action(problem, run, response)
            following = run_with_action(problem, experiment, action, run.state.rotation, run)
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
class LawAhead:
    """A law beside the declared model that leaves noise.

    Attributes
    ----------
    fit : LawFit
    alternatives : tuple of Term
        That explain as much in its place.
    """

    fit: LawFit
    alternatives: tuple[Term, ...]


@dataclass(frozen=True)
class Columns:
    """Candidate terms as columns, freed of what the base's parameters can bring.

    Attributes
    ----------
    terms : tuple of Term
    free : ndarray, shape (m, q)
        Weighted changes of the fitted readings over sigma by a term, of norm one.
    size : ndarray, shape (q,)
        Coefficient that belongs to a column of norm one.
    rest : ndarray, shape (m,)
        What has to be explained.
    """

    terms: tuple[Term, ...]
    free: Array
    size: Array
    rest: Array

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


def law_bic(problem: FitProblem, fit: LawFit) -> float:
    """As `tdcr_fe.identify.criteria.bic`, with a price for the choice of the terms, of their factors and their bays."""
    price = sum(
        len(t.factors) + (0.0 if t.bay is None else 1.0) + (t.direction.symbol not in ("kappa", "m_T"))
        for t in fit.terms
    )
    return fit.cost + fit.held_cost + (fit.count + 0.5 * price) * math.log(problem.count)


def search_law(
    search: LawSearch,
    significance: float,
    report: Callable[[str], None],
    budget: Budget | None = None,
    most_terms: int = MOST_TERMS,
    promise: float = math.inf,
) -> tuple[LawFit | None, tuple[Term, ...]]:
    """The law beside one base that the held-out steps support; and terms that explain as much in its place.

    Parameters
    ----------
    search
        Base and response.
    significance
        Chance of adding an effect to data that miss nothing [1].
    report
        Called with a sentence on what is done.
    budget
        No further fit begins where it is spent; None for no limit.
    most_terms
        Of a law.
    promise
        Nothing is fitted unless a single term leaves no more than this sum of squares to first order.
    """
    problem, base = search.problem, search.base
    columns = Columns.of(search)
    if not columns.terms or (promise < math.inf and columns.left(columns.best_sets(1, ())[0]) > promise):
        return None, ()
    best: LawFit | None = None
    alternatives: tuple[Term, ...] = ()
    known: tuple[int, ...] = ()
    for number in range(1, most_terms + 1):
        sets = columns.best_sets(number, known)
        fits = _fitted(search, columns, sets, significance, report, budget)
        if not fits:
            break
        fits.sort(key=lambda f: law_bic(problem, f[1]))
        which, new = fits[0]
        if not _improves(problem, new, best or base, significance):
            break
        noise = effective_noise(problem, new.as_fit(), significance)
        if number == 1:
            limit = law_bic(problem, new) + BIC_DIFFERENCE * noise
            alternatives = tuple(f.terms[0] for _, f in fits[1:] if law_bic(problem, f) < limit)
        best, known = new, which
        if residual_is_noise(problem, best.as_fit(), significance):
            break
    return best, alternatives


def _fitted(
    search: LawSearch,
    columns: Columns,
    sets: Sequence[tuple[int, ...]],
    significance: float,
    report: Callable[[str], None],
    budget: Budget | None,
) -> list[tuple[tuple[int, ...], LawFit]]:
    """Fits of the best sets of terms that differ from each other; where one leaves noise, only of those near it."""
    fits: list[tuple[tuple[int, ...], LawFit]] = []
    taken: list[Array] = []
    least = columns.left(sets[0]) if sets else 0.0
    limit = 4.0 * least + 0.05 * float(np.sum(columns.rest**2))
    for which in sets:
        left = columns.left(which)
        if len(taken) >= FITTED or left > limit or (budget is not None and budget.spent):
            break
        predicted = columns.free[:, list(which)] @ (columns.coefficients(which) / columns.size[list(which)])
        direction = predicted / max(float(np.linalg.norm(predicted)), 1e-300)
        if any(float(d @ direction) > ALIKE for d in taken):
            continue
        taken.append(direction)
        terms = [columns.terms[j] for j in which]
        report("fitting the law " + " + ".join(t.key for t in terms))
        found = fit_law(
            search.problem,
            search.base,
            search.reading,
            search.response,
            terms,
            columns.coefficients(which),
        )
        if found is not None:
            fits.append((which, found))
            if residual_is_noise(search.problem, found.as_fit(), significance):
                limit = min(limit, 2.0 * least + 60.0)
    return fits


def _improves(problem: FitProblem, new: LawFit, old: LawFit | Fit, significance: float) -> bool:
    """Whether the fitted steps improve beyond chance, over all candidate terms, and the held-out steps as well."""
    level = max(1.0, new.cost / max(1, int(np.count_nonzero(problem.fitted)) - new.count))
    if old.cost - new.cost <= chi_square_threshold(2, 0.1 * significance) * level:
        return False
    if not np.any(problem.held_out):
        return False
    lower = old.held_cost - new.held_cost > HELD_OUT_DROP * level
    return bool(lower and new.held_cost < LOWER * old.held_cost)
