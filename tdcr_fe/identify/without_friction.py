"""Search without friction, for long data that friction explains no better, and friction put back at its end.

With friction, a load step depends on those before it, and costs ten to a hundred times as much as one without. Where
the declared model fits no worse without friction, what it lacks is something else: the search then runs without
friction, and the best model gets the declared friction back, with its parameters fitted anew and with the effects that
act through friction as candidates.
"""

from __future__ import annotations

from dataclasses import replace

from tdcr_fe.identify import fitting
from tdcr_fe.identify.criteria import robust_threshold
from tdcr_fe.identify.problem import FitProblem, evaluate
from tdcr_fe.identify.search_state import Search, SearchState, Stage, mean_cost
from tdcr_fe.identify.selection import forward_selection

#: Friction is left out where the misfit of the declared model grows by no more than this share.
WORSE = 0.1

#: Steps of the fit with friction, from the parameters found without.
ITERATIONS = 4

#: Rounds of forward selection with friction.
ROUNDS = 2


def without_friction(problem: FitProblem) -> FitProblem:
    """The same problem for a model without friction; effects that act through friction are no candidates."""
    experiment = replace(problem.experiment, model=replace(problem.experiment.model, friction="none"))
    catalogue = tuple(e for e in problem.catalogue if not e.needs_friction)
    return replace(problem, experiment=experiment, catalogue=catalogue)


def friction_explains_little(problem: FitProblem) -> bool:
    """Whether the declared model, which has friction, fits about as well without it.

    Parameters
    ----------
    problem
        Of those load steps that a search with friction takes.
    """
    if problem.experiment.model.friction == "none":
        return False
    frictionless = evaluate(without_friction(problem), (), {})
    if not frictionless.solved:
        return False
    frictional = evaluate(problem, (), {})
    cost, other = (f.cost + f.held_cost for f in (frictionless, frictional))
    return not frictional.solved or cost <= (1.0 + WORSE) * other


def restore_friction(search: Search, state: SearchState, problem: FitProblem) -> Stage:
    """The best model of a search without friction, with friction: fitted anew, and further effects tried.

    Parameters
    ----------
    search, state
        The search and its last state, without friction.
    problem
        With friction.

    Returns
    -------
    SearchState
        With friction; that without where a model is not solved with it.
    """
    search.report("the best model with friction", 0.8)
    experiment = problem.experiment
    mesh = state.problem.experiment.model.elements_per_bay
    problem = replace(
        problem,
        experiment=replace(experiment, model=replace(experiment.model, elements_per_bay=mesh)),
        scales=state.problem.scales,
        mesh_error=state.problem.mesh_error,
    )
    declared = evaluate(problem, (), {})
    problem = replace(problem, robust_threshold=robust_threshold(declared.residual))
    declared = evaluate(problem, (), {})
    best = declared
    if state.best.effects:
        best = fitting.fit(problem, state.best.effects, [state.best.values], ITERATIONS)
    if not (declared.solved and best.solved):
        return state.with_history("with friction the best model is not solved; the search ended without it")
    problem = replace(
        problem, robust_threshold=min(problem.robust_threshold, robust_threshold(best.residual))
    )
    again = replace(state.begun_anew(problem, declared, best), refused=_without_friction(problem))
    again = again.with_history(
        f"with the declared friction, misfit per reading {mean_cost(best.cost, problem.fitted):.3g} on fitted and "
        f"{mean_cost(best.held_cost, problem.held_out):.3g} on held-out steps"
    )
    yield again
    settings = replace(search.settings, max_effects=len(best.effects) + ROUNDS)
    again = yield from forward_selection(replace(search, settings=settings), again, locate=False)
    again = replace(again, refused=state.refused)
    yield again
    return again


def _without_friction(problem: FitProblem) -> dict[str, str]:
    """Effects that do not act through friction: they were tried without it."""
    forms = (form for e in problem.catalogue if not e.needs_friction for form in e.forms(problem.experiment))
    return {form.name: "tried without friction" for form in forms}
