"""Identification: traces the residual of a declared robot to effects that it is missing, until only noise is left."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from tdcr_fe.effects import EFFECTS, Effect, Experiment
from tdcr_fe.identify import fitting
from tdcr_fe.identify.criteria import WORTHWHILE, robust_threshold, unusable_data
from tdcr_fe.identify.data_faults import data_fault, other_sign_solves
from tdcr_fe.identify.forward import ForwardModel
from tdcr_fe.identify.next_experiment import choose_next
from tdcr_fe.identify.noise import estimate_sigma
from tdcr_fe.identify.problem import Fit, FitProblem, Point, evaluate, fit_of_run, refine, with_elements
from tdcr_fe.identify.result import IdentificationResult
from tdcr_fe.identify.rows import RowChoice, choose_held_out, choose_rows, held_out_branches, read_rows
from tdcr_fe.identify.run import Run
from tdcr_fe.identify.scatter import errors_of_inputs, with_input_sigma
from tdcr_fe.identify.search import search_causes, with_scatter
from tdcr_fe.identify.search_state import Progress, Search, SearchState, as_good, in_time
from tdcr_fe.identify.settings import FINAL_FIT, WITH_FRICTION, IdentifySettings, Part, clock
from tdcr_fe.identify.verdict import conclude
from tdcr_fe.io.measured import MeasuredData, first_checks, with_columns, without_unread_steps
from tdcr_fe.io.user_effects import check_on
from tdcr_fe.model.messages import warnings_to
from tdcr_fe.model.schema import check_instance

#: Tolerance of the loading path as a fraction of the noise of a position (a third of it is left), and its limits.
PATH_SHARE, TIGHTEST, LOOSEST = 0.6, 5e-5, 3e-4


class NotSolved(Exception):
    """The declared model does not converge on this loading sequence; the message names the step and the reason."""


def identify(
    data: MeasuredData, settings: IdentifySettings | None = None, progress: Progress | None = None
) -> IdentificationResult:
    """Trace the residual of a declared model to the effects that it is missing.

    Parameters
    ----------
    data
        Robot as declared, loading sequence, readings; see `tdcr_fe.io.measured.read_measured`.
    settings
        How the search works.
    progress
        Called with a sentence on what is done, and about which fraction of the work is done.

    Returns
    -------
    IdentificationResult
        Where Ctrl-C or SIGTERM interrupts the search, with the verdict "unfinished" and what was found until then.

    Raises
    ------
    TypeError
        An argument is of another type; the message names the expected type and the function to call.
    InputError
        ``settings.hold_out_branches`` matches no branch, or every step, or an effect of one's own fails, or a load is
        far beyond what the robot can carry; nothing was simulated.
    NotSolved
        The declared model does not converge.
    KeyboardInterrupt
        Interrupted before the declared model was solved.
    """
    check_instance("identify", "data", data, MeasuredData, "MeasuredData. read_measured(folder) reads it")
    hint = "IdentifySettings; those of the solver are data.settings"
    check_instance("identify", "settings", settings, (IdentifySettings, type(None)), hint)
    settings = settings or IdentifySettings()
    check_on(settings.own_effects, Experiment(data.robot, data.model, data.steps))
    first_checks(data).issued()
    with warnings_to():
        return _identified(data, settings, Search(settings, progress or (lambda text, share: None)))


def _identified(data: MeasuredData, settings: IdentifySettings, search: Search) -> IdentificationResult:
    """See `identify`."""
    begun, started = clock(), time.perf_counter()
    search.report("the declared model", 0.0)
    try:
        with ForwardModel(settings.processes, data.settings) as forward:
            prepared = prepare(without_unread_steps(data), settings, forward)
            state = search.keep(declared_state(prepared))
            state = _search(search, state, prepared, begun)
            search.report("conclusions", 0.97)
    except KeyboardInterrupt:  # the workers have ended
        if not search.kept:
            raise
        state = search.kept[0].with_history("interrupted; what was found until then is reported")
        state = state.logged(interrupted=True)
    return conclude(state, started, begun + settings.time_limit)


class Prepared(NamedTuple):
    """What a search begins with."""

    problem: FitProblem  # of all load steps
    # of those that the search uses, with mesh and path fine enough; the same readings where it uses all
    searched: FitProblem
    run: Run  # of the declared model, in that problem
    rows: RowChoice | None  # load steps that the search uses; None for all
    frictional: FitProblem | None  # where the search runs without friction: what its end runs with


def _search(search: Search, state: SearchState, prepared: Prepared, begun: float) -> SearchState:
    """Run the search to its end, with a law where effects do not suffice.

    A search on some of the load steps ends with a fit to all of them.
    """
    if unusable_data(state.problem, state.declared):
        return state
    limit = search.settings.time_limit
    end = begun + limit
    friction = end - FINAL_FIT * limit * (prepared.rows is not None)
    searched = friction - WITH_FRICTION * limit * (prepared.frictional is not None)
    state = in_time(search, state.ending_at(end), _with_fault, Part.FAULTS)
    if state.data_fault:
        return state
    state = in_time(search, state.ending_at(searched), search_causes, Part.FURTHER_EFFECTS)
    state = in_time(search, state.ending_at(friction), _with_next, Part.NEXT_EXPERIMENT)
    if prepared.rows is not None:
        if prepared.frictional is not None:
            frictional = replace(prepared.frictional, deadline=friction)
            state = in_time(search, state, partial(with_friction, frictional), Part.FRICTION)
        whole = replace(prepared.problem, deadline=end)
        state = in_time(search, state, partial(fit_to_all_rows, whole), Part.ALL_STEPS)
    if not search.explained(state):  # parameters of a model that leaves more than noise have no profiles
        return in_time(search, state, _scattered, Part.SCATTER)
    return in_time(search, state, _profiled, Part.PROFILES)


def _profiled(search: Search, state: SearchState) -> SearchState:
    """With the profiles of all parameters."""
    return replace(state, profiles=tuple(fitting.profiles(state.problem, state.best)))


def _scattered(search: Search, state: SearchState) -> SearchState:
    """With what is different in every step, where that explains all, or errors of the inputs that explain much."""
    state = with_scatter(state)
    return state if state.scatter else replace(state, scatter=errors_of_inputs(state.problem, state.best))


def _with_fault(search: Search, state: SearchState) -> SearchState:
    """With the fault of the data, where there is one."""
    return replace(state, data_fault=data_fault(state.problem, state.declared))


def _with_next(search: Search, state: SearchState) -> SearchState:
    """With the next experiment, where one helps."""
    return replace(state, next_experiment=choose_next(search, state))


def prepare(data: MeasuredData, settings: IdentifySettings, forward: ForwardModel) -> Prepared:
    """The problem with sigma known and steps held out; and that of the search, with mesh and path fine enough."""
    patterns = settings.hold_out_branches
    held = held_out_branches(data, patterns) if patterns else choose_held_out(data)
    held_out = np.isin(read_rows(data), held)
    problem = FitProblem.of(data, np.ones(len(data.readings)), held_out, forward, TIGHTEST)
    problem = replace(problem, catalogue=(*EFFECTS, *settings.own_effects))
    residual = np.full(problem.count, np.nan)
    if any(r.sigma is None for r in data.readings):
        residual = evaluate(problem, (), {}).residual
    sigma = estimate_sigma(data, residual)
    problem = with_input_sigma(replace(problem, sigma=sigma))
    is_position = problem.readings.is_position
    if np.any(is_position):
        share = PATH_SHARE * float(np.median(sigma[is_position])) / data.robot.backbone.length
        problem = replace(problem, path_tolerance=float(np.clip(share, TIGHTEST, LOOSEST)))
    rows, searched, frictional = choose_rows(data, held), problem, None
    if rows is not None:
        searched = problem.of_rows(rows)
        if friction_explains_little(searched):
            frictional = searched
            rows = choose_rows(data, held, history=False) or rows
            searched = without_friction(problem.of_rows(rows))
    run = evaluate(searched, (), {}).run
    if run.solved:
        searched, run = refine(searched, (), {}, run)
    return Prepared(problem, searched, run, rows, frictional)


def declared_state(prepared: Prepared) -> SearchState:
    """The state with the declared model alone.

    Raises
    ------
    NotSolved
    """
    problem = prepared.searched
    declared = fit_of_run(problem, (), {}, prepared.run)
    if not declared.solved:
        hint = other_sign_solves(problem)
        reason = with_columns(declared.run.message, problem.data)
        message = f"the declared model does not follow the loading sequence: {reason}"
        raise NotSolved(f"{message}{' ' if hint else ''}{hint}")
    problem = replace(problem, robust_threshold=robust_threshold(declared.residual))
    return SearchState.start(problem, problem.with_residual(declared, declared.residual), prepared.rows)


# ---------------------------------------------------------------------------------------------- the end of long data


def fit_to_all_rows(problem: FitProblem, search: Search, state: SearchState) -> SearchState:
    """The best model of a search on chosen load steps, fitted to all of them.

    The mesh is that of the search. First the best model is evaluated on all load steps with the parameters that the
    search has found; then it is fitted for as long as the time suffices. If time is left, other models are
    evaluated, see `_with_other_models`.

    Parameters
    ----------
    problem
        The problem on all load steps.
    search, state
        The search and its last state.

    Returns
    -------
    SearchState
        The state on all load steps; that of the search where a model is not solved on all of them.
    """
    search.report("the final fit to all load steps", 0.8)
    if state.problem.experiment.model.friction == "none":
        problem = without_friction(problem)
    problem = _on_mesh_of(state.problem, problem)
    problem, found = _evaluated(problem, state.best)
    unsolved = [f for f in found if not f.solved]
    if unsolved:
        return state.with_history(f"no fit to all load steps: {unsolved[0].title}: {unsolved[0].run.message}")
    declared, best = found[0], found[-1]
    if best.effects:
        (best,) = fitting.run_fits(problem, [fitting.finish(problem, best, fitting.Race())])
    anew = state.begun_anew(problem, declared, best)
    return in_time(search, anew, partial(_with_other_models, state), Part.OTHER_MODELS)


def _on_mesh_of(searched: FitProblem, problem: FitProblem) -> FitProblem:
    """A problem with the mesh on which a search ended, and with what it knows of typical steps and of the mesh."""
    experiment = with_elements(problem.experiment, searched.elements)
    return replace(problem, experiment=experiment, scales=searched.scales, mesh_error=searched.mesh_error)


def _evaluated(problem: FitProblem, best: Fit) -> tuple[FitProblem, list[Fit]]:
    """The declared model, and the best one with its derivatives, on all load steps, with the robust threshold there."""
    fits = [fitting.evaluated(problem, (), {}, ())]
    if best.effects:
        fits.append(fitting.begin(problem, best.effects, _within(problem, best.effects, best.values)))
    found = fitting.run_fits(problem, fits)
    if found[0].solved:
        problem = replace(problem, robust_threshold=robust_threshold(found[0].residual))
    return problem, [problem.with_residual(f, f.residual) for f in found]


def _with_other_models(searched: SearchState, search: Search, state: SearchState) -> SearchState:
    """With other models on all load steps, where the time suffices.

    Those on the way to the best one, and, where that leaves noise, those that explain as much: with the best one alone,
    its probability would be one. Those that the search has fitted are moved to the optimum of their linear model.

    Parameters
    ----------
    search
        With the deadline.
    searched
        State of the search on chosen load steps; a smaller model that it has not fitted has the values of the best.
    state
        The state on all load steps.
    """
    problem, effects = state.problem, state.best.effects
    fits = []
    for part in (effects[:i] for i in range(1, len(effects))):
        known = searched.fits.get(frozenset(e.name for e in part), searched.best)
        fits.append(fitting.evaluated(problem, part, _within(problem, part, known.values), ()))
    for other in as_good(searched) if search.explained(state) else ():
        start = _within(problem, other.effects, other.values)
        fits.append(fitting.begin(problem, other.effects, start, state.best))
    found = [fitting.linear_optimum(problem, fit) for fit in fitting.run_fits(problem, fits)]
    return replace(state, fits={**{frozenset(fit.names): fit for fit in found}, **state.fits})


def _within(problem: FitProblem, effects: Sequence[Effect], values: Point) -> Point:
    """Values within the bounds of a problem, which may depend on its load steps."""
    free = [(e.name, p.name) for e in effects for p in e.parameters]
    return problem.moved(effects, values, free, np.zeros(len(free)))


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
        The problem on those load steps that a search with friction takes.
    """
    if problem.experiment.model.friction == "none":
        return False
    frictionless = evaluate(without_friction(problem), (), {})
    if not frictionless.solved:
        return False
    frictional = evaluate(problem, (), {})
    cost, other = (f.cost + f.held_cost for f in (frictionless, frictional))
    return not frictional.solved or cost <= (1.0 + WORTHWHILE) * other


def with_friction(problem: FitProblem, search: Search, state: SearchState) -> SearchState:
    """The best model of a search without friction: with friction where it then fits better, its parameters fitted anew.

    Parameters
    ----------
    problem
        With friction.
    search
        The search, with the deadline of this part.
    state
        The last one of the search, without friction.
    """
    search.report("the best model with friction", 0.8)
    problem = replace(_on_mesh_of(state.problem, problem), robust_threshold=state.problem.robust_threshold)
    without = evaluate(without_friction(problem), state.best.effects, state.best.values)
    best = fitting.fit(problem, state.best.effects, state.best.values)
    costs = [(f.cost + f.held_cost) / problem.count for f in (best, without)]
    both = f"the misfit per reading is {costs[0]:.3g}, without {costs[1]:.3g}"
    if not costs[0] < costs[1]:
        return state.with_history(f"the declared friction is left out: with it {both}")
    state = state.begun_anew(problem, evaluate(problem, (), {}), best)
    return state.with_history(f"with friction {both}")
