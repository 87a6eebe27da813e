"""Search for a law that nobody listed: reads the missing moment, regresses it sparsely, fits and judges the law.

The missing moment of every bay and load step is read from the residual through the exact response of the readings, as
smooth along the backbone as the noise allows. It corrects the state in which the candidate terms are evaluated. Terms
are then regressed on the residual itself (orthogonal matching pursuit in the metric of the readings), the best are put
into the model and fitted in full, and the number of terms is that at which the held-out steps stop improving.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.identify.criteria import (
    BIC_DIFFERENCE,
    HELD_OUT_DROP,
    bic,
    chi_square_threshold,
    effective_noise,
    is_improvement,
    lacks_test,
    noise_cost,
    residual_is_noise,
)
from tdcr_fe.identify.fitting import covariance
from tdcr_fe.identify.law_fit import Columns, Law, LawFit, LawSearch, fit_law
from tdcr_fe.identify.law_state import action_response, run_with_action
from tdcr_fe.identify.law_terms import CURVATURE, Term
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.identify.result import Estimate, FoundLaw, LawTerm
from tdcr_fe.identify.search_state import Search, SearchState, with_rival
from tdcr_fe.identify.settings import A_LAW, Budget, OutOfTime

Array = NDArray[np.float64]

#: Terms of a law at most, and candidates that are fitted in a round.
MOST_TERMS, FITTED = 3, 5

#: Fraction of the identification that is done when a law is searched for: after the first round, and after the search
#: for effects [1].
EARLY_PROGRESS, LAW_PROGRESS = 0.4, 0.92

#: Sets of terms whose predictions have a larger cosine than this are the same.
ALIKE = 0.999999

#: A further term must lower the held-out misfit at least by this factor.
LOWER = 0.95


@dataclass(frozen=True)
class LawAhead:
    """A law beside the declared model that leaves noise."""

    fit: LawFit
    alternatives: tuple[Term, ...]  # that explain as much in its place


def law_bic(problem: FitProblem, fit: LawFit) -> float:
    """As `tdcr_fe.identify.criteria.bic`, with a price for the choice of the terms, of their factors and their bays."""
    price = sum(
        len(t.factors) + (0.0 if t.bay is None else 1.0) + (t.direction.symbol not in ("kappa", "m_T"))
        for t in fit.terms
    )
    return fit.cost + fit.held_cost + (fit.count + 0.5 * price) * math.log(problem.count)


def search_law(
    ready: LawSearch,
    search: Search,
    budget: Budget | None = None,
    most_terms: int = MOST_TERMS,
    promise: float = math.inf,
) -> tuple[LawFit | None, tuple[Term, ...]]:
    """The law beside one base that the held-out steps support; and terms that explain as much in its place.

    Parameters
    ----------
    ready
        Base and response.
    search
        With the significance, and the function that is told what is done.
    budget
        No further fit begins where it is spent; None for no limit.
    most_terms
        Of a law.
    promise
        Nothing is fitted unless a single term leaves no more than this sum of squares to first order.
    """
    problem, significance = ready.problem, search.significance
    columns = Columns.of(ready)
    if not columns.terms or (promise < math.inf and columns.left(columns.best_sets(1, ())[0]) > promise):
        return None, ()
    best: LawFit | None = None
    alternatives: tuple[Term, ...] = ()
    known: tuple[int, ...] = ()
    for number in range(1, most_terms + 1):
        fits = _fitted(ready, columns, columns.best_sets(number, known), search, budget)
        if not fits:
            break
        fits.sort(key=lambda f: law_bic(problem, f[1]))
        which, new = fits[0]
        if not _improves(problem, new, best or ready.base, significance):
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
    ready: LawSearch,
    columns: Columns,
    sets: Sequence[tuple[int, ...]],
    search: Search,
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
        law = Law([columns.terms[j] for j in which], columns.coefficients(which))
        predicted = columns.free[:, list(which)] @ (law.coefficients / columns.size[list(which)])
        direction = predicted / max(float(np.linalg.norm(predicted)), 1e-300)
        if any(float(d @ direction) > ALIKE for d in taken):
            continue
        taken.append(direction)
        search.report("fitting the law " + " + ".join(t.key for t in law.terms), LAW_PROGRESS)
        found = fit_law(ready.problem, ready.base, law, ready.reading, ready.response)
        if found is not None:
            fits.append((which, found))
            if search.is_noise(ready.problem, found.as_fit()):
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


#: Newton iterations that a search for a law may always take (half a minute without friction, one and a half with), and
#: how many times its first run must fit into them [1].
LEAST_ITERATIONS, RUNS = 12_000, 40

#: Runs after which no further fit of a law begins.
MOST_RUNS = 120

#: A law is fitted before further effects where it leaves, to first order, at most so many times the cost of noise or
#: this share of what the best effect leaves: the first order is not exact.
NEARLY, PROMISE = 4.0, 0.05


def law_ahead(search: Search, state: SearchState, iterations: int = LEAST_ITERATIONS) -> SearchState:
    """Search for a law of one term beside the declared model, where the effects found so far leave more than noise.

    A law that leaves noise is kept. Then one further effect has to explain as much, and no more are tried. The search
    is made once: after the first round of the search for effects, or after a later one where it takes long. What it
    may take is counted in iterations, so that what is found does not depend on what else the machine does.

    Parameters
    ----------
    search, state
        After a round of the search for listed effects.
    iterations
        Newton iterations that the search may take, such as those of the rounds so far.

    Returns
    -------
    SearchState
        With `SearchState.law_ahead` where there is such a law.

    Raises
    ------
    OutOfTime
        The time limit has passed within a simulation.
    """
    problem = state.problem
    if not search.laws or state.law_sought or search.out_of_time or not _may_have_law(search, state):
        return state
    budget = _budget(search, problem, iterations)
    search.report("reading the missing moment from the shapes", EARLY_PROGRESS)
    ready = LawSearch.of(problem, state.declared, iterations / RUNS)
    if ready is None:
        return state
    state = replace(state, law_sought=True)
    early = replace(search, report=lambda text, _: search.report(text, EARLY_PROGRESS))
    promise = max(NEARLY * noise_cost(problem), PROMISE * state.best.cost)
    law, others = search_law(ready, early, budget, most_terms=1, promise=promise)
    if law is None or not search.is_noise(problem, law.as_fit()):
        return state
    state = state.with_history(f"an unlisted law leaves only noise: {law.terms[0].key}")
    return replace(state, law_ahead=LawAhead(law, others))


def find_law(
    search: Search, state: SearchState, iterations: int = LEAST_ITERATIONS
) -> tuple[FoundLaw | None, SearchState]:
    """The unlisted law that explains more than the listed effects; sought where these leave more than noise.

    The law is sought beside the declared model, the best model, and the best model without each of its effects. It
    counts only if it explains more than all listed effects together, by the criterion of all models and on the
    held-out steps. Of the effects beside it those are dropped that it makes unnecessary.

    Parameters
    ----------
    search, state
        What the search for listed effects has ended with.
    iterations
        Newton iterations that the search may take, if the time limit allows; the last fit ends after them.

    Returns
    -------
    law : FoundLaw or None
    state : SearchState
        Where a law was found, its best model has the law, and the listed effects that remain beside it. Where effects
        and a law explain the data alike, the best model has the effects, and the law is one of their rivals.

    Raises
    ------
    OutOfTime
        The time limit has passed.
    """
    best = state.best
    if state.law_ahead is not None:
        found, alternatives = _on_its_own_path(state, state.law_ahead.fit), state.law_ahead.alternatives
    else:
        if not _may_have_law(search, state):
            several = bool(state.problem.experiment.restarts)
            return None, state.with_history(
                "no search for a law with several data sets"
            ) if several else state
        if search.out_of_time:
            raise OutOfTime
        sought, alternatives, state = _sought(search, state, iterations)
        if sought is None:
            return None, state.with_history("no law explains more than the listed effects")
        found = _on_its_own_path(state, _without_unnecessary(search, state, sought))
    if not _explains_more(search, state, found, best):
        return None, _beside_the_effects(search, state, found, best)
    fit = found.as_fit()
    formula = " + ".join(f"{t.key}" for t in found.terms)
    kept = {k: v for k, v in state.rivals.items() if k in fit.names}
    state = replace(state, best=fit, rivals=kept).with_history(f"law found: {formula}")
    return _described(state, found, alternatives), state


def _budget(search: Search, problem: FitProblem, iterations: int) -> Budget:
    """So many iterations and `MOST_RUNS` more than were made so far, until the deadline of the search."""
    forward = problem.forward
    return Budget(forward, forward.runs + MOST_RUNS, forward.iterations + iterations, search.deadline)


def _may_have_law(search: Search, state: SearchState) -> bool:
    """Whether there is something left for a law, and held-out steps to judge it by."""
    problem, best = state.problem, state.best
    if problem.experiment.restarts or not np.any(problem.held_out) or lacks_test(problem, best):
        return False
    return best.solved and not search.is_noise(problem, best)


def _sought(
    search: Search, state: SearchState, iterations: int
) -> tuple[LawFit | None, tuple[Term, ...], SearchState]:
    """The best law beside any of the bases, with the terms that explain as much; and a history of what was left out."""
    problem = state.problem
    budget = _budget(search, problem, iterations)
    found: LawFit | None = None
    alternatives: tuple[Term, ...] = ()
    for base in _bases(state):
        if budget.spent:
            why = "out of time" if search.out_of_time else "too many runs before it"
            state = state.with_history(f"no search for a law {_beside(base)}: {why}")
            continue
        search.report("reading the missing moment from the shapes", LAW_PROGRESS)
        ready = LawSearch.of(problem, base, iterations / RUNS)
        if ready is None:
            state = state.with_history(f"no search for a law {_beside(base)}: too slow, or not solved")
            continue
        law, others = search_law(ready, search, budget)
        if law is not None and (found is None or law_bic(problem, law) < law_bic(problem, found)):
            found, alternatives = law, others
        if found is not None and search.is_noise(problem, found.as_fit()):
            break
    return found, alternatives, state


def _without_unnecessary(search: Search, state: SearchState, law: LawFit) -> LawFit:
    """The law without the listed effects that do not improve fitted and held-out steps beside it."""
    problem = state.problem
    for effect in law.base.effects:
        rest = frozenset(e.name for e in law.base.effects if e is not effect)
        base = state.fits.get(rest)
        if base is None or not base.solved or base.jacobian.shape[1] != len(base.free):
            continue
        values = {e.name: law.values[e.name] for e in base.effects}
        base = replace(base, values={**base.values, **values})
        experiment = problem.with_effects(base.effects, base.values)
        run = run_with_action(problem, experiment, law.acted.repeated)
        if not run.solved:
            continue
        response, run = action_response(problem, experiment, run)
        smaller = fit_law(problem, base, law.law, run, response)
        if smaller is not None and not is_improvement(
            problem, law.as_fit(), smaller.as_fit(), search.significance
        ):
            return _without_unnecessary(search, state, smaller)
    return law


def _bases(state: SearchState) -> list[Fit]:
    """Models beside which a law is sought: the declared one, and the best one whole and without each effect."""
    best = state.best
    smaller = [
        state.fits.get(frozenset(e.name for e in best.effects if e is not gone)) for gone in best.effects
    ]
    models = [state.declared, *(f for f in smaller if f is not None and f.effects), best]
    usable = [f for f in models if f.solved and f.jacobian.shape[1] == len(f.free)]
    return list({f.names: f for f in usable}.values())


def _beside(base: Fit) -> str:
    return f"beside {' + '.join(base.names)}" if base.effects else "beside the declared model"


def _explains_more(search: Search, state: SearchState, law: LawFit, rival: Fit) -> bool:
    """Whether a law clearly beats the listed effects, overall and on the held-out steps.

    Effects that leave noise are beaten on the held-out steps only by more than chance, others by a share.
    """
    problem = state.problem
    noise = effective_noise(problem, law.as_fit(), search.significance)
    gain = bic(problem, rival) - law_bic(problem, law)
    needed = (1.0 - LOWER) * rival.held_cost
    if search.is_noise(problem, rival):
        needed = HELD_OUT_DROP * noise
    return gain > BIC_DIFFERENCE * noise and rival.held_cost - law.held_cost > needed


def _beside_the_effects(search: Search, state: SearchState, law: LawFit, best: Fit) -> SearchState:
    """With the law as a rival of the effects where both explain the data alike."""
    problem = state.problem
    formula = " + ".join(t.key for t in law.terms)
    noise = effective_noise(problem, best, search.significance)
    # What the data say, without the price for the choice of the terms.
    if not best.effects or not bic(problem, law.as_fit()) - bic(problem, best) < BIC_DIFFERENCE * noise:
        return state.with_history("no law explains more than the listed effects")
    for effect in best.effects:
        state = with_rival(state, effect.name, f"{A_LAW} ({formula})")
    return state.with_history(f"an unlisted law explains the data equally well: {formula}")


def _on_its_own_path(state: SearchState, law: LawFit) -> LawFit:
    """The same law, simulated without the path of a neighbouring run."""
    problem = state.problem
    experiment = problem.with_effects(law.base.effects, law.values)
    run = run_with_action(problem, experiment, law.acted.repeated)
    if not run.solved:
        return law
    cost, held_cost = problem.cost(run.residual)
    return replace(law, acted=run, cost=cost, held_cost=held_cost)


# ---------------------------------------------------------------------------------------------------- texts


def _described(state: SearchState, law: LawFit, alternatives: Sequence[Term]) -> FoundLaw:
    """The law with its numbers, formula and sentence."""
    problem, fit = state.problem, law.as_fit()
    deviation = np.sqrt(np.maximum(np.diag(covariance(problem, fit)), 0.0))[len(law.base.free) :]
    experiment = problem.with_effects(law.base.effects, law.values)
    edges = experiment.robot.bay_edges
    terms = tuple(
        LawTerm(
            product=t.product,
            coefficient=Estimate(float(c), float(d), t.unit),
            where=where(t, edges),
            is_force=t.direction.is_force,
        )
        for t, c, d in zip(law.terms, law.coefficients, deviation, strict=True)
    )
    return FoundLaw(
        terms=terms,
        sentence=" ".join(sentence(t, float(c), edges) for t, c in zip(law.terms, law.coefficients, strict=True)),
        after_fit=problem.misfit(fit.residual, problem.fitted, len(fit.free)),
        after_held_out=problem.misfit(fit.residual, problem.held_out),
        alternatives=tuple(dict.fromkeys(t.key for t in alternatives)),
        steps=law.acted.steps,
    )  # fmt: skip


def where(term: Term, edges: Array) -> str:
    """Where a term acts."""
    if term.bay is None:
        return "all bays"
    if term.direction.is_force:
        return f"disk at s = {edges[term.bay + 1]:.4g} m"
    return f"bay {term.bay + 1} (s = {edges[term.bay]:.4g} to {edges[term.bay + 1]:.4g} m)"


_POWERS = {1: "", 2: "the square of ", 3: "the third power of "}

#: What the size of a direction is, in words.
_SIZES = {
    "kappa": CURVATURE.name,
    "kappa_x e_x": "the curvature about x",
    "kappa_y e_y": "the curvature about y",
    "e_z x kappa": CURVATURE.name,
    "m_T": "the moment of the tendons",
    "sum(sign_i m_Ti)": "the moment of each tendon",
    "sum(sign_i r_i)": "the lever of each tendon",
    "m_F": "the bending moment of the loads",
    "u": "the displacement",
}


def sentence(term: Term, coefficient: float, edges: Array) -> str:
    """What a term says, in words."""
    names = [f.name for f in term.factors]
    own = _SIZES.get(term.direction.symbol)
    names += [own] if own else []
    parts = []
    for name in dict.fromkeys(names):
        power = names.count(name)
        parts.append(f"{_POWERS.get(power, f'power {power} of ')}{name}")
    size = " times ".join(parts) or "a constant"
    place = where(term, edges)
    place = {"all bays": "In all bays"}.get(place, ("At the " if term.direction.is_force else "In ") + place)
    what = "a force" if term.direction.is_force else "a bending moment"
    pointing = term.direction.name
    if coefficient < 0.0:
        pointing = (
            pointing.replace("along ", "against ", 1)
            if pointing.startswith("along ")
            else f"negative {pointing}"
        )
    return f"{place}, {what} acts {pointing}, proportional to {size}; the declared model does not have it."
