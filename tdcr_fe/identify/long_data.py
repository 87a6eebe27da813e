"""Choice of load steps (rows of ``loading.csv``) for the search on long data, and the final fit to all of them.

A search simulates the loading sequence hundreds of times. On long data it takes a part of the steps that covers the
inputs. With friction the history matters, so that steps are not left out one by one at random:

- Whole branches are chosen, those whose inputs differ most from the ones chosen before (farthest-point sampling). A
  robot that returns to the same inputs between two branches brings little history from one to the next.
- Within a branch, steps are left out where the path of the inputs is nearly straight between its neighbours that stay
  (Ramer, Douglas and Peucker): friction that does not depend on the rate has the same history on the same path, in
  however many steps it is commanded. Turning points always stay.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Effect
from tdcr_fe.identify import fitting
from tdcr_fe.identify.criteria import robust_threshold
from tdcr_fe.identify.load_steps import blocks, inputs
from tdcr_fe.identify.problem import Fit, FitProblem, Point, evaluate, with_elements
from tdcr_fe.identify.result import SearchedSteps
from tdcr_fe.identify.search_state import Search, SearchState, mean_cost
from tdcr_fe.identify.settings import ALL_STEPS, SMALLER_MODELS, OutOfTime, clock
from tdcr_fe.io.measured import MeasuredData

Array = NDArray[np.float64]

#: A path whose inputs deviate by less than this from a straight one, over their range, is straight.
STRAIGHT = 0.02

#: Iterations of the final fit to all load steps at most.
FINAL_ITERATIONS = 4

#: Data with more steps than this are long; about how many steps a search then takes, and in a branch at most. Branches
#: of fewer steps on average are joined to pieces of twice as many.
LONG, SEARCHED, IN_BRANCH = 200, 72, 6

#: Steps that a search takes for each input, where that is more: with two branches of each, one parameter per tendon can
#: be determined.
PER_INPUT = 13

#: Share of the chosen steps that are held out, where there are enough of them.
HELD_OUT = 0.33


@dataclass(frozen=True)
class RowChoice:
    """The load steps that a search takes."""

    steps: tuple[int, ...]  # positions in the loading sequence, ascending
    readings: tuple[int, ...]  # indices of their readings
    total: int  # steps of the loading sequence

    def of(self, data: MeasuredData) -> MeasuredData:
        """The data of the chosen steps."""
        return replace(
            data,
            step_ids=tuple(data.step_ids[k] for k in self.steps),
            steps=tuple(data.steps[k] for k in self.steps),
            branches=tuple(data.branches[k] for k in self.steps),
            readings=tuple(data.readings[i] for i in self.readings),
        )

    def described(self, data: MeasuredData) -> SearchedSteps:
        """For the result; ``data`` are those of the final model, which has all load steps or the chosen ones."""
        every = len(data.step_ids) == self.total
        numbers = tuple(data.step_ids[k] for k in self.steps) if every else data.step_ids
        return SearchedSteps(numbers, self.total, every)


def choose_rows(data: MeasuredData, held_out: Sequence[int], history: bool = True) -> RowChoice | None:
    """The load steps that a search takes; None where it takes all, which is so for data that are not long.

    Parameters
    ----------
    data
        Measured data of one loading sequence.
    held_out
        Positions of the steps that are held out, whole branches.
    history
        Whether the model has friction. Without, every step is solved for itself and costs little: twice as many are
        taken, of more branches.

    Returns
    -------
    RowChoice or None
    """
    if len(data.steps) <= LONG or data.parts:
        return None
    read = {r.step for r in data.readings}
    with_readings = {k for k, n in enumerate(data.step_ids) if n in read}
    table, held = inputs(data), set(held_out)
    branches = [own for b in blocks(data) if (own := [k for k in b if k in with_readings])]
    if len(with_readings) < IN_BRANCH * len(branches):
        branches = _joined(branches, held)
    else:
        branches = [_simplified(table, b) for b in branches]
    groups = ([b for b in branches if b[0] in held], [b for b in branches if b[0] not in held])
    total = max(SEARCHED, PER_INPUT * int(np.count_nonzero(np.ptp(table, axis=0))))
    total *= 1 if history else 2
    share = round(HELD_OUT * total)
    rows = sorted(
        k
        for group, most in zip(groups, (share, total - share), strict=True)
        for k in _spread(table, group, most)
    )
    if len(rows) == len(data.steps):
        return None
    chosen = {data.step_ids[k] for k in rows}
    readings = tuple(i for i, r in enumerate(data.readings) if r.step in chosen)
    return RowChoice(tuple(rows), readings, len(data.steps))


def _joined(branches: Sequence[Sequence[int]], held: set[int]) -> list[list[int]]:
    """Neighbouring short branches as pieces of the sequence, each fitted or held out, twice as long as `IN_BRANCH`.

    Where the inputs turn at every other step, nothing can be left out between.
    """
    found: list[list[int]] = []
    for branch in branches:
        joins = found and len(found[-1]) < 2 * IN_BRANCH and (found[-1][0] in held) == (branch[0] in held)
        if joins and branch[0] == found[-1][-1] + 1:
            found[-1].extend(branch)
        else:
            found.append(list(branch))
    return found


def _simplified(table: Array, branch: Sequence[int]) -> list[int]:
    """Steps of a branch that describe the path of its inputs best, `IN_BRANCH` at most, ascending.

    The first, the last, and then always the step farthest from the straight path between its neighbours; where the path
    is straight, that in the middle of the longest part.
    """
    x = table[list(branch)]
    kept = {0, len(branch) - 1}
    parts: list[tuple[float, float, int, int, int]] = []

    def add(first: int, last: int) -> None:
        if last - first < 2:
            return
        chord = x[last] - x[first]
        along = (x[first + 1 : last] - x[first]) @ chord / max(float(chord @ chord), 1e-300)
        on = x[first] + np.clip(along, 0.0, 1.0)[:, None] * chord
        gap = np.max(np.abs(x[first + 1 : last] - on), axis=1)
        at = first + 1 + int(np.argmax(gap))
        far = float(np.max(gap))
        if far < STRAIGHT:
            at, far = first + 1 + int(np.argmin(np.abs(along - 0.5))), 0.0
        heapq.heappush(parts, (-far, -float(np.max(np.abs(chord))), first, at, last))

    add(0, len(branch) - 1)
    while parts and len(kept) < IN_BRANCH:
        _, _, first, at, last = heapq.heappop(parts)
        kept.add(at)
        add(first, at)
        add(at, last)
    return [branch[i] for i in sorted(kept)]


def _spread(table: Array, branches: Sequence[Sequence[int]], most: int) -> list[int]:
    """Steps of branches whose inputs differ most from each other, up to about so many; at least one branch."""
    if not branches:
        return []
    far = np.array([table[b[int(np.argmax(np.abs(table[list(b)]).max(axis=1)))]] for b in branches])
    chosen, distance = [0], np.max(np.abs(far - far[0]), axis=1)
    count = len(branches[0])
    while len(chosen) < len(branches):
        nearest = int(np.argmax(distance))
        if distance[nearest] <= 0.0 or count + len(branches[nearest]) > most:
            break
        chosen.append(nearest)
        count += len(branches[nearest])
        distance = np.minimum(distance, np.max(np.abs(far - far[nearest]), axis=1))
    return [k for i in chosen for k in branches[i]]


# ---------------------------------------------------------------------------------------------- the final fit


def problem_of_rows(problem: FitProblem, rows: RowChoice) -> FitProblem:
    """The same problem on chosen load steps, with the declared model."""
    index, data = np.array(rows.readings), rows.of(problem.data)
    sigma, held_out = problem.sigma[index], problem.held_out[index]
    fresh = FitProblem.of(data, sigma, held_out, problem.forward, problem.path_tolerance)
    at = {i: k for k, i in enumerate(rows.readings)}
    roots = tuple((np.array([at[i] for i in own]), root) for own, root in problem.roots if own[0] in at)
    return replace(fresh, catalogue=problem.catalogue, roots=roots)


def fit_to_all_rows(search: Search, state: SearchState, problem: FitProblem) -> SearchState:
    """The best model of a search on chosen load steps, fitted to all of them.

    The mesh is that of the search. First the best model is evaluated on all load steps with the parameters that the
    search has found; then it is fitted for as long as the time suffices. If time is left, smaller models on the way to
    the best one are evaluated with the parameters that the search has found for them.

    Parameters
    ----------
    search, state
        The search, with the deadline of this part, and its last state.
    problem
        Of all load steps.

    Returns
    -------
    SearchState
        Of all load steps; the state of the search where a model is not solved on all of them, or not in time.
    """
    search.report("the final fit to all load steps", 0.8)
    if state.problem.experiment.model.friction == "none":
        problem = without_friction(problem)
    problem = _on_mesh_of(state.problem, problem)
    begun = clock()
    try:
        problem, found = _evaluated(problem, state.best)
    except OutOfTime:
        return state.without_trying(ALL_STEPS)
    unsolved = [f for f in found if not f.solved]
    if unsolved:
        model = " + ".join(unsolved[0].names) or "the declared model"
        return state.with_history(f"no fit to all load steps: {model}: {unsolved[0].run.message}")
    duration = clock() - begun
    declared, best = found[0], found[-1]
    if best.effects:
        # An iteration is followed by a run on the path of the new parameters.
        race = fitting.Race(deadline=search.deadline - 2.0 * duration)
        (best,) = fitting.run_fits(problem, [fitting.finish(problem, best, race, FINAL_ITERATIONS)])
    everything = state.begun_anew(problem, declared, best)
    return _with_smaller_models(search, state, everything, duration)


def _on_mesh_of(searched: FitProblem, problem: FitProblem) -> FitProblem:
    """A problem with the mesh on which a search ended, and with what it knows of typical steps and of the mesh."""
    count = searched.experiment.model.starting_elements_per_bay
    experiment = with_elements(problem.experiment, count)
    return replace(problem, experiment=experiment, scales=searched.scales, mesh_error=searched.mesh_error)


def _evaluated(problem: FitProblem, best: Fit) -> tuple[FitProblem, list[Fit]]:
    """The declared model, and the best one with its derivatives, on all load steps, with the robust threshold there."""
    fits = [fitting.evaluated(problem, (), {}, ())]
    if best.effects:
        start = _within(problem, best.effects, best.values)
        fits.append(fitting.begin(problem, best.effects, [start], fitting.Race()))
    found = fitting.run_fits(problem, fits)
    if found[0].solved:
        problem = replace(problem, robust_threshold=robust_threshold(found[0].residual))
    costs = [problem.cost(f.residual) for f in found]
    return problem, [replace(f, cost=a, held_cost=b) for f, (a, b) in zip(found, costs, strict=True)]


def _with_smaller_models(
    search: Search, searched: SearchState, state: SearchState, duration: float
) -> SearchState:
    """With smaller models on the way to the best one, evaluated on all load steps where the time suffices.

    Parameters
    ----------
    search
        With the deadline.
    searched
        State of the search on chosen load steps.
    state
        Of all load steps.
    duration
        Of one run over all load steps with derivatives, which takes longer than without [s].
    """
    problem, effects = state.problem, state.best.effects
    parts = [effects[:i] for i in range(1, len(effects))]
    together = problem.forward.processes
    for first in range(0, len(parts), together):
        if clock() + duration > search.deadline:
            return state.without_trying(SMALLER_MODELS)
        models = [(part, _known_values(searched, part)) for part in parts[first : first + together]]
        fits = [fitting.evaluated(problem, e, _within(problem, e, v), ()) for e, v in models]
        try:
            found = fitting.run_fits(problem, fits)
        except OutOfTime:
            return state.without_trying(SMALLER_MODELS)
        for fit in found:
            state = state.with_fit(fit)
    return state


def _known_values(state: SearchState, part: Sequence[Effect]) -> Point:
    """Parameters of a smaller model that the search has fitted; of the best model where it has not."""
    names = [e.name for e in part]
    known = state.fits.get(frozenset(names))
    return {n: (known or state.best).values[n] for n in names}


def _within(problem: FitProblem, effects: Sequence[Effect], values: Point) -> Point:
    """Values within the bounds of a problem, which may depend on its load steps."""
    found: Point = {}
    for e in effects:
        found[e.name] = {}
        for p in e.parameters:
            low, high = problem.bounds(e, p.name)
            value = values[e.name][p.name]
            z = p.coordinate(value)
            found[e.name][p.name] = value if low <= z <= high else p.value(min(max(z, low), high))
    return found


#: Friction is left out where the misfit of the declared model grows by no more than this share.
WORSE = 0.1

#: Steps of the fit with friction, from the parameters found without.
ITERATIONS = 2


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


def with_friction(search: Search, state: SearchState, problem: FitProblem) -> SearchState:
    """The best model of a search without friction: with friction where it then fits better, its parameters fitted anew.

    Parameters
    ----------
    search, state
        The search and its last state, without friction.
    problem
        With friction.
    """
    search.report("the best model with friction", 0.8)
    threshold = state.problem.robust_threshold
    problem = replace(_on_mesh_of(state.problem, problem), robust_threshold=threshold)
    without = evaluate(without_friction(problem), state.best.effects, state.best.values)
    best = fitting.fit(problem, state.best.effects, [state.best.values], ITERATIONS)
    costs = [mean_cost(f.cost + f.held_cost, np.ones(problem.count, bool)) for f in (best, without)]
    if not costs[0] < costs[1]:
        return state.with_history(
            f"the declared friction is left out: with it the misfit per reading is {costs[0]:.3g}, without "
            f"{costs[1]:.3g}"
        )
    state = state.begun_anew(problem, evaluate(problem, (), {}), best)
    return state.with_history(
        f"with friction the misfit per reading is {costs[0]:.3g}, without {costs[1]:.3g}"
    )
